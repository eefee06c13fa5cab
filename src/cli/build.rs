//! Records the commit and the compiler of the build for `lastlight --version --verbose`. Without git, or outside a checkout, the commit is `unknown`.

use std::path::Path;
use std::process::Command;

/// The trimmed output of a program that succeeds.
fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let done = Command::new(program).args(arguments).output().ok()?;
    let text = String::from_utf8(done.stdout).ok()?.trim().to_owned();
    (done.status.success() && !text.is_empty()).then_some(text)
}

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // HEAD changes with a checkout, its log with a commit, also in a linked working tree.
    for name in ["HEAD", "logs/HEAD"] {
        let file = output("git", &["rev-parse", "--git-path", name]);
        if let Some(file) = file.filter(|file| Path::new(file).is_file()) {
            println!("cargo::rerun-if-changed={file}");
        }
    }
    let unknown = || "unknown".to_owned();
    let commit = output("git", &["rev-parse", "--short=12", "HEAD"]).unwrap_or_else(unknown);
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let rustc = output(&rustc, &["--version"]).unwrap_or_else(unknown);
    println!("cargo::rustc-env=LASTLIGHT_COMMIT={commit}");
    println!("cargo::rustc-env=LASTLIGHT_RUSTC={rustc}");
}
