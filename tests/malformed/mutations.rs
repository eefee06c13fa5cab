//! The mutator itself: reproducible, of every kind, and able to find what is wrong with a reader.

use super::mutate::{Mutation, apply, every_case, mutations};
use std::mem::{Discriminant, discriminant};

#[test]
fn mutations_are_reproducible_and_of_every_kind() {
    let of = |seed, case, file| mutations(seed, case, file);
    assert_eq!(of(2, 7, 1), of(2, 7, 1), "the same case again");
    let others = [of(3, 7, 1), of(2, 8, 1), of(2, 7, 2)];
    assert!(others.iter().all(|m| *m != of(2, 7, 1)), "another seed, case or file");
    let mut kinds: Vec<(Discriminant<Mutation>, usize)> = Vec::new();
    let mut counts = [0; 4];
    for m in (0..1000).map(|case| of(2, case, 0)) {
        counts[m.len() - 1] += 1;
        for kind in m.iter().map(discriminant) {
            match kinds.iter_mut().find(|k| k.0 == kind) {
                Some(k) => k.1 += 1,
                None => kinds.push((kind, 1)),
            }
        }
    }
    assert!(kinds.len() == 11 && kinds.iter().all(|k| k.1 > 50), "every kind is drawn: {kinds:?}");
    assert!(counts.iter().all(|n| *n > 200), "one to four mutations: {counts:?}");
}

#[test]
fn every_mutation_does_what_it_says() {
    let after = |m: Mutation| {
        let mut bytes = b"ab12cdef".to_vec();
        apply(&mut bytes, &m, &[b"xyz"]);
        bytes
    };
    let huge = usize::MAX - 7;
    for (m, expected) in [
        (Mutation::Flip { at: 8, bit: 1 }, &b"cb12cdef"[..]),
        (Mutation::Cut { at: 3 }, b"ab1"),
        (Mutation::Remove { at: 6, len: 39 }, b"ab12cd"),
        (Mutation::Repeat { at: 0, len: 2 }, b"abab12cdef"),
        (Mutation::Byte { at: huge, value: b'-' }, b"-b12cdef"),
        (Mutation::Fill { at: 5, len: 39, value: b' ' }, b"ab12c   "),
        (Mutation::Swap { at: 0, other: 6, len: 39 }, b"ef12cdab"),
        (Mutation::Integer { at: 0, value: 0x4142, width: 2, big: true }, b"AB12cdef"),
        (Mutation::Integer { at: 7, value: 0x4142, width: 8, big: false }, b"ab12cdeB"),
        (Mutation::Add { at: 0, value: 1, width: 2, big: true }, b"ac12cdef"),
        (Mutation::Add { at: 0, value: u64::MAX, width: 4, big: false }, b"`b12cdef"),
        (Mutation::Digits { at: 4, value: 70 }, b"ab70cdef"),
        (Mutation::Splice { at: 1, other: 5, from: 4, len: 2 }, b"ayzb12cdef"),
    ] {
        assert_eq!(after(m.clone()), expected, "{m:?}");
    }
    let mut empty = Vec::new();
    apply(&mut empty, &Mutation::Cut { at: 3 }, &[b"xyz"]);
    assert!(empty.is_empty(), "nothing stays nothing");
}

/// A reader that trusts a length is found within the cases that are run by default.
#[test]
#[should_panic(expected = "range end index")]
fn a_reader_that_trusts_a_length_is_found() {
    let file = [&[4, 0, 0, 0][..], b"data"].concat();
    every_case(2, 5000, &[&file], |_, bytes| {
        let Some((length, rest)) = bytes.split_first_chunk::<4>() else { return };
        let _read = &rest[..u32::from_le_bytes(*length) as usize];
    });
}
