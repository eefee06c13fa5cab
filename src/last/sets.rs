//! Images and points of known causes, in shards.
//!
//! # Layout
//! ```text
//! template.npz                the points at rest, weights, bones
//! observational/0000.npz …    64 frames each, the last one fewer
//! interventions/0000.npz …    8 groups each
//! ```
//! `template.npz`: `points`, `normals` (P,3), `weights` (P,K), `bone` (P) i32, `parents` (K) i32 (−1: none),
//! `joints` (K,3), `rest` (K,4,4) world-from-bone at rest, `spacing` (P) mean distance to the three nearest
//! points, `sigma` (P) standard deviation of the isotropic Gaussians that represent the points, with opacity
//! [`figure::OPACITY`]; for a character also `focal` (1), the focal length of its camera in sides of an image
//! (the camera of the figure is always the same).
//!
//! A shard of N observational frames: `images` (N,S,S,3) u8 sRGB-encoded over black, `mask` (N,S,S) u8
//! coverage, `points`, `rgb` (N,P,3) f32 (figure frame; sRGB-encoded, shaded), `u`, `e` (N,n) f64,
//! `appearance`, `index` (N) i64.
//!
//! A shard of G groups of M bases: `target` (G) i32, `value` (G) f64, `appearance`, `index` (G) i64, `e`
//! (G,M,n) f64, and before (`base_`) and after (`after_`) the intervention `images` (G,M,S,S,3), `mask`
//! (G,M,S,S), `points`, `rgb` (G,M,P,3), `u` (G,M,n).
//!
//! A shard depends only on the settings and its number; it is written atomically.

use super::figure;
pub use super::image_source::{ImageSource, Surfaces};
use super::points::{Photo, Points, Rendering};
use crate::Result;
use crate::io::npz;
use crate::num::array::Arrays;
use crate::num::par;
use crate::scene::camera::Camera;
use crate::scene::mesh::Object;
use data_gen::figure::factors::Drive;
use data_gen::figure::mechanism::Scm;
use data_gen::figure::purpose::{PICTURE_AFTER, PICTURE_BASE, PICTURE_OBSERVED};
use data_gen::figure::samples::{self, BASES, Frame};

/// Number of observational frames of a shard.
pub const FRAMES_PER_SHARD: usize = 64;
/// Number of intervention groups of a shard.
pub const GROUPS_PER_SHARD: usize = 8;

/// Settings common to all frames of the sets.
pub struct RenderJob<'a> {
    /// The structural causal model.
    pub scm: &'a Scm,
    /// The subject of the images.
    pub sitter: &'a dyn ImageSource,
    /// Seed of the run.
    pub seed: u64,
    /// Number of appearances.
    pub appearances: usize,
    /// How the subject is rendered.
    pub look: Rendering,
    /// Side of an image in pixels.
    pub size: usize,
    /// Number of samples per pixel for surfaces.
    pub samples: u32,
}

/// Image and points of one frame.
struct Exposure {
    photo: Photo,
    points: Points,
}

