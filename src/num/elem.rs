//! (in work)
use super::lanes::Real;
/// exp
#[inline(always)]
pub fn exp_lanes<L: Real>(x: L) -> L {
    let c = L::splat;
    let x = x.max(c(-87.3));
    let magic = c(12582912.0);
    let n = (x * c(std::f32::consts::LOG2_E) + magic) - magic;
    let r = (x - n * c(0.693359375)) - n * c(-2.12194440e-4);
    let p = ((((c(1.9875691500E-4) * r + c(1.3981999507E-3)) * r + c(8.3334519073E-3)) * r + c(4.1665795894E-2)) * r + c(1.6666665459E-1)) * r + c(5.0000001201E-1);
    (p * (r * r) + r + c(1.0)) * L::exp2_int(n)
}
/// ln
pub fn ln(x: f32) -> f32 { libm::log(f64::from(x)) as f32 }
/// exp
pub fn exp(x: f32) -> f32 { libm::exp(f64::from(x)) as f32 }
/// sigmoid
pub fn sigmoid(x: f32) -> f32 { (1.0 / (1.0 + libm::exp(-f64::from(x)))) as f32 }
