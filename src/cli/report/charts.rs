//! Line and bar charts as inline SVG. Colours are the custom properties of the page, so that they follow its palette.

use maud::{Markup, html};
use std::fmt::Write as _;

/// Pairs of numbers along a curve.
pub(crate) type Curve = Vec<(f64, f64)>;

/// One curve.
pub(crate) struct Series<'a> {
    /// shown in the legend
    pub(crate) name: &'a str,
    /// custom property of the colour, `a` to `h`
    pub(crate) color: char,
    /// (x, y) with x ascending
    pub(crate) points: Curve,
    /// lower and upper edge at the same x, drawn as a band
    pub(crate) band: Curve,
}

/// A chart over a numeric x axis.
pub(crate) struct Lines<'a> {
    /// heading
    pub(crate) title: &'a str,
    /// label of the x axis
    pub(crate) x_label: &'a str,
    /// logarithmic y axis; all values must be positive
    pub(crate) log_y: bool,
    /// start the y axis at 0 (ignored with `log_y`)
    pub(crate) from_zero: bool,
    /// the curves
    pub(crate) series: Vec<Series<'a>>,
    /// vertical marks: x and what happened there
    pub(crate) marks: Vec<(f64, String)>,
}

const W: f64 = 560.0;
const H: f64 = 270.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 40.0;

