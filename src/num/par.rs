//! Threads decide who computes, never what: ordered maps over fixed chunks.
//!
//! rayon is used here and nowhere else. There is no parallel reduction: results are collected in index order and
//! folded by one thread, or by the tree of [`super::sum`].

use rayon::prelude::*;

/// Pieces of work per thread. rayon alone makes four pieces for two threads, the last of which one thread may wait for: a quarter of the time
/// where cost is uneven.
const PIECES: usize = 32;

/// Most tasks that one piece of `n` has.
fn most(n: usize) -> usize {
    Ord::max(1, n / (PIECES * threads()))
}

/// `f(0), …, f(n−1)` in index order; each result depends on its index alone.
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    (0..n).into_par_iter().with_max_len(most(n)).map(f).collect()
}

/// Like [`map`] with tasks handed out `batch` at a time: for many small tasks. The batch changes no bit.
pub fn map_batched<T: Send>(n: usize, batch: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    (0..n).into_par_iter().with_min_len(batch).with_max_len(Ord::max(batch, most(n))).map(f).collect()
}

/// Runs `f(chunk index, chunk)` over disjoint chunks of fixed length; the last may be shorter.
pub fn chunks_mut<T: Send>(data: &mut [T], len: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    let most = most(data.len().div_ceil(len));
    data.par_chunks_mut(len).with_max_len(most).enumerate().for_each(|(i, c)| f(i, c));
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
    let most = most(a.len().div_ceil(len_a));
    let pairs = a.par_chunks_mut(len_a).zip(b.par_chunks_mut(len_b)).with_max_len(most);
    pairs.enumerate().for_each(|(i, (x, y))| f(i, x, y));
}

/// `f(0, item 0), …` in order, each task owning its item (typically a disjoint `&mut` view).
pub fn map_each<A: Send, T: Send>(tasks: Vec<A>, f: impl Fn(usize, A) -> T + Sync + Send) -> Vec<T> {
    let most = most(tasks.len());
    tasks.into_par_iter().with_max_len(most).enumerate().map(|(i, t)| f(i, t)).collect()
}

/// Runs one task per item of `tasks`, each owning its item (typically disjoint `&mut` views).
pub fn each<T: Send>(tasks: Vec<T>, f: impl Fn(usize, T) + Sync + Send) {
    let most = most(tasks.len());
    tasks.into_par_iter().with_max_len(most).enumerate().for_each(|(i, t)| f(i, t));
}

/// Both closures, possibly at the same time; they share nothing mutable.
pub fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    rayon::join(a, b)
}

/// Number of threads of the current pool; for reports only, never for the shape of work.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// Runs `f` in a pool of its own with `n` threads, each of which has passed [`super::env::probe`].
///
/// # Errors
/// When the floating-point environment of a thread is not the default one.
pub fn with_threads<T: Send>(n: usize, f: impl FnOnce() -> T + Send) -> crate::Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().map_err(|e| {
        crate::Error::input("threads").expected("a thread pool that starts").got(e.to_string())
    })?;
    for verdict in pool.broadcast(|_| super::env::probe()) {
        verdict?;
    }
    Ok(pool.install(f))
}
