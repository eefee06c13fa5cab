//! Elementary functions: error against the table, special values, one body for all widths.
//!
//! The truth is f64 `libm`, whose own error is below one f64 place, 2⁻²⁹ single-precision places: it can move
//! the measured error by 2e-9, and that is the only doubt in "correctly rounded" here.

use lastlight::num::elem::{self, TABLE, table::Ulp};
use lastlight::num::lanes::f32x8;
use lastlight::num::{bits, par, rng::Rng};

/// |y − truth| in units of the last place of a single-precision number of the size of the truth.
fn error_ulp(y: f32, truth: f64) -> f64 {
    if y.is_nan() || truth.is_nan() {
        return if y.is_nan() && truth.is_nan() { 0.0 } else { f64::INFINITY };
    }
    if (truth as f32).is_infinite() {
        return if y == truth as f32 { 0.0 } else { f64::INFINITY };
    }
    let y = f64::from(y);
    let exponent = ((truth.abs().to_bits() >> 52) as i32 - 1023).max(-126);
    (y - truth).abs() / libm::ldexp(1.0, exponent - 23)
}

fn line(name: &str) -> &'static Ulp {
    TABLE.iter().find(|l| l.name == name).expect("every tested function has a line in the table")
}

struct Function {
    name: &'static str,
    /// the function on one number and on eight
    one: fn(f32) -> f32,
    eight: fn(f32x8) -> f32x8,
    truth: fn(f64) -> f64,
    domain: fn(f32) -> bool,
}

const FUNCTIONS: [Function; 15] = [
    Function { name: "exp", one: elem::exp, eight: elem::exp, truth: libm::exp, domain: |x| !x.is_nan() },
    Function {
        name: "expm1",
        one: elem::expm1,
        eight: elem::expm1,
        truth: libm::expm1,
        domain: |x| !x.is_nan(),
    },
    Function { name: "ln", one: elem::ln, eight: elem::ln, truth: libm::log, domain: |x| x >= 0.0 },
    Function {
        name: "log1p",
        one: elem::log1p,
        eight: elem::log1p,
        truth: libm::log1p,
        domain: |x| x >= -1.0,
    },
    Function {
        name: "logit",
        one: elem::logit,
        eight: elem::logit,
        truth: elem::f64::logit,
        domain: |x| (0.0..=1.0).contains(&x),
    },
    Function { name: "sin", one: elem::sin, eight: elem::sin, truth: libm::sin, domain: f32::is_finite },
    Function { name: "cos", one: elem::cos, eight: elem::cos, truth: libm::cos, domain: f32::is_finite },
    Function {
        name: "acos",
        one: elem::acos,
        eight: elem::acos,
        truth: libm::acos,
        domain: |x| x.abs() <= 1.0,
    },
    Function { name: "tanh", one: elem::tanh, eight: elem::tanh, truth: libm::tanh, domain: |x| !x.is_nan() },
    Function {
        name: "sigmoid",
        one: elem::sigmoid,
        eight: elem::sigmoid,
        truth: elem::f64::sigmoid,
        domain: |x| !x.is_nan(),
    },
    Function {
        name: "softplus",
        one: elem::softplus,
        eight: elem::softplus,
        truth: elem::f64::softplus,
        domain: |x| !x.is_nan(),
    },
    Function { name: "erf", one: elem::erf, eight: elem::erf, truth: libm::erf, domain: |x| !x.is_nan() },
    Function { name: "gelu", one: elem::gelu, eight: elem::gelu, truth: gelu, domain: f32::is_finite },
    Function {
        name: "gelu_slope",
        one: elem::gelu_slope,
        eight: elem::gelu_slope,
        truth: gelu_slope,
        domain: f32::is_finite,
    },
    Function {
        name: "exp_lanes",
        one: elem::exp_lanes,
        eight: elem::exp_lanes,
        truth: libm::exp,
        domain: |x| (elem::EXP_LANES_MIN..=elem::EXP_LANES_MAX).contains(&x),
    },
];

