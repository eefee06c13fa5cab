//! Ties, orders, ordered maps, digests.

use lastlight::num::array::Array;
use lastlight::num::{bits, order, par};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicIsize, Ordering};

#[test]
fn ties_go_to_the_first_argument() {
    for (a, b) in [(0.0_f32, -0.0_f32), (-0.0, 0.0)] {
        assert_eq!(order::min(a, b).to_bits(), a.to_bits());
        assert_eq!(order::max(a, b).to_bits(), a.to_bits());
    }
    assert_eq!(order::clamp(-0.0_f32, 0.0, 1.0).to_bits(), (-0.0_f32).to_bits());
    assert_eq!((order::clamp(2.0, 0.0, 1.0), order::clamp(-2.0, 0.0, 1.0)), (1.0, 0.0));
}

#[test]
fn keys_order_like_numbers() {
    let inf = f32::INFINITY;
    let rising = [-inf, -3.4e38, -1.0, -1e-45, 0.0, 1e-45, 1.0, 1.000_000_1, 3.4e38, inf];
    assert!(rising.windows(2).all(|w| order::key_f32(w[0]) < order::key_f32(w[1])), "strictly rising");
    assert_eq!(order::key_f32(-0.0), order::key_f32(0.0));
}

#[test]
fn maps_keep_the_order_of_indices() {
    for threads in [1, 2, 7] {
        let (plain, batched, chunks) = par::with_threads(threads, || {
            let mut chunks = vec![0; 1001];
            par::chunks_mut(&mut chunks, 64, |c, part| part.iter_mut().for_each(|x| *x = c));
            (par::map(1000, |i| 3 * i), par::map_batched(1000, 37, |i| 3 * i), chunks)
        })
        .expect("the environment of a fresh pool is the default one");
        assert!((0..1000).all(|i| plain[i] == 3 * i && batched[i] == 3 * i), "{threads} threads");
        assert!((0..1001).all(|i| chunks[i] == i / 64), "{threads} threads");
    }
}

#[test]
fn two_buffers_are_cut_alike() {
    let (mut a, mut b) = (vec![0; 10], vec![0; 5]);
    par::chunks_mut2(&mut a, 4, &mut b, 2, |i, a, b| {
        a.fill(i);
        b.fill(10 * i);
    });
    assert_eq!((a, b), (vec![0, 0, 0, 0, 1, 1, 1, 1, 2, 2], vec![0, 0, 10, 10, 20]));
}

/// In pools of 1, 2 and 7 threads.
fn in_pools(f: impl Fn(usize) + Sync) {
    for threads in [1, 2, 7] {
        par::with_threads(threads, || f(threads))
            .expect("the environment of a fresh pool is the default one");
    }
}

/// So many chunks that a piece holds several, whatever the number of threads.
const CHUNKS: usize = 5000;

#[test]
fn many_chunks_keep_their_numbers() {
    in_pools(|threads| {
        let mut whole = vec![usize::MAX; 3 * CHUNKS - 1];
        par::chunks_mut(&mut whole, 3, |i, part| part.iter_mut().for_each(|x| *x = i));
        assert!(whole.iter().enumerate().all(|(at, x)| *x == at / 3), "{threads} threads");
        let (mut a, mut b) = (vec![(0, 0); 4 * CHUNKS - 2], vec![(0, 0); CHUNKS]);
        par::chunks_mut2(&mut a, 4, &mut b, 1, |i, a, b| {
            a.fill((i, a.len()));
            b.fill((i, a.len()));
        });
        let size = |i: usize| if i + 1 == CHUNKS { 2 } else { 4 };
        assert!(a.iter().enumerate().all(|(at, x)| *x == (at / 4, size(at / 4))), "{threads} threads");
        assert!(b.iter().enumerate().all(|(i, x)| *x == (i, size(i))), "{threads} threads");
    });
}

#[test]
fn many_tasks_are_owned_and_keep_their_order() {
    in_pools(|threads| {
        let tasks: Vec<String> = (0..CHUNKS).map(|i| i.to_string()).collect();
        let done = par::map_each(tasks, |i, task| {
            assert_eq!(task, i.to_string(), "task {i} of {threads} threads");
            task + "!"
        });
        assert!(done.iter().enumerate().all(|(i, x)| *x == format!("{i}!")), "{threads} threads");
        let mut values = vec![0; CHUNKS];
        par::each(values.iter_mut().collect(), |i, x: &mut usize| *x = i);
        assert!(values.iter().enumerate().all(|(i, x)| *x == i), "{threads} threads");
    });
}

#[test]
fn nothing_and_one_are_maps_too() {
    in_pools(|threads| {
        for n in [0, 1] {
            let expected: Vec<usize> = (0..n).collect();
            assert_eq!(par::map(n, |i| i), expected, "{threads} threads");
            assert_eq!(par::map_batched(n, 37, |i| i), expected, "{threads} threads");
            assert_eq!(par::map_each(vec![7; n], |i, task| i + task), vec![7; n], "{threads} threads");
            let (mut a, mut b) = (vec![0; n], vec![0; n]);
            par::chunks_mut(&mut a, 64, |i, part| part.fill(i + part.len()));
            par::chunks_mut2(&mut b, 64, &mut a, 64, |i, b, a| b.fill(i + a.len() + a[0]));
            assert_eq!((a, b), (vec![1; n], vec![2; n]), "{threads} threads");
        }
    });
}

