//! Materials of a person and their textures.

use super::appearance::{Appearance, Pattern, Rgb};
use super::factors::{turn_hue, unit_interval};
use super::garments::{CLOTH, FACE, HAIR, SHIRT, SHOES, SKIN, SLEEVE};
use super::purpose;
use crate::surface::{Material, Picture, Transfer};
use reference::num::elem::{cos, exp, sin};
use reference::num::rng::{Key, uniform_f64};
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Heights in metres of the first and last row of the face texture.
pub(super) const FACE_TOP: f64 = 1.705;
pub(super) const FACE_BOTTOM: f64 = 1.465;
/// Heights in metres of the first and last row of the shirt texture.
pub(super) const SHIRT_TOP: f64 = 1.47;
pub(super) const SHIRT_BOTTOM: f64 = 0.87;

/// Half width of the head at the eyes, metres.
const FACE_HALF: f64 = 0.072;
/// Girth of the chest, metres.
const GIRTH: f64 = 0.95;

fn byte(x: f64) -> u8 {
    (255.0 * unit_interval(x) + 0.5) as u8
}

fn picture(width: usize, height: usize, color: impl Fn(f64, f64) -> Rgb) -> Picture {
    let mut texels = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let c = color((column as f64 + 0.5) / width as f64, (row as f64 + 0.5) / height as f64);
            texels.push([byte(c[0]), byte(c[1]), byte(c[2]), 255]);
        }
    }
    Picture { width, height, texels, transfer: Transfer::Srgb }
}

fn mix(a: Rgb, b: Rgb, share: f64) -> Rgb {
    std::array::from_fn(|c| a[c] + share * (b[c] - a[c]))
}

fn times(a: Rgb, s: f64) -> Rgb {
    a.map(|x| x * s)
}

/// 1 inside an ellipse, 0 outside, over a soft border.
fn spot(x: f64, z: f64, half: [f64; 2], soft: f64) -> f64 {
    let r = ((x / half[0]) * (x / half[0]) + (z / half[1]) * (z / half[1])).sqrt();
    unit_interval((1.0 + soft - r) / (2.0 * soft))
}

/// Cells of the grain along a side of a texture.
const CELLS: usize = 256;

/// Grain of threads and pores: a factor around 1, the same for every person. The number of a cell is drawn
/// once.
fn grain(u: f64, v: f64, strength: f64) -> f64 {
    static DRAWN: OnceLock<Vec<f64>> = OnceLock::new();
    let draw = |i: usize| {
        let item = ((i / CELLS) as u64) << 16 | (i % CELLS) as u64;
        uniform_f64(Key { seed: 0, item, step: 0, purpose: purpose::GRAIN, draw: 0 })
    };
    let drawn = DRAWN.get_or_init(|| (0..CELLS * CELLS).map(draw).collect());
    let cell = |x: f64| (x * CELLS as f64) as usize;
    1.0 + strength * (drawn[cell(v) * CELLS + cell(u)] - 0.5)
}

fn face(look: &Appearance, u: f64, v: f64) -> Rgb {
    let azimuth = TAU * (u - 0.5);
    let z = FACE_TOP + v * (FACE_BOTTOM - FACE_TOP);
    let mut c = times(look.skin, grain(u, v, 0.03));
    if cos(azimuth) <= 0.0 {
        return c;
    }
    let x = FACE_HALF * sin(azimuth);
    let side = if x < 0.0 { -x } else { x };
    let blush = [0.86 * look.skin[0] + 0.10, 0.72 * look.skin[1], 0.70 * look.skin[2]];
    c = mix(
        c,
        blush,
        0.55 * exp(-((side - 0.040) / 0.016) * ((side - 0.040) / 0.016)
            - ((z - 1.548) / 0.014) * ((z - 1.548) / 0.014)),
    );
    c = mix(c, blush, 0.35 * spot(x, z - 1.550, [0.011, 0.009], 0.8));
    // Shadows of the sockets, brows, eyes.
    c = mix(c, times(look.skin, 0.62), 0.55 * spot(side - 0.031, z - 1.589, [0.022, 0.013], 0.6));
    let arch = 1.6065 - 6.0 * (side - 0.032) * (side - 0.032);
    c = mix(c, times(look.hair, 0.85), 0.9 * spot(side - 0.032, z - arch, [0.018, 0.0036], 0.35));
    c = mix(c, [0.93, 0.92, 0.90], spot(side - 0.031, z - 1.5865, [0.0135, 0.0062], 0.15));
    c = mix(c, look.eyes, spot(side - 0.031, z - 1.5865, [0.0058, 0.0058], 0.15));
    c = mix(c, [0.03, 0.03, 0.03], spot(side - 0.031, z - 1.5865, [0.0028, 0.0028], 0.2));
    let lid = 1.5925 - 18.0 * (side - 0.031) * (side - 0.031);
    c = mix(c, times(look.hair, 0.35), 0.9 * spot(side - 0.031, z - lid, [0.0145, 0.0016], 0.4));
    // Nostrils, lips.
    c = mix(c, times(look.skin, 0.45), 0.8 * spot(side - 0.0065, z - 1.5395, [0.0042, 0.0024], 0.4));
    let lips = [0.72 * look.skin[0] + 0.10, 0.50 * look.skin[1], 0.50 * look.skin[2]];
    c = mix(c, lips, spot(x, z - 1.5135, [0.025, 0.0082], 0.2));
    mix(c, times(lips, 0.5), 0.9 * spot(x, z - (1.5135 - 2.0 * x * x), [0.023, 0.0011], 0.5))
}

