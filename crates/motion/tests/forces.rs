//! Balances of energy and momentum under every force model, and the plan against the general code.

use crate::common::*;
use phipsi_model::{Body, Inertia, Joint, JointKind, Limits, Model, ModelBuilder, Placement, State};
use phipsi_motion::forces::{
    BodyWrench, Control, JointDissipation, JointSpring, JointTorque, PointSpring, Servo, WrenchAxes,
};
use phipsi_motion::{
    Conserved, Dynamics, Force, Integrator, JudgedRun, Method, Plan, PlannedRun, Prescription, Signal,
    System, Tolerances, Trail, balance, estimate_error, estimate_error_beside,
};
use phipsi_recursion::{Form, Kinematics};
use phipsi_spatial::Vec3;

/// A free base with a three-joint arm, damping and friction in the joints.
fn satellite(gravity: [f64; 3]) -> Model {
    let link = || Inertia::from_principal(2.0, [0.1, 0.05, 0.2], [0.1, 0.12, 0.05]);
    let mut builder = ModelBuilder::new("satellite")
        .body(Body::new("base", Inertia::from_principal(20.0, [0.02, 0.0, -0.1], [3.0, 4.0, 5.0])))
        .joint(Joint::new("free", JointKind::Free), "world", "base")
        .gravity(gravity);
    let axes = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.5, 0.0]];
    for (i, axis) in axes.into_iter().enumerate() {
        let parent = if i == 0 { "base".into() } else { format!("link {i}") };
        let name = format!("link {}", i + 1);
        let at = Placement::from_xyz_rpy([0.1, 0.2, 0.4], [0.1, -0.3, 0.2]);
        let joint = Joint {
            name: format!("joint {}", i + 1),
            kind: JointKind::Revolute { axis },
            placement: at,
            limits: Limits::default(),
            damping: 0.05,
            friction: 0.02,
        };
        builder = builder.body(Body::new(name.clone(), link())).joint(joint, parent, name);
    }
    builder.build().unwrap()
}

fn every_force(model: &Model) -> Vec<Box<dyn Force>> {
    let smooth = || Signal::function(|t| 0.4 * (1.3 * t).sin(), |t| 0.52 * (1.3 * t).cos());
    let table = Signal::table(vec![(0.0, 0.0), (0.7, 0.5), (1.1, -0.2), (3.0, 0.1)]).unwrap();
    vec![
        Box::new(JointTorque { name: "torque".into(), dof: 6, value: table }),
        Box::new(Servo {
            name: "servo".into(),
            coordinate: 8,
            dof: 7,
            target: smooth(),
            stiffness: 8.0,
            damping: 2.0,
            integral: 0.5,
            limit: f64::INFINITY,
        }),
        Box::new(JointSpring {
            name: "spring".into(),
            coordinate: 9,
            dof: 8,
            stiffness: 3.0,
            damping: 0.0,
            rest: 0.2,
        }),
        Box::new(JointSpring {
            name: "damped".into(),
            coordinate: 9,
            dof: 8,
            stiffness: 1.0,
            damping: 0.3,
            rest: 0.0,
        }),
        Box::new(PointSpring {
            name: "tether".into(),
            bodies: [Some(0), Some(3)],
            points: [Vec3([0.3, 0.0, 0.0]), Vec3([0.0, 0.1, 0.2])],
            stiffness: 5.0,
            damping: 0.4,
            rest_length: 0.5,
        }),
        Box::new(PointSpring {
            name: "bungee".into(),
            bodies: [None, Some(2)],
            points: [Vec3([1.0, 2.0, 0.0]), Vec3([0.0, 0.0, 0.1])],
            stiffness: 2.0,
            damping: 0.0,
            rest_length: 0.7,
        }),
        Box::new(BodyWrench {
            name: "thruster".into(),
            body: 0,
            point: Vec3([0.0, 0.0, -0.5]),
            axes: WrenchAxes::Body,
            components: std::array::from_fn(|i| Signal::Constant(0.1 * i as f64 - 0.2)),
        }),
        Box::new(BodyWrench {
            name: "pull".into(),
            body: 3,
            point: Vec3([0.1, 0.0, 0.0]),
            axes: WrenchAxes::World,
            components: std::array::from_fn(|_| smooth()),
        }),
        Box::new(JointDissipation::new(model, 0.05).unwrap()),
        Box::new(Control::new("own", model.nv(), |_, q, v, tau: &mut [f64]| {
            tau[6] = -0.3 * q[7] - 0.1 * v[6];
            tau[1] = 0.05;
            Ok(())
        })),
    ]
}

