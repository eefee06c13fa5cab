//! Files of `weights/`, whose README says how each was made: bytes and nothing else, so that every package that reads them has them.

/// The image-to-point model of the built-in figure, safetensors.
pub const FIGURE64: &[u8] = include_bytes!("../weights/figure64.safetensors");
