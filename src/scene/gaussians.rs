//! A set of 3-D Gaussians as it is stored: unconstrained parameters, as in every 3DGS file.

/// Stored parameters of N Gaussians.
///
/// | field | shape | meaning |
/// |---|---|---|
/// | `means` | (N, 3) | centre, scene units |
/// | `quats` | (N, 4) | w, x, y, z; any length but zero |
/// | `scales_log` | (N, 3) | natural logarithm of the standard deviations |
/// | `opacity_logits` | (N) | logit of the opacity |
/// | `sh` | (N, K, 3) | spherical-harmonics coefficients of the sRGB-encoded colour, K = (degree+1)² |
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    /// (N, 3)
    pub means: Vec<[f32; 3]>,
    /// (N, 4) wxyz
    pub quats: Vec<[f32; 4]>,
    /// (N, 3)
    pub scales_log: Vec<[f32; 3]>,
    /// (N)
    pub opacity_logits: Vec<f32>,
    /// (N, K, 3) row-major
    pub sh: Vec<f32>,
    /// 0 to 3
    pub sh_degree: usize,
}

impl Gaussians {
    /// N.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// K = (degree+1)², coefficients per channel.
    pub fn sh_coefficients(&self) -> usize {
        (self.sh_degree + 1) * (self.sh_degree + 1)
    }
}
