//! The report of one fit: held-out images, what to try, numbers per view, curves, density events, time, files.

use super::run::{self, Compared, HOW_TO_READ, Run, decibel};
use super::{Page, Section, Stat, bars, hints, table, text, thousands};
use crate::Result;
use crate::fit::evaluate::{Evaluation, Scored};
use crate::fit::splat::Event;
use crate::units::counted;
use maud::{Markup, html};

/// Most views shown as images; the table has all.
const MAX_IMAGES: usize = 16;
/// Longest side of an image in the report, in pixels.
const MAX_SIDE: usize = 640;

/// Numbers of photos of a capture; by default nothing is known of them.
#[derive(Clone, Copy, Default)]
pub(crate) struct Photos {
    /// those that were fitted, if there was a fit
    pub(crate) fitted: Option<usize>,
    /// those that were held out
    pub(crate) held_out: usize,
    /// frames that the capture lists
    pub(crate) listed: usize,
    /// listed frames without a photo, which were left out
    pub(crate) missing: usize,
}

impl Photos {
    /// The card of the numbers, if there is something to state.
    fn stat(self) -> Option<Stat> {
        let missing = if self.missing == 0 {
            String::new()
        } else {
            format!(
                "{} of {} listed frames have no photo and were left out",
                thousands(self.missing),
                thousands(self.listed)
            )
        };
        let Some(fitted) = self.fitted else {
            let value = thousands(self.missing);
            return (self.missing > 0).then_some(Stat { label: "Missing photos", value, note: missing });
        };
        let held_out = format!("{} held out", thousands(self.held_out));
        let note = if missing.is_empty() { held_out } else { format!("{held_out} · {missing}") };
        Some(Stat { label: "Training photos", value: thousands(fitted), note })
    }
}

/// What the report is made of.
pub(crate) struct Input<'a> {
    /// the command, e.g. `splat fit`
    pub(crate) kind: &'a str,
    /// the result and its input
    pub(crate) title: String,
    /// the command line
    pub(crate) command: String,
    /// digest of the final parameters
    pub(crate) digest: Option<String>,
    /// what density control did
    pub(crate) events: &'a [Event],
    /// number of Gaussians
    pub(crate) n_gauss: usize,
    /// that the largest number was reached, and how to raise it
    pub(crate) limit: Option<String>,
    /// the photos of the capture
    pub(crate) photos: Photos,
    /// images and scores of the held-out views
    pub(crate) scored: &'a [Scored],
    /// distance of each to the nearest fitted camera, see [`hints::distances`]; empty if it is not known
    pub(crate) distances: Vec<f64>,
    /// the numbers
    pub(crate) evaluation: &'a Evaluation,
    /// settings, course, time, files
    pub(crate) run: Run<'a>,
}

/// The page.
///
/// # Errors
/// When an image cannot be encoded.
pub(crate) fn page(x: &Input<'_>) -> Result<Page> {
    let e = x.evaluation;
    let mut facts = Vec::new();
    if let Some(digest) = &x.digest {
        facts.push(("digest", digest.clone()));
    }
    if let Some(seed) = x.run.settings.get("seed") {
        facts.push(("seed", seed.to_string()));
    }
    if let Some(profile) = x.run.settings.get("profile").and_then(|p| p.as_str()) {
        facts.push(("profile", profile.to_owned()));
    }
    let mut stats = quality(e);
    stats.extend(x.photos.stat());
    let mut note = size_note(&x.run);
    if let Some(limit) = &x.limit {
        note = format!("{note}{}limit: {limit}", if note.is_empty() { "" } else { " · " });
    }
    stats.push(Stat { label: "Gaussians", value: thousands(x.n_gauss), note });
    if let Some(h) = x.run.history {
        stats.push(run::iterations(h, h.loss.last().map_or(String::new(), |l| format!("last loss {l:.4}"))));
    }
    stats.push(x.run.card());

    let mut sections = vec![];
    if !e.views.is_empty() {
        sections.push(Section {
            id: "views",
            title: "Held-out views",
            lead: format!(
                "Input images that were not used in the fit, the scene rendered from the same cameras, and the mean absolute error over the channels. \
                 Pixels outside an image or its mask are black in the error map and do not count. {HOW_TO_READ}"
            ),
            body: views(x.scored)?,
        });
        let lead = format!("{}.", e.protocol);
        sections.push(Section { id: "scores", title: "Scores", lead, body: scores(e) });
    }
    let views = x.scored.iter().enumerate().map(|(i, s)| hints::View {
        name: &s.score.name,
        psnr_db: s.score.psnr_db,
        photo: &s.photo,
        image: &s.image,
        distance: x.distances.get(i).copied(),
    });
    sections.extend(hints::section(&views.collect::<Vec<_>>(), &x.run, x.n_gauss, x.photos.fitted));
    let resets: Vec<(f64, String)> = x
        .events
        .iter()
        .filter(|e| e.reset > 0)
        .map(|e| (e.iteration as f64, format!("opacity reset at iteration {}", e.iteration)))
        .collect();
    sections.extend(x.run.course(
        "Loss (0.8 L1 + 0.2 (1 − SSIM))",
        Some("Gaussians"),
        " Dotted marks are opacity resets.",
        &resets,
    )?);
    if x.run.history.is_some() && !x.events.is_empty() {
        sections.push(Section {
            id: "density",
            title: "Density control",
            lead: "When Gaussians were added and removed; the last row is the sum.".into(),
            body: events(x.events),
        });
    }
    sections.extend(x.run.tail());
    Ok(Page {
        kind: x.kind.to_owned(),
        title: x.title.clone(),
        notice: "",
        command: x.command.clone(),
        facts,
        stats,
        sections,
    })
}

