//! Self-contained HTML reports: one file, no network, light and dark by the reader's preference.
//!
//! ```text
//! mod       the page: header, stat cards, sections, tables       charts    line and bar charts as inline SVG
//! fit       the report of one fit                                images  pixels to PNG data URIs, error maps
//! person    the report of a fitted person                        run       what those two share
//! style     the style sheet
//! ```
//!
//! A report is made of plain values; nothing here computes a result.

pub(crate) mod charts;
pub(crate) mod fit;
pub(crate) mod person;
pub(crate) mod pictures;
pub(crate) mod run;
mod style;

pub(crate) use crate::units::{bytes, seconds};
use crate::{Error, Result};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::path::Path;

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
    /// on what, e.g. the capture's name
    pub(crate) title: String,
    /// the command line that makes this page again
    pub(crate) command: String,
    /// short facts under the title: digest, seed, version
    pub(crate) facts: Vec<(&'static str, String)>,
    /// cards
    pub(crate) stats: Vec<Stat>,
    /// parts in order
    pub(crate) sections: Vec<Section>,
}

impl Page {
    /// The page as HTML text.
    pub(crate) fn html(&self) -> String {
        html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    title { (self.kind) " · " (self.title) }
                    style { (PreEscaped(style::CSS)) }
                }
                body {
                    header {
                        div.wrap {
                            p.kind { span.mark { "lastlight" } (self.kind) }
                            h1 { (self.title) }
                            dl.facts {
                                @for (name, value) in &self.facts { div { dt { (name) } dd { code { (value) } } } }
                            }
                            pre.command { code { (self.command) } }
                        }
                    }
                    nav { div.wrap { @for s in &self.sections { a href={ "#" (s.id) } { (s.title) } } } }
                    main.wrap {
                        div.stats {
                            @for s in &self.stats {
                                div.stat { p.label { (s.label) } p.value { (s.value) } p.note { (s.note) } }
                            }
                        }
                        @for s in &self.sections {
                            section id=(s.id) {
                                h2 { (s.title) }
                                @if !s.lead.is_empty() { p.lead { (s.lead) } }
                                (s.body)
                            }
                        }
                    }
                    footer { div.wrap { "Made by lastlight " (env!("CARGO_PKG_VERSION")) ". This file needs no network and no other file." } }
                }
            }
        }
        .into_string()
    }

    /// Writes `DIR/report/index.html`, whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(crate) fn write(&self, dir: &Path) -> Result<std::path::PathBuf> {
        let folder = dir.join("report");
        std::fs::create_dir_all(&folder).map_err(|e| Error::os(&folder, &e))?;
        let path = folder.join("index.html");
        crate::io::atomic::write_bytes(&path, self.html().as_bytes())?;
        Ok(path)
    }
}

/// A table; columns whose header starts with `>` are numbers and stand right.
pub(crate) fn table(head: &[&str], rows: &[Vec<Markup>]) -> Markup {
    let number: Vec<bool> = head.iter().map(|h| h.starts_with('>')).collect();
    html! {
        div.scroll { table {
            thead { tr { @for h in head { th.num[h.starts_with('>')] scope="col" { (h.trim_start_matches('>')) } } } }
            tbody { @for row in rows { tr {
                @for (i, cell) in row.iter().enumerate() { td.num[number.get(i).copied().unwrap_or(false)] { (cell) } }
            } } }
        } }
    }
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
            command: "lastlight splat fit '<fox>'".into(),
            facts: vec![("seed", "0".into())],
            stats: vec![],
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
        for word in ["http://", "https://", "<script", "@import", "url("] {
            assert!(!html.contains(word), "a self-contained page has no '{word}'");
        }
    }
}
