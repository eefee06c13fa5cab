//! The depth order: a radix sort of runs, followed by a merge; both are stable and independent of the number
//! of threads.

use super::splat::Splat;
use crate::num::{order, par};

/// Returns the indices of the visible splats by (z, index).
pub(super) fn depth_order(splats: &[Splat]) -> Vec<u32> {
    let key = |(i, s): (usize, &Splat)| (u64::from(order::key_f32(s.z)) << 32) | i as u64;
    let mut keys: Vec<u64> = splats.iter().enumerate().filter(|(_, s)| s.is_visible()).map(key).collect();
    let mut runs: Vec<&mut [u64]> = keys.chunks_mut(SORT_RUN).collect();
    par::chunks_mut(&mut runs, 1, |_, run| radix_sort(run[0]));
    let runs: Vec<&[u64]> = keys.chunks(SORT_RUN).collect();
    merge_runs(&runs).into_iter().map(|k| k as u32).collect()
}

/// Keys sorted by one task, a fixed number.
const SORT_RUN: usize = 1 << 15;

/// Sorts by the upper 32 bits in four passes of 8 bits; the sort is stable, so that the index order of the
/// input breaks ties.
fn radix_sort(keys: &mut [u64]) {
    let mut other = vec![0_u64; keys.len()];
    for pass in 0..4 {
        let shift = 32 + 8 * pass;
        let (from, to): (&[u64], &mut [u64]) =
            if pass % 2 == 0 { (keys, &mut other) } else { (&other, keys) };
        let mut start = [0_usize; 256];
        for k in from {
            start[(k >> shift & 255) as usize] += 1;
        }
        let mut sum = 0;
        for s in &mut start {
            (*s, sum) = (sum, sum + *s);
        }
        for &k in from {
            let slot = &mut start[(k >> shift & 255) as usize];
            to[*slot] = k;
            *slot += 1;
        }
    }
}

/// Merges sorted runs pairwise; keys are unique, so the result is unique.
fn merge_runs(runs: &[&[u64]]) -> Vec<u64> {
    match runs {
        [] => Vec::new(),
        [one] => one.to_vec(),
        _ => {
            let (l, r) = runs.split_at(runs.len() / 2);
            let (a, b) = par::join(|| merge_runs(l), || merge_runs(r));
            let mut out = Vec::with_capacity(a.len() + b.len());
            let (mut i, mut j) = (0, 0);
            while i < a.len() && j < b.len() {
                let take_a = a[i] < b[j];
                out.push(if take_a { a[i] } else { b[j] });
                i += usize::from(take_a);
                j += usize::from(!take_a);
            }
            out.extend_from_slice(&a[i..]);
            out.extend_from_slice(&b[j..]);
            out
        }
    }
}
