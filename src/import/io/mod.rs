//! Bytes ↔ plain records, with the formats of other programs. Level 2.
//!
//! ```text
//! gltf        meshes, materials, skins, animations; .gltf and .glb       obj      OBJ with MTL
//! ply_mesh    meshes in PLY files, with the images they name
//! makehuman   the open body: mesh, rig, skinning weights                 smpl     body models
//! captures    published layouts of captures of moving people             pickle   Python's pickles, without running anything
//! objects     published layouts of captures of one object
//! hdf5        arrays in HDF5 files, read in parts                        lzf      the compression of h5py
//! ```
//!
//! The rest of `io` is [`lastlight_files`], re-exported here.

pub mod captures;
pub mod gltf;
mod hdf5;
mod lzf;
pub mod makehuman;
pub mod obj;
pub mod objects;
pub mod pickle;
pub mod ply_mesh;
pub mod smpl;

#[doc(no_inline)]
pub use lastlight_files::*;
