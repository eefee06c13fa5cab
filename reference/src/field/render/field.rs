//! The field of a call: signed distances, densities, values and normals at points, with their decisions.

use super::In;
use crate::array::{Arr, Named};
use crate::field::decisions::{Bits, Rows};
use crate::field::network::network_by;
use crate::field::{density, embed, fetch, half_size, interval, normal, normal_head, sdf_head};
use crate::scalar::Scalar;
use crate::settings::Settings;

/// Settings in their final form.
pub(super) struct Choices {
    pub(super) half_size: f64,
    pub(super) step: f64,
    rule: String,
    is_sum: bool,
    pub(super) early_stop: f64,
    pub(super) least_weight: f64,
    pub(super) normals: String,
    epsilon: f64,
}

impl Choices {
    pub(super) fn of(settings: &Settings<'_>) -> Result<Self, String> {
        let half_size = half_size(settings)?;
        let samples = settings.whole("samples", 1.0)? as f64;
        Ok(Self {
            half_size,
            step: 2.0 * 3.0_f64.sqrt() * half_size / samples,
            rule: settings.word("rule").to_owned(),
            is_sum: settings.word("combine") == "sum",
            early_stop: settings.number("early_stop"),
            least_weight: settings.number("least_weight"),
            normals: settings.word("normals").to_owned(),
            epsilon: settings.given_number("epsilon").unwrap_or(8.0 * half_size / samples),
        })
    }
}

/// Networks by head; an absent head is empty.
pub(super) struct Heads<'a, S> {
    pub(super) sdf: Vec<&'a Arr<S>>,
    pub(super) color: Vec<&'a Arr<S>>,
    pub(super) albedo: Vec<&'a Arr<S>>,
    pub(super) material: Vec<&'a Arr<S>>,
    pub(super) normal: Vec<&'a Arr<S>>,
    pub(super) rho: Vec<&'a Arr<S>>,
}

impl<'a, S: Scalar> Heads<'a, S> {
    pub(super) fn of(x: &In<'a, S>) -> Self {
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

    /// Whether the first network also gives the colour.
    pub(super) fn is_trunk(&self) -> bool {
        self.sdf[2].shape[0] == 4
    }
}

/// Decisions at samples, ray by ray.
pub(super) struct Decisions<'a> {
    /// Hidden units that pass their values.
    active: Bits<'a>,
    /// Sides of signed distances.
    side: Bits<'a>,
    /// Gradients that are long enough for a numerical normal.
    steep: Bits<'a>,
    /// First row and column, lower level.
    panorama: Rows<'a, 3>,
    /// Directions in which the panoramas are read.
    reflected: Rows<'a, 3>,
    /// Cosines of the normal with them.
    cosine: Rows<'a, 1>,
}

impl<'a> Decisions<'a> {
    pub(super) fn of(plan: Option<&'a Named<f64>>) -> Self {
        Self {
            active: Bits::new(plan, "active"),
            side: Bits::new(plan, "side"),
            steep: Bits::new(plan, "steep"),
            panorama: Rows::new(plan, "panorama"),
            reflected: Rows::new(plan, "reflected"),
            cosine: Rows::new(plan, "cosine"),
        }
    }

    pub(super) fn put(self, plan: &mut Named<f64>) {
        self.active.put(plan);
        self.side.put(plan);
        self.steep.put(plan);
        self.panorama.put(plan);
        self.reflected.put(plan);
        self.cosine.put(plan);
    }
}

fn sigmoid<S: Scalar>(x: S) -> S {
    S::one() / ((-x).exp() + 1.0)
}

/// The field of a call.
pub(super) struct Field<'a, S> {
    pub(super) input: &'a In<'a, S>,
    pub(super) heads: Heads<'a, S>,
    pub(super) choices: &'a Choices,
    pub(super) decisions: Decisions<'a>,
}

/// A network whose decisions are the next ones.
fn network<S: Scalar>(weights: &[&Arr<S>], row: &[S], active: &mut Bits<'_>) -> Vec<S> {
    network_by(weights, row, |own| active.choose(own))
}

fn sigmoids<S: Scalar>(weights: &[&Arr<S>], row: &[S], active: &mut Bits<'_>) -> Vec<S> {
    network(weights, row, active).into_iter().map(sigmoid).collect()
}

