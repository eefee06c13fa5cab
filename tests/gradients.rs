//! Gradient checks of every operator of the list: rungs R0 to R4 on every generated case, and negative controls.

use lastlight::check::{self, Options, Sabotage, Sabotaged, Subject};
use lastlight::ops::{self, OpSubject};

#[test]
fn every_operator_passes_every_rung_on_every_case() {
    let mut failed = Vec::new();
    for op in ops::LIST {
        for case in 0..op.cases {
            let subject = OpSubject::case(op, case).unwrap_or_else(|e| panic!("{} case {case}: {e}", op.name));
            let report = check::run(&subject, &Options::default()).unwrap_or_else(|e| panic!("{} case {case}: {e}", op.name));
            let rungs: Vec<_> = report.rungs.iter().map(|r| r.name).collect();
            let expected: &[&str] = if op.adjoint { &["R0", "R1", "R2", "R3", "R4"] } else { &["R0", "R4"] };
            assert_eq!(rungs, expected, "{}: the rungs that ran", op.name);
            println!("{report}");
            if !report.passed() {
                failed.push(report.to_string());
            }
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}
