//! Colours, sRGB-encoded.

use crate::draws::Draws;
use crate::space::clamp;

/// An sRGB-encoded colour, 0..1.
pub(super) type Rgb = [f64; 3];

/// Converts hue (turns), saturation and value.
fn hsv(h: f64, s: f64, v: f64) -> Rgb {
    [5.0, 3.0, 1.0].map(|n: f64| {
        let k = n + 6.0 * h;
        let k = k - 6.0 * (k / 6.0).floor();
        let t = clamp(crate::space::smaller(k, 4.0 - k), 0.0, 1.0);
        v * (1.0 - s * t)
    })
}

/// Any paint: vivid, muted, pastel, grey, nearly white or black.
pub(super) fn any(draws: &mut Draws) -> Rgb {
    let h = draws.unit();
    match draws.weighted(&[3.0, 2.5, 1.5, 1.0, 0.8, 0.6]) {
        0 => hsv(h, draws.range(0.7, 0.95), draws.range(0.55, 0.95)),
        1 => hsv(h, draws.range(0.25, 0.6), draws.range(0.35, 0.75)),
        2 => hsv(h, draws.range(0.12, 0.35), draws.range(0.8, 0.95)),
        3 => hsv(h, draws.range(0.0, 0.08), draws.range(0.3, 0.8)),
        4 => light(draws),
        _ => dark(draws),
    }
}

pub(super) fn vivid(draws: &mut Draws) -> Rgb {
    hsv(draws.unit(), draws.range(0.65, 0.95), draws.range(0.6, 0.95))
}

pub(super) fn light(draws: &mut Draws) -> Rgb {
    hsv(draws.unit(), draws.range(0.0, 0.12), draws.range(0.85, 0.95))
}

pub(super) fn dark(draws: &mut Draws) -> Rgb {
    hsv(draws.unit(), draws.range(0.0, 0.5), draws.range(0.12, 0.28))
}

fn brightness(c: Rgb) -> f64 {
    0.3 * c[0] + 0.6 * c[1] + 0.1 * c[2]
}

/// Two paints that differ clearly in brightness or hue.
pub(super) fn pair(draws: &mut Draws) -> (Rgb, Rgb) {
    let a = any(draws);
    let b = any(draws);
    let distance = (0..3).fold(0.0, |s, k| s + (a[k] - b[k]).abs());
    if distance > 0.6 {
        (a, b)
    } else if brightness(a) > 0.5 {
        (a, dark(draws))
    } else {
        (a, light(draws))
    }
}

/// Reflectance of metals at normal incidence, some of them tinted.
pub(super) fn metal(draws: &mut Draws) -> Rgb {
    const METALS: [Rgb; 9] = [
        [1.0, 0.87, 0.58],
        [0.97, 0.82, 0.75],
        [0.96, 0.96, 0.97],
        [0.98, 0.97, 0.94],
        [0.77, 0.78, 0.79],
        [0.93, 0.82, 0.6],
        [0.76, 0.73, 0.69],
        [0.8, 0.82, 0.84],
        [0.66, 0.66, 0.68],
    ];
    if draws.chance(0.2) {
        return hsv(draws.unit(), draws.range(0.3, 0.7), draws.range(0.65, 0.95));
    }
    draws.pick(&METALS)
}

/// Colours of early and late wood.
pub(super) fn wood(draws: &mut Draws) -> (Rgb, Rgb) {
    const WOODS: [(Rgb, Rgb); 6] = [
        ([0.8, 0.62, 0.42], [0.62, 0.43, 0.26]),
        ([0.87, 0.75, 0.57], [0.75, 0.59, 0.4]),
        ([0.55, 0.36, 0.22], [0.35, 0.21, 0.13]),
        ([0.42, 0.27, 0.2], [0.25, 0.15, 0.11]),
        ([0.68, 0.38, 0.22], [0.5, 0.24, 0.13]),
        ([0.62, 0.55, 0.47], [0.45, 0.39, 0.33]),
    ];
    draws.pick(&WOODS)
}

/// Colours of ground and vein.
pub(super) fn stone(draws: &mut Draws) -> (Rgb, Rgb) {
    const STONES: [(Rgb, Rgb); 7] = [
        ([0.92, 0.91, 0.88], [0.5, 0.5, 0.52]),
        ([0.16, 0.16, 0.18], [0.82, 0.8, 0.76]),
        ([0.2, 0.38, 0.3], [0.75, 0.82, 0.74]),
        ([0.75, 0.58, 0.48], [0.92, 0.86, 0.78]),
        ([0.6, 0.58, 0.55], [0.38, 0.36, 0.35]),
        ([0.5, 0.2, 0.18], [0.85, 0.75, 0.7]),
        ([0.83, 0.75, 0.58], [0.55, 0.42, 0.26]),
    ];
    draws.pick(&STONES)
}

pub(super) fn brick(draws: &mut Draws) -> Rgb {
    [draws.range(0.5, 0.7), draws.range(0.25, 0.36), draws.range(0.18, 0.28)]
}
