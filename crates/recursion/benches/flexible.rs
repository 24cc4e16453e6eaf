//! Dynamics of one state of an arm of flexible links, workspace kept: cost of modes and of bodies.

mod common;

use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_model::{Beam, BeamModes, Body, Joint, JointKind, Model, ModelBuilder, Placement, Section};
use phipsi_recursion::{ForwardDynamics, InverseDynamics, Layout};
use std::hint::black_box;

/// An arm: bodies, and modes of each.
#[derive(Clone, Copy, Debug)]
struct Arm(usize, usize);

impl std::fmt::Display for Arm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} bodies, {} modes each", self.0, self.1)
    }
}

const ARMS: [Arm; 7] = [Arm(7, 0), Arm(7, 2), Arm(7, 6), Arm(7, 20), Arm(70, 2), Arm(70, 6), Arm(70, 20)];

fn main() {
    common::header("Dynamics of one state of an arm of flexible links, workspace kept; items are bodies");
    divan::main();
}

fn arm(Arm(bodies, modes): Arm) -> Model {
    let section = Section {
        mass_per_length: 1.0,
        bending_stiffness: [30.0, 20.0],
        torsional_stiffness: 20.0,
        polar_inertia: 0.01,
        axial_stiffness: 1e4,
    };
    let beam = Beam::new(0.5, section).family(BeamModes::ClampedFree).bending([modes / 2; 2]).build();
    let rigid = beam.integrals.undeformed();
    let mut builder = ModelBuilder::new("arm");
    for k in 0..bodies {
        let (body, joint) = (format!("link{k}"), format!("joint{k}"));
        let axis = if k % 2 == 0 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        let joint = Joint::new(joint, JointKind::Revolute { axis });
        let tip = Placement { translation: [0.5, 0.0, 0.0], ..Placement::IDENTITY };
        builder = builder.body(match modes {
            0 => Body::new(body.as_str(), rigid),
            _ => Body::flexible(body.as_str(), beam.clone()),
        });
        builder = match k {
            0 => builder.joint(joint, "world", body),
            _ if modes == 0 => builder.joint(joint.at(tip), format!("link{}", k - 1), body),
            _ => builder.joint_at_node(joint, format!("link{}", k - 1), "tip", body),
        };
    }
    builder.build().expect("a valid model")
}

#[divan::bench(args = ARMS, min_time = 0.1)]
fn forward_dynamics(bencher: Bencher<'_, '_>, case: Arm) {
    let model = arm(case);
    let layout = Layout::<f64>::new(&model);
    let (state, mut out) = (model.random_state(1), vec![0.0; model.nv()]);
    let mut work = ForwardDynamics::new(&layout);
    bencher.counter(ItemsCount::new(model.len())).bench_local(|| {
        let (q, v) = black_box((&state.q, &state.v));
        work.run(&layout, q, v, v, None, &mut out).expect("a regular state");
    });
}

#[divan::bench(args = ARMS, min_time = 0.1)]
fn inverse_dynamics(bencher: Bencher<'_, '_>, case: Arm) {
    let model = arm(case);
    let layout = Layout::<f64>::new(&model);
    let (state, mut out) = (model.random_state(1), vec![0.0; model.nv()]);
    let mut work = InverseDynamics::new(&layout);
    bencher.counter(ItemsCount::new(model.len())).bench_local(|| {
        let (q, v) = black_box((&state.q, &state.v));
        work.run(&layout, q, v, v, None, &mut out).expect("lengths that fit");
    });
}
