//! Accelerations from forces, one state, workspace kept, kinematics included.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::ForwardDynamics;

fn main() {
    common::header(
        "Accelerations from forces, one state, workspace kept, kinematics included; items are bodies",
    );
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn forward_dynamics(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        nv,
        ForwardDynamics::new(&example.layout),
        |work, e, s, out| work.run(&e.layout, &s.q, &s.v, &s.x, None, out),
    ));
}
