//! Where cameras look, and which way is up: least squares over their axes.

/// A 3×3 matrix.
type Matrix = [[f64; 3]; 3];

fn determinant(m: &Matrix) -> f64 {
    m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
}

/// x with A x = b, by Cramer's rule.
fn solve(a: &Matrix, b: [f64; 3], det: f64) -> [f64; 3] {
    std::array::from_fn(|k| {
        let mut m = *a;
        for i in 0..3 {
            m[i][k] = b[i];
        }
        determinant(&m) / det
    })
}

/// The point p that minimises the sum over optical axes (centre c, unit direction d) of the squared distance
/// to the axis, i.e. Σ(I − ddᵀ)(p − c) = 0; `None` if there are no axes, or they are parallel (to about a
/// thousandth of a radian).
pub fn nearest_to_axes(axes: &[([f64; 3], [f64; 3])]) -> Option<[f64; 3]> {
    let n = axes.len() as f64;
    let (mut a, mut b) = ([[0.0; 3]; 3], [0.0; 3]);
    for (c, d) in axes {
        for i in 0..3 {
            for j in 0..3 {
                let p = (f64::from(u8::from(i == j)) - d[i] * d[j]) / n;
                a[i][j] += p;
                b[i] += p * c[j];
            }
        }
    }
    let det = determinant(&a);
    (det > 1e-6).then(|| solve(&a, b, det))
}

/// Weight of the mean of the cameras' own up directions in [`up`].
const OWN_UP: f64 = 0.02;

/// The unit vector that is most nearly upright in all images, from the cameras' directions to the right and
/// up: cameras are held level more often than they look horizontally, so u minimises mean (r·u)² + 0.02·‖u −
/// m‖², m the mean of the directions up. For cameras around an object u is the axis of their circle, whatever
/// their elevation. `None` if the directions up cancel.
pub fn up(right_and_up: &[([f64; 3], [f64; 3])]) -> Option<[f64; 3]> {
    let n = right_and_up.len() as f64;
    let (mut a, mut b) = ([[0.0; 3]; 3], [0.0; 3]);
    for (i, row) in a.iter_mut().enumerate() {
        row[i] = OWN_UP;
    }
    for (right, up) in right_and_up {
        for i in 0..3 {
            for j in 0..3 {
                a[i][j] += right[i] * right[j] / n;
            }
            b[i] += OWN_UP * up[i] / n;
        }
    }
    let det = determinant(&a);
    if !(det > 0.0) {
        return None;
    }
    let u = solve(&a, b, det);
    let length = (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]).sqrt();
    (length > 1e-3).then(|| u.map(|x| x / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_is_the_axis_of_a_circle_whatever_the_elevation() {
        for share in [1.0, 0.25] {
            let camera = |i: u32| {
                let turn = share * std::f64::consts::TAU * f64::from(i) / 24.0;
                let (s, c) = (libm::sin(turn), libm::cos(turn));
                // at (c, s, 0) seen from the middle, 40 degrees above, looking down at it
                let (se, ce) = (libm::sin(0.7), libm::cos(0.7));
                ([-s, c, 0.0], [-se * c, -se * s, ce])
            };
            let u = up(&(0..24).map(camera).collect::<Vec<_>>()).expect("one");
            assert!(u[2] > if share == 1.0 { 1.0 - 1e-9 } else { 0.97 }, "{share} of a turn: {u:?}");
        }
        assert!(up(&[]).is_none(), "no cameras");
        assert!(nearest_to_axes(&[]).is_none(), "no axes");
    }
}
