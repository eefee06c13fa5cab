//! `field.render`: rays through a field.
//!
//! wᵢ = Tᵢ(1 − e^(−σᵢδᵢ)),   Tᵢ₊₁ = Tᵢ·e^(−σᵢδᵢ),   O = Σ wᵢ,   v = Σ wᵢvᵢ + (1 − O)·b
//! x̂ = Σ wᵢxᵢ/max(O, 0.98),   n̂ = N/‖N‖ with N = Σ wᵢnᵢ where O > 0.98, else 0
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | | `origins`, `directions` | (N, 3) |
//! | | `planes`, `panoramas` | as in `field.fetch`, `field.embed` |
//! | | `sdf_w0` … `rho_w2` | weights (out, in) of the heads |
//! | β, b | `beta`, `background` | () |
//! | v | `color`, `albedo`, `material`, `normal` | (N, 3), (N, 3), (N, 2), (N, 3) |
//! | O, x̂, n̂ | `opacity`, `point`, `numerical_normal` | (N), (N, 3), (N, 3) |
//!
//! Step i of a ray is [t₀ + ih, t₀ + (i+1)h], cut at t₁; t₀ and t₁ are where the ray enters and leaves the box,
//! h = 2√3·R/samples. Values are taken at its middle, the density as `rule` says.
//!
//! # Rounding
//! Left folds over the samples of a ray.
//!
//! # Kinks and domain
//! Those of the parts. The plan holds the steps of every ray, the number of samples it takes and whether O >
//! 0.98.

use super::network::network;
use super::{density, embed, fetch, half_size, interval, normal, normal_head, sdf_head};
use crate::array::{Arr, Named, Out, Slot};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::settings::Settings;
use crate::twins::Call;

/// Weights of a layer of a head that may be absent.
const fn layer(shape: &'static str) -> Port {
    Port::var(shape, "weights (out, in)").or_absent()
}

inputs! {
    /// Inputs of `field.render`.
    pub struct In<'a, S> {
        origins: &'a Arr<S> = Port::fixed("N,3", "of the rays"),
        directions: &'a Arr<S> = Port::fixed("N,3", "unit length"),
        planes: &'a Arr<S> = Port::var("P,S,S,C", "xy−, xy+, xz−, xz+, yz−, yz+, or xy, xz, yz"),
        panoramas: Option<&'a Arr<S>> = Port::var("L,H,W,D", "read by the colour; with the heads normal and rho"),
        sdf_w0: &'a Arr<S> = Port::var("SA,F", "signed distance, first layer"),
        sdf_w1: &'a Arr<S> = Port::var("SB,SA", "signed distance, second layer"),
        sdf_w2: &'a Arr<S> = Port::var("SC,SB", "signed distance, last layer: 1 output, or 4 with the colour"),
        color_w0: Option<&'a Arr<S>> = layer("CA,CF"),
        color_w1: Option<&'a Arr<S>> = layer("CB,CA"),
        color_w2: Option<&'a Arr<S>> = layer("CD,CB"),
        color_w3: Option<&'a Arr<S>> = layer("3,CD"),
        albedo_w0: Option<&'a Arr<S>> = layer("AA,F"),
        albedo_w1: Option<&'a Arr<S>> = layer("AB,AA"),
        albedo_w2: Option<&'a Arr<S>> = layer("AD,AB"),
        albedo_w3: Option<&'a Arr<S>> = layer("3,AD"),
        material_w0: Option<&'a Arr<S>> = layer("MA,F"),
        material_w1: Option<&'a Arr<S>> = layer("MB,MA"),
        material_w2: Option<&'a Arr<S>> = layer("MD,MB"),
        material_w3: Option<&'a Arr<S>> = layer("2,MD"),
        normal_w0: Option<&'a Arr<S>> = layer("NA,F"),
        normal_w1: Option<&'a Arr<S>> = layer("NB,NA"),
        normal_w2: Option<&'a Arr<S>> = layer("ND,NB"),
        normal_w3: Option<&'a Arr<S>> = layer("3,ND"),
        rho_w0: Option<&'a Arr<S>> = layer("RA,F"),
        rho_w1: Option<&'a Arr<S>> = layer("RB,RA"),
        rho_w2: Option<&'a Arr<S>> = layer("1,RB"),
        beta: &'a Arr<S> = density::BETA,
        background: &'a Arr<S> = Port::var("", "of all values"),
    }
}

