//! The open body of MakeHuman as a character.
//!
//! Bones become joints at their heads, without rotation at rest (arms half lowered); decimetres become
//! metres. The body has no animations, so four are added: `Rest` (as it is), `Stand` (arms down), `Walk` (one
//! loop of 1 s on the spot) and `Reach` (both hands forward at the height of the chest). They turn the bones
//! of the Mixamo rig (`mixamorig:LeftUpLeg` and so on); a rig with other names has only `Rest`.

use super::local::Local;
use super::motion::product;
use super::posed;
use super::rig::largest;
use super::skinned::{Character, Joint, Part};
use crate::io::gltf::{self, Animation, Channel, Gltf, Interpolation, Node, Path};
use crate::io::makehuman::Body;
use crate::num::elem::f64 as elem;
use crate::scene::material::Material;
use crate::scene::mesh::{Mesh, Object};
use crate::scene::model::{z_up, z_up_map};
use crate::{Error, Result};
use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;

/// Linear base colour of the skin, which has no texture.
const SKIN: [f32; 4] = [0.58, 0.36, 0.26, 1.0];

/// Keys of the walk, the first again at the end.
const KEYS: usize = 17;

impl Character {
    /// From a record; `name` is the folder name in errors.
    ///
    /// # Errors
    /// When there are no faces or bones.
    pub fn from_body(body: &Body, name: &str) -> Result<Self> {
        if body.bones.is_empty() {
            return Err(Error::input(name).at("bones").expected("at least one").got("none"));
        }
        let metres = |p: [f64; 3]| DVec3::from_array(p) * body.scale;
        let frame = z_up_map();
        let (mut nodes, mut joints) = (Vec::new(), Vec::new());
        for (i, b) in body.bones.iter().enumerate() {
            let above = b.parent.map_or(DVec3::ZERO, |p| metres(body.bones[p].head));
            let translation = (metres(b.head) - above).to_array().map(|x| x as f32);
            let local = gltf::Local::Trs { translation, rotation: [0.0, 0.0, 0.0, 1.0], scale: [1.0; 3] };
            let children = (0..body.bones.len()).filter(|&c| body.bones[c].parent == Some(i)).collect();
            nodes.push(Node {
                name: b.name.clone(),
                parent: b.parent,
                children,
                local,
                mesh: None,
                skin: None,
            });
        }
        let order: Vec<usize> = (0..nodes.len()).collect();
        let mut rig = Gltf { order: order.clone(), scene: order, nodes, ..Gltf::default() };
        rig.animations = movements(&rig);
        let rest: Vec<Local> = rig.nodes.iter().map(|n| Local::of(&n.local)).collect();
        // As the rounded translations place them, so that the canonical surface is the rest pose.
        let locals: Vec<DAffine3> = rig.nodes.iter().map(|n| crate::scene::model::local(&n.local)).collect();
        let globals = crate::scene::model::globals(&rig, &locals, frame);
        for (i, b) in body.bones.iter().enumerate() {
            joints.push(Joint {
                name: b.name.clone(),
                parent: b.parent,
                node: Some(i),
                bind: globals[i].inverse(),
            });
        }
        // A corner is a pair of vertex and texture coordinate; pairs become vertices in the order of the
        // faces.
        let mut mesh = Mesh::default();
        let mut influences = Vec::new();
        let mut known: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        for t in &body.triangles {
            let corner = t.map(|pair| {
                *known.entry(pair).or_insert_with(|| {
                    let p = metres(body.positions[pair[0] as usize].map(f64::from)).to_array();
                    mesh.positions.push(z_up(p.map(|x| x as f32)));
                    if let Some(&[u, v]) = body.uvs.get(pair[1] as usize) {
                        mesh.uvs.push([u, 1.0 - v]);
                    }
                    influences.push(largest(body.weights[pair[0] as usize].clone()));
                    mesh.positions.len() as u32 - 1
                })
            });
            mesh.triangles.push(corner);
        }
        let folds = posed::welded_normals(&mesh);
        mesh.normals = folds.clone();
        let skin = Material { name: "skin".into(), base_color: SKIN, roughness: 0.55, ..Material::default() };
        let object = Object { material_of: vec![0; mesh.triangles.len()], materials: vec![skin], mesh };
        object.validate(name)?;
        if object.mesh.triangles.is_empty() {
            return Err(Error::input(name).at("group 'body'").expected("faces").got("none"));
        }
        let (vertices, triangles) = (0..object.mesh.positions.len(), 0..object.mesh.triangles.len());
        let parts =
            vec![Part { name: "body".into(), mesh: "body".into(), skinned: true, vertices, triangles }];
        let name = name.to_owned();
        Ok(Self { name, object, parts, joints, influences, rig, rest, frame, folds, notes: Vec::new() })
    }
}

