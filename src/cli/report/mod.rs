//! Self-contained HTML reports: one file, no network, light and dark by the reader's preference.
//!
//! ```text
//! mod       the page: header, stat cards, sections, tables       charts    line charts; bars: bars, intervals, histograms
//! fit       the report of one fit                                images    pixels to PNG data URIs, error maps, strips
//! person    the report of a fitted person                        model     the report of an image-to-point model
//! run       what these reports share
//! settings  settings in groups, as typed                         glossary  what the names of metrics mean
//! graph     a causal graph as SVG                               hints     what to try next
//! film      snapshots of a training                             compare   the page of `oracle compare`, compare_table: its table
//! style     the style sheet                                      machine   machine, date, version: facts outside every digest
//! ```
//!
//! A report is made of plain values; nothing here computes a result. Pages have no script: views are chosen and enlarged by
//! radio buttons, check boxes and the style sheet, and the content security policy of the page forbids scripts and external sources.

pub(crate) mod bars;
pub(crate) mod charts;
pub(crate) mod compare;
mod compare_table;
pub(crate) mod film;
pub(crate) mod fit;
mod glossary;
pub(crate) mod graph;
pub(crate) mod hints;
pub(crate) mod images;
mod machine;
pub(crate) mod model;
pub(crate) mod person;
pub(crate) mod run;
mod settings;
mod style;

pub(crate) use crate::units::{bytes, seconds};
use crate::{Error, Result};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::path::Path;

/// Where the names of scores are explained, for the terminal.
pub(crate) const EXPLAINED: &str = "explained in the glossary of the report";

/// One large number at the top of the page.
#[derive(Clone)]
pub(crate) struct Stat {
    /// what it is
    pub(crate) label: &'static str,
    /// the number as text
    pub(crate) value: String,
    /// unit or remark under it
    pub(crate) note: String,
}

/// A titled part of the page.
#[derive(Clone)]
pub(crate) struct Section {
    /// anchor, also in the navigation
    pub(crate) id: &'static str,
    /// heading
    pub(crate) title: &'static str,
    /// one or two sentences on how to read it
    pub(crate) lead: String,
    /// the content
    pub(crate) body: Markup,
}

/// A whole page.
pub(crate) struct Page {
    /// what was done, e.g. `splat fit`
    pub(crate) kind: String,
    /// the result and its input, e.g. `Person from the video subject/video`
    pub(crate) title: String,
    /// a restriction that the reader must know first; empty if there is none
    pub(crate) notice: &'static str,
    /// the command line that makes this page again
    pub(crate) command: String,
    /// short facts under the title: digest, seed, version
    pub(crate) facts: Vec<(&'static str, String)>,
    /// cards
    pub(crate) stats: Vec<Stat>,
    /// parts in order
    pub(crate) sections: Vec<Section>,
}

/// Nothing is loaded from elsewhere and no script runs; images and style are in the page itself.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

impl Page {
    /// Whether it has a section of this name.
    pub(crate) fn has(&self, id: &str) -> bool {
        self.sections.iter().any(|s| s.id == id)
    }

    /// The page as HTML text.
    pub(crate) fn html(&self) -> String {
        let stats = html! {
            div.stats { @for s in &self.stats {
                div.stat { p.label { (glossary::marked(s.label)) } p.value { (s.value) } p.note { (s.note) } }
            } }
        };
        let sections = html! {
            @for s in &self.sections {
                section id=(s.id) {
                    h2 { (s.title) }
                    @if !s.lead.is_empty() { p.lead { (s.lead) } }
                    (s.body)
                }
            }
        };
        let terms = glossary::of_page(&format!("{}{}", stats.0, sections.0));
        html! {
            (DOCTYPE)
            html lang="en" {
                (self.head())
                body {
                    a.skip href="#content" { "Skip to the content" }
                    (self.header())
                    nav aria-label="Sections of this report" { div.wrap {
                        @for s in &self.sections { a href={ "#" (s.id) } { (s.title) } }
                        @if !terms.is_empty() { a href="#glossary" { "Glossary" } }
                    } }
                    main.wrap #content {
                        (stats)
                        (sections)
                        @if !terms.is_empty() {
                            section #glossary {
                                h2 { "Glossary" }
                                dl.glossary { @for (name, meaning) in &terms { dt { (name) } dd { (meaning) } } }
                            }
                        }
                    }
                    footer { div.wrap { "Made by lastlight " (env!("CARGO_PKG_VERSION")) ". This file contains no script and needs no network and no other file." } }
                }
            }
        }
        .into_string()
    }

    fn head(&self) -> Markup {
        html! {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (self.title) " · " (self.kind) }
                style { (PreEscaped(style::CSS)) }
            }
        }
    }

    fn header(&self) -> Markup {
        let facts = |facts: &[(&'static str, String)]| {
            html! { dl.facts { @for (name, value) in facts { div { dt { (name) } dd { code { (value) } } } } } }
        };
        html! {
            header {
                div.wrap {
                    p.kind { span.mark { "lastlight" } (self.kind) }
                    h1 { (self.title) }
                    @if !self.notice.is_empty() { p.notice { (self.notice) } }
                    @if !self.facts.is_empty() { (facts(&self.facts)) }
                    (facts(&machine::facts()))
                    pre.command { code { (self.command) } }
                }
            }
        }
    }

    /// Writes the page as a file atomically.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(crate) fn write_file(&self, path: &Path) -> Result<()> {
        crate::io::atomic::write_bytes(path, self.html().as_bytes())
    }

    /// Writes `DIR/report/index.html` atomically.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(crate) fn write(&self, dir: &Path) -> Result<std::path::PathBuf> {
        let folder = dir.join("report");
        std::fs::create_dir_all(&folder).map_err(|e| Error::os(&folder, &e))?;
        let path = folder.join("index.html");
        self.write_file(&path)?;
        Ok(path)
    }
}