/// Round steps that cut `lo..hi` into about `n` parts.
fn ticks(lo: f64, hi: f64, n: usize) -> Vec<f64> {
    let raw = (hi - lo) / n as f64;
    if !(raw > 0.0 && raw.is_finite()) {
        return vec![lo];
    }
    let power = libm::pow(10.0, libm::floor(libm::log10(raw)));
    let step =
        [1.0, 2.0, 2.5, 5.0, 10.0].into_iter().map(|m| m * power).find(|&s| s >= raw).unwrap_or(10.0 * power);
    let first = libm::ceil(lo / step - 1e-9) as i64;
    let last = libm::floor(hi / step + 1e-9) as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// A number of an axis: `12`, `0.25`, `20k`, `1.5M`.
pub(crate) fn short(x: f64) -> String {
    let trim = |s: String| {
        if s.contains('.') { s.trim_end_matches('0').trim_end_matches('.').to_owned() } else { s }
    };
    let a = x.abs();
    if a >= 1e6 {
        format!("{}M", trim(format!("{:.2}", x / 1e6)))
    } else if a >= 1e4 {
        format!("{}k", trim(format!("{:.1}", x / 1e3)))
    } else if a == 0.0 || a >= 1e-3 {
        trim(format!("{x:.4}"))
    } else {
        format!("{x:.0e}")
    }
}

/// Means of at most `n` buckets of consecutive points, with the smallest and largest value of each as a band.
pub(crate) fn bucket(values: &[f32], n: usize) -> (Curve, Curve) {
    let size = values.len().div_ceil(n.max(1)).max(1);
    let mut points = Vec::new();
    let mut band = Vec::new();
    for (i, part) in values.chunks(size).enumerate() {
        let (mut sum, mut lo, mut hi) = (0.0, f64::INFINITY, f64::NEG_INFINITY);
        for &v in part {
            let v = f64::from(v);
            sum += v;
            lo = crate::num::order::min(lo, v);
            hi = crate::num::order::max(hi, v);
        }
        points.push(((i * size) as f64 + part.len() as f64 * 0.5, sum / part.len() as f64));
        band.push((lo, hi));
    }
    (points, band)
}

impl Lines<'_> {
    /// The chart in a panel with a legend when there is more than one curve.
    pub(crate) fn html(&self) -> Markup {
        let all = || self.series.iter().flat_map(|s| s.points.iter());
        let (mut x0, mut x1, mut y0, mut y1) =
            (f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY);
        for &(x, y) in all() {
            x0 = crate::num::order::min(x0, x);
            x1 = crate::num::order::max(x1, x);
            y0 = crate::num::order::min(y0, y);
            y1 = crate::num::order::max(y1, y);
        }
        if !(x1 >= x0 && y1 >= y0) {
            return html! { div.panel { h3 { (self.title) } p.note { "Nothing recorded." } } };
        }
        for &(lo, hi) in self.series.iter().flat_map(|s| s.band.iter()) {
            y0 = crate::num::order::min(y0, lo);
            y1 = crate::num::order::max(y1, hi);
        }
        let log = self.log_y && y0 > 0.0;
        let fy = |y: f64| if log { libm::log10(y) } else { y };
        let (mut b0, mut b1) = (fy(y0), fy(y1));
        if !log && self.from_zero {
            b0 = 0.0;
        }
        let pad = if b1 > b0 { (b1 - b0) * 0.04 } else { crate::num::order::max(b1.abs() * 0.05, 1e-6) };
        b1 += pad;
        if log || !self.from_zero {
            b0 -= pad;
        }
        if x1 <= x0 {
            x1 = x0 + 1.0;
        }
        let px = |x: f64| LEFT + (x - x0) / (x1 - x0) * (W - LEFT - RIGHT);
        let py = |y: f64| TOP + (b1 - fy(y)) / (b1 - b0) * (H - TOP - BOTTOM);
        let y_ticks: Vec<f64> = if log {
            let (lo, hi) = (libm::floor(b0) as i32 - 1, libm::ceil(b1) as i32 + 1);
            let few = b1 - b0 > 2.5;
            (lo..=hi)
                .flat_map(|p| {
                    let power = libm::pow(10.0, f64::from(p));
                    [1.0, 2.0, 5.0].into_iter().filter(move |&m| !few || m == 1.0).map(move |m| m * power)
                })
                .filter(|&y| libm::log10(y) >= b0 && libm::log10(y) <= b1)
                .collect()
        } else {
            ticks(b0, b1, 5)
        };
        html! {
            div.panel {
                h3 { (self.title) }
                svg viewBox={ "0 0 " (W) " " (H) } role="img" aria-label=(self.title) {
                    @for y in &y_ticks {
                        line x1=(LEFT) x2=(W - RIGHT) y1=(num(py(*y))) y2=(num(py(*y))) stroke="var(--line)" {}
                        text x=(LEFT - 8.0) y=(num(py(*y) + 4.0)) text-anchor="end" { (short(*y)) }
                    }
                    @for x in ticks(x0, x1, 6) {
                        text x=(num(px(x))) y=(H - BOTTOM + 18.0) text-anchor="middle" { (short(x)) }
                    }
                    @for (x, what) in &self.marks {
                        line x1=(num(px(*x))) x2=(num(px(*x))) y1=(TOP) y2=(H - BOTTOM) stroke="var(--faint)" stroke-dasharray="2 4" { title { (what) } }
                    }
                    line x1=(LEFT) x2=(W - RIGHT) y1=(H - BOTTOM) y2=(H - BOTTOM) stroke="var(--faint)" {}
                    text x=((LEFT + W - RIGHT) * 0.5) y=(H - 4.0) text-anchor="middle" { (self.x_label) }
                    @for s in &self.series {
                        @if s.band.len() == s.points.len() && !s.band.is_empty() {
                            path d=(band(s, &px, &py)) fill={ "var(--" (s.color) ")" } fill-opacity="0.16" {}
                        }
                        path d=(line(s, &px, &py)) fill="none" stroke={ "var(--" (s.color) ")" } stroke-width="1.8" stroke-linejoin="round" { title { (s.name) } }
                    }
                }
                @if self.series.len() > 1 {
                    div.legend { @for s in &self.series { span { i style={ "background:var(--" (s.color) ")" } {} (s.name) } } }
                }
            }
        }
    }
}

/// Two decimals are a hundredth of a pixel.
fn num(x: f64) -> String {
    format!("{x:.2}")
}

fn line(s: &Series<'_>, px: &dyn Fn(f64) -> f64, py: &dyn Fn(f64) -> f64) -> String {
    let mut d = String::new();
    for (i, &(x, y)) in s.points.iter().enumerate() {
        let _ = write!(d, "{}{} {}", if i == 0 { 'M' } else { 'L' }, num(px(x)), num(py(y)));
    }
    d
}

fn band(s: &Series<'_>, px: &dyn Fn(f64) -> f64, py: &dyn Fn(f64) -> f64) -> String {
    let mut d = String::new();
    for (i, (&(x, _), &(_, hi))) in s.points.iter().zip(&s.band).enumerate() {
        let _ = write!(d, "{}{} {}", if i == 0 { 'M' } else { 'L' }, num(px(x)), num(py(hi)));
    }
    for (&(x, _), &(lo, _)) in s.points.iter().zip(&s.band).rev() {
        let _ = write!(d, "L{} {}", num(px(x)), num(py(lo)));
    }
    d.push('Z');
    d
}