fn gelu(x: f64) -> f64 {
    x * (0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2))
}

fn gelu_slope(x: f64) -> f64 {
    let density = libm::exp(-0.5 * x * x) / (2.0 * std::f64::consts::PI).sqrt();
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2) + x * density
}

/// Worst error, its argument, and how many results are not the nearest number.
#[derive(Clone, Copy)]
struct Worst {
    error: f64,
    at: [f32; 2],
    ulp: u64,
    not_nearest: u64,
    tested: u64,
}

impl Worst {
    const NONE: Self = Self { error: -1.0, at: [0.0; 2], ulp: 0, not_nearest: 0, tested: 0 };

    fn see(&mut self, at: [f32; 2], y: f32, truth: f64) {
        let error = error_ulp(y, truth);
        let ulp = bits::ulp_f32(y, truth as f32);
        self.tested += 1;
        self.not_nearest += u64::from(ulp > 0);
        self.ulp = self.ulp.max(ulp);
        if error > self.error {
            self.error = error;
            self.at = at;
        }
    }

    fn merge(all: Vec<Self>) -> Self {
        all.into_iter().fold(Self::NONE, |a, b| Self {
            tested: a.tested + b.tested,
            not_nearest: a.not_nearest + b.not_nearest,
            ulp: a.ulp.max(b.ulp),
            ..if b.error > a.error { b } else { a }
        })
    }

    /// The table holds, and it is tight (ratchet).
    fn check(self, name: &str) {
        let Self { error, at, ulp, not_nearest, tested } = self;
        println!(
            "{name}: worst {error:.9} ulp at {at:?}, {not_nearest} of {tested} not nearest, {ulp} from nearest at most"
        );
        let Ulp { allowed, worst, .. } = *line(name);
        assert!(error <= allowed, "{name}({at:?}): {error} ulp, allowed {allowed}");
        assert!(error <= worst, "{name}({at:?}): {error} ulp, more than the worst {worst} of the table");
        assert!(worst * 4.0 >= allowed, "{name}: the table allows {allowed}, far above the worst {worst}");
        assert!(ulp <= 1, "{name} is more than one place from the nearest number");
    }
}

/// Bit patterns start, start + step, … of one block of 2²², eight at a time; lanes against scalars along the
/// way.
fn sweep_block(f: &Function, block: u32, step: u32) -> Worst {
    let mut worst = Worst::NONE;
    let mut at = u64::from(block) << 22;
    let end = u64::from(block + 1) << 22;
    while at < end {
        let x: [f32; 8] = std::array::from_fn(|i| f32::from_bits((at + i as u64 * u64::from(step)) as u32));
        let y = (f.eight)(f32x8::new(x)).to_array();
        for (&x, &y) in x.iter().zip(&y) {
            if !(f.domain)(x) {
                continue;
            }
            worst.see([x, 0.0], y, (f.truth)(f64::from(x)));
            if step != 1 || x.to_bits() % 16 == 0 {
                let one = (f.one)(x);
                assert_eq!(one.to_bits(), y.to_bits(), "{}({x:e}): one lane {one:e}, eight {y:e}", f.name);
            }
        }
        at += 8 * u64::from(step);
    }
    worst
}

fn sweep(f: &Function, step: u32) -> Worst {
    Worst::merge(par::map(1024, |block| sweep_block(f, block as u32, step)))
}

#[test]
fn functions_of_one_argument_keep_the_table_on_a_sample() {
    for f in &FUNCTIONS {
        sweep(f, 4097).check(f.name);
    }
}

#[test]
fn functions_of_one_argument_keep_the_table_everywhere() {
    if !crate::common::long("exhaustive sweep of every single-precision argument") {
        return;
    }
    for f in &FUNCTIONS {
        sweep(f, 1).check(f.name);
    }
}

/// A finite number from 32 random bits: any bit pattern.
fn any_number(bits: u32) -> f32 {
    let x = f32::from_bits(bits);
    if x.is_finite() { x } else { f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000) }
}

type Pair = fn([u32; 4]) -> [f32; 2];

