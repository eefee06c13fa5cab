//! `field.render`: rays through a field.
//!
//! wᵢ = Tᵢ(1 − e^(−σᵢδᵢ)),   Tᵢ₊₁ = Tᵢ·e^(−σᵢδᵢ),   O = Σ wᵢ,   v = Σ wᵢvᵢ + T·b, T behind the last sample;
//! vᵢ = b where wᵢ < `least_weight`
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
//! h = 2√3·R/samples. Values are taken at its middle, the density by `rule`.
//!
//! # Rounding
//! Left folds over the samples of a ray.
//!
//! # Kinks and domain
//! Those of the parts. The plan holds the steps of every ray, the number of samples it takes and whether O >
//! 0.98. That of the twin also has every choice at the samples, in the order in which it evaluates them (ray by ray
//! and sample by sample: density, values, numerical normal), and the directions in which the panoramas are read,
//! which carry no gradient. Octants and texels follow from the rays and the steps, which do not move.

mod field;
mod march;

use super::density;
use crate::array::{Arr, Named, Out, Slot};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::settings::Settings;
use crate::twins::Call;
use field::{Choices, Decisions, Field, Heads};
use march::{crossing, march, steps};

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
        shaded: Port::int("M", Dtype::U8, "1: the values of the step are decoded").or_absent(),
        valid: Port::int("N", Dtype::U8, "1: the opacity is above 0.98"),
        active: Port::int("A1", Dtype::I64, "twin: units above 0, 32 to an entry, the first in the lowest bit")
            .or_absent(),
        side: Port::int("A2", Dtype::I64, "twin: sides of signed distances, likewise").or_absent(),
        steep: Port::int("A3", Dtype::I64, "twin: gradients longer than 1e-4, likewise").or_absent(),
        panorama: Port::int("K,3", Dtype::I32, "twin: first row and column, lower panorama").or_absent(),
        reflected: Port::fixed("K,3", "twin: direction in which they are read; held in differences").or_absent(),
        cosine: Port::fixed("K,1", "twin: its cosine with the normal; held in differences").or_absent(),
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
        SettingSpec::number(
            "least_weight",
            "0",
            "samples with a smaller weight have the background's values",
        ),
        SettingSpec::choice("normals", &["none", "forward", "central"], "none", "numerical normals"),
        SettingSpec::number("epsilon", "8 R/samples", "distance of the points of numerical normals"),
    ],
    ..Signature::EMPTY
};

/// Output arrays by name.
fn slots<S: Scalar>(
    field: &Field<'_, S>,
    out: &mut Out<'_, S>,
    n: usize,
) -> Vec<(&'static str, Slot, usize)> {
    let h = &field.heads;
    let names = [
        ("color", 3, h.is_trunk() || !h.color.is_empty()),
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
    let decisions = Decisions::of(plan);
    let mut field = Field { input, heads: Heads::of(input), choices: &choices, decisions };
    let n = input.origins.shape[0];
    let values = slots(&field, out, n);
    let (opacity, point) = (out.array("opacity", &[n]), out.array("point", &[n, 3]));
    let numerical = (choices.normals != "none").then(|| out.array("numerical_normal", &[n, 3]));
    let (mut start, mut index, mut took, mut valid) = (vec![0.0], Vec::new(), Vec::new(), Vec::new());
    let (least, mut shaded) = (choices.least_weight, Vec::new());
    for ray in 0..n {
        let of = |x: &Arr<S>| x.row::<3>(ray).map(Scalar::value);
        let (origin, direction) = (of(input.origins), of(input.directions));
        let span = crossing(origin, direction, choices.half_size);
        let steps = steps(plan, ray, span, choices.step);
        let given = plan.and_then(|p| p.get("taken")).map(|t| t.data[ray] as usize);
        let of_ray = |all: &'_ Arr<f64>| all.data[index.len()..index.len() + steps.len()].to_vec();
        let given_shaded = plan.and_then(|p| p.get("shaded")).map(of_ray);
        let sums = march(&mut field, (origin, direction), (span, &steps), (given, given_shaded.as_deref()));
        let is_valid = match plan.and_then(|p| p.get("valid")) {
            Some(v) => v.data[ray] != 0.0,
            None => sums.opacity.value() > 0.98,
        };
        let rest = (sums.through + sums.unshaded) * input.background.data[0];
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
        shaded.extend(sums.shaded);
        valid.push(f64::from(u8::from(is_valid)));
    }
    for (name, data) in [("start", start), ("index", index), ("taken", took), ("valid", valid)] {
        out.plan.insert(name.to_owned(), Arr::new(&[data.len()], data));
    }
    if least > 0.0 && !field.heads.is_trunk() {
        out.plan.insert("shaded".to_owned(), Arr::new(&[shaded.len()], shaded));
    }
    field.decisions.put(&mut out.plan);
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
    let weights = all.iter().flatten().fold(0, |sum, w| sum + w.data.len());
    let samples = call.settings.whole("samples", 1.0)?;
    Ok((input.origins.shape[0] * samples * weights) as u64)
}
