//! The avatar, a person that can be posed and rendered: canonical Gaussians attached to a body, and the
//! networks that correct skinning weights and poses.
//!
//! ```text
//! pose ──► rig: joints (corrected), weights (refined), offsets
//!      ──► place: posed centres and factors ──► draw: an image
//! ```
//!
//! The result of [`rig`](Avatar::rig) depends on the positions of the Gaussians only through the weights
//! network, which reads them without gradient. A rig is therefore computed once per iteration and used by
//! every render of that iteration.

use super::body::Body;
use super::light::{Light, Moment};
use super::mlp::{self, Mlp};
use super::pose::{self, CorrectedPose};
use super::settings::Settings;
use super::skin;
use crate::math::knn;
use crate::nn::softmax;
use crate::num::bits::Digest;
use crate::num::rng::Rng;
use crate::num::{elem, order, par};
use crate::scene::camera::Camera;
use crate::scene::gaussians::Gaussians;
use crate::scene::person::{Affine, Pose, Template};
use crate::shade::{diffuse, gain};
use crate::splat::color::Sh;
use crate::splat::render::{self, Color, Out, Saved, Shape};
use crate::splat::{activate, covariance};
use crate::{Error, Result};
use std::sync::Arc;

/// Purpose numbers of the draws.
const PURPOSE_COLOR: u16 = 0x0901;
const PURPOSE_WEIGHTS: u16 = 0x0902;
const PURPOSE_POSE: u16 = 0x0903;
/// Lower limit of the squared distance to neighbours from which an initial scale is computed.
const LEAST_SQUARE: f32 = 1e-7;
/// Keeps the logarithm of a zero weight finite.
const WEIGHT_FLOOR: f32 = 1e-9;
/// Number of octaves of the positional code.
const OCTAVES: usize = 10;
const CODE: usize = 3 + 6 * OCTAVES;
const WIDTH: usize = 128;
const CHUNK: usize = 256;

/// Canonical Gaussians attached to a body.
#[derive(Clone, Debug)]
pub struct Avatar {
    /// The body.
    pub body: Body,
    /// The Gaussians in the canonical pose.
    pub gaussians: Gaussians,
    /// Index of the nearest template point, found when the number of Gaussians last changed, shape (G).
    pub nearest: Vec<u32>,
    /// Skinning weights of that point, shape (G, K).
    base: Arc<Vec<f32>>,
    /// The network Δ(x), whose output is added to the logarithms of the weights.
    pub weights_net: Option<Mlp>,
    /// The network that maps the axis-angles of a pose to the axis-angles of its correction; joints without a
    /// parent are omitted.
    pub pose_net: Option<Mlp>,
    /// Gain and light direction of each moment.
    pub light: Option<Light>,
    /// Settings of the renderer.
    pub render: render::Settings,
    /// Colour of the background.
    pub background: [f32; 3],
}

/// Values saved for the adjoint of the pose network: those of the network and the corrected chain of joints.
type PoseSaved = (mlp::Saved, CorrectedPose);

/// The transforms, weights and offsets with which Gaussians follow a pose.
#[derive(Clone, Debug)]
pub struct Rig {
    /// The joints.
    pub bones: skin::Bones,
    /// Skinning weights, shape (G, K).
    pub weights: Arc<Vec<f32>>,
    /// Offsets, shape (G, 3).
    pub offsets: Option<Vec<[f32; 3]>>,
    /// Normals of the nearest points, world axes, shape (G, 3); empty if colours are not shaded.
    normals: Vec<[f32; 3]>,
    weights_saved: Option<mlp::Saved>,
    pose_saved: Option<PoseSaved>,
}

/// The Gaussians at a moment.
#[derive(Clone, Debug, Default)]
pub struct PosedGaussians {
    /// Centres in the world, shape (G, 3).
    pub means: Vec<[f32; 3]>,
    /// Factors in the world, shape (G, 3, 3).
    pub factors: Vec<[f32; 9]>,
    /// Canonical factors, shape (G, 3, 3).
    rest: Vec<[f32; 9]>,
    scales: Vec<[f32; 3]>,
    /// Opacities, shape (G).
    pub opacities: Vec<f32>,
    /// Shaded colours and their shading factors, shape (G), if there is a light.
    shaded: Option<(Vec<[f32; 3]>, Vec<f32>)>,
    /// Direction towards the light.
    light: [f32; 3],
}

