//! Tests of level 0: where bits are decided.

mod elem;

/// Whether the exhaustive sweeps run; says so once when they do not.
fn long(what: &str) -> bool {
    let on = std::env::var_os("LASTLIGHT_LONG").is_some_and(|v| v == "1");
    if !on {
        println!("not run: {what} (set LASTLIGHT_LONG=1)");
    }
    on
}