/// `field.render`
pub static SIGNATURE: Signature = Signature {
    name: "field.render",
    summary: "rays through a field: colour, materials, normals, opacity, surface points",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        color: Port::var("N,3", "sRGB-encoded").or_absent(),
        albedo: Port::var("N,3", "sRGB-encoded").or_absent(),
        material: Port::var("N,2", "roughness, metallic").or_absent(),
        normal: Port::var("N,3", "of the normal head").or_absent(),
        opacity: Port::var("N", ""),
        point: Port::var("N,3", "mean point of the samples"),
        numerical_normal: Port::var("N,3", "of the signed distance").or_absent(),
    ],
    plan: ports![
        start: Port::int("N1", Dtype::I64, "first entry of every ray in index"),
        index: Port::int("M", Dtype::I32, "steps that take a sample"),
        taken: Port::int("N", Dtype::I32, "samples taken per ray"),
        valid: Port::int("N", Dtype::U8, "1: the opacity is above 0.98"),
    ],
    settings: &[
        super::HALF_SIZE,
        SettingSpec::number("samples", "128", "steps along the diagonal of the box"),
        SettingSpec::choice(
            "rule",
            &["left", "midpoint", "analytic"],
            "midpoint",
            "where the density is taken",
        ),
        SettingSpec::choice("combine", &["concat", "sum"], "concat", "how the three planes are combined"),
        SettingSpec::number("early_stop", "0", "transmittance at which rays end; 0: none"),
        SettingSpec::choice("normals", &["none", "forward", "central"], "none", "numerical normals"),
        SettingSpec::number("epsilon", "8 R/samples", "distance of the points of numerical normals"),
    ],
    ..Signature::EMPTY
};

/// Settings in their final form.
struct Choices {
    half_size: f64,
    step: f64,
    rule: String,
    is_sum: bool,
    early_stop: f64,
    normals: String,
    epsilon: f64,
}

impl Choices {
    fn of(settings: &Settings<'_>) -> Result<Self, String> {
        let half_size = half_size(settings)?;
        let samples = settings.whole("samples", 1.0)? as f64;
        Ok(Self {
            half_size,
            step: 2.0 * 3.0_f64.sqrt() * half_size / samples,
            rule: settings.word("rule").to_owned(),
            is_sum: settings.word("combine") == "sum",
            early_stop: settings.number("early_stop"),
            normals: settings.word("normals").to_owned(),
            epsilon: settings.given_number("epsilon").unwrap_or(8.0 * half_size / samples),
        })
    }
}

/// Networks by head; an absent head is empty.
struct Heads<'a, S> {
    sdf: Vec<&'a Arr<S>>,
    color: Vec<&'a Arr<S>>,
    albedo: Vec<&'a Arr<S>>,
    material: Vec<&'a Arr<S>>,
    normal: Vec<&'a Arr<S>>,
    rho: Vec<&'a Arr<S>>,
}

impl<'a, S: Scalar> Heads<'a, S> {
    fn of(x: &In<'a, S>) -> Self {
        let all = |layers: &[Option<&'a Arr<S>>]| layers.iter().flatten().copied().collect();
        Self {
            sdf: vec![x.sdf_w0, x.sdf_w1, x.sdf_w2],
            color: all(&[x.color_w0, x.color_w1, x.color_w2, x.color_w3]),
            albedo: all(&[x.albedo_w0, x.albedo_w1, x.albedo_w2, x.albedo_w3]),
            material: all(&[x.material_w0, x.material_w1, x.material_w2, x.material_w3]),
            normal: all(&[x.normal_w0, x.normal_w1, x.normal_w2, x.normal_w3]),
            rho: all(&[x.rho_w0, x.rho_w1, x.rho_w2]),
        }
    }
}

fn sigmoid<S: Scalar>(x: S) -> S {
    S::one() / ((-x).exp() + 1.0)
}

/// The field of a call.
struct Field<'a, S> {
    input: &'a In<'a, S>,
    heads: Heads<'a, S>,
    choices: &'a Choices,
}

