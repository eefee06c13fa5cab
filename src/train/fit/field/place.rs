//! The box of an object, from its foreground in all images.
//!
//! The centre is the point nearest to the optical axes. The radius is that of the smallest sphere there whose outline covers
//! the foreground of every image: the largest distance of a foreground ray from the centre. Centre and radius become the
//! origin and ½; the box is a twentieth larger. Images of `lirm gen` have this form already and are used as they are.
//!
//! The axes are those of the world, unless another pose is requested ([`posed`]).
//!
//! A grid of points in the sphere's cube serves as a check: if every point is background in some image that sees it,
//! cameras and foreground contradict each other.

use super::targets::Picture;
use crate::num::{order, par};
use crate::scene::bound::project;
use crate::scene::camera::Camera;
use crate::scene::field::Placement;
use crate::scene::placement::up;
use crate::scene::views::SceneBox;
use crate::{Error, Result};

/// Points of the grid along each axis.
const SIDE: usize = 64;
/// Coverage from which a pixel is foreground here.
const COVERED: f32 = 0.5;
/// Half size of the box as a factor of the radius.
const MARGIN: f64 = 1.05;

/// Distance of a point from the line of a ray.
fn distance(origin: [f32; 3], direction: [f32; 3], point: [f64; 3]) -> f64 {
    let to: [f64; 3] = std::array::from_fn(|k| point[k] - f64::from(origin[k]));
    let along = (0..3).fold(0.0, |sum, k| sum + to[k] * f64::from(direction[k]));
    let square = (0..3).fold(0.0, |sum, k| {
        let d = to[k] - along * f64::from(direction[k]);
        sum + d * d
    });
    square.sqrt()
}

/// Largest distance of a foreground ray from a point.
fn reach(pictures: &[&Picture], center: [f64; 3]) -> f64 {
    let of = |i: usize| {
        let p = pictures[i];
        let width = p.camera.width;
        let far = |most: f64, px: usize| {
            let at = [(px % width) as f32 + 0.5, (px / width) as f32 + 0.5];
            let ray = if p.foreground[px] >= COVERED { p.camera.ray(at) } else { None };
            ray.map_or(most, |(o, d)| order::max(most, distance(o, d, center)))
        };
        (0..p.foreground.len()).fold(0.0, far)
    };
    par::map(pictures.len(), of).into_iter().fold(0.0, order::max)
}

/// Whether an image sees a point as background. A pixel beside the foreground counts as foreground.
fn is_background(p: &Picture, point: [f64; 3]) -> bool {
    let (w, h) = (p.camera.width, p.camera.height);
    let Some([x, y]) = project(&p.camera, point) else { return false };
    if !(x >= 0.0 && y >= 0.0 && x < w as f64 && y < h as f64) {
        return false;
    }
    let (x, y) = (x as usize, y as usize);
    let rows = y.saturating_sub(1)..Ord::min(y + 2, h);
    !rows
        .into_iter()
        .any(|r| (x.saturating_sub(1)..Ord::min(x + 2, w)).any(|c| p.foreground[r * w + c] >= COVERED))
}

/// Whether there is a point that no image sees as background.
fn has_hull(pictures: &[&Picture], center: [f64; 3], radius: f64) -> bool {
    let at = |i: usize| -> [f64; 3] {
        let index = [i / (SIDE * SIDE), i / SIDE % SIDE, i % SIDE];
        std::array::from_fn(|k| center[k] + radius * (2.0 * (index[k] as f64 + 0.5) / SIDE as f64 - 1.0))
    };
    let kept =
        par::map_batched(SIDE * SIDE * SIDE, 1024, |i| !pictures.iter().any(|p| is_background(p, at(i))));
    kept.contains(&true)
}

/// Returns the box around the sphere whose outline covers the foreground of all images.
///
/// # Errors
/// When no image has foreground, or no point is foreground in all images that see it.
pub fn around(pictures: &[&Picture], center: [f64; 3]) -> Result<SceneBox> {
    let radius = reach(pictures, center);
    if !(radius > 0.0) {
        return Err(Error::input("foreground")
            .expected("pixels that show the object")
            .got("none in any training image")
            .hint("masks are 0 where the object is not; --box sets the box by hand"));
    }
    if !has_hull(pictures, center, radius) {
        return Err(Error::input("foreground")
            .expected("a place that no image sees as background")
            .got("none")
            .hint("check the camera poses and the masks, or set the box with --box"));
    }
    Ok(SceneBox { center, half_size: MARGIN * radius })
}

