//! Names of metrics with what they mean, for the glossary of a page and for the reader who points at one.

use maud::{Markup, html};

/// Names and meanings; a name that is the beginning of another comes after it.
const TERMS: [(&str, &str); 34] = [
    (
        "PSNR-full-ch",
        "PSNR of the complete image, computed for each colour channel and averaged, in dB. Higher is better.",
    ),
    ("PSNR-full", "PSNR over all pixels and channels of the complete image, in dB. Higher is better."),
    (
        "PSNR-box",
        "PSNR over the pixels of the projected bounding box of the body, in dB: empty background does not count. Higher is better.",
    ),
    (
        "PSNR-A",
        "PSNR of albedo as Stanford-ORB computes it, in dB: linear values, eroded mask, over the whole image. Higher is better. It is at least that of a \
         constant of 0.5: many equal values mean that the albedo is worse than this constant.",
    ),
    (
        "PSNR",
        "Peak signal-to-noise ratio, −10 log₁₀ of the mean squared error, in dB. Higher is better. 20 dB is a typical error of a tenth of \
         the range of values, 30 dB of a thirtieth; above 40 dB differences are hardly visible.",
    ),
    ("D-SSIM×1000-box", "1000 · (1 − SSIM) / 2 on the rectangle around the body. Lower is better."),
    ("D-SSIM×1000", "1000 · (1 − SSIM) / 2. Lower is better."),
    ("SSIM-g-box", "SSIM with a Gaussian window on the rectangle around the body. Higher is better."),
    ("SSIM-g", "SSIM with a Gaussian window of 11×11 pixels, σ = 1.5. Higher is better."),
    (
        "SSIM-sk-range2",
        "SSIM of scikit-image with a range of values of 2, as its versions before 0.20 compute it: larger than SSIM-sk. Higher is better.",
    ),
    ("SSIM-sk-box", "SSIM of scikit-image on the rectangle around the body. Higher is better."),
    ("SSIM-sk", "SSIM as scikit-image computes it: uniform window of 7×7 pixels. Higher is better."),
    (
        "SSIM",
        "Structural similarity: agreement of local mean, contrast and structure; 1 for equal images. Higher is better.",
    ),
    ("RFD-box", "RFD on the rectangle around the body. Lower is better."),
    (
        "RFD",
        "Distance of the responses to random filters at three scales; used where there are no LPIPS weights. It is not LPIPS. Lower is better.",
    ),
    ("LPIPS", "Learned perceptual distance between images. Lower is better."),
    (
        "mean abs. error",
        "Mean of |render − photo| over pixels and channels; values are in 0…1. Lower is better.",
    ),
    (
        "SHD",
        "Structural Hamming distance: the number of edges to add, remove or reverse to get the true graph. Lower is better.",
    ),
    (
        "SID",
        "Structural intervention distance: pairs of factors whose causal effect the graph gets wrong. Lower is better.",
    ),
    (
        "MCC",
        "Mean correlation coefficient between true and learned factors after the best matching. 1 is best.",
    ),
    (
        "position error",
        "Mean distance of decoded points from the true ones, in the frame in which the figure is 2 high. Lower is better.",
    ),
    (
        "colour error",
        "Mean absolute error of the colours of decoded points; values are in 0…1. Lower is better.",
    ),
    (
        "counterfactual error",
        "Position error of images decoded after one factor was set, compared with the true images after that intervention. Lower is better.",
    ),
    (
        "active units",
        "Number of latent dimensions that carry information: the variance of their posterior means is above 0.01.",
    ),
    (
        "targets",
        "Share of the intervention groups whose factor is found from the change of the noise alone. Higher is better.",
    ),
    (
        "disentanglement",
        "Degree to which each latent block represents a single true factor (DCI). Higher is better.",
    ),
    (
        "completeness",
        "Degree to which each true factor is represented by a single latent block (DCI). Higher is better.",
    ),
    (
        "information gap",
        "Difference in mutual information between the two blocks that are most informative about a factor, divided by the entropy of the \
         factor (MIG). Higher is better.",
    ),
    (
        "locality",
        "After an intervention, the displacement of factors that must not change, divided by that of the others. Lower is better.",
    ),
    ("relative L2", "‖yours − reference‖ / ‖reference‖ over an array."),
    ("worst ulp", "Largest difference in units in the last place of the narrower element type."),
    ("mean ulp", "Mean difference in units in the last place of the narrower element type."),
    ("signed bias", "Σ(yours − reference) / Σ|reference|: near zero if errors have no preferred sign."),
    (
        "1 − cosine",
        "1 minus the cosine of the angle between the two arrays: 0 if they differ by a positive factor only.",
    ),
];

/// The term with which a text begins.
fn term(text: &str) -> Option<&'static (&'static str, &'static str)> {
    TERMS.iter().find(|(name, _)| {
        let rest = text.strip_prefix(name);
        rest.is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric()))
    })
}

/// A text, the term at its beginning marked with its meaning.
pub(super) fn marked(text: &str) -> Markup {
    match term(text) {
        Some((name, meaning)) => html! { abbr title=(meaning) { (name) } (text[name.len()..]) },
        None => html! { (text) },
    }
}

/// The terms that are marked in the HTML text of a page, in alphabetical order.
pub(super) fn of_page(html: &str) -> Vec<(&'static str, &'static str)> {
    let mut terms: Vec<_> =
        TERMS.into_iter().filter(|(name, _)| html.contains(&format!(">{name}</abbr>"))).collect();
    terms.sort_unstable();
    terms
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_name_is_marked() {
        let name = |text| term(text).map(|t| t.0);
        assert_eq!(name("PSNR-box, held out"), Some("PSNR-box"), "not PSNR");
        assert_eq!(name("PSNR, held out"), Some("PSNR"), "before punctuation");
        assert_eq!(name("PSNRs"), None, "another word");
        assert_eq!(name("RFD (not LPIPS)"), Some("RFD"), "the rest stays");
        let page = marked("SSIM, held out").into_string();
        assert!(page.ends_with(">SSIM</abbr>, held out"), "{page}");
        assert_eq!(of_page(&page).len(), 1, "only terms that are there");
    }
}
