//! The check before the first iteration: what the images and cameras of a capture look like, in a few lines and one sheet of thumbnails.

use crate::fit::survey::Survey;
use crate::meter::Meter;
use crate::num::order;
use crate::report::images::Sheet;
use crate::report::thousands;
use crate::scene::views::{View, Views};
use crate::{Error, Result};
use std::path::Path;

/// Name of the sheet in the folder of the results.
pub(super) const SHEET: &str = "images.png";
/// Most thumbnails; of more images, evenly chosen ones.
const MOST: usize = 60;
/// Columns of the sheet.
const COLUMNS: usize = 10;
/// Longer side of a thumbnail in pixels.
const SIDE: usize = 120;
/// Pixels that a mask excludes are mixed with this colour.
const MASKED: [f32; 3] = [1.0, 0.0, 1.0];

/// Prints what the capture looks like, and warns of cameras that look outward.
pub(super) fn note(views: &Views, survey: &Survey, is_random: bool, meter: &Meter) {
    let b = &views.scene_box;
    let center = b.center.map(|x| format!("{x:.2}")).join(", ");
    meter.note(&format!(
        "cameras: {} of {} point at the centre ({center}), from distances of {:.2} to {:.2}",
        survey.inward, survey.images, survey.distances[0], survey.distances[1]
    ));
    let counts = survey.counts();
    if let (Some(least), Some(most)) = (counts.first(), counts.last()) {
        let who = survey.seen.iter().find(|s| s.1 == *least).map_or("", |s| s.0.as_str());
        meter.note(&format!(
            "points: {}; an image sees {} ({who}) to {}, median {}",
            thousands(survey.points),
            thousands(*least),
            thousands(*most),
            thousands(counts[counts.len() / 2])
        ));
    }
    if is_random {
        meter.note(&format!(
            "start: random Gaussians in a cube of side {:.2} around that centre",
            2.0 * b.half_size
        ));
    }
    if views.train.len() == 1 {
        meter.note(
            "warning: a single photo contains no depth: the fit reproduces it, and views from elsewhere are arbitrary; take 60 to \
             200 photos from all sides (`lastlight help captures`)",
        );
    }
    if survey.is_outward() {
        meter.note(
            "warning: most cameras look away from their common centre, as in a room filmed from its middle; such a fit needs \
             points of a reconstruction (a COLMAP model, or --init points.ply), or --box with what they see",
        );
    }
}

/// Writes the sheet of thumbnails: the images as they are fitted, masked pixels in magenta.
pub(super) fn write_sheet(views: &Views, dir: &Path) -> Result<()> {
    let count = views.views.len().min(MOST);
    let shown: Vec<&View> = (0..count).map(|i| &views.views[i * views.views.len() / count]).collect();
    let ratio = |v: &View| v.camera.width as f64 / v.camera.height as f64;
    let Some(widest) = shown.iter().map(|v| ratio(v)).max_by(f64::total_cmp) else {
        return Err(Error::input("capture").expected("at least one image").got("none"));
    };
    let cell = if widest > 1.0 {
        [SIDE, ((SIDE as f64 / widest) as usize).max(1)]
    } else {
        [((SIDE as f64 * widest) as usize).max(1), SIDE]
    };
    let columns = count.min(COLUMNS);
    let mut sheet = Sheet::new([columns, count.div_ceil(columns)], cell, 2);
    for (k, view) in shown.iter().enumerate() {
        sheet.put([k % columns, k / columns], &thumbnail(view, cell));
    }
    sheet.write(&dir.join(SHEET))
}

/// The image in a cell (h, w, 3), whole, white beside it: means of the pixels that fall on a pixel of the cell.
fn thumbnail(view: &View, [w, h]: [usize; 2]) -> Vec<f32> {
    let (vw, vh) = (view.camera.width, view.camera.height);
    let scale = order::min(w as f64 / vw as f64, h as f64 / vh as f64);
    let side = |length: usize, most: usize| ((length as f64 * scale) as usize).clamp(1, most);
    let (tw, th) = (side(vw, w), side(vh, h));
    let (left, top) = ((w - tw) / 2, (h - th) / 2);
    let mut out = vec![1.0; w * h * 3];
    let span = |i: usize, of: usize, length: usize| {
        let from = i * length / of;
        from..((i + 1) * length / of).max(from + 1)
    };
    for y in 0..th {
        for x in 0..tw {
            let (mut sum, mut n) = ([0.0_f32; 3], 0.0_f32);
            for v in span(y, th, vh) {
                for u in span(x, tw, vw) {
                    let p = v * vw + u;
                    let is_masked = view.mask.as_ref().is_some_and(|m| m[p] == 0);
                    for c in 0..3 {
                        let value = f32::from(view.rgb[3 * p + c]) / 255.0;
                        sum[c] += if is_masked { 0.4 * value + 0.6 * MASKED[c] } else { value };
                    }
                    n += 1.0;
                }
            }
            let at = ((top + y) * w + left + x) * 3;
            out[at..at + 3].copy_from_slice(&sum.map(|s| s / n));
        }
    }
    out
}
