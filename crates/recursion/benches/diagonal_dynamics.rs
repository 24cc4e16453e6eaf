//! Forward dynamics in normalised diagonal velocities, one state, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::{DiagonalDynamics, DiagonalVelocity};

fn main() {
    common::header(
        "Forward dynamics in normalised diagonal velocities, one state, workspace kept; items are bodies",
    );
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn diagonal_dynamics(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        2 * nv,
        DiagonalDynamics::new(&example.layout),
        |work, e, s, out| {
            let (v, rate) = out.split_at_mut(nv);
            let kind = DiagonalVelocity::Normalized;
            work.run(&e.layout, &s.q, &s.v, &s.x, None, kind, v, rate)
        },
    ));
}
