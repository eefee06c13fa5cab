//! Causes to factors and back: the truncated sum is the inverse, sweeps are ancestral evaluation, abduction
//! undoes them.

use super::models::{Model, bits, worst};
use lastlight::causal::structure::{self, In};

/// LU factors of a matrix (n, n) with row pivots, L below the diagonal; and the order of the rows.
fn factored(mut a: Vec<f64>, n: usize) -> (Vec<f64>, Vec<usize>) {
    let mut rows: Vec<usize> = (0..n).collect();
    for c in 0..n {
        let largest =
            (c..n).fold(c, |best, r| if a[r * n + c].abs() > a[best * n + c].abs() { r } else { best });
        rows.swap(c, largest);
        (0..n).for_each(|x| a.swap(c * n + x, largest * n + x));
        for r in c + 1..n {
            let factor = a[r * n + c] / a[c * n + c];
            a[r * n + c] = factor;
            for x in c + 1..n {
                a[r * n + x] -= factor * a[c * n + x];
            }
        }
    }
    (a, rows)
}

/// Z with (I − Wᵀ) Z = ε, by LU.
fn solved(model: &Model) -> Vec<f64> {
    let (n, k, w) = (model.n, model.k, model.edges());
    let system = (0..n * n).map(|at| f64::from(u8::from(at / n == at % n)) - w[at % n * n + at / n]);
    let (lu, rows) = factored(system.collect(), n);
    let mut z = vec![0.0; n * k];
    for c in 0..k {
        let mut x: Vec<f64> = rows.iter().map(|r| model.eps[r * k + c]).collect();
        for r in 0..n {
            x[r] -= (0..r).fold(0.0, |sum, t| sum + lu[r * n + t] * x[t]);
        }
        for r in (0..n).rev() {
            x[r] = (x[r] - (r + 1..n).fold(0.0, |sum, t| sum + lu[r * n + t] * x[t])) / lu[r * n + r];
        }
        (0..n).for_each(|r| z[r * k + c] = x[r]);
    }
    z
}

#[test]
fn the_truncated_sum_is_the_inverse_on_a_thousand_weighted_graphs() {
    let (mut largest, mut edges) = (0.0, 0.0);
    for number in 0..1000 {
        let model = Model::new(number);
        let error = worst(&structure::forward(&model.input(true)).0, &solved(&model));
        assert!(error < 1e-12, "graph {number}: {error:e}");
        largest = if error > largest { error } else { largest };
        edges += model.mask.iter().fold(0.0, |sum, m| sum + m);
    }
    println!("largest difference from LU {largest:.1e}, {edges} edges");
    assert!(edges > 5000.0, "the graphs have edges: {edges}");
}

#[test]
fn sweeps_are_ancestral_evaluation_bit_for_bit() {
    for number in 0..1000 {
        let model = Model::new(number);
        for linear in [true, false] {
            let (x, k) = (model.input(linear), model.k);
            let mut z = vec![0.0; x.eps.len()];
            for j in &model.order {
                let all = structure::apply(&x, &z);
                z[j * k..(j + 1) * k].copy_from_slice(&all[j * k..(j + 1) * k]);
            }
            assert_eq!(bits(&structure::forward(&x).0), bits(&z), "graph {number}, linear {linear}");
            let more = structure::forward(&In { sweeps: x.sweeps + 3, ..x }).0;
            assert_eq!(
                bits(&more),
                bits(&z),
                "graph {number}, linear {linear}: further sweeps change nothing"
            );
        }
    }
}

#[test]
fn abduction_and_sweeps_undo_each_other() {
    let mut largest = 0.0;
    for number in 0..1000 {
        let model = Model::new(number);
        for linear in [true, false] {
            // the model's numbers are factors now
            let factors = model.input(linear);
            let causes = structure::abduct(&factors);
            let again = structure::forward(&In { eps: &causes, ..factors }).0;
            let error = worst(&again, &model.eps);
            assert!(error <= 1e-12, "graph {number}, linear {linear}: S(abduct(u)) is off by {error:e}");
            let z = structure::forward(&factors).0;
            let back = worst(&structure::abduct(&In { eps: &z, ..factors }), &model.eps);
            assert!(back <= 1e-12, "graph {number}, linear {linear}: abduct(S(ε)) is off by {back:e}");
            largest = [error, back].into_iter().fold(largest, |a, b| if b > a { b } else { a });
        }
    }
    println!("largest difference {largest:.1e}");
}