/// Arguments (y, x): any bit patterns, or y close to ±x, where the octants meet.
fn angle_pair(r: [u32; 4]) -> [f32; 2] {
    let x = any_number(r[0]);
    match r[2] % 4 {
        0 => [any_number(r[1]), x],
        1 => [f32::from_bits(x.to_bits().wrapping_add(r[1] % 64)), x],
        2 => [x * ((r[1] >> 8) as f32 / 8_388_608.0), x],
        _ => [x, x * ((r[1] >> 8) as f32 / 8_388_608.0)],
    }
}

/// Arguments (x, y): any bit patterns, or such that y ln x lies where the result is finite and not 0; x also
/// near 1.
fn power_pair(r: [u32; 4]) -> [f32; 2] {
    let any = any_number(r[0] & 0x7fff_ffff);
    let x = if r[2] % 8 < 4 { any } else { f32::from_bits(0x3f00_0000 + r[0] % 0x0100_0000) };
    if r[2].is_multiple_of(4) || x == 0.0 || x == 1.0 {
        return [x, any_number(r[1])];
    }
    let exponent = f64::from(r[1]) / 4_294_967_296.0 * 194.0 - 105.0;
    [x, (exponent / libm::log(f64::from(x))) as f32]
}

fn pair_worst(f: fn(f32, f32) -> f32, truth: fn(f64, f64) -> f64, pair: Pair, n: usize, seed: u64) -> Worst {
    const BATCH: usize = 1 << 16;
    let rng = Rng::new(seed);
    Worst::merge(par::map(n / BATCH, |batch| {
        let mut worst = Worst::NONE;
        for i in 0..BATCH {
            let at = pair(rng.block((batch * BATCH + i) as u64, 0, 0, 0));
            if at.iter().all(|x| x.is_finite()) {
                worst.see(at, f(at[0], at[1]), truth(f64::from(at[0]), f64::from(at[1])));
            }
        }
        worst
    }))
}

#[test]
fn functions_of_two_arguments_keep_the_table() {
    let n = if crate::common::long("2³⁰ pairs for atan2 and pow; 2²⁰ are") { 1 << 30 } else { 1 << 20 };
    let edges: Vec<f32> = [
        0.0,
        1e-45,
        1.17e-38,
        1.175_494_4e-38,
        1e-20,
        0.333_333_34,
        0.414_213_57,
        0.5,
        0.999_999_94,
        1.0,
        1.000_000_1,
        2.0,
        2.4,
        2.414_213_7,
        3.0,
        1e20,
        3.402_823_5e38,
    ]
    .into_iter()
    .flat_map(|x| [x, -x])
    .collect();
    let grid = |f: fn(f32, f32) -> f32, truth: fn(f64, f64) -> f64, first: &dyn Fn(f32) -> bool| {
        let mut worst = Worst::NONE;
        for &a in edges.iter().filter(|a| first(**a)) {
            for &b in &edges {
                worst.see([a, b], f(a, b), truth(f64::from(a), f64::from(b)));
            }
        }
        worst
    };
    let angle = pair_worst(elem::atan2, libm::atan2, angle_pair, n, 1);
    Worst::merge(vec![angle, grid(elem::atan2, libm::atan2, &|_| true)]).check("atan2");
    let power = pair_worst(elem::pow, libm::pow, power_pair, n, 2);
    Worst::merge(vec![power, grid(elem::pow, libm::pow, &|x| x.is_sign_positive())]).check("pow");
}

#[test]
fn two_arguments_have_the_bits_of_the_scalar_call_in_every_lane() {
    let rng = Rng::new(3);
    for i in 0..20_000 {
        for (pair, eight, one) in [
            (
                angle_pair as Pair,
                elem::atan2::<f32x8> as fn(f32x8, f32x8) -> f32x8,
                elem::atan2::<f32> as fn(f32, f32) -> f32,
            ),
            (power_pair, elem::pow, elem::pow),
        ] {
            let at: [[f32; 2]; 8] = std::array::from_fn(|l| pair(rng.block(i, l as u32, 0, 0)));
            let lanes = |j: usize| f32x8::new(at.map(|a| a[j]));
            for (at, y) in at.iter().zip(eight(lanes(0), lanes(1)).to_array()) {
                assert_eq!(y.to_bits(), one(at[0], at[1]).to_bits(), "{at:?}");
            }
        }
    }
}