impl<S: Scalar> Field<'_, S> {
    fn features(&self, x: [f64; 3]) -> Vec<S> {
        fetch::features(self.input.planes, x.map(S::from_f64), self.choices.half_size, self.choices.is_sum)
    }

    /// Signed distance, and the further outputs of a trunk.
    fn sdf(&mut self, x: [f64; 3]) -> (S, Vec<S>) {
        let features = self.features(x);
        let z = network(&self.heads.sdf, &features, &mut self.decisions.active);
        (sdf_head::distance(z[0], x.map(S::from_f64), self.choices.half_size), z[1..].to_vec())
    }

    /// Values of a sample by output name.
    pub(super) fn values(&mut self, x: [f64; 3], direction: [f64; 3]) -> Vec<(&'static str, Vec<S>)> {
        let mut values = Vec::new();
        if self.heads.is_trunk() {
            values.push(("color", self.sdf(x).1.into_iter().map(sigmoid).collect()));
        }
        let features = self.features(x);
        let (heads, decisions) = (&self.heads, &mut self.decisions);
        let normal = (!heads.normal.is_empty()).then(|| {
            let z = network(&heads.normal, &features, &mut decisions.active);
            let radial = normal_head::unit(x.map(S::from_f64));
            normal_head::unit(std::array::from_fn(|k| z[k] + radial[k]))
        });
        if !heads.color.is_empty() {
            let mut own = features.clone();
            if let (Some(maps), Some(n)) = (self.input.panoramas, normal) {
                let rho = sigmoids(&heads.rho, &features, &mut decisions.active)[0];
                // The normal that is looked up carries no gradient: differences hold the direction as well.
                let n = n.map(Scalar::value);
                let live = embed::reflect(n, Some(direction));
                let r = decisions.reflected.given().unwrap_or(live);
                let given = decisions.panorama.given();
                let chosen = (given.map(|[row, column, _]| [row, column]), given.map(|cell| cell[2]));
                let (h, cell) = embed::features(maps, r, rho, chosen);
                decisions.reflected.push(r);
                decisions.panorama.push(cell);
                own.extend(h);
                if heads.color[0].shape[1] > own.len() {
                    let live = n[0] * live[0] + n[1] * live[1] + n[2] * live[2];
                    let [cosine] = decisions.cosine.given().unwrap_or([live]);
                    decisions.cosine.push([cosine]);
                    own.push(S::from_f64(cosine));
                }
            }
            values.push(("color", sigmoids(&heads.color, &own, &mut decisions.active)));
        }
        for (name, head) in [("albedo", &heads.albedo), ("material", &heads.material)] {
            if !head.is_empty() {
                values.push((name, sigmoids(head, &features, &mut decisions.active)));
            }
        }
        if let Some(n) = normal {
            values.push(("normal", n.to_vec()));
        }
        values
    }

    /// Density of a step.
    pub(super) fn density(&mut self, at: impl Fn(f64) -> [f64; 3], [begin, end]: [f64; 2], beta: S) -> S {
        let place = match self.choices.rule.as_str() {
            "left" => begin,
            "midpoint" => begin + (end - begin) / 2.0,
            _ => {
                let (s0, s1) = (self.sdf(at(begin)).0, self.sdf(at(end)).0);
                return interval::interval_by(s0, s1, beta, |own| self.decisions.side.choose(own));
            }
        };
        let s = self.sdf(at(place)).0;
        density::density_by(s, beta, |own| self.decisions.side.choose(own))
    }

    pub(super) fn numerical_normal(&mut self, x: [f64; 3]) -> [S; 3] {
        let e = self.choices.epsilon;
        let mut values = Vec::new();
        let is_forward = self.choices.normals == "forward";
        if is_forward {
            values.push(self.sdf(x).0);
        }
        let sides: &[f64] = if is_forward { &[e] } else { &[e, -e] };
        for k in 0..3 {
            for by in sides {
                let mut y = x;
                y[k] += by;
                values.push(self.sdf(y).0);
            }
        }
        normal::direction_by(normal::differences(&values, e), |own| self.decisions.steep.choose(own))
    }
}
