//! The twin: a second, independent implementation of every operator of lastlight, in f64, on one thread, with
//! naive loops.
//!
//! It is written for correctness, not speed: from the equations alone, with `libm` as its only dependency and
//! without access to the code it is compared with. Each operator is one function over [`scalar::Scalar`]. With
//! `f64` it computes values, with [`dual::Dual`] directional derivatives, and with [`rev::Rev`] gradients, so no
//! gradient is derived by hand here. A twin has the same path, name, inputs and order of inputs as its
//! operator. Every twin also has a [`ports::Signature`]: the table of its inputs, outputs and settings, used by
//! the twin and by the operator list.
//!
//! ```
//! use reference::{array::Arr, twins};
//! let one = |x| Arr::new(&[1, 1], vec![x]);
//! let inputs = [("x", one(2.0)), ("weight", one(3.0)), ("bias", Arr::new(&[1], vec![0.5]))];
//! let inputs = inputs.map(|(name, x)| (name.to_owned(), x)).into();
//! let request = twins::Request { op: "nn.linear", inputs: &inputs, settings: &Default::default(), plan: None };
//! assert_eq!(twins::value(&request).unwrap().outputs["y"].data, [6.5]);
//! ```
#![forbid(unsafe_code)]

pub mod array;
pub mod body;
pub mod causal;
pub mod dual;
pub mod fd;
pub mod field;
pub mod geometry;
pub mod inputs;
pub mod loss;
pub mod nn;
pub mod num;
pub mod optim;
pub mod ports;
pub mod rev;
pub mod scalar;
pub mod scene;
pub mod settings;
pub mod shade;
pub mod splat;
pub mod twins;
pub mod weights;
