//! The files of `weights/`, embedded as bytes so that every package can use them. Their README describes how
//! they were made.

/// The image-to-point model of the built-in figure, safetensors.
pub const FIGURE64: &[u8] = include_bytes!("../weights/figure64.safetensors");
