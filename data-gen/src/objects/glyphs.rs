//! Outlines of capital letters and digits: closed contours of straight lines and quadratic curves, cap height
//! 14, stem 3. The first contour is the outline, the others are holes.

/// Name and contours; `Q` before two points: a curve with the first as control point and the second as end
/// point.
const OUTLINES: &[(char, &[&str])] = &[
    ('A', &["0 0 3 0 4.1 3 7.9 3 9 0 12 0 7.6 14 4.4 14", "5 5.6 7 5.6 6 9.6"]),
    (
        'B',
        &[
            "0 0 6 0 Q 10.5 0 10.5 4 Q 10.5 6.6 8.2 7.2 Q 10 8 10 10.2 Q 10 14 5.8 14 0 14",
            "3 2.6 5.8 2.6 Q 7.5 2.6 7.5 4.2 Q 7.5 5.9 5.8 5.9 3 5.9",
            "3 8.3 5.6 8.3 Q 7 8.3 7 9.8 Q 7 11.4 5.6 11.4 3 11.4",
        ],
    ),
    (
        'C',
        &[
            "11 3.4 Q 9.6 0 6.2 0 Q 0 0 0 7 Q 0 14 6.2 14 Q 9.6 14 11 10.6 8.3 9.6 Q 7.6 11.3 6.2 11.3 Q 3 11.3 3 7 Q 3 2.7 6.2 2.7 Q 7.6 2.7 8.3 4.4",
        ],
    ),
    ('D', &["0 0 5 0 Q 11 0 11 7 Q 11 14 5 14 0 14", "3 2.7 5 2.7 Q 8 2.7 8 7 Q 8 11.3 5 11.3 3 11.3"]),
    ('E', &["0 0 9 0 9 2.8 3 2.8 3 5.7 8 5.7 8 8.3 3 8.3 3 11.2 9 11.2 9 14 0 14"]),
    ('F', &["0 0 3 0 3 5.6 8 5.6 8 8.3 3 8.3 3 11.2 9 11.2 9 14 0 14"]),
    ('H', &["0 0 3 0 3 5.6 8 5.6 8 0 11 0 11 14 8 14 8 8.4 3 8.4 3 14 0 14"]),
    ('K', &["0 0 3 0 3 4.2 4.4 5.8 7.6 0 11.2 0 6.5 8.2 11 14 7.4 14 3 8.4 3 14 0 14"]),
    ('L', &["0 0 9 0 9 2.8 3 2.8 3 14 0 14"]),
    ('M', &["0 0 2.8 0 2.8 8.6 6.5 3 10.2 8.6 10.2 0 13 0 13 14 10.4 14 6.5 7.6 2.6 14 0 14"]),
    ('N', &["0 0 2.9 0 2.9 8.8 8.1 0 11 0 11 14 8.1 14 8.1 5.2 2.9 14 0 14"]),
    (
        'O',
        &[
            "6 0 Q 12 0 12 7 Q 12 14 6 14 Q 0 14 0 7 Q 0 0 6 0",
            "6 2.7 Q 9 2.7 9 7 Q 9 11.3 6 11.3 Q 3 11.3 3 7 Q 3 2.7 6 2.7",
        ],
    ),
    (
        'P',
        &[
            "0 0 3 0 3 4.8 5.6 4.8 Q 10.4 4.8 10.4 9.4 Q 10.4 14 5.6 14 0 14",
            "3 7.4 5.4 7.4 Q 7.4 7.4 7.4 9.4 Q 7.4 11.4 5.4 11.4 3 11.4",
        ],
    ),
    (
        'R',
        &[
            "0 0 3 0 3 4.8 4.8 4.8 7.4 0 11 0 7.9 5.4 Q 10.4 6.4 10.4 9.5 Q 10.4 14 5.6 14 0 14",
            "3 7.4 5.4 7.4 Q 7.4 7.4 7.4 9.4 Q 7.4 11.4 5.4 11.4 3 11.4",
        ],
    ),
    (
        'S',
        &[
            "0.4 3.2 Q 1.6 0 5.2 0 Q 10 0 10 4 Q 10 7.2 6 8.3 Q 3.2 9 3.2 10.3 Q 3.2 11.5 5 11.5 Q 6.6 11.5 7.2 10 9.6 11 Q 8.6 14 5.1 14 Q 0.4 14 0.4 10.1 Q 0.4 6.9 4.4 5.8 Q 7 5 7 3.8 Q 7 2.6 5.2 2.6 Q 3.4 2.6 2.8 4.3",
        ],
    ),
    ('T', &["4 0 7 0 7 11.2 11 11.2 11 14 0 14 0 11.2 4 11.2"]),
    ('U', &["0 14 0 5 Q 0 0 5.5 0 Q 11 0 11 5 11 14 8 14 8 5.2 Q 8 2.7 5.5 2.7 Q 3 2.7 3 5.2 3 14"]),
    ('V', &["4.4 0 7.6 0 12 14 8.9 14 6 3.8 3.1 14 0 14"]),
    ('X', &["0 0 3.5 0 6 4.6 8.5 0 12 0 7.8 7.1 11.8 14 8.4 14 6 9.7 3.6 14 0.2 14 4.2 7.1"]),
    ('Y', &["4.5 0 7.5 0 7.5 5.4 12 14 8.7 14 6 8.4 3.3 14 0 14 4.5 5.4"]),
    ('Z', &["0 0 10 0 10 2.8 3.8 2.8 10 11.4 10 14 0.4 14 0.4 11.2 6.2 11.2 0 2.6"]),
    (
        '2',
        &[
            "0.4 0 9.8 0 9.8 2.7 4.8 2.7 Q 9.7 6.4 9.7 9.9 Q 9.7 14 5.2 14 Q 1.2 14 0.4 9.9 3.2 9.3 Q 3.6 11.4 5.1 11.4 Q 6.7 11.4 6.7 9.7 Q 6.7 7.2 0.4 2.2",
        ],
    ),
    ('4', &["6 0 9 0 9 3 11 3 11 5.6 9 5.6 9 14 5.8 14 0 5.4 0 3 6 3", "6 5.6 6 10 3 5.6"]),
    (
        '8',
        &[
            "5.5 0 Q 10.6 0 10.6 4 Q 10.6 6.4 8.4 7.3 Q 10 8.2 10 10.4 Q 10 14 5.5 14 Q 1 14 1 10.4 Q 1 8.2 2.6 7.3 Q 0.4 6.4 0.4 4 Q 0.4 0 5.5 0",
            "5.5 2.4 Q 7.6 2.4 7.6 4.1 Q 7.6 5.9 5.5 5.9 Q 3.4 5.9 3.4 4.1 Q 3.4 2.4 5.5 2.4",
            "5.5 8.3 Q 7.1 8.3 7.1 9.9 Q 7.1 11.6 5.5 11.6 Q 3.9 11.6 3.9 9.9 Q 3.9 8.3 5.5 8.3",
        ],
    ),
];