/// Turn about an axis of the file's frame: x to the left, y up, z forward; xyzw.
fn turn(axis: usize, angle: f64) -> [f64; 4] {
    let mut q = [0.0, 0.0, 0.0, elem::cos(0.5 * angle)];
    q[axis] = elem::sin(0.5 * angle);
    q
}

/// The movements of the Mixamo rig, or `Rest` alone.
fn movements(rig: &Gltf) -> Vec<Animation> {
    let still = |name: &str| Animation { name: name.into(), channels: Vec::new() };
    let bone = |n: &str| rig.nodes.iter().position(|b| b.name == format!("mixamorig:{n}"));
    let names = [
        "LeftArm",
        "LeftForeArm",
        "LeftUpLeg",
        "LeftLeg",
        "RightArm",
        "RightForeArm",
        "RightUpLeg",
        "RightLeg",
        "Hips",
    ];
    let found: Option<Vec<usize>> = names.iter().map(|n| bone(n)).collect();
    let Some(bones) = found else { return vec![still("Rest")] };
    // (arm, forearm, thigh, shin) of the left side for a phase; the right side is half a loop behind and
    // mirrored in y and z.
    let limbs = |walk: f64, swing: f64| {
        // At rest the arms stand 40° off the body and the legs 6°.
        let arm = product(turn(0, 0.35 * swing), turn(2, -0.5));
        let thigh = product(turn(0, -0.45 * swing), turn(2, -0.09));
        [arm, turn(1, -0.1), thigh, turn(0, 0.04 + 0.3 * walk)]
    };
    let mirrored = |q: [f64; 4]| [q[0], -q[1], -q[2], q[3]];
    let rotations = |keys: usize, of: &dyn Fn(usize, bool) -> [[f64; 4]; 4]| {
        let times = Arc::new((0..keys).map(|k| k as f32 / (KEYS - 1) as f32).collect::<Vec<f32>>());
        let mut channels = Vec::new();
        for (b, &node) in bones[..8].iter().enumerate() {
            let value = |k: usize| {
                let q = of(k, b >= 4)[b % 4];
                (if b >= 4 { mirrored(q) } else { q }).map(|x| x as f32)
            };
            channels.push(Channel {
                node,
                path: Path::Rotation,
                interpolation: Interpolation::Linear,
                times: Arc::clone(&times),
                values: Arc::new((0..keys).map(value).collect()),
            });
        }
        channels
    };
    // The loop begins with the left leg in front, and has the right one in front in its middle.
    let phase = |k: usize, right: bool| {
        let angle = 2.0 * PI * (k % (KEYS - 1)) as f64 / (KEYS - 1) as f64 + 0.5 * PI;
        if right { angle + PI } else { angle }
    };
    let stand = rotations(1, &|_, _| limbs(0.0, 0.0));
    let walk = rotations(KEYS, &|k, right| {
        let angle = phase(k, right);
        // The knee bends while the leg swings forward.
        limbs(1.0 + elem::cos(angle), elem::sin(angle))
    });
    let reach = rotations(1, &|_, _| {
        let arm = product(turn(1, -1.2), turn(2, 0.75));
        [arm, turn(1, -0.1), turn(0, 0.0), turn(0, 0.0)]
    });
    vec![
        still("Rest"),
        Animation { name: "Stand".into(), channels: stand },
        Animation { name: "Walk".into(), channels: walk },
        Animation { name: "Reach".into(), channels: reach },
    ]
}
