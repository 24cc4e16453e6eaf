//! Derivatives of the accelerations by q, v and forces, three nv×nv matrices, one state, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls, thirds};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::ForwardDynamicsDerivatives;

fn main() {
    common::header(
        "Derivatives of the accelerations by q, v and forces, three nv×nv matrices, one state, workspace kept; items are bodies",
    );
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn forward_dynamics_derivatives(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        3 * nv * nv,
        ForwardDynamicsDerivatives::new(&example.layout),
        |work, e, s, out| {
            let [d_dq, d_dv, d_dtau] = thirds(out);
            work.run(&e.layout, &s.q, &s.v, &s.x, None, d_dq, d_dv, d_dtau)
        },
    ));
}
