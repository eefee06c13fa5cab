//! Finite differences.

/// Central difference (f(h) − f(−h))/2h.
pub fn central(mut f: impl FnMut(f64) -> f64, h: f64) -> f64 {
    (f(h) - f(-h)) / (2.0 * h)
}

/// One step of Richardson's extrapolation from two central differences: (4 D(h/2) − D(h))/3, error O(h⁴).
pub fn extrapolate(coarse: f64, fine: f64) -> f64 {
    (4.0 * fine - coarse) / 3.0
}

/// Richardson's derivative of f at 0.
pub fn richardson(mut f: impl FnMut(f64) -> f64, h: f64) -> f64 {
    let coarse = central(&mut f, h);
    extrapolate(coarse, central(&mut f, 0.5 * h))
}

/// Observed order of convergence of central differences towards `derivative`: the slope of ln|D(h) −
/// derivative| against ln h by least squares over `steps`. `None` when fewer than two errors are above
/// `floor`, below which rounding errors dominate.
pub fn order(mut f: impl FnMut(f64) -> f64, derivative: f64, steps: &[f64], floor: f64) -> Option<f64> {
    let points: Vec<(f64, f64)> = steps
        .iter()
        .map(|&h| (h, (central(&mut f, h) - derivative).abs()))
        .filter(|&(_, error)| error > floor)
        .map(|(h, error)| (libm::log(h), libm::log(error)))
        .collect();
    if points.len() < 2 {
        return None;
    }
    let n = points.len() as f64;
    let (mx, my) = points.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let (top, bottom) =
        points.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + (x - mx) * (y - my), b + (x - mx) * (x - mx)));
    Some(top / bottom)
}
