//! Forces of every second and accelerations of the other degrees of freedom, one state, workspace kept, kinematics included.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::HybridDynamics;

fn main() {
    common::header("Every second degree of freedom active, one state, workspace kept; items are bodies");
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn hybrid_dynamics(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    let active: Vec<bool> = (0..nv).map(|i| i % 2 == 1).collect();
    let work = (HybridDynamics::new(&example.layout), vec![0.0; nv]);
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        nv,
        work,
        move |(work, tau), e, s, out| {
            out.copy_from_slice(&s.x);
            tau.copy_from_slice(&s.x);
            work.run(&e.layout, &s.q, &s.v, &active, out, tau, None)
        },
    ));
}
