//! Joint stops and dry friction against closed forms.

use crate::events::{happenings, slider, spring};
use phipsi_model::{
    Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, State,
};
use phipsi_motion::forces::{JointSpring, JointTorque};
use phipsi_motion::{
    DryFriction, Dynamics, Force, Happening, Integrator, JointSwitch, JudgedRun, Method, Mode, MotionError,
    Occurrence, Prescription, Signal, Stops, System, Tolerances, estimate_error,
};
use std::f64::consts::PI;

const METHODS: [Method; 5] =
    [Method::Dop853, Method::Tsit5, Method::Rk4 { step: 0.01 }, Method::Rodas4, Method::Rodas5p];

const INFINITE: f64 = f64::INFINITY;

fn stop(dof: usize, lower: f64, upper: f64, restitution: f64) -> JointSwitch {
    JointSwitch { dof, stops: Some(Stops { coordinate: dof, lower, upper, restitution }), friction: None }
}

fn dry(dof: usize, sliding: f64, breakaway: f64) -> JointSwitch {
    JointSwitch { dof, stops: None, friction: Some(DryFriction { sliding, breakaway }) }
}

fn dynamics(model: &Model, forces: Vec<Box<dyn Force>>, joints: Vec<JointSwitch>) -> Dynamics {
    Dynamics::switching(model, forces, &Prescription::default(), joints).unwrap()
}

/// 1 kg that falls along z from a height; its stop is the ground.
fn ball() -> Model {
    ModelBuilder::new("ball")
        .body(Body::new("ball", Inertia::from_principal(1.0, [0.0; 3], [0.1; 3])))
        .joint(Joint::new("height", JointKind::Prismatic { axis: [0.0, 0.0, 1.0] }), "world", "ball")
        .gravity([0.0, 0.0, -10.0])
        .build()
        .unwrap()
}

fn force(dof: usize, value: impl Fn(f64) -> f64 + Send + Sync + 'static) -> Box<dyn Force> {
    Box::new(JointTorque { name: "push".into(), dof, value: Signal::function(value, |_| 0.0) })
}

fn impacts(found: &[Occurrence]) -> Vec<(f64, [f64; 2], f64)> {
    let of = |o: &Occurrence| match o.what {
        Happening::Impact { speed, energy, .. } => Some((o.t, speed, energy)),
        _ => None,
    };
    found.iter().filter_map(of).collect()
}

/// Impacts at t₁ = √(2h/g), then after flights of 2 eⁿ v₁/g; each takes ½(1 − e²)v².
#[test]
fn a_ball_bounces_geometrically() {
    let (h, g, e) = (1.25, 10.0, 0.8);
    for method in METHODS {
        let mut d = dynamics(&ball(), vec![], vec![stop(0, 0.0, INFINITE, e)]);
        let (found, end) = happenings(&mut d, method, 1e-10, (&[h], &[0.0]), 3.6);
        let found = impacts(&found);
        let (mut t, mut speed) = ((2.0 * h / g).sqrt(), (2.0 * g * h).sqrt());
        let mut taken = 0.0;
        for (n, (at, [before, after], energy)) in found.iter().enumerate() {
            // Free fall is integrated but for rounding: weights of up to 165 (Rodas5p) cancel, so that a flight of T ≤ 1 s ends with a
            // speed that is off by 165 ε g T at most, and the next takes 2/g of that longer.
            let allowed = 2.0 * 165.0 * f64::EPSILON * (n + 1) as f64;
            assert!((at - t).abs() < allowed, "{method:?} {n}: {:e}", at - t);
            assert!((before + speed).abs() < 10.0 * allowed && (after - e * speed).abs() < 10.0 * allowed);
            assert!((energy - 0.5 * (1.0 - e * e) * speed * speed).abs() < 100.0 * allowed);
            taken += energy;
            speed *= e;
            t += 2.0 * speed / g;
        }
        assert!(found.len() == 7 && t > 3.6, "{method:?}: {} impacts", found.len());
        let energy = 0.5 * end.v()[0].powi(2) + g * end.q()[0];
        assert!((g * h - taken - energy).abs() < 1e-12 && (end.aux()[0] + taken).abs() < 1e-12);
    }
}

