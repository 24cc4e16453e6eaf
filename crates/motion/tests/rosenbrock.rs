//! Rosenbrock methods: linearisations against differences, orders, a stiff scene.

use crate::common::*;
use crate::midpoint_loops::{models, started};
use phipsi_model::{Model, State};
use phipsi_motion::forces::{
    BodyWrench, CentralGravity, JointDissipation, JointSpring, JointTorque, PointSpring, Servo, Thruster,
    WrenchAxes,
};
use phipsi_motion::system::differences;
use phipsi_motion::{Dynamics, Force, Integrator, Linearization, Method, Signal, System, Tolerances};
use phipsi_reference::generate::case;
use phipsi_spatial::Vec3;

/// Every kind of force but the user's own, on bodies and joints of a model.
fn forces(model: &Model, seed: u64) -> Vec<Box<dyn Force>> {
    let mut forces: Vec<Box<dyn Force>> = Vec::new();
    let one_axis = |k: &usize| model.joints()[*k].kind.nv() == 1;
    if let Some(k) = model.moving_joints().find(one_axis) {
        let (coordinate, dof) = (model.q_offset(k), model.v_offset(k));
        forces.push(Box::new(JointSpring {
            name: "spring".into(),
            coordinate,
            dof,
            stiffness: 3.0,
            damping: 0.7,
            rest: 0.1,
        }));
        forces.push(Box::new(Servo {
            name: "servo".into(),
            coordinate,
            dof,
            target: Signal::function(|t| t.sin(), |t| t.cos()),
            stiffness: 2.0,
            damping: 0.3,
            integral: 1.5,
            limit: f64::INFINITY,
        }));
        // At its limit, far from where that begins: a constant force.
        forces.push(Box::new(Servo {
            name: "limited".into(),
            coordinate,
            dof,
            target: Signal::Constant(9.0),
            stiffness: 2.0,
            damping: 0.3,
            integral: 0.0,
            limit: 0.05,
        }));
        forces.push(Box::new(JointTorque { name: "torque".into(), dof, value: Signal::Constant(0.4) }));
    }
    let last = model.len() - 1;
    let body = seed as usize % model.len();
    forces.push(Box::new(PointSpring {
        name: "cord".into(),
        bodies: [None, Some(last)],
        points: [Vec3([1.0, 2.0, -3.0]), Vec3([0.1, -0.2, 0.3])],
        stiffness: 4.0,
        damping: 0.9,
        rest_length: 0.5,
    }));
    if body != last {
        forces.push(Box::new(PointSpring {
            name: "strut".into(),
            bodies: [Some(body), Some(last)],
            points: [Vec3([0.4, 0.0, 0.2]), Vec3([-0.1, 0.5, 0.0])],
            stiffness: 2.0,
            damping: 1.1,
            rest_length: 1.0,
        }));
    }
    let pull = [0.3, -0.2, 0.5, 1.0, 2.0, -1.5].map(Signal::Constant);
    for (name, axes) in [("pull", WrenchAxes::World), ("jet", WrenchAxes::Body)] {
        let (point, components) = (Vec3([0.2, 0.1, -0.3]), pull.clone());
        forces.push(Box::new(BodyWrench { name: name.into(), body, point, axes, components }));
    }
    forces.push(Box::new(CentralGravity::new("planet", model, 7.0, [3.0, -4.0, 5.0])));
    forces.push(Box::new(Thruster {
        name: "thruster".into(),
        body,
        point: Vec3([0.1, 0.2, 0.3]),
        direction: Vec3([0.6, 0.0, 0.8]),
        thrust: Signal::Constant(0.7),
        specific_impulse: Some(200.0),
    }));
    forces.extend(JointDissipation::new(model, 0.5).map(|d| Box::new(d) as Box<dyn Force>));
    forces
}

/// The blocks from derivatives are those by differences, on generated trees with joints of all kinds.
#[test]
fn linearisations_are_difference_quotients() {
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
        let State { q, v, .. } = model.random_state(seed);
        let mut dynamics = Dynamics::new(&model, forces(&model, seed)).unwrap();
        let aux: Vec<f64> = (0..dynamics.auxiliary_len()).map(|i| 0.1 * i as f64 - 0.2).collect();
        let mut own = Linearization::new(model.nv(), aux.len());
        // A singular hinge is refused by both.
        let Ok(evaluations) = dynamics.linearize(0.7, &q, &v, &aux, &mut own) else { continue };
        assert_eq!(evaluations, 0, "seed {seed}: by differences");
        let mut other = Linearization::new(model.nv(), aux.len());
        differences(&mut dynamics, 0.7, (&q, &v, &aux), &mut other).unwrap();
        for (name, a, b) in [
            ("A_q", &own.a_q, &other.a_q),
            ("A_v", &own.a_v, &other.a_v),
            ("A_aux", &own.a_aux, &other.a_aux),
        ] {
            let size = a.iter().fold(1.0f64, |m, x| m.max(x.abs()));
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                // Differences of size 6e-6: truncation 4e-11 of the third derivative, rounding 2e-11 of the accelerations, which
                // exceed these entries by up to 1e4 where light bodies are pulled.
                assert!((a - b).abs() < 1e-6 * size, "seed {seed}, {name} {i}: {a} {b}");
            }
        }
        looked += 1;
    }
    assert!(looked > 0);
}

