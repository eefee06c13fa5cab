//! From images to tokens and back.

mod rays;
