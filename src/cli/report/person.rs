//! The report of a fitted person: held-out images, every metric by camera, curves, density events, guidance by the model, time, files.

use super::run::{self, Compared, HOW_TO_READ, Run};
use super::{Page, Section, Stat, bars, hints, metric, table, text, thousands};
use crate::Result;
use crate::loss::metric::person::Scores;
use crate::units::counted;
use lastlight_last::avatar::density::Event;
use lastlight_last::avatar::evaluate::Scored;
use lastlight_last::avatar::fit::Tally;
use maud::{Markup, html};

/// Most views shown as images.
const MAX_IMAGES: usize = 12;
/// Longest side of an image in the report, in pixels.
const MAX_SIDE: usize = 512;

/// What the report is made of.
pub(crate) struct Input<'a> {
    /// the command, e.g. `last fit`
    pub(crate) kind: &'a str,
    /// the result and its input
    pub(crate) title: String,
    /// the command line
    pub(crate) command: String,
    /// digest of the final parameters
    pub(crate) digest: String,
    /// what density control did
    pub(crate) events: &'a [Event],
    /// renders, encodings, bound steps
    pub(crate) tally: Option<Tally>,
    /// number of Gaussians
    pub(crate) n_gauss: usize,
    /// groups of images, by name: images and means per camera and over all
    pub(crate) groups: &'a [Group],
    /// settings, course, time, files
    pub(crate) run: Run<'a>,
}

/// Images that are scored together.
pub(crate) struct Group {
    /// e.g. `other cameras`
    pub(crate) name: &'static str,
    /// each
    pub(crate) scored: Vec<Scored>,
    /// means per camera
    pub(crate) cameras: Vec<(usize, Scores)>,
    /// means over all
    pub(crate) mean: Scores,
}

fn level(scores: &Scores) -> f64 {
    scores.boxed.db.finite().unwrap_or(f64::INFINITY)
}

/// The page.
///
/// # Errors
/// When an image cannot be encoded.
pub(crate) fn page(x: &Input<'_>) -> Result<Page> {
    let mut stats: Vec<Stat> = (x.groups.iter())
        .map(|g| Stat {
            label: if g.name == TRAINED { "PSNR-box, training camera" } else { "PSNR-box, held out" },
            value: format!("{:.2} dB", level(&g.mean)),
            note: format!(
                "{}, {}, SSIM-g-box {:.4}",
                g.name,
                counted(g.scored.len(), "image"),
                g.mean.ssim_g_box
            ),
        })
        .collect();
    stats.push(Stat { label: "Gaussians", value: thousands(x.n_gauss), note: String::new() });
    if let (Some(h), Some(t)) = (x.run.history, x.tally) {
        stats.push(run::iterations(h, format!("{} renders", thousands(t.renders as usize))));
    }
    stats.push(x.run.card());
    let mut sections = vec![
        Section {
            id: "views",
            title: "Views",
            lead: format!(
                "Input images, the person rendered from the same cameras, and the mean absolute error over the channels. {HOW_TO_READ}"
            ),
            body: views(x.groups)?,
        },
        Section {
            id: "scores",
            title: "Scores",
            lead: "Means over images. PSNR-box counts the pixels in the projected box of the body; the other -box metrics are computed on the \
                   rectangle around it. Renders are clamped to 0…1 and not quantised."
                .into(),
            body: scores(x.groups),
        },
    ];
    let held_out = x.groups.iter().filter(|g| g.name != TRAINED).flat_map(|g| &g.scored);
    let views = held_out.map(|s| hints::View {
        name: &s.name,
        psnr_db: level(&s.scores),
        // Light is a part of the fit: other cameras see other sides of it.
        photo: &[],
        image: &[],
        distance: None,
    });
    sections.extend(hints::section(&views.collect::<Vec<_>>(), &x.run, x.n_gauss, None));
    sections.extend(x.run.course("Loss", Some("Gaussians"), "", &[])?);
    if !x.events.is_empty() {
        sections.push(Section {
            id: "density",
            title: "Density control",
            lead: "When Gaussians were added and removed. A Gaussian becomes a candidate when it exceeds the pixel or the latent threshold.".into(),
            body: events(x.events),
        });
    }
    if let Some(t) = x.tally.filter(|t| t.encodings > 0) {
        sections.push(Section {
            id: "guide",
            title: "Guidance by the model",
            lead: "Number of encoder passes, share of the update steps of child factors that λ limited, and the share of the image that has no \
                   influence on the factors."
                .into(),
            body: guide(&t),
        });
    }
    sections.extend(x.run.tail());
    Ok(Page {
        kind: x.kind.to_owned(),
        title: x.title.clone(),
        notice: "",
        command: x.command.clone(),
        facts: vec![("digest", x.digest.clone())],
        stats,
        sections,
    })
}

/// Name of the group of images the fit has seen.
pub(crate) const TRAINED: &str = "training camera";

/// Held-out views first: they are what the scores are about.
fn views(groups: &[Group]) -> Result<Markup> {
    let each = Ord::max(1, MAX_IMAGES / Ord::max(1, groups.len()));
    let mut parts = Vec::new();
    for group in groups.iter().rev() {
        let what = if group.name == TRAINED { "training view" } else { "held-out view" };
        let mut worst: Vec<&Scored> = group.scored.iter().collect();
        worst.sort_by(|a, b| level(&a.scores).total_cmp(&level(&b.scores)));
        worst.truncate(each);
        let shown = worst.into_iter().map(|s| Compared {
            name: &s.name,
            psnr_db: level(&s.scores),
            remark: format!("PSNR-box {}", run::decibel(level(&s.scores))),
            photo: &s.photo,
            image: &s.image,
            error: &s.error,
            mae: None,
            size: s.size,
        });
        let shown: Vec<Compared<'_>> = shown.collect();
        let title = format!("{}: {} of {}", group.name, shown.len(), counted(group.scored.len(), "image"));
        parts.push((title, run::compared(shown, what, MAX_SIDE)?));
    }
    Ok(html! { @for (title, part) in &parts { h3.group { (title) } (part) } })
}

