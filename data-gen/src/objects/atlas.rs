//! Packing of charts into one texture.

use super::soup::Shell;
use crate::space::{larger, smaller};

/// Free texels around a chart.
const MARGIN: f64 = 2.0;

/// Positions and sizes of the charts.
pub(crate) struct Atlas {
    /// Texture coordinates, (0, 0) at the top left, shape (V).
    pub(crate) uvs: Vec<[f64; 2]>,
    /// Width in texels.
    pub(crate) width: usize,
    /// Height in texels.
    pub(crate) height: usize,
    /// Length of one texel on the object.
    pub(crate) texel: f64,
}

/// Packs charts in rows, the highest first, at the largest common scale that fits a texture of about `size`²
/// texels: of several widths, 0.75 to 2 times `size`, the one with the largest scale (found to 1/4000).
pub(crate) fn pack(shell: &Shell, size: usize) -> Atlas {
    let mut boxes = vec![[f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY]; shell.charts];
    for (st, &c) in shell.st.iter().zip(&shell.chart) {
        let b = &mut boxes[c as usize];
        *b = [smaller(b[0], st[0]), smaller(b[1], st[1]), larger(b[2], st[0]), larger(b[3], st[1])];
    }
    let extent: Vec<[f64; 2]> = boxes.iter().map(|b| [b[2] - b[0], b[3] - b[1]]).collect();
    let mut order: Vec<usize> = (0..shell.charts).filter(|&c| extent[c][0] >= 0.0).collect();
    order.sort_by(|&a, &b| extent[b][1].total_cmp(&extent[a][1]).then(a.cmp(&b)));
    let area = order.iter().fold(0.0, |s, &c| s + extent[c][0] * extent[c][1]);
    let most = (size * size) as f64;
    // Corners and the required height.
    let place = |scale: f64, width: f64| -> Option<(Vec<[f64; 2]>, f64)> {
        let mut corner = vec![[0.0; 2]; shell.charts];
        let (mut x, mut y, mut row) = (0.0, 0.0, 0.0);
        for &c in &order {
            let [w, h] = extent[c].map(|e| (e * scale).ceil() + 2.0 * MARGIN + 1.0);
            if x + w > width {
                (x, y, row) = (0.0, y + row, 0.0);
            }
            if x + w > width {
                return None;
            }
            corner[c] = [x + MARGIN + 0.5, y + MARGIN + 0.5];
            x += w;
            row = larger(row, h);
        }
        Some((corner, y + row))
    };
    let mut best = (0.0, size);
    for eighths in [6, 8, 10, 12, 14, 16] {
        let width = size * eighths / 8;
        let fits =
            |scale: f64| place(scale, width as f64).is_some_and(|(_, height)| height * width as f64 <= most);
        let (mut low, mut high) = (0.0, (most / larger(area, 1e-12)).sqrt());
        for _ in 0..12 {
            let middle = 0.5 * (low + high);
            if fits(middle) { low = middle } else { high = middle }
        }
        if low > best.0 {
            best = (low, width);
        }
    }
    let (scale, width) = best;
    // At scale 0, every chart has a few texels.
    let (corner, height) =
        place(scale, width as f64).expect("a texture is wider than the margins of one chart");
    let height = larger(height, 1.0);
    let uvs = shell
        .st
        .iter()
        .zip(&shell.chart)
        .map(|(st, &c)| {
            let (b, at) = (boxes[c as usize], corner[c as usize]);
            [(at[0] + (st[0] - b[0]) * scale) / width as f64, (at[1] + (b[3] - st[1]) * scale) / height]
        })
        .collect();
    Atlas { uvs, width, height: height as usize, texel: 1.0 / larger(scale, 1e-9) }
}
