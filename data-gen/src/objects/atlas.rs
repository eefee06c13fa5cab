//! Charts side by side on the unit square.

use super::soup::Shell;
use crate::space::{larger, smaller};

/// Texels kept free around a chart.
const MARGIN: f64 = 2.0;

/// Where charts lie and how large they are.
pub(crate) struct Atlas {
    /// (V) texture coordinates, (0, 0) top left
    pub(crate) uvs: Vec<[f64; 2]>,
    /// Length on the object of one texel.
    pub(crate) texel: f64,
}

/// Rows of charts, the highest first, at the largest common scale that fits `size` × `size` texels (found to 1/1000).
pub(crate) fn pack(shell: &Shell, size: usize) -> Atlas {
    let mut boxes = vec![[f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY]; shell.charts];
    for (st, &c) in shell.st.iter().zip(&shell.chart) {
        let b = &mut boxes[c as usize];
        *b = [smaller(b[0], st[0]), smaller(b[1], st[1]), larger(b[2], st[0]), larger(b[3], st[1])];
    }
    let extent: Vec<[f64; 2]> = boxes.iter().map(|b| [b[2] - b[0], b[3] - b[1]]).collect();
    let mut order: Vec<usize> = (0..shell.charts).filter(|&c| extent[c][0] >= 0.0).collect();
    order.sort_by(|&a, &b| extent[b][1].total_cmp(&extent[a][1]).then(a.cmp(&b)));
    let full = size as f64;
    let place = |scale: f64| -> Option<Vec<[f64; 2]>> {
        let mut corner = vec![[0.0; 2]; shell.charts];
        let (mut x, mut y, mut row) = (0.0, 0.0, 0.0);
        for &c in &order {
            let [w, h] = extent[c].map(|e| (e * scale).ceil() + 2.0 * MARGIN + 1.0);
            if x + w > full {
                (x, y, row) = (0.0, y + row, 0.0);
            }
            if x + w > full || y + h > full {
                return None;
            }
            corner[c] = [x + MARGIN + 0.5, y + MARGIN + 0.5];
            x += w;
            row = larger(row, h);
        }
        Some(corner)
    };
    let area = extent.iter().fold(0.0, |s, e| s + larger(e[0], 0.0) * larger(e[1], 0.0));
    let mut high = full / larger(area, 1e-12).sqrt();
    let mut low = 0.0;
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        if place(middle).is_some() { low = middle } else { high = middle }
    }
    // At scale 0 every chart is a few texels; more charts than fit share the corner.
    let corner = place(low).unwrap_or_else(|| vec![[MARGIN + 0.5; 2]; shell.charts]);
    let uvs = shell
        .st
        .iter()
        .zip(&shell.chart)
        .map(|(st, &c)| {
            let (b, at) = (boxes[c as usize], corner[c as usize]);
            [(at[0] + (st[0] - b[0]) * low) / full, (at[1] + (b[3] - st[1]) * low) / full]
        })
        .collect();
    Atlas { uvs, texel: 1.0 / larger(low, 1e-9) }
}
