//! The operators of this folder against PyTorch in double precision, values and gradients, on their generated cases.

use crate::common::not_run;
use lastlight::io::npz;
use lastlight::num::array::{Array, Arrays};
use lastlight::ops::{self, Call, Setting};
use std::process::Command;

/// Reads IN.npz for every case in a folder and writes OUT.npz: outputs, and gradients as `NAME_bar`.
const SCRIPT: &str = r#"
import glob, sys
import numpy as np
import torch
import torch.nn.functional as F

def first(x):
    return x.permute(0, 3, 1, 2)

def last(x):
    return x.permute(0, 2, 3, 1)

def tokens(x):
    z = sum(F.conv2d(first(x[name]), first(x["w_" + name]), stride=x["w_image"].shape[1])
            for name in ["image", "rays", "photo"] if name in x)
    return {"tokens": F.layer_norm(last(z) + x["bias"], x["bias"].shape, x["norm_gain"], x["norm_bias"], float(x["setting_eps"]))}

def fuse(x):
    u = F.gelu(F.linear(torch.cat([x["state"], x["position"]], 1), x["w1"], x["b1"]))
    u = F.linear(u, x["w2"], x["b2"])
    return {"tokens": x["position"] + u if x["setting_residual"] else u}

def unpatch(x):
    y = F.conv_transpose2d(first(x["tokens"]), first(x["weight"]), x["bias"], stride=x["weight"].shape[1])
    return {"y": last(y)}

for path in glob.glob(sys.argv[1] + "/*.in.npz"):
    x = {name: torch.from_numpy(a).double() for name, a in np.load(path).items()}
    bars = {name: x.pop(name) for name in list(x) if name.endswith("_bar")}
    leaves = {name: a.requires_grad_() for name, a in x.items() if not name.startswith("setting_")}
    made = globals()[path.split("/")[-1].split(".")[0]](x)
    for name, y in made.items():
        y.backward(bars[name + "_bar"])
    out = {name: y.detach().numpy() for name, y in made.items()}
    out.update({name + "_bar": a.grad.numpy() for name, a in leaves.items()})
    np.savez(path.replace(".in.", ".out."), **out)
"#;

fn relative(ours: &Array, theirs: &Array) -> f64 {
    assert_eq!(ours.shape(), theirs.shape(), "the shape of an array");
    let (ours, theirs) = (ours.to_f64(), theirs.to_f64());
    let sum = |f: &dyn Fn(usize) -> f64| (0..ours.len()).fold(0.0, |sum, i| sum + f(i) * f(i)).sqrt();
    sum(&|i| ours[i] - theirs[i]) / sum(&|i| theirs[i])
}

#[test]
fn values_and_gradients_are_those_of_pytorch() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut calls = Vec::new();
    for name in ["tokens", "fuse", "unpatch"] {
        let op = ops::find(&format!("nn.{name}")).expect("on the list");
        for case in 0..op.cases {
            let ops::Case { inputs, settings } = (op.case)(case);
            let mut call = Call { inputs, settings, ..Call::default() };
            call.cotangents = ops::draw_cotangents(op, &ops::run(op, &call).expect("it runs").outputs);
            let mut given = call.inputs.clone();
            for (output, bar) in &call.cotangents.0 {
                given.0.insert(format!("{output}_bar"), bar.clone());
            }
            let eps = match call.settings.get("eps") {
                Some(Setting::Number(eps)) => *eps,
                _ => 1e-6,
            };
            given.put("setting_eps", &[], vec![eps]);
            given.put("setting_residual", &[], vec![f64::from(u8::from(call.settings.contains_key("fuse")))]);
            npz::write(&folder.path().join(format!("{name}.{case}.in.npz")), &given).expect("written");
            calls.push((op, call, format!("{name}.{case}.out.npz")));
        }
    }
    let script = folder.path().join("peer.py");
    std::fs::write(&script, SCRIPT).expect("written");
    let python = std::env::var("LASTLIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has_torch = Command::new(&python).args(["-c", "import numpy, torch"]).output();
    if !has_torch.is_ok_and(|o| o.status.success()) {
        return not_run("python3 with numpy and torch: tokens, fuse and unpatch against PyTorch");
    }
    let ran = Command::new(&python).arg(&script).arg(folder.path()).output().expect("it started before");
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));

    for (op, call, file) in calls {
        let theirs = npz::read(&folder.path().join(&file)).expect("made");
        let runs =
            [("f64", ops::run_f64(op, &call), [1e-12, 1e-10]), ("f32", ops::run(op, &call), [2e-6, 2e-5])];
        for (precision, ran, bounds) in runs {
            let ran = ran.expect("it runs");
            let bars = ran.gradients.0.iter().map(|(name, a)| (format!("{name}_bar"), a.clone()));
            let ours =
                Arrays(ran.outputs.0.iter().map(|(name, a)| (name.clone(), a.clone())).chain(bars).collect());
            assert!(ours.0.keys().eq(theirs.0.keys()), "{file}: the same arrays");
            for (name, array) in &ours.0 {
                let error = relative(array, theirs.need(name).expect("the same arrays"));
                let bound = bounds[usize::from(name.ends_with("_bar"))];
                println!("{file} {precision} {name}: {error:.1e}");
                assert!(error <= bound, "{file} {precision} {name}: relative L2 {error:e}");
            }
        }
    }
}
