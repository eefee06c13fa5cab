//! Signatures match the twins: names, shapes and element types of everything that is written.

use std::collections::BTreeSet;

use reference::array::{Arr, Named};
use reference::inputs::Dims;
use reference::ports::{Dtype, Kind, Port};
use reference::twins::{self, LIST, Request};

use crate::cases::cases;
use crate::scenes::{named, normal, settings};

/// Holds the arrays to their ports: every array has a port, every port that is not optional has an array.
fn hold(label: &str, ports: &[Port], arrays: &Named<f64>, dims: &mut Dims) {
    for (name, x) in arrays {
        let port = ports.iter().find(|port| port.name == name);
        let port = port.unwrap_or_else(|| panic!("{label}: {name} is in no table"));
        dims.bind(port.shape, &x.shape)
            .unwrap_or_else(|expected| panic!("{label}: {name}: expected {expected}, got {:?}", x.shape));
        let whole = port.dtype == Dtype::Float || x.data.iter().all(|x| x.fract() == 0.0);
        assert!(whole, "{label}: {name}: {} has whole numbers only", port.dtype.name());
    }
    for port in ports.iter().filter(|port| !port.optional) {
        assert!(arrays.contains_key(port.name), "{label}: {} was not written", port.name);
    }
}

fn check(label: &str, request: &Request<'_>) {
    let twin = LIST.iter().find(|twin| twin.signature.name == request.op).expect("a twin");
    let answer = twins::value(request).expect("a value");
    let mut dims = Dims::default();
    hold(label, twin.signature.inputs, request.inputs, &mut dims);
    hold(label, twin.signature.outputs, &answer.outputs, &mut dims);
    hold(label, twin.signature.intermediates, &answer.intermediates, &mut dims);
    hold(label, twin.signature.plan, &answer.plan, &mut dims);
}

#[test]
fn what_a_twin_writes_is_in_its_signature() {
    for case in cases() {
        check(
            case.name,
            &Request { op: case.op, inputs: &case.inputs, settings: &case.settings, plan: None },
        );
    }
    // operators without gradient
    let steps = named([("param", normal(&[4, 2], 90)), ("grads", normal(&[3, 4, 2], 91))]);
    let rays = named([
        ("vertices", normal(&[3, 3], 92)),
        ("triangles", Arr::new(&[1, 3], vec![0.0, 1.0, 2.0])),
        ("origin", normal(&[2, 3], 93)),
        ("direction", normal(&[2, 3], 94)),
    ]);
    for (op, inputs) in [("optim.adam", &steps), ("optim.adamw", &steps), ("geometry.trace", &rays)] {
        check(op, &Request { op, inputs, settings: &settings(&[]), plan: None });
    }
}

#[test]
fn signatures_are_consistent() {
    let mut names = BTreeSet::new();
    for signature in LIST.iter().map(|twin| twin.signature) {
        let name = signature.name;
        assert!(name.contains('.') && names.insert(name), "{name}: one operator of that name");
        let ports = [signature.inputs, signature.outputs, signature.intermediates];
        for group in [&ports.concat()[..], signature.plan] {
            let mut seen = BTreeSet::new();
            for port in group {
                assert!(!port.name.is_empty() && seen.insert(port.name), "{name}: port {} twice", port.name);
                assert!(!port.differentiable || port.dtype == Dtype::Float, "{name}: {} moves", port.name);
            }
        }
        assert!(!signature.summary.is_empty() && !signature.inputs.is_empty(), "{name}: what it does");
        for spec in signature.settings {
            let number = spec.default.parse::<f64>().is_ok_and(f64::is_finite);
            let phrase = spec.default.contains(' ');
            let fits = match spec.kind {
                Kind::Number => number || phrase,
                Kind::Flag => ["0", "1"].contains(&spec.default),
                Kind::Choice(words) => words.contains(&spec.default) || phrase,
            };
            assert!(fits, "{name}: default {} of setting {}", spec.default, spec.key);
        }
    }
}

#[test]
fn settings_are_checked_against_the_signature() {
    let inputs = named([("x", normal(&[2, 2], 95))]);
    let refused = |op: &str, key: &str, value: &str| {
        let chosen = settings(&[(key, value)]);
        twins::value(&Request { op, inputs: &inputs, settings: &chosen, plan: None }).expect_err("refused")
    };
    assert!(refused("nn.leaky_relu", "slop", "0.5").contains("unknown here; known: slope"));
    assert!(refused("nn.leaky_relu", "slope", "steep").contains("expected a number, got steep"));
    assert!(refused("nn.leaky_relu", "slope", "inf").contains("expected a finite number"));
    assert!(refused("loss.lpips", "rescale", "2").contains("expected 0 or 1, got 2"));
    assert!(refused("causal.structure", "mode", "curved").contains("expected one of nonlinear, linear"));
}
