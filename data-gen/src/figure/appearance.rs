//! The appearance of a person: skin, hair, clothes. It is drawn from a seed; the only factor that affects it
//! is the hue of the cloth.

use super::purpose;
use super::skeleton::{FOREARM, HEAD, LEFT, METRES, SHIN, SKIRT_RING, THIGH, TORSO, UPPER_ARM, V3};
use reference::num::rng::{Key, uniform_f64};
use reference::scalar::Scalar;
use std::f64::consts::TAU;

/// An sRGB-encoded colour, 0..1.
pub type Rgb = [f64; 3];

/// Pattern of the shirt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// A single colour.
    Plain,
    /// Horizontal stripes.
    Stripes,
    /// Checks.
    Checks,
    /// A disc with a star on the chest.
    Print,
}

/// The garment that covers the legs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bottom {
    /// A skirt over bare legs.
    Skirt,
    /// Trousers.
    Trousers,
}

/// The appearance of a person.
#[derive(Clone, Debug, PartialEq)]
pub struct Appearance {
    /// Colour of the skin.
    pub skin: Rgb,
    /// Colour of hair and brows.
    pub hair: Rgb,
    /// Whether the hair reaches the shoulders.
    pub long_hair: bool,
    /// Colour of the irises.
    pub eyes: Rgb,
    /// Pattern of the shirt.
    pub pattern: Pattern,
    /// Main colour of the shirt.
    pub shirt: Rgb,
    /// Second colour of the shirt.
    pub accent: Rgb,
    /// Whether the sleeves reach the wrists.
    pub long_sleeves: bool,
    /// Skirt or trousers.
    pub bottom: Bottom,
    /// Colour of the skirt or trousers.
    pub cloth: Rgb,
    /// Colour of the shoes.
    pub shoes: Rgb,
    /// Two phases of the finer folds, rad.
    pub fold_phases: [f64; 2],
}

const SKINS: [Rgb; 5] =
    [[0.95, 0.80, 0.70], [0.88, 0.70, 0.57], [0.76, 0.57, 0.43], [0.58, 0.41, 0.30], [0.40, 0.27, 0.20]];
const HAIRS: [Rgb; 6] = [
    [0.11, 0.09, 0.08],
    [0.25, 0.16, 0.10],
    [0.42, 0.27, 0.15],
    [0.76, 0.60, 0.35],
    [0.55, 0.24, 0.12],
    [0.62, 0.61, 0.60],
];
const EYES: [Rgb; 4] = [[0.24, 0.16, 0.10], [0.30, 0.42, 0.55], [0.30, 0.42, 0.28], [0.36, 0.27, 0.17]];
const BOTTOMS: [Rgb; 6] = [
    [0.20, 0.25, 0.38],
    [0.30, 0.30, 0.32],
    [0.55, 0.47, 0.36],
    [0.42, 0.20, 0.24],
    [0.22, 0.36, 0.32],
    [0.62, 0.60, 0.56],
];
const SHOES: [Rgb; 4] = [[0.14, 0.13, 0.13], [0.36, 0.23, 0.15], [0.82, 0.80, 0.77], [0.50, 0.16, 0.15]];

/// A saturated colour of the colour wheel, turn 0..1.
fn wheel(turn: f64, low: f64, high: f64) -> Rgb {
    [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|offset| {
        let wave = 0.5 + 0.5 * reference::num::elem::cos(TAU * (turn - offset));
        low + (high - low) * wave
    })
}

