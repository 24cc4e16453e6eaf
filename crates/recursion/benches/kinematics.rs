//! Poses, velocities and accelerations of all bodies, one state, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::Kinematics;

fn main() {
    common::header(
        "Poses, velocities and accelerations of all bodies, one state, workspace kept; items are bodies",
    );
    divan::main();
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn kinematics(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        12,
        Kinematics::new(&example.layout),
        |work, e, s, out| {
            work.set_position(&e.layout, &s.q)?;
            work.set_velocity(&e.layout, &s.v)?;
            work.set_acceleration(&e.layout, &s.v, &s.x)?;
            out[..6].copy_from_slice(&work.acceleration(&e.layout, Some(e.model.len() - 1)).to_array());
            Ok(())
        },
    ));
}
