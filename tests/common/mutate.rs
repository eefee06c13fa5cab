//! Mutations of valid files: damaged and malicious files.
//!
//! Case n of a seed is the same everywhere: every number is drawn from [`Rng`] with its own counter. A
//! failure prints the seed, the case and the mutations; `LASTLIGHT_CASE=n` then runs that case alone.
#![allow(dead_code, reason = "each test program uses its part")]

use lastlight::num::rng::Rng;

/// A mutation of a file. Positions are taken modulo the length of the file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Mutation {
    /// Inverts one bit.
    Flip { at: usize, bit: u8 },
    /// Removes everything from a position on.
    Cut { at: usize },
    /// Removes bytes.
    Remove { at: usize, len: usize },
    /// Writes bytes twice.
    Repeat { at: usize, len: usize },
    /// Replaces one byte.
    Byte { at: usize, value: u8 },
    /// Sets all bytes of a range to one value.
    Fill { at: usize, len: usize, value: u8 },
    /// Exchanges two ranges of the same length.
    Swap { at: usize, other: usize, len: usize },
    /// Replaces an integer of 2, 4 or 8 bytes.
    Integer { at: usize, value: u64, width: usize, big: bool },
    /// Adds to an integer of 2, 4 or 8 bytes, with wrap-around.
    Add { at: usize, value: u64, width: usize, big: bool },
    /// Replaces the next number that is written in digits.
    Digits { at: usize, value: u64 },
    /// Inserts a piece of another file.
    Splice { at: usize, other: usize, from: usize, len: usize },
}

/// Relative frequencies of the kinds, in their order.
const WEIGHTS: [usize; 11] = [4, 1, 1, 1, 2, 1, 1, 4, 2, 2, 1];

/// Values at which sizes, counts and offsets go wrong.
const INTERESTING: [u64; 12] = [
    0,
    1,
    u16::MAX as u64,
    i32::MAX as u64,
    1 << 31,
    u32::MAX as u64,
    1 << 32,
    1 << 40,
    i64::MAX as u64,
    1 << 63,
    u64::MAX - 7,
    u64::MAX,
];

/// What the draws are for, among those of a seed.
const PURPOSE: u16 = 1;

/// The draws of one file of one case, in order.
pub(crate) struct Draws {
    rng: Rng,
    case: u64,
    file: u32,
    purpose: u16,
    next: u16,
}

impl Draws {
    /// The first draw of a case; `purpose` separates the draws of different campaigns.
    pub(crate) fn new(seed: u64, case: u64, file: u32, purpose: u16) -> Self {
        Self { rng: Rng::new(seed), case, file, purpose, next: 0 }
    }

    /// An index below n.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        self.next += 1;
        self.rng.index(n, self.case, self.file, self.purpose, self.next)
    }

    pub(crate) fn word(&mut self) -> u64 {
        self.next += 1;
        let [a, b, ..] = self.rng.block(self.case, self.file, self.purpose, self.next);
        u64::from(b) << 32 | u64::from(a)
    }

    fn at(&mut self) -> usize {
        self.word() as usize
    }

    fn byte(&mut self) -> u8 {
        self.word() as u8
    }

    /// An interesting value, a small one, or any.
    fn integer(&mut self) -> u64 {
        match self.below(4) {
            0 => self.word(),
            1 => self.below(300) as u64,
            _ => INTERESTING[self.below(INTERESTING.len())],
        }
    }

    fn width(&mut self) -> usize {
        [2, 4, 8][self.below(3)]
    }

    /// The next mutation of bytes.
    pub(crate) fn mutation(&mut self) -> Mutation {
        let mut total = 0;
        WEIGHTS.iter().for_each(|w| total += w);
        let mut rest = self.below(total);
        let mut kind = 0;
        while rest >= WEIGHTS[kind] {
            rest -= WEIGHTS[kind];
            kind += 1;
        }
        let at = self.at();
        match kind {
            0 => Mutation::Flip { at, bit: self.below(8) as u8 },
            1 => Mutation::Cut { at },
            2 => Mutation::Remove { at, len: 1 + self.below(39) },
            3 => Mutation::Repeat { at, len: 1 + self.below(39) },
            4 => Mutation::Byte { at, value: self.byte() },
            5 => Mutation::Fill { at, len: 1 + self.below(39), value: [0, 0xff, b' ', b'9'][self.below(4)] },
            6 => Mutation::Swap { at, other: self.at(), len: 1 + self.below(39) },
            7 => {
                Mutation::Integer { at, value: self.integer(), width: self.width(), big: self.below(2) == 1 }
            }
            8 => {
                let by = 1 + self.below(8) as u64;
                let value = if self.below(2) == 1 { by } else { by.wrapping_neg() };
                Mutation::Add { at, value, width: self.width(), big: self.below(2) == 1 }
            }
            9 => Mutation::Digits { at, value: self.integer() },
            _ => Mutation::Splice { at, other: self.at(), from: self.at(), len: 1 + self.below(199) },
        }
    }
}

