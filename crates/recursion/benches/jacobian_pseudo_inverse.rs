//! Joint rates for a motion of the last body by singular values, one state, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::{JacobianPseudoInverse, PseudoInverseOptions, Tip};

fn main() {
    common::header(
        "Joint rates for a motion of the last body by singular values, one state, workspace kept; items are bodies",
    );
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn jacobian_pseudo_inverse(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nv = example.layout.nv();
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        nv,
        JacobianPseudoInverse::new(&example.layout, 1),
        |work, e, s, out| {
            let tip = [Tip { body: Some(e.model.len() - 1), point: None }];
            work.update(&e.layout, &s.q, &tip, PseudoInverseOptions::default())?;
            work.solve(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6], out)
        },
    ));
}
