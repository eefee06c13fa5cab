//! Ordered parallel maps over fixed chunks; the number of threads affects no result.
//!
//! This is the only module that uses rayon. There is no parallel reduction: results are collected in index
//! order and combined by one thread, or by the tree of [`super::sum`].
//!
//! # One loop
//! Every map below ends in `pieces`, the only loop that is compiled with rayon's scheduler. It calls the
//! caller's closure through a pointer once per piece and not once per task, so the loops inside pieces are
//! compiled together with the closure and have no call overhead. The results of a piece, or its part of a
//! buffer, are stored in a separate slot; each owned task of [`map_each`] has a slot of its own. [`join`] and
//! [`with_threads`] are thin wrappers of rayon's functions.

use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Pieces of work per thread. rayon alone makes four pieces for two threads, and all threads may have to wait
/// for the last piece: a quarter of the time if costs are uneven.
const PIECES: usize = 32;

/// Returns the number of tasks per piece for `n` tasks, at least `batch` if there are that many; fewer than
/// two batches form one piece, which runs without other threads.
fn piece(n: usize, batch: usize) -> usize {
    let least = Ord::max(Ord::max(1, batch), n / (PIECES * threads()));
    Ord::max(1, n.div_ceil(Ord::max(1, n / least)))
}

/// Runs `job(0), …, job(n−1)` in any order, on any threads.
fn pieces(n: usize, job: &(dyn Fn(usize) + Sync)) {
    if n < 2 {
        (0..n).for_each(job);
    } else {
        (0..n).into_par_iter().with_max_len(1).for_each(job);
    }
}

/// Takes the contents of a slot. If another piece panicked, its panic is propagated to the caller, so a
/// poisoned lock can be ignored.
fn take<T: Default>(slot: &Mutex<T>) -> T {
    std::mem::take(&mut slot.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Returns `f(0), …, f(n−1)` in index order; each result depends only on its index.
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    map_batched(n, 1, f)
}

/// Like [`map`], with tasks distributed in batches of `batch`, for many small tasks. The batch size changes
/// no bit.
pub fn map_batched<T: Send>(n: usize, batch: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    let size = piece(n, batch);
    let mut slots: Vec<Mutex<Vec<T>>> = (0..n.div_ceil(size)).map(|_| Mutex::default()).collect();
    pieces(slots.len(), &|k| {
        let results = (k * size..Ord::min(n, (k + 1) * size)).map(&f).collect();
        *slots[k].lock().unwrap_or_else(PoisonError::into_inner) = results;
    });
    if let [slot] = &mut slots[..] {
        return take(slot);
    }
    let mut all = Vec::with_capacity(n);
    slots.iter().for_each(|slot| all.append(&mut take(slot)));
    all
}

/// Runs `f(chunk index, chunk)` over disjoint chunks of fixed length; the last may be shorter.
pub fn chunks_mut<T: Send>(data: &mut [T], len: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    let size = piece(data.len().div_ceil(len), 1);
    let slots: Vec<Mutex<&mut [T]>> = data.chunks_mut(len * size).map(Mutex::new).collect();
    pieces(slots.len(), &|k| {
        for (i, chunk) in take(&slots[k]).chunks_mut(len).enumerate() {
            f(k * size + i, chunk);
        }
    });
}

/// Runs `f(chunk index, chunk of a, chunk of b)` over matching disjoint chunks of two buffers.
pub fn chunks_mut2<A: Send, B: Send>(
    a: &mut [A],
    len_a: usize,
    b: &mut [B],
    len_b: usize,
    f: impl Fn(usize, &mut [A], &mut [B]) + Sync + Send,
) {
    assert_eq!(
        a.len().div_ceil(len_a),
        b.len().div_ceil(len_b),
        "both buffers have the same number of chunks"
    );
    let size = piece(a.len().div_ceil(len_a), 1);
    let pairs = a.chunks_mut(len_a * size).zip(b.chunks_mut(len_b * size));
    let slots: Vec<Mutex<(&mut [A], &mut [B])>> = pairs.map(Mutex::new).collect();
    pieces(slots.len(), &|k| {
        let (a, b) = take(&slots[k]);
        for (i, (a, b)) in a.chunks_mut(len_a).zip(b.chunks_mut(len_b)).enumerate() {
            f(k * size + i, a, b);
        }
    });
}

/// Returns `f(0, item 0), …` in order; each task owns its item (typically a disjoint `&mut` view).
pub fn map_each<A: Send, T: Send>(tasks: Vec<A>, f: impl Fn(usize, A) -> T + Sync + Send) -> Vec<T> {
    let slots: Vec<Mutex<Option<A>>> = tasks.into_iter().map(|task| Mutex::new(Some(task))).collect();
    map(slots.len(), |i| f(i, take(&slots[i]).expect("each task is taken exactly once")))
}

/// Runs one task per item of `tasks`, each owning its item (typically disjoint `&mut` views).
pub fn each<T: Send>(tasks: Vec<T>, f: impl Fn(usize, T) + Sync + Send) {
    map_each(tasks, f);
}

/// Runs both closures, possibly in parallel; they share no mutable state.
pub fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    rayon::join(a, b)
}

/// Returns the number of threads of the current pool. It is meant for reports only and must not affect how
/// work is divided.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// Runs `f` in a new pool of `n` threads, each of which has passed [`super::env::probe`].
///
/// # Errors
/// Returns an error if the floating-point environment of a thread is not the default one.
pub fn with_threads<T: Send>(n: usize, f: impl FnOnce() -> T + Send) -> crate::Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().map_err(|e| {
        crate::Error::input("threads").expected("a thread pool that starts").got(e.to_string())
    })?;
    for verdict in pool.broadcast(|_| super::env::probe()) {
        verdict?;
    }
    Ok(pool.install(f))
}
