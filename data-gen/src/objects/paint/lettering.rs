//! Letters of five by seven dots, invented words, and labels printed with them.

use crate::draws::Draws;

/// Columns of a glyph, bit 0 at the top: space, A–Z, 0–9, and . - / :
const FONT: [[u8; 5]; 41] = [
    [0, 0, 0, 0, 0],
    [0x7c, 0x12, 0x11, 0x12, 0x7c],
    [0x7f, 0x49, 0x49, 0x49, 0x36],
    [0x3e, 0x41, 0x41, 0x41, 0x22],
    [0x7f, 0x41, 0x41, 0x41, 0x3e],
    [0x7f, 0x49, 0x49, 0x49, 0x41],
    [0x7f, 0x09, 0x09, 0x09, 0x01],
    [0x3e, 0x41, 0x41, 0x51, 0x73],
    [0x7f, 0x08, 0x08, 0x08, 0x7f],
    [0x00, 0x41, 0x7f, 0x41, 0x00],
    [0x20, 0x40, 0x41, 0x3f, 0x01],
    [0x7f, 0x08, 0x14, 0x22, 0x41],
    [0x7f, 0x40, 0x40, 0x40, 0x40],
    [0x7f, 0x02, 0x1c, 0x02, 0x7f],
    [0x7f, 0x04, 0x08, 0x10, 0x7f],
    [0x3e, 0x41, 0x41, 0x41, 0x3e],
    [0x7f, 0x09, 0x09, 0x09, 0x06],
    [0x3e, 0x41, 0x51, 0x21, 0x5e],
    [0x7f, 0x09, 0x19, 0x29, 0x46],
    [0x26, 0x49, 0x49, 0x49, 0x32],
    [0x03, 0x01, 0x7f, 0x01, 0x03],
    [0x3f, 0x40, 0x40, 0x40, 0x3f],
    [0x1f, 0x20, 0x40, 0x20, 0x1f],
    [0x3f, 0x40, 0x38, 0x40, 0x3f],
    [0x63, 0x14, 0x08, 0x14, 0x63],
    [0x03, 0x04, 0x78, 0x04, 0x03],
    [0x61, 0x59, 0x49, 0x4d, 0x43],
    [0x3e, 0x51, 0x49, 0x45, 0x3e],
    [0x00, 0x42, 0x7f, 0x40, 0x00],
    [0x72, 0x49, 0x49, 0x49, 0x46],
    [0x21, 0x41, 0x49, 0x4d, 0x33],
    [0x18, 0x14, 0x12, 0x7f, 0x10],
    [0x27, 0x45, 0x45, 0x45, 0x39],
    [0x3c, 0x4a, 0x49, 0x49, 0x31],
    [0x41, 0x21, 0x11, 0x09, 0x07],
    [0x36, 0x49, 0x49, 0x49, 0x36],
    [0x46, 0x49, 0x49, 0x29, 0x1e],
    [0x00, 0x60, 0x60, 0x00, 0x00],
    [0x08, 0x08, 0x08, 0x08, 0x08],
    [0x20, 0x10, 0x08, 0x04, 0x02],
    [0x00, 0x36, 0x36, 0x00, 0x00],
];

/// An invented word, as indices into the font.
fn word(draws: &mut Draws) -> Vec<u8> {
    const CONSONANTS: &[u8] = b"BCDFGHKLMNPRSTVWZ";
    const VOWELS: &[u8] = b"AEIOUY";
    if draws.chance(0.15) {
        return (0..draws.whole(1, 5)).map(|_| 27 + draws.whole(0, 10) as u8).collect();
    }
    let mut out = Vec::new();
    for _ in 0..draws.whole(1, 4) {
        out.push(draws.pick(CONSONANTS) - b'A' + 1);
        out.push(draws.pick(VOWELS) - b'A' + 1);
        if draws.chance(0.35) {
            out.push(draws.pick(CONSONANTS) - b'A' + 1);
        }
    }
    out
}

/// A small printed image of coverages: 0 for no ink, 255 for ink.
#[derive(Clone, Debug)]
pub(crate) struct Print {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Coverage of ink, shape (H, W), top row first.
    pub(crate) ink: Vec<u8>,
    /// Coverage of a second colour, shape (H, W).
    pub(crate) accent: Vec<u8>,
}

impl Print {
    fn new(width: usize, height: usize) -> Self {
        Self { width, height, ink: vec![0; width * height], accent: vec![0; width * height] }
    }

    fn block(&mut self, x: usize, y: usize, w: usize, h: usize, is_accent: bool) {
        let layer = if is_accent { &mut self.accent } else { &mut self.ink };
        for j in y..(y + h).min(self.height) {
            for i in x..(x + w).min(self.width) {
                layer[j * self.width + i] = 255;
            }
        }
    }

    fn clear(&mut self, x: usize, y: usize, w: usize, h: usize) {
        for j in y..(y + h).min(self.height) {
            for i in x..(x + w).min(self.width) {
                self.ink[j * self.width + i] = 0;
                self.accent[j * self.width + i] = 0;
            }
        }
    }

