//! Bytes ↔ plain records. Level 2: has no notion of scenes.
//!
//! ```text
//! npz, npy       named arrays            safetensors   named arrays with text metadata (checkpoints)
//! ply            any PLY, strictly       gaussian_ply  3DGS scenes and coloured points in PLY
//! splat_file     .splat, 32 bytes each   image_file    PNG, JPEG, WebP, TIFF, BMP, HDR, OpenEXR; image_data: as records
//! transforms     transforms.json in three dialects     colmap  sparse models, binary and text
//! capture        detects the layout of a folder        frame   images with poses and lenses, as records
//! person         captures of moving people: the one layout
//! memory         the limit, --max-memory               lock   one program at a time in a folder
//! paths          paths written in files                atomic  atomic writes
//! ```
//!
//! The formats of other programs (glTF, OBJ, pickle, HDF5, published captures) are in `lastlight_import`,
//! which re-exports this member.
//!
//! Every reader has two forms: `read(path)`, and `parse(bytes, name)` for bytes already in memory, where
//! `name` is the file name in errors. A reader checks every declared size against the available bytes
//! **before** it allocates, so memory is bounded by a small multiple of the file; a decoder of another crate
//! runs inside [`guard`], which turns its panic into an [`Error`]. Errors name the file, the place in it, the
//! expected and the actual value. Writers give the same bytes for the same record on every machine and go
//! through [`atomic::write()`].
#![forbid(unsafe_code)]

pub mod atomic;
#[doc(hidden)]
pub mod bytes;
mod camera_path;
pub mod capture;
pub mod colmap;
mod colmap_model;
pub mod colmap_text;
pub mod frame;
pub mod gaussian_ply;
pub mod image_data;
mod image_exr;
pub mod image_file;
mod image_format;
pub mod json;
pub mod lock;
pub mod memory;
#[doc(hidden)]
pub mod npy;
pub mod npz;
pub mod paths;
pub mod person;
pub mod ply;
mod ply_data;
mod read;
mod reading;
pub mod safetensors;
pub mod splat_file;
pub mod transforms;

pub use read::{
    MAX_FILE_BYTES, MAX_SMALL_FILE_BYTES, beside, digest, guard, hex, identity, name_of, read_bytes,
};

#[doc(hidden)]
pub extern crate self as io;
#[doc(hidden)]
pub use lastlight_num::{Error, Result, error, math, num, with_array};
