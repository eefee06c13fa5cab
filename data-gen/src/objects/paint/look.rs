//! Materials as layers: pattern, colour, roughness and metallic of each layer.

use super::super::Wish;
use super::lettering;
use super::palette::{self, Rgb};
use super::pattern::Pattern;
use crate::draws::Draws;

/// One layer.
#[derive(Clone, Debug)]
pub(super) struct Coat {
    /// Two sRGB-encoded colours between which the grain interpolates.
    pub(super) colors: [Rgb; 2],
    /// Periods of the grain per unit length.
    pub(super) grain: f64,
    /// Roughness at the two ends of the grain.
    pub(super) roughness: [f64; 2],
    /// Metallic, 0 or 1.
    pub(super) metallic: f64,
}

impl Coat {
    fn new(a: Rgb, b: Rgb, roughness: [f64; 2], metallic: f64) -> Self {
        Self { colors: [a, b], grain: 6.0, roughness, metallic }
    }

    /// A single colour with slight variations of its brightness.
    fn plain(c: Rgb, roughness: f64, metallic: f64) -> Self {
        Self::new(c, c.map(|x| 0.93 * x), [roughness, roughness], metallic)
    }

    fn grain(self, grain: f64) -> Self {
        Self { grain, ..self }
    }
}

/// A material: the first layer everywhere, the others where their pattern is, multiplied by their strength.
#[derive(Clone, Debug)]
pub(super) struct PaintedMaterial {
    pub(super) name: &'static str,
    pub(super) base: Coat,
    pub(super) over: Vec<(Pattern, f64, Coat)>,
}

/// Roughness of a rough dielectric, half gloss or gloss.
fn finish(draws: &mut Draws) -> f64 {
    match draws.weighted(&[0.4, 0.35, 0.25]) {
        0 => draws.range(0.55, 0.95),
        1 => draws.range(0.28, 0.55),
        _ => draws.range(0.06, 0.28),
    }
}

/// One of the patterns with two sides.
fn two_sided(draws: &mut Draws) -> Pattern {
    let size = draws.range(0.04, 0.16);
    match draws.whole(0, 8) {
        0 => Pattern::Checks { size },
        1 => Pattern::Cubes { size: 1.3 * size },
        2 | 3 => Pattern::Stripes {
            along: draws.direction(),
            period: draws.range(0.04, 0.25),
            share: draws.range(0.2, 0.7),
        },
        4 => Pattern::Dots { period: 1.3 * size, radius: size * draws.range(0.25, 0.5) },
        5 => Pattern::Patches {
            frequency: draws.range(3.0, 9.0),
            octaves: draws.whole(1, 5),
            level: draws.range(-0.1, 0.15),
            soft: draws.range(0.01, 0.1),
        },
        6 => Pattern::Chips { size, share: draws.range(0.3, 0.6) },
        _ => Pattern::Ramp { along: draws.direction(), from: -0.4, to: 0.4 },
    }
}

fn scratches(draws: &mut Draws) -> Pattern {
    Pattern::Scratches {
        frequency: draws.range(90.0, 220.0),
        slope: draws.range(-0.5, 0.5),
        level: draws.range(0.45, 0.62),
    }
}

fn worn(draws: &mut Draws, level: f64) -> Pattern {
    Pattern::Patches { frequency: draws.range(4.0, 8.0), octaves: 4, level, soft: 0.08 }
}

/// Lettering over the whole surface: small rows, or a label.
fn print(look: &mut PaintedMaterial, draws: &mut Draws, words: &mut Draws, ink: Coat, accent: Coat) {
    let print = lettering::page(words);
    let dot = draws.range(0.0022, 0.006);
    let second = Pattern::Print { print: print.clone(), dot, is_accent: true };
    look.over.push((Pattern::Print { print, dot, is_accent: false }, 1.0, ink));
    look.over.push((second, 1.0, accent));
}