/// Infinitely many impacts end at t₁ + 2v₁/g · e/(1 − e): there it rests, and lies still.
#[test]
fn infinitely_many_impacts_come_to_rest() {
    let (h, g, e) = (1.25f64, 10.0, 0.5);
    let mut d = dynamics(&ball(), vec![], vec![stop(0, 0.0, INFINITE, e)]);
    let (found, end) = happenings(&mut d, Method::Dop853, 1e-9, (&[h], &[0.0]), 4.0);
    let rest: Vec<f64> = found
        .iter()
        .filter(|o| matches!(o.what, Happening::Rest { endless: true, .. }))
        .map(|o| o.t)
        .collect();
    let want = (2.0 * h / g).sqrt() + 2.0 * (2.0 * g * h).sqrt() / g * e / (1.0 - e);
    // What is left of the flights at a rebound of 1e-10.
    assert!(rest.len() == 1 && (rest[0] - want).abs() < 1e-10, "{rest:?} instead of {want}");
    assert_eq!((end.q()[0], end.v()[0], end.modes()), (0.0, 0.0, &[Mode::AtLower][..]));
    assert!((end.aux()[0] + g * h).abs() < 1e-12);
}

/// Pressed on its stop by a force −1 + t, a mass leaves at t = 1 and then follows (t − 1)³/6.
#[test]
fn a_resting_joint_leaves_when_the_force_turns() {
    for method in METHODS {
        let mut d = dynamics(&slider(), vec![force(0, |t| t - 1.0)], vec![stop(0, 0.0, INFINITE, 0.3)]);
        let (found, end) = happenings(&mut d, method, 1e-10, (&[0.0], &[0.0]), 2.0);
        let leaves: Vec<f64> =
            found.iter().filter(|o| matches!(o.what, Happening::Leave { .. })).map(|o| o.t).collect();
        assert!(leaves.len() == 1 && (leaves[0] - 1.0).abs() < 1e-14, "{method:?}: {found:?}");
        assert!((end.q()[0] - 1.0 / 6.0).abs() < 1e-10, "{method:?}: {:e}", end.q()[0] - 1.0 / 6.0);
    }
}

/// Two masses in a row: the stop of the second on the first is a collision of the two.
#[test]
fn two_bodies_collide_with_newtons_restitution() {
    let x = || JointKind::Prismatic { axis: [1.0, 0.0, 0.0] };
    let (m1, m2, e) = (2.0, 3.0, 0.6);
    let model = ModelBuilder::new("two")
        .body(Body::new("a", Inertia::from_principal(m1, [0.0; 3], [0.1; 3])))
        .body(Body::new("b", Inertia::from_principal(m2, [0.0; 3], [0.1; 3])))
        .joint(Joint::new("first", x()), "world", "a")
        .joint(Joint::new("gap", x()), "a", "b")
        .gravity([0.0; 3])
        .build()
        .unwrap();
    let mut d = dynamics(&model, vec![], vec![stop(1, 0.0, INFINITE, e)]);
    // Speeds 1.0 and −0.5; the gap is the second coordinate.
    let (found, end) = happenings(&mut d, Method::Dop853, 1e-9, (&[0.0, 0.3], &[1.0, -1.5]), 1.0);
    let [(t, speed, taken)] = impacts(&found)[..] else { panic!("{found:?}") };
    assert!((t - 0.2).abs() < 1e-15 && (speed[1] - 0.9).abs() < 1e-15);
    let (u1, u2) = (1.0, -0.5);
    let mean = (m1 * u1 + m2 * u2) / (m1 + m2);
    let after = [mean - m2 * e * (u1 - u2) / (m1 + m2), mean + m1 * e * (u1 - u2) / (m1 + m2)];
    assert!((end.v()[0] - after[0]).abs() < 1e-14 && (end.v()[0] + end.v()[1] - after[1]).abs() < 1e-14);
    let loss = 0.5 * m1 * m2 / (m1 + m2) * (1.0 - e * e) * (u1 - u2) * (u1 - u2);
    assert!((taken - loss).abs() < 1e-14);
}

