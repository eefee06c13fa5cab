//! Counter-based random numbers drawn in sequence for one item, with a record of the named ones.

use reference::num::rng::{Key, normal_f64, uniform_f64};

/// The draws of one purpose for one item: the n-th call always returns the same number.
#[derive(Clone, Debug)]
pub struct Draws {
    key: Key,
    named: Vec<(String, f64)>,
}

impl Draws {
    /// Starts at draw 0 of (seed, item, step, purpose).
    pub fn new(seed: u64, item: u64, step: u32, purpose: u16) -> Self {
        Self { key: Key { seed, item, step, purpose, draw: 0 }, named: Vec::new() }
    }

    fn next(&mut self) -> Key {
        let key = self.key;
        self.key.draw += 1;
        key
    }

    /// Uniform in (0, 1).
    pub fn unit(&mut self) -> f64 {
        uniform_f64(self.next())
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        normal_f64(self.next())
    }

    /// Uniform in (low, high).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// [`Self::range`], recorded under a name.
    pub fn named(&mut self, name: &str, low: f64, high: f64) -> f64 {
        let x = self.range(low, high);
        self.note(name, x);
        x
    }

    /// An integer n with low ≤ n < high.
    pub fn whole(&mut self, low: usize, high: usize) -> usize {
        low + ((high - low) as f64 * self.unit()) as usize
    }

    /// [`Self::whole`], recorded under a name.
    pub fn named_whole(&mut self, name: &str, low: usize, high: usize) -> usize {
        let n = self.whole(low, high);
        self.note(name, n as f64);
        n
    }

    /// True with probability p.
    pub fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }

    /// A random entry of a list.
    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.whole(0, from.len())]
    }

    /// An index drawn with probability proportional to its weight.
    pub fn weighted(&mut self, weights: &[f64]) -> usize {
        let total = weights.iter().fold(0.0, |s, w| s + w);
        let mut left = total * self.unit();
        for (i, w) in weights.iter().enumerate() {
            left -= w;
            if left < 0.0 {
                return i;
            }
        }
        weights.len() - 1
    }

    /// A uniformly distributed direction.
    pub fn direction(&mut self) -> [f64; 3] {
        let z = self.range(-1.0, 1.0);
        let angle = self.range(0.0, std::f64::consts::TAU);
        let r = (1.0 - z * z).sqrt();
        [r * reference::num::elem::cos(angle), r * reference::num::elem::sin(angle), z]
    }

    /// Records a parameter.
    pub fn note(&mut self, name: &str, value: f64) {
        self.named.push((name.to_owned(), value));
    }

    /// The recorded parameters, in the order in which they were drawn.
    pub fn parameters(self) -> Vec<(String, f64)> {
        self.named
    }
}
