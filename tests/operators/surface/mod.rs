//! From volumes to textured meshes: closed surfaces, parts, smoothing, charts and texels.

mod charts;
mod marching;
mod parts;
mod shapes;
