//! The inertia that the last body shows, 6×6, one state, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::OperationalSpaceInertia;

fn main() {
    common::header("The inertia that the last body shows, 6×6, one state, workspace kept; items are bodies");
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn operational_space_inertia(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        36,
        OperationalSpaceInertia::new(&example.layout),
        |work, e, s, out| work.run(&e.layout, &s.q, Some(e.model.len() - 1), None, out).map(drop),
    ));
}
