//! The inverse of the mass matrix, all nv×nv entries, and its product with one vector; one state, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::{MassMatrixInverse, MassMatrixSolution};

fn main() {
    common::header(
        "The inverse of the mass matrix, all nv×nv entries, and its product with one vector; one state, workspace kept; items are bodies",
    );
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn mass_matrix_inverse(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        nv * nv,
        MassMatrixInverse::new(&example.layout),
        |work, e, s, out| work.run(&e.layout, &s.q, out),
    ));
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn solve_mass_matrix(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        nv,
        MassMatrixSolution::new(&example.layout),
        |work, e, s, out| work.run(&e.layout, &s.q, &s.x, out),
    ));
}