impl RenderJob<'_> {
    /// `purpose` and `item` determine the light samples of the image.
    fn expose(
        &self,
        frame: &Frame,
        (purpose, item): (u16, u64),
        camera: &Camera,
        object: Option<Object>,
    ) -> Result<Exposure> {
        let points = self.sitter.points(frame)?;
        let photo = match object {
            None => self.sitter.dots().photo(&points, camera, self.look)?,
            Some(object) => {
                let seed = figure::picture_seed(self.seed, purpose, item);
                let azimuth = Drive::new(&frame.u).light_azimuth;
                figure::photo(&object, azimuth, camera, &figure::lighting(self.samples, seed))?
            }
        };
        Ok(Exposure { photo, points })
    }

    /// `purpose` and `first` as for [`Self::expose`]; items are numbered consecutively.
    fn expose_all(&self, frames: &[&Frame], purpose: u16, first: usize) -> Result<Vec<Exposure>> {
        let camera = self.sitter.camera(self.size);
        let surfaces = match self.look {
            Rendering::Mesh => Some(self.sitter.surfaces(frames)),
            Rendering::Discs | Rendering::Splats => None,
        };
        par::map(frames.len(), |i| {
            let object = surfaces.as_ref().map(|of| of(i)).transpose()?;
            self.expose(frames[i], (purpose, (first + i) as u64), &camera, object)
        })
        .into_iter()
        .collect()
    }

    /// Observational shard `shard` of a set of `count` frames.
    ///
    /// # Errors
    /// If an image cannot be rendered.
    pub fn observational(&self, shard: usize, count: usize) -> Result<Arrays> {
        let from = shard * FRAMES_PER_SHARD;
        let to = Ord::min(from + FRAMES_PER_SHARD, count);
        let frames: Vec<Frame> =
            (from..to).map(|i| samples::observed(self.scm, self.seed, i, count, self.appearances)).collect();
        let n = frames.len();
        let exposures = self.expose_all(&frames.iter().collect::<Vec<_>>(), PICTURE_OBSERVED, from)?;
        let mut arrays = Arrays::new();
        self.put_exposures(&mut arrays, "", &[n], &exposures);
        let factors = self.scm.graph.n();
        arrays.put("u", &[n, factors], frames.iter().flat_map(|f| f.u.clone()).collect());
        arrays.put("e", &[n, factors], frames.iter().flat_map(|f| f.e.clone()).collect());
        arrays.put("appearance", &[n], frames.iter().map(|f| f.appearance as i64).collect());
        arrays.put("index", &[n], (from as i64..to as i64).collect());
        Ok(arrays)
    }

    /// Intervention shard `shard` of a set of `count` groups.
    ///
    /// # Errors
    /// If an image cannot be rendered.
    pub fn interventions(&self, shard: usize, count: usize) -> Result<Arrays> {
        let from = shard * GROUPS_PER_SHARD;
        let to = Ord::min(from + GROUPS_PER_SHARD, count);
        let groups: Vec<samples::Group> =
            (from..to).map(|i| samples::group(self.scm, self.seed, i, self.appearances)).collect();
        let (g, factors) = (groups.len(), self.scm.graph.n());
        let mut arrays = Arrays::new();
        for (prefix, after, purpose) in [("base_", false, PICTURE_BASE), ("after_", true, PICTURE_AFTER)] {
            let frames: Vec<&Frame> =
                groups.iter().flat_map(|group| if after { &group.after } else { &group.bases }).collect();
            let exposures = self.expose_all(&frames, purpose, from * BASES)?;
            self.put_exposures(&mut arrays, prefix, &[g, BASES], &exposures);
            let u = frames.iter().flat_map(|f| f.u.clone()).collect();
            arrays.put(&format!("{prefix}u"), &[g, BASES, factors], u);
        }
        let e = groups.iter().flat_map(|group| &group.bases).flat_map(|f| f.e.clone()).collect();
        arrays.put("e", &[g, BASES, factors], e);
        arrays.put("target", &[g], groups.iter().map(|group| group.target as i32).collect());
        arrays.put("value", &[g], groups.iter().map(|group| group.value).collect());
        arrays.put("appearance", &[g], groups.iter().map(|x| x.bases[0].appearance as i64).collect());
        arrays.put("index", &[g], (from as i64..to as i64).collect());
        Ok(arrays)
    }

    fn put_exposures(&self, arrays: &mut Arrays, prefix: &str, lead: &[usize], exposures: &[Exposure]) {
        let (s, p) = (self.size, self.sitter.dots().spacing.len());
        let shape = |tail: &[usize]| -> Vec<usize> { lead.iter().chain(tail).copied().collect() };
        let bytes = |get: fn(&Photo) -> &Vec<u8>| -> Vec<u8> {
            exposures.iter().flat_map(|x| get(&x.photo).iter().copied()).collect()
        };
        let rows = |get: fn(&Points) -> &Vec<[f32; 3]>| -> Vec<f32> {
            exposures.iter().flat_map(|x| get(&x.points).iter().flatten().copied()).collect()
        };
        arrays.put(&format!("{prefix}images"), &shape(&[s, s, 3]), bytes(|x| &x.image));
        arrays.put(&format!("{prefix}mask"), &shape(&[s, s]), bytes(|x| &x.mask));
        arrays.put(&format!("{prefix}points"), &shape(&[p, 3]), rows(|x| &x.points));
        arrays.put(&format!("{prefix}rgb"), &shape(&[p, 3]), rows(|x| &x.rgb));
    }
}

/// Contents of a shard or of the template as bytes.
///
/// # Errors
/// See [`npz::to_bytes`].
pub fn bytes(arrays: &Arrays) -> Result<Vec<u8>> {
    npz::to_bytes(arrays, npz::Packing::Stored)
}