fn labels(
    look: &mut PaintedMaterial,
    draws: &mut Draws,
    words: &mut Draws,
    paper: Coat,
    ink: Coat,
    accent: Coat,
) {
    let print = lettering::label(words);
    let dot = draws.range(0.0024, 0.004);
    let (width, height) = (print.width as f64 * dot, print.height as f64 * dot);
    if draws.chance(0.8) {
        look.over.push((Pattern::Sheet { width, height, margin: 2.0 * dot }, 1.0, paper));
    }
    look.over.push((Pattern::Print { print: print.clone(), dot, is_accent: true }, 1.0, accent));
    look.over.push((Pattern::Print { print, dot, is_accent: false }, 1.0, ink));
}

/// Draws a material that satisfies the request.
pub(super) fn draw(draws: &mut Draws, words: &mut Draws, wish: Wish) -> PaintedMaterial {
    match wish {
        Wish::Printed => return printed(draws, words),
        Wish::Metallic => return metal(draws),
        Wish::Paper => return pages(draws),
        Wish::Any => {}
    }
    match draws.weighted(&[1.3, 1.4, 1.0, 1.0, 1.0, 0.7, 1.2, 0.8, 0.8, 0.8, 0.9, 0.7]) {
        0 => painted(draws, words),
        1 => patterned(draws, words),
        2 => wood(draws),
        3 => stone(draws, words),
        4 => metal(draws),
        5 => mirror(draws, words),
        6 => inlaid(draws),
        7 => rusty(draws),
        8 => masonry(draws),
        9 => cloth(draws),
        10 => printed(draws, words),
        _ => terrazzo(draws),
    }
}

fn painted(draws: &mut Draws, words: &mut Draws) -> PaintedMaterial {
    let (a, b) = palette::pair(draws);
    let r = finish(draws);
    let mut look = PaintedMaterial { name: "paint", base: Coat::plain(a, r, 0.0), over: Vec::new() };
    if draws.chance(0.4) {
        let coat = Coat::plain(b, r, 0.0);
        print(&mut look, draws, words, coat.clone(), coat);
    }
    if draws.chance(0.4) {
        let bare = Coat::plain(palette::metal(draws), draws.range(0.25, 0.5), 1.0);
        look.over.push((worn(draws, 0.22), 1.0, bare));
    }
    look
}

fn patterned(draws: &mut Draws, words: &mut Draws) -> PaintedMaterial {
    let (a, b) = palette::pair(draws);
    let (ra, rb) = (finish(draws), finish(draws));
    let mut look = PaintedMaterial {
        name: "pattern",
        base: Coat::new(a, a.map(|x| 0.85 * x), [ra, ra * 0.9], 0.0),
        over: vec![(two_sided(draws), 1.0, Coat::new(b, b.map(|x| 0.85 * x), [rb, rb * 0.9], 0.0))],
    };
    if draws.chance(0.35) {
        let ink = Coat::plain(palette::dark(draws), 0.4, 0.0);
        let paper = Coat::plain(palette::light(draws), 0.5, 0.0);
        let accent = Coat::plain(palette::any(draws), 0.4, 0.0);
        labels(&mut look, draws, words, paper, ink, accent);
    }
    look
}

fn wood(draws: &mut Draws) -> PaintedMaterial {
    let (light, dark) = palette::wood(draws);
    let r = draws.range(0.3, 0.75);
    let off = [draws.range(-0.3, 0.3), draws.range(-0.3, 0.3), draws.range(-0.3, 0.3)];
    let axis = if draws.chance(0.6) { [0.0, 0.0, 1.0] } else { draws.direction() };
    let rings = Pattern::Rings { axis, off, frequency: draws.range(10.0, 26.0), sway: draws.range(0.3, 1.2) };
    let base = Coat::new(light, light.map(|x| 0.88 * x), [r, r + 0.1], 0.0).grain(14.0);
    let over = Coat::new(dark, dark.map(|x| 0.85 * x), [r + 0.1, r + 0.15], 0.0).grain(20.0);
    PaintedMaterial { name: "wood", base, over: vec![(rings, 0.85, over)] }
}

