//! The mass matrix of one state, all nv×nv entries, workspace kept, kinematics included.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::MassMatrix;

fn main() {
    common::header(
        "The mass matrix of one state, all nv×nv entries, workspace kept, kinematics included; items are bodies",
    );
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn mass_matrix(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        nv * nv,
        MassMatrix::new(&example.layout),
        |work, e, s, out| work.run(&e.layout, &s.q, out),
    ));
}