fn shirt(look: &Appearance, u: f64, v: f64) -> Rgb {
    let z = SHIRT_TOP + v * (SHIRT_BOTTOM - SHIRT_TOP);
    let mut c = look.shirt_at(u, z, GIRTH);
    // Collar and hem have seams.
    if z > 1.433 || (0.887..0.890).contains(&z) {
        c = times(look.shirt, 0.82);
    }
    times(c, grain(u, v, 0.06))
}

fn sleeve(look: &Appearance, u: f64, v: f64) -> Rgb {
    // 0.6 m along, 0.36 m around; no print.
    let plain = Appearance { pattern: Pattern::Plain, ..look.clone() };
    let look = if look.pattern == Pattern::Print { &plain } else { look };
    times(look.shirt_at(u, 0.6 * v, 0.36), grain(u, v, 0.06))
}

fn weave(color: Rgb, u: f64, v: f64) -> Rgb {
    let twill = 1.0 + 0.05 * sin(TAU * 24.0 * (u + v));
    times(color, twill * grain(u, v, 0.08))
}

fn strands(color: Rgb, u: f64, v: f64) -> Rgb {
    let strand = sin(TAU * 37.0 * u + 3.0 * sin(7.0 * v)) + 0.6 * sin(TAU * 61.0 * u + 2.0 * v);
    times(color, (1.0 + 0.09 * strand) * grain(u, v, 0.12))
}

fn material(name: &str, roughness: f64, map: Picture) -> Material {
    Material {
        name: name.to_owned(),
        base_color: [1.0; 3],
        base_color_map: Some(map),
        roughness,
        metallic: 0.0,
        metallic_roughness_map: None,
    }
}

/// The materials whose colours depend on the hue, rotated by an angle in rad, with their indices in
/// [`materials`]. The few base colours are rotated, not the texels.
pub(super) fn dyed(look: &Appearance, hue: f64) -> Vec<(usize, Material)> {
    let look = &Appearance {
        shirt: turn_hue(look.shirt, hue),
        accent: turn_hue(look.accent, hue),
        cloth: turn_hue(look.cloth, hue),
        ..look.clone()
    };
    vec![
        (SHIRT, material("shirt", 0.85, picture(512, 512, |u, v| shirt(look, u, v)))),
        (SLEEVE, material("sleeve", 0.85, picture(256, 512, |u, v| sleeve(look, u, v)))),
        (CLOTH, material("cloth", 0.85, picture(256, 256, |u, v| weave(look.cloth, u, v)))),
    ]
}

/// Materials in the order of [`super::garments`], with the cloth colours rotated by a hue angle in rad.
pub(super) fn materials(look: &Appearance, hue: f64) -> Vec<Material> {
    let mut made = dyed(look, hue);
    made.extend([
        (SKIN, material("skin", 0.55, picture(64, 64, |u, v| times(look.skin, grain(u, v, 0.03))))),
        (FACE, material("face", 0.5, picture(512, 512, |u, v| face(look, u, v)))),
        (HAIR, material("hair", 0.45, picture(512, 64, |u, v| strands(look.hair, u, v)))),
        (SHOES, material("shoes", 0.35, picture(32, 32, |u, v| times(look.shoes, grain(u, v, 0.04))))),
    ]);
    made.sort_by_key(|(place, _)| *place);
    made.into_iter().map(|(_, m)| m).collect()
}