/// Every metric that some group has, in the order of the first that has it, with the means of all groups.
pub(crate) fn by_metric(groups: &[Group]) -> Vec<(&'static str, Vec<Option<f64>>)> {
    let means: Vec<Vec<(&'static str, f64)>> = groups.iter().map(|g| g.mean.named()).collect();
    let mut names: Vec<&'static str> = Vec::new();
    for (name, _) in means.iter().flatten() {
        if !names.contains(name) {
            names.push(name);
        }
    }
    let of = |mean: &Vec<(&'static str, f64)>, name: &str| mean.iter().find(|m| m.0 == name).map(|m| m.1);
    names.into_iter().map(|name| (name, means.iter().map(|m| of(m, name)).collect())).collect()
}

fn scores(groups: &[Group]) -> Markup {
    let head: Vec<String> = std::iter::once("metric".to_owned())
        .chain(groups.iter().map(|g| format!(">{}, {}", g.name, counted(g.scored.len(), "image"))))
        .collect();
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    let cell = |x: Option<f64>| text(x.map_or_else(|| "–".to_owned(), |x| format!("{x:.4}")));
    let row = |(name, values): (&'static str, Vec<Option<f64>>)| {
        std::iter::once(metric(name)).chain(values.into_iter().map(cell)).collect()
    };
    let rows: Vec<Vec<Markup>> = by_metric(groups).into_iter().map(row).collect();
    let levels: Vec<(String, f64)> = (groups.iter().filter(|g| g.cameras.len() > 1))
        .flat_map(|g| g.cameras.iter().map(|(c, s)| (format!("camera {c}"), level(s))))
        .filter(|(_, x)| x.is_finite())
        .collect();
    html! { div.stack {
        (table(&head, &rows))
        (bars::bars("PSNR-box in dB by camera (bars start at 10)", &levels, 'a', 2, 10.0, None))
    } }
}

fn events(events: &[Event]) -> Markup {
    let rows: Vec<Vec<Markup>> = events
        .iter()
        .map(|e| {
            let counts = [
                e.iteration,
                e.pixel_candidates,
                e.latent_candidates,
                e.cloned,
                e.split,
                e.faint,
                e.strayed,
                e.turned_away,
                e.size,
            ];
            counts.iter().map(|&n| text(thousands(n))).collect()
        })
        .collect();
    table(
        &[
            "iteration",
            ">pixel candidates",
            ">latent candidates",
            ">cloned",
            ">split",
            ">pruned: low opacity",
            ">pruned: far from body",
            ">rejected: over budget",
            ">Gaussians after",
        ],
        &rows,
    )
}

fn guide(t: &Tally) -> Markup {
    let share = |a: f64, b: f64| if b > 0.0 { format!("{:.1} %", 100.0 * a / b) } else { "–".to_owned() };
    let rows = vec![
        vec![text("renders"), text(thousands(t.renders as usize))],
        vec![text("encoder passes"), text(thousands(t.encodings as usize))],
        vec![text("steps of child factors limited by λ"), text(share(t.bound as f64, t.capped as f64))],
        vec![
            text("share of the image without influence on the factors (|g| < 1e-8)"),
            text(share(t.blind, t.gradients as f64)),
        ],
    ];
    table(&["quantity", ">value"], &rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loss::In;
    use crate::loss::lpips::{Metric, Weights};
    use crate::loss::metric::person;
    use lastlight_last::avatar::evaluate::means;

    #[test]
    fn metrics_that_one_group_lacks_have_no_number_there() {
        let (x, y): (Vec<f32>, Vec<f32>) =
            (0..24 * 24 * 3).map(|i| ((i % 7) as f32 / 7.0, (i % 5) as f32 / 5.0)).unzip();
        let images = In { x: &x, y: &y, mask: None, height: 24, width: 24 };
        let metric = Metric { weights: Weights::by_formula(), rescale: true };
        let group = |name, columns: usize| {
            let mask: Vec<f32> = (0..24 * 24).map(|i| f32::from(u8::from(i % 24 < columns))).collect();
            let scores = person::forward(&images, &mask, Some(&metric)).expect("scores");
            let of = Scored {
                name: String::new(),
                camera: 0,
                time: 0,
                scores,
                photo: y.clone(),
                image: x.clone(),
                error: vec![0.0; 24 * 24],
                size: [24; 2],
            };
            let (cameras, mean) = means(std::slice::from_ref(&of)).expect("an image");
            Group { name, scored: vec![of], cameras, mean }
        };
        for columns in [[24, 10], [10, 24]] {
            let groups = [group("training", columns[0]), group("held out", columns[1])];
            let table = by_metric(&groups);
            assert_eq!(table.len(), 14, "each metric once");
            let (name, values) = &table[13];
            assert_eq!(*name, "LPIPS-vgg-box", "the one that needs 16 pixels");
            assert_eq!([values[0].is_some(), values[1].is_some()], columns.map(|c| c >= 16), "{columns:?}");
            assert!(table[..13].iter().all(|(_, v)| v.iter().all(Option::is_some)), "all others");
        }
    }
}
