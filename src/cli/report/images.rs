//! Pixels to PNG data URIs; sheets and strips of images; the colour map of error maps.

use crate::Result;
use crate::io::image_file;
use base64::Engine;
use maud::{Markup, html};
use std::path::Path;

/// Anchors of the perceptually uniform map *inferno* (Smith and van der Walt 2015) at 0, 0.1, …, 1, sRGB-encoded.
const INFERNO: [[f32; 3]; 11] = [
    [0.001462, 0.000466, 0.013866],
    [0.087411, 0.044556, 0.224813],
    [0.258234, 0.038571, 0.406485],
    [0.416331, 0.090203, 0.432943],
    [0.578304, 0.148039, 0.404411],
    [0.735683, 0.215906, 0.330245],
    [0.865006, 0.316822, 0.226055],
    [0.954506, 0.468744, 0.099874],
    [0.987622, 0.645320, 0.039886],
    [0.964394, 0.843848, 0.273391],
    [0.988362, 0.998364, 0.644924],
];

/// Error that gets the brightest colour of an error map.
pub(crate) const ERROR_MAX: f32 = 0.25;

/// Colour of `x` in 0..1 on the perceptual map; outside the ends are used.
pub(crate) fn inferno(x: f32) -> [f32; 3] {
    let last = INFERNO.len() - 1;
    let t = crate::num::order::clamp(x, 0.0, 1.0) * last as f32;
    let i = (t as usize).min(last - 1);
    let f = t - i as f32;
    std::array::from_fn(|c| INFERNO[i][c] + (INFERNO[i + 1][c] - INFERNO[i][c]) * f)
}

/// An error per pixel (H, W) as a colour image (H, W, 3), 0 to [`ERROR_MAX`].
pub(crate) fn error_map(error: &[f32]) -> Vec<f32> {
    error.iter().flat_map(|&e| inferno(e / ERROR_MAX)).collect()
}

/// The image as a `data:` URI, box-filtered by whole factors until its longer side is at most `max_side`.
///
/// # Errors
/// When the encoder refuses the size.
pub(crate) fn data_uri(rgb: &[f32], width: usize, height: usize, max_side: usize) -> Result<String> {
    let factor = width.max(height).div_ceil(max_side).max(1);
    let (small, w, h) = if factor == 1 { (None, width, height) } else { shrink(rgb, width, height, factor) };
    let file = image_file::png_bytes(w, h, 3, &image_file::to_u8(small.as_deref().unwrap_or(rgb))?)?;
    Ok(format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(file)))
}

/// The image itself if its longer side is at most `max_side`, else box-filtered as in [`data_uri`]; with its width and height.
pub(crate) fn small(rgb: Vec<f32>, [width, height]: [usize; 2], max_side: usize) -> (Vec<f32>, [usize; 2]) {
    let factor = width.max(height).div_ceil(max_side).max(1);
    match shrink(&rgb, width, height, factor) {
        (Some(small), w, h) if factor > 1 => (small, [w, h]),
        _ => (rgb, [width, height]),
    }
}

/// Means of `factor`×`factor` blocks; an incomplete last row or column of blocks is dropped unless it is the only one.
fn shrink(rgb: &[f32], width: usize, height: usize, factor: usize) -> (Option<Vec<f32>>, usize, usize) {
    let (w, h) = ((width / factor).max(1), (height / factor).max(1));
    let mut out = vec![0.0_f32; w * h * 3];
    for y in 0..h {
        for x in 0..w {
            for c in 0..3 {
                let (mut sum, mut n) = (0.0_f32, 0.0_f32);
                for v in y * factor..((y + 1) * factor).min(height) {
                    for u in x * factor..((x + 1) * factor).min(width) {
                        sum += rgb[(v * width + u) * 3 + c];
                        n += 1.0;
                    }
                }
                out[(y * w + x) * 3 + c] = sum / n;
            }
        }
    }
    (Some(out), w, h)
}

/// Longest side of an image of a strip, in pixels.
pub(crate) const MAX_STRIP_SIDE: usize = 400;

/// What is written about an image.
pub(crate) struct Label {
    /// the alternative text: what is shown
    pub(crate) alt: String,
    /// the text below it
    pub(crate) caption: String,
}

/// Images side by side, in several rows where the screen is narrow.
pub(crate) fn strip(figures: &[(String, Label)]) -> Markup {
    html! {
        div.strip { @for (uri, label) in figures {
            figure { img src=(uri) alt=(label.alt) loading="lazy"; figcaption { (label.caption) } }
        } }
    }
}

/// Images of one size in rows and columns.
pub(crate) struct Sheet {
    /// (H, W, 3)
    rgb: Vec<f32>,
    /// W, H of the sheet
    size: [usize; 2],
    /// w, h of an image
    cell: [usize; 2],
    gap: usize,
}

impl Sheet {
    /// A sheet for `columns` × `rows` images of `cell` pixels, `gap` white pixels between them.
    pub(crate) fn new([columns, rows]: [usize; 2], cell: [usize; 2], gap: usize) -> Self {
        let side = |count: usize, length: usize| count * (length + gap) - if count > 0 { gap } else { 0 };
        let size = [side(columns, cell[0]), side(rows, cell[1])];
        Self { rgb: vec![1.0; size[0] * size[1] * 3], size, cell, gap }
    }

