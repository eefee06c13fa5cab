//! From the features of a batch to signed distances and values, and back.

use super::batch::Batch;
use super::nets::{Net, Values, pack};
use super::scene::{Heads, Scene};
use crate::field::direction::{unit, unit_back};
use crate::field::embed::{Place, reflect};
use crate::field::sdf_head;
use crate::num::elem;
use crate::num::gemm::Packed;

/// The packed networks of a scene.
#[derive(Debug)]
pub(super) struct Nets {
    sdf: Net,
    color: Option<Net>,
    albedo: Option<Net>,
    material: Option<Net>,
    normal: Option<Net>,
    rho: Option<Net>,
}

/// Gradients of the weights, network by network and layer by layer; empty for networks that are not there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeadsBar {
    /// Of the network of the signed distance.
    pub sdf: Vec<Vec<f32>>,
    /// Of the colour.
    pub color: Vec<Vec<f32>>,
    /// Of the albedo.
    pub albedo: Vec<Vec<f32>>,
    /// Of roughness and metallic.
    pub material: Vec<Vec<f32>>,
    /// Of the normal.
    pub normal: Vec<Vec<f32>>,
    /// Of the roughness of the embedding.
    pub rho: Vec<Vec<f32>>,
}

impl HeadsBar {
    /// Returns all arrays in the order of the fields.
    pub fn arrays_mut(&mut self) -> impl Iterator<Item = &mut Vec<f32>> {
        let Self { sdf, color, albedo, material, normal, rho } = self;
        sdf.iter_mut().chain(color).chain(albedo).chain(material).chain(normal).chain(rho)
    }
}

/// Decoded values of a batch, with what the adjoint needs.
#[derive(Debug, Default)]
pub(super) struct Decoded {
    /// Values of all channels, (rows of the second list, channels).
    pub(super) values: Vec<f32>,
    sdf: Values,
    /// tanh of the network, per row of the first list.
    tanh: Vec<f32>,
    color: Values,
    albedo: Values,
    material: Values,
    normal: Values,
    rho: Values,
    /// Per row of the second list: the sum that the normal head normalises.
    sums: Vec<[f32; 3]>,
    /// Per row of the second list: ρ, and where the panoramas are read.
    rhos: Vec<f32>,
    places: Vec<Place>,
    /// Features ‖ h, (rows of the second list, F + C).
    joined: Vec<f32>,
    bars: Bars,
}

/// Cotangents of a batch.
#[derive(Debug, Default)]
struct Bars {
    outputs: Vec<f32>,
    joined: Vec<f32>,
    rho: Vec<f32>,
    /// Features, packed.
    packed: Vec<Packed>,
}

/// Cotangents of panorama values: the rows h̄ of a batch with the places where they were read.
pub(super) type Reads<'a> = (&'a [Place], &'a [f32]);

impl Nets {
    pub(super) fn new(heads: &Heads<'_>) -> Self {
        let net = |n: &Option<_>| n.as_ref().map(Net::new);
        Self {
            sdf: Net::new(&heads.sdf),
            color: net(&heads.color),
            albedo: net(&heads.albedo),
            material: net(&heads.material),
            normal: net(&heads.normal),
            rho: net(&heads.rho),
        }
    }

    /// Returns zeros for the gradients of all weights.
    pub(super) fn zeros(&self) -> HeadsBar {
        let zeros = |net: &Option<Net>| net.as_ref().map_or_else(Vec::new, Net::zeros);
        HeadsBar {
            sdf: self.sdf.zeros(),
            color: zeros(&self.color),
            albedo: zeros(&self.albedo),
            material: zeros(&self.material),
            normal: zeros(&self.normal),
            rho: zeros(&self.rho),
        }
    }

