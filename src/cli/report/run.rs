//! What the reports of runs have in common: images side by side, the course, the time, the files, the settings.

use super::charts::{self, Lines, Series};
use super::{Section, Stat, bytes, code, pictures, seconds, table, text, thousands};
use crate::Result;
use crate::fit::training::History;
use crate::meter::Meter;
use maud::{Markup, html};
use serde_json::Value;
use std::path::Path;

/// A run, whatever it made.
pub(crate) struct Run<'a> {
    /// the settings that decide the result
    pub(crate) settings: &'a Value,
    /// loss and size per iteration, if there was a fit
    pub(crate) history: Option<&'a History>,
    /// parts and seconds
    pub(crate) time: Vec<(String, f64)>,
    /// seconds in all
    pub(crate) total_seconds: f64,
    /// name and size of the files written
    pub(crate) files: Vec<(String, u64)>,
}

impl<'a> Run<'a> {
    /// The run so far: its clock, and those of its files in `dir` that are there.
    pub(crate) fn new<N: AsRef<str>>(
        settings: &'a Value,
        history: Option<&'a History>,
        meter: &Meter,
        dir: &Path,
        names: &[N],
    ) -> Self {
        let size = |n: &N| {
            let name = n.as_ref();
            std::fs::metadata(dir.join(name)).ok().map(|m| (name.to_owned(), m.len()))
        };
        Self {
            settings,
            history,
            time: meter.parts(),
            total_seconds: meter.seconds(),
            files: names.iter().filter_map(size).collect(),
        }
    }

    /// The card of the time it took.
    pub(crate) fn card(&self) -> Stat {
        Stat {
            label: "Time",
            value: seconds(self.total_seconds),
            note: format!("{} threads", crate::num::par::threads()),
        }
    }

    /// Loss and size of a fit; `marks` are places on the axis of iterations.
    pub(crate) fn course(
        &self,
        title: &'static str,
        remark: &str,
        marks: &[(f64, String)],
    ) -> Option<Section> {
        let history = self.history?;
        let (points, band) = charts::bucket(&history.loss, 280);
        let sizes: Vec<f32> = history.size.iter().map(|&n| n as f32).collect();
        let (size, _) = charts::bucket(&sizes, 560);
        let chart = |title, log_y, series| Lines {
            title,
            x_label: "iteration",
            log_y,
            from_zero: !log_y,
            series: vec![series],
            marks: marks.to_vec(),
        };
        Some(Section {
            id: "curves",
            title: "Course of the fit",
            lead: format!(
                "The line is the mean of consecutive iterations, the band their range: every iteration sees another picture.{remark}"
            ),
            body: html! {
                div.two {
                    (chart(title, true, Series { name: "loss", color: 'a', points, band }).html())
                    (chart("Gaussians", false, Series { name: "Gaussians", color: 'b', points: size, band: vec![] }).html())
                }
            },
        })
    }

    /// What every report ends with: time, files, settings.
    pub(crate) fn tail(&self) -> Vec<Section> {
        let mut sections = vec![Section {
            id: "time",
            title: "Where the time went",
            lead: String::new(),
            body: time(&self.time, self.total_seconds),
        }];
        if !self.files.is_empty() {
            let rows: Vec<_> = self.files.iter().map(|(n, b)| vec![code(n), text(bytes(*b))]).collect();
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
            body: settings(self.settings),
        });
        sections
    }
}

/// A photograph, what is rendered from there, and the error.
pub(crate) struct Compared<'a> {
    /// of the photograph
    pub(crate) name: &'a str,
    /// scores, in a few words
    pub(crate) remark: String,
    /// (H, W, 3)
    pub(crate) photo: &'a [f32],
    /// (H, W, 3)
    pub(crate) image: &'a [f32],
    /// (H, W)
    pub(crate) error: &'a [f32],
    /// under the error map
    pub(crate) caption: String,
    /// W, H
    pub(crate) size: [usize; 2],
}

/// Comparisons with the colour scale of their error maps; images are at most `max_side` pixels long.
///
/// # Errors
/// When an image cannot be encoded.
pub(crate) fn compared(all: &[Compared<'_>], max_side: usize) -> Result<Markup> {
    let mut shown = Vec::new();
    for c in all {
        let [w, h] = c.size;
        let uri = |rgb: &[f32]| pictures::data_uri(rgb, w, h, max_side);
        shown.push((c, uri(c.photo)?, uri(c.image)?, uri(&pictures::error_map(c.error))?));
    }
    let bar = pictures::scale_bar()?;
    Ok(html! {
        div.scale { span { "error 0" } img src=(bar) alt="colour scale of the error maps"; span { (pictures::ERROR_MAX) " and above" } }
        div.views {
            @for (c, photo, image, error) in &shown {
                div.view {
                    h3 { (c.name) span { (c.remark) } }
                    div.triple.pixelated[Ord::max(c.size[0], c.size[1]) < 256] {
                        figure { img src=(photo) alt="photograph"; figcaption { "photograph" } }
                        figure { img src=(image) alt="render"; figcaption { "render" } }
                        figure { img src=(error) alt="error map"; figcaption { (c.caption) } }
                    }
                }
            }
        }
    })
}

fn time(parts: &[(String, f64)], total: f64) -> Markup {
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

fn settings(settings: &Value) -> Markup {
    let rows: Vec<_> = settings
        .as_object()
        .into_iter()
        .flatten()
        .map(|(k, v)| vec![text(k), code(v.as_str().map_or_else(|| v.to_string(), str::to_owned))])
        .collect();
    table(&["setting", "value"], &rows)
}

/// 12 345 iterations as a card.
pub(crate) fn iterations(history: &History, note: String) -> Stat {
    Stat { label: "Iterations", value: thousands(history.len()), note }
}