/// A double pendulum whose both hinges strike at the same instant: v⁺ = −e v⁻ at both.
#[test]
fn two_stops_push_at_once() {
    let y = || JointKind::Revolute { axis: [0.0, 1.0, 0.0] };
    let rod = |name: &str| Body::new(name, Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 0.1, 0.1]));
    let model = ModelBuilder::new("double")
        .body(rod("a"))
        .body(rod("b"))
        .joint(Joint::new("first", y()), "world", "a")
        .joint(
            Joint::new("second", y()).at(Placement { translation: [1.0, 0.0, 0.0], ..Placement::IDENTITY }),
            "a",
            "b",
        )
        .gravity([0.0; 3])
        .build()
        .unwrap();
    let e = 0.5;
    let mut d = dynamics(&model, vec![], vec![stop(0, 0.0, INFINITE, e), stop(1, 0.0, INFINITE, e)]);
    let (found, end) = happenings(&mut d, Method::Dop853, 1e-9, (&[0.0, 0.0], &[-1.0, -2.0]), 1e-3);
    // An impulse at one hinge throws the other one against its stop, so both push.
    let [(_, first, _), (_, second, _)] = impacts(&found)[..] else { panic!("{found:?}") };
    assert_eq!((first, second), ([-1.0, 0.5], [-2.0, 1.0]));
    assert_eq!(found[0].t, 0.0);
    assert!(end.q()[0] > 0.0 && end.q()[1] > 0.0);
}

/// A four-bar of equal rods, without weight: it turns at a constant rate, whatever the angle.
fn parallelogram() -> Model {
    let rod = |name: &str| Body::new(name, Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 0.1, 0.1]));
    let hinge = |name: &str, x: f64| {
        let kind = JointKind::Revolute { axis: [0.0, 1.0, 0.0] };
        Joint::new(name, kind).at(Placement::from_xyz_rpy([x, 0.0, 0.0], [0.0; 3]))
    };
    let end = || Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3]);
    ModelBuilder::new("four-bar")
        .body(rod("crank"))
        .body(rod("coupler"))
        .body(rod("rocker"))
        .joint(hinge("a", 0.0), "world", "crank")
        .joint(hinge("b", 1.0), "crank", "coupler")
        .joint(hinge("c", 1.0), "world", "rocker")
        .closure(Closure {
            name: "pin".into(),
            kind: ClosureKind::Spherical,
            body_a: "coupler".into(),
            pose_a: end(),
            body_b: "rocker".into(),
            pose_b: end(),
        })
        .gravity([0.0; 3])
        .build()
        .unwrap()
}

/// Stuck at three hinges of one loop, it breaks away where a ramp t at the crank exceeds the sum of the three breakaway forces: the hinges
/// turn by equal angles. Its inertia about the crank is 2 (m/4 + I) + m = 1.7, since the coupler does not turn.
#[test]
fn joints_of_a_loop_stick_together() {
    let joints = vec![dry(0, 0.3, 0.4), dry(1, 0.5, 0.6), dry(2, 0.7, 0.8)];
    let mut d = dynamics(&parallelogram(), vec![force(0, |t| t)], joints);
    let (found, end) = happenings(&mut d, Method::Dop853, 1e-11, (&[1.0, -1.0, 1.0], &[0.0; 3]), 2.5);
    // They stick at the start.
    let later: Vec<&Occurrence> = found.iter().filter(|o| o.t > 0.0).collect();
    assert!(later.len() == 3 && later.iter().all(|o| (o.t - 1.8).abs() < 1e-12), "{found:?}");
    // ω̇ = (t − 1.5)/1.7 from t = 1.8 on.
    let s = 0.7;
    let turned = (0.5 * 0.3 * s * s + s * s * s / 6.0) / 1.7;
    assert!((end.q()[0] - 1.0 - turned).abs() < 1e-9, "{:e}", end.q()[0] - 1.0 - turned);
}

