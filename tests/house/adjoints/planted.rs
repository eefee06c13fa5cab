//! The checks of adjoints on code written here: what is wrong in it is found, what is right is not.

use super::*;

/// Code written here. Every member has a root that declares its folders.
fn planted(files: &[(&str, &str)]) -> Code {
    let roots = [
        ("kernels/lib.rs", "pub mod nn; pub mod splat; pub mod shade;"),
        ("oracle/lib.rs", "pub mod ops; pub use lastlight_kernels::{nn, splat, shade};"),
        ("last/lib.rs", "pub mod model; pub use lastlight_kernels::{nn, splat, shade};"),
    ];
    let empty = [
        ("kernels/nn/mod.rs", "pub mod linear;"),
        ("kernels/nn/linear.rs", ""),
        ("kernels/splat/mod.rs", "pub mod render;"),
        ("kernels/splat/render.rs", ""),
        ("kernels/shade/mod.rs", "pub mod render;"),
        ("kernels/shade/render.rs", ""),
        ("oracle/ops.rs", "mod nn; pub static LIST: &[&Op] = &[&nn::OP];"),
        (
            "oracle/ops/nn.rs",
            "use crate::nn::linear; static OP: Op = Op { run: run_it, ..entry() }; fn run_it() { linear::adjoint(); }",
        ),
        ("last/model.rs", ""),
        ("kernels/nn/linear/trials.rs", "fn y_bar() {}"),
    ];
    Code::new(&["kernels", "oracle", "last"], &|path| {
        let all = || files.iter().chain(&empty).chain(&roots);
        all().find(|(name, _)| Path::new(name) == path).map(|(_, text)| (*text).to_owned())
    })
}

/// The functions of operators that the list does not reach.
fn unreached(files: &[(&str, &str)]) -> Vec<String> {
    let mut left = Vec::new();
    for (label, is_reached) in planted(files).adjoints() {
        if !is_reached {
            left.push(label);
        }
    }
    left
}

#[test]
fn an_adjoint_that_the_list_does_not_reach_is_found() {
    let linear = |text: &'static str| unreached(&[("kernels/nn/linear.rs", text)]);
    assert!(
        linear("pub fn adjoint() { helper_back() } fn helper_back() {}").is_empty(),
        "called, and what it calls"
    );
    assert_eq!(linear("pub fn other_adjoint() {}"), ["kernels/nn/linear.rs other_adjoint"], "not called");

    // 2. bare words, fields and locals are no calls
    let found = linear(
        "pub fn adjoint() { let spread = 1; x.gradients.put(spread); } pub fn spread() {} impl W { fn gradients() {} }",
    );
    assert_eq!(
        found,
        ["kernels/nn/linear.rs spread", "kernels/nn/linear.rs W::gradients"],
        "a local and a field"
    );
    let found = unreached(&[
        ("kernels/nn/linear.rs", "pub fn adjoint() { spread(1); x.pull_back(); }"),
        ("kernels/splat/render.rs", "pub fn spread() {} impl W { fn pull_back(&self) {} }"),
    ]);
    let both = ["kernels/splat/render.rs spread", "kernels/splat/render.rs W::pull_back"];
    assert_eq!(found, both, "a bare name of a file that is not imported");
    let found = unreached(&[
        (
            "kernels/nn/linear.rs",
            "use crate::splat::render::{W, spread as f}; pub fn adjoint() { f::<u8>(1); x.pull_back(); W::new_bar() }",
        ),
        (
            "kernels/splat/render.rs",
            "pub fn spread() {} impl W { fn pull_back(&self) {} fn new_bar() { Self::own_bar() } fn own_bar() {} } pub struct W;",
        ),
    ]);
    assert!(found.is_empty(), "imported by name, a method, a function of a type, Self: {found:?}");
    let found = linear(
        "pub struct A; pub struct B; impl A { fn x_bar() {} } impl B { fn x_bar() {} } pub fn adjoint() { A::x_bar() }",
    );
    assert_eq!(found, ["kernels/nn/linear.rs B::x_bar"], "another type's");

    // a module of the same name in another folder
    let same = [
        ("kernels/nn/linear.rs", "use crate::splat::render; pub fn adjoint() { render::adjoint_into() }"),
        ("kernels/splat/render.rs", "pub fn adjoint_into() {}"),
        ("kernels/shade/render.rs", "pub fn adjoint_into() {}"),
    ];
    assert_eq!(unreached(&same), ["kernels/shade/render.rs adjoint_into"], "the other render.rs");

    // 3. what follows the declaration of a file of tests; `//` in strings
    let found = linear("pub fn adjoint() {}\n#[cfg(test)]\nmod trials;\nfn x_bar() {}");
    assert_eq!(found, ["kernels/nn/linear.rs x_bar"], "behind a declaration");
    let found = linear(
        "pub fn adjoint() { f(\"http://a\"); x_back(); } fn x_back() {} #[cfg(test)] mod tests { fn y_back() {} }",
    );
    assert!(found.is_empty(), "a call behind a string with slashes, and tests may: {found:?}");

    // 5. functions beside the entries of the list
    let found = unreached(&[
        ("kernels/nn/linear.rs", "pub fn adjoint() {} pub fn lone_adjoint() {}"),
        (
            "oracle/ops/nn.rs",
            "use crate::nn::linear; static OP: Op = Op { run: run_it }; static OFF: Op = Op { run: off };
            fn run_it() { linear::adjoint(); } fn off() { linear::lone_adjoint() }",
        ),
    ]);
    assert_eq!(found, ["kernels/nn/linear.rs lone_adjoint"], "an entry that is not in the list");
    let found = unreached(&[
        ("kernels/nn/linear.rs", "pub fn adjoint() {}"),
        (
            "oracle/ops/nn.rs",
            "use crate::nn::linear; static OP: Op = Op { cases: 2, ..entry() }; const fn entry() -> Op { Op { run: run_it } }
            fn run_it() { both(linear::forward, linear::adjoint) }",
        ),
    ]);
    assert!(found.is_empty(), "handed over by a const fn, and as a value: {found:?}");
}

