//! Fields and rays that tests of the renderer share.

use crate::chains::values;
use lastlight::field::embed::Panoramas;
use lastlight::field::fetch::{Combine, Planes};
use lastlight::field::network::Network;
use lastlight::field::render::{Heads, InBar, Out, OutBar, Plan, Rays, Scene, Settings, adjoint, forward};

/// Half size of the box.
pub(super) const HALF_SIZE: f32 = 0.5;
/// Texels per side, channels.
pub(super) const SIDE: usize = 5;
pub(super) const CHANNELS: usize = 3;
/// Levels, rows, columns, channels of the panoramas.
const MAPS: [usize; 4] = [3, 4, 3, 2];

/// Owned arrays of a field with six planes and rays.
pub(super) struct Made {
    pub(super) origins: Vec<[f32; 3]>,
    pub(super) directions: Vec<[f32; 3]>,
    pub(super) planes: Vec<f32>,
    maps: Vec<f32>,
    /// Signed distance, colour, albedo, material, normal, ρ.
    heads: [Vec<Vec<f32>>; 6],
    pub(super) beta: f32,
    pub(super) settings: Settings,
    /// Whether the colour reads panoramas.
    pub(super) is_embedded: bool,
    /// Whether it reads the cosine of the reflection behind them.
    has_cosine: bool,
}

/// Weights of layers of these widths.
fn layers(widths: &[usize], seed: u64) -> Vec<Vec<f32>> {
    let layer = |(l, size): (usize, &[usize])| {
        let scale = 2.0 / (size[0] as f32).sqrt();
        values(size[0] * size[1], seed + l as u64).into_iter().map(|w| scale * w).collect()
    };
    widths.windows(2).enumerate().map(layer).collect()
}

/// x/‖x‖ in f64.
pub(super) fn unit(x: [f64; 3]) -> [f64; 3] {
    let length = (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt();
    x.map(|x| x / length)
}

/// `n` rays through the middle of the box.
pub(super) fn rays(n: usize, seed: u64) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
    let drawn = values(6 * n, seed);
    let ray = |x: &[f32]| {
        let d = unit([x[0], x[1], x[2] + 1e-3].map(f64::from)).map(|x| x as f32);
        (std::array::from_fn(|k| 0.2 * x[3 + k] - 1.2 * d[k]), d)
    };
    drawn.chunks_exact(6).map(ray).unzip()
}

impl Made {
    /// A field with random planes and heads.
    pub(super) fn random(n: usize, seed: u64) -> Self {
        let (origins, directions) = rays(n, seed);
        let f = 3 * CHANNELS;
        Self {
            origins,
            directions,
            planes: values(6 * SIDE * SIDE * CHANNELS, seed + 1).into_iter().map(|x| 1.5 * x).collect(),
            maps: values(MAPS[0] * MAPS[1] * MAPS[2] * MAPS[3], seed + 2),
            heads: [
                layers(&[f, 7, 6, 1], seed + 10),
                layers(&[f, 6, 5, 4, 3], seed + 20),
                layers(&[f, 6, 5, 4, 3], seed + 30),
                layers(&[f, 6, 5, 4, 2], seed + 40),
                layers(&[f, 6, 5, 4, 3], seed + 50),
                layers(&[f, 6, 5, 1], seed + 60),
            ],
            beta: 0.0625,
            settings: Settings { samples: 24, background: 0.75, ..Settings::default() },
            is_embedded: false,
            has_cosine: false,
        }
    }

    /// With panoramas, which make the colour depend on direction.
    pub(super) fn embedded(n: usize, seed: u64) -> Self {
        let mut made = Self::random(n, seed);
        made.heads[1] = layers(&[3 * CHANNELS + MAPS[3], 6, 5, 4, 3], seed + 70);
        made.is_embedded = true;
        made
    }