/// E − E₀ − W and momentum − impulse stay zero under all forces together, to the integration's accuracy.
#[test]
fn energy_and_momentum_balance_under_every_force() {
    for gravity in [[0.0; 3], [0.3, -0.2, -1.6]] {
        let model = satellite(gravity);
        let mut dynamics = free_fall(&model, every_force(&model));
        let (q, v) = (model.neutral::<f64>(), vec![0.1; model.nv()]);
        let (end, _) = run(&mut dynamics, Method::Dop853, 1e-12, &q, &v, 3.0);
        let mut kinematics = Kinematics::new(dynamics.layout());
        let mut conserved = Conserved::default();
        let zero = vec![0.0; dynamics.auxiliary_len()];
        for (t, q, v, aux) in [(0.0, &q[..], &v[..], &zero[..]), (3.0, end.q(), end.v(), end.aux())] {
            conserved.record(&balance(&mut dynamics, &mut kinematics, (t, q, v), aux).unwrap());
        }
        // Local errors of 1e-12 over about a hundred steps.
        assert!(conserved.energy_error() < 1e-10, "energy {:e}", conserved.energy_error());
        let momentum = conserved.momentum_error();
        assert!(momentum.iter().all(|e| *e < 1e-10), "momentum {momentum:?}");
        assert!(conserved.energy_scale > 0.1 && conserved.momentum_scale[0] > 0.1);
    }
}

/// Every force but a control law with one owner has a second one. A run judged beside it, step by step on another thread with other
/// dynamics, has the estimate of the run judged after it, to the last bit.
#[test]
fn second_dynamics_judge_a_run_while_it_goes_on() {
    let model = satellite([0.3, -0.2, -1.6]);
    let mut forces = every_force(&model);
    assert!(Dynamics::new(&model, every_force(&model)).unwrap().another().is_none());
    forces.pop();
    forces.push(Box::new(Control::shared("shared", model.nv(), |_, q, _, tau: &mut [f64]| {
        tau[6] = -0.3 * q[7];
        Ok(())
    })));
    let mut dynamics = Dynamics::new(&model, forces).unwrap();
    let (q, v, end) = (model.neutral::<f64>(), vec![0.1; model.nv()], 3.0);
    let aux = vec![0.0; dynamics.auxiliary_len()];
    let start = (0.0, &q[..], &v[..], &aux[..]);
    let breaks: Vec<f64> = dynamics.breaks().into_iter().filter(|b| *b > 0.0 && *b < end).collect();
    for tolerance in [1e-6, 1e-8, 1e-10] {
        let (method, tolerances) = (Method::Dop853, Tolerances::new(tolerance));
        let planned = PlannedRun { method, tolerances, start, end, breaks: &breaks, instants: &[end] };
        let mut second = dynamics.another().unwrap();
        let trail = Trail::default();
        let (mut steps, mut samples) = (Vec::new(), Vec::new());
        let beside = std::thread::scope(|scope| {
            let companion = scope.spawn(|| estimate_error_beside(&mut second, &planned, &trail).unwrap());
            let mut run = Integrator::new(&model, method, tolerances, 0.0, &q, &v, &aux);
            while run.t() < end {
                let limit = breaks.iter().copied().find(|b| *b > run.t());
                steps.push(run.step(&mut dynamics, limit.unwrap_or(end), limit.is_some()).unwrap().t1);
                if limit == Some(run.t()) {
                    run.restart();
                }
                trail.advance(&steps[steps.len() - 1..], &[]);
            }
            samples.push(State { t: end, q: run.q().to_vec(), v: run.v().to_vec() });
            trail.end(samples.clone());
            companion.join().unwrap()
        });
        let (steps, samples) = (&steps[..], &samples[..]);
        let judged = JudgedRun { method, tolerances, start, steps, breaks: &breaks, samples, events: &[] };
        assert_eq!(beside, estimate_error(&mut dynamics, &judged).unwrap(), "{tolerance:e}");
        assert!(beside.q.is_some_and(|q| q > 0.0 && q < 1e3 * tolerance), "{beside:?}");
    }
}

