//! The report of one fit: held-out pictures, numbers per view, curves, density events, time, files.

use super::charts::{self, Lines, Series};
use super::{Page, Section, Stat, bytes, code, pictures, seconds, table, text, thousands};
use crate::Result;
use crate::fit::evaluate::{Evaluation, Scored};
use crate::fit::splat::Event;
use crate::fit::training::History;
use maud::{Markup, html};

/// Most views shown as pictures; the table has all.
const MAX_PICTURES: usize = 16;
/// Longest side of a picture in the report, in pixels.
const MAX_SIDE: usize = 640;

/// What the report is made of.
pub(crate) struct Input<'a> {
    /// the command, e.g. `splat fit`
    pub(crate) kind: &'a str,
    /// name of the capture
    pub(crate) title: String,
    /// the command line
    pub(crate) command: String,
    /// digest of the final parameters
    pub(crate) digest: Option<String>,
    /// the settings that decide the result
    pub(crate) settings: &'a serde_json::Value,
    /// loss and size per iteration, if there was a fit
    pub(crate) history: Option<&'a History>,
    /// what density control did
    pub(crate) events: &'a [Event],
    /// number of Gaussians
    pub(crate) n_gauss: usize,
    /// pictures and scores of the held-out views
    pub(crate) scored: &'a [Scored],
    /// the numbers
    pub(crate) evaluation: &'a Evaluation,
    /// parts and seconds
    pub(crate) time: Vec<(String, f64)>,
    /// seconds in all
    pub(crate) total_seconds: f64,
    /// name and size of the files written
    pub(crate) files: Vec<(String, u64)>,
}

/// The page.
///
/// # Errors
/// When a picture cannot be encoded.
pub(crate) fn page(x: &Input<'_>) -> Result<Page> {
    let e = x.evaluation;
    let mut facts = Vec::new();
    if let Some(digest) = &x.digest {
        facts.push(("digest", digest.clone()));
    }
    if let Some(seed) = x.settings.get("seed") {
        facts.push(("seed", seed.to_string()));
    }
    if let Some(profile) = x.settings.get("profile").and_then(|p| p.as_str()) {
        facts.push(("profile", profile.to_owned()));
    }
    facts.push(("lastlight", env!("CARGO_PKG_VERSION").to_owned()));

    let mut stats = vec![
        Stat {
            label: "PSNR, held out",
            value: decibel(e.mean_psnr_db),
            note: format!("mean of {} views", e.views.len()),
        },
        Stat {
            label: "SSIM, held out",
            value: format!("{:.4}", e.mean_ssim),
            note: "11×11 window, σ 1.5".into(),
        },
        Stat { label: "Gaussians", value: thousands(x.n_gauss), note: size_note(x.history) },
    ];
    if let Some(h) = x.history {
        stats.push(Stat {
            label: "Iterations",
            value: thousands(h.len()),
            note: h.loss.last().map_or(String::new(), |l| format!("last loss {l:.4}")),
        });
    }
    stats.push(Stat {
        label: "Time",
        value: seconds(x.total_seconds),
        note: format!("{} threads", crate::num::par::threads()),
    });

    let mut sections = vec![
        Section {
            id: "views",
            title: "Held-out views",
            lead: "Photographs the fit never saw, what the scene renders from there, and the mean absolute error over \
                   the channels. Pixels outside the photograph or its mask are black in the error map and do not count."
                .into(),
            body: views(x.scored)?,
        },
        Section { id: "scores", title: "Scores", lead: format!("{}.", e.protocol), body: scores(e) },
    ];
    if let Some(history) = x.history {
        sections.push(Section {
            id: "curves",
            title: "Course of the fit",
            lead: "The line is the mean of consecutive iterations, the band their range: every iteration sees another \
                   photograph. Dotted marks are opacity resets."
                .into(),
            body: curves(history, x.events),
        });
        if !x.events.is_empty() {
            sections.push(Section {
                id: "density",
                title: "Density control",
                lead: "Where Gaussians were added and removed; the last row is the sum.".into(),
                body: events(x.events),
            });
        }
    }
    sections.push(Section {
        id: "time",
        title: "Where the time went",
        lead: String::new(),
        body: time(&x.time, x.total_seconds),
    });
    if !x.files.is_empty() {
        let rows: Vec<_> = x.files.iter().map(|(n, b)| vec![code(n), text(bytes(*b))]).collect();
        sections.push(Section {
            id: "files",
            title: "Files",
            lead: String::new(),
            body: table(&["file", ">size"], &rows),
        });
    }
    sections.push(Section {
        id: "settings",
        title: "Settings",
        lead: "Everything that decides the result: the same settings and input give the same digest on any machine.".into(),
        body: settings(x.settings),
    });
    Ok(Page {
        kind: x.kind.to_owned(),
        title: x.title.clone(),
        command: x.command.clone(),
        facts,
        stats,
        sections,
    })
}

