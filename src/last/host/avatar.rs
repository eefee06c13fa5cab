//! The person that can be posed and seen: canonical Gaussians on a body, and the networks that refine how they follow it.
//!
//! ```text
//! pose ──► rig: joints (corrected), weights (refined), offsets ──► place: posed centres and factors ──► draw: a picture
//! ```
//!
//! [`rig`](Avatar::rig) depends on where Gaussians are only through the weights network, which reads places without gradient; so a rig is made
//! once per iteration and used by every render of it.

use super::body::Body;
use super::light::{self, Light, Moment};
use super::mlp::{Mlp, Passed};
use super::pose::{self, Corrected};
use super::settings::Settings;
use super::skin;
use crate::math::knn;
use crate::num::bits::Digest;
use crate::num::rng::Rng;
use crate::num::{elem, order, par};
use crate::scene::camera::Camera;
use crate::scene::gaussians::Gaussians;
use crate::scene::person::{Affine, Pose, Template};
use crate::splat::color::Sh;
use crate::splat::render::{self, Color, Out, Saved, Shape};
use crate::splat::{activate, covariance};
use crate::{Error, Result};
use std::sync::Arc;

/// Purposes of the draws.
const PURPOSE_COLOR: u16 = 0x0901;
const PURPOSE_WEIGHTS: u16 = 0x0902;
const PURPOSE_POSE: u16 = 0x0903;
/// Smallest squared distance to neighbours that a first scale is made of.
const LEAST_SQUARE: f32 = 1e-7;
/// Keeps the logarithm of an absent weight finite.
const WEIGHT_FLOOR: f32 = 1e-9;
/// The constant spherical harmonic.
const Y0: f32 = 0.282_094_79;
/// Octaves of the code of a place.
const OCTAVES: usize = 10;
const CODE: usize = 3 + 6 * OCTAVES;
const WIDTH: usize = 128;
const CHUNK: usize = 256;

/// Canonical Gaussians on a body.
#[derive(Clone, Debug)]
pub struct Avatar {
    /// The body.
    pub body: Body,
    /// In the canonical pose.
    pub gaussians: Gaussians,
    /// (G) nearest point of the template, found when the number of Gaussians last changed
    pub nearest: Vec<u32>,
    /// (G, K) its weights
    base: Arc<Vec<f32>>,
    /// Δ(x), added to logarithms of weights
    pub weights_net: Option<Mlp>,
    /// axis-angles of a pose → axis-angles of its correction; joints without a parent are left out
    pub pose_net: Option<Mlp>,
    /// How bright each moment is.
    pub light: Option<Light>,
    /// How to render.
    pub render: render::Settings,
    /// Behind the person.
    pub background: [f32; 3],
}

/// What the adjoint of the pose network needs: its own, the corrections (K), and the chain they went through.
type PosePassed = (Passed, Vec<[f64; 3]>, Corrected);

/// How Gaussians follow a pose.
#[derive(Clone, Debug)]
pub struct Rig {
    /// The joints.
    pub bones: skin::Bones,
    /// (G, K)
    pub weights: Arc<Vec<f32>>,
    /// (G, 3)
    pub offsets: Option<Vec<[f32; 3]>>,
    /// (G, 3) of the nearest points, in the world; empty where colours are not shaded
    normals: Vec<[f32; 3]>,
    weights_passed: Option<Passed>,
    pose_passed: Option<PosePassed>,
}

/// Gaussians at a moment.
#[derive(Clone, Debug, Default)]
pub struct Placed {
    /// (G, 3) in the world
    pub means: Vec<[f32; 3]>,
    /// (G, 3, 3) in the world
    pub factors: Vec<[f32; 9]>,
    /// (G, 3, 3) canonical
    rest: Vec<[f32; 9]>,
    scales: Vec<[f32; 3]>,
    /// (G)
    pub opacities: Vec<f32>,
    /// (G) shaded colours and their shades, where there is light
    shaded: Option<(Vec<[f32; 3]>, Vec<f32>)>,
}

/// Gradients of a moment's picture by what is stored.
#[derive(Clone, Debug)]
pub struct Grad {
    /// by the parameters of the Gaussians
    pub gaussians: Gaussians,
    /// by skinning weights (G, K); empty without a weights network
    weights: Vec<f32>,
    /// by joints (K); empty without a pose network
    posed: Vec<[[f64; 4]; 3]>,
    /// by the direction of the light
    pub toward: [f32; 3],
}

impl Avatar {
    /// One Gaussian per point of the template, grey, of the size of the distance to its neighbours; T moments.
    ///
    /// # Errors
    /// When points are not finite.
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
        let weights_net = settings.weights_network.then(|| {
            Mlp::new(&[CODE, WIDTH, WIDTH, WIDTH, WIDTH, joints], Some(2), settings.seed, PURPOSE_WEIGHTS)
        });
        let pose_net = (settings.pose_network && moving > 0)
            .then(|| Mlp::new(&[3 * moving, WIDTH, WIDTH, 3 * moving], None, settings.seed, PURPOSE_POSE));
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

