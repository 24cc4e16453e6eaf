//! Simulations with flexible bodies: energy and momentum to rounding and the integrator's error, damping as work.

use crate::common::run;
use phipsi_model::{
    Base, Beam, Body, FlexibleBody, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Section,
};
use phipsi_motion::{
    Conserved, DryFriction, Dynamics, Happening, Integrator, JointSwitch, Method, Midpoint, Mode,
    Prescription, Stops, System, Tolerances, balance,
};
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

/// A boom that falls on its hinge, with stops.
fn falling_boom(damping: f64) -> Model {
    ModelBuilder::new("boom")
        .body(Body::flexible("boom", boom(20.0, damping)))
        .body(Body::new("tool", Inertia::from_principal(0.5, [0.1, 0.0, 0.0], [0.01, 0.02, 0.02])))
        .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "boom")
        .joint_at_node(
            Joint::new("wrist", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }),
            "boom",
            "tip",
            "tool",
        )
        .build()
        .unwrap()
}

fn stopped_at(upper: f64, restitution: f64, sliding: f64) -> JointSwitch {
    let stops = Stops { coordinate: 0, lower: -1.0, upper, restitution };
    let friction = (sliding > 0.0).then_some(DryFriction { sliding, breakaway: 1.2 * sliding });
    JointSwitch { dof: 0, stops: Some(stops), friction }
}

fn switching(model: &Model, joints: Vec<JointSwitch>) -> Dynamics {
    Dynamics::switching(model, vec![], &Prescription::default(), joints).unwrap()
}

/// State right after the first impact, and the energy that the stop took.
fn struck(model: &Model, restitution: f64) -> (Vec<f64>, Vec<f64>, f64) {
    let mut dynamics = switching(model, vec![stopped_at(0.8, restitution, 0.0)]);
    let aux = vec![0.0; dynamics.auxiliary_len()];
    let (q, v) = (model.neutral(), vec![0.0; model.nv()]);
    let mut i = Integrator::new(model, Method::Dop853, Tolerances::new(1e-11), 0.0, &q, &v, &aux);
    loop {
        i.step(&mut dynamics, 5.0, false).unwrap();
        assert!(i.t() < 5.0, "no impact");
        for o in i.occurrences() {
            if let Happening::Impact { energy, .. } = o.what {
                return (i.q().to_vec(), i.v().to_vec(), energy);
            }
        }
    }
}

/// An impact on a stop: M (v⁺ − v⁻) has a component at the struck joint alone, modes included, and the kinetic energy falls by what the
/// stop took. v⁺ = v⁻ + (1 + e) u: two restitutions tell u and v⁻.
#[test]
fn a_boom_strikes_its_stop() {
    let model = falling_boom(0.0);
    let (q, bouncing, taken_none) = struck(&model, 1.0);
    let (same, lazy, taken) = struck(&model, 0.5);
    assert!(q == same, "the runs before the impact differ");
    let u: Vec<f64> = bouncing.iter().zip(&lazy).map(|(a, b)| 2.0 * (a - b)).collect();
    let before: Vec<f64> = bouncing.iter().zip(&u).map(|(v, u)| v - 2.0 * u).collect();
    // Differences of velocities lose a digit.
    let rounding = 1e3 * f64::EPSILON;
    assert!(before[0] > 0.1 && (lazy[0] + 0.5 * before[0]).abs() < rounding * before[0]);
    let layout =
        phipsi_recursion::Layout::<f64>::new(&model.clone().with_gravity([0.0; 3]).without_stiffness());
    let mut inverse = phipsi_recursion::InverseDynamics::new(&layout);
    let (rest, mut impulse) = (vec![0.0; model.nv()], vec![0.0; model.nv()]);
    inverse.run(&layout, &q, &rest, &u, None, &mut impulse).unwrap();
    assert!(impulse[0] < 0.0, "{impulse:?}");
    // Velocities round by nv·ε of their size on both sides of the impact, and M carries that on.
    let (m, nv) = (phipsi_recursion::mass_matrix(&layout, &q).unwrap(), model.nv());
    for i in 1..nv {
        let carried: f64 =
            (0..nv).map(|j| m[i * nv + j].abs() * 2.0 * (bouncing[j].abs() + lazy[j].abs())).sum();
        let allowed = 4.0 * nv as f64 * f64::EPSILON * carried;
        assert!(impulse[i].abs() <= allowed, "{i}: {impulse:?}, allowed {allowed:e}");
    }
    let kinetic = |v: &[f64]| phipsi_recursion::kinetic_energy(&layout, &q, v).unwrap();
    let all = kinetic(&before);
    assert!((all - kinetic(&lazy) - taken).abs() < rounding * all, "{taken:e}");
    assert!(taken > 0.0 && taken_none.abs() < rounding * all, "{taken_none:e}");
}

/// A damped boom that strikes, rubs, comes to rest on its stop and vibrates there: energy less work is kept, and the joint does not move.
#[test]
fn a_boom_with_stops_and_friction_keeps_its_books() {
    let model = falling_boom(1e-3);
    let mut dynamics = switching(&model, vec![stopped_at(0.8, 0.3, 0.05)]);
    let mut kinematics = Kinematics::new(dynamics.layout());
    let mut conserved = Conserved::default();
    let aux = vec![0.0; dynamics.auxiliary_len()];
    let (q, v) = (model.neutral(), vec![0.0; model.nv()]);
    let mut i = Integrator::new(&model, Method::Dop853, Tolerances::new(1e-9), 0.0, &q, &v, &aux);
    conserved.record(&balance(&mut dynamics, &mut kinematics, (0.0, &q, &v), &aux).unwrap());
    let mut resting = 0;
    while i.t() < 3.0 {
        i.step(&mut dynamics, 3.0, false).unwrap();
        let at = (i.t(), i.q(), i.v());
        conserved.record(&balance(&mut dynamics, &mut kinematics, at, i.aux()).unwrap());
        if i.modes()[0] == Mode::AtUpper {
            assert_eq!((i.q()[0], i.v()[0]), (0.8, 0.0));
            resting += 1;
        }
    }
    let impacts = i.occurrences().iter().filter(|o| matches!(o.what, Happening::Impact { .. })).count();
    assert!(impacts > 1 && resting > 10, "{impacts} impacts, {resting} steps at rest");
    // Local errors of 1e-9 a step, some thousand steps.
    assert!(conserved.energy_error() < 1e-6, "{:e}", conserved.energy_error());
}