    /// Computes the signed distances of the first list.
    pub(super) fn sdf(&self, scene: &Scene<'_>, batch: &Batch, decoded: &mut Decoded, sdf: &mut Vec<f32>) {
        let (rows, stride) = (batch.rows(), self.sdf.outputs());
        self.sdf.forward(&batch.sdf_features, rows, &mut decoded.sdf);
        let raw: &[f32] = decoded.sdf.outputs();
        sdf.clear();
        sdf.extend(raw.iter().step_by(stride));
        decoded.tanh.resize(rows, 0.0);
        elem::tanh_slice(sdf, &mut decoded.tanh);
        for ((s, t), x) in sdf.iter_mut().zip(&decoded.tanh).zip(&batch.sdf_points) {
            *s = sdf_head::distance(*t, *x, scene.planes.half_size);
        }
    }

    /// Adds the gradients for the cotangents of the signed distances, and of the colours of a trunk that are
    /// left in `decoded` by [`Self::values_adjoint`].
    pub(super) fn sdf_adjoint(
        &self,
        scene: &Scene<'_>,
        batch: &Batch,
        decoded: &mut Decoded,
        sdf_bar: &[f32],
        (heads_bar, features_bar): (&mut HeadsBar, &mut [f32]),
    ) {
        let stride = self.sdf.outputs();
        let mut bar = std::mem::take(&mut decoded.bars.outputs);
        if stride == 1 {
            bar.clear();
            bar.resize(sdf_bar.len(), 0.0);
        }
        for (row, (s_bar, t)) in sdf_bar.iter().zip(&decoded.tanh).enumerate() {
            bar[row * stride] = sdf_head::distance_bar(*t, *s_bar, scene.planes.half_size);
        }
        let packed: &[Packed] = if scene.is_shared() { &decoded.bars.packed } else { &[] };
        let x = (&batch.sdf_features[..], packed);
        self.sdf.adjoint(x, &mut decoded.sdf, &bar, &mut heads_bar.sdf, features_bar);
        decoded.bars.outputs = bar;
    }

    /// Computes the values of all channels.
    pub(super) fn values(&self, scene: &Scene<'_>, batch: &Batch, decoded: &mut Decoded) {
        let (channels, samples) = (scene.channels(), batch.shaded());
        let q = channels.count();
        let mut all = std::mem::take(&mut decoded.values);
        all.resize(samples * q, 0.0);
        let features = batch.second_features(scene.is_shared());
        if let (Some(net), Some(at)) = (&self.normal, channels.normal) {
            net.forward(features, samples, &mut decoded.normal);
            decoded.sums.clear();
            for (i, raw) in decoded.normal.outputs().as_chunks::<3>().0.iter().enumerate() {
                let radial = unit(batch.shaded_points[i]);
                let sum: [f32; 3] = std::array::from_fn(|k| raw[k] + radial[k]);
                all[i * q + at..][..3].copy_from_slice(&unit(sum));
                decoded.sums.push(sum);
            }
        }
        if let Some(at) = channels.color {
            match &self.color {
                None => sigmoids(decoded.sdf.outputs(), (4, 1), &mut all, (q, at), 3),
                Some(net) if self.rho.is_none() => {
                    net.forward(features, samples, &mut decoded.color);
                    sigmoids(decoded.color.outputs(), (3, 0), &mut all, (q, at), 3);
                }
                Some(net) => {
                    self.join(scene, batch, decoded, &all);
                    net.forward(&decoded.joined, samples, &mut decoded.color);
                    sigmoids(decoded.color.outputs(), (3, 0), &mut all, (q, at), 3);
                }
            }
        }
        if let (Some(net), Some(at)) = (&self.albedo, channels.albedo) {
            net.forward(features, samples, &mut decoded.albedo);
            sigmoids(decoded.albedo.outputs(), (3, 0), &mut all, (q, at), 3);
        }
        if let (Some(net), Some(at)) = (&self.material, channels.material) {
            net.forward(features, samples, &mut decoded.material);
            sigmoids(decoded.material.outputs(), (2, 0), &mut all, (q, at), 2);
        }
        decoded.values = all;
    }