impl<S: Scalar> Field<'_, S> {
    fn features(&self, x: [f64; 3]) -> Vec<S> {
        fetch::features(self.input.planes, x.map(S::from_f64), self.choices.half_size, self.choices.is_sum)
    }

    /// Signed distance, and the further outputs of a trunk.
    fn sdf(&self, x: [f64; 3]) -> (S, Vec<S>) {
        let z = network(&self.heads.sdf, &self.features(x));
        (sdf_head::distance(z[0], x.map(S::from_f64), self.choices.half_size), z[1..].to_vec())
    }

    /// Values of a sample by output name.
    fn values(&self, x: [f64; 3], direction: [f64; 3]) -> Vec<(&'static str, Vec<S>)> {
        let (features, heads) = (self.features(x), &self.heads);
        let mut values = Vec::new();
        let normal = (!heads.normal.is_empty()).then(|| {
            let z = network(&heads.normal, &features);
            let radial = normal_head::unit(x.map(S::from_f64));
            normal_head::unit(std::array::from_fn(|k| z[k] + radial[k]))
        });
        if heads.sdf[2].shape[0] == 4 {
            values.push(("color", self.sdf(x).1.into_iter().map(sigmoid).collect()));
        } else if !heads.color.is_empty() {
            let mut own = features.clone();
            if let (Some(maps), Some(n)) = (self.input.panoramas, normal) {
                let rho = sigmoid(network(&heads.rho, &features)[0]);
                let r = embed::reflect(n.map(Scalar::value), Some(direction));
                own.extend(embed::features(maps, r, rho, (None, None)).0);
            }
            values.push(("color", network(&heads.color, &own).into_iter().map(sigmoid).collect()));
        }
        if !heads.albedo.is_empty() {
            values.push(("albedo", network(&heads.albedo, &features).into_iter().map(sigmoid).collect()));
        }
        if !heads.material.is_empty() {
            values.push(("material", network(&heads.material, &features).into_iter().map(sigmoid).collect()));
        }
        if let Some(n) = normal {
            values.push(("normal", n.to_vec()));
        }
        values
    }

    fn density(&self, at: impl Fn(f64) -> [f64; 3], [begin, end]: [f64; 2], beta: S) -> S {
        match self.choices.rule.as_str() {
            "left" => density::density(self.sdf(at(begin)).0, beta),
            "midpoint" => density::density(self.sdf(at(begin + (end - begin) / 2.0)).0, beta),
            _ => interval::interval(self.sdf(at(begin)).0, self.sdf(at(end)).0, beta),
        }
    }

    fn numerical_normal(&self, x: [f64; 3]) -> [S; 3] {
        let e = self.choices.epsilon;
        let moved = |k: usize, by: f64| {
            let mut y = x;
            y[k] += by;
            self.sdf(y).0
        };
        let values: Vec<S> = if self.choices.normals == "forward" {
            std::iter::once(self.sdf(x).0).chain((0..3).map(|k| moved(k, e))).collect()
        } else {
            (0..3).flat_map(|k| [moved(k, e), moved(k, -e)]).collect()
        };
        normal::direction(normal::differences(&values, e))
    }
}

/// Distances at which a ray enters and leaves the box; entry ≥ exit if it misses.
fn crossing(origin: [f64; 3], direction: [f64; 3], half_size: f64) -> [f64; 2] {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for k in 0..3 {
        if direction[k] == 0.0 {
            if origin[k].abs() > half_size {
                return [1.0, 0.0];
            }
        } else {
            let a = (-half_size - origin[k]) / direction[k];
            let b = (half_size - origin[k]) / direction[k];
            enter = if a.min(b) > enter { a.min(b) } else { enter };
            leave = if a.max(b) < leave { a.max(b) } else { leave };
        }
    }
    [enter, leave]
}

/// Steps of a ray: those of the plan, or all that begin before it leaves the box.
fn steps(plan: Option<&Named<f64>>, ray: usize, [enter, leave]: [f64; 2], step: f64) -> Vec<usize> {
    if let Some((start, index)) = plan.and_then(|p| Some((p.get("start")?, p.get("index")?))) {
        let (from, to) = (start.data[ray] as usize, start.data[ray + 1] as usize);
        return index.data[from..to].iter().map(|i| *i as usize).collect();
    }
    let mut all = Vec::new();
    while enter + all.len() as f64 * step < leave {
        all.push(all.len());
    }
    all
}

