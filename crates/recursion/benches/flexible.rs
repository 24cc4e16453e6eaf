//! Forward dynamics of one state of an arm of seven flexible links, workspace kept.

mod common;

use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_model::{Beam, Body, Joint, JointKind, Model, ModelBuilder, Section};
use phipsi_recursion::{ForwardDynamics, InverseDynamics, Layout};
use std::hint::black_box;

/// Modes of each link: eigenfunctions and cubics in two planes, and torsion.
const MODES: [usize; 3] = [3, 7, 13];

fn main() {
    common::header(
        "Dynamics of one state of an arm of seven flexible links, workspace kept; items are bodies",
    );
    divan::main();
}

fn arm(modes: usize) -> Model {
    let section = Section {
        mass_per_length: 1.0,
        bending_stiffness: [30.0, 20.0],
        torsional_stiffness: 20.0,
        polar_inertia: 0.01,
        axial_stiffness: 1e4,
    };
    let bending = match modes {
        3 => [1, 0],
        7 => [1, 1],
        _ => [4, 4],
    };
    let torsion = modes - bending.iter().map(|n| if *n > 0 { n + 2 } else { 0 }).sum::<usize>();
    let beam = Beam::new(0.5, section).bending(bending).torsion(torsion).build();
    let mut builder = ModelBuilder::new("arm");
    for k in 0..7 {
        let (body, joint) = (format!("link{k}"), format!("joint{k}"));
        let axis = if k % 2 == 0 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        let joint = Joint::new(joint, JointKind::Revolute { axis });
        builder = builder.body(Body::flexible(body.as_str(), beam.clone()));
        builder = match k {
            0 => builder.joint(joint, "world", body),
            _ => builder.joint_at_node(joint, format!("link{}", k - 1), "tip", body),
        };
    }
    builder.build().expect("a valid model")
}

#[divan::bench(args = MODES, min_time = 0.1)]
fn forward_dynamics(bencher: Bencher<'_, '_>, modes: usize) {
    let model = arm(modes);
    let layout = Layout::<f64>::new(&model);
    let (state, mut out) = (model.random_state(1), vec![0.0; model.nv()]);
    let mut work = ForwardDynamics::new(&layout);
    bencher.counter(ItemsCount::new(model.len())).bench_local(|| {
        let (q, v) = black_box((&state.q, &state.v));
        work.run(&layout, q, v, v, None, &mut out).expect("a regular state");
    });
}

#[divan::bench(args = MODES, min_time = 0.1)]
fn inverse_dynamics(bencher: Bencher<'_, '_>, modes: usize) {
    let model = arm(modes);
    let layout = Layout::<f64>::new(&model);
    let (state, mut out) = (model.random_state(1), vec![0.0; model.nv()]);
    let mut work = InverseDynamics::new(&layout);
    bencher.counter(ItemsCount::new(model.len())).bench_local(|| {
        let (q, v) = black_box((&state.q, &state.v));
        work.run(&layout, q, v, v, None, &mut out).expect("lengths that fit");
    });
}
