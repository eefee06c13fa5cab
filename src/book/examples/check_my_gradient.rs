//! Checks a user-supplied gradient: a correct one and one with a common mistake.
//!
//! `cargo run --release --example check_my_gradient`

use lastlight::check::{self, Options, Values};
use lastlight::{Error, Result};

/// Computes y = v/‖v‖ for a vector of three numbers.
fn normalise(x: &Values) -> Result<Vec<f64>> {
    let v = &x["v"];
    let length = norm(v);
    Ok(v.iter().map(|v| v / length).collect())
}

/// Computes the correct gradient, v̄ = (ȳ − y (y·ȳ)) / ‖v‖.
fn right(x: &Values, y_bar: &[f64]) -> Result<Values> {
    let (y, length) = (normalise(x)?, norm(&x["v"]));
    let radial = y.iter().zip(y_bar).fold(0.0, |s, (y, b)| s + y * b);
    let v_bar = y.iter().zip(y_bar).map(|(y, b)| (b - y * radial) / length).collect();
    Ok([("v".to_owned(), v_bar)].into())
}

/// Treats the length as a constant: every entry is present and finite, but the direction is wrong.
fn wrong(x: &Values, y_bar: &[f64]) -> Result<Values> {
    let length = norm(&x["v"]);
    Ok([("v".to_owned(), y_bar.iter().map(|b| b / length).collect())].into())
}

fn norm(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |s, v| s + v * v).sqrt()
}

fn main() -> Result<()> {
    let inputs: Values = [("v".to_owned(), vec![0.6, -1.1, 0.3])].into();
    let good = check::function("normalise", normalise, right, &inputs, &Options::default())?;
    println!("{good}");
    let bad = check::function("normalise, length forgotten", normalise, wrong, &inputs, &Options::default())?;
    println!("{bad}");
    if good.passed() && !bad.passed() {
        println!("the right one passed, the wrong one did not");
        return Ok(());
    }
    Err(Error::check("check_my_gradient").expected("one to pass and one to fail"))
}
