//! The wrench through every joint, one state, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::JointReactions;
use phipsi_spatial::Wrench;

fn main() {
    common::header("The wrench through every joint, one state, workspace kept; items are bodies");
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn joint_reactions(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        6 * example.model.len(),
        (JointReactions::new(&example.model, &example.layout), vec![Wrench::zero(); example.model.len()]),
        |work, e, s, out| {
            work.0.run(&e.layout, &s.q, &s.v, &s.x, None, &mut work.1)?;
            out.as_chunks_mut::<6>().0.iter_mut().zip(&work.1).for_each(|(row, w)| *row = w.to_array());
            Ok(())
        },
    ));
}