#[test]
fn ends_of_the_domains_and_signs_of_zeros() {
    let inf = f32::INFINITY;
    let same = |a: f32, b: f32| a.to_bits() == b.to_bits();
    let exact: [(&str, f32, f32); 45] = [
        ("exp 0", elem::exp(0.0_f32), 1.0),
        ("exp ∞", elem::exp(inf), inf),
        ("exp −∞", elem::exp(-inf), 0.0),
        ("exp 88.72284", elem::exp(88.722_84_f32), inf),
        ("expm1 −0", elem::expm1(-0.0_f32), -0.0),
        ("expm1 −∞", elem::expm1(-inf), -1.0),
        ("expm1 ∞", elem::expm1(inf), inf),
        ("ln 1", elem::ln(1.0_f32), 0.0),
        ("ln 0", elem::ln(0.0_f32), -inf),
        ("ln −0", elem::ln(-0.0_f32), -inf),
        ("ln ∞", elem::ln(inf), inf),
        ("log1p −0", elem::log1p(-0.0_f32), -0.0),
        ("log1p −1", elem::log1p(-1.0_f32), -inf),
        ("log1p ∞", elem::log1p(inf), inf),
        ("logit 0", elem::logit(0.0_f32), -inf),
        ("logit ½", elem::logit(0.5_f32), 0.0),
        ("logit 1", elem::logit(1.0_f32), inf),
        ("sin −0", elem::sin(-0.0_f32), -0.0),
        ("cos 0", elem::cos(0.0_f32), 1.0),
        ("acos 1", elem::acos(1.0_f32), 0.0),
        ("acos −1", elem::acos(-1.0_f32), std::f32::consts::PI),
        ("tanh −0", elem::tanh(-0.0_f32), -0.0),
        ("tanh ∞", elem::tanh(inf), 1.0),
        ("tanh −∞", elem::tanh(-inf), -1.0),
        ("sigmoid 0", elem::sigmoid(0.0_f32), 0.5),
        ("sigmoid ∞", elem::sigmoid(inf), 1.0),
        ("sigmoid −∞", elem::sigmoid(-inf), 0.0),
        ("softplus −∞", elem::softplus(-inf), 0.0),
        ("softplus ∞", elem::softplus(inf), inf),
        ("erf −0", elem::erf(-0.0_f32), -0.0),
        ("erf ∞", elem::erf(inf), 1.0),
        ("gelu −0", elem::gelu(-0.0_f32), -0.0),
        ("gelu 20", elem::gelu(20.0_f32), 20.0),
        ("gelu −1e30", elem::gelu(-1e30_f32), -0.0),
        ("gelu_slope 0", elem::gelu_slope(0.0_f32), 0.5),
        ("gelu_slope −1e30", elem::gelu_slope(-1e30_f32), 0.0),
        ("atan2 0 1", elem::atan2(0.0_f32, 1.0), 0.0),
        ("atan2 −0 1", elem::atan2(-0.0_f32, 1.0), -0.0),
        ("atan2 0 −0", elem::atan2(0.0_f32, -0.0), std::f32::consts::PI),
        ("atan2 −0 −1", elem::atan2(-0.0_f32, -1.0), -std::f32::consts::PI),
        ("atan2 ∞ ∞", elem::atan2(inf, inf), std::f32::consts::FRAC_PI_4),
        ("pow 0 0", elem::pow(0.0_f32, 0.0), 1.0),
        ("pow 0 −1", elem::pow(0.0_f32, -1.0), inf),
        ("pow 1 ∞", elem::pow(1.0_f32, inf), 1.0),
        ("pow ½ ∞", elem::pow(0.5_f32, inf), 0.0),
    ];
    for (what, got, expected) in exact {
        assert!(same(got, expected), "{what}: {got}, expected {expected}");
    }
    for (what, got) in [
        ("ln −1", elem::ln(-1.0_f32)),
        ("log1p −2", elem::log1p(-2.0_f32)),
        ("logit 2", elem::logit(2.0_f32)),
        ("sin ∞", elem::sin(inf)),
        ("cos −∞", elem::cos(-inf)),
        ("acos 2", elem::acos(2.0_f32)),
        ("pow −1 2", elem::pow(-1.0_f32, 2.0)),
    ] {
        assert!(got.is_nan(), "{what}: {got}");
    }
}

