//! A crop of 64×64 rays with 96 samples each, from where they enter the box.

use lastlight::field::fetch::{Combine, Planes};
use lastlight::field::network::Network;
use lastlight::field::render::{Heads, Intervals, Rays, Rule, Scene, Settings};
use lastlight::num::array::Arrays;
use lastlight::num::rng::Rng;

/// Rays per side of the crop.
const SIDE: usize = 64;
/// Channels of the planes.
const CHANNELS: usize = 32;
/// Networks in the order of the scene.
const NETWORKS: [&str; 5] = ["sdf", "color", "albedo", "material", "normal"];
/// Samples per ray; all of them are inside the box.
const SAMPLES: u32 = 96;
/// Steps along the diagonal of the box.
const STEPS: usize = 192;
/// Half size of the box.
const HALF_SIZE: f32 = 2.0;

/// Arrays of a scene.
pub(crate) struct Setup {
    pub(crate) name: &'static str,
    origins: Vec<[f32; 3]>,
    directions: Vec<[f32; 3]>,
    planes: Vec<f32>,
    count: usize,
    combine: Combine,
    /// Widths and weights of the networks: signed distance (or trunk), colour, albedo, material, normal.
    networks: Vec<(usize, Vec<Vec<f32>>)>,
    beta: f32,
}

fn network(widths: &[usize], purpose: u16) -> (usize, Vec<Vec<f32>>) {
    let rng = Rng::new(3);
    let layer = |l: usize| {
        let (k, n) = (widths[l], widths[l + 1]);
        let scale = (2.0 / (k + n) as f32).sqrt();
        (0..n * k).map(|i| scale * rng.normal_f32(i as u64, l as u32, purpose, 0)).collect()
    };
    (widths[0], (0..widths.len() - 1).map(layer).collect())
}

impl Setup {
    fn new(
        name: &'static str,
        count: usize,
        combine: Combine,
        networks: Vec<(usize, Vec<Vec<f32>>)>,
        beta: f32,
    ) -> Self {
        let rng = Rng::new(2);
        let n = count * SIDE * SIDE * CHANNELS;
        let tan = 0.466_307_66; // of half the field of view, 25°
        let direction = |i: usize| {
            let at = |k: usize| ((k as f32 + 0.5) / SIDE as f32 * 2.0 - 1.0) * tan;
            let d = [at(i % SIDE), at(i / SIDE), 1.0];
            let length = (d[0] * d[0] + d[1] * d[1] + 1.0).sqrt();
            d.map(|x| x / length)
        };
        Self {
            name,
            origins: vec![[0.0, 0.0, -3.0]; SIDE * SIDE],
            directions: (0..SIDE * SIDE).map(direction).collect(),
            planes: (0..n).map(|i| 0.1 * rng.normal_f32(i as u64, 0, 7, 0)).collect(),
            count,
            combine,
            networks,
            beta,
        }
    }

    /// Summed features and one trunk.
    pub(crate) fn trunk(count: usize) -> Self {
        let name = if count == 3 { "three planes, trunk" } else { "six planes, trunk" };
        Self::new(name, count, Combine::Sum, vec![network(&[32, 64, 64, 4], 8)], 0.1)
    }

    /// Six planes with the heads of LIRM.
    pub(crate) fn heads() -> Self {
        let widths: [&[usize]; 5] = [
            &[96, 32, 32, 1],
            &[96, 32, 32, 32, 3],
            &[96, 32, 32, 32, 3],
            &[96, 32, 32, 32, 2],
            &[96, 32, 32, 32, 3],
        ];
        let networks = widths.iter().zip(8..).map(|(w, i)| network(w, i)).collect();
        Self::new("six planes, heads", 6, Combine::Concat, networks, 0.1)
    }

    /// The first 96 steps of every ray.
    pub(crate) fn intervals(&self) -> Intervals {
        let scene = self.scene();
        Intervals::kept(scene.rays, HALF_SIZE, scene.step(), |_, _, steps| {
            assert!(steps.end >= SAMPLES, "all samples are inside the box");
            (0..SAMPLES).collect()
        })
    }

    /// The inputs as arrays, for PyTorch.
    pub(crate) fn arrays(&self) -> Arrays {
        let n = self.origins.len();
        let mut made = Arrays::new();
        made.put("origins", &[n, 3], self.origins.clone().into_flattened());
        made.put("directions", &[n, 3], self.directions.clone().into_flattened());
        made.put("planes", &[self.count, SIDE, SIDE, CHANNELS], self.planes.clone());
        for ((inputs, weights), net) in self.networks.iter().zip(NETWORKS) {
            let mut k = *inputs;
            for (l, w) in weights.iter().enumerate() {
                made.put(&format!("{net}_w{l}"), &[w.len() / k, k], w.clone());
                k = w.len() / k;
            }
        }
        made.put("beta", &[], vec![self.beta]);
        made.put("half_size", &[], vec![HALF_SIZE]);
        made.put("steps", &[], vec![STEPS as i32]);
        made.put("samples", &[], vec![SAMPLES as i32]);
        made.put("summed", &[], vec![u8::from(self.combine == Combine::Sum)]);
        made
    }

    /// The inputs of the renderer.
    pub(crate) fn scene(&self) -> Scene<'_> {
        let net = |i: usize| {
            self.networks.get(i).map(|(inputs, weights)| {
                let weights: Vec<&[f32]> = weights.iter().map(Vec::as_slice).collect();
                Network { weights: weights.leak(), inputs: *inputs }
            })
        };
        Scene {
            rays: Rays { origins: &self.origins, directions: &self.directions },
            planes: Planes {
                values: &self.planes,
                count: self.count,
                side: SIDE,
                channels: CHANNELS,
                half_size: HALF_SIZE,
            },
            panoramas: None,
            heads: Heads {
                sdf: net(0).expect("the first network"),
                color: net(1),
                albedo: net(2),
                material: net(3),
                normal: net(4),
                rho: None,
            },
            beta: self.beta,
            settings: Settings {
                samples: STEPS,
                rule: Rule::Midpoint,
                combine: self.combine,
                ..Settings::default()
            },
        }
    }
}
