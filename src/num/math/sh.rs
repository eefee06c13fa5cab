//! Real spherical harmonics up to degree 3 with the signs of 3DGS, and their derivatives.
//!
//! With d = (x, y, z), ‖d‖ = 1: Y₀ = C0; Y₁₋₃ = −C1 y, C1 z, −C1 x; degree 2: C2₀ xy, C2₁ yz, C2₂
//! (2z²−x²−y²), C2₃ xz, C2₄ (x²−y²); degree 3: C3₀ y(3x²−y²), C3₁ xyz, C3₂ y(4z²−x²−y²), C3₃ z(2z²−3x²−3y²),
//! C3₄ x(4z²−x²−y²), C3₅ z(x²−y²), C3₆ x(x²−3y²). Σₘ Y² over a band of degree l is (2l+1)/4π for every d.

use crate::num::lanes::Real;

/// Y₀.
pub const C0: f32 = 0.28209479177387814;
const C1: f32 = 0.4886025119029199;
const C2: [f32; 5] =
    [1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396];
const C3: [f32; 7] = [
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
];

/// Largest supported degree.
pub const MAX_DEGREE: usize = 3;

/// Returns Y₀ … Y₁₅ at the unit vector `d`; entries beyond `degree` are 0.
#[inline(always)]
pub fn basis<L: Real>(degree: usize, d: [L; 3]) -> [L; 16] {
    let c = L::splat;
    let [x, y, z] = d;
    let mut out = [c(0.0); 16];
    out[0] = c(C0);
    if degree >= 1 {
        out[1] = c(-C1) * y;
        out[2] = c(C1) * z;
        out[3] = c(-C1) * x;
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    if degree >= 2 {
        out[4] = c(C2[0]) * (x * y);
        out[5] = c(C2[1]) * (y * z);
        out[6] = c(C2[2]) * ((c(2.0) * zz - xx) - yy);
        out[7] = c(C2[3]) * (x * z);
        out[8] = c(C2[4]) * (xx - yy);
    }
    if degree >= 3 {
        let ring = (c(4.0) * zz - xx) - yy;
        out[9] = c(C3[0]) * (y * (c(3.0) * xx - yy));
        out[10] = c(C3[1]) * ((x * y) * z);
        out[11] = c(C3[2]) * (y * ring);
        out[12] = c(C3[3]) * (z * ((c(2.0) * zz - c(3.0) * xx) - c(3.0) * yy));
        out[13] = c(C3[4]) * (x * ring);
        out[14] = c(C3[5]) * (z * (xx - yy));
        out[15] = c(C3[6]) * (x * (xx - c(3.0) * yy));
    }
    out
}

/// Returns d̄ = Σₖ Ȳₖ ∂Yₖ/∂d; bands are added in ascending order.
#[inline(always)]
pub fn basis_adjoint<L: Real>(degree: usize, d: [L; 3], y_bar: &[L; 16]) -> [L; 3] {
    let c = L::splat;
    let [x, y, z] = d;
    let b = y_bar;
    let (mut gx, mut gy, mut gz) = (c(0.0), c(0.0), c(0.0));
    if degree >= 1 {
        gy = gy + c(-C1) * b[1];
        gz = gz + c(C1) * b[2];
        gx = gx + c(-C1) * b[3];
    }
    if degree >= 2 {
        let (b4, b5, b6, b7, b8) =
            (c(C2[0]) * b[4], c(C2[1]) * b[5], c(C2[2]) * b[6], c(C2[3]) * b[7], c(C2[4]) * b[8]);
        gx = gx + (((y * b4 - c(2.0) * (x * b6)) + z * b7) + c(2.0) * (x * b8));
        gy = gy + (((x * b4 + z * b5) - c(2.0) * (y * b6)) - c(2.0) * (y * b8));
        gz = gz + ((y * b5 + c(4.0) * (z * b6)) + x * b7);
    }
    if degree >= 3 {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        let (xy, xz, yz) = (x * y, x * z, y * z);
        let b9 = c(C3[0]) * b[9];
        let b10 = c(C3[1]) * b[10];
        let b11 = c(C3[2]) * b[11];
        let b12 = c(C3[3]) * b[12];
        let b13 = c(C3[4]) * b[13];
        let b14 = c(C3[5]) * b[14];
        let b15 = c(C3[6]) * b[15];
        let (two, three, four, six, eight) = (c(2.0), c(3.0), c(4.0), c(6.0), c(8.0));
        let ring = four * zz - (xx + yy);
        // Y₉ = y(3x²−y²), Y₁₀ = xyz, Y₁₁ = y·ring, Y₁₂ = z(2z²−3x²−3y²), Y₁₃ = x·ring, Y₁₄ = z(x²−y²),
        // Y₁₅ = x(x²−3y²)
        gx = gx
            + ((((((six * xy) * b9 + yz * b10) - (two * xy) * b11) - (six * xz) * b12)
                + (ring - two * xx) * b13)
                + ((two * xz) * b14 + (three * (xx - yy)) * b15));
        gy = gy
            + ((((((three * (xx - yy)) * b9 + xz * b10) + (ring - two * yy) * b11) - (six * yz) * b12)
                - (two * xy) * b13)
                - ((two * yz) * b14 + (six * xy) * b15));
        gz = gz
            + ((((xy * b10 + (eight * yz) * b11) + (six * zz - three * (xx + yy)) * b12)
                + (eight * xz) * b13)
                + (xx - yy) * b14);
    }
    [gx, gy, gz]
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn squares_of_a_band_add_up_to_the_addition_theorem() {
        for d in [[0.6_f32, 0.0, 0.8], [0.48, 0.64, -0.6], [-2.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0]] {
            let y = basis(3, d);
            for l in 0..4_usize {
                let band = y[l * l..(l + 1) * (l + 1)].iter().fold(0.0, |s, y| s + y * y);
                let expected = (2 * l + 1) as f32 / (4.0 * std::f32::consts::PI);
                assert_relative_eq!(band, expected, max_relative = 2e-6);
            }
        }
    }
}
