//! The equations of motion in double-double numbers against those in f64, on generated trees.

use phipsi_motion::forces::{
    BodyWrench, JointDissipation, JointSpring, JointTorque, PointSpring, Servo, WrenchAxes,
};
use phipsi_motion::{Dynamics, Force, Signal, System, WideDynamics, coordinate_rate};
use phipsi_reference::generate::case;
use phipsi_spatial::{Dd, Vec3};

fn forces(model: &phipsi_model::Model) -> Vec<Box<dyn Force>> {
    let mut forces: Vec<Box<dyn Force>> = Vec::new();
    if let Some(k) = model.moving_joints().find(|k| model.joints()[*k].kind.nv() == 1) {
        let (coordinate, dof) = (model.q_offset(k), model.v_offset(k));
        let name = || "joint".to_string();
        forces.push(Box::new(JointSpring {
            name: name(),
            coordinate,
            dof,
            stiffness: 3.0,
            damping: 0.7,
            rest: 0.1,
        }));
        forces.push(Box::new(JointTorque { name: name(), dof, value: Signal::Constant(0.4) }));
        forces.push(Box::new(Servo {
            name: name(),
            coordinate,
            dof,
            target: Signal::Constant(0.3),
            stiffness: 2.0,
            damping: 0.3,
            integral: 0.0,
            limit: f64::INFINITY,
        }));
    }
    let last = model.len() - 1;
    forces.push(Box::new(PointSpring {
        name: "cord".into(),
        bodies: [None, Some(last)],
        points: [Vec3([1.0, 2.0, -3.0]), Vec3([0.1, -0.2, 0.3])],
        stiffness: 4.0,
        damping: 0.9,
        rest_length: 0.5,
    }));
    for axes in [WrenchAxes::World, WrenchAxes::Body] {
        forces.push(Box::new(BodyWrench {
            name: "pull".into(),
            body: 0,
            point: Vec3([0.2, 0.1, -0.3]),
            axes,
            components: [0.3, -0.2, 0.5, 1.0, 2.0, -1.5].map(Signal::Constant),
        }));
    }
    forces
}

#[test]
fn accelerations_are_those_of_f64_to_its_rounding() {
    let seeds: Vec<u64> = match std::env::var("PHIPSI_SEED") {
        Ok(seed) => vec![seed.parse().unwrap()],
        Err(_) => (0..60).collect(),
    };
    let mut looked = 0;
    for seed in seeds {
        let model = case(seed).model;
        if model.refused_closure().is_some() || model.is_empty() {
            continue;
        }
        let mut all = forces(&model);
        if let Some(d) = JointDissipation::new(&model, 0.5).filter(|d| !d.has_friction()) {
            all.push(Box::new(d));
        }
        let mut dynamics = Dynamics::new(&model, all).unwrap();
        let state = model.random_state(seed);
        let mut q = state.q.clone();
        model.normalize(&mut q);
        let aux = vec![0.0; dynamics.auxiliary_len()];
        let (mut v_dot, mut aux_dot) = (vec![0.0; model.nv()], aux.clone());
        // A singular hinge is refused by both.
        if dynamics.derivative(0.0, &q, &state.v, &aux, &mut v_dot, &mut aux_dot).is_err() {
            continue;
        }
        let mut q_dot = vec![0.0; model.nq()];
        coordinate_rate(&model, &q, &state.v, &mut q_dot);
        let mut wide = WideDynamics::new(&dynamics).unwrap();
        let y: Vec<Dd> = q.iter().chain(&state.v).map(|x| Dd::from_f64(*x)).collect();
        let mut rate = vec![Dd::from_f64(0.0); y.len()];
        wide.derivative(&y, &mut rate).unwrap();
        let size = v_dot.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        for (i, (own, wide)) in q_dot.iter().chain(&v_dot).zip(&rate).enumerate() {
            // n ε κ with κ up to 1e5 where light bodies are pulled.
            assert!((own - wide.hi).abs() < 1e-9 * size, "seed {seed}, {i}: {own} {}", wide.hi);
        }
        looked += 1;
    }
    assert!(looked > 0);
}

/// A force that depends on time, or has no such form, says so.
#[test]
fn a_force_that_cannot_be_had_is_not_left_out_silently() {
    let model = case(3).model;
    let value = Signal::function(|t| t.sin(), |t| t.cos());
    let torque = JointTorque { name: "torque".into(), dof: 0, value };
    let dynamics = Dynamics::new(&model, vec![Box::new(torque)]).unwrap();
    assert!(WideDynamics::new(&dynamics).is_none());
}