/// Sums along one ray.
struct Sums<S> {
    opacity: S,
    values: Vec<(&'static str, Vec<S>)>,
    point: [S; 3],
    normal: [S; 3],
    taken: usize,
}

fn march<S: Scalar>(
    field: &Field<'_, S>,
    (origin, direction): ([f64; 3], [f64; 3]),
    ([enter, leave], steps): ([f64; 2], &[usize]),
    taken: Option<usize>,
) -> Sums<S> {
    let beta = field.input.beta.data[0];
    let at = |t: f64| std::array::from_fn(|k| origin[k] + t * direction[k]);
    let mut through = S::one();
    let mut sums = Sums {
        opacity: S::zero(),
        values: Vec::new(),
        point: [S::zero(); 3],
        normal: [S::zero(); 3],
        taken: 0,
    };
    for i in steps {
        if taken == Some(sums.taken) {
            break;
        }
        let begin = enter + *i as f64 * field.choices.step;
        let end = leave.min(enter + (*i + 1) as f64 * field.choices.step);
        let sigma = field.density(at, [begin, end], beta);
        let kept = (-(sigma * (end - begin))).exp();
        let weight = through * (-(-(sigma * (end - begin))).expm1());
        let middle: [f64; 3] = at(begin + (end - begin) / 2.0);
        sums.opacity = sums.opacity + weight;
        let values = field.values(middle, direction);
        if sums.values.is_empty() {
            sums.values = values.iter().map(|(name, v)| (*name, vec![S::zero(); v.len()])).collect();
        }
        for ((_, sum), (_, value)) in sums.values.iter_mut().zip(values) {
            for (sum, v) in sum.iter_mut().zip(value) {
                *sum = *sum + weight * v;
            }
        }
        for k in 0..3 {
            sums.point[k] = sums.point[k] + weight * middle[k];
        }
        if field.choices.normals != "none" {
            let n = field.numerical_normal(middle);
            for k in 0..3 {
                sums.normal[k] = sums.normal[k] + weight * n[k];
            }
        }
        through = through * kept;
        sums.taken += 1;
        if taken.is_none() && field.choices.early_stop > 0.0 && through.value() <= field.choices.early_stop {
            break;
        }
    }
    sums
}

/// Output arrays by name.
fn slots<S: Scalar>(
    field: &Field<'_, S>,
    out: &mut Out<'_, S>,
    n: usize,
) -> Vec<(&'static str, Slot, usize)> {
    let h = &field.heads;
    let is_trunk = h.sdf[2].shape[0] == 4;
    let names = [
        ("color", 3, is_trunk || !h.color.is_empty()),
        ("albedo", 3, !h.albedo.is_empty()),
        ("material", 2, !h.material.is_empty()),
        ("normal", 3, !h.normal.is_empty()),
    ];
    names
        .into_iter()
        .filter(|(_, _, is_there)| *is_there)
        .map(|(name, width, _)| (name, out.array(name, &[n, width]), width))
        .collect()
}

/// The twin of `field.render`.
///
/// # Errors
/// When a setting is out of its range.
pub fn forward<S: Scalar>(
    input: &In<'_, S>,
    settings: &Settings<'_>,
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    let choices = Choices::of(settings)?;
    density::scale(input.beta)?;
    let field = Field { input, heads: Heads::of(input), choices: &choices };
    let n = input.origins.shape[0];
    let values = slots(&field, out, n);
    let (opacity, point) = (out.array("opacity", &[n]), out.array("point", &[n, 3]));
    let numerical = (choices.normals != "none").then(|| out.array("numerical_normal", &[n, 3]));
    let (mut start, mut index, mut took, mut valid) = (vec![0.0], Vec::new(), Vec::new(), Vec::new());
    for ray in 0..n {
        let of = |x: &Arr<S>| x.row::<3>(ray).map(Scalar::value);
        let (origin, direction) = (of(input.origins), of(input.directions));
        let span = crossing(origin, direction, choices.half_size);
        let steps = steps(plan, ray, span, choices.step);
        let given = plan.and_then(|p| p.get("taken")).map(|t| t.data[ray] as usize);
        let sums = march(&field, (origin, direction), (span, &steps), given);
        let is_valid = match plan.and_then(|p| p.get("valid")) {
            Some(v) => v.data[ray] != 0.0,
            None => sums.opacity.value() > 0.98,
        };
        let rest = (S::one() - sums.opacity) * input.background.data[0];
        for (name, slot, width) in &values {
            let own = sums.values.iter().find(|(other, _)| other == name);
            for k in 0..*width {
                let sum = own.map_or(S::zero(), |(_, v)| v[k]);
                out.put(*slot, ray * width + k, sum + rest);
            }
        }
        out.put(opacity, ray, sums.opacity);
        let divisor = if is_valid { sums.opacity } else { S::from_f64(0.98) };
        out.put_row(point, ray, sums.point.map(|x| x / divisor));
        if let Some(slot) = numerical {
            let length = super::length(sums.normal);
            let is_there = is_valid && length.value() > 0.0;
            let unit = sums.normal.map(|x| if is_there { x / length } else { S::zero() });
            out.put_row(slot, ray, unit);
        }
        out.flush();
        index.extend(steps.iter().map(|i| *i as f64));
        start.push(index.len() as f64);
        took.push(sums.taken as f64);
        valid.push(f64::from(u8::from(is_valid)));
    }
    for (name, data) in [("start", start), ("index", index), ("taken", took), ("valid", valid)] {
        out.plan.insert(name.to_owned(), Arr::new(&[data.len()], data));
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or a setting is out of its range.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, &call.settings, call.plan, out)
}

/// Number of products of the networks, if every ray crosses the diagonal.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let input = In::of(call.arrays)?;
    let heads = Heads::of(&input);
    let all = [heads.sdf, heads.color, heads.albedo, heads.material, heads.normal, heads.rho];
    let weights: usize = all.iter().flatten().map(|w| w.data.len()).sum();
    let samples = call.settings.whole("samples", 1.0)?;
    Ok((input.origins.shape[0] * samples * weights) as u64)
}
