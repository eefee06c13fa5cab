//! What the reports of runs have in common: images side by side, the course, the time, the files, the settings.

use super::charts::{self, Lines, Series};
use super::film::Film;
use super::{Section, Stat, bars, bytes, code, images, seconds, settings, table, text, thousands};
use crate::Result;
use crate::fit::training::History;
use crate::meter::Meter;
use crate::units::counted;
use maud::{Markup, html};
use serde_json::Value;
use std::path::Path;

/// Points of a curve of the loss.
pub(crate) const LOSS_POINTS: usize = 80;

/// A run, whatever it made.
pub(crate) struct Run<'a> {
    /// the settings that decide the result
    pub(crate) settings: &'a Value,
    /// the same without options, where there are defaults
    pub(crate) defaults: Option<Value>,
    /// loss and size per iteration, if there was a fit
    pub(crate) history: Option<&'a History>,
    /// snapshots of the fit, if there was one
    pub(crate) film: Option<&'a Film>,
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
            defaults: None,
            history,
            film: None,
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
            note: counted(crate::num::par::threads(), "thread"),
        }
    }

    /// Snapshots, loss, score and size of a fit; `sizes` is the name of what the history counts, for a chart of it; `marks` are places on
    /// the axis of iterations.
    ///
    /// # Errors
    /// When an image cannot be encoded.
    pub(crate) fn course(
        &self,
        title: &'static str,
        sizes: Option<&'static str>,
        remark: &str,
        marks: &[(f64, String)],
    ) -> Result<Option<Section>> {
        let Some(history) = self.history else { return Ok(None) };
        let strip = self.film.map_or_else(|| Ok(html! {}), strip)?;
        let (points, band) = charts::bucket(&history.loss, LOSS_POINTS);
        let counts: Vec<f32> = history.size.iter().map(|&n| n as f32).collect();
        let (size, _) = charts::bucket(&counts, 560);
        let chart = |title, log_y, series| Lines {
            title,
            x_label: "iteration",
            log_y,
            from_zero: !log_y,
            series: vec![series],
            marks: marks.to_vec(),
        };
        Ok(Some(Section {
            id: "curves",
            title: "Training",
            lead: format!(
                "Every iteration uses other images, so single losses scatter. The line is the median of consecutive iterations; the band contains \
                 the middle 80 % of them.{remark} Images and scores during the training are of held-out views; they do not influence it."
            ),
            body: html! {
                (strip)
                div.two {
                    (chart(title, true, Series { name: "loss", color: 'a', points, band }).html())
                    @if let Some(film) = self.film.filter(|f| f.all.len() > 1) { (levels(film)) }
                    @if let Some(name) = sizes { (chart(name, false, Series { name, color: 'b', points: size, band: vec![] }).html()) }
                }
            },
        }))
    }

    /// What every report ends with: time, files, settings.
    pub(crate) fn tail(&self) -> Vec<Section> {
        self.tail_of(self.settings, self.defaults.as_ref())
    }

    /// [`Self::tail`] with settings and defaults under the names that the page shows.
    pub(crate) fn tail_of(&self, shown: &Value, defaults: Option<&Value>) -> Vec<Section> {
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
            lead: "Everything that decides the result: the same settings and the same input give the same digest on any machine. The row with \
                   date, machine and version at the top of this page is not part of the digest."
                .into(),
            body: settings::tables(shown, defaults),
        });
        sections
    }
}

/// The renders of one view during the training.
fn strip(film: &Film) -> Result<Markup> {
    let mut figures = Vec::new();
    for s in &film.all {
        let Some((rgb, [w, h])) = &s.image else { continue };
        let score = format!("{} {}", film.metric, decibel(s.psnr_db));
        let caption = format!("iteration {} · {}", thousands(s.iteration), decibel(s.psnr_db));
        let alt =
            format!("render of view {} after {}, {score}", film.view, counted(s.iteration, "iteration"));
        figures
            .push((images::data_uri(rgb, *w, *h, images::MAX_STRIP_SIDE)?, images::Label { alt, caption }));
    }
    Ok(if figures.len() < 2 {
        html! {}
    } else {
        images::strip(&figures)
    })
}

/// The score over the iterations.
fn levels(film: &Film) -> Markup {
    let title = match film.views {
        0 | 1 => format!("{} of view {} in dB", film.metric, film.view),
        n => format!("{} in dB, mean of {n} views", film.metric),
    };
    let finite = film.all.iter().filter(|s| s.psnr_db.is_finite());
    let points = finite.map(|s| (s.iteration as f64, s.psnr_db)).collect();
    let chart = Lines {
        title: &title,
        x_label: "iteration",
        log_y: false,
        from_zero: false,
        series: vec![Series { name: &film.metric, color: 'c', points, band: vec![] }],
        marks: vec![],
    };
    chart.html()
}