    /// Draws a glyph with dots of `dot` × `dot`.
    fn glyph(&mut self, glyph: u8, x: usize, y: usize, dot: usize, is_accent: bool) {
        for (c, column) in FONT[usize::from(glyph)].iter().enumerate() {
            for r in 0..7 {
                if column >> r & 1 == 1 {
                    self.block(x + c * dot, y + r * dot, dot, dot, is_accent);
                }
            }
        }
    }

    /// Draws a row of words until `width` is filled; returns the width used.
    fn row(
        &mut self,
        draws: &mut Draws,
        x: usize,
        y: usize,
        width: usize,
        dot: usize,
        is_accent: bool,
    ) -> usize {
        let mut at = 0;
        loop {
            let word = word(draws);
            if at + word.len() * 6 * dot > width {
                return at;
            }
            for &g in &word {
                self.glyph(g, x + at, y, dot, is_accent);
                at += 6 * dot;
            }
            at += 5 * dot;
        }
    }

    /// Coverage 0..1 of ink and accent at a position in dots, with the image repeated in both directions.
    pub(crate) fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let (x, y) = (x - 0.5, y - 0.5);
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let wrap = |k: f64, n: usize| (k as i64).rem_euclid(n as i64) as usize;
        let xs = [wrap(x.floor(), self.width), wrap(x.floor() + 1.0, self.width)];
        let ys = [wrap(y.floor(), self.height), wrap(y.floor() + 1.0, self.height)];
        [&self.ink, &self.accent].map(|layer| {
            let v = |i: usize, j: usize| f64::from(layer[ys[j] * self.width + xs[i]]);
            let (a, b) = (v(0, 0) + fx * (v(1, 0) - v(0, 0)), v(0, 1) + fx * (v(1, 1) - v(0, 1)));
            (a + fy * (b - a)) / 255.0
        })
    }
}

/// Rows of small words, as on a page.
pub(crate) fn page(draws: &mut Draws) -> Print {
    let (w, rows) = (192, 16);
    let mut print = Print::new(w, rows * 11);
    let ragged = draws.chance(0.5);
    for r in 0..rows {
        if draws.chance(0.1) {
            continue;
        }
        let indent = if draws.chance(0.15) { 14 } else { 2 };
        let short = if ragged { draws.whole(0, 60) } else { 0 };
        let is_accent = draws.chance(0.08);
        print.row(draws, indent, r * 11 + 2, w - 4 - indent - short, 1, is_accent);
    }
    print
}

/// A label: a frame, a title, small rows, a bar code, a mark.
pub(crate) fn label(draws: &mut Draws) -> Print {
    let (w, h) = (draws.whole(120, 200), draws.whole(90, 170));
    let mut print = Print::new(w, h);
    let head = draws.whole(22, 34);
    let is_banner = draws.chance(0.6);
    if draws.chance(0.5) {
        let t = draws.whole(1, 3);
        print.block(3, 3, w - 6, t, false);
        print.block(3, h - 3 - t, w - 6, t, false);
        print.block(3, 3, t, h - 6, false);
        print.block(w - 3 - t, 3, t, h - 6, false);
    }
    if is_banner {
        print.block(6, 6, w - 12, head, true);
    }
    let dot = 2 + usize::from(head > 30);
    print.row(draws, 10, 6 + (head - 7 * dot) / 2, w - 20, dot, false);
    let mut y = head + 12;
    // A mark: a disc, a ring or a block.
    let mark = draws.whole(0, 4);
    let size = draws.whole(18, 30);
    if mark < 3 && y + size + 4 < h {
        let x0 = w - 12 - size;
        if mark == 2 {
            print.block(x0, y, size, size, true);
            print.clear(x0 + 4, y + 4, size - 8, size - 8);
        } else {
            let r = 0.5 * size as f64;
            for j in 0..size {
                for i in 0..size {
                    let (dx, dy) = (i as f64 + 0.5 - r, j as f64 + 0.5 - r);
                    let d = (dx * dx + dy * dy).sqrt();
                    if d < r && (mark == 0 || d > 0.6 * r) {
                        print.block(x0 + i, y + j, 1, 1, true);
                    }
                }
            }
        }
    }
    let beside = y + size + 2;
    let bars = draws.chance(0.6) && h > 110;
    let end = if bars { h - 32 } else { h - 8 };
    while y + 8 < end {
        let width = if mark < 3 && y < beside { w - 28 - size } else { w - 20 };
        let big = draws.chance(0.15) && y + 18 < end;
        if draws.chance(0.12) {
            print.block(10, y + 3, width.saturating_sub(4), 1, false);
            y += 7;
            continue;
        }
        let dot = if big { 2 } else { 1 };
        let is_accent = draws.chance(0.15);
        print.row(draws, 10, y, width, dot, is_accent);
        y += 7 * dot + 3;
    }
    if bars {
        let mut x = 12;
        while x + 4 < w / 2 + 20 {
            let t = draws.whole(1, 4);
            print.block(x, h - 28, t, 16, false);
            x += t + draws.whole(1, 4);
        }
        print.row(draws, 12, h - 11, w / 2, 1, false);
    }
    print
}
