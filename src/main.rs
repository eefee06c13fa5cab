//! The `lastlight` binary: everything is in `lastlight::cli`.
fn main() {}
