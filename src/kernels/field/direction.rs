//! Lengths and unit vectors, computed in f64 and rounded once, so that no square of an f32 underflows.

/// Returns ‖x‖.
#[inline(always)]
pub(super) fn length(x: [f32; 3]) -> f64 {
    let [x, y, z] = x.map(f64::from);
    ((x * x + y * y) + z * z).sqrt()
}

/// Returns x/‖x‖, 0 at 0.
#[inline(always)]
pub(super) fn unit(x: [f32; 3]) -> [f32; 3] {
    let r = length(x);
    if r > 0.0 { x.map(|x| (f64::from(x) / r) as f32) } else { [0.0; 3] }
}

/// Returns the gradient of x for the cotangent `bar` of x/‖x‖: (n̄ − n(n·n̄))/‖x‖, 0 at 0.
#[inline(always)]
pub(super) fn unit_back(x: [f32; 3], bar: [f32; 3]) -> [f32; 3] {
    let r = length(x);
    if !(r > 0.0) {
        return [0.0; 3];
    }
    let (n, g) = (x.map(|x| f64::from(x) / r), bar.map(f64::from));
    let along = (n[0] * g[0] + n[1] * g[1]) + n[2] * g[2];
    std::array::from_fn(|k| ((g[k] - n[k] * along) / r) as f32)
}