/// Number of glyphs.
pub(crate) const COUNT: usize = OUTLINES.len();

/// Contours of glyph `index`, with curves divided into `steps` segments; the cap height is 1.
pub(crate) fn outline(index: usize, steps: usize) -> Vec<Vec<[f64; 2]>> {
    OUTLINES[index].1.iter().map(|text| contour(text, steps)).collect()
}

fn contour(text: &str, steps: usize) -> Vec<[f64; 2]> {
    let mut words = text.split(' ').peekable();
    let mut out: Vec<[f64; 2]> = Vec::new();
    let number = |w: Option<&str>| -> f64 {
        w.and_then(|w| w.parse::<f64>().ok()).expect("the outlines above contain pairs of numbers") / 14.0
    };
    while let Some(&word) = words.peek() {
        if word == "Q" {
            words.next();
            let control = [number(words.next()), number(words.next())];
            let end = [number(words.next()), number(words.next())];
            let start = out[out.len() - 1];
            for k in 1..=steps {
                let t = k as f64 / steps as f64;
                let blend = |i: usize| {
                    (1.0 - t) * (1.0 - t) * start[i] + 2.0 * t * (1.0 - t) * control[i] + t * t * end[i]
                };
                out.push([blend(0), blend(1)]);
            }
        } else {
            out.push([number(words.next()), number(words.next())]);
        }
    }
    // A curve that ends at the start of the contour contains that point twice.
    if out.len() > 1 {
        let (a, b) = (out[0], out[out.len() - 1]);
        if (a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-9 {
            out.pop();
        }
    }
    out
}
