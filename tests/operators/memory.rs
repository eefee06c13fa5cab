//! Memory that operators take: counted by the allocator, for each thread by itself.

#![expect(unsafe_code, reason = "an allocator")]

use lastlight::nn::attention::{self, In, InBar};
use lastlight::num::par::with_threads;
use lastlight::num::rng::Rng;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Bytes that this thread holds now, and the most since [`most_bytes`] began.
    static HELD: Cell<[isize; 2]> = const { Cell::new([0; 2]) };
}

/// The allocator of the system, which counts.
struct Counting;

/// Adds to what the thread holds; a thread that ends has nothing to count with.
fn count(bytes: isize) {
    let _ = HELD.try_with(|held| {
        let [now, most] = held.get();
        let now = now + bytes;
        held.set([now, Ord::max(most, now)]);
    });
}

// SAFETY: every call is passed on to the allocator of the system, which keeps the contract; counting neither
// allocates nor unwinds. The other methods are the provided ones, which call these two.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size().cast_signed());
        // SAFETY: the caller's contract is that of this call.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count(-layout.size().cast_signed());
        // SAFETY: the caller's contract is that of this call.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The most bytes that `f` holds at once beside those before it, run by one thread.
fn most_bytes(f: impl FnOnce() + Send) -> isize {
    let counted = with_threads(1, || {
        HELD.set([0; 2]);
        f();
        HELD.get()[1]
    });
    counted.expect("a thread starts")
}

#[test]
fn attention_takes_memory_in_proportion_to_tokens() {
    const WIDTH: usize = 32;
    let normals = |n: usize, purpose: u16| -> Vec<f32> {
        (0..n).map(|i| Rng::new(5).normal_f32(i as u64, 0, purpose, 0)).collect()
    };
    let (w_qkv, w_out) = (normals(3 * WIDTH * WIDTH, 1), normals(WIDTH * WIDTH, 2));
    let [b_qkv, b_out] = [vec![0.0; 3 * WIDTH], vec![0.0; WIDTH]];
    let of = |tokens: usize| {
        let (x, y_bar) = (normals(tokens * WIDTH, 3), normals(tokens * WIDTH, 4));
        let x = In {
            x: &x,
            w_qkv: &w_qkv,
            b_qkv: &b_qkv,
            w_out: &w_out,
            b_out: &b_out,
            attended: &[],
            tokens,
            heads: 2,
        };
        most_bytes(|| {
            let mut y = vec![0.0; tokens * WIDTH];
            let saved = attention::forward(&x, &mut y);
            let mut bar = InBar::zeros_like(&x);
            attention::adjoint(&x, &saved, &y_bar, &mut bar);
        })
    };
    let [few, many] = [512, 2048].map(of);
    let array = (2048 * WIDTH * size_of::<f32>()).cast_signed();
    assert!(few > 0 && many <= 4 * few + array / 2, "{few} bytes for 512 tokens, {many} for 2 048");
    // The logits of one head would be 64 such arrays.
    assert!(many < 24 * array, "{many} bytes, {} arrays of all tokens", many / array);
}
