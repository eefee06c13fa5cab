//! How far each function of this module is from the true value.

/// One line of the table. Errors are in units of the last place of the single-precision result: |y − f(x)| / ulp(f(x)),
/// with ulp = 2⁻¹⁴⁹ among the subnormal numbers. A correctly rounded function has 0.5.
#[derive(Clone, Copy, Debug)]
pub struct Ulp {
    /// name of the function
    pub name: &'static str,
    /// arguments for which the bound holds
    pub domain: &'static str,
    /// allowed error; a test fails above it, and also when four times the measured worst is below it
    pub allowed: f64,
    /// worst error measured over every single-precision number of the domain (two arguments: over 2³⁰ drawn pairs
    /// and a grid of edges), against f64 `libm`
    pub worst: f64,
}

const fn line(name: &'static str, domain: &'static str, allowed: f64, worst: f64) -> Ulp {
    Ulp { name, domain, allowed, worst }
}

/// The table, in the order of the documentation.
pub const TABLE: [Ulp; 15] = [
    line("exp", "all", 0.501, 0.5),
    line("expm1", "all", 0.501, 0.5),
    line("ln", "x > 0", 0.501, 0.5),
    line("log1p", "x > −1", 0.501, 0.5),
    line("logit", "0 < x < 1", 0.501, 0.5),
    line("sin", "finite", 0.501, 0.5),
    line("cos", "finite", 0.501, 0.5),
    line("acos", "−1 ≤ x ≤ 1", 0.501, 0.5),
    line("tanh", "all", 0.501, 0.5),
    line("sigmoid", "all", 0.501, 0.5),
    line("softplus", "all", 0.501, 0.5),
    line("erf", "all", 0.501, 0.5),
    line("atan2", "finite", 0.501, 0.5),
    line("pow", "x ≥ 0", 0.501, 0.5),
    line("exp_lanes", "−87.3 ≤ x ≤ 88", 1.5, 1.0),
];