/// Returns the box of an object in the ball of radius ½ around the origin.
pub fn unit_ball() -> SceneBox {
    SceneBox { center: [0.0; 3], half_size: MARGIN * 0.5 }
}

/// How the axes of a field lie in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pose {
    /// Those of the world.
    #[default]
    World,
    /// z is that of the world, and the first camera is above the positive x axis.
    Azimuth,
    /// z is up, as it is in the images (the direction that is most nearly upright in all of them), and the first camera is above the positive
    /// x axis.
    Upright,
    /// Those of the first camera: to the right, down, forwards.
    FirstCamera,
}

impl Pose {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::World, Self::Azimuth, Self::Upright, Self::FirstCamera];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::World => "world",
            Self::Azimuth => "azimuth",
            Self::Upright => "upright",
            Self::FirstCamera => "first-camera",
        }
    }

    /// Returns the pose of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|pose| pose.name() == name)
    }
}

/// Returns the placement with its axes turned. DTC's code can turn the world by the inverse rotation of the first camera (whether LIRM did is not published); a model that was trained with
/// z up needs that direction.
///
/// # Errors
/// When the images do not show which direction is up.
pub fn posed(at: Placement, pose: Pose, cameras: &[&Camera]) -> Result<Placement> {
    let Some(first) = cameras.first().filter(|_| pose != Pose::World) else { return Ok(at) };
    let row = |c: &Camera, k: usize| c.rotation[k].map(f64::from);
    let up = match pose {
        Pose::FirstCamera => {
            let rotation = orthonormal([row(first, 0), row(first, 1), row(first, 2)]);
            return Ok(Placement { rotation, ..at });
        }
        Pose::Upright => upright(cameras).ok_or_else(|| {
            Error::input("--field-axes")
                .expected("images that show which direction is up")
                .got("cameras that are held in opposite ways")
        })?,
        _ => [0.0, 0.0, 1.0],
    };
    let eye = first.center().map(f64::from);
    let from: [f64; 3] = std::array::from_fn(|k| eye[k] - at.center[k]);
    let y = cross(up, from);
    // A camera straight above is above every axis.
    let is_above =
        (0..3).fold(0.0, |s, k| s + y[k] * y[k]) <= 1e-12 * (0..3).fold(0.0, |s, k| s + from[k] * from[k]);
    let y = if is_above {
        cross(up, if up[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] })
    } else {
        y
    };
    let rotation = orthonormal([cross(y, up), y, up]);
    Ok(Placement { rotation, ..at })
}

/// The direction of the world that is most nearly upright in all images, if they agree on one.
pub fn upright(cameras: &[&Camera]) -> Option<[f64; 3]> {
    let row = |c: &Camera, k: usize| c.rotation[k].map(f64::from);
    let directions: Vec<_> = cameras.iter().map(|c| (row(c, 0), row(c, 1).map(|x| -x))).collect();
    up(&directions)
}

/// Largest angle between z and the mean upright direction of cameras around an object: 20°, a choice.
const LEVEL: f64 = 0.94;
/// Largest angle between z and the mean upright direction of cameras that are not rolled about z: 60°, a choice.
const STEEP: f64 = 0.5;
/// Largest mean square of the sine of that roll: 20°, a choice.
const ROLL: f64 = 0.117;

