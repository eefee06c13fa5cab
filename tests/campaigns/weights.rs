//! A file of LPIPS weights.

use crate::lpips_weights::torchvision;
use lastlight::io::safetensors;
use lastlight::loss::lpips::Weights;
use std::collections::BTreeMap;

/// The weights by formula, under torchvision's names.
pub(crate) fn formula() -> Vec<u8> {
    safetensors::to_bytes(&torchvision(&Weights::by_formula()), &BTreeMap::new())
}