    /// An avatar of parts that were stored.
    ///
    /// # Errors
    /// When a Gaussian hangs on no point of the template.
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

    /// Fresh networks for this body, to load stored ones into: (weights, pose).
    ///
    /// # Errors
    /// Never for a body with joints.
    pub fn networks(body: &Body) -> Result<[Mlp; 2]> {
        let moving = Ord::max(1, moving(&body.template).len());
        Ok([
            Mlp::new(&[CODE, WIDTH, WIDTH, WIDTH, WIDTH, body.joints()], Some(2), 0, PURPOSE_WEIGHTS)?,
            Mlp::new(&[3 * moving, WIDTH, WIDTH, 3 * moving], None, 0, PURPOSE_POSE)?,
        ])
    }

    /// Finds the nearest points anew; gives the distances to them.
    pub fn attach(&mut self) -> Vec<f64> {
        let (nearest, distance) = self.body.nearest(&self.gaussians.means);
        self.base = Arc::new(self.body.weights(&nearest));
        self.nearest = nearest;
        distance
    }

    /// Hangs the Gaussians on given points.
    ///
    /// # Errors
    /// When there is no such point, or not one for each.
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

    /// How the Gaussians follow a pose.
    pub fn rig(&self, pose: &Pose) -> Rig {
        let (posed, pose_passed) = self.corrected(pose);
        let (weights, weights_passed) = match &self.weights_net {
            None => (Arc::clone(&self.base), None),
            Some(net) => {
                let n = self.gaussians.len();
                let (delta, passed) = net.forward(&code(&self.gaussians.means), n);
                (Arc::new(softmax(&self.base, &delta, self.body.joints())), Some(passed))
            }
        };
        let normals = self.normals(&posed);
        Rig {
            normals,
            bones: self.body.bones(posed),
            weights,
            offsets: self.body.offsets(&self.nearest, &pose.axis_angles),
            weights_passed,
            pose_passed,
        }
    }

    fn corrected(&self, pose: &Pose) -> (Vec<Affine>, Option<PosePassed>) {
        let Some(net) = &self.pose_net else { return (pose.transforms.clone(), None) };
        let template = &self.body.template;
        let moving = moving(template);
        let x: Vec<f32> = moving.iter().flat_map(|&k| pose.axis_angles[k]).collect();
        let (y, passed) = net.forward(&x, 1);
        let mut corrections = vec![[0.0; 3]; self.body.joints()];
        for (&k, v) in moving.iter().zip(y.as_chunks::<3>().0) {
            corrections[k] = v.map(f64::from);
        }
        let corrected = pose::forward(template, &pose.transforms, &corrections);
        (corrected.transforms.clone(), Some((passed, corrections, corrected)))
    }

    /// (G, 3) unit normals of the nearest points, turned with the joint they hang on most.
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

    /// The Gaussians at the moment of a rig, in the light of a moment.
    pub fn place(&self, rig: &Rig, light: Moment) -> Placed {
        let g = &self.gaussians;
        let n = g.len();
        let mut placed = Placed {
            rest: vec![[0.0; 9]; n],
            scales: vec![[0.0; 3]; n],
            opacities: vec![0.0; n],
            ..Placed::default()
        };
        activate::forward(&g.scales_log, &g.opacity_logits, &mut placed.scales, &mut placed.opacities);
        covariance::forward(&g.quats, &placed.scales, &mut placed.rest);
        (placed.means, placed.factors) = skin::forward(&self.skin_in(rig, &placed.rest));
        if !rig.normals.is_empty() {
            let shades: Vec<f32> = rig.normals.iter().map(|&m| light::shade(m, light.toward)).collect();
            let colors = g.sh.as_chunks::<3>().0.iter().zip(&shades);
            let shaded = colors.map(|(c, s)| c.map(|c| order::max(0.5 + Y0 * c, 0.0) * s)).collect();
            placed.shaded = Some((shaded, shades));
        }
        placed
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

    /// What the renderer takes.
    pub fn input<'a>(&'a self, placed: &'a Placed, camera: &'a Camera, degree: usize) -> render::In<'a> {
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