/// The direction that is upright in the images, if they contradict that z is up.
///
/// Pitch does not: a camera that is held level and looks down at an object is upright about a direction that is
/// tilted by its pitch, and only around the object does the mean become z. So z is up if it is within 20° of that
/// mean, or within 60° where the horizontal axes of the cameras are level (within 20°, root mean square).
pub fn upright_beside_z(cameras: &[&Camera]) -> Option<[f64; 3]> {
    let square = |c: &&Camera| f64::from(c.rotation[0][2]) * f64::from(c.rotation[0][2]);
    let roll = cameras.iter().map(square).fold(0.0, |sum, x| sum + x) / Ord::max(cameras.len(), 1) as f64;
    upright(cameras).filter(|up| up[2] < if roll <= ROLL { STEEP } else { LEVEL })
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The last row, then the first two made orthogonal to it, all of unit length.
fn orthonormal(rows: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let unit = |x: [f64; 3]| {
        let length = ((x[0] * x[0] + x[1] * x[1]) + x[2] * x[2]).sqrt();
        x.map(|v| v / length)
    };
    let z = unit(rows[2]);
    let y = unit(cross(z, rows[0]));
    [cross(y, z), y, z]
}

/// Returns the placement of a field that fills a box.
pub fn placement(scene: &SceneBox) -> Placement {
    let half = f64::from(super::state::HALF_SIZE);
    Placement::new(scene.center, half / scene.half_size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::camera::Model;

    /// A camera at `eye` that is directed at the origin, with `up` upwards.
    fn looking(eye: [f64; 3], up: [f64; 3]) -> Camera {
        let [_, _, z] = orthonormal([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], eye.map(|x| -x)]);
        let rotation = orthonormal([cross(z, up), cross(z, cross(z, up)), z]);
        let mut m = [0.0; 16];
        for (i, r) in rotation.iter().enumerate() {
            (0..3).for_each(|k| m[4 * i + k] = r[k] as f32);
            m[4 * i + 3] = -((r[0] * eye[0] + r[1] * eye[1]) + r[2] * eye[2]) as f32;
        }
        m[15] = 1.0;
        Camera::from_matrices(&m, &[50.0, 0.0, 32.0, 0.0, 50.0, 32.0, 0.0, 0.0, 1.0], 64, 64, Model::Pinhole)
    }

    #[test]
    fn a_camera_that_looks_down_does_not_contradict_z() {
        let z = [0.0, 0.0, 1.0];
        let at = |azimuth: f64, pitch: f64| {
            [libm::cos(azimuth) * libm::cos(pitch), libm::sin(azimuth) * libm::cos(pitch), libm::sin(pitch)]
        };
        let is_up = |cameras: &[Camera]| upright_beside_z(&cameras.iter().collect::<Vec<_>>()).is_none();
        for pitch in [0.0, 0.35, 0.7, 1.0] {
            assert!(is_up(&[looking(at(0.4, pitch), z)]), "one camera, {pitch}");
            assert!(is_up(&[0.1, 0.5, 0.9].map(|a| looking(at(a, pitch), z))), "from one side, {pitch}");
            let turned = |k: i32| looking(at(f64::from(k), pitch), z);
            assert!(is_up(&(0..7).map(turned).collect::<Vec<_>>()), "around, {pitch}");
        }
        // y up, and a camera on its side.
        let up = [0.0, 1.0, 0.0];
        let around = |k: i32| {
            let a = f64::from(k);
            looking([libm::cos(a), 0.6, libm::sin(a)], up)
        };
        assert!(!is_up(&(0..7).map(around).collect::<Vec<_>>()));
        assert!(!is_up(&[looking([1.0, 0.3, 0.2], up)]));
        assert!(!is_up(&[looking([1.0, 0.1, 0.0], [0.0, 0.8, 0.6])]));
    }

    #[test]
    fn upright_axes_have_z_up_whatever_the_axes_of_the_capture() {
        // A capture with y down.
        let up = [0.0, -1.0, 0.0];
        let around = |i: i32| {
            let a = f64::from(i);
            looking([libm::cos(a) * 2.0, -0.7, libm::sin(a) * 2.0], up)
        };
        let cameras: Vec<Camera> = (0..7).map(around).collect();
        let at = Placement::new([0.1, 0.2, 0.3], 2.0);
        let of = |pose| posed(at, pose, &cameras.iter().collect::<Vec<_>>()).expect("they agree");
        assert_eq!(of(Pose::World), at);
        let found = super::upright(&cameras.iter().collect::<Vec<_>>()).expect("they agree");
        assert!(found[1] < -0.999, "{found:?}");
        let upright = of(Pose::Upright);
        let z = upright.direction_to_field(up);
        assert!(z[2] > 0.999, "{z:?}");
        let first = of(Pose::FirstCamera);
        let forward = first.direction_to_field(cameras[0].rotation[2].map(f64::from));
        assert!((forward[2] - 1.0).abs() < 1e-6, "{forward:?}");
        let azimuth = of(Pose::Azimuth);
        assert_eq!(azimuth.rotation[2], [0.0, 0.0, 1.0]);
        for (q, up) in [(upright, up), (azimuth, [0.0, 0.0, 1.0])] {
            let eye = q.to_field(cameras[0].center().map(f64::from));
            assert!(eye[0] > 0.5 && eye[1].abs() < 1e-5, "above the x axis: {eye:?}");
            assert!(q.direction_to_field(up)[2] > 0.999);
        }
        for q in [upright, azimuth, first] {
            let x = [0.3, -1.0, 2.0];
            let back = q.to_world(q.to_field(x));
            assert!(back.iter().zip(x).all(|(a, b)| (a - b).abs() < 1e-12), "{back:?}");
            let [a, b, c] = q.rotation;
            let right_handed = cross(a, b);
            assert!(right_handed.iter().zip(c).all(|(x, y)| (x - y).abs() < 1e-12), "a rotation");
        }
    }
}