/// Gradients of the image of a moment with respect to the stored parameters.
#[derive(Clone, Debug)]
pub struct Grad {
    /// Gradient with respect to the parameters of the Gaussians.
    pub gaussians: Gaussians,
    /// Gradient with respect to the skinning weights, shape (G, K); empty without a weights network.
    weights: Vec<f32>,
    /// Gradient with respect to the joints, shape (K); empty without a pose network.
    posed: Vec<Affine>,
    /// Gradient with respect to the direction of the light.
    pub toward: [f32; 3],
}

impl Avatar {
    /// Creates an avatar with one grey Gaussian per template point, scaled by the distance to its neighbours,
    /// for T moments.
    ///
    /// # Errors
    /// If points are not finite.
    pub fn new(template: &Template, moments: usize, settings: &Settings) -> Result<Self> {
        let body = Body::new(template);
        let n = body.points.len();
        let squares = knn::mean_squared_distance(&body.points)?;
        let scale = |d: f32| elem::ln(settings.first_scale * order::max(d, LEAST_SQUARE).sqrt());
        let k = (settings.sh_degree + 1) * (settings.sh_degree + 1);
        let mut sh = vec![0.0; n * k * 3];
        let rng = Rng::new(settings.seed);
        for (i, row) in sh.chunks_exact_mut(3 * k).enumerate() {
            for c in 0..3 {
                row[c] = rng.uniform_f32(i as u64, 0, PURPOSE_COLOR, c as u16) / 255.0;
            }
        }
        let gaussians = Gaussians {
            means: body.points.clone(),
            quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
            scales_log: squares.iter().map(|&d| [scale(d); 3]).collect(),
            opacity_logits: vec![elem::logit(settings.first_opacity); n],
            sh,
            sh_degree: settings.sh_degree,
        };
        let joints = body.joints();
        let moving = moving(template).len();
        let weights_net = settings.weights_network.then(|| weights_network(joints, settings.seed));
        let pose_net = (settings.pose_network && moving > 0).then(|| pose_network(moving, settings.seed));
        let mut avatar = Self {
            body,
            gaussians,
            nearest: Vec::new(),
            base: Arc::default(),
            weights_net: weights_net.transpose()?,
            pose_net: pose_net.transpose()?,
            light: if settings.learning.gains > 0.0 { Some(Light::new(moments)?) } else { None },
            render: settings.render.clone(),
            background: settings.background,
        };
        avatar.attach();
        Ok(avatar)
    }

    /// Creates an avatar from stored parts.
    ///
    /// # Errors
    /// If a Gaussian refers to a template point that does not exist.
    pub fn from_parts(
        body: Body,
        gaussians: Gaussians,
        nearest: Vec<u32>,
        networks: [Option<Mlp>; 2],
        light: Option<Light>,
        (render, background): (render::Settings, [f32; 3]),
    ) -> Result<Self> {
        let [weights_net, pose_net] = networks;
        let (nearest_of, base) = (Vec::new(), Arc::default());
        let mut avatar = Self {
            body,
            gaussians,
            nearest: nearest_of,
            base,
            weights_net,
            pose_net,
            light,
            render,
            background,
        };
        avatar.attach_to(nearest)?;
        Ok(avatar)
    }

    /// New networks for this body, into which stored parameters can be loaded: (weights, pose).
    ///
    /// # Errors
    /// If the sizes of a network are invalid.
    pub fn networks(body: &Body) -> Result<[Mlp; 2]> {
        let moving = Ord::max(1, moving(&body.template).len());
        Ok([weights_network(body.joints(), 0)?, pose_network(moving, 0)?])
    }

    /// Finds the nearest template points again and returns the distances to them.
    pub fn attach(&mut self) -> Vec<f64> {
        let (nearest, distance) = self.body.nearest(&self.gaussians.means);
        self.base = Arc::new(self.body.weights(&nearest));
        self.nearest = nearest;
        distance
    }

