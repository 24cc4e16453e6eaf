//! Articulated inertias and gains of one state, and a solution with them; workspaces kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::{ArticulatedSweep, articulated_sweep::SolveWorkspace};

fn main() {
    common::header(
        "Articulated inertias and gains of one state, and a solution with them; workspaces kept; items are bodies",
    );
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn update(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        1,
        ArticulatedSweep::new(&example.layout, &example.states[0].q).expect("a regular state"),
        |work, e, s, _| work.update(&e.layout, &s.q),
    ));
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn solve_in_place(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        nv,
        (
            ArticulatedSweep::new(&example.layout, &example.states[0].q).expect("a regular state"),
            SolveWorkspace::new(&example.layout),
        ),
        |work, e, s, out| {
            out.copy_from_slice(&s.x);
            work.0.solve_in_place(&e.layout, out, &mut work.1);
            Ok(())
        },
    ));
}
