//! A scalar reverse-mode tape, one per thread. It stays short because it is flushed after every pixel or row.
//!
//! [`leaves`] registers a stage's inputs at the bottom of the tape. A twin computes one pixel or row above
//! them, seeds its results with their cotangents and calls [`Scalar::sweep`]: adjoints are propagated to the
//! leaves, where they accumulate, and all nodes above the leaves are dropped. [`adjoints`] returns the
//! gradients.

use std::cell::RefCell;

use crate::array::Arr;
use crate::scalar::{Scalar, operators};

/// Index of a constant: it has no node on the tape.
const CONSTANT: u32 = u32::MAX;

/// A number and its node on the tape of this thread.
#[derive(Clone, Copy, Debug)]
pub struct Rev {
    index: u32,
    value: f64,
}

#[derive(Clone, Copy)]
struct Node {
    parents: [u32; 2],
    slopes: [f64; 2],
}

#[derive(Default)]
struct Tape {
    nodes: Vec<Node>,
    /// First node above the leaves.
    mark: usize,
    /// One adjoint per node.
    adjoints: Vec<f64>,
}

thread_local! {
    static TAPE: RefCell<Tape> = RefCell::new(Tape::default());
}

fn push(parents: [u32; 2], slopes: [f64; 2]) -> u32 {
    TAPE.with_borrow_mut(|tape| {
        let index = tape.nodes.len();
        assert!(index < CONSTANT as usize, "more than 2^32 - 1 numbers between two sweeps");
        tape.nodes.push(Node { parents, slopes });
        tape.adjoints.push(0.0);
        index as u32
    })
}

/// Empties the tape. Numbers made before must not be used any more.
pub fn clear() {
    TAPE.with_borrow_mut(|tape| {
        tape.nodes.clear();
        tape.adjoints.clear();
        tape.mark = 0;
    });
}

/// Registers every entry of an array as a leaf. All leaves are registered before the first operation.
pub fn leaves(x: &Arr<f64>) -> Arr<Rev> {
    let data = x.data.iter().map(|&value| Rev { index: push([CONSTANT; 2], [0.0; 2]), value }).collect();
    TAPE.with_borrow_mut(|tape| {
        assert!(tape.mark + x.data.len() == tape.nodes.len(), "leaves come before operations");
        tape.mark = tape.nodes.len();
    });
    Arr { shape: x.shape.clone(), data }
}

/// The accumulated adjoints of leaves.
pub fn adjoints(x: &Arr<Rev>) -> Arr<f64> {
    TAPE.with_borrow(|tape| {
        let read = |r: &Rev| if r.index == CONSTANT { 0.0 } else { tape.adjoints[r.index as usize] };
        Arr { shape: x.shape.clone(), data: x.data.iter().map(read).collect() }
    })
}

impl Scalar for Rev {
    fn from_f64(x: f64) -> Self {
        Self { index: CONSTANT, value: x }
    }
    fn value(self) -> f64 {
        self.value
    }
    fn chain(self, value: f64, slope: f64) -> Self {
        if self.index == CONSTANT {
            return Self::from_f64(value);
        }
        Self { index: push([self.index, CONSTANT], [slope, 0.0]), value }
    }
    fn chain2(self, other: Self, value: f64, slopes: [f64; 2]) -> Self {
        if self.index == CONSTANT && other.index == CONSTANT {
            return Self::from_f64(value);
        }
        Self { index: push([self.index, other.index], slopes), value }
    }
    fn seed(self, cotangent: f64) {
        if self.index != CONSTANT {
            TAPE.with_borrow_mut(|tape| tape.adjoints[self.index as usize] += cotangent);
        }
    }
    fn sweep() {
        TAPE.with_borrow_mut(|tape| {
            let Tape { nodes, mark, adjoints } = tape;
            for i in (*mark..nodes.len()).rev() {
                let (node, bar) = (nodes[i], adjoints[i]);
                if bar == 0.0 {
                    continue;
                }
                for (parent, slope) in node.parents.into_iter().zip(node.slopes) {
                    if parent != CONSTANT && slope != 0.0 {
                        adjoints[parent as usize] += slope * bar;
                    }
                }
            }
            nodes.truncate(*mark);
            adjoints.truncate(*mark);
        });
    }
}

operators!(Rev);