fn order_of(
    model: &Model,
    make: &dyn Fn() -> Vec<Box<dyn Force>>,
    start: &State,
    method: Method,
    counts: &[usize],
) -> f64 {
    let mut dynamics = free_fall(model, make());
    let t_end = 1.0;
    let (exact, _) = run(&mut dynamics, Method::Dop853, 1e-14, &start.q, &start.v, t_end);
    let points: Vec<(f64, f64)> = counts
        .iter()
        .map(|&n| {
            let mut dynamics = free_fall(model, make());
            let aux = vec![0.0; dynamics.auxiliary_len()];
            let accept = Tolerances { rtol: f64::INFINITY, atol: f64::INFINITY, max_step: f64::INFINITY };
            let mut i = Integrator::new(model, method, accept, 0.0, &start.q, &start.v, &aux);
            for step in 1..=n {
                let t = t_end * step as f64 / n as f64;
                i.propose(t - i.t());
                i.step(&mut dynamics, t, false).unwrap();
            }
            let q = model.difference(exact.q(), i.q()).iter().fold(0.0f64, |m, x| m.max(x.abs()));
            let aux = exact.aux().iter().zip(i.aux()).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
            ((n as f64).ln(), q.max(aux).ln())
        })
        .collect();
    let n = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let slope = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>()
        / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>();
    -slope
}

/// On a double pendulum under a torque that depends on time, with the work that is integrated beside it.
#[test]
fn orders_show_with_forces_that_depend_on_time() {
    let model = double_pendulum();
    let make = || -> Vec<Box<dyn Force>> {
        let value = Signal::function(|t| 3.0 * (2.0 * t).sin(), |t| 6.0 * (2.0 * t).cos());
        let spring = JointSpring {
            name: "spring".into(),
            coordinate: 1,
            dof: 1,
            stiffness: 5.0,
            damping: 0.5,
            rest: 0.2,
        };
        vec![Box::new(JointTorque { name: "torque".into(), dof: 0, value }), Box::new(spring)]
    };
    let start = State { q: vec![0.5, 0.6], v: vec![0.0; 2], t: 0.0 };
    // Rodas4's leading error terms are small: the order shows at fine steps only.
    let counts = [(Method::Rodas4, [400, 560, 800, 1120, 1600]), (Method::Rodas5p, [60, 80, 120, 160, 240])];
    for (method, counts) in counts {
        let observed = order_of(&model, &make, &start, method, &counts);
        let order = f64::from(method.order());
        assert!((observed - order).abs() < 0.3, "{method:?}: observed {observed:.2}");
    }
}

/// Without ½ ad_v in the Jacobian the order of a free base would fall to two or three.
#[test]
fn orders_show_on_a_free_base() {
    let model = free_body([1.0, 2.0, 2.5]);
    let start = State { q: model.neutral(), v: vec![0.7, 1.3, -0.4, 0.2, 0.1, -0.3], t: 0.0 };
    for method in [Method::Rodas4, Method::Rodas5p] {
        let observed = order_of(&model, &Vec::new, &start, method, &[10, 14, 20, 28]);
        let order = f64::from(method.order());
        assert!((observed - order).abs() < 0.4, "{method:?}: observed {observed:.2}");
    }
}

/// Closed loops: every step ends with a projection onto them, redundant rows included, and the order is what it is on trees. With springs
/// and dampers, whose derivatives enter the Jacobian of the closed dynamics.
#[test]
fn orders_show_on_closed_loops() {
    for model in models() {
        let (_, q, v) = started(&model, 3);
        let start = State { q, v, t: 0.0 };
        let make = || -> Vec<Box<dyn Force>> {
            let hinges = model.moving_joints().filter(|&k| model.joints()[k].kind.nv() == 1).take(2);
            let springs = hinges.map(|k| JointSpring {
                name: format!("spring {k}"),
                coordinate: model.q_offset(k),
                dof: model.v_offset(k),
                stiffness: 5.0,
                damping: 0.5,
                rest: 0.2,
            });
            springs.map(|spring| Box::new(spring) as Box<dyn Force>).collect()
        };
        for method in [Method::Rodas4, Method::Rodas5p] {
            let observed = order_of(&model, &make, &start, method, &[40, 56, 80, 112, 160]);
            let order = f64::from(method.order());
            println!("{}: {method:?}: observed {observed:.2}", model.name());
            assert!((observed - order).abs() < 0.4, "{}, {method:?}: observed {observed:.2}", model.name());
        }
    }
}

