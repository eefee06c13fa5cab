//! glTF 2.0, `.gltf` and `.glb`: static meshes, metallic-roughness materials, skins, and animations of nodes.
//!
//! The record keeps the file's own frame: right-handed, **y up**, quaternions **xyzw**, texture coordinates
//! with (0, 0) at the top left. `scene` turns it into the project's conventions.
//!
//! | part | read | not read |
//! |---|---|---|
//! | container | JSON with buffers and images beside it, in data URIs or in buffer views; GLB | anything over a network |
//! | accessors | every component type, normalised integers, strides, sparse ones (over zeros too) | neither a view nor sparse | |
//! | primitives | triangles, strips, fans; any number of texture coordinate sets; all joint sets | points and lines (skipped with a note), morph targets, vertex colours (notes) |
//! | materials | metallic-roughness, normal, emission, alpha modes, both sides | occlusion, other lobes (notes) |
//! | animation | translation, rotation, scale; step, linear, cubic spline | weights of morph targets (note) |
//! | extensions | `KHR_texture_transform`, `KHR_materials_emissive_strength`, `KHR_mesh_quantization` | any other one that the file **requires** is an error |
//!
//! # Bounds
//! JSON of at most [`MAX_JSON_BYTES`] with at most [`MAX_JSON_OBJECTS`] objects; accessors are checked
//! against the bytes of their buffers before anything is allocated, and together decode to at most 16 times
//! those bytes and 64 MiB; images have at most [`MAX_TEXELS`] texels together, known before they are decoded.
//! Paths stay inside the folder of the file.

mod accessor;
mod container;
mod materials;
mod motion;
mod read;
mod write;

pub use read::{parse, read};
pub use write::to_glb;

pub(in crate::io) use materials::rgba;

use std::sync::Arc;

/// Largest JSON part that is read, in bytes.
pub const MAX_JSON_BYTES: usize = 256 << 20;

/// Most objects and lists in the JSON part.
pub const MAX_JSON_OBJECTS: usize = 1 << 20;

/// Most texels of all images of one file.
pub const MAX_TEXELS: u64 = 1 << 28;

/// A file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gltf {
    /// The hierarchy; each has at most one parent, there are no cycles.
    pub nodes: Vec<Node>,
    /// All nodes, parents before children.
    pub order: Vec<usize>,
    /// Nodes of the default scene (or of the first; or all), a subsequence of `order`.
    pub scene: Vec<usize>,
    /// What nodes show.
    pub meshes: Vec<Mesh>,
    /// What primitives are made of.
    pub materials: Vec<Material>,
    /// Decoded images; `None` where no material uses them.
    pub images: Vec<Option<Arc<Image>>>,
    /// Joints with their bind matrices.
    pub skins: Vec<Skin>,
    /// Movements of nodes.
    pub animations: Vec<Animation>,
    /// Contents of the file that the record does not represent, one sentence each.
    pub notes: Vec<String>,
}

/// A 4×4 matrix, row-major, columns are multiplied.
pub type Matrix = [[f32; 4]; 4];

/// Transform of a node in its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Local {
    /// Any affine map.
    Matrix(Matrix),
    /// T · R · S
    Trs {
        /// lengths
        translation: [f32; 3],
        /// xyzw, not necessarily of length 1
        rotation: [f32; 4],
        /// per axis
        scale: [f32; 3],
    },
}

/// One node.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Its name, or `node N`.
    pub name: String,
    /// Above it.
    pub parent: Option<usize>,
    /// Below it.
    pub children: Vec<usize>,
    /// Where it is.
    pub local: Local,
    /// What it shows.
    pub mesh: Option<usize>,
    /// How that deforms.
    pub skin: Option<usize>,
}

/// One mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    /// Its name, or `mesh N`.
    pub name: String,
    /// Its parts.
    pub primitives: Vec<Primitive>,
}