/// A four-bar parallelogram whose crank strikes: without losses the speed turns over exactly, the loops stay closed.
#[test]
fn a_linkage_strikes_its_stop() {
    let model = parallelogram();
    let mut d = dynamics(&model, vec![], vec![stop(0, 0.6, INFINITE, 1.0)]);
    let (q, v) = ([1.0, -1.0, 1.0], [-0.5, 0.5, -0.5]);
    let (found, i) = happenings(&mut d, Method::Dop853, 1e-10, (&q, &v), 1.6);
    // A parallelogram without weight turns at a constant rate: ½(m/4 + I)·2 + m of the coupler does not depend on the angle.
    let [(t, speed, taken)] = impacts(&found)[..] else { panic!("{found:?}") };
    assert!((t - 0.8).abs() < 1e-9 && (speed[0] + 0.5).abs() < 1e-9 && speed[1] == -speed[0], "{found:?}");
    assert!(taken.abs() < 1e-14);
    for (got, want) in i.q().iter().zip([1.0, -1.0, 1.0]).chain(i.v().iter().zip([0.5, -0.5, 0.5])) {
        assert!((got - want).abs() < 1e-8, "{:?} {:?}", i.q(), i.v());
    }
    let residual = d.closure_residual(i.t(), i.q(), i.v()).unwrap().unwrap();
    assert!(residual[0] < 1e-13 && residual[1] < 1e-13, "{residual:?}");
}

/// On a slope of 30° a block thrown uphill stops after v₀/(g sin + f/m), and stays if f/m exceeds g sin, else slides back.
#[test]
fn a_block_on_a_slope_sticks_or_slides_back() {
    let (sine, g): (f64, f64) = (0.5, 10.0);
    let model = ModelBuilder::new("slope")
        .body(Body::new("block", Inertia::from_principal(2.0, [0.0; 3], [0.1; 3])))
        .joint(
            Joint::new("slope", JointKind::Prismatic { axis: [(1.0f64 - sine * sine).sqrt(), 0.0, sine] }),
            "world",
            "block",
        )
        .gravity([0.0, 0.0, -g])
        .build()
        .unwrap();
    for method in METHODS {
        for (friction, sticks) in [(12.0, true), (8.0, false)] {
            let mut d = dynamics(&model, vec![], vec![dry(0, friction, friction)]);
            let (found, end) = happenings(&mut d, method, 1e-10, (&[0.0], &[4.0]), 1.0);
            let slow = g * sine + friction / 2.0;
            let (stopped, height) = (4.0 / slow, 8.0 / slow);
            assert!((found[0].t - stopped).abs() < 1e-14, "{method:?}: {found:?}");
            let want = if sticks {
                assert_eq!(found[0].what, Happening::Stick { dof: 0 });
                height
            } else {
                assert_eq!(found[0].what, Happening::Slip { dof: 0, forward: false });
                height - 0.5 * (g * sine - friction / 2.0) * (1.0 - stopped).powi(2)
            };
            assert!((end.q()[0] - want).abs() < 1e-13, "{method:?}: {:e}", end.q()[0] - want);
            if sticks {
                assert_eq!((end.v()[0], end.modes()), (0.0, &[Mode::Stuck][..]));
            }
        }
    }
}

/// x₀ = 1, k = 1, m = 1, f = 0.08: half swings of π lose 2f of amplitude each; it sticks where |x| ≤ f after six of them.
#[test]
fn an_oscillator_with_dry_friction_loses_amplitude_linearly() {
    let f = 0.08;
    for method in METHODS {
        let mut d = dynamics(&slider(), vec![spring(1.0)], vec![dry(0, f, f)]);
        let (found, end) = happenings(&mut d, method, 1e-10, (&[1.0], &[0.0]), 25.0);
        // 0.01⁴/120 a second for the fixed step; some hundred steps at 1e-10 for the others.
        let allowed = 1e-8;
        // Released at t = 0, it turns at π, 2π, …
        for (n, o) in found.iter().enumerate() {
            assert!((o.t - (n + 1) as f64 * PI).abs() < allowed, "{method:?}: {o:?}");
        }
        assert_eq!(found.len(), 6, "{method:?}: {found:?}");
        assert_eq!(found[5].what, Happening::Stick { dof: 0 });
        let last = 1.0 - 6.0 * 2.0 * f;
        assert!((end.q()[0] - last).abs() < allowed && end.v()[0] == 0.0, "{:?}", end.q());
        // What friction took is the energy of the spring.
        assert!((end.aux()[0] - 0.5 * (last * last - 1.0)).abs() < allowed);
    }
}

