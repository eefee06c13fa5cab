//! Whole images of a field.

use super::scene::Weights;
use crate::Result;
use crate::field::occupancy::Occupancy;
use crate::field::render::{self, Channels, Plan, Rays};
use crate::scene::camera::Camera;
use crate::scene::field::Field;

/// Rays of a camera, row by row.
#[derive(Clone, Debug, Default)]
pub struct RayList {
    /// (N, 3)
    pub origins: Vec<[f32; 3]>,
    /// (N, 3) unit length.
    pub directions: Vec<[f32; 3]>,
}

/// Far outside of every box: the origin of a ray for a pixel that a camera does not see.
const NOWHERE: [f32; 3] = [1e6; 3];

impl RayList {
    /// Appends the ray through the middle of a pixel.
    pub fn push(&mut self, camera: &Camera, pixel: usize) {
        let at = [(pixel % camera.width) as f32 + 0.5, (pixel / camera.width) as f32 + 0.5];
        let (origin, direction) = camera.ray(at).unwrap_or((NOWHERE, [1.0, 0.0, 0.0]));
        self.origins.push(origin);
        self.directions.push(direction);
    }

    /// Borrows the rays.
    pub fn borrowed(&self) -> Rays<'_> {
        Rays { origins: &self.origins, directions: &self.directions }
    }
}

/// Returns the rays of all pixels.
pub fn rays(camera: &Camera) -> RayList {
    let mut list = RayList::default();
    (0..camera.width * camera.height).for_each(|i| list.push(camera, i));
    list
}

/// Images of a field, row-major.
#[derive(Clone, Debug)]
pub struct Images {
    /// (H, W, Q) values over the background.
    pub values: Vec<f32>,
    /// Number of values Q.
    pub count: usize,
    /// Where they are.
    pub channels: Channels,
    /// (H, W)
    pub opacity: Vec<f32>,
    /// (H, W, 3) surface points in the units of the field.
    pub points: Vec<[f32; 3]>,
    /// (H, W, 3) numerical normals, 0 where there is no surface.
    pub normals: Vec<[f32; 3]>,
    /// Number of samples that were taken.
    pub samples: usize,
}

impl Images {
    /// Returns N of the values of every pixel, (H, W, N).
    pub fn values_from(&self, first: usize, n: usize) -> Vec<f32> {
        self.values.chunks_exact(self.count).flat_map(|v| v[first..first + n].iter().copied()).collect()
    }

    /// Returns the colours, limited to 0..1.
    pub fn color(&self) -> Option<Vec<f32>> {
        let all = self.values_from(self.channels.color?, 3);
        Some(all.into_iter().map(|x| crate::num::order::clamp(x, 0.0, 1.0)).collect())
    }
}

/// Cells per axis of the grid with which whole images are rendered.
const SIDE: usize = 128;

/// Returns the cells of a field in which rays take samples.
///
/// # Errors
/// When a value of the field is not finite.
pub fn occupancy(field: &Field) -> Result<Occupancy> {
    super::occupied::filled(field, SIDE)
}

/// Renders a field from a camera in its units. With `normals`, the numerical ones at the surface points are computed.
pub fn render(field: &Field, cells: Option<&Occupancy>, camera: &Camera, normals: bool) -> Images {
    let list = rays(camera);
    let weights = Weights::of(field);
    let scene = weights.scene(list.borrowed());
    let intervals = match cells {
        Some(cells) => cells.intervals(scene.rays, scene.step()),
        None => scene.all_intervals(),
    };
    let mut plan = Plan::new(intervals);
    let out = render::forward(&scene, &mut plan);
    let mut made = Images {
        count: out.values.len() / Ord::max(out.opacity.len(), 1),
        values: out.values,
        channels: scene.channels(),
        points: out.points,
        normals: vec![[0.0; 3]; if normals { out.opacity.len() } else { 0 }],
        opacity: out.opacity,
        samples: plan.taken(),
    };
    if normals {
        let valid: Vec<usize> =
            (0..made.opacity.len()).filter(|i| made.opacity[*i] > render::VALID).collect();
        let points: Vec<[f32; 3]> = valid.iter().map(|i| made.points[*i]).collect();
        if !points.is_empty() {
            let at = super::surface::Stencils::at(field, &points);
            valid.iter().zip(at.normals).for_each(|(i, n)| made.normals[*i] = n);
        }
    }
    made
}
