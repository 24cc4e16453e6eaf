//! Momentum about the centre of mass, and the centroidal momentum matrix, 6×nv; one state, workspaces kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::{About, CentroidalMomentumMatrix, Momentum};

fn main() {
    common::header(
        "Momentum about the centre of mass, and the centroidal momentum matrix, 6×nv; one state, workspaces kept; items are bodies",
    );
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn momentum(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        6,
        Momentum::new(&example.layout),
        |work, e, s, out| {
            out.copy_from_slice(&work.run(&e.layout, &s.q, &s.v, About::CenterOfMass)?.to_array());
            Ok(())
        },
    ));
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn centroidal_momentum_matrix(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        6 * nv,
        CentroidalMomentumMatrix::new(&example.layout),
        |work, e, s, out| work.run(&e.layout, &s.q, out),
    ));
}