/// An input image, the render from its camera, and the error.
pub(crate) struct Compared<'a> {
    /// of the view
    pub(crate) name: &'a str,
    /// its PSNR, in dB, by which the views are ordered
    pub(crate) psnr_db: f64,
    /// scores, in a few words
    pub(crate) remark: String,
    /// (H, W, 3)
    pub(crate) photo: &'a [f32],
    /// (H, W, 3)
    pub(crate) image: &'a [f32],
    /// (H, W)
    pub(crate) error: &'a [f32],
    /// mean of the error
    pub(crate) mae: Option<f64>,
    /// W, H
    pub(crate) size: [usize; 2],
}

/// Decibels as text.
pub(crate) fn decibel(x: f64) -> String {
    if x.is_finite() { format!("{x:.2} dB") } else { "∞ dB".into() }
}

/// How views are read, for the lead of a section.
pub(crate) const HOW_TO_READ: &str = "The worst views come first. Choose input, render or error to see them at the same place (with the \
    keyboard: arrow keys); a click on an image enlarges the view.";

/// Views with their renders, the worst first, with the colour scale of the error maps; images are at most `max_side` pixels long. `what` names the
/// kind of view in alternative texts and is unique in a page.
///
/// # Errors
/// When an image cannot be encoded.
pub(crate) fn compared(mut all: Vec<Compared<'_>>, what: &str, max_side: usize) -> Result<Markup> {
    all.sort_by(|a, b| a.psnr_db.total_cmp(&b.psnr_db));
    let id = what.replace(' ', "-");
    let views = all.iter().enumerate().map(|(i, c)| view(c, what, &format!("{id}-{i}"), max_side));
    let views = views.collect::<Result<Vec<_>>>()?;
    let bar = images::scale_bar()?;
    let most = images::ERROR_MAX;
    Ok(html! {
        div.scale { span { "error 0" } img src=(bar) alt={ "colours of the error maps of the " (what) "s, from black for 0 to light yellow for " (most) " and above" }; span { (most) " and above" } }
        div.views { @for view in &views { (view) } }
    })
}

/// One view: three images, which of them are shown, and whether they fill the screen.
fn view(c: &Compared<'_>, what: &str, id: &str, max_side: usize) -> Result<Markup> {
    let [w, h] = c.size;
    let error = images::error_map(c.error);
    let mean = c.mae.map_or_else(String::new, |mae| format!(", mean {mae:.4}"));
    let figures = [
        ("photo", c.photo, format!("input image of {what} {}", c.name), "input".to_owned()),
        (
            "render",
            c.image,
            format!("render of {what} {}, PSNR {}", c.name, decibel(c.psnr_db)),
            "render".to_owned(),
        ),
        ("error", &error, format!("error map of {what} {}{mean}", c.name), format!("error{mean}")),
    ];
    let uri = |rgb: &[f32]| images::data_uri(rgb, w, h, max_side);
    let figures = figures.into_iter().map(|(class, rgb, alt, caption)| Ok((class, uri(rgb)?, alt, caption)));
    let figures = figures.collect::<Result<Vec<_>>>()?;
    let choices = [
        ("pick-all", "side by side"),
        ("pick-photo", "input"),
        ("pick-render", "render"),
        ("pick-error", "error"),
    ];
    Ok(html! {
        fieldset.view aria-label={ (what) " " (c.name) } {
            h3 { (c.name) span { (c.remark) } }
            @for (i, (class, text)) in choices.into_iter().enumerate() {
                input class=(class) type="radio" name=(id) id={ (id) "-" (class) } checked[i == 0];
                label for={ (id) "-" (class) } { (text) }
            }
            input.zoom type="checkbox" id={ (id) "-zoom" };
            label for={ (id) "-zoom" } { span.open { "enlarge" } span.shut { "close" } }
            div.frames { @for (class, uri, alt, caption) in &figures {
                figure class=(class) { label for={ (id) "-zoom" } { img src=(uri) alt=(alt); } figcaption { (caption) } }
            } }
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
    html! { div.stack {
        div.panel { (bars::parts(&all)) }
        (table(&["part", ">time", ">share"], &rows))
    } }
}

/// 12 345 iterations as a card.
pub(crate) fn iterations(history: &History, note: String) -> Stat {
    Stat { label: "Iterations", value: thousands(history.len()), note }
}
