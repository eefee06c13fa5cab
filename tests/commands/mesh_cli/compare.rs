//! What `mesh compare` measures.

use super::{done, refused, write};
use crate::program::{json, lastlight};

#[test]
fn distances_are_those_of_closed_forms() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    // y up: squares at heights 0 and ¼, the second turned over.
    write(&dir.join("a.obj"), "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nf 1 2 3 4\n");
    write(&dir.join("b.obj"), "v 0 0.25 0\nv 1 0.25 0\nv 1 0.25 1\nv 0 0.25 1\nf 4 3 2 1\n");
    let compare = |a: &'static str, b: &'static str, more: &[&'static str]| {
        let base = ["mesh", "compare", a, b, "--surface-samples", "2000", "--json"];
        json(&base.iter().chain(more).copied().collect::<Vec<_>>(), dir)
    };
    let c = compare("a.obj", "b.obj", &["--tau", "0.3"]);
    for way in ["a_to_b", "b_to_a"] {
        for what in ["mean", "rms", "max"] {
            assert!((c[way][what].as_f64().expect("a number") - 0.25).abs() < 1e-6, "{way} {what}: {c}");
        }
        assert_eq!(c[way]["within"], 1.0, "{way}: all within tau");
    }
    assert_eq!((&c["f_score"], &c["tau"], &c["samples"]), (&1.0.into(), &0.3.into(), &2000.into()), "{c}");
    assert!((c["normal_consistency"].as_f64().expect("a number") - 1.0).abs() < 1e-6, "parallel: {c}");
    assert!((c["area"][0].as_f64().expect("a number") - 1.0).abs() < 1e-6, "area: {c}");
    let chamfer = c["chamfer_mean"].as_f64().expect("a number");
    assert!((0.25..0.27).contains(&chamfer), "samples lie at most a little aside: {chamfer}");
    let sum = c["chamfer_sum"].as_f64().expect("a number");
    assert!((sum - 2.0 * chamfer).abs() < 1e-12, "sum {sum} and mean {chamfer}");
    let none = compare("a.obj", "b.obj", &["--tau", "0.2"]);
    assert_eq!((&none["f_score"], &none["a_to_b"]["within"]), (&0.0.into(), &0.0.into()), "{none}");
    let same = compare("a.obj", "a.obj", &[]);
    assert!(same["a_to_b"]["max"].as_f64().expect("a number") < 1e-9 && same["f_score"] == 1.0, "{same}");
    assert_ne!(
        compare("a.obj", "b.obj", &["--seed", "1"])["chamfer_mean"],
        c["chamfer_mean"],
        "other samples"
    );
    let base = ["mesh", "compare", "a.obj", "b.obj"];
    let text = done(&base, dir);
    for word in ["Chamfer, mean (L1)", "normal consistency", "F-score", "A to B", "area 1.000000"] {
        assert!(text.contains(word), "'{word}' in {text}");
    }
    for tau in ["nan", "-1", "inf"] {
        refused(&[&base[..], &[&*format!("--tau={tau}").leak()]].concat(), dir, &["--tau"]);
    }
    assert_eq!(
        lastlight(&[&base[..], &["--surface-samples", "0"]].concat(), dir).status.code(),
        Some(2),
        "no samples"
    );
    refused(&["mesh", "compare", "a.obj", "none.obj"], dir, &["none.obj"]);
    write(&dir.join("flat.obj"), "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    refused(&["mesh", "compare", "a.obj", "flat.obj"], dir, &["area"]);
}
