//! Metallic-roughness materials and their textures, as glTF 2.0 defines them.
//!
//! | quantity | stored | meaning |
//! |---|---|---|
//! | base colour | factor linear; texture sRGB-encoded, its alpha linear | albedo of dielectrics, F0 of metals |
//! | roughness r | G of a linear texture times a factor | α_GGX = r² |
//! | metallic m | B of the same texture times a factor | mixes dielectric (F0 = 0.04) and metal |
//! | normal | tangent space, +y up the image | perturbs the shading normal |
//! | emission | factor linear; texture sRGB-encoded | radiance |

use super::light::MAX_RADIANCE;
use crate::{Error, Result};
use std::sync::{Arc, OnceLock};

/// Largest factor of a normal map.
pub const MAX_STRENGTH: f32 = 1e6;

/// How texels hold a quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// sRGB-encoded colour (alpha stays linear)
    Srgb,
    /// the quantity itself
    Linear,
}

/// Addressing beyond the border of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// the texture again
    Repeat,
    /// its mirror image
    Mirror,
    /// its border
    Clamp,
}

/// An image with eight bits per value, four values per texel.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Texels.
    pub width: usize,
    /// Texels.
    pub height: usize,
    /// (H, W, 4) row-major
    pub texels: Vec<[u8; 4]>,
    /// Transfer of the first three values.
    pub transfer: Transfer,
    /// Horizontally, vertically.
    pub wrap: [Wrap; 2],
}

/// Transparency of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Alpha {
    /// alpha is ignored
    Opaque,
    /// rays pass where alpha is below this
    Mask(f32),
    /// rays pass with probability 1 − alpha
    Blend,
}

/// A metallic-roughness material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// For messages.
    pub name: String,
    /// Linear RGB factor, 0..1, and alpha factor.
    pub base_color: [f32; 4],
    /// sRGB-encoded, times `base_color` once linear.
    pub base_color_map: Option<Arc<Texture>>,
    /// 0..1
    pub roughness: f32,
    /// 0..1
    pub metallic: f32,
    /// Linear: G roughness, B metallic.
    pub metallic_roughness_map: Option<Arc<Texture>>,
    /// Linear, tangent space; x and y are scaled by the factor.
    pub normal_map: Option<(Arc<Texture>, f32)>,
    /// Linear radiance, ≥ 0.
    pub emission: [f32; 3],
    /// sRGB-encoded, times `emission` once linear.
    pub emission_map: Option<Arc<Texture>>,
    /// Transparency.
    pub alpha: Alpha,
}

impl Default for Material {
    /// White, half rough, dielectric, opaque.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: [1.0; 4],
            base_color_map: None,
            roughness: 0.5,
            metallic: 0.0,
            metallic_roughness_map: None,
            normal_map: None,
            emission: [0.0; 3],
            emission_map: None,
            alpha: Alpha::Opaque,
        }
    }
}

impl Material {
    /// Checks the ranges of the factors and the sizes of the textures.
    ///
    /// # Errors
    /// Names the field.
    pub fn validate(&self) -> Result<()> {
        let at = |field: &str| Error::input(format!("material '{}'", self.name)).at(field);
        let unit = |x: &f32| (0.0..=1.0).contains(x);
        if !self.base_color.iter().all(unit) {
            return Err(at("base colour")
                .expected("factors from 0 to 1")
                .got(format!("{:?}", self.base_color)));
        }
        for (field, x) in [("roughness", self.roughness), ("metallic", self.metallic)] {
            if !unit(&x) {
                return Err(at(field).expected("a factor from 0 to 1").got(x.to_string()));
            }
        }
        if !self.emission.iter().all(|x| (0.0..=MAX_RADIANCE).contains(x)) {
            let e = at("emission").expected(format!("radiance from 0 to {MAX_RADIANCE:e}"));
            return Err(e.got(format!("{:?}", self.emission)));
        }
        if let Some((_, strength)) = &self.normal_map
            && !(strength.abs() <= MAX_STRENGTH)
        {
            let e = at("normal map").expected(format!("a factor of at most {MAX_STRENGTH:e}"));
            return Err(e.got(strength.to_string()));
        }
        if let Alpha::Mask(cut) = self.alpha
            && !cut.is_finite()
        {
            return Err(at("alpha").expected("a finite cut").got(cut.to_string()));
        }
        let maps = [&self.base_color_map, &self.metallic_roughness_map, &self.emission_map];
        for map in maps.into_iter().flatten().chain(self.normal_map.as_ref().map(|(m, _)| m)) {
            if map.width == 0 || map.height == 0 || map.texels.len() != map.width * map.height {
                return Err(at("texture").expected("width × height texels, at least one").got(format!(
                    "{}×{} with {}",
                    map.width,
                    map.height,
                    map.texels.len()
                )));
            }
        }
        Ok(())
    }
}

/// Linear values of the 256 sRGB bytes (IEC 61966-2-1), each rounded once from f64.
pub fn linear_of_srgb() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|i| {
            let x = i as f64 / 255.0;
            (if x <= 0.040_45 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) }) as f32
        })
    })
}

impl Texture {
    /// Bilinear value at a texture coordinate, linear, 0..1. Texel (i, j) has its centre at ((i+½)/W,
    /// (j+½)/H).
    ///
    /// # Rounding
    /// f32: a horizontal and then a vertical interpolation a + w·(b − a) of decoded texels.
    #[inline]
    pub fn sample(&self, uv: [f32; 2]) -> [f32; 4] {
        let (x0, x1, fx) = cell(uv[0], self.width, self.wrap[0]);
        let (y0, y1, fy) = cell(uv[1], self.height, self.wrap[1]);
        let [a, b] = [y0, y1].map(|y| {
            let (l, r) = (self.decode(y * self.width + x0), self.decode(y * self.width + x1));
            std::array::from_fn::<f32, 4, _>(|c| l[c] + fx * (r[c] - l[c]))
        });
        std::array::from_fn(|c| a[c] + fy * (b[c] - a[c]))
    }

    #[inline]
    fn decode(&self, i: usize) -> [f32; 4] {
        let t = self.texels[i];
        let linear = t.map(|b| f32::from(b) * (1.0 / 255.0));
        match self.transfer {
            Transfer::Linear => linear,
            Transfer::Srgb => {
                let table = linear_of_srgb();
                [table[usize::from(t[0])], table[usize::from(t[1])], table[usize::from(t[2])], linear[3]]
            }
        }
    }
}

/// The two texels around a coordinate and the weight of the second.
#[inline]
fn cell(u: f32, n: usize, wrap: Wrap) -> (usize, usize, f32) {
    // Far outside, f32 has no fraction left; a coordinate is finite, so it still lands on a texel.
    let u = match wrap {
        Wrap::Repeat => u - u.floor(),
        Wrap::Mirror => {
            let half = 0.5 * u;
            1.0 - (2.0 * (half - half.floor()) - 1.0).abs()
        }
        Wrap::Clamp => crate::num::order::clamp(u, 0.0, 1.0),
    };
    let x = u * n as f32 - 0.5;
    let low = x.floor();
    let last = n as i64 - 1;
    let place = |i: i64| match wrap {
        Wrap::Repeat => i.rem_euclid(n as i64) as usize,
        Wrap::Mirror | Wrap::Clamp => i.clamp(0, last) as usize,
    };
    let i = low as i64;
    (place(i), place(i + 1), x - low)
}