/// Cards of the scores; without held-out views, one card that states it.
fn quality(e: &Evaluation) -> Vec<Stat> {
    if e.views.is_empty() {
        let note = "a single image: nothing is held out, so there is no score".into();
        return vec![Stat { label: "Held-out views", value: "none".into(), note }];
    }
    let (psnr, ssim) = (decibel(e.mean_psnr_db), format!("{:.4}", e.mean_ssim));
    vec![
        Stat {
            label: "PSNR, held out",
            value: psnr,
            note: format!("mean of {}", counted(e.views.len(), "view")),
        },
        Stat { label: "SSIM, held out", value: ssim, note: "11×11 window, σ 1.5".into() },
    ]
}

fn size_note(run: &Run<'_>) -> String {
    run.history
        .and_then(|h| h.size.first())
        .map_or(String::new(), |&n| format!("from {} at the start", thousands(n.max(0) as usize)))
}

fn views(scored: &[Scored]) -> Result<Markup> {
    let compare = |s| {
        let Scored { score, photo, image, error }: &Scored = s;
        Compared {
            name: &score.name,
            psnr_db: score.psnr_db,
            remark: format!("PSNR {} · SSIM {:.4}", decibel(score.psnr_db), score.ssim),
            photo,
            image,
            error,
            mae: Some(score.mae),
            size: [score.width, score.height],
        }
    };
    let mut worst: Vec<&Scored> = scored.iter().collect();
    worst.sort_by(|a, b| a.score.psnr_db.total_cmp(&b.score.psnr_db));
    worst.truncate(MAX_IMAGES);
    let shown = worst.len();
    let images = run::compared(worst.into_iter().map(compare).collect(), "scored view", MAX_SIDE)?;
    Ok(html! {
        (images)
        @if scored.len() > shown { p.note { "The " (shown) " worst of " (scored.len()) " views; the table of scores has all." } }
    })
}

fn scores(e: &Evaluation) -> Markup {
    let mut rows: Vec<Vec<Markup>> = e
        .views
        .iter()
        .map(|v| {
            vec![
                text(&v.name),
                text(format!("{} × {}", v.width, v.height)),
                text(format!("{:.1} %", v.kept as f64 / (v.width * v.height) as f64 * 100.0)),
                text(decibel(v.psnr_db)),
                text(format!("{:.4}", v.ssim)),
                text(format!("{:.4}", v.mae)),
            ]
        })
        .collect();
    rows.push(vec![
        html! { b { "mean" } },
        text(""),
        text(""),
        html! { b { (decibel(e.mean_psnr_db)) } },
        html! { b { (format!("{:.4}", e.mean_ssim)) } },
        html! { b { (format!("{:.4}", e.mean_mae)) } },
    ]);
    let finite = e.views.iter().filter(|v| v.psnr_db.is_finite());
    let psnr: Vec<(String, f64)> = finite.map(|v| (short_name(&v.name), v.psnr_db)).collect();
    let ssim: Vec<(String, f64)> = e.views.iter().map(|v| (short_name(&v.name), v.ssim)).collect();
    let lowest = psnr.iter().fold(f64::INFINITY, |m, p| crate::num::order::min(m, p.1));
    let from = if lowest.is_finite() {
        crate::num::order::max(libm::floor((lowest - 5.0) / 5.0) * 5.0, 0.0)
    } else {
        0.0
    };
    html! {
        div.stack {
        (table(&["view", ">size", ">counted", ">PSNR", ">SSIM", ">mean abs. error"], &rows))
        div.two {
            (bars::bars(&format!("PSNR in dB (bars start at {from:.0})"), &psnr, 'a', 2, from, e.mean_psnr_db.is_finite().then_some((e.mean_psnr_db, "mean"))))
            (bars::bars("SSIM (bars start at 0)", &ssim, 'b', 4, 0.0, Some((e.mean_ssim, "mean"))))
        } }
    }
}

/// The file name without its folders.
fn short_name(name: &str) -> String {
    name.rsplit('/').next().unwrap_or(name).to_owned()
}

/// Most rows of the event table that are shown before it is unfolded.
const MAX_EVENT_ROWS: usize = 12;

fn events(events: &[Event]) -> Markup {
    let row = |e: &Event| {
        vec![
            text(thousands(e.iteration)),
            text(thousands(e.cloned)),
            text(thousands(e.split)),
            text(thousands(e.moved)),
            text(thousands(e.added)),
            text(thousands(e.pruned)),
            text(if e.reset > 0 { thousands(e.reset) } else { String::new() }),
            text(thousands(e.size)),
        ]
    };
    let head = [
        "iteration",
        ">cloned",
        ">split",
        ">moved",
        ">added",
        ">pruned",
        ">opacities reset",
        ">Gaussians after",
    ];
    let total = |f: fn(&Event) -> usize| text(thousands(events.iter().fold(0, |s, e| s + f(e))));
    let mut rows: Vec<_> = events.iter().map(row).collect();
    let sum = vec![
        html! { b { "all" } },
        total(|e| e.cloned),
        total(|e| e.split),
        total(|e| e.moved),
        total(|e| e.added),
        total(|e| e.pruned),
        total(|e| e.reset),
        text(events.last().map_or(String::new(), |e| thousands(e.size))),
    ];
    if rows.len() <= MAX_EVENT_ROWS {
        rows.push(sum);
        return table(&head, &rows);
    }
    let n = rows.len();
    html! {
        (table(&head, &[sum]))
        details { summary { "All " (n) " events" } (table(&head, &rows)) }
    }
}
