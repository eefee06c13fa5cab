//! What a capture lists and does not have, and what was done with the EXIF orientation of its photos.

use crate::meter::Meter;
use crate::scene::views::Views;

/// Notes on files that a capture lists and does not have, and on EXIF orientations.
pub(crate) fn note(views: &Views, meter: &Meter) {
    let some = |names: &[String]| {
        let more = if names.len() > 3 { ", …" } else { "" };
        format!("{}{more}", names.iter().take(3).map(String::as_str).collect::<Vec<_>>().join(", "))
    };
    if !views.missing.is_empty() {
        let (gone, listed) = (views.missing.len(), views.missing.len() + views.views.len());
        let names = some(&views.missing);
        meter.note(&format!(
            "{gone} of {listed} frames have no photo and are left out: {names} (--strict refuses such a capture)"
        ));
    }
    let listed = views.views.len();
    if !views.turned.is_empty() {
        meter.note(&format!(
            "EXIF orientation applied to {} of {listed} photos, to fit the size that the capture declares: {}",
            views.turned.len(),
            some(&views.turned)
        ));
    }
    if !views.not_turned.is_empty() {
        meter.note(&format!(
            "EXIF orientation of {} of {listed} photos ignored, as COLMAP does: cameras refer to the stored pixels: {}",
            views.not_turned.len(),
            some(&views.not_turned)
        ));
    }
    if !views.missing_files.is_empty() {
        meter.note(&format!("not found and not used: {}", some(&views.missing_files)));
    }
}