/// Triangles of one material. Arrays may be shared by several primitives.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive {
    /// (V)
    pub positions: Arc<Vec<[f32; 3]>>,
    /// (V), lengths as in the file
    pub normals: Option<Arc<Vec<[f32; 3]>>>,
    /// By set: (V)
    pub uvs: Vec<Option<Arc<Vec<[f32; 2]>>>>,
    /// By set: (V) indices into the joints of a skin
    pub joints: Vec<Arc<Vec<[u16; 4]>>>,
    /// By set: (V), as many sets as `joints`
    pub weights: Vec<Arc<Vec<[f32; 4]>>>,
    /// (T) indices below V
    pub triangles: Vec<[u32; 3]>,
    /// Index, or the default material.
    pub material: Option<usize>,
}

/// Addressing beyond the border of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// the image again
    #[default]
    Repeat,
    /// its mirror image
    Mirror,
    /// its border
    Clamp,
}

/// uv' = offset + R(rotation) · (scale ∘ uv) of `KHR_texture_transform`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvTransform {
    /// added last
    pub offset: [f32; 2],
    /// radians, counter-clockwise in the image
    pub rotation: f32,
    /// applied first
    pub scale: [f32; 2],
}

impl UvTransform {
    /// Nothing changes.
    pub const IDENTITY: Self = Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2] };
}

/// Use of an image by a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into `images`.
    pub image: usize,
    /// Horizontally, vertically.
    pub wrap: [Wrap; 2],
    /// Set of texture coordinates.
    pub uv_set: usize,
    /// Applied to them.
    pub transform: UvTransform,
}

/// Transparency.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Alpha {
    /// alpha is ignored
    #[default]
    Opaque,
    /// visible where alpha reaches the threshold
    Mask(f32),
    /// mixed with what is behind
    Blend,
}

/// A metallic-roughness material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name, or `material N`.
    pub name: String,
    /// Linear RGB and alpha.
    pub base_color: [f32; 4],
    /// sRGB-encoded RGB and linear alpha.
    pub base_color_texture: Option<TextureRef>,
    /// 0..1
    pub metallic: f32,
    /// 0..1
    pub roughness: f32,
    /// G roughness, B metallic.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent space, with the factor of x and y.
    pub normal_texture: Option<(TextureRef, f32)>,
    /// Linear RGB, strength included.
    pub emission: [f32; 3],
    /// sRGB-encoded.
    pub emission_texture: Option<TextureRef>,
    /// Transparency.
    pub alpha: Alpha,
    /// Visible from behind too.
    pub double_sided: bool,
}

impl Default for Material {
    /// The default material of glTF: white, rough, metallic.
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_color: [1.0; 4],
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            emission: [0.0; 3],
            emission_texture: None,
            alpha: Alpha::Opaque,
            double_sided: false,
        }
    }
}

/// A decoded image, eight bits per value.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Its name, or `image N`.
    pub name: String,
    /// Texels.
    pub width: usize,
    /// Texels.
    pub height: usize,
    /// (H, W) RGBA
    pub texels: Vec<[u8; 4]>,
}

/// Joints and where the mesh was bound to them.
#[derive(Clone, Debug, PartialEq)]
pub struct Skin {
    /// Its name, or `skin N`.
    pub name: String,
    /// (J) nodes
    pub joints: Vec<usize>,
    /// (J) mesh space to joint space, invertible
    pub inverse_bind: Vec<Matrix>,
}

/// Property that a channel animates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// the first three values
    Translation,
    /// xyzw
    Rotation,
    /// the first three values
    Scale,
}

/// Interpolation between keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// the key before
    Step,
    /// straight; rotations on the sphere
    Linear,
    /// Hermite with a tangent into and out of each key
    Cubic,
}

/// One property of one node over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// The node it belongs to.
    pub node: usize,
    /// The property.
    pub path: Path,
    /// Interpolation between keys.
    pub interpolation: Interpolation,
    /// (K) seconds, ascending, ≥ 0, at least one
    pub times: Arc<Vec<f32>>,
    /// (K), or (3K) for [`Interpolation::Cubic`]: tangent in, value, tangent out
    pub values: Arc<Vec<[f32; 4]>>,
}

/// An animation.
#[derive(Clone, Debug, PartialEq)]
pub struct Animation {
    /// Its name, or `animation N`.
    pub name: String,
    /// The animated properties.
    pub channels: Vec<Channel>,
}
