//! `oracle run | compare | mint | list` and `gradcheck` on files: golden arrays of other programs, plans that
//! freeze, the first operator at which two files diverge, bytes that do not move, and input that is refused.

mod compare;
mod files;
mod golden;
mod input;
mod plan;

use lastlight::num::array::Arrays;
use lastlight::ops::{self, Call, Op};
use lastlight::oracle::run::{self, Precision};

/// A file's arrays as a call.
fn sorted(op: &'static Op, arrays: &Arrays, profile: Option<&str>) -> Call {
    let mut sorted = run::sort(op, arrays.clone()).unwrap_or_else(|e| panic!("{e}"));
    run::add_settings(op, &mut sorted.call.settings, profile, &[]).unwrap_or_else(|e| panic!("{e}"));
    Call { dump: true, ..sorted.call }
}

fn run_file(op: &'static Op, arrays: &Arrays, profile: Option<&str>, precision: Precision) -> Arrays {
    let call = sorted(op, arrays, profile);
    run::gather(&run::call(op, &call, precision).unwrap_or_else(|e| panic!("{e}")))
}

/// A generated case as a call with cotangents and everything dumped.
fn full_call(op: &'static Op, case: usize) -> Call {
    let made = (op.case)(case);
    let mut call = Call { inputs: made.inputs, settings: made.settings, dump: true, ..Call::default() };
    let first = ops::run(op, &call).unwrap_or_else(|e| panic!("{e}"));
    if op.adjoint {
        call.cotangents = ops::draw_cotangents(op, &first.outputs);
    }
    call
}