/// A ramp t breaks friction away at its breakaway force, and the mass then follows ẍ = t − f.
#[test]
fn a_ramp_breaks_away_at_the_breakaway_force() {
    let (sliding, breakaway) = (1.0, 1.5);
    let mut d = dynamics(&slider(), vec![force(0, |t| t)], vec![dry(0, sliding, breakaway)]);
    let (found, end) = happenings(&mut d, Method::Dop853, 1e-11, (&[0.0], &[0.0]), 2.5);
    let slips: Vec<&Occurrence> = found.iter().filter(|o| matches!(o.what, Happening::Slip { .. })).collect();
    assert!(slips.len() == 1 && (slips[0].t - breakaway).abs() < 1e-14, "{found:?}");
    let s = 1.0;
    let want = s * s * s / 6.0 + (breakaway - sliding) * s * s / 2.0;
    assert!((end.q()[0] - want).abs() < 1e-12, "{:e}", end.q()[0] - want);
}

/// Two blocks, one on the other, each with friction below it: F on the upper one moves both coordinates, as the textbook says.
#[test]
fn two_frictions_stick_and_slip_together() {
    let x = || JointKind::Prismatic { axis: [1.0, 0.0, 0.0] };
    let model = ModelBuilder::new("stack")
        .body(Body::new("lower", Inertia::from_principal(2.0, [0.0; 3], [0.1; 3])))
        .body(Body::new("upper", Inertia::from_principal(1.0, [0.0; 3], [0.1; 3])))
        .joint(Joint::new("ground", x()), "world", "lower")
        .joint(Joint::new("between", x()), "lower", "upper")
        .gravity([0.0; 3])
        .build()
        .unwrap();
    let (ground, between) = (1.0, 3.0);
    // Accelerations of the lower and of the upper block: nothing moves; both together; the upper one slides on the lower one.
    let slide = |push: f64| ((between - ground) / 2.0, push - between);
    for (push, want) in [(0.9, (0.0, 0.0)), (2.5, (0.5, 0.5)), (5.0, slide(5.0)), (-2.5, (-0.5, -0.5))] {
        let joints = vec![dry(0, ground, ground), dry(1, between, between)];
        let mut d = dynamics(&model, vec![force(0, move |_| push), force(1, move |_| push)], joints);
        let (_, end) = happenings(&mut d, Method::Tsit5, 1e-10, (&[0.0; 2], &[0.0; 2]), 1.0);
        let got = (end.v()[0], end.v()[0] + end.v()[1]);
        assert!((got.0 - want.0).abs() < 1e-13 && (got.1 - want.1).abs() < 1e-13, "{push}: {got:?} {want:?}");
    }
}

#[test]
fn wrong_stops_and_starts_are_refused_by_name() {
    let made = |joint| Dynamics::switching(&slider(), vec![], &Prescription::default(), vec![joint]);
    let text = |joint| made(joint).err().unwrap().to_string();
    assert!(text(stop(0, 1.0, 1.0, 0.5)).contains("rail"));
    assert!(text(stop(0, 0.0, 1.0, 1.5)).contains("0 … 1"));
    assert!(text(dry(0, 2.0, 1.0)).contains("breakaway"));
    assert!(text(dry(3, 1.0, 1.0)).contains("does not exist"));
    let mut d = dynamics(&slider(), vec![], vec![stop(0, 0.0, 1.0, 0.5)]);
    let mut i =
        Integrator::new(&slider(), Method::Dop853, Tolerances::new(1e-9), 0.0, &[1.5], &[0.0], &[0.0]);
    let failed = i.step(&mut d, 1.0, false).unwrap_err();
    let text = failed.describe(&slider());
    assert!(text.contains("rail") && text.contains("beyond its stop at 1"), "{text}");
    assert!(matches!(made(dry(0, -1.0, 1.0)), Err(MotionError::Switch { .. })));
}

