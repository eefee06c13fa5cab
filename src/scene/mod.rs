//! Validated, typed scenes. Level 3: the last place that returns data errors.
//!
//! ```text
//! io (plain records) ──► scene ──► splat, fit, …
//! camera     one pinhole, orthographic or fisheye view      profile    the constants of a splatting semantics
//! gaussians  stored, unconstrained parameters of a scene    views      photographs with cameras, undistorted
//! ```

pub mod camera;
pub mod gaussians;
pub mod profile;
