//! Texture sheets of a page about a mesh: every map as an image, with the borders of charts.

use crate::report::images::{Label, data_uri, small};
use crate::scene::material::{Material, Texture};
use crate::scene::mesh::Object;
use crate::{Result, geometry::facts};
use std::sync::Arc;

/// Longest side of a sheet, in pixels.
const SIDE: usize = 512;
/// Materials whose maps are shown.
const SHOWN: usize = 8;
/// Colour of borders of charts.
const BORDER: [f32; 3] = [0.95, 0.3, 0.05];

/// How a texel is shown.
type Shown = fn([u8; 4]) -> [u8; 3];
/// A map of a material: its name, the texture, and how its texels are shown.
type Map<'a> = (&'static str, &'a Arc<Texture>, Shown);

/// The maps of a material.
fn maps(m: &Material) -> Vec<Map<'_>> {
    let all: [(&'static str, Option<&Arc<Texture>>, Shown); 5] = [
        ("base colour", m.base_color_map.as_ref(), |[r, g, b, _]| [r, g, b]),
        ("roughness", m.metallic_roughness_map.as_ref(), |[_, g, _, _]| [g; 3]),
        ("metallic", m.metallic_roughness_map.as_ref(), |[_, _, b, _]| [b; 3]),
        ("normal map", m.normal_map.as_ref().map(|(t, _)| t), |[r, g, b, _]| [r, g, b]),
        ("emission", m.emission_map.as_ref(), |[r, g, b, _]| [r, g, b]),
    ];
    all.into_iter().filter_map(|(name, map, shown)| map.map(|map| (name, map, shown))).collect()
}

/// The size of the largest map of an object, if it has maps.
pub(super) fn size(object: &Object) -> Option<[usize; 2]> {
    let all = object.materials.iter().flat_map(maps).map(|(_, t, _)| [t.width, t.height]);
    all.max_by_key(|[w, h]| w * h)
}

/// Every map of the first materials as a figure, and one of the charts if there are coordinates without maps; then the number of materials
/// with maps that are not shown.
///
/// # Errors
/// When an image cannot be encoded.
pub(super) fn figures(object: &Object) -> Result<(Vec<(String, Label)>, usize)> {
    let borders = if object.mesh.uvs.is_empty() { Vec::new() } else { facts::borders(&object.mesh) };
    let with_maps: Vec<&Material> = object.materials.iter().filter(|m| !maps(m).is_empty()).collect();
    let mut out = Vec::new();
    for (i, m) in with_maps.iter().take(SHOWN).enumerate() {
        let of = if with_maps.len() == 1 { String::new() } else { format!(" of material {i} ({})", m.name) };
        for (name, t, shown) in maps(m) {
            let rgb = t.texels.iter().flat_map(|x| shown(*x).map(|v| f32::from(v) / 255.0)).collect();
            let (mut rgb, size) = small(rgb, [t.width, t.height], SIDE);
            let alt = format!("{name}{of}, {} by {} texels, with the borders of charts", t.width, t.height);
            let caption = format!("{name}{of}, {}×{}", t.width, t.height);
            draw(&mut rgb, size, &borders);
            out.push((data_uri(&rgb, size[0], size[1], SIDE)?, Label { alt, caption }));
        }
    }
    if out.is_empty() && !borders.is_empty() {
        let mut rgb = vec![0.93; SIDE * SIDE * 3];
        draw(&mut rgb, [SIDE; 2], &borders);
        let alt = "borders of charts in the square of texture coordinates, without a map".to_owned();
        out.push((
            data_uri(&rgb, SIDE, SIDE, SIDE)?,
            Label { alt, caption: "texture coordinates without a map".to_owned() },
        ));
    }
    Ok((out, with_maps.len().saturating_sub(SHOWN)))
}

/// Draws lines one pixel wide; coordinates repeat with period 1.
fn draw(rgb: &mut [f32], [w, h]: [usize; 2], lines: &[[[f32; 2]; 2]]) {
    for [a, b] in lines {
        let [a, b] = [a, b].map(|uv| [f64::from(uv[0]) * w as f64, f64::from(uv[1]) * h as f64]);
        let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        // A line across more than the image would be drawn over itself.
        let steps = (if dx.abs() > dy.abs() { dx.abs() } else { dy.abs() }).ceil() as usize;
        for i in 0..=Ord::min(steps, 4 * (w + h)) {
            let t = i as f64 / Ord::max(steps, 1) as f64;
            let x = (a[0] + t * dx).floor().rem_euclid(w as f64) as usize;
            let y = (a[1] + t * dy).floor().rem_euclid(h as f64) as usize;
            let at = (Ord::min(y, h - 1) * w + Ord::min(x, w - 1)) * 3;
            rgb[at..at + 3].copy_from_slice(&BORDER);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_drawn_where_they_are_and_repeat() {
        let mut rgb = vec![0.0; 4 * 2 * 3];
        draw(&mut rgb, [4, 2], &[[[0.0, 0.25], [0.5, 0.25]], [[1.8, -0.2], [1.8, -0.2]]]);
        let drawn: Vec<usize> = (0..8).filter(|i| rgb[3 * i] == BORDER[0]).collect();
        assert_eq!(drawn, [0, 1, 2, 7], "three pixels of the first row, and one period further on the last");
    }
}
