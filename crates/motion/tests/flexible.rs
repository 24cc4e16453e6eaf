//! Simulations with flexible bodies: energy and momentum to rounding and the integrator's error, damping as work.

use crate::common::run;
use phipsi_model::{
    Base, Beam, Body, FlexibleBody, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Section,
};
use phipsi_motion::{Conserved, Dynamics, Method, Midpoint, balance};
use phipsi_recursion::Kinematics;

fn boom(stiffness: f64, damping: f64) -> FlexibleBody {
    let section = Section {
        mass_per_length: 1.0,
        bending_stiffness: [stiffness, 0.7 * stiffness],
        torsional_stiffness: 0.5 * stiffness,
        polar_inertia: 0.01,
        axial_stiffness: 1.0,
    };
    Beam::new(1.0, section).bending([1, 1]).torsion(1).damped(damping).build()
}

/// A free hub with two booms, on a revolute and on a ball joint.
fn satellite(damping: f64) -> Model {
    let hub = Inertia::from_principal(3.0, [0.02, 0.01, -0.03], [0.4, 0.5, 0.6]);
    let to = |x: f64| Placement { translation: [x, 0.1, 0.0], ..Placement::IDENTITY };
    ModelBuilder::new("satellite")
        .gravity([0.0; 3])
        .base(Base::Free)
        .body(Body::new("hub", hub))
        .body(Body::flexible("left", boom(3.0, damping)))
        .body(Body::flexible("right", boom(3.0, damping)))
        .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 0.6, 0.8] }).at(to(-0.4)), "hub", "left")
        .joint(Joint::new("ball", JointKind::Spherical).at(to(0.4)), "hub", "right")
        .build()
        .unwrap()
}

/// Two links in space under gravity.
fn arm() -> Model {
    ModelBuilder::new("arm")
        .body(Body::flexible("upper", boom(20.0, 0.0)))
        .body(Body::flexible("lower", boom(10.0, 0.0)))
        .joint(Joint::new("shoulder", JointKind::Spherical), "world", "upper")
        .joint_at_node(
            Joint::new("elbow", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }),
            "upper",
            "tip",
            "lower",
        )
        .build()
        .unwrap()
}

/// Imbalances of energy and momentum over a run, relative.
fn imbalance(model: &Model, t_end: f64) -> (f64, [f64; 2], f64) {
    let mut dynamics = Dynamics::new(model, vec![]).unwrap();
    let mut state = model.random_state(5);
    state.q[model.joint_nq()..].iter_mut().for_each(|x| *x *= 0.5);
    let mut kinematics = Kinematics::new(dynamics.layout());
    let mut conserved = Conserved::default();
    let aux = vec![0.0; 0];
    let start = vec![0.0; dynamics.auxiliary_names().len()];
    let start = if start.is_empty() { &aux } else { &start };
    conserved.record(&balance(&mut dynamics, &mut kinematics, (0.0, &state.q, &state.v), start).unwrap());
    let (end, _) = run(&mut dynamics, Method::Dop853, 1e-13, &state.q, &state.v, t_end);
    let last = balance(&mut dynamics, &mut kinematics, (t_end, end.q(), end.v()), end.aux()).unwrap();
    conserved.record(&last);
    (conserved.energy_error(), conserved.momentum_error(), last.work)
}

#[test]
fn a_free_hub_with_booms_keeps_energy_and_momentum() {
    let (energy, momentum, work) = imbalance(&satellite(0.0), 2.0);
    println!("energy {energy:e}, momentum {momentum:?}");
    // Local errors of 1e-13 a step, some hundred steps.
    assert!(energy < 2e-12, "{energy:e}");
    assert!(momentum.iter().all(|x| *x < 2e-12), "{momentum:?}");
    assert_eq!(work, 0.0);
}

#[test]
fn an_arm_under_gravity_keeps_energy() {
    let (energy, _, _) = imbalance(&arm(), 2.0);
    println!("energy {energy:e}");
    assert!(energy < 2e-12, "{energy:e}");
}

/// What modal damping takes is in the work.
#[test]
fn damping_is_work() {
    let (energy, momentum, work) = imbalance(&satellite(0.02), 1.0);
    println!("energy {energy:e}, momentum {momentum:?}, work {work}");
    assert!(work < -1e-3, "{work}");
    assert!(energy < 2e-12, "{energy:e}");
    assert!(momentum.iter().all(|x| *x < 2e-12), "{momentum:?}");
}

/// The midpoint method knows rigid bodies only, and says so.
#[test]
fn midpoint_refuses_flexible_bodies() {
    let model = satellite(0.0);
    let state = model.random_state(1);
    let mut dynamics = Dynamics::new(&model, vec![]).unwrap();
    let Err(error) = Midpoint::new(&model, &mut dynamics, 0.0, &state.q, &state.v) else {
        panic!("the midpoint method ran on a flexible body");
    };
    assert!(error.to_string().contains("`left` is flexible"), "{error}");
}
