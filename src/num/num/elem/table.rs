//! Error bounds of the functions of this module.

/// One row of the table. Errors are in units of the last place of the single-precision result: |y − f(x)| /
/// ulp(f(x)), with ulp = 2⁻¹⁴⁹ for subnormal results. A correctly rounded function has the error 0.5.
#[derive(Clone, Copy, Debug)]
pub struct Ulp {
    /// Name of the function.
    pub name: &'static str,
    /// Arguments for which the bound holds.
    pub domain: &'static str,
    /// Allowed error; a test fails if a measured error is larger, or if this bound is more than four times
    /// `worst`.
    pub allowed: f64,
    /// Worst measured error, rounded up, relative to the f64 `libm`; a sweep that finds a larger error fails.
    pub worst: f64,
}

/// Bounds of a function that is computed in double precision and rounded once: ½ plus the contribution of the
/// double-precision error.
const fn rounded_once(name: &'static str, domain: &'static str) -> Ulp {
    Ulp { name, domain, allowed: 0.500_01, worst: 0.500_001 }
}

/// The table, in the order of the documentation.
pub const TABLE: [Ulp; 17] = [
    rounded_once("exp", "all"),
    rounded_once("expm1", "all"),
    rounded_once("ln", "x ≥ 0"),
    rounded_once("log1p", "x ≥ −1"),
    rounded_once("logit", "0 ≤ x ≤ 1"),
    rounded_once("sin", "finite"),
    rounded_once("cos", "finite"),
    rounded_once("acos", "−1 ≤ x ≤ 1"),
    rounded_once("tanh", "all"),
    rounded_once("sigmoid", "all"),
    rounded_once("softplus", "all"),
    rounded_once("erf", "all"),
    rounded_once("gelu", "finite"),
    // Its terms cancel at −0.75.
    Ulp { name: "gelu_slope", domain: "finite", allowed: 0.51, worst: 0.501 },
    rounded_once("atan2", "finite"),
    rounded_once("pow", "x ≥ +0, finite"),
    Ulp { name: "exp_lanes", domain: "−87.3 ≤ x ≤ 88", allowed: 1.01, worst: 1.008_1 },
];
