//! Images of a ball in closed form, with all passes, as the targets of a fit of a field: no random numbers, no library
//! functions but square roots, so that they have the same bits everywhere.

use lastlight::fit::field::targets::{Picture, Target, Targets};
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::field::Placement;
use lastlight::scene::passes::PassImages;

/// Centre of the ball.
pub(crate) const CENTER: [f32; 3] = [0.05, -0.03, 0.02];
/// Its radius; the box of a field has the half size 0.525.
pub(crate) const RADIUS: f32 = 0.35;
/// Directions from the origin to the cameras.
const TOWARDS: [[f32; 3]; 8] = [
    [2.0, 1.0, 1.0],
    [-1.0, 2.0, 1.0],
    [-2.0, -1.0, 1.0],
    [1.0, -2.0, 1.0],
    [1.0, 1.0, 2.0],
    [-1.0, 1.0, -2.0],
    [1.0, -1.0, -2.0],
    [2.0, -1.0, -1.0],
];
/// Distance of the cameras from the origin.
const DISTANCE: f32 = 1.6;
/// Positions in a pixel that are averaged.
const INSIDE: [[f32; 2]; 4] = [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]];

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: [f32; 3]) -> [f32; 3] {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}

/// Camera `k` of 8, directed at the origin; images of `side`² pixels.
pub(crate) fn camera(k: usize, side: usize) -> Camera {
    let back = unit(TOWARDS[k]);
    let forward = back.map(|x| -x);
    let right = unit(cross(forward, [0.0, 0.0, 1.0]));
    let rotation = [right, cross(forward, right), forward];
    let eye = back.map(|x| DISTANCE * x);
    let half = 0.5 * side as f32;
    Camera {
        rotation,
        translation: std::array::from_fn(|i| -dot(rotation[i], eye)),
        focal_px: [1.3 * side as f32; 2],
        center_px: [half; 2],
        width: side,
        height: side,
        model: Model::Pinhole,
    }
}

/// Distance and unit normal where a ray meets the ball.
fn hit((origin, direction): ([f32; 3], [f32; 3])) -> Option<(f32, [f32; 3])> {
    let from: [f32; 3] = std::array::from_fn(|k| origin[k] - CENTER[k]);
    let along = dot(from, direction);
    let inside = along * along - (dot(from, from) - RADIUS * RADIUS);
    if !(inside > 0.0) {
        return None;
    }
    let t = -along - inside.sqrt();
    Some((t, std::array::from_fn(|k| (from[k] + t * direction[k]) / RADIUS)))
}

/// Albedo, sRGB-encoded.
fn albedo(n: [f32; 3]) -> [f32; 3] {
    n.map(|x| 0.5 + 0.4 * x)
}

/// Colour: the albedo under a light from above.
fn color(n: [f32; 3]) -> [f32; 3] {
    albedo(n).map(|x| x * (0.75 + 0.25 * n[2]))
}

/// Roughness and metallic: two halves.
fn material(n: [f32; 3]) -> [f32; 2] {
    if n[0] > 0.0 { [0.6, 0.0] } else { [0.3, 0.8] }
}

/// Mean over a pixel of what rays see, with ones where they miss; and the part that hits.
fn mean<const N: usize>(
    camera: &Camera,
    pixel: usize,
    seen: impl Fn([f32; 3]) -> [f32; N],
) -> ([f32; N], f32) {
    let (mut sum, mut hits) = ([0.0; N], 0.0);
    for [dx, dy] in INSIDE {
        let at = [(pixel % camera.width) as f32 + dx, (pixel / camera.width) as f32 + dy];
        let surface = camera.ray(at).and_then(hit);
        let value = surface.map_or([1.0; N], |(_, n)| seen(n));
        (0..N).for_each(|k| sum[k] += 0.25 * value[k]);
        hits += if surface.is_some() { 0.25 } else { 0.0 };
    }
    (sum, hits)
}

/// The image of camera `k` with its passes.
pub(crate) fn target(k: usize, side: usize) -> Target {
    let camera = camera(k, side);
    let pixels = side * side;
    let middle = |i: usize| camera.ray([(i % side) as f32 + 0.5, (i / side) as f32 + 0.5]).and_then(hit);
    let foreground: Vec<f32> = (0..pixels).map(|i| mean(&camera, i, color).1).collect();
    let is_solid = |i: usize| {
        let (x, y) = (i % side, i / side);
        let inner = x > 0 && y > 0 && x + 1 < side && y + 1 < side;
        inner && (y - 1..y + 2).all(|r| (x - 1..x + 2).all(|c| foreground[r * side + c] == 1.0))
    };
    let forward = camera.rotation[2];
    let depth = |i: usize| {
        let at = [(i % side) as f32 + 0.5, (i / side) as f32 + 0.5];
        let along = camera.ray(at).map_or(0.0, |(_, d)| dot(d, forward));
        middle(i).map_or(0.0, |(t, _)| t * along)
    };
    Target {
        name: format!("{k:04}.png"),
        color: (0..pixels).flat_map(|i| mean(&camera, i, color).0).collect(),
        kept: None,
        colored: None,
        albedo: Some((0..pixels).flat_map(|i| mean(&camera, i, albedo).0).collect()),
        material: Some((0..pixels).flat_map(|i| mean(&camera, i, material).0).collect()),
        normal: Some((0..pixels).flat_map(|i| middle(i).map_or([0.0; 3], |(_, n)| n)).collect()),
        solid: (0..pixels).map(|i| f32::from(u8::from(is_solid(i)))).collect(),
        depth: Some((0..pixels).map(depth).collect()),
        foreground,
        camera,
    }
}

/// Images of the first `views` cameras, the last one held out.
pub(crate) fn targets(views: usize, side: usize) -> Targets {
    let mut train: Vec<Target> = (0..views).map(|k| target(k, side)).collect();
    let test = train.split_off(views - 1);
    Targets { train, test, placement: Placement::default(), exposure: 1.0 }
}

/// Without the passes that a photo does not have.
pub(crate) fn without_passes(mut targets: Targets) -> Targets {
    for t in targets.train.iter_mut().chain(&mut targets.test) {
        (t.albedo, t.material, t.normal, t.depth) = (None, None, None, None);
        t.solid.fill(0.0);
    }
    targets
}

/// The image of camera `k` before it has a place in a field.
#[allow(dead_code, reason = "some tests have no use for it")]
pub(crate) fn picture(k: usize, side: usize) -> Picture {
    let Target { name, camera, color, foreground, kept, .. } = target(k, side);
    let passes = PassImages::default();
    Picture { name, camera, color, foreground, kept, colored: None, passes, environment: None }
}