fn stone(draws: &mut Draws, words: &mut Draws) -> PaintedMaterial {
    let (ground, vein) = palette::stone(draws);
    let r = draws.range(0.08, 0.5);
    let veins = Pattern::Veins {
        along: draws.direction(),
        frequency: draws.range(3.0, 7.0),
        sway: draws.range(2.0, 4.5),
        sharp: draws.range(0.15, 0.7),
    };
    let base = Coat::new(ground, ground.map(|x| 0.82 * x), [r, r], 0.0);
    let coat = Coat::new(vein, vein.map(|x| 0.8 * x), [r, r + 0.1], 0.0);
    let mut look = PaintedMaterial { name: "stone", base, over: vec![(veins, 0.8, coat)] };
    if draws.chance(0.25) {
        let gold = Coat::plain(palette::metal(draws), 0.2, 1.0);
        print(&mut look, draws, words, gold.clone(), gold);
    }
    look
}

fn metal(draws: &mut Draws) -> PaintedMaterial {
    let c = palette::metal(draws);
    let r = draws.range(0.08, 0.45);
    let base = Coat::new(c, c.map(|x| 0.94 * x), [r, r * 1.25], 1.0).grain(draws.range(2.0, 10.0));
    let mut over = Vec::new();
    if draws.chance(0.6) {
        let deep = Coat::plain(c.map(|x| 0.85 * x), crate::space::smaller(r + 0.25, 0.7), 1.0);
        over.push((scratches(draws), 0.8, deep));
    }
    if draws.chance(0.3) {
        let stain = Coat::plain(c.map(|x| 0.7 * x), crate::space::smaller(r + 0.3, 0.8), 1.0);
        over.push((worn(draws, 0.1), 0.7, stain));
    }
    PaintedMaterial { name: "metal", base, over }
}

fn mirror(draws: &mut Draws, words: &mut Draws) -> PaintedMaterial {
    let c = palette::metal(draws);
    let base = Coat::plain(c, draws.range(0.02, 0.05), 1.0);
    let mut look = PaintedMaterial { name: "mirror", base, over: Vec::new() };
    if draws.chance(0.5) {
        let paint = Coat::plain(palette::any(draws), finish(draws), 0.0);
        if draws.chance(0.5) {
            look.over.push((two_sided(draws), 1.0, paint));
        } else {
            print(&mut look, draws, words, paint.clone(), paint);
        }
    }
    look
}

fn inlaid(draws: &mut Draws) -> PaintedMaterial {
    let (metal, paint) = (palette::metal(draws), palette::any(draws));
    let (rm, rp) = (draws.range(0.08, 0.4), finish(draws));
    let (a, b) =
        (Coat::new(metal, metal.map(|x| 0.92 * x), [rm, rm * 1.3], 1.0), Coat::plain(paint, rp, 0.0));
    let (base, coat) = if draws.chance(0.5) { (a, b) } else { (b, a) };
    let mut over = vec![(two_sided(draws), 1.0, coat)];
    if draws.chance(0.3) {
        over.push((scratches(draws), 0.5, Coat::plain(metal.map(|x| 0.8 * x), 0.5, 1.0)));
    }
    PaintedMaterial { name: "inlay", base, over }
}

fn rusty(draws: &mut Draws) -> PaintedMaterial {
    let c = palette::metal(draws);
    let r = draws.range(0.2, 0.5);
    let rust = Coat::new([0.47, 0.24, 0.11], [0.26, 0.14, 0.09], [0.85, 0.95], 0.0).grain(30.0);
    let paint = Coat::plain(palette::any(draws), draws.range(0.2, 0.5), 0.0);
    let level = draws.range(-0.1, 0.12);
    let rim = worn(draws, level);
    let Pattern::Patches { frequency, octaves, .. } = rim else { return metal(draws) };
    let inner = Pattern::Patches { frequency, octaves, level: level + 0.06, soft: 0.05 };
    let is_painted = draws.chance(0.5);
    let base = if is_painted { paint } else { Coat::new(c, c.map(|x| 0.8 * x), [r, r + 0.2], 1.0) };
    let bare = Coat::plain(c.map(|x| 0.75 * x), 0.5, 1.0);
    PaintedMaterial { name: "rust", base, over: vec![(rim, 1.0, bare), (inner, 1.0, rust)] }
}

