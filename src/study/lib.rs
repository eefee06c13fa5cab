//! Level 12 of lastlight: experiments that compare settings of the systems.
#![forbid(unsafe_code)]

pub mod last;
pub mod lirm;

use lastlight_import::{io, scene};
use lastlight_kernels::{loss, shade};
use lastlight_num::{Error, Result, math, num};
use lastlight_train::{experiment, fit};