/// The estimate against the truth: a swinging pendulum between stops, and the oscillator with dry friction.
#[test]
fn the_estimate_stays_valid_across_events() {
    let hinge = crate::common::pendulum();
    let swing = || dynamics(&hinge, vec![], vec![stop(0, -0.5, 0.7, 0.9)]);
    let rub = || {
        let spring =
            JointSpring { name: "s".into(), coordinate: 0, dof: 0, stiffness: 3.0, damping: 0.0, rest: 0.0 };
        dynamics(&slider(), vec![Box::new(spring)], vec![dry(0, 0.02, 0.03)])
    };
    let (mut good, mut all) = (0, Vec::new());
    let makes: [(&dyn Fn() -> Dynamics, f64, f64); 2] = [(&swing, 0.6, 3.0), (&rub, 1.0, 5.0)];
    for (make, start, t_end) in makes {
        let (_, truth) = happenings(&mut make(), Method::Dop853, 1e-14, (&[start], &[0.0]), t_end);
        for method in [Method::Dop853, Method::Tsit5] {
            for exponent in 5..=11 {
                let tolerances = Tolerances::new(10f64.powi(-exponent));
                let mut d = make();
                let model = d.model().clone();
                let mut i = Integrator::new(&model, method, tolerances, 0.0, &[start], &[0.0], &[0.0]);
                let mut steps = Vec::new();
                while i.t() < t_end {
                    steps.push(i.step(&mut d, t_end, false).unwrap().t1);
                }
                let samples = [State { q: i.q().to_vec(), v: i.v().to_vec(), t: t_end }];
                let judged = JudgedRun {
                    method,
                    tolerances,
                    start: (0.0, &[start], &[0.0], &[0.0]),
                    steps: &steps,
                    breaks: &[],
                    samples: &samples,
                    events: i.occurrences(),
                };
                let estimate = estimate_error(&mut d, &judged).unwrap();
                let error = (i.q()[0] - truth.q()[0]).abs();
                let said = estimate.q.unwrap_or(f64::NAN);
                good +=
                    usize::from((error < 1e-12 && said < 1e-12) || (0.1..=10.0).contains(&(said / error)));
                all.push(format!("{method:?} 1e-{exponent}: {error:.1e}, said {said:.1e}"));
            }
        }
    }
    // Nine of ten, as without events: neighbouring tolerances can take the same steps in so short a run.
    assert!(10 * good >= 9 * all.len(), "{good} of {}: {all:#?}", all.len());
}

/// Energy less work, relative to what moves.
fn energy_error(d: &mut Dynamics, states: &[(State, Vec<f64>)]) -> f64 {
    let mut kinematics = phipsi_recursion::Kinematics::new(d.layout());
    let mut conserved = phipsi_motion::Conserved::default();
    for (State { q, v, t }, aux) in states {
        conserved.record(&phipsi_motion::balance(d, &mut kinematics, (*t, q, v), aux).unwrap());
    }
    conserved.energy_error()
}