/// What the plan leaves out changes nothing: each subset of forces, against the general code, on random states.
#[test]
fn the_plan_equals_the_general_code() {
    for gravity in [[0.0; 3], [0.3, -0.2, -1.6]] {
        let model = satellite(gravity);
        let n = every_force(&model).len();
        for subset in (0..n).map(|i| 1usize << i).chain([0, (1 << n) - 1]) {
            let chosen = || {
                let all = every_force(&model).into_iter().enumerate();
                all.filter(|(i, _)| subset >> i & 1 == 1).map(|(_, f)| f).collect::<Vec<_>>()
            };
            let mut planned = Dynamics::new(&model, chosen()).unwrap();
            let tree = Plan { loops: false, prescribed: false, ..Plan::everything() };
            let general =
                |plan| Dynamics::with_plan(&model, chosen(), plan, &Prescription::default()).unwrap();
            let (mut general, mut everything) = (general(tree), general(Plan::everything()));
            assert!(everything.is_constrained() && !general.is_constrained());
            for seed in 0..5 {
                let s = model.random_state(seed);
                let mut results = Vec::new();
                for dynamics in [&mut planned, &mut general, &mut everything] {
                    let n = dynamics.auxiliary_len();
                    let (mut a, mut rates) = (vec![0.0; model.nv()], vec![0.0; n]);
                    dynamics.derivative(0.4, &s.q, &s.v, &vec![0.3; n], &mut a, &mut rates).unwrap();
                    results.push(a);
                }
                // The same sums with zeros added: not a bit differs.
                assert_eq!(results[0], results[1], "forces {subset:b}, plan {:?}", planned.plan());
                // The solver of loops, of which there are none, sums in another order: 4 n ε, and κ below 100 here.
                let scale = results[0].iter().fold(0.0f64, |m, x| m.max(x.abs()));
                let budget = 400.0 * model.len() as f64 * f64::EPSILON * scale;
                for (x, y) in results[0].iter().zip(&results[2]) {
                    assert!((x - y).abs() <= budget, "forces {subset:b}: {x:e}, {y:e}");
                }
            }
            assert!(planned.auxiliary_len() <= general.auxiliary_len());
        }
    }
}

/// Every form of forward dynamics gives the accelerations of the plan's, to rounding.
#[test]
fn every_form_gives_the_same_accelerations() {
    let model = satellite([0.3, -0.2, -1.6]);
    let mut dynamics = Dynamics::new(&model, every_force(&model)).unwrap();
    assert_eq!(dynamics.form(), Form::Plain);
    assert!(dynamics.form_choice().is_some_and(|choice| choice.is_sufficient()));
    let s = model.random_state(1);
    let n = dynamics.auxiliary_len();
    let mut results = Vec::new();
    for form in [Form::Plain, Form::Refined, Form::SquareRoot, Form::DoubleDouble] {
        dynamics.set_form(form).unwrap();
        assert_eq!((dynamics.form(), dynamics.plan().form), (form, form));
        assert!(dynamics.form_choice().is_none());
        let (mut a, mut rates) = (vec![0.0; model.nv()], vec![0.0; n]);
        dynamics.derivative(0.4, &s.q, &s.v, &vec![0.3; n], &mut a, &mut rates).unwrap();
        results.push(a);
    }
    let exact = &results[3];
    let scale = exact.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    for (a, form) in results.iter().zip(Form::ALL.iter().skip(1)) {
        let error = a.iter().zip(exact).fold(0.0f64, |m, (x, y)| m.max((x - y).abs())) / scale;
        // Four steps of a sweep a body and a degree of freedom, as in the tests of the kernels.
        let allowed = 4.0 * (model.len() + model.nv()) as f64 * f64::EPSILON;
        assert!(error <= allowed, "{form}: {error:e}");
    }
}

#[test]
fn coinciding_points_of_a_spring_with_length_are_an_error_with_its_name() {
    let model = satellite([0.0; 3]);
    let spring = PointSpring {
        name: "tether".into(),
        bodies: [Some(0), None],
        points: [Vec3([0.0; 3]); 2],
        stiffness: 1.0,
        damping: 0.0,
        rest_length: 1.0,
    };
    let mut dynamics = free_fall(&model, vec![Box::new(spring)]);
    let (q, v) = (model.neutral::<f64>(), vec![0.0; model.nv()]);
    let (mut a, mut rates) = (v.clone(), vec![0.0; dynamics.auxiliary_len()]);
    let aux = rates.clone();
    let error = dynamics.derivative(0.0, &q, &v, &aux, &mut a, &mut rates).unwrap_err().to_string();
    assert!(error.contains("tether") && error.contains("coincide"), "{error}");
}
