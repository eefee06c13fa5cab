//! Decisions in the order in which an evaluation takes them: recorded, and replayed from a plan.
//!
//! An array of a plan that has fewer entries than an evaluation takes decisions is completed with its own. Such an
//! evaluation has taken another path, and its plan is another one.

use crate::array::{Arr, Named};

/// Choices per entry of an array of [`Bits`].
const WIDTH: usize = 32;

/// Choices between two ways: 32 to an entry, the first in the lowest bit, 1 where the condition holds.
pub(super) struct Bits<'a> {
    name: &'static str,
    given: Option<&'a [f64]>,
    words: Vec<f64>,
    taken: usize,
}

/// The given array, if it is there.
fn find<'a>(plan: Option<&'a Named<f64>>, name: &str) -> Option<&'a [f64]> {
    Some(&plan?.get(name)?.data)
}

impl<'a> Bits<'a> {
    pub(super) fn new(plan: Option<&'a Named<f64>>, name: &'static str) -> Self {
        Self { name, given: find(plan, name), words: Vec::new(), taken: 0 }
    }

    /// The next choice: the given one, or `own`.
    pub(super) fn choose(&mut self, own: bool) -> bool {
        let (word, bit) = (self.taken / WIDTH, self.taken % WIDTH);
        let given = self.given.and_then(|words| words.get(word));
        let choice = given.map_or(own, |&w| (w as u64 >> bit) & 1 == 1);
        if bit == 0 {
            self.words.push(0.0);
        }
        self.words[word] += if choice { (1_u64 << bit) as f64 } else { 0.0 };
        self.taken += 1;
        choice
    }

    /// Stores the choices, if there are any.
    pub(super) fn put(self, plan: &mut Named<f64>) {
        if !self.words.is_empty() {
            plan.insert(self.name.to_owned(), Arr::new(&[self.words.len()], self.words));
        }
    }
}

/// Rows of K numbers: indices, or values without a gradient.
pub(super) struct Rows<'a, const K: usize> {
    name: &'static str,
    given: Option<&'a [f64]>,
    numbers: Vec<f64>,
}

impl<'a, const K: usize> Rows<'a, K> {
    pub(super) fn new(plan: Option<&'a Named<f64>>, name: &'static str) -> Self {
        Self { name, given: find(plan, name), numbers: Vec::new() }
    }

    /// The next row of the plan.
    pub(super) fn given(&self) -> Option<[f64; K]> {
        let row = self.given?.get(self.numbers.len()..self.numbers.len() + K)?;
        Some(std::array::from_fn(|k| row[k]))
    }

    /// Stores the row that was used.
    pub(super) fn push(&mut self, row: [f64; K]) {
        self.numbers.extend(row);
    }

    /// Stores the rows, if there are any.
    pub(super) fn put(self, plan: &mut Named<f64>) {
        if !self.numbers.is_empty() {
            plan.insert(self.name.to_owned(), Arr::new(&[self.numbers.len() / K, K], self.numbers));
        }
    }
}
