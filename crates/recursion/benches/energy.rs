//! Kinetic and potential energy, one state, workspaces kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::energy::{CenterOfMass, KineticEnergy};

fn main() {
    common::header("Kinetic and potential energy, one state, workspaces kept; items are bodies");
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn kinetic_energy(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        1,
        KineticEnergy::new(&example.layout),
        |work, e, s, out| {
            out[0] = work.run(&e.layout, &s.q, &s.v)?;
            Ok(())
        },
    ));
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn potential_energy(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        1,
        CenterOfMass::new(&example.layout),
        |work, e, s, out| {
            out[0] = work.potential_energy(&e.layout, &s.q)?;
            Ok(())
        },
    ));
}