/// Horizontal bars with a value at the end of each; `reference` draws a vertical line (a mean, a goal).
pub(crate) fn bars(
    title: &str,
    rows: &[(String, f64)],
    color: char,
    decimals: usize,
    from: f64,
    reference: Option<(f64, &str)>,
) -> Markup {
    let row_height = 24.0;
    let (label, width, right) = (110.0, W, 58.0);
    let height = rows.len() as f64 * row_height + if reference.is_some() { 26.0 } else { 8.0 };
    let top = rows.iter().fold(from, |m, r| crate::num::order::max(m, r.1));
    let span = if top > from { top - from } else { 1.0 };
    let px = |x: f64| label + (crate::num::order::max(x, from) - from) / span * (width - label - right);
    html! {
        div.panel {
            h3 { (title) }
            svg viewBox={ "0 0 " (width) " " (height) } role="img" aria-label=(title) {
                @for (i, (name, value)) in rows.iter().enumerate() {
                    @let y = i as f64 * row_height + 4.0;
                    text x=(label - 10.0) y=(num(y + 13.0)) text-anchor="end" { (clip(name, 16)) title { (name) } }
                    rect x=(label) y=(num(y)) width=(num(px(*value) - label)) height=(row_height - 7.0) rx="3" fill={ "var(--" (color) ")" } fill-opacity="0.85" {
                        title { (name) ": " (format!("{value:.decimals$}")) }
                    }
                    text x=(width - 2.0) y=(num(y + 13.0)) text-anchor="end" { (format!("{value:.decimals$}")) }
                }
                @if let Some((x, what)) = reference {
                    line x1=(num(px(x))) x2=(num(px(x))) y1="0" y2=(num(height - 20.0)) stroke="var(--ink)" stroke-opacity="0.55" stroke-dasharray="3 4" {}
                    text x=(num(px(x))) y=(num(height - 6.0)) text-anchor="middle" { (what) " " (format!("{x:.decimals$}")) }
                }
            }
        }
    }
}

/// Means with their intervals as dots with whiskers, one row each, before a line at 0. A half-width that is not finite has no whisker.
pub(crate) fn intervals(title: &str, rows: &[(String, f64, f64)], color: char) -> Markup {
    let row_height = 24.0;
    let (label, right) = (170.0, 110.0);
    let height = rows.len() as f64 * row_height + 28.0;
    let half = |h: f64| if h.is_finite() { h } else { 0.0 };
    let low = rows.iter().fold(0.0, |m, r| crate::num::order::min(m, r.1 - half(r.2)));
    let high = rows.iter().fold(0.0, |m, r| crate::num::order::max(m, r.1 + half(r.2)));
    let span = if high > low { high - low } else { 1.0 };
    let px = |x: f64| label + (x - low) / span * (W - label - right);
    let bottom = height - 24.0;
    html! {
        div.panel {
            h3 { (title) }
            svg viewBox={ "0 0 " (W) " " (height) } role="img" aria-label=(title) {
                @for x in ticks(low, high, 4) {
                    line x1=(num(px(x))) x2=(num(px(x))) y1="0" y2=(num(bottom)) stroke="var(--line)" {}
                    text x=(num(px(x))) y=(num(height - 6.0)) text-anchor="middle" { (short(x)) }
                }
                line x1=(num(px(0.0))) x2=(num(px(0.0))) y1="0" y2=(num(bottom)) stroke="var(--ink)" stroke-opacity="0.55" {}
                @for (i, (name, mean, width)) in rows.iter().enumerate() {
                    @let y = i as f64 * row_height + 12.0;
                    text x=(label - 10.0) y=(num(y + 4.0)) text-anchor="end" { (clip(name, 26)) title { (name) } }
                    line x1=(num(px(mean - half(*width)))) x2=(num(px(mean + half(*width)))) y1=(num(y)) y2=(num(y)) stroke={ "var(--" (color) ")" } stroke-width="2" {}
                    circle cx=(num(px(*mean))) cy=(num(y)) r="4" fill={ "var(--" (color) ")" } { title { (name) } }
                    text x=(W - 2.0) y=(num(y + 4.0)) text-anchor="end" {
                        (format!("{mean:+.2}")) @if width.is_finite() { " ± " (format!("{width:.2}")) }
                    }
                }
            }
        }
    }
}