    /// Attaches the Gaussians to the given template points.
    ///
    /// # Errors
    /// If a point does not exist, or the number of points differs from the number of Gaussians.
    pub fn attach_to(&mut self, nearest: Vec<u32>) -> Result<()> {
        let points = self.body.points.len();
        if nearest.len() != self.gaussians.len() || nearest.iter().any(|&p| p as usize >= points) {
            return Err(Error::input("array 'nearest'")
                .expected(format!("{} points of a template of {points}", self.gaussians.len()))
                .got(format!("{} points", nearest.len())));
        }
        self.base = Arc::new(self.body.weights(&nearest));
        self.nearest = nearest;
        Ok(())
    }

    /// Computes how the Gaussians follow a pose.
    pub fn rig(&self, pose: &Pose) -> Rig {
        let (posed, pose_saved) = self.corrected(pose);
        let (weights, weights_saved) = match &self.weights_net {
            None => (Arc::clone(&self.base), None),
            Some(net) => {
                let n = self.gaussians.len();
                let (delta, saved) = net.forward(code(&self.gaussians.means), n);
                let x =
                    softmax::In { x: &delta, base: &self.base, floor: WEIGHT_FLOOR, k: self.body.joints() };
                (Arc::new(softmax::forward(&x)), Some(saved))
            }
        };
        let normals = self.normals(&posed);
        Rig {
            normals,
            bones: self.body.bones(posed),
            weights,
            offsets: self.body.offsets(&self.nearest, &pose.axis_angles),
            weights_saved,
            pose_saved,
        }
    }

    fn corrected(&self, pose: &Pose) -> (Vec<Affine>, Option<PoseSaved>) {
        let Some(net) = &self.pose_net else { return (pose.transforms.clone(), None) };
        let template = &self.body.template;
        let moving = moving(template);
        let x: Vec<f32> = moving.iter().flat_map(|&k| pose.axis_angles[k]).collect();
        let (y, saved) = net.forward(x, 1);
        let mut corrections = vec![[0.0; 3]; self.body.joints()];
        for (&k, v) in moving.iter().zip(y.as_chunks::<3>().0) {
            corrections[k] = *v;
        }
        let corrected = pose::forward(template, &pose.transforms, &corrections);
        (corrected.transforms.clone(), Some((saved, corrected)))
    }

    /// Unit normals of the nearest points, rotated with the joint of the largest weight, shape (G, 3).
    fn normals(&self, posed: &[Affine]) -> Vec<[f32; 3]> {
        let t = &self.body.template;
        if self.light.is_none() || t.normals.len() != t.points.len() || self.gaussians.sh_degree > 0 {
            return Vec::new();
        }
        let turn = |&p: &u32| {
            let (n, a) = (t.normals[p as usize], &posed[usize::from(t.joint_of[p as usize][0])]);
            let m: [f32; 3] = std::array::from_fn(|i| (a[i][0] * n[0] + a[i][1] * n[1]) + a[i][2] * n[2]);
            let length = ((m[0] * m[0] + m[1] * m[1]) + m[2] * m[2]).sqrt();
            if length > 0.0 { m.map(|x| x / length) } else { [0.0; 3] }
        };
        self.nearest.iter().map(turn).collect()
    }

    /// The Gaussians posed by a rig, shaded by the light of a moment.
    pub fn place(&self, rig: &Rig, light: Moment) -> PosedGaussians {
        let g = &self.gaussians;
        let n = g.len();
        let mut placed = PosedGaussians {
            rest: vec![[0.0; 9]; n],
            scales: vec![[0.0; 3]; n],
            opacities: vec![0.0; n],
            ..PosedGaussians::default()
        };
        activate::forward(&g.scales_log, &g.opacity_logits, &mut placed.scales, &mut placed.opacities);
        covariance::forward(&g.quats, &placed.scales, &mut placed.rest);
        (placed.means, placed.factors) = skin::forward(&self.skin_in(rig, &placed.rest));
        if !rig.normals.is_empty() {
            placed.light = light.toward;
            placed.shaded = Some(diffuse::forward(&self.diffuse_in(rig, light.toward)));
        }
        placed
    }

    fn diffuse_in<'a>(&'a self, rig: &'a Rig, toward: [f32; 3]) -> diffuse::In<'a> {
        diffuse::In { sh: &self.gaussians.sh, normals: &rig.normals, toward }
    }

