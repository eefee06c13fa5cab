//! Bars and parts as HTML, intervals and histograms as inline SVG.

use super::charts::{BOTTOM, LEFT, RIGHT, TOP, W, num, short, ticks};
use maud::{Markup, html};

/// Horizontal bars with a value at the end of each; `reference` draws a line (a mean, a goal). One value needs no bars: nothing is drawn.
pub(crate) fn bars(
    title: &str,
    rows: &[(String, f64)],
    color: char,
    decimals: usize,
    from: f64,
    reference: Option<(f64, &str)>,
) -> Markup {
    if rows.len() < 2 {
        return html! {};
    }
    let top = rows.iter().fold(from, |m, r| crate::num::order::max(m, r.1));
    let span = if top > from { top - from } else { 1.0 };
    let share = |x: f64| format!("{:.2}%", 100.0 * (crate::num::order::max(x, from) - from) / span);
    let style = |x: f64| format!("width:{};background:var(--{color})", share(x));
    html! {
        div.panel {
            h3 { (title) @if let Some((x, what)) = reference { ", " (what) " " (format!("{x:.decimals$}")) " (dashed)" } }
            ul.bars { @for (name, value) in rows {
                li {
                    span.name title=(name) { (clip(name, 20)) }
                    span.track { i style=(style(*value)) {} @if let Some((x, _)) = reference { b style={ "left:" (share(x)) } {} } }
                    span.value { (format!("{value:.decimals$}")) }
                }
            } }
        }
    }
}

/// Means with their intervals as dots with whiskers, one row each, before a line at 0. A half-width that is not finite has no whisker.
pub(crate) fn intervals(title: &str, rows: &[(String, f64, f64)], color: char) -> Markup {
    let words: Vec<String> = rows.iter().map(|(name, mean, _)| format!("{name} {}", short(*mean))).collect();
    let row_height = 26.0;
    let (label, right) = (190.0, 110.0);
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
            svg viewBox={ "0 0 " (W) " " (height) } role="img" aria-label={ (title) ": " (words.join("; ")) } {
                @for x in ticks(low, high, 4) {
                    line x1=(num(px(x))) x2=(num(px(x))) y1="0" y2=(num(bottom)) stroke="var(--line)" {}
                    text x=(num(px(x))) y=(num(height - 6.0)) text-anchor="middle" { (short(x)) }
                }
                line x1=(num(px(0.0))) x2=(num(px(0.0))) y1="0" y2=(num(bottom)) stroke="var(--ink)" stroke-opacity="0.55" {}
                @for (i, (name, mean, width)) in rows.iter().enumerate() {
                    @let y = i as f64 * row_height + 12.0;
                    text x=(label - 10.0) y=(num(y + 4.0)) text-anchor="end" { (clip(name, 20)) title { (name) } }
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
    let share = |x: f64| if total > 0.0 { 100.0 * x / total } else { 0.0 };
    let words: Vec<String> = rows.iter().map(|(name, x)| format!("{name} {:.0} %", share(*x))).collect();
    html! {
        div.parts role="img" aria-label={ "parts of the time: " (words.join(", ")) } {
            @for (i, (name, value)) in rows.iter().enumerate() {
                i title=(name) style=(format!("flex:{:.3} 0 0;background:var(--{})", share(*value), color(i))) {}
            }
        }
        div.legend { @for (i, (name, _)) in rows.iter().enumerate() { span { i style={ "background:var(--" (color(i)) ")" } {} (name) } } }
    }
}

/// Numbers of entries in bins of equal width from `low` on, as vertical bars; the axis holds decimal logarithms.
pub(crate) fn histogram(title: &str, low: f64, width: f64, counts: &[usize]) -> Markup {
    let most = counts.iter().fold(1, |m, &c| Ord::max(m, c));
    let total = counts.iter().fold(0, |s: usize, &c| s.saturating_add(c));
    let high = low + width * counts.len() as f64;
    let height = 190.0;
    let px = |x: f64| LEFT + (x - low) / (high - low) * (W - LEFT - RIGHT);
    let py = |n: f64| TOP + (1.0 - n / most as f64) * (height - TOP - BOTTOM);
    let power = |x: f64| format!("1e{}", short(x));
    html! {
        div.panel {
            h3 { (title) }
            svg viewBox={ "0 0 " (W) " " (height) } role="img" aria-label={ (title) ": " (total) " entries from " (power(low)) " to " (power(high)) } {
                @for (i, &count) in counts.iter().enumerate() {
                    @let (x, y) = (px(low + i as f64 * width), py(count as f64));
                    rect x=(num(x + 0.8)) y=(num(y)) width=(num(crate::num::order::max((W - LEFT - RIGHT) / counts.len() as f64 - 1.6, 0.5))) height=(num(height - BOTTOM - y)) fill="var(--b)" { title { (count) } }
                }
                line x1=(LEFT) x2=(W - RIGHT) y1=(height - BOTTOM) y2=(height - BOTTOM) stroke="var(--faint)" {}
                text x=(LEFT - 8.0) y=(num(py(most as f64) + 10.0)) text-anchor="end" { (most) }
                @for x in ticks(low, high, 6) { text x=(num(px(x))) y=(height - BOTTOM + 18.0) text-anchor="middle" { (short(x)) } }
            }
        }
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
    fn one_bar_is_no_chart() {
        let row = |name: &str, x: f64| (name.to_owned(), x);
        assert!(bars("t", &[row("a", 1.0)], 'a', 2, 0.0, None).into_string().is_empty(), "one value");
        let two = bars("t", &[row("a", 1.0), row("b", 4.0)], 'a', 2, 0.0, Some((2.0, "mean"))).into_string();
        assert!(
            two.contains("width:25.00%") && two.contains("width:100.00%") && two.contains("left:50.00%"),
            "{two}"
        );
    }

    #[test]
    fn intervals_without_a_width_draw() {
        let rows = [("a".to_owned(), 0.5, f64::INFINITY), ("b".to_owned(), -0.25, 0.5)];
        let drawn = intervals("t", &rows, 'a').into_string();
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"), "finite coordinates: {drawn}");
        assert_eq!(clip("images/a_very_long_name.png", 16).chars().count(), 16, "clipped");
    }
}
