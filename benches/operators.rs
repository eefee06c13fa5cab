//! Every operator of the list on its own generated case, forward and with gradients, in f32 and in the f64
//! twin.
//!
//! The list drives this file: an operator that is added there is timed here. The cases are small, so these
//! figures compare a change with the day before; for throughput see the benches `splat`, `gemm` and `loss`.

use criterion::{Criterion, criterion_group, criterion_main};
use lastlight::ops::{self, Call, Case};

fn operators(c: &mut Criterion) {
    for op in ops::LIST {
        let Case { inputs, settings } = (op.case)(0);
        let mut call = Call { inputs, settings, ..Call::default() };
        c.bench_function(&format!("{} f32 forward", op.name), |b| b.iter(|| ops::run(op, &call)));
        let outputs = ops::run(op, &call).expect("a generated case runs").outputs;
        if op.adjoint {
            call.cotangents = ops::draw_cotangents(op, &outputs);
            c.bench_function(&format!("{} f32 with gradients", op.name), |b| b.iter(|| ops::run(op, &call)));
        }
        c.bench_function(&format!("{} f64 twin", op.name), |b| b.iter(|| ops::run_f64(op, &call)));
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10);
    targets = operators
}
criterion_main!(benches);
