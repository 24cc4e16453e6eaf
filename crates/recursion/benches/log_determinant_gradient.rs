//! All derivatives of ln det M, one state, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::LogDeterminantGradient;

fn main() {
    common::header("All derivatives of ln det M, one state, workspace kept; items are bodies");
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn log_determinant_gradient(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        nv,
        LogDeterminantGradient::new(&example.layout),
        |work, e, s, out| work.run(&e.layout, &s.q, out),
    ));
}