#[test]
fn an_adjoint_of_a_system_is_found() {
    let system = |text: &'static str| planted(&[("last/model.rs", text)]);
    let names = "impl A { fn shade_adjoint(&self) {} fn grad_x() {} } fn feed_back() {} fn plain() {} fn derivative() {} fn slope_of() {}
        fn jacobian() {} fn backprop() {} fn pullback() {} static GRADIENTS: u8 = 1;";
    let expected = [
        "A::shade_adjoint",
        "A::grad_x",
        "feed_back",
        "derivative",
        "slope_of",
        "jacobian",
        "backprop",
        "pullback",
    ];
    assert_eq!(
        system(names).named_in_systems(),
        expected.map(|name| format!("last/model.rs {name}")),
        "by name"
    );
    let body = "fn run() { bars.mask.iter_mut().zip(along).for_each(|(bar, along)| *bar *= along); }
        #[cfg(test)] mod tests { fn f() { x_bar += 1.0; } }";
    let found = system(body).computed_in_systems();
    assert_eq!(found, [("last/model.rs run".to_owned(), "*bar*=along".to_owned())], "by what it computes");
    assert_eq!(computing_differences(&found, &[]).len(), 1, "an error");
    assert!(
        computing_differences(&found, &[("last/model.rs run", "*bar*=", "a reason")]).is_empty(),
        "excepted"
    );
    assert_eq!(
        computing_differences(&found, &[("last/model.rs run", "*bar+=", "a reason")]).len(),
        2,
        "another one"
    );
    assert_eq!(
        computing_differences(&[], &[("last/model.rs run", "", "a reason")]).len(),
        1,
        "no longer there"
    );
}

#[test]
fn lists_that_are_out_of_date_are_found() {
    let found = ["a.rs f".to_owned(), "a.rs g".to_owned()];
    let wrong = differences(&found, &[("a.rs f", "why"), ("a.rs h", "why"), ("a.rs g", "")]);
    assert_eq!(
        wrong,
        ["a.rs h: listed, but not there or not needed", "a.rs g: no reason"],
        "stale, without reason"
    );
    assert_eq!(differences(&found, &[("a.rs f", "why")]), ["a.rs g: not listed"], "missing");
    let wrong = wrong_folders(&planted(&[]), &[("kernels", 3, &[("nn", "nn", 4), ("new", "new", 4)])]);
    assert!(wrong.contains(&"kernels/new: in 0 tables".to_owned()), "a folder without a table: {wrong:?}");
    assert!(
        wrong.contains(&"kernels/loss: is not there".to_owned()),
        "a table without its folder: {wrong:?}"
    );
    assert!(!wrong.iter().any(|w| w.starts_with("kernels/nn")), "{wrong:?}");
}