/// Colours of a bar of parts; the last is for the rest.
const COLORS: usize = 8;

/// One horizontal bar cut into parts, with a legend: where the time went.
pub(crate) fn parts(rows: &[(String, f64)]) -> Markup {
    let mut rows = rows.to_vec();
    if rows.len() > COLORS {
        let rest = rows.drain(COLORS - 1..).fold(0.0, |s, r| s + r.1);
        rows.push(("rest".to_owned(), rest));
    }
    let total = rows.iter().fold(0.0, |s, r| s + r.1);
    let color = |i: usize| (b'a' + (i % COLORS) as u8) as char;
    let starts: Vec<f64> = rows
        .iter()
        .scan(0.0, |at, r| {
            let start = *at;
            *at += r.1;
            Some(start)
        })
        .collect();
    let scale = if total > 0.0 { 1120.0 / total } else { 0.0 };
    html! {
        svg viewBox="0 0 1120 30" role="img" aria-label="parts of the time" {
            @for (i, (name, value)) in rows.iter().enumerate() {
                rect x=(num(starts[i] * scale)) y="0" width=(num(crate::num::order::max(value * scale - 1.5, 0.5))) height="30" rx="3" fill={ "var(--" (color(i)) ")" } {
                    title { (name) }
                }
            }
        }
        div.legend { @for (i, (name, _)) in rows.iter().enumerate() { span { i style={ "background:var(--" (color(i)) ")" } {} (name) } } }
    }
}

/// At most `n` characters, the middle left out.
fn clip(name: &str, n: usize) -> String {
    let chars: Vec<char> = name.chars().collect();
    if chars.len() <= n {
        return name.to_owned();
    }
    let tail = n / 2;
    let head = n - tail - 1;
    chars[..head].iter().chain(&['…']).chain(&chars[chars.len() - tail..]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 7000.0, 6), vec![0.0, 2000.0, 4000.0, 6000.0], "steps of 2000");
        assert_eq!(ticks(0.1, 0.5, 4), vec![0.1, 0.2, 0.30000000000000004, 0.4, 0.5], "ends included");
        assert_eq!(ticks(1.0, 1.0, 5), vec![1.0], "an empty range has one tick");
        assert_eq!(short(7000.0), "7000", "plain");
        assert_eq!(short(25_000.0), "25k", "thousands");
        assert_eq!(short(0.05), "0.05", "decimals");
    }

    #[test]
    fn buckets_keep_every_value_in_the_band() {
        let v: Vec<f32> = (0..1000).map(|i| ((i * 37) % 101) as f32).collect();
        let (points, band) = bucket(&v, 64);
        assert!(points.len() <= 64, "at most as many as asked for");
        let lo = band.iter().fold(f64::INFINITY, |m, b| if b.0 < m { b.0 } else { m });
        let hi = band.iter().fold(0.0, |m, b| if b.1 > m { b.1 } else { m });
        assert_eq!((lo, hi), (0.0, 100.0), "extremes survive");
    }

    #[test]
    fn empty_and_constant_charts_draw() {
        let chart = |points| Lines {
            title: "t",
            x_label: "x",
            log_y: true,
            from_zero: false,
            series: vec![Series { name: "s", color: 'a', points, band: vec![] }],
            marks: vec![],
        };
        assert!(chart(vec![]).html().into_string().contains("Nothing recorded"), "empty");
        let flat = chart(vec![(0.0, 0.1), (1.0, 0.1)]).html().into_string();
        assert!(!flat.contains("NaN") && !flat.contains("inf"), "finite coordinates: {flat}");
        let rows = [("a".to_owned(), 0.5, f64::INFINITY), ("b".to_owned(), -0.25, 0.5)];
        let drawn = intervals("t", &rows, 'a').into_string();
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"), "finite coordinates: {drawn}");
        assert_eq!(clip("images/a_very_long_name.png", 16).chars().count(), 16, "clipped");
    }
}