/// Columns of a table from which on its rows are shown as cards on a narrow screen.
const WIDE: usize = 7;

/// A table; columns whose header starts with `>` are numbers and are aligned to the right. Names of metrics are marked.
pub(crate) fn table(head: &[&str], rows: &[Vec<Markup>]) -> Markup {
    let name = |i: usize| head.get(i).map_or("", |h| h.trim_start_matches('>'));
    let is_number = |i: usize| head.get(i).is_some_and(|h| h.starts_with('>'));
    html! {
        div.scroll { table.cards[head.len() >= WIDE] {
            thead { tr { @for (i, _) in head.iter().enumerate() { th.num[is_number(i)] scope="col" { (glossary::marked(name(i))) } } } }
            tbody { @for row in rows { tr {
                @for (i, cell) in row.iter().enumerate() { td.num[is_number(i)] data-label=[(head.len() >= WIDE).then(|| name(i))] { (cell) } }
            } } }
        } }
    }
}

/// The name of a metric as a table cell, marked with its meaning.
pub(crate) fn metric(name: &str) -> Markup {
    glossary::marked(name)
}

/// Text as a table cell.
pub(crate) fn text(value: impl std::fmt::Display) -> Markup {
    let value = value.to_string();
    html! { (value) }
}

/// Code as a table cell.
pub(crate) fn code(value: impl std::fmt::Display) -> Markup {
    let value = value.to_string();
    html! { code { (value) } }
}

/// 1234567 as `1 234 567` with thin spaces.
pub(crate) fn thousands(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_readable() {
        assert_eq!(thousands(0), "0", "no separator");
        assert_eq!(thousands(999), "999", "no separator");
        assert_eq!(thousands(1000), "1\u{202f}000", "one separator");
        assert_eq!(thousands(1_234_567), "1\u{202f}234\u{202f}567", "two separators");
        assert_eq!(seconds(0.85), "850 ms", "below one second");
        assert_eq!(seconds(245.2), "4 min 05 s", "minutes");
        assert_eq!(bytes(1_468_006), "1.4 MiB", "binary prefix");
    }

    #[test]
    fn a_page_is_escaped_and_needs_no_network() {
        let page = Page {
            kind: "splat fit".into(),
            title: "<fox> & co".into(),
            notice: "not evidence",
            command: "lastlight splat fit '<fox>'".into(),
            facts: vec![("seed", "0".into())],
            stats: vec![Stat { label: "PSNR, held out", value: "20 dB".into(), note: String::new() }],
            sections: vec![Section {
                id: "a",
                title: "A",
                lead: String::new(),
                body: table(&["x", ">y"], &[vec![text("<b>"), text(1)]]),
            }],
        };
        let html = page.html();
        assert!(html.contains("&lt;fox&gt; &amp; co"), "text is escaped");
        assert!(!html.contains("<b>"), "cells are escaped");
        for word in ["http://", "https://", "<script", "<link", "<iframe", "@import", "url(", "onclick"] {
            assert!(!html.contains(word), "a self-contained page has no '{word}'");
        }
        assert!(html.contains(POLICY), "the policy is in the page");
        assert!(html.contains("id=\"glossary\"") && html.contains("<dt>PSNR</dt>"), "terms are explained");
        assert!(html.contains("href=\"#content\"") && html.contains("id=\"content\""), "a skip link");
        assert!(
            ["date", "commit", "rustc", "processor", "threads"]
                .iter()
                .all(|f| html.contains(&format!("<dt>{f}</dt>"))),
            "facts of the run"
        );
    }
}
