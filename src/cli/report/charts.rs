//! Line charts as inline SVG. Colours are the custom properties of the page, so that they follow its palette;
//! every chart has an alternative text with its numbers in short.

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

pub(super) const W: f64 = 540.0;
const H: f64 = 270.0;
pub(super) const LEFT: f64 = 64.0;
pub(super) const RIGHT: f64 = 24.0;
pub(super) const TOP: f64 = 10.0;
pub(super) const BOTTOM: f64 = 44.0;

/// Round steps that cut `lo..hi` into about `n` parts.
pub(super) fn ticks(lo: f64, hi: f64, n: usize) -> Vec<f64> {
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

/// Share of the values of a bucket below its band, and above it.
const TAIL: f64 = 0.1;

/// Medians of at most `n` buckets of consecutive values, with the range of the middle 80 % of each as a band.
pub(crate) fn bucket(values: &[f32], n: usize) -> (Curve, Curve) {
    let size = values.len().div_ceil(n.max(1)).max(1);
    let mut points = Vec::new();
    let mut band = Vec::new();
    for (i, part) in values.chunks(size).enumerate() {
        let mut sorted: Vec<f64> = part.iter().map(|&v| f64::from(v)).collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted[libm::round(share * (sorted.len() - 1) as f64) as usize];
        points.push(((i * size) as f64 + part.len() as f64 * 0.5, at(0.5)));
        band.push((at(TAIL), at(1.0 - TAIL)));
    }
    (points, band)
}

/// The ends of the curves in words, for those who do not see them.
fn in_words(title: &str, x_label: &str, series: &[Series<'_>]) -> String {
    let one = |s: &Series<'_>| match (s.points.first(), s.points.last()) {
        (Some(a), Some(b)) => format!(
            "{} from {} at {x_label} {} to {} at {}",
            s.name,
            short(a.1),
            short(a.0),
            short(b.1),
            short(b.0)
        ),
        _ => s.name.to_owned(),
    };
    format!("{title}: {}", series.iter().map(one).collect::<Vec<_>>().join("; "))
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
                svg viewBox={ "0 0 " (W) " " (H) } role="img" aria-label=(in_words(self.title, self.x_label, &self.series)) {
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
pub(super) fn num(x: f64) -> String {
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
    fn buckets_have_their_median_and_a_band_without_spikes() {
        let mut v: Vec<f32> = (0..1000).map(|i| ((i * 37) % 101) as f32).collect();
        v[500] = 1e6;
        let (points, band) = bucket(&v, 50);
        assert_eq!((points.len(), band.len()), (50, 50), "as many as requested");
        for (i, ((x, median), (lo, hi))) in points.iter().zip(&band).enumerate() {
            let part = &v[i * 20..(i + 1) * 20];
            let below = |y: f64| part.iter().filter(|&&p| f64::from(p) < y).count();
            assert_eq!(*x, i as f64 * 20.0 + 10.0, "the middle of the bucket");
            assert!(
                (9..=10).contains(&below(*median)),
                "bucket {i}: half of the values are below the median"
            );
            assert_eq!((below(*lo), below(*hi)), (2, 17), "bucket {i}: a tenth is outside on each side");
            assert!(*hi < 1e6, "a spike is no part of the band");
        }
        assert_eq!(bucket(&v[..3], 80).0.len(), 3, "few values are their own buckets");
        assert!(bucket(&[], 80).0.is_empty(), "nothing");
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
        assert!(
            flat.contains("aria-label=\"t: s from 0.1 at x 0 to 0.1 at 1\""),
            "the numbers in words: {flat}"
        );
    }
}