fn masonry(draws: &mut Draws) -> PaintedMaterial {
    let (a, b) = palette::stone(draws);
    let brick = if draws.chance(0.5) { palette::brick(draws) } else { palette::any(draws) };
    let width = draws.range(0.08, 0.2);
    let height = width * draws.pick(&[0.4, 0.5, 1.0, 1.0]);
    let r = finish(draws);
    let joints = Pattern::Joints { width, height, joint: width * draws.range(0.04, 0.1) };
    let base = Coat::new(brick, brick.map(|x| 0.7 * x), [r, crate::space::smaller(r + 0.1, 1.0)], 0.0)
        .grain(draws.range(5.0, 25.0));
    PaintedMaterial {
        name: "masonry",
        base,
        over: vec![(joints, 1.0, Coat::new(a, b, [0.9, 1.0], 0.0).grain(20.0))],
    }
}

fn cloth(draws: &mut Draws) -> PaintedMaterial {
    let (a, b) = palette::pair(draws);
    let period = draws.range(0.08, 0.3);
    let shares =
        [draws.range(0.2, 0.6), draws.range(0.03, 0.1), draws.range(0.1, 0.9), draws.range(0.3, 1.0)];
    let weave = Pattern::Checks { size: draws.range(0.004, 0.008) };
    let shade = Coat::plain(palette::dark(draws), 1.0, 0.0);
    PaintedMaterial {
        name: "cloth",
        base: Coat::plain(a, draws.range(0.8, 1.0), 0.0),
        over: vec![
            (Pattern::Plaid { period, shares }, 1.0, Coat::plain(b, 0.9, 0.0)),
            (weave, draws.range(0.08, 0.3), shade),
        ],
    }
}

fn printed(draws: &mut Draws, words: &mut Draws) -> PaintedMaterial {
    let (a, b) = palette::pair(draws);
    let r = draws.range(0.15, 0.6);
    let mut look = PaintedMaterial { name: "print", base: Coat::plain(a, r, 0.0), over: Vec::new() };
    if draws.chance(0.5) {
        look.over.push((two_sided(draws), 1.0, Coat::plain(b, r, 0.0)));
    }
    let is_light = draws.chance(0.7);
    let paper = if is_light { palette::light(draws) } else { palette::dark(draws) };
    let ink = if is_light { palette::dark(draws) } else { palette::light(draws) };
    let accent = if draws.chance(0.15) {
        Coat::plain(palette::metal(draws), 0.2, 1.0)
    } else {
        Coat::plain(palette::vivid(draws), r, 0.0)
    };
    labels(&mut look, draws, words, Coat::plain(paper, r, 0.0), Coat::plain(ink, r, 0.0), accent);
    look
}

fn pages(draws: &mut Draws) -> PaintedMaterial {
    let paper = [0.93, 0.9, 0.82];
    let lines = Pattern::Stripes { along: [0.0, 0.0, 1.0], period: 0.006, share: 0.4 };
    let base = Coat::plain(paper, 0.9, 0.0);
    let shade = Coat::plain(palette::dark(draws), 1.0, 0.0);
    PaintedMaterial { name: "paper", base, over: vec![(lines, 0.25, shade)] }
}

fn terrazzo(draws: &mut Draws) -> PaintedMaterial {
    let (ground, other) = palette::stone(draws);
    let r = draws.range(0.1, 0.45);
    let size = draws.range(0.05, 0.12);
    let mut over = vec![
        (Pattern::Chips { size, share: 0.3 }, 1.0, Coat::plain(palette::any(draws), r, 0.0)),
        (Pattern::Chips { size, share: 0.14 }, 1.0, Coat::plain(other, r, 0.0)),
    ];
    if draws.chance(0.4) {
        over.push((Pattern::Chips { size, share: 0.06 }, 1.0, Coat::plain(palette::metal(draws), 0.15, 1.0)));
    }
    over.push((Pattern::Cracks { size, width: draws.range(0.003, 0.01) }, 1.0, Coat::plain(ground, r, 0.0)));
    PaintedMaterial { name: "terrazzo", base: Coat::new(ground, ground.map(|x| 0.88 * x), [r, r], 0.0), over }
}
