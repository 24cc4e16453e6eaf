//! Inverse kinematics of the last body from random states, workspace kept.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::{InverseKinematics, InverseKinematicsOptions, body_pose};

fn main() {
    common::header(
        "Inverse kinematics of the last body from random states, workspace kept; items are bodies",
    );
    divan::main();
}

/// The last body to the pose of another state: from one state to the next.
#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn inverse_kinematics(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::named(model);
    let nq = example.layout.nq();
    let body = example.model.len() - 1;
    let target = body_pose(&example.layout, &example.states[0].q, Some(body)).expect("a state");
    bencher.counter(ItemsCount::new(example.layout.len())).bench_local(calls(
        &example,
        nq,
        InverseKinematics::new(&example.model, &example.layout),
        |work, e, s, out| {
            let options = InverseKinematicsOptions::default();
            work.run(&e.model, &e.layout, body, &target, &s.q, options, out).map(drop)
        },
    ));
}
