//! The `lastlight` binary: everything is in `lastlight::cli`.

fn main() -> std::process::ExitCode {
    lastlight::cli::main()
}
