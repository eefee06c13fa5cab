//! The twin: every operator of lastlight once more, in f64, on one thread, in naive loops.
//!
//! It exists to be trusted, not to be fast. It is written from the equations alone, depends on `libm` and nothing else, and
//! cannot see the code it is compared with. Each operator is one function over [`scalar::Scalar`]; with `f64` it gives
//! values, with [`dual::Dual`] directional derivatives, with [`rev::Rev`] gradients, so nobody derives a gradient by hand here.
//! The path and name of a twin are those of its operator, and so are the names and the order of its inputs. Beside its
//! function every twin has a [`ports::Signature`]: the table of its inputs, outputs and settings, read by both sides.
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