    /// A picture of a pose from a camera, as bright as a moment of the capture or as their mean.
    ///
    /// # Errors
    /// When the camera is not valid or the pose belongs to another body.
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
            light::apply(&mut out, self.background, light.gain);
        }
        Ok(out)
    }

    /// From gradients of the renderer's input to those of what is stored. `networks` also follows those of weights and joints.
    pub fn adjoint(&self, rig: &Rig, placed: &Placed, bar: render::InBar, networks: bool) -> Grad {
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
            let mut shades_bar = vec![0.0; n];
            sh = vec![0.0; 3 * n];
            for i in 0..n {
                for c in 0..3 {
                    let base = 0.5 + Y0 * g.sh[3 * i + c];
                    if base > 0.0 {
                        sh[3 * i + c] = Y0 * shades[i] * bar.rgb[i][c];
                        shades_bar[i] += base * bar.rgb[i][c];
                    }
                }
            }
            toward = light::shade_adjoint(&rig.normals, shades, &shades_bar);
        }
        let gaussians =
            Gaussians { means: skinned.means, quats, scales_log, opacity_logits, sh, sh_degree: g.sh_degree };
        Grad { gaussians, weights: skinned.weights, posed: skinned.posed, toward }
    }

    /// One step of the networks.
    ///
    /// # Errors
    /// A result that is not finite.
    pub fn step_networks(&mut self, rig: &Rig, grad: &Grad, rate: f64) -> Result<()> {
        if let (Some(net), Some(passed)) = (&mut self.weights_net, &rig.weights_passed) {
            let bar = softmax_adjoint(&rig.weights, &grad.weights, self.body.joints());
            net.step(passed, bar, rate).map_err(|e| e.within("network of the weights"))?;
        }
        if let (Some(net), Some((passed, corrections, corrected))) = (&mut self.pose_net, &rig.pose_passed) {
            let bar = pose::adjoint(&self.body.template, corrections, corrected, &grad.posed);
            let y_bar = moving(&self.body.template).iter().flat_map(|&k| bar[k].map(|x| x as f32)).collect();
            net.step(passed, y_bar, rate).map_err(|e| e.within("network of the poses"))?;
        }
        Ok(())
    }

    /// Digest of all parameters, 16 hexadecimal digits.
    ///
    /// # Errors
    /// When a parameter is NaN.
    pub fn digest(&self) -> Result<String> {
        let (mut d, g) = (Digest::new(), &self.gaussians);
        let n = g.len();
        d.f32(&[n, 3], g.means.as_flattened())?;
        d.f32(&[n, 4], g.quats.as_flattened())?;
        d.f32(&[n, 3], g.scales_log.as_flattened())?;
        d.f32(&[n], &g.opacity_logits)?;
        d.f32(&[n, g.sh_coefficients(), 3], &g.sh)?;
        for net in [&self.weights_net, &self.pose_net].into_iter().flatten() {
            for (values, shape) in net.values() {
                d.f32(&shape, values)?;
            }
        }
        if let Some(light) = &self.light {
            d.f32(&[light.gains.len(), 3], light.gains.as_flattened())?;
            d.f32(&[light.toward.len(), 3], light.toward.as_flattened())?;
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

/// Joints that hang on another, in order.
fn moving(template: &Template) -> Vec<usize> {
    (0..template.joints.len()).filter(|&k| template.parents[k].is_some()).collect()
}

/// (G, 63): x, then sin 2ᵐx and cos 2ᵐx for m = 0 … 9.
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

/// softmax(ln(w + 1e-9) + Δ) of each row of K = (w + 1e-9)·e^Δ', normalised; Δ' = Δ − max Δ.
fn softmax(base: &[f32], delta: &[f32], k: usize) -> Vec<f32> {
    let mut out = vec![0.0; base.len()];
    par::chunks_mut(&mut out, CHUNK * k, |c, out| {
        let from = c * CHUNK * k;
        for (r, row) in out.chunks_exact_mut(k).enumerate() {
            let at = from + r * k;
            let (w, d) = (&base[at..at + k], &delta[at..at + k]);
            let most = d.iter().fold(d[0], |m, &x| order::max(m, x));
            let mut sum = 0.0;
            for j in 0..k {
                row[j] = (w[j] + WEIGHT_FLOOR) * elem::exp(d[j] - most);
                sum += row[j];
            }
            for x in row {
                *x = *x / sum;
            }
        }
    });
    out
}

/// Δ̄ = w ∘ (w̄ − ⟨w, w̄⟩).
fn softmax_adjoint(weights: &[f32], bar: &[f32], k: usize) -> Vec<f32> {
    let mut out = vec![0.0; weights.len()];
    par::chunks_mut(&mut out, CHUNK * k, |c, out| {
        for (r, row) in out.chunks_exact_mut(k).enumerate() {
            let at = c * CHUNK * k + r * k;
            let (w, b) = (&weights[at..at + k], &bar[at..at + k]);
            let mean = w.iter().zip(b).fold(0.0, |s, (w, b)| s + w * b);
            for j in 0..k {
                row[j] = w[j] * (b[j] - mean);
            }
        }
    });
    out
}