    fn skin_in<'a>(&'a self, rig: &'a Rig, rest: &'a [[f32; 9]]) -> skin::In<'a> {
        skin::In {
            bones: &rig.bones,
            weights: &rig.weights,
            means: &self.gaussians.means,
            factors: rest,
            offsets: rig.offsets.as_deref(),
        }
    }

    /// The input of the renderer.
    pub fn input<'a>(
        &'a self,
        placed: &'a PosedGaussians,
        camera: &'a Camera,
        degree: usize,
    ) -> render::In<'a> {
        render::In {
            means: &placed.means,
            shape: Shape::Factors(&placed.factors),
            opacities: &placed.opacities,
            color: match &placed.shaded {
                Some((rgb, _)) => Color::Rgb(rgb),
                None => Color::Sh(Sh {
                    values: &self.gaussians.sh,
                    coefficients: self.gaussians.sh_coefficients(),
                    degree,
                }),
            },
            cameras: std::slice::from_ref(camera),
            background: self.background,
        }
    }

    /// Renders a pose from a camera, with the gain of a moment of the capture or with the mean gain.
    ///
    /// # Errors
    /// If the camera is invalid or the pose belongs to another body.
    pub fn picture(&self, pose: &Pose, moment: Option<usize>, camera: &Camera) -> Result<Out> {
        self.drawn(pose, moment, camera, &self.render)
    }

    /// [`Self::picture`] with other settings of the renderer.
    pub(super) fn drawn(
        &self,
        pose: &Pose,
        moment: Option<usize>,
        camera: &Camera,
        render: &render::Settings,
    ) -> Result<Out> {
        if pose.transforms.len() != self.body.joints() {
            return Err(Error::input("pose")
                .expected(format!("{} joints", self.body.joints()))
                .got(pose.transforms.len().to_string()));
        }
        let light = self.light.as_ref().map(|l| l.at(moment));
        let placed = self.place(&self.rig(pose), light.unwrap_or_default());
        let x = self.input(&placed, camera, self.gaussians.sh_degree);
        x.validate(render)?;
        let (mut out, mut saved) = (Out::default(), Saved::default());
        render::forward_into(&x, render, None, &mut out, &mut saved);
        if let Some(light) = light {
            let x = gain::In { alpha: &out.alpha, background: self.background, gain: light.gain };
            gain::forward(&x, &mut out.image);
        }
        Ok(out)
    }

    /// Maps gradients of the renderer's input to gradients of the stored parameters. With `networks`, the
    /// gradients of weights and joints are included.
    pub fn adjoint(&self, rig: &Rig, placed: &PosedGaussians, bar: render::InBar, networks: bool) -> Grad {
        let (g, n) = (&self.gaussians, self.gaussians.len());
        let wants = [networks && self.weights_net.is_some(), networks && self.pose_net.is_some()];
        let skinned =
            skin::adjoint(&self.skin_in(rig, &placed.rest), &bar.means, &bar.factors, wants[0], wants[1]);
        let (mut quats, mut scales) = (vec![[0.0; 4]; n], vec![[0.0; 3]; n]);
        covariance::adjoint(&g.quats, &placed.scales, &skinned.factors, &mut quats, &mut scales);
        let (mut scales_log, mut opacity_logits) = (vec![[0.0; 3]; n], vec![0.0; n]);
        activate::adjoint(
            &placed.scales,
            &placed.opacities,
            &scales,
            &bar.opacities,
            &mut scales_log,
            &mut opacity_logits,
        );
        let (mut sh, mut toward) = (bar.sh, [0.0; 3]);
        if let Some((_, shades)) = &placed.shaded {
            let mut bars = diffuse::InBar { sh: vec![0.0; 3 * n], toward };
            diffuse::adjoint(&self.diffuse_in(rig, placed.light), shades, &bar.rgb, &mut bars);
            (sh, toward) = (bars.sh, bars.toward);
        }
        let gaussians =
            Gaussians { means: skinned.means, quats, scales_log, opacity_logits, sh, sh_degree: g.sh_degree };
        Grad { gaussians, weights: skinned.weights, posed: skinned.posed, toward }
    }

    /// Performs one step of the networks.
    ///
    /// # Errors
    /// If a result is not finite.
    pub fn step_networks(&mut self, rig: &Rig, grad: &Grad, rate: f64) -> Result<()> {
        if let (Some(net), Some(saved)) = (&mut self.weights_net, &rig.weights_saved) {
            let mut bar = vec![0.0; grad.weights.len()];
            softmax::adjoint(&rig.weights, self.body.joints(), &grad.weights, &mut bar);
            net.step(saved, &bar, rate).map_err(|e| e.within("weights network"))?;
        }
        if let (Some(net), Some((saved, corrected))) = (&mut self.pose_net, &rig.pose_saved) {
            let bar = pose::adjoint(&self.body.template, corrected, &grad.posed);
            let y_bar: Vec<f32> = moving(&self.body.template).iter().flat_map(|&k| bar[k]).collect();
            net.step(saved, &y_bar, rate).map_err(|e| e.within("pose network"))?;
        }
        Ok(())
    }

    /// Digest of all parameters, 16 hexadecimal digits.
    ///
    /// # Errors
    /// If a parameter is NaN.
    pub fn digest(&self) -> Result<String> {
        let mut d = Digest::new();
        self.gaussians.add_to(&mut d)?;
        for net in [&self.weights_net, &self.pose_net].into_iter().flatten() {
            for (values, shape) in net.values() {
                d.f32(&shape, values)?;
            }
        }
        if let Some(light) = &self.light {
            for rows in [light.gains(), light.toward()] {
                d.f32(&[rows.len(), 3], rows.as_flattened())?;
            }
            for (t, _) in light.seen.iter().enumerate().filter(|(_, seen)| !**seen) {
                d.u64(t as u64);
            }
        }
        for &p in &self.nearest {
            d.u64(u64::from(p));
        }
        Ok(format!("{:016x}", d.value()))
    }
}