fn decibel(x: f64) -> String {
    if x.is_finite() { format!("{x:.2} dB") } else { "∞ dB".into() }
}

fn size_note(history: Option<&History>) -> String {
    history
        .and_then(|h| h.size.first())
        .map_or(String::new(), |&n| format!("from {} at the start", thousands(n.max(0) as usize)))
}

fn views(scored: &[Scored]) -> Result<Markup> {
    let mut shown = Vec::new();
    for s in scored.iter().take(MAX_PICTURES) {
        let (w, h) = (s.score.width, s.score.height);
        shown.push((
            s,
            pictures::data_uri(&s.photo, w, h, MAX_SIDE)?,
            pictures::data_uri(&s.image, w, h, MAX_SIDE)?,
            pictures::data_uri(&pictures::error_map(&s.error), w, h, MAX_SIDE)?,
        ));
    }
    let bar = pictures::scale_bar()?;
    Ok(html! {
        div.scale { span { "error 0" } img src=(bar) alt="colour scale of the error maps"; span { (pictures::ERROR_MAX) " and above" } }
        div.views {
            @for (s, photo, image, error) in &shown {
                div.view {
                    h3 { (s.score.name) span { (decibel(s.score.psnr_db)) " · SSIM " (format!("{:.4}", s.score.ssim)) } }
                    div.triple.pixelated[s.score.width.max(s.score.height) < 256] {
                        figure { img src=(photo) alt="photograph"; figcaption { "photograph" } }
                        figure { img src=(image) alt="render"; figcaption { "render" } }
                        figure { img src=(error) alt="error map"; figcaption { "error, mean " (format!("{:.4}", s.score.mae)) } }
                    }
                }
            }
        }
        @if scored.len() > shown.len() { p.note { "Pictures of " (shown.len()) " of " (scored.len()) " views; the table below has all." } }
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
        (table(&["view", ">size", ">counted", ">PSNR", ">SSIM", ">mean abs. error"], &rows))
        div style="height:16px" {}
        div.two {
            (charts::bars(&format!("PSNR in dB (bars start at {from:.0})"), &psnr, 'a', 2, from, e.mean_psnr_db.is_finite().then_some((e.mean_psnr_db, "mean"))))
            (charts::bars("SSIM (bars start at 0)", &ssim, 'b', 4, 0.0, Some((e.mean_ssim, "mean"))))
        }
    }
}

/// The file name without its folders.
fn short_name(name: &str) -> String {
    name.rsplit('/').next().unwrap_or(name).to_owned()
}

fn curves(history: &History, events: &[Event]) -> Markup {
    let (points, band) = charts::bucket(&history.loss, 280);
    let sizes: Vec<f32> = history.size.iter().map(|&n| n as f32).collect();
    let (size, _) = charts::bucket(&sizes, 560);
    let resets: Vec<(f64, String)> = events
        .iter()
        .filter(|e| e.reset > 0)
        .map(|e| (e.iteration as f64, format!("opacity reset at iteration {}", e.iteration)))
        .collect();
    html! {
        div.two {
            (Lines { title: "Loss (0.8 L1 + 0.2 (1 − SSIM))", x_label: "iteration", log_y: true, from_zero: false,
                series: vec![Series { name: "loss", color: 'a', points, band }], marks: resets.clone() }.html())
            (Lines { title: "Gaussians", x_label: "iteration", log_y: false, from_zero: true,
                series: vec![Series { name: "Gaussians", color: 'b', points: size, band: vec![] }], marks: resets }.html())
        }
    }
}

/// Rows of the event table that are shown without being asked for.
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

pub(super) fn time(parts: &[(String, f64)], total: f64) -> Markup {
    let known = parts.iter().fold(0.0, |s, p| s + p.1);
    let mut all = parts.to_vec();
    if total - known > 0.005 * total {
        all.push(("other".into(), total - known));
    }
    let rows: Vec<_> = all
        .iter()
        .map(|(n, s)| {
            vec![
                text(n),
                text(seconds(*s)),
                text(format!("{:.1} %", if total > 0.0 { s / total * 100.0 } else { 0.0 })),
            ]
        })
        .collect();
    html! {
        div.panel { (charts::parts(&all)) }
        div style="height:16px" {}
        (table(&["part", ">time", ">share"], &rows))
    }
}

pub(super) fn settings(settings: &serde_json::Value) -> Markup {
    let rows: Vec<_> = settings
        .as_object()
        .into_iter()
        .flatten()
        .map(|(k, v)| vec![text(k), code(v.as_str().map_or_else(|| v.to_string(), str::to_owned))])
        .collect();
    table(&["setting", "value"], &rows)
}