    /// Reads the panoramas for every row of the second list and writes features ‖ h.
    fn join(&self, scene: &Scene<'_>, batch: &Batch, decoded: &mut Decoded, values: &[f32]) {
        let (Some(rho), Some(panoramas)) = (&self.rho, &scene.panoramas) else { return };
        let (samples, channels) = (batch.shaded(), scene.channels());
        let features = batch.second_features(scene.is_shared());
        rho.forward(features, samples, &mut decoded.rho);
        decoded.rhos.resize(samples, 0.0);
        elem::sigmoid_slice(decoded.rho.outputs(), &mut decoded.rhos);
        let (f, c) = (rho.inputs(), panoramas.channels);
        let width = self.color.as_ref().map_or(0, Net::inputs);
        decoded.joined.resize(samples * width, 0.0);
        decoded.places.clear();
        for (i, ray) in batch.shaded_rays.iter().enumerate() {
            let at = i * channels.count() + channels.normal.unwrap_or(0);
            let normal = [values[at], values[at + 1], values[at + 2]];
            let reflected = reflect(normal, Some(scene.rays.directions[*ray]));
            let place = panoramas.place(reflected, decoded.rhos[i], None);
            let row = &mut decoded.joined[i * width..][..width];
            row[..f].copy_from_slice(&features[i * f..][..f]);
            panoramas.features(&place, &mut row[f..f + c]);
            if let Some(cosine) = row.get_mut(f + c) {
                *cosine = (reflected[0] * normal[0] + reflected[1] * normal[1]) + reflected[2] * normal[2];
            }
            decoded.places.push(place);
        }
    }

    /// Adds the gradients for the cotangents `values_bar` (rows of the second list, channels). The cotangents of the outputs
    /// of a trunk stay in `decoded` for [`Self::sdf_adjoint`].
    pub(super) fn values_adjoint<'a>(
        &self,
        scene: &Scene<'_>,
        batch: &Batch,
        decoded: &'a mut Decoded,
        values_bar: &[f32],
        (heads_bar, features_bar): (&mut HeadsBar, &mut [f32]),
    ) -> Reads<'a> {
        let (channels, samples) = (scene.channels(), batch.shaded());
        let q = channels.count();
        let all = std::mem::take(&mut decoded.values);
        let mut bars = std::mem::take(&mut decoded.bars);
        let features = batch.second_features(scene.is_shared());
        pack(features, self.sdf.inputs(), &mut bars.packed);
        let bar = &mut bars.outputs;
        if let (Some(net), Some(at)) = (&self.albedo, channels.albedo) {
            sigmoids_back(&all, values_bar, (q, at), 3, bar, (3, 0));
            net.adjoint(
                (features, &bars.packed),
                &mut decoded.albedo,
                bar,
                &mut heads_bar.albedo,
                features_bar,
            );
        }
        if let (Some(net), Some(at)) = (&self.material, channels.material) {
            sigmoids_back(&all, values_bar, (q, at), 2, bar, (2, 0));
            net.adjoint(
                (features, &bars.packed),
                &mut decoded.material,
                bar,
                &mut heads_bar.material,
                features_bar,
            );
        }
        if let (Some(net), Some(at)) = (&self.normal, channels.normal) {
            bar.clear();
            for (i, sum) in decoded.sums.iter().enumerate() {
                let of = i * q + at;
                bar.extend(unit_back(*sum, [values_bar[of], values_bar[of + 1], values_bar[of + 2]]));
            }
            net.adjoint(
                (features, &bars.packed),
                &mut decoded.normal,
                bar,
                &mut heads_bar.normal,
                features_bar,
            );
        }
        if let Some(at) = channels.color {
            match (&self.color, &self.rho) {
                (None, _) => {
                    bar.clear();
                    bar.resize(4 * samples, 0.0);
                    sigmoids_back(&all, values_bar, (q, at), 3, bar, (4, 1));
                }
                (Some(net), None) => {
                    sigmoids_back(&all, values_bar, (q, at), 3, bar, (3, 0));
                    net.adjoint(
                        (features, &bars.packed),
                        &mut decoded.color,
                        bar,
                        &mut heads_bar.color,
                        features_bar,
                    );
                }
                (Some(net), Some(rho)) => {
                    sigmoids_back(&all, values_bar, (q, at), 3, bar, (3, 0));
                    bars.joined.clear();
                    bars.joined.resize(decoded.joined.len(), 0.0);
                    net.adjoint(
                        (&decoded.joined, &[]),
                        &mut decoded.color,
                        bar,
                        &mut heads_bar.color,
                        &mut bars.joined,
                    );
                    self.split(scene, decoded, &mut bars, features_bar);
                    rho.adjoint(
                        (features, &bars.packed),
                        &mut decoded.rho,
                        &bars.rho,
                        &mut heads_bar.rho,
                        features_bar,
                    );
                }
            }
        }
        (decoded.values, decoded.bars) = (all, bars);
        (&decoded.places, &decoded.bars.joined)
    }

    /// Splits the cotangents of features ‖ h: adds the first part to those of the features, and reduces the
    /// second to that of ρ before its sigmoid; h̄ is moved to the front of the buffer.
    fn split(&self, scene: &Scene<'_>, decoded: &Decoded, bars: &mut Bars, features_bar: &mut [f32]) {
        let Some(panoramas) = &scene.panoramas else { return };
        let c = panoramas.channels;
        let width = decoded.joined.len() / decoded.places.len().max(1);
        let f = features_bar.len() / decoded.places.len().max(1);
        bars.rho.clear();
        for (i, place) in decoded.places.iter().enumerate() {
            let row = &bars.joined[i * width..][..width];
            let into = &mut features_bar[i * f..][..f];
            into.iter_mut().zip(row).for_each(|(sum, g)| *sum += g);
            let rho = decoded.rhos[i];
            bars.rho.push(panoramas.rho_bar(place, &row[f..f + c]) * (rho * (1.0 - rho)));
        }
        for i in 0..decoded.places.len() {
            bars.joined.copy_within(i * width + f..i * width + f + c, i * c);
        }
        bars.joined.truncate(decoded.places.len() * c);
    }
}

