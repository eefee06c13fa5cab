//! Painting of a mesh: every texel of its atlas gets the colour, roughness and metallic of the corresponding
//! surface point.
//!
//! Patterns are defined in space or on the charts, so a solid pattern has no seams. Texels up to [`GUTTER`]
//! beyond the border of a chart repeat the nearest painted one, because bilinear sampling reads across the
//! border.

pub(super) mod lettering;
mod look;
mod palette;
mod pattern;

use super::atlas::Atlas;
use super::soup::Shell;
use super::{Wish, purpose};
use crate::draws::Draws;
use crate::noise::Noise;
use crate::space::{clamp, mix, scaled};
use crate::surface::{Material, Picture, Transfer};
use look::PaintedMaterial;
use pattern::Spot;

/// Texels painted beyond the border of a chart.
const GUTTER: usize = 3;

/// Draws a material for group `group` of object k and paints it.
pub(super) fn paint(shell: &Shell, atlas: &Atlas, seed: u64, k: u64, group: u32, wish: Wish) -> Material {
    let mut draws = Draws::new(seed, k, group, purpose::MATERIAL);
    let mut words = Draws::new(seed, k, group, purpose::WORDS);
    let noise = Noise::new(&mut Draws::new(seed, k, group, purpose::NOISE));
    let look = look::draw(&mut draws, &mut words, wish);
    let canvas = Canvas { look, noise, texel: atlas.texel };
    let (width, height) = (atlas.width, atlas.height);
    let mut texels: Vec<Option<[u8; 5]>> = vec![None; width * height];
    for t in &shell.triangles {
        let corner = t.map(|v| v as usize);
        let place = |v: usize| [atlas.uvs[v][0] * width as f64, atlas.uvs[v][1] * height as f64];
        cover(corner.map(place), [width, height], |at, w| {
            let blend3 =
                |x: [[f64; 3]; 3]| std::array::from_fn(|i| w[0] * x[0][i] + w[1] * x[1][i] + w[2] * x[2][i]);
            let st = corner.map(|v| shell.st[v]);
            let spot = Spot {
                p: blend3(corner.map(|v| shell.positions[v])),
                st: std::array::from_fn(|i| w[0] * st[0][i] + w[1] * st[1][i] + w[2] * st[2][i]),
            };
            texels[at] = Some(canvas.texel_at(&spot));
        });
    }
    let filled = spread(texels, width);
    let picture = |texels: Vec<[u8; 4]>, transfer| Some(Picture { width, height, texels, transfer });
    Material {
        name: canvas.look.name.to_owned(),
        base_color: [1.0; 3],
        base_color_map: picture(filled.iter().map(|t| [t[0], t[1], t[2], 255]).collect(), Transfer::Srgb),
        roughness: 1.0,
        metallic: 1.0,
        metallic_roughness_map: picture(
            filled.iter().map(|t| [255, t[3], t[4], 255]).collect(),
            Transfer::Linear,
        ),
    }
}

/// Calls `f` with each texel whose centre lies in a triangle (borders included) and its barycentric weights.
fn cover([a, b, c]: [[f64; 2]; 3], size: [usize; 2], mut f: impl FnMut(usize, [f64; 3])) {
    let cross =
        |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let area = cross(a, b, c);
    if area == 0.0 {
        return;
    }
    let bound = |k: usize| {
        let low = crate::space::smaller(crate::space::smaller(a[k], b[k]), c[k]);
        let high = crate::space::larger(crate::space::larger(a[k], b[k]), c[k]);
        let first = clamp((low - 0.5).ceil(), 0.0, size[k] as f64) as usize;
        let last = clamp((high - 0.5).floor() + 1.0, 0.0, size[k] as f64) as usize;
        first..last
    };
    for y in bound(1) {
        for x in bound(0) {
            let p = [x as f64 + 0.5, y as f64 + 0.5];
            let w = [cross(b, c, p) / area, cross(c, a, p) / area, cross(a, b, p) / area];
            if w.iter().all(|&w| w >= -1e-9) {
                f(y * size[0] + x, w);
            }
        }
    }
}

/// Fills unpainted texels next to painted ones, [`GUTTER`] times; all others get the value of the first
/// painted texel.
fn spread(mut texels: Vec<Option<[u8; 5]>>, width: usize) -> Vec<[u8; 5]> {
    let count = texels.len();
    let mut open: Vec<usize> = (0..texels.len()).filter(|&i| texels[i].is_none()).collect();
    for _ in 0..GUTTER {
        let mut found: Vec<(usize, [u8; 5])> = Vec::new();
        open.retain(|&i| {
            let x = i % width;
            let near = [
                (x > 0).then(|| i - 1),
                (x + 1 < width).then(|| i + 1),
                (i >= width).then(|| i - width),
                (i + width < count).then(|| i + width),
            ];
            match near.into_iter().flatten().find_map(|j| texels[j]) {
                Some(t) => {
                    found.push((i, t));
                    false
                }
                None => true,
            }
        });
        for (i, t) in found {
            texels[i] = Some(t);
        }
    }
    let rest = texels.iter().flatten().next().copied().unwrap_or([128, 128, 128, 128, 0]);
    texels.into_iter().map(|t| t.unwrap_or(rest)).collect()
}

struct Canvas {
    look: PaintedMaterial,
    noise: Noise,
    texel: f64,
}

impl Canvas {
    /// Colour (sRGB-encoded), roughness and metallic, as bytes.
    fn texel_at(&self, spot: &Spot) -> [u8; 5] {
        let value = |coat: &look::Coat| {
            let wander = clamp(0.5 + 0.8 * self.noise.octaves(scaled(spot.p, coat.grain), 2), 0.0, 1.0);
            let color = mix(coat.colors[0], coat.colors[1], wander);
            let roughness = coat.roughness[0] + wander * (coat.roughness[1] - coat.roughness[0]);
            [color[0], color[1], color[2], roughness, coat.metallic]
        };
        let mut x = value(&self.look.base);
        for (pattern, strength, coat) in &self.look.over {
            let share = strength * pattern.at(spot, &self.noise, self.texel);
            if share > 0.0 {
                x = mix(x, value(coat), share);
            }
        }
        x.map(|x| (clamp(x, 0.0, 1.0) * 255.0 + 0.5) as u8)
    }
}