    /// The colour also reads the cosine of the reflection, with weights 0.
    pub(super) fn with_cosine(mut self) -> Self {
        let inputs = 3 * CHANNELS + MAPS[3];
        self.heads[1][0] =
            self.heads[1][0].chunks_exact(inputs).flat_map(|row| [row, &[0.0]].concat()).collect();
        self.has_cosine = true;
        self
    }

    /// Zero planes: a sphere.
    pub(super) fn sphere(rays: (Vec<[f32; 3]>, Vec<[f32; 3]>)) -> Self {
        let mut made = Self::random(0, 1);
        (made.origins, made.directions) = rays;
        made.planes.fill(0.0);
        made
    }

    pub(super) fn panoramas(&self) -> Panoramas<'_> {
        let [levels, height, width, channels] = MAPS;
        Panoramas { values: &self.maps, levels, height, width, channels }
    }

    pub(super) fn field(&self) -> Planes<'_> {
        Planes { values: &self.planes, count: 6, side: SIDE, channels: CHANNELS, half_size: HALF_SIZE }
    }

    /// Calls `work` with the scene.
    pub(super) fn with<T>(&self, work: impl FnOnce(&Scene<'_>) -> T) -> T {
        let views: Vec<Vec<&[f32]>> =
            self.heads.iter().map(|head| head.iter().map(Vec::as_slice).collect()).collect();
        let f = self.settings.combine.width(CHANNELS);
        let net = |head: usize, inputs: usize| Network { weights: &views[head], inputs };
        let embedded = if self.is_embedded { MAPS[3] + usize::from(self.has_cosine) } else { 0 };
        work(&Scene {
            rays: Rays { origins: &self.origins, directions: &self.directions },
            planes: self.field(),
            panoramas: self.is_embedded.then(|| self.panoramas()),
            heads: Heads {
                sdf: net(0, f),
                color: Some(net(1, f + embedded)),
                albedo: Some(net(2, f)),
                material: Some(net(3, f)),
                normal: Some(net(4, f)),
                rho: self.is_embedded.then(|| net(5, f)),
            },
            beta: self.beta,
            settings: self.settings.clone(),
        })
    }

    /// Renders all steps.
    pub(super) fn render(&self) -> (Out, Plan) {
        self.with(|scene| {
            let mut plan = Plan::new(scene.all_intervals());
            (forward(scene, &mut plan), plan)
        })
    }

    /// Random cotangents of all outputs, and the gradients for them, `chunk` rays at a time.
    pub(super) fn gradients(&self, out: &Out, plan: &Plan, chunk: usize) -> InBar {
        let bar = values(out.values.len() + 7 * self.origins.len(), 99);
        let (values, rest) = bar.split_at(out.values.len());
        let (opacity, rest) = rest.split_at(self.origins.len());
        let (points, normals) = rest.split_at(3 * self.origins.len());
        let normals = if out.normals.is_empty() { &[] } else { normals.as_chunks::<3>().0 };
        let out_bar = OutBar { values, opacity, points: points.as_chunks::<3>().0, normals };
        self.with(|scene| {
            let mut made = InBar::zeros_like(scene);
            adjoint(scene, plan, out, &out_bar, chunk, &mut made);
            made
        })
    }

    /// The field on three planes whose features are added.
    pub(super) fn summed(mut self) -> Self {
        assert_eq!(self.settings.combine, Combine::Concat, "once");
        let f = 3 * CHANNELS;
        for head in &mut self.heads {
            // the first channels of every row
            let width = head[0].len() / f * f;
            head[0] = head[0][..width].chunks_exact(f).flat_map(|row| row[..CHANNELS].to_vec()).collect();
        }
        self.settings.combine = Combine::Sum;
        self
    }
}

/// All gradients one after the other.
pub(super) fn flat(bar: &mut InBar) -> Vec<f32> {
    let mut all = bar.planes.clone();
    all.extend(&bar.panoramas);
    bar.heads.arrays_mut().for_each(|array| all.extend(array.iter()));
    all.extend([bar.beta, bar.background]);
    all
}