/// Writes the sigmoids of columns of x (rows of `stride` numbers, from `at` on) to columns of y.
fn sigmoids(x: &[f32], (stride, from): (usize, usize), y: &mut [f32], (q, at): (usize, usize), n: usize) {
    const ROWS: usize = 64;
    let mut buffer = [[0.0; ROWS * 3]; 2];
    for (x, y) in x.chunks(ROWS * stride).zip(y.chunks_mut(ROWS * q)) {
        let rows = x.len() / stride;
        let [before, after] = &mut buffer;
        for (row, x) in before.chunks_exact_mut(n).zip(x.chunks_exact(stride)) {
            row.copy_from_slice(&x[from..from + n]);
        }
        elem::sigmoid_slice(&before[..rows * n], &mut after[..rows * n]);
        for (row, y) in after.chunks_exact(n).zip(y.chunks_exact_mut(q)) {
            y[at..at + n].copy_from_slice(row);
        }
    }
}

/// Writes the cotangents before the sigmoids, v̄·v·(1−v), to columns of `bar`.
fn sigmoids_back(
    values: &[f32],
    values_bar: &[f32],
    (q, at): (usize, usize),
    n: usize,
    bar: &mut Vec<f32>,
    (stride, from): (usize, usize),
) {
    bar.resize(values.len() / q * stride, 0.0);
    let rows = values.chunks_exact(q).zip(values_bar.chunks_exact(q));
    for ((v, v_bar), bar) in rows.zip(bar.chunks_exact_mut(stride)) {
        for k in 0..n {
            let v = v[at + k];
            bar[from + k] = v_bar[at + k] * (v * (1.0 - v));
        }
    }
}