#[test]
fn a_nan_is_never_replaced() {
    for f in &FUNCTIONS {
        assert!((f.one)(f32::NAN).is_nan(), "{}", f.name);
        assert!(
            (f.eight)(f32x8::splat(f32::NAN)).to_array().iter().all(|y| y.is_nan()),
            "{} in lanes",
            f.name
        );
    }
    assert!(elem::atan2(f32::NAN, 1.0).is_nan() && elem::atan2(1.0, f32::NAN).is_nan(), "atan2");
    assert!(elem::pow(f32::NAN, 2.0).is_nan() && elem::pow(2.0, f32::NAN).is_nan(), "pow");
}

#[test]
fn slices_have_the_bits_of_scalar_calls() {
    let x: Vec<f32> = (0..29).map(|i| i as f32 * 0.031 + 0.01).collect();
    let mut y = vec![0.0; x.len()];
    type Slice = fn(&[f32], &mut [f32]);
    type One = fn(f32) -> f32;
    let pairs: [(Slice, One); 15] = [
        (elem::exp_slice, elem::exp),
        (elem::expm1_slice, elem::expm1),
        (elem::ln_slice, elem::ln),
        (elem::log1p_slice, elem::log1p),
        (elem::logit_slice, elem::logit),
        (elem::sin_slice, elem::sin),
        (elem::cos_slice, elem::cos),
        (elem::acos_slice, elem::acos),
        (elem::tanh_slice, elem::tanh),
        (elem::sigmoid_slice, elem::sigmoid),
        (elem::softplus_slice, elem::softplus),
        (elem::erf_slice, elem::erf),
        (elem::gelu_slice, elem::gelu),
        (elem::gelu_slope_slice, elem::gelu_slope),
        (elem::exp_lanes_slice, elem::exp_lanes),
    ];
    for (slice, one) in pairs {
        for n in [0, 1, 7, 8, 9, 29] {
            slice(&x[..n], &mut y[..n]);
            assert!((0..n).all(|i| y[i].to_bits() == one(x[i]).to_bits()), "{n} elements");
        }
    }
    elem::pow_slice(&x, 2.4, &mut y);
    assert!((0..x.len()).all(|i| y[i].to_bits() == elem::pow(x[i], 2.4).to_bits()), "pow");
}

#[test]
fn every_function_of_the_table_is_tested() {
    let mut tested: Vec<_> = FUNCTIONS.iter().map(|f| f.name).chain(["atan2", "pow"]).collect();
    let mut listed: Vec<_> = TABLE.iter().map(|l| l.name).collect();
    tested.sort_unstable();
    listed.sort_unstable();
    assert_eq!(tested, listed);
}

#[test]
fn outside_its_range_the_fast_exponential_is_constant() {
    for (x, edge) in
        [(-88.0, elem::EXP_LANES_MIN), (-f32::INFINITY, elem::EXP_LANES_MIN), (89.0, elem::EXP_LANES_MAX)]
    {
        assert_eq!(elem::exp_lanes(x).to_bits(), elem::exp_lanes(edge).to_bits(), "at {x}");
    }
    assert!(elem::exp_lanes(elem::EXP_LANES_MIN).is_normal(), "the smallest result is a normal number");
    assert_eq!(elem::exp_lanes(-0.0_f32), 1.0);
}
