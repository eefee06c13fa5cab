//! The HTML report of `oracle compare`: self-contained, with error maps of arrays that are images.

use super::differences::{Agreement, ArrayReport, Report};
use crate::num::array::Arrays;
use crate::num::order;
use base64::Engine as _;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::path::Path;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:70rem;padding:0 1rem;color:#222}\
table{border-collapse:collapse;margin:.5rem 0}td,th{padding:.2rem .7rem;text-align:right;border-bottom:1px solid #ddd}\
td:first-child,th:first-child{text-align:left}.bad{color:#b00020;font-weight:600}.good{color:#1b6e20}\
img{image-rendering:pixelated;border:1px solid #ccc;margin:.3rem}figure{display:inline-block;margin:0}\
figcaption{font-size:.85em;color:#555}code{background:#f4f4f4;padding:0 .2rem}";

/// |ours − theirs| per pixel as a PNG, black 0 to white the largest, for arrays (C,H,W,3), (C,H,W) or (H,W,3).
fn error_images(a: &ArrayReport, theirs: &Arrays, ours: &Arrays) -> Vec<(String, f64)> {
    let (Some(t), Some(o)) = (theirs.get(&a.name), ours.get(&a.name)) else { return Vec::new() };
    let (views, height, width, channels) = match *a.shape_ours.as_slice() {
        [c, h, w, 3] => (c, h, w, 3),
        [h, w, 3] if h >= 8 && w >= 8 => (1, h, w, 3),
        [c, h, w] if h >= 8 && w >= 8 => (c, h, w, 1),
        _ => return Vec::new(),
    };
    if height < 8 || width < 8 || a.agreement == Agreement::ShapesDiffer || a.agreement == Agreement::Nan {
        return Vec::new();
    }
    let (t, o) = (t.to_f64(), o.to_f64());
    let pixels = height * width;
    let error = |view: usize, p: usize| {
        let at = (view * pixels + p) * channels;
        (at..at + channels).fold(0.0, |m, i| order::max(m, (o[i] - t[i]).abs()))
    };
    let mut out = Vec::new();
    for view in 0..Ord::min(views, 4) {
        let largest = (0..pixels).fold(0.0, |m, p| order::max(m, error(view, p)));
        let scale = if largest > 0.0 { 255.0 / largest } else { 0.0 };
        let gray: Vec<u8> = (0..pixels).map(|p| (error(view, p) * scale) as u8).collect();
        let Some(image) = image::GrayImage::from_raw(width as u32, height as u32, gray) else { continue };
        let mut png = std::io::Cursor::new(Vec::new());
        if image.write_to(&mut png, image::ImageFormat::Png).is_ok() {
            out.push((base64::engine::general_purpose::STANDARD.encode(png.into_inner()), largest));
        }
    }
    out
}

fn row(a: &ArrayReport) -> Markup {
    let class = if a.agreement == Agreement::Agrees { "good" } else { "bad" };
    html! {
        tr {
            td { code { (a.name) } }
            td class=(class) { (a.agreement.text()) }
            td { (format!("{:?}", a.shape_ours)) @if a.shape_ours != a.shape_theirs { " against " (format!("{:?}", a.shape_theirs)) } }
            td { (format!("{:.3e}", a.relative_l2)) }
            td { (a.worst_ulp) }
            td { (format!("{:.2}", a.mean_ulp)) }
            td { (format!("{:.3e}", 1.0 - a.cosine)) }
            td { (format!("{:.2e}", a.signed_bias)) }
            td { (a.zeros.both) " / " (a.zeros.only_theirs) " / " (a.zeros.only_ours) }
            td { (a.note.as_deref().unwrap_or("")) }
        }
    }
}

/// The report as one page without external references.
pub(super) fn page(
    report: &Report,
    their_file: &Path,
    our_file: &Path,
    theirs: &Arrays,
    ours: &Arrays,
) -> String {
    let name = report.operator.unwrap_or("arrays");
    let markup = html! {
        (DOCTYPE)
        html lang="en" {
            head { meta charset="utf-8"; title { "lastlight oracle compare: " (name) } style { (PreEscaped(STYLE)) } }
            body {
                h1 { (name) }
                p { "theirs " code { (their_file.display()) } ", ours " code { (our_file.display()) }
                    ", relative L2 at most " (format!("{:e}", report.tol)) ": "
                    @if report.passed { span.good { "agrees" } } @else { span.bad { "differs" } } }
                @if let Some(divergence) = &report.divergence { p.bad { (divergence) } }
                table {
                    tr { th { "array" } th { } th { "shape" } th { "relative L2" } th { "worst ulp" } th { "mean ulp" }
                         th { "1 − cosine" } th { "signed bias" } th { "zeros: both / theirs / ours" } th { } }
                    @for a in &report.arrays { (row(a)) }
                }
                @for (whose, names) in [("theirs", &report.only_theirs), ("ours", &report.only_ours)] {
                    @if !names.is_empty() { p { "only in " (whose) ": " (names.join(", ")) } }
                }
                @for a in report.arrays.iter().filter(|a| !a.worst.is_empty()) {
                    h2 { code { (a.name) } ": entries that differ most" }
                    table {
                        tr { th { "index" } th { "theirs" } th { "ours" } th { "difference" } th { "ulp" } }
                        @for w in &a.worst {
                            tr { td { (format!("{:?}", w.index)) } td { (format!("{:e}", w.theirs)) }
                                 td { (format!("{:e}", w.ours)) } td { (format!("{:.3e}", w.ours - w.theirs)) } td { (w.ulp) } }
                        }
                    }
                    @for (view, (png, largest)) in error_images(a, theirs, ours).into_iter().enumerate() {
                        figure {
                            img src=(format!("data:image/png;base64,{png}")) width="360" alt=(format!("error of view {view}"));
                            figcaption { "|ours − theirs|, view " (view) ", white = " (format!("{largest:.3e}")) }
                        }
                    }
                }
            }
        }
    };
    markup.into_string()
}
