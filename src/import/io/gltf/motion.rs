//! Skins and animations.

use super::accessor::Cache;
use super::read::{Reader, named};
use super::{Animation, Channel, Interpolation, Matrix, Mesh, Path as Target, Skin};
use crate::Result;

impl Reader<'_> {
    pub(super) fn skins(&mut self) -> Result<()> {
        for s in self.document.skins() {
            let place = format!("skins[{}]", s.index());
            let joints: Vec<usize> = s.joints().map(|j| j.index()).collect();
            if joints.is_empty() || joints.len() > usize::from(u16::MAX) {
                return Err(self
                    .error(format!("{place}.joints"))
                    .expected("1 to 65535 joints")
                    .got(joints.len().to_string()));
            }
            let inverse_bind: Vec<Matrix> = match s.inverse_bind_matrices() {
                None => {
                    let one = |i, j| if i == j { 1.0 } else { 0.0 };
                    vec![std::array::from_fn(|i| std::array::from_fn(|j| one(i, j))); joints.len()]
                }
                Some(a) => {
                    let columns = self.buffers.floats::<16>(&a, "inverse bind matrices")?;
                    columns
                        .iter()
                        .map(|c| std::array::from_fn(|i| std::array::from_fn(|j| c[4 * j + i])))
                        .collect()
                }
            };
            if inverse_bind.len() < joints.len() {
                return Err(self
                    .error(format!("{place}.inverseBindMatrices"))
                    .expected(format!("{} matrices, one per joint", joints.len()))
                    .got(inverse_bind.len().to_string()));
            }
            for (i, m) in inverse_bind.iter().enumerate().take(joints.len()) {
                let last = [0.0, 0.0, 0.0, 1.0];
                let affine = (0..4).all(|k| (m[3][k] - last[k]).abs() <= 1e-5);
                let [a, b, c] = [m[0], m[1], m[2]].map(|r| r.map(f64::from));
                let det = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
                    + a[2] * (b[0] * c[1] - b[1] * c[0]);
                if !(affine && det != 0.0) {
                    return Err(self
                        .error(format!("{place}, inverse bind matrix {i}"))
                        .expected("an invertible affine matrix")
                        .got(format!("{m:?}")));
                }
            }
            let inverse_bind = inverse_bind.into_iter().take(joints.len()).collect();
            self.out.skins.push(Skin { name: named(s.name(), "skin", s.index()), joints, inverse_bind });
        }
        for (i, n) in self.out.nodes.iter().enumerate() {
            if let (Some(skin), Some(mesh)) = (n.skin, n.mesh) {
                self.weights(i, &self.out.skins[skin], &self.out.meshes[mesh])?;
            }
        }
        Ok(())
    }

    /// Joints must exist, weights must be weights.
    fn weights(&self, node: usize, skin: &Skin, mesh: &Mesh) -> Result<()> {
        for (k, p) in mesh.primitives.iter().enumerate() {
            for v in 0..p.positions.len() {
                let place = || format!("nodes[{node}], mesh '{}', primitive {k}, vertex {v}", mesh.name);
                let mut sum = 0.0f64;
                for (joints, weights) in p.joints.iter().zip(&p.weights) {
                    for (&j, &w) in joints[v].iter().zip(&weights[v]) {
                        if !(w >= 0.0) {
                            return Err(self.error(place()).expected("weights ≥ 0").got(w.to_string()));
                        }
                        // The joint of a zero weight is padding.
                        if w > 0.0 && usize::from(j) >= skin.joints.len() {
                            let e = self.error(place());
                            return Err(e
                                .expected(format!("joints below {}", skin.joints.len()))
                                .got(j.to_string()));
                        }
                        sum = sum + f64::from(w);
                    }
                }
                // Quantised weights of four sets may be off by 16·½/255.
                if !p.joints.is_empty() && !((sum - 1.0).abs() <= 0.04) {
                    let e = self.error(place()).expected("weights that sum to 1").got(sum.to_string());
                    return Err(e.hint("normalise the weights on export"));
                }
            }
        }
        Ok(())
    }

    pub(super) fn animations(&mut self) -> Result<()> {
        use gltf::animation::{Interpolation as I, Property};
        let document = self.document;
        let mut cache = Cache::default();
        for a in document.animations() {
            let (mut channels, samplers) = (Vec::new(), a.samplers().count());
            for c in a.channels() {
                let place = format!("animations[{}].channels[{}]", a.index(), c.index());
                let json = &document.as_json().animations[a.index()].channels[c.index()];
                if json.sampler.value() >= samplers {
                    let e = self.error(format!("{place}.sampler"));
                    return Err(e
                        .expected(format!("below {samplers}"))
                        .got(json.sampler.value().to_string()));
                }
                if json.target.node.value() >= self.out.nodes.len() {
                    let e = self.error(format!("{place}.target.node"));
                    return Err(e
                        .expected(format!("below {}", self.out.nodes.len()))
                        .got(json.target.node.value().to_string()));
                }
                let sampler = c.sampler();
                let path = match c.target().property() {
                    Property::Translation => Target::Translation,
                    Property::Rotation => Target::Rotation,
                    Property::Scale => Target::Scale,
                    Property::MorphTargetWeights => {
                        self.note("animations of morph targets are not read".into());
                        continue;
                    }
                };
                let times = cache.get1(&self.buffers, &sampler.input())?;
                if times.is_empty() || times[0] < 0.0 || times.windows(2).any(|t| !(t[0] < t[1])) {
                    let e = self.error(format!("{place}, times"));
                    return Err(e
                        .expected("at least one, ≥ 0, strictly ascending")
                        .got(format!("{} keys", times.len())));
                }
                let values = if path == Target::Rotation {
                    cache.get4(&self.buffers, &sampler.output(), "rotations")?
                } else {
                    cache.padded(&self.buffers, &sampler.output())?
                };
                let interpolation = match sampler.interpolation() {
                    I::Step => Interpolation::Step,
                    I::Linear => Interpolation::Linear,
                    I::CubicSpline => Interpolation::Cubic,
                };
                let per_key = if interpolation == Interpolation::Cubic { 3 } else { 1 };
                if values.len() != per_key * times.len() {
                    let e = self.error(format!("{place}, values"));
                    return Err(e
                        .expected(format!("{} for {} keys", per_key * times.len(), times.len()))
                        .got(values.len().to_string()));
                }
                let zero = |i: usize| values[i * per_key + per_key / 2] == [0.0; 4];
                if path == Target::Rotation && (0..times.len()).any(zero) {
                    return Err(self.error(format!("{place}, values")).expected("quaternions").got("a zero"));
                }
                channels.push(Channel {
                    node: c.target().node().index(),
                    path,
                    interpolation,
                    times,
                    values,
                });
            }
            self.out.animations.push(Animation { name: named(a.name(), "animation", a.index()), channels });
        }
        Ok(())
    }
}