#[test]
fn maps_inside_maps_keep_their_order() {
    in_pools(|threads| {
        let table = par::map(300, |i| par::join(|| par::map(i, |j| i * j), || par::map(3, |j| i + j)));
        for (i, (row, sum)) in table.iter().enumerate() {
            assert!(row.len() == i && row.iter().enumerate().all(|(j, x)| *x == i * j), "{threads} threads");
            assert_eq!(sum[..], [i, i + 1, i + 2], "{threads} threads");
        }
    });
}

/// Counts how many of it there are.
struct Counted<'a>(&'a AtomicIsize);

impl<'a> Counted<'a> {
    fn new(alive: &'a AtomicIsize) -> Self {
        alive.fetch_add(1, Ordering::SeqCst);
        Self(alive)
    }
}

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
}

/// The text of the panic of `f`.
fn panic_of(f: impl FnOnce()) -> String {
    let panic = catch_unwind(AssertUnwindSafe(f)).expect_err("a piece panics");
    panic.downcast_ref::<String>().cloned().unwrap_or_default()
}

#[test]
fn a_panic_reaches_the_caller_and_nothing_is_dropped_twice_or_kept() {
    in_pools(|threads| {
        for bad in [0, 1234, CHUNKS - 1] {
            let alive = AtomicIsize::new(0);
            let fail = |i: usize| assert!(i != bad, "task {i} fails");
            let tasks: Vec<_> = (0..CHUNKS).map(|_| Counted::new(&alive)).collect();
            let text = panic_of(|| {
                par::map_each(tasks, |i, task| {
                    fail(i);
                    [task, Counted::new(&alive)]
                });
            });
            assert_eq!(text, format!("task {bad} fails"), "map_each, {threads} threads");
            assert_eq!(alive.load(Ordering::SeqCst), 0, "map_each of {threads} threads keeps nothing");
            let text = panic_of(|| {
                par::map(CHUNKS, |i| {
                    let made = Counted::new(&alive);
                    fail(i);
                    made
                });
            });
            assert_eq!(text, format!("task {bad} fails"), "map, {threads} threads");
            assert_eq!(alive.load(Ordering::SeqCst), 0, "map of {threads} threads keeps nothing");
            let mut data: Vec<_> = (0..CHUNKS).map(|_| Some(Counted::new(&alive))).collect();
            let text = panic_of(|| {
                par::chunks_mut(&mut data, 1, |i, part| {
                    fail(i);
                    part[0] = Some(Counted::new(&alive));
                });
            });
            assert_eq!(text, format!("task {bad} fails"), "chunks_mut, {threads} threads");
            assert_eq!(alive.load(Ordering::SeqCst), 5000, "a buffer keeps its values, {threads} threads");
            drop(data);
            assert_eq!(alive.load(Ordering::SeqCst), 0, "and drops each once, {threads} threads");
        }
    });
}

/// FNV-1a of bytes, as its authors define it.
fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, &b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

#[test]
fn a_digest_is_fnv_over_width_rank_dimensions_and_elements() {
    assert_eq!(fnv(b"foobar"), 0x8594_4171_f739_67e8, "published value");
    let x = [1.5_f32, -0.0, 3.0, 1e-45, 5.0, 6.0];
    let mut bytes = Vec::new();
    for head in [4_u64, 2, 2, 3] {
        bytes.extend(head.to_le_bytes());
    }
    for v in x {
        bytes.extend(v.to_le_bytes());
    }
    let expected = fnv(&bytes);
    assert_eq!(bits::digest_f32(&[2, 3], &x).unwrap(), expected);
    assert_eq!(bits::digest(&Array::new(&[2, 3], x.to_vec())).unwrap(), expected);
    assert_eq!(
        bits::digest_f64(&[], &[2.0]).unwrap(),
        fnv(&[8_u64, 0, 2.0_f64.to_bits()].map(u64::to_le_bytes).concat())
    );
    let integers = [4_u64.to_le_bytes(), 1_u64.to_le_bytes(), 2_u64.to_le_bytes()].concat();
    let integers = [integers, 7_i32.to_le_bytes().to_vec(), (-1_i32).to_le_bytes().to_vec()].concat();
    assert_eq!(bits::digest(&Array::new(&[2], vec![7, -1_i32])).unwrap(), fnv(&integers));
}

#[test]
fn a_nan_or_a_wrong_shape_has_no_digest() {
    let nan = bits::digest_f32(&[2], &[0.0, f32::NAN]).unwrap_err();
    assert!(nan.to_string().contains("element 1"), "{nan}");
    assert!(bits::digest_f64(&[1], &[f64::NAN]).is_err(), "NaN in f64");
    assert!(bits::digest_f32(&[3], &[0.0, 1.0]).is_err(), "two elements are not three");
}

#[test]
fn distances_count_representable_steps() {
    assert_eq!(bits::ulp_f32(0.0, -0.0), 0);
    assert_eq!(bits::ulp_f32(1e-45, -1e-45), 2);
    assert_eq!(bits::ulp_f32(1.0, 1.000_000_1), 1);
    assert_eq!(bits::ulp_f32(f32::MAX, f32::INFINITY), 1);
    assert_eq!(bits::ulp_f32(f32::NAN, 1.0), u64::MAX);
    assert_eq!(bits::ulp_f64(1.0, 1.0 + 3.0 * f64::EPSILON), 3);
    assert_eq!(bits::ulp_f64(-f64::MAX, f64::MAX), 2 * f64::MAX.to_bits());
}