impl Appearance {
    /// The appearance with number `index` for a run's seed.
    pub fn new(seed: u64, index: u64) -> Self {
        let draw =
            |draw: u16| uniform_f64(Key { seed, item: index, step: 0, purpose: purpose::APPEARANCE, draw });
        let pick = |palette: &[Rgb], k: u16| palette[(draw(k) * palette.len() as f64) as usize];
        // Skin colours are interpolated between neighbours of the palette.
        let place = draw(0) * (SKINS.len() - 1) as f64;
        let (near, share) = (place as usize, place - (place as usize) as f64);
        let skin = std::array::from_fn(|c| SKINS[near][c] + share * (SKINS[near + 1][c] - SKINS[near][c]));
        let hue = draw(5);
        let light_ground = draw(6) < 0.5;
        let shirt = if light_ground { wheel(hue, 0.72, 0.95) } else { wheel(hue, 0.16, 0.72) };
        let other = hue + 0.3 + 0.4 * draw(7);
        let accent = if light_ground { wheel(other, 0.12, 0.60) } else { wheel(other, 0.70, 0.96) };
        let patterns = [Pattern::Plain, Pattern::Stripes, Pattern::Checks, Pattern::Print];
        Self {
            skin,
            hair: pick(&HAIRS, 1),
            long_hair: draw(2) < 0.5,
            eyes: pick(&EYES, 3),
            pattern: patterns[(draw(4) * 4.0) as usize],
            shirt,
            accent,
            long_sleeves: draw(8) < 0.4,
            bottom: if draw(9) < 0.5 { Bottom::Skirt } else { Bottom::Trousers },
            cloth: pick(&BOTTOMS, 10),
            shoes: pick(&SHOES, 11),
            fold_phases: [TAU * draw(12), TAU * draw(13)],
        }
    }

    /// Colour of the shirt at a turn around the body (½ in front), a height in metres, and a girth in metres.
    pub fn shirt_at(&self, turn: f64, height: f64, girth: f64) -> Rgb {
        let fraction = |x: f64| x - x.floor();
        let in_stripe = |x: f64, period: f64| fraction(x / period) < 0.42;
        let accent = match self.pattern {
            Pattern::Plain => false,
            Pattern::Stripes => in_stripe(height, 0.075),
            Pattern::Checks => {
                // An integer number of squares fits around.
                let squares = (girth / 0.075 + 0.5).floor();
                in_stripe(height, 0.075) != in_stripe(turn * squares * 0.075, 0.075)
            }
            Pattern::Print => {
                let (x, z) = ((turn - 0.5) * girth, height - 1.265);
                let r = (x * x + z * z).sqrt();
                // A five-pointed star cut out of a disc.
                let star = || {
                    let fifth = Scalar::atan2(x, z) * (5.0 / TAU);
                    let off = (fifth - (fifth + 0.5).floor()).abs();
                    0.062 * (1.0 - 1.15 * off)
                };
                (0.0..0.085).contains(&r) && r > star()
            }
        };
        if accent { self.accent } else { self.shirt }
    }

    /// Colour of a template point at rest on the capsule of a bone, and whether it is dyed cloth.
    pub fn point(&self, bone: usize, x: V3) -> (Rgb, bool) {
        let m = [METRES * x[0], METRES * x[1], METRES * x[2] + METRES];
        // ½ is in front, where y is negative.
        let turn = 0.5 + Scalar::atan2(m[0], -m[1]) / TAU;
        // Position along a limb, from its joint, in units of its length.
        let along = |from: V3, to: V3| {
            let side = [m[0].abs(), m[1], m[2]];
            let (d, p) = (super::skeleton::sub(to, from), super::skeleton::sub(side, from));
            super::skeleton::dot(d, p) / super::skeleton::dot(d, d)
        };
        let cloth = (self.cloth, true);
        let skin = (self.skin, false);
        match bone {
            0 | TORSO => (self.shirt_at(turn, m[2], 0.95), true),
            HEAD => {
                let is_hair = m[2] > 1.66 || (m[1] > 0.0 && m[2] > 1.5);
                (if is_hair { self.hair } else { self.skin }, false)
            }
            b if (UPPER_ARM..FOREARM).contains(&b) => {
                let sleeve = self.long_sleeves || along(LEFT[0], LEFT[1]) < 0.65;
                if sleeve { (self.shirt_at(turn, m[2], 0.95), true) } else { skin }
            }
            b if (FOREARM..THIGH).contains(&b) => {
                let sleeve = self.long_sleeves && along(LEFT[1], LEFT[2]) < 0.68;
                if sleeve { (self.shirt, true) } else { skin }
            }
            b if (THIGH..SHIN).contains(&b) => match self.bottom {
                Bottom::Trousers => cloth,
                Bottom::Skirt => skin,
            },
            SKIRT_RING => match self.bottom {
                Bottom::Skirt => cloth,
                Bottom::Trousers => (self.shirt, true),
            },
            _ => {
                if m[2] < 0.09 {
                    (self.shoes, false)
                } else if self.bottom == Bottom::Trousers {
                    cloth
                } else {
                    skin
                }
            }
        }
    }
}
