//! The chart of the book's chapter on fields: errors of the three rules of a step. The file is generated here, from the
//! numbers that the tests of the quadrature assert; `LASTLIGHT_REMINT=1 cargo test --release --workspace --test operators
//! field::figure` writes it anew.

use super::quadrature::{Rule, Sdf, depth_f64, exact, plane, sphere, wedge, worst};
use std::fmt::Write as _;
use std::path::Path;

/// Scale β of the density.
const BETA: f64 = 0.02;
/// Steps h/β, two per octave.
const HALVES: std::ops::RangeInclusive<i32> = -5..=4;
/// Decades of the y axis.
const DECADES: std::ops::RangeInclusive<i32> = -6..=1;
const RULES: [(Rule, &str, &str); 3] = [
    (Rule::Left, "left", "#a44a06"),
    (Rule::Midpoint, "midpoint", "#2a66a0"),
    (Rule::Analytic, "analytic", "#37752a"),
];
const SURFACES: [(&str, Sdf<'_>); 3] = [("plane", &plane), ("sphere", &sphere), ("crease", &wedge)];

const PANEL: [f64; 2] = [230.0, 250.0];
const GAP: f64 = 20.0;
const LEFT: f64 = 62.0;
const TOP: f64 = 34.0;

/// Errors of a rule for every step, in units of β.
fn errors(sdf: Sdf<'_>, rule: Rule) -> Vec<(f64, f64)> {
    let truth = exact(sdf, BETA);
    let step = |i: i32| libm::exp2(0.5 * f64::from(i));
    HALVES.map(|i| (step(i), worst(BETA, truth, |o| depth_f64(sdf, BETA, step(i) * BETA, o, rule)))).collect()
}

/// Place of a value on a logarithmic axis, from 0 to 1.
fn place(value: f64, [low, high]: [f64; 2]) -> f64 {
    (libm::log2(value) - libm::log2(low)) / (libm::log2(high) - libm::log2(low))
}

/// A power of ten as text, with a raised exponent.
fn power(exponent: i32) -> String {
    match exponent {
        0 => "1".to_owned(),
        1 => "10".to_owned(),
        n => format!("10<tspan dy=\"-4\" font-size=\"9\">{}</tspan>", n.to_string().replace('-', "−")),
    }
}

/// The chart: a panel per surface, a curve per rule.
fn chart() -> String {
    let [x_range, y_range] =
        [[libm::exp2(-2.5), 4.0], [DECADES.start(), DECADES.end()].map(|d| libm::pow(10.0, f64::from(*d)))];
    let (mut body, mut words) = (String::new(), Vec::new());
    for (panel, (name, sdf)) in SURFACES.iter().enumerate() {
        let left = LEFT + panel as f64 * (PANEL[0] + GAP);
        let (right, bottom) = (left + PANEL[0], TOP + PANEL[1]);
        let px = |x: f64| left + place(x, x_range) * PANEL[0];
        let py = |y: f64| bottom - place(y, y_range) * PANEL[1];
        let _ = writeln!(body, "<text x=\"{left:.2}\" y=\"22\" class=\"t\">{name}</text>");
        for d in DECADES {
            let y = py(libm::pow(10.0, f64::from(d)));
            let _ = writeln!(
                body,
                "<line x1=\"{left:.2}\" x2=\"{right:.2}\" y1=\"{y:.2}\" y2=\"{y:.2}\" class=\"g\"/>"
            );
            if panel == 0 {
                let (x, y) = (left - 8.0, y + 4.0);
                let _ = writeln!(body, "<text x=\"{x:.2}\" y=\"{y:.2}\" class=\"e\">{}</text>", power(d));
            }
        }
        for (x, label) in [(0.25, "¼"), (0.5, "½"), (1.0, "1"), (2.0, "2"), (4.0, "4")] {
            let (x, y) = (px(x), bottom + 18.0);
            let _ = writeln!(body, "<text x=\"{x:.2}\" y=\"{y:.2}\" class=\"m\">{label}</text>");
        }
        let (x, y) = (left + 0.5 * PANEL[0], bottom + 38.0);
        let _ = writeln!(body, "<text x=\"{x:.2}\" y=\"{y:.2}\" class=\"m\">h/β</text>");
        for (rule, title, color) in RULES {
            let found = errors(*sdf, rule);
            let mut path = String::new();
            let mut dots = String::new();
            for (i, (x, y)) in found.iter().enumerate() {
                let (x, y) = (px(*x), py(*y));
                let _ = write!(path, "{}{x:.2} {y:.2}", if i == 0 { 'M' } else { 'L' });
                let _ = write!(dots, "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"2.6\" fill=\"{color}\"/>");
            }
            let _ = writeln!(
                body,
                "<path d=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.8\"><title>{title}</title></path>{dots}"
            );
            let at = |step: f64| found.iter().find(|f| f.0 == step).expect("a step of the chart").1;
            words.push(format!("{name}, {title}: {:.1e} at h = β/2, {:.1e} at h = 2β", at(0.5), at(2.0)));
        }
    }
    let width = LEFT + 3.0 * PANEL[0] + 2.0 * GAP + 16.0;
    let height = TOP + PANEL[1] + 78.0;
    for (i, (_, title, color)) in RULES.iter().enumerate() {
        let (x, y) = (LEFT + 110.0 * i as f64, height - 18.0);
        let _ = writeln!(
            body,
            "<rect x=\"{x:.2}\" y=\"{:.2}\" width=\"11\" height=\"11\" rx=\"3\" fill=\"{color}\"/><text x=\"{:.2}\" y=\"{y:.2}\" class=\"l\">{title}</text>",
            y - 10.0,
            x + 17.0
        );
    }
    let middle = TOP + 0.5 * PANEL[1];
    let _ = writeln!(
        body,
        "<text x=\"14\" y=\"{middle:.2}\" class=\"m\" transform=\"rotate(-90 14 {middle:.2})\">error of the depth, in β</text>"
    );
    let alt = format!(
        "Largest error of the depth over 200 offsets, in units of β = {BETA}, by the step h/β from 0.18 to 4. {}.",
        words.join("; ")
    );
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" aria-labelledby=\"alt\">\n\
         <title id=\"alt\">{alt}</title>\n\
         <style>text{{font:12px system-ui,-apple-system,'Segoe UI',Roboto,Arial,sans-serif;fill:#4f5864}}.t{{font-size:14px;font-weight:600;fill:#1d2126}}.e{{text-anchor:end}}.m{{text-anchor:middle}}.g{{stroke:#e4e2dd}}</style>\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n{body}</svg>\n"
    )
}

#[test]
fn the_chart_of_the_quadrature_is_that_of_the_book() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../src/book/figures/quadrature.svg");
    let made = chart();
    if std::env::var_os("LASTLIGHT_REMINT").is_some_and(|v| v == "1") {
        std::fs::write(&file, &made).expect("the figure can be written");
    }
    let stored = std::fs::read_to_string(&file).expect("the book has the figure");
    let differs = stored.lines().zip(made.lines()).position(|(a, b)| a != b);
    assert!(stored == made, "the figure differs from its numbers, from line {differs:?} on");
}
