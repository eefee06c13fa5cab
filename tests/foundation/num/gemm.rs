//! Matrix products bit for bit against three loops.

use crate::chains::{assert_same_bits, three_loops, values};
use lastlight::num::gemm::{Finish, Packed, View, gemm, gemm_packed};
use lastlight::num::par;

const SHAPES: [(usize, usize, usize); 20] = [
    (1, 1, 1),
    (1, 1, 0),
    (6, 16, 4),
    (5, 15, 3),
    (7, 17, 5),
    (1, 64, 64),
    (64, 1, 64),
    (13, 513, 9),
    (61, 77, 517),
    (12, 40, 256),
    (12, 40, 257),
    (50, 33, 512),
    (97, 1030, 31),
    (400, 24, 40),
    (3, 5, 4096),
    (3, 5, 4097),
    (5, 18, 5000),
    (7, 9, 8192),
    (2, 3, 20_481),
    (2, 20, 28_700),
];

#[test]
fn products_are_those_of_three_loops_in_every_orientation() {
    for (m, n, k) in SHAPES {
        let (a, b, old) = (values(m * k, 1), values(k * n, 2), values(m * n, 3));
        let (bias, what) = (values(n, 4), format!("{m}x{n}x{k}"));
        let mut c = vec![f32::NAN; m * n];
        let nn = three_loops(m, n, k, |i, p| a[i * k + p], |p, j| b[p * n + j]);
        gemm(View::new(&a, m, k), View::new(&b, k, n), Finish::Store, &mut c);
        assert_same_bits(&c, &nn, &format!("{what}, a·b"));
        let nt = three_loops(m, n, k, |i, p| a[i * k + p], |p, j| b[j * k + p]);
        gemm(View::new(&a, m, k), View::new(&b, n, k).t(), Finish::Store, &mut c);
        assert_same_bits(&c, &nt, &format!("{what}, a·bᵀ"));
        let tn = three_loops(m, n, k, |i, p| a[p * m + i], |p, j| b[p * n + j]);
        gemm(View::new(&a, k, m).t(), View::new(&b, k, n), Finish::Store, &mut c);
        assert_same_bits(&c, &tn, &format!("{what}, aᵀ·b"));
        let tt = three_loops(m, n, k, |i, p| a[p * m + i], |p, j| b[j * k + p]);
        gemm(View::new(&a, k, m).t(), View::new(&b, n, k).t(), Finish::Store, &mut c);
        assert_same_bits(&c, &tt, &format!("{what}, aᵀ·bᵀ"));

        gemm(View::new(&a, m, k), View::new(&b, k, n), Finish::Bias(&bias), &mut c);
        let expected: Vec<f32> = nn.iter().enumerate().map(|(i, p)| p + bias[i % n]).collect();
        assert_same_bits(&c, &expected, &format!("{what}, bias"));
        c.copy_from_slice(&old);
        gemm_packed(View::new(&a, m, k), &Packed::new(View::new(&b, k, n)), Finish::Add, &mut c);
        let expected: Vec<f32> = nn.iter().zip(&old).map(|(p, c)| c + p).collect();
        assert_same_bits(&c, &expected, &format!("{what}, added"));
    }
}

#[test]
fn products_of_strided_views() {
    // Two heads of four columns each in rows of eight; and every second column.
    let (x, m, k) = (values(9 * 8, 5), 9, 4);
    for (start, step) in [(0, 1), (4, 1), (0, 2), (1, 2)] {
        let view = View::strided(&x[start..], (m, k), (8, step));
        let at = |i: usize, p: usize| x[start + i * 8 + p * step];
        let mut c = vec![0.0; m * m];
        gemm(view, view.t(), Finish::Store, &mut c);
        assert_same_bits(
            &c,
            &three_loops(m, m, k, at, |p, j| at(j, p)),
            &format!("start {start}, step {step}"),
        );
    }
}

#[test]
fn products_do_not_depend_on_the_number_of_threads() {
    let (m, n, k) = (203, 1100, 301);
    let (a, b) = (values(m * k, 6), values(n * k, 7));
    let product = |threads: usize| {
        par::with_threads(threads, || {
            let mut c = vec![0.0; m * n];
            gemm(View::new(&a, m, k), View::new(&b, n, k).t(), Finish::Store, &mut c);
            c
        })
        .expect("the environment of a fresh pool is the default one")
    };
    let one = product(1);
    assert_same_bits(&one, &three_loops(m, n, k, |i, p| a[i * k + p], |p, j| b[j * k + p]), "one thread");
    for threads in [2, 7] {
        assert_same_bits(&product(threads), &one, &format!("{threads} threads"));
    }
}

#[test]
fn infinities_stay_where_they_are() {
    // Seventeen columns and seven rows: padding next to an infinite element must not reach the result.
    let (m, n, k) = (7, 17, 3);
    let mut a = vec![1.0; m * k];
    a[0] = f32::INFINITY;
    let b = vec![1.0; k * n];
    let mut c = vec![0.0; m * n];
    gemm(View::new(&a, m, k), View::new(&b, k, n), Finish::Store, &mut c);
    assert!(c[..n].iter().all(|&x| x == f32::INFINITY), "the first row");
    assert!(c[n..].iter().all(|&x| x == 3.0), "the others");
}