/// The weights network, which maps the code of a position to changes of the logarithms of the joint weights.
fn weights_network(joints: usize, seed: u64) -> Result<Mlp> {
    let widths = &[CODE, WIDTH, WIDTH, WIDTH, WIDTH, joints];
    Mlp::new(mlp::Sizes { name: "network/weights", widths, skip: Some(2), purpose: PURPOSE_WEIGHTS }, seed)
}

/// The pose network, which maps axis-angles of the joints that have a parent to the axis-angles of their
/// corrections.
fn pose_network(moving: usize, seed: u64) -> Result<Mlp> {
    let widths = &[3 * moving, WIDTH, WIDTH, 3 * moving];
    Mlp::new(mlp::Sizes { name: "network/pose", widths, skip: None, purpose: PURPOSE_POSE }, seed)
}

/// Joints that have a parent, in order.
fn moving(template: &Template) -> Vec<usize> {
    (0..template.joints.len()).filter(|&k| template.parents[k].is_some()).collect()
}

/// The positional code (G, 63): x, then sin 2ᵐx and cos 2ᵐx for m = 0 … 9.
fn code(places: &[[f32; 3]]) -> Vec<f32> {
    let mut out = vec![0.0; places.len() * CODE];
    par::chunks_mut(&mut out, CHUNK * CODE, |c, out| {
        let places = &places[c * CHUNK..][..out.len() / CODE];
        let mut arguments = vec![0.0; places.len() * 3 * OCTAVES];
        for (row, x) in arguments.chunks_exact_mut(3 * OCTAVES).zip(places) {
            for m in 0..OCTAVES {
                for c in 0..3 {
                    row[3 * m + c] = x[c] * (1u32 << m) as f32;
                }
            }
        }
        let (mut sines, mut cosines) = (vec![0.0; arguments.len()], vec![0.0; arguments.len()]);
        elem::sin_slice(&arguments, &mut sines);
        elem::cos_slice(&arguments, &mut cosines);
        for (g, row) in out.chunks_exact_mut(CODE).enumerate() {
            row[..3].copy_from_slice(&places[g]);
            for m in 0..OCTAVES {
                let from = g * 3 * OCTAVES + 3 * m;
                row[3 + 6 * m..][..3].copy_from_slice(&sines[from..from + 3]);
                row[6 + 6 * m..][..3].copy_from_slice(&cosines[from..from + 3]);
            }
        }
    });
    out
}