    /// Puts an image (h, w, 3) at a column and a row.
    pub(crate) fn put(&mut self, [column, row]: [usize; 2], image: &[f32]) {
        let [w, h] = self.cell;
        for (y, line) in image.chunks_exact(w * 3).enumerate() {
            let at = ((row * (h + self.gap) + y) * self.size[0] + column * (w + self.gap)) * 3;
            self.rgb[at..at + w * 3].copy_from_slice(line);
        }
    }

    /// The image at a column and a row.
    fn image(&self, [column, row]: [usize; 2]) -> Vec<f32> {
        let [w, h] = self.cell;
        let line = |y: usize| {
            let at = ((row * (h + self.gap) + y) * self.size[0] + column * (w + self.gap)) * 3;
            &self.rgb[at..at + w * 3]
        };
        (0..h).flat_map(line).copied().collect()
    }

    /// The image at a column and a row as a `data:` URI.
    ///
    /// # Errors
    /// When it cannot be encoded.
    pub(crate) fn uri(&self, place: [usize; 2]) -> Result<String> {
        data_uri(&self.image(place), self.cell[0], self.cell[1], MAX_STRIP_SIDE)
    }

    /// Its columns as figures that wrap on narrow screens.
    ///
    /// # Errors
    /// When one cannot be encoded.
    pub(crate) fn columns(&self, label: &dyn Fn(usize) -> Label) -> Result<Markup> {
        let [w, height] = [self.cell[0], self.size[1]];
        let column = |c: usize| -> Vec<f32> {
            let at = |y: usize| (y * self.size[0] + c * (w + self.gap)) * 3;
            (0..height).flat_map(|y| &self.rgb[at(y)..at(y) + w * 3]).copied().collect()
        };
        let count = (self.size[0] + self.gap) / (w + self.gap);
        let figure = |c: usize| Ok((data_uri(&column(c), w, height, MAX_STRIP_SIDE)?, label(c)));
        Ok(strip(&(0..count).map(figure).collect::<Result<Vec<_>>>()?))
    }

    /// Its first `count` images, row by row, as figures that wrap on narrow screens.
    ///
    /// # Errors
    /// When one cannot be encoded.
    pub(crate) fn strip(&self, count: usize, label: &dyn Fn([usize; 2]) -> Label) -> Result<Markup> {
        let columns = (self.size[0] + self.gap) / (self.cell[0] + self.gap);
        let places = (0..count).map(|i| [i % columns, i / columns]);
        let figures = places.map(|place| Ok((self.uri(place)?, label(place)))).collect::<Result<Vec<_>>>()?;
        Ok(strip(&figures))
    }

    /// As a file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(crate) fn write(&self, path: &Path) -> Result<()> {
        image_file::write_png(path, self.size[0], self.size[1], 3, &image_file::to_u8(&self.rgb)?)
    }
}

/// The colour map as an image 256×1.
///
/// # Errors
/// Never for this size; the encoder's signature requires a `Result`.
pub(crate) fn scale_bar() -> Result<String> {
    let row: Vec<f32> = (0..256).flat_map(|i| inferno(i as f32 / 255.0)).collect();
    data_uri(&row, 256, 1, 256)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_gets_lighter_all_the_way() {
        let light = |x: f32| {
            let c = inferno(x);
            0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
        };
        for i in 1..=100 {
            assert!(light(i as f32 / 100.0) > light((i - 1) as f32 / 100.0), "lightness rises at {i} %");
        }
        assert_eq!(inferno(-1.0), inferno(0.0), "below the range");
        assert_eq!(inferno(2.0), inferno(1.0), "above the range");
    }

    #[test]
    fn a_sheet_has_its_images_in_their_places() {
        let mut sheet = Sheet::new([2, 2], [2, 1], 1);
        assert_eq!((sheet.size, sheet.rgb.len()), ([5, 3], 45), "gaps between images alone");
        sheet.put([1, 1], &[0.25; 6]);
        let dark: Vec<usize> = (0..15).filter(|i| sheet.rgb[3 * i] < 1.0).collect();
        assert_eq!(dark, [13, 14], "the last two pixels of the last row");
        assert_eq!(sheet.image([1, 1]), [0.25; 6], "read back");
        let label =
            |[c, r]: [usize; 2]| Label { alt: format!("column {c}, row {r}"), caption: format!("{c}{r}") };
        let strip = sheet.strip(3, &label).expect("encodes").into_string();
        let alts = ["alt=\"column 0, row 0\"", "alt=\"column 1, row 0\"", "alt=\"column 0, row 1\""];
        assert!(alts.iter().all(|alt| strip.contains(alt)) && !strip.contains("column 1, row 1"), "{strip}");
    }

    #[test]
    fn large_images_shrink_by_whole_factors() {
        let rgb: Vec<f32> = (0..8 * 4 * 3).map(|i| if (i / 3) % 2 == 0 { 1.0 } else { 0.0 }).collect();
        let (small, w, h) = shrink(&rgb, 8, 4, 2);
        assert_eq!((w, h), (4, 2), "half the size");
        assert!(small.is_some_and(|s| s.iter().all(|&x| x == 0.5)), "means of the blocks");
        assert!(data_uri(&rgb, 8, 4, 4).is_ok_and(|u| u.starts_with("data:image/png;base64,iVBOR")), "a PNG");
    }
}
