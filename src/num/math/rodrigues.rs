//! Rodrigues' formula: the rotation about an axis by an angle, with its adjoint and its inverse, in f64.
//!
//! ℛ(w) = I + a K + b K²,   K v = w × v,   a = sin θ/θ,   b = (1 − cos θ)/θ² = ½ (sin ½θ/½θ)²,   θ = ‖w‖
//!
//! # Rounding
//! Dot products are (x₀y₀ + x₁y₁) + x₂y₂. b is computed from the half angle, because 1 − cos θ would cancel.
//! For θ < 1e-4 the series a = 1 − θ²/6, b = ½ − θ²/24 (and their derivatives −⅓ + θ²/30, −1/12 + θ²/180) are
//! exact to the last place.
//!
//! # Kinks and domain
//! There are no kinks: ℛ is smooth in w, also at 0.
//!
//! # Adjoint
//! With s = (R̄₂₁ − R̄₁₂, R̄₀₂ − R̄₂₀, R̄₁₀ − R̄₀₁):
//!
//! w̄ = a s + b ((R̄ + R̄ᵀ) w − 2 tr(R̄) w) + (a' (w·s) + b' (wᵀR̄w − θ² tr R̄)) w,
//! a' = (θ cos θ − sin θ)/θ³,   b' = (a − 2b)/θ²

/// Angle in rad below which series replace the quotients.
pub const SERIES: f64 = 1e-4;

type Vec3 = [f64; 3];
type Mat3 = [Vec3; 3];

const IDENTITY: Mat3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn dot(a: Vec3, b: Vec3) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

/// Returns a, b, a', b', where ∂a/∂w = a' w and ∂b/∂w = b' w.
fn quotients(square: f64) -> [f64; 4] {
    if square < SERIES * SERIES {
        return [
            1.0 - square / 6.0,
            0.5 - square / 24.0,
            square / 30.0 - 1.0 / 3.0,
            square / 180.0 - 1.0 / 12.0,
        ];
    }
    let theta = square.sqrt();
    let (sin, cos, half) = (libm::sin(theta), libm::cos(theta), libm::sin(0.5 * theta) / (0.5 * theta));
    let (a, b) = (sin / theta, 0.5 * (half * half));
    [a, b, (theta * cos - sin) / (square * theta), (a - 2.0 * b) / square]
}

/// Returns ℛ(w), row-major.
pub fn matrix(w: Vec3) -> Mat3 {
    let square = dot(w, w);
    let [a, b, ..] = quotients(square);
    let cross = [[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let one = IDENTITY[i][j];
            one + (a * cross[i][j] + b * (w[i] * w[j] - square * one))
        })
    })
}

/// Returns w̄ for the cotangent `r_bar` of ℛ(w).
pub fn matrix_adjoint(w: Vec3, r_bar: &Mat3) -> Vec3 {
    let square = dot(w, w);
    let [a, b, a_slope, b_slope] = quotients(square);
    let s = [r_bar[2][1] - r_bar[1][2], r_bar[0][2] - r_bar[2][0], r_bar[1][0] - r_bar[0][1]];
    let trace = (r_bar[0][0] + r_bar[1][1]) + r_bar[2][2];
    let (there, back) =
        (r_bar.map(|row| dot(row, w)), [0, 1, 2].map(|j| dot([r_bar[0][j], r_bar[1][j], r_bar[2][j]], w)));
    let radial = a_slope * dot(w, s) + b_slope * (dot(w, there) - square * trace);
    std::array::from_fn(|i| (a * s[i] + b * ((there[i] + back[i]) - 2.0 * (trace * w[i]))) + radial * w[i])
}

/// Returns the w of a rotation, with ‖w‖ ≤ π; this is the inverse of [`matrix`]. It is computed from the
/// quaternion, whose largest entry is found without cancellation, so half turns need no special case.
pub fn vector(r: &Mat3) -> Vec3 {
    let (x, y, z) = (r[0][0], r[1][1], r[2][2]);
    let candidates = [(1.0 + x) + (y + z), (1.0 + x) - (y + z), (1.0 + y) - (x + z), (1.0 + z) - (x + y)];
    let best = (1..4).fold(0, |best, k| if candidates[k] > candidates[best] { k } else { best });
    let (wx, wy, wz) = (r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]);
    let (xy, xz, yz) = (r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]);
    let c = candidates[best];
    let q = match best {
        0 => [c, wx, wy, wz],
        1 => [wx, c, xy, xz],
        2 => [wy, xy, c, yz],
        _ => [wz, xz, yz, c],
    };
    // The sign is chosen such that the half angle is at most a quarter turn.
    let q = if q[0] < 0.0 { q.map(|x| -x) } else { q };
    let sine = ((q[1] * q[1] + q[2] * q[2]) + q[3] * q[3]).sqrt();
    if sine == 0.0 {
        return [0.0; 3];
    }
    let factor = 2.0 * libm::atan2(sine, q[0]) / sine;
    [factor * q[1], factor * q[2], factor * q[3]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_go_both_ways() {
        for v in [
            [0.0, 0.0, 0.0],
            [1e-9, 0.0, 0.0],
            [5e-5, -5e-5, 2e-5],
            [0.3, -1.2, 0.7],
            [0.0, std::f64::consts::PI - 6e-10, 0.0],
            [-1.8, 1.8, 1.8],
        ] {
            let back = vector(&matrix(v));
            for k in 0..3 {
                assert!((back[k] - v[k]).abs() < 1e-9, "{v:?} came back as {back:?}");
            }
        }
    }

    #[test]
    fn rotations_differentiate() {
        for v in
            [[0.0, 0.0, 0.0], [1e-3, -2e-3, 5e-4], [0.006, -0.004, 0.003], [0.4, -1.1, 0.7], [-1.8, 1.2, 2.0]]
        {
            let seeds: Mat3 =
                std::array::from_fn(|i| std::array::from_fn(|j| 0.2 + 0.37 * i as f64 - 0.21 * j as f64));
            let value = |v: [f64; 3]| {
                let r = matrix(v);
                (0..9).fold(0.0, |s, e| s + seeds[e / 3][e % 3] * r[e / 3][e % 3])
            };
            let bar = matrix_adjoint(v, &seeds);
            for k in 0..3 {
                let h = 1e-5;
                let at = |d: f64| {
                    let mut v = v;
                    v[k] += d;
                    value(v)
                };
                let slope = (at(h) - at(-h)) / (2.0 * h);
                assert!((bar[k] - slope).abs() < 1e-6 * (1.0 + slope.abs()), "{v:?} {k}: {} {slope}", bar[k]);
            }
        }
    }
}
