//! The dynamics linearised, A and B, one state, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::Linearization;

fn main() {
    common::header("The dynamics linearised, A and B, one state, workspace kept; items are bodies");
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn linearize(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        6 * nv * nv,
        Linearization::new(&example.layout),
        |work, e, s, out| {
            let (a, b) = out.split_at_mut(4 * nv * nv);
            work.run(&e.layout, &s.q, &s.v, &s.x, None, a, b)
        },
    ));
}