/// Chains with stops and friction at every joint, some closed to a four-bar: they stay inside their stops, do not move where they are
/// held, keep energy less work, and end.
#[test]
fn chains_with_stops_and_friction_keep_their_books() {
    let rod = |name: &str| Body::new(name, Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.01, 0.1, 0.1]));
    let hinge = |name: &str, x: f64| {
        let kind = JointKind::Revolute { axis: [0.0, 1.0, 0.0] };
        Joint::new(name, kind).at(Placement::from_xyz_rpy([x, 0.0, 0.0], [0.0; 3]))
    };
    let end = || Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3]);
    let (mut kinds, mut runs) = (std::collections::BTreeSet::new(), 0);
    for seed in 0..16u32 {
        let closed = seed % 4 == 3;
        let mut builder = ModelBuilder::new("chain")
            .body(rod("1"))
            .body(rod("2"))
            .body(rod("3"))
            .joint(hinge("a", 0.0), "world", "1")
            .joint(hinge("b", 1.0), "1", "2")
            .joint(hinge("c", 1.0), if closed { "world" } else { "2" }, "3")
            .gravity([0.0, 0.0, -9.81]);
        if closed {
            builder = builder.closure(Closure {
                name: "pin".into(),
                kind: ClosureKind::Spherical,
                body_a: "2".into(),
                pose_a: end(),
                body_b: "3".into(),
                pose_b: end(),
            });
        }
        let model = builder.build().unwrap();
        // A generator of its own: fractions of a Weyl sequence.
        let part = |i: u32| (f64::from(seed * 37 + i) * 0.618_033_988_749_895).fract();
        let joints: Vec<JointSwitch> = (0..3usize)
            .map(|k| {
                let i = 10 * k as u32;
                let center = if closed { [1.0, -1.0, 1.0][k] } else { 0.0 };
                let sliding = 3.0 * part(i);
                JointSwitch {
                    dof: k,
                    stops: Some(Stops {
                        coordinate: k,
                        lower: center - 0.1 - part(i + 1),
                        upper: center + 0.1 + part(i + 2),
                        restitution: 0.9 * part(i + 3),
                    }),
                    friction: (part(i + 4) > 0.3)
                        .then_some(DryFriction { sliding, breakaway: 1.3 * sliding }),
                }
            })
            .collect();
        let (q, v) = if closed {
            ([1.0, -1.0, 1.0], [0.8, -0.8, 0.8])
        } else {
            ([0.0; 3], [part(5) - 0.5, 2.0 * part(6) - 1.0, part(7)])
        };
        let method = [Method::Dop853, Method::Tsit5, Method::Rodas5p][seed as usize % 3];
        let mut d = dynamics(&model, vec![], joints.clone());
        let tolerances = Tolerances::new(1e-9);
        let aux = vec![0.0; d.auxiliary_len()];
        let mut i = Integrator::new(&model, method, tolerances, 0.0, &q, &v, &aux);
        let mut states = vec![(State { q: q.to_vec(), v: v.to_vec(), t: 0.0 }, aux)];
        let mut steps = 0;
        while i.t() < 2.0 {
            if let Err(e) = i.step(&mut d, 2.0, false) {
                let past = i.occurrences();
                let last = &past[past.len().saturating_sub(8)..];
                panic!("seed {seed}: {} {last:#?} {:?} {:?}", e.describe(&model), i.modes(), i.v());
            }
            steps += 1;
            assert!(steps < 20_000, "seed {seed}: {:?}", &i.occurrences()[i.occurrences().len() - 20..]);
            for (joint, mode) in joints.iter().zip(i.modes()) {
                let stops = joint.stops.unwrap();
                let (q, v) = (i.q()[joint.dof], i.v()[joint.dof]);
                // What the tolerance does not tell from the stop.
                let inside = q > stops.lower - 1e-9 && q < stops.upper + 1e-9;
                let past = i.occurrences();
                assert!(
                    inside,
                    "seed {seed} at {}: {q} {v} {mode:?} {joint:?} {:#?}",
                    i.t(),
                    &past[past.len().saturating_sub(6)..]
                );
                assert!(!mode.holds() || v.abs() < 1e-14, "seed {seed}: {v:e} in {mode:?}");
                assert!(*mode != Mode::Forward || v > -1e-12, "seed {seed}: {v:e}");
                assert!(*mode != Mode::Backward || v < 1e-12, "seed {seed}: {v:e}");
            }
            let now = State { q: i.q().to_vec(), v: i.v().to_vec(), t: i.t() };
            states.push((now, i.aux().to_vec()));
        }
        for o in i.occurrences() {
            kinds.insert(match o.what {
                Happening::Impact { energy, .. } => {
                    assert!(energy > -1e-12, "seed {seed}: {o:?}");
                    "impact"
                }
                Happening::Rest { .. } => "rest",
                Happening::Leave { .. } => "leave",
                Happening::Stick { .. } => "stick",
                Happening::Slip { .. } => "slip",
                Happening::Event { .. } => "event",
            });
        }
        let error = energy_error(&mut d, &states);
        assert!(error < 1e-6, "seed {seed}, {method:?}: {error:e}");
        runs += 1;
    }
    assert_eq!(runs, 16);
    for kind in ["impact", "rest", "stick", "slip"] {
        assert!(kinds.contains(kind), "{kinds:?}");
    }
}