/// A damped spring of 1e8 N·m/rad: steps of a hundredth of a second, where an explicit method needs some 1e6.
#[test]
fn a_stiff_spring_does_not_limit_the_step() {
    let model = double_pendulum();
    let make = || -> Vec<Box<dyn Force>> {
        vec![Box::new(JointSpring {
            name: "weld".into(),
            coordinate: 1,
            dof: 1,
            stiffness: 1e8,
            damping: 1e6,
            rest: 0.0,
        })]
    };
    for method in [Method::Rodas4, Method::Rodas5p] {
        let mut dynamics = free_fall(&model, make());
        let (end, steps) = run(&mut dynamics, method, 1e-6, &[0.5, 0.0], &[0.0; 2], 2.0);
        assert!(steps.len() < 400, "{method:?}: {} steps", steps.len());
        // As the stiffness grows, the two rods are one of 2 m: a pendulum with moment 8/3 and weight 2 g at 1 m.
        let one = {
            use phipsi_model::{Body, Inertia, Joint, ModelBuilder};
            let rod = Inertia::from_principal(2.0, [0.0, 0.0, -1.0], [2.0 / 3.0, 2.0 / 3.0, 0.0]);
            let builder = ModelBuilder::new("rod").body(Body::new("rod", rod));
            builder.joint(Joint::new("hinge", Y), "world", "rod").gravity([0.0, 0.0, -9.81]).build().unwrap()
        };
        let (rigid, _) = run(&mut free_fall(&one, vec![]), Method::Dop853, 1e-12, &[0.5], &[0.0], 2.0);
        // The elbow yields by torque/stiffness = 1e-7.
        assert!((end.q()[0] - rigid.q()[0]).abs() < 1e-5, "{method:?}: {} {}", end.q()[0], rigid.q()[0]);
        assert!(end.q()[1].abs() < 1e-6, "{method:?}: {}", end.q()[1]);
    }
}

/// A chain long enough for the other elimination of its matrix: damped springs at all hinges, against an explicit method.
#[test]
fn a_long_stiff_chain_moves_as_by_an_explicit_method() {
    use phipsi_model::{Body, Inertia, Joint, ModelBuilder, Placement};
    let n = 50;
    let mut builder = ModelBuilder::new("chain").gravity([0.0, 0.0, -9.81]);
    for i in 0..n {
        let rod = Inertia::from_principal(1.0, [0.0, 0.0, -0.05], [1e-3, 1e-3, 1e-4]);
        let below = if i == 0 { 0.0 } else { -0.1 };
        let at = Placement { translation: [0.0, 0.0, below], ..Placement::IDENTITY };
        let parent = if i == 0 { "world".into() } else { format!("rod{}", i - 1) };
        let name = format!("rod{i}");
        builder = builder.body(Body::new(name.as_str(), rod));
        builder = builder.joint(Joint::new(format!("hinge{i}"), Y).at(at), parent, name.as_str());
    }
    let model = builder.build().unwrap();
    let make = || -> Vec<Box<dyn Force>> {
        let spring = |i: usize| JointSpring {
            name: format!("spring {i}"),
            coordinate: i,
            dof: i,
            stiffness: 10.0,
            damping: 1.0,
            rest: 0.0,
        };
        (0..n).map(|i| Box::new(spring(i)) as Box<dyn Force>).collect()
    };
    let q: Vec<f64> = (0..n).map(|i| 0.2 * (1.0 + i as f64).sin()).collect();
    let at_rest = vec![0.0; n];
    let (exact, many) = run(&mut free_fall(&model, make()), Method::Dop853, 1e-9, &q, &at_rest, 0.05);
    let (end, few) = run(&mut free_fall(&model, make()), Method::Rodas5p, 1e-7, &q, &at_rest, 0.05);
    let away = model.difference(exact.q(), end.q()).iter().fold(0.0f64, |m, x| m.max(x.abs()));
    println!("{} steps, {} explicit: {away:.1e} rad apart", few.len(), many.len());
    // So many steps, each wrong by its tolerance, which dampers do not let grow.
    assert!(away < few.len() as f64 * 1e-7 && few.len() < many.len(), "{away:e}");
}

/// Samples inside stiff steps are as good as the steps.
#[test]
fn dense_output_has_the_order_of_the_embedded_method() {
    let model = double_pendulum();
    for (method, allowed) in [(Method::Rodas4, 1e-6), (Method::Rodas5p, 1e-6)] {
        let mut dynamics = free_fall(&model, vec![]);
        let mut i = Integrator::new(&model, method, Tolerances::new(1e-7), 0.0, &[1.5, -0.4], &[0.0; 2], &[]);
        let (mut q, mut v) = ([0.0; 2], [0.0; 2]);
        while i.t() < 1.0 {
            let step = i.step(&mut dynamics, 1.0, false).unwrap();
            let t = 0.6 * step.t0 + 0.4 * step.t1;
            i.sample(&mut dynamics, t, &mut q, &mut v, &mut []).unwrap();
            let (exact, _) =
                run(&mut free_fall(&model, vec![]), Method::Dop853, 1e-12, &[1.5, -0.4], &[0.0; 2], t);
            let error = (0..2).map(|k| (q[k] - exact.q()[k]).abs()).fold(0.0, f64::max);
            assert!(error < allowed, "{method:?} at {t}: {error:e}");
        }
    }
}
