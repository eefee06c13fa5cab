//! What this build is and the machine it runs on: `--version --verbose`, `doctor`, records and reports.

use crate::num::bits::Digest;
use crate::num::{gemm, par};
use serde_json::{Map, Value};

/// The version of the package.
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The table of digests that the tests hold.
const BITS: &[u8] = include_bytes!("../../tests/bits.toml");

/// f32 lanes of one register in this build.
pub(crate) const LANES: usize = if cfg!(target_feature = "avx512f") {
    16
} else if cfg!(target_feature = "avx") {
    8
} else {
    4
};

/// The processor by its name where the system tells it, else by its architecture.
fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}

/// Names and values of what identifies this build and this machine.
pub(crate) fn facts() -> [(&'static str, String); 7] {
    let mut table = Digest::new();
    table.bytes(BITS);
    [
        ("commit", env!("LASTLIGHT_COMMIT").to_owned()),
        ("rustc", env!("LASTLIGHT_RUSTC").to_owned()),
        ("build", if cfg!(debug_assertions) { "debug" } else { "release" }.to_owned()),
        ("processor", processor()),
        ("threads", par::threads().to_string()),
        ("lanes", format!("{LANES} of f32, {} in matrix products", gemm::product_lanes())),
        ("bit table", format!("{:016x}", table.value())),
    ]
}

/// The same as a record.
pub(crate) fn record() -> Map<String, Value> {
    facts().into_iter().map(|(name, value)| (name.replace(' ', "_"), Value::String(value))).collect()
}

/// What `--version` prints, with everything in [`facts`] if `verbose`.
pub(crate) fn text(verbose: bool) -> String {
    let mut text = format!("lastlight {VERSION}");
    if verbose {
        facts().iter().for_each(|(name, value)| text += &format!("\n{name:<10} {value}"));
    }
    text
}
