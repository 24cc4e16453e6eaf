//! The compliances of all bodies, 6×6 each, one state, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::Upsilon;

fn main() {
    common::header("The compliances of all bodies, 6×6 each, one state, workspace kept; items are bodies");
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn upsilon(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        36 * example.model.len(),
        Upsilon::new(&example.layout),
        |work, e, s, out| work.run(&e.layout, &s.q, out),
    ));
}