/// The mutations of one file of one case: one to four.
pub(crate) fn mutations(seed: u64, case: u64, file: usize) -> Vec<Mutation> {
    let mut draws = Draws::new(seed, case, file as u32, PURPOSE);
    let count = 1 + draws.below(4);
    (0..count).map(|_| draws.mutation()).collect()
}

/// A piece of at most `len` bytes from `at` on.
fn range(n: usize, at: usize, len: usize) -> std::ops::Range<usize> {
    let at = at % n;
    at..Ord::min(n, at + len)
}

/// Changes the integer of at most `width` bytes at a position; at the end of a file it has fewer.
fn integer(bytes: &mut [u8], at: usize, width: usize, big: bool, change: impl Fn(u64) -> u64) {
    let range = range(bytes.len(), at, width);
    let field = &mut bytes[range];
    if big {
        field.reverse();
    }
    let mut word = [0; 8];
    word[..field.len()].copy_from_slice(field);
    let word = change(u64::from_le_bytes(word)).to_le_bytes();
    field.copy_from_slice(&word[..field.len()]);
    if big {
        field.reverse();
    }
}

/// Applies a mutation; `files` are those that pieces are taken from. An empty file stays as it is.
pub(crate) fn apply(bytes: &mut Vec<u8>, mutation: &Mutation, files: &[&[u8]]) {
    let n = bytes.len();
    if n == 0 {
        return;
    }
    match *mutation {
        Mutation::Flip { at, bit } => bytes[at % n] ^= 1 << bit,
        Mutation::Cut { at } => bytes.truncate(at % n),
        Mutation::Remove { at, len } => drop(bytes.drain(range(n, at, len))),
        Mutation::Repeat { at, len } => {
            let piece = bytes[range(n, at, len)].to_vec();
            bytes.splice(at % n..at % n, piece);
        }
        Mutation::Byte { at, value } => bytes[at % n] = value,
        Mutation::Fill { at, len, value } => bytes[range(n, at, len)].fill(value),
        Mutation::Swap { at, other, len } => {
            let len = Ord::min(len, n - Ord::max(at % n, other % n));
            (0..len).for_each(|i| bytes.swap(at % n + i, other % n + i));
        }
        Mutation::Integer { at, value, width, big } => integer(bytes, at, width, big, |_| value),
        Mutation::Add { at, value, width, big } => {
            integer(bytes, at, width, big, |old| old.wrapping_add(value));
        }
        Mutation::Digits { at, value } => {
            let digit = (0..n).map(|i| (at % n + i) % n).find(|&i| bytes[i].is_ascii_digit());
            if let Some(start) = digit {
                let len = bytes[start..].iter().take_while(|b| b.is_ascii_digit()).count();
                bytes.splice(start..start + len, value.to_string().into_bytes());
            }
        }
        Mutation::Splice { at, other, from, len } => {
            let source = files[other % files.len()];
            let piece = source[range(source.len(), from, len)].to_vec();
            bytes.splice(at % n..at % n, piece);
        }
    }
}

/// Prints the case when a test fails.
struct Report<'a> {
    seed: u64,
    case: u64,
    file: usize,
    mutations: &'a [Mutation],
}

impl Drop for Report<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let Self { seed, case, file, mutations } = self;
            println!("seed {seed}, case {case}, file {file}: {mutations:?}");
            println!("LASTLIGHT_CASE={case} runs this case alone");
        }
    }
}

/// The cases to run: those below `count`, or the one that `LASTLIGHT_CASE` names.
fn cases(count: u64) -> std::ops::Range<u64> {
    match std::env::var("LASTLIGHT_CASE") {
        Ok(text) => {
            let case: u64 = text.parse().expect("LASTLIGHT_CASE is the number of a case");
            case..case + 1
        }
        Err(_) => 0..count,
    }
}

/// Runs `check` on mutations of every file, `count` times; it gets the number of the file and its bytes.
pub(crate) fn every_case(seed: u64, count: u64, files: &[&[u8]], check: impl Fn(usize, &[u8])) {
    for case in cases(count) {
        for (file, valid) in files.iter().enumerate() {
            let mutations = mutations(seed, case, file);
            let mut bytes = valid.to_vec();
            mutations.iter().for_each(|m| apply(&mut bytes, m, files));
            let _report = Report { seed, case, file, mutations: &mutations };
            check(file, &bytes);
        }
    }
}
