//! Events of functions of the state: where they are, which ones count, and what they leave of a method's order.

use crate::common::*;
use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder};
use phipsi_motion::forces::JointSpring;
use phipsi_motion::{
    Action, Direction, Dynamics, Event, Happening, Integrator, Method, Occurrence, Scheme, Stepper, System,
    Tolerances,
};
use std::f64::consts::{FRAC_PI_2, PI};

const METHODS: [Method; 5] =
    [Method::Dop853, Method::Tsit5, Method::Rk4 { step: 0.01 }, Method::Rodas4, Method::Rodas5p];

/// 1 kg on a rail along x, without weight.
pub fn slider() -> Model {
    ModelBuilder::new("slider")
        .body(Body::new("block", Inertia::from_principal(1.0, [0.0; 3], [0.1; 3])))
        .joint(Joint::new("rail", JointKind::Prismatic { axis: [1.0, 0.0, 0.0] }), "world", "block")
        .gravity([0.0; 3])
        .build()
        .unwrap()
}

pub fn spring(stiffness: f64) -> Box<JointSpring> {
    Box::new(JointSpring { name: "spring".into(), coordinate: 0, dof: 0, stiffness, damping: 0.0, rest: 0.0 })
}

/// x = cos t.
fn oscillator(events: Vec<Event>) -> Dynamics {
    Dynamics::new(&slider(), vec![spring(1.0)]).unwrap().with_events(events)
}

/// Everything that happens up to t_end, and the state there or where an event stops the run.
pub fn happenings(
    dynamics: &mut Dynamics,
    method: Method,
    tolerance: f64,
    (q, v): (&[f64], &[f64]),
    t_end: f64,
) -> (Vec<Occurrence>, Integrator) {
    let aux = vec![0.0; dynamics.auxiliary_len()];
    let model = dynamics.model().clone();
    let mut i = Integrator::new(&model, method, Tolerances::new(tolerance), 0.0, q, v, &aux);
    let breaks: Vec<f64> = dynamics.breaks().into_iter().filter(|b| *b > 0.0 && *b < t_end).collect();
    'run: for limit in breaks.into_iter().chain([t_end]) {
        while i.t() < limit {
            if i.step(dynamics, limit, limit < t_end).unwrap().stop {
                break 'run;
            }
        }
        i.restart();
    }
    (i.occurrences().to_vec(), i)
}

fn times(found: &[Occurrence], event: usize) -> Vec<f64> {
    found.iter().filter(|o| o.what == Happening::Event { index: event }).map(|o| o.t).collect()
}

fn all_near(found: &[f64], want: &[f64], allowed: f64) {
    assert_eq!(found.len(), want.len(), "{found:?} instead of {want:?}");
    for (a, b) in found.iter().zip(want) {
        assert!((a - b).abs() < allowed, "{a} instead of {b}: {:e}", (a - b).abs());
    }
}

#[test]
fn thresholds_are_crossed_when_the_cosine_says() {
    let at = |name: &str, direction, level: f64| {
        Event::new(name, direction, Action::Record, move |at| at.q[0] - level)
    };
    for method in METHODS {
        let events = vec![
            at("down", Direction::Falling, 0.5),
            at("up", Direction::Rising, 0.5),
            at("both", Direction::Either, 0.0),
            // cos 0 = 1: it starts at zero and only touches it later.
            at("start", Direction::Falling, 1.0),
            Event::new("clock", Direction::Rising, Action::Record, |at| at.t - 2.5),
        ];
        let mut dynamics = oscillator(events);
        // Error of the motion after some hundred steps at 1e-11; 0.01⁴/120 a second for the fixed step.
        let allowed = if let Method::Rk4 { .. } = method { 1e-8 } else { 5e-9 };
        let (found, end) = happenings(&mut dynamics, method, 1e-11, (&[1.0], &[0.0]), 10.0);
        let third = PI / 3.0;
        all_near(&times(&found, 0), &[third, third + 2.0 * PI], allowed);
        all_near(&times(&found, 1), &[5.0 * third], allowed);
        all_near(&times(&found, 2), &[FRAC_PI_2, 3.0 * FRAC_PI_2, 5.0 * FRAC_PI_2], allowed);
        assert_eq!(times(&found, 4), [2.5], "{method:?}");
        assert!((end.q()[0] - 10f64.cos()).abs() < allowed);
        let order: Vec<f64> = found.iter().map(|o| o.t).collect();
        assert!(order.is_sorted(), "{order:?}");
    }
}

/// At the event the function is zero to rounding of time, and energy says how fast a pendulum is there.
#[test]
fn a_pendulum_stops_at_an_angle() {
    for method in METHODS {
        let event = Event::new("there", Direction::Falling, Action::Stop, |at| at.q[0] - 0.3);
        let mut dynamics = free_fall(&pendulum(), vec![]).with_events(vec![event]);
        let (found, end) = happenings(&mut dynamics, method, 1e-11, (&[1.2], &[0.0]), 10.0);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].t, end.t());
        assert!((end.q()[0] - 0.3).abs() < 8.0 * f64::EPSILON, "{method:?}: {:e}", end.q()[0] - 0.3);
        let speed = (2.0 * 9.81 * (0.3f64.cos() - 1.2f64.cos())).sqrt();
        let allowed = if let Method::Rk4 { .. } = method { 1e-8 } else { 1e-9 };
        assert!((end.v()[0] + speed).abs() < allowed, "{method:?}: {:e}", end.v()[0] + speed);
    }
}

/// The lowest point of a swing, a quarter period after release: T = 4 K(sin ½q₀)/√g, K by the arithmetic-geometric mean.
#[test]
fn a_pendulum_passes_the_lowest_point_after_a_quarter_period() {
    let event = Event::new("low", Direction::Falling, Action::Stop, |at| at.q[0]);
    let mut dynamics = free_fall(&pendulum(), vec![]).with_events(vec![event]);
    let (found, _) = happenings(&mut dynamics, Method::Dop853, 1e-13, (&[2.0], &[0.0]), 10.0);
    let (mut a, mut b) = (1.0f64, 1.0f64.cos());
    while (a - b).abs() > 1e-16 {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    let quarter = FRAC_PI_2 / a / 9.81f64.sqrt();
    assert!((found[0].t - quarter).abs() < 1e-12, "{:e}", found[0].t - quarter);
}

/// A thrown body, y = 3 t − ½ 9.81 t²: thresholds a hair below and above its highest point.
#[test]
fn grazing_is_seen_where_it_passes() {
    let top = 0.5 * 9.0 / 9.81;
    let model = ModelBuilder::new("thrown")
        .body(Body::new("ball", Inertia::from_principal(1.0, [0.0; 3], [0.1; 3])))
        .joint(Joint::new("up", JointKind::Prismatic { axis: [0.0, 0.0, 1.0] }), "world", "ball")
        .gravity([0.0, 0.0, -9.81])
        .build()
        .unwrap();
    for (below, passages) in [(1e-7, 2), (-1e-7, 0)] {
        let event = Event::new("near", Direction::Either, Action::Record, move |at| at.q[0] - (top - below));
        let mut dynamics = free_fall(&model, vec![]).with_events(vec![event]);
        let (found, _) = happenings(&mut dynamics, Method::Dop853, 1e-10, (&[0.0], &[3.0]), 0.6);
        assert_eq!(found.len(), passages, "{found:?}");
        if let [up, down] = &found[..] {
            let half = (2.0 * below / 9.81).sqrt();
            // A root at a slope of 1e-3: rounding of q there, over the slope.
            all_near(&[up.t, down.t], &[3.0 / 9.81 - half, 3.0 / 9.81 + half], 1e-12);
        }
    }
}

/// Several events in one step come in their order, and one that acts makes those after it anew.
#[test]
fn events_of_one_step_come_in_order() {
    let clock = |t: f64| Event::new("clock", Direction::Rising, Action::Record, move |at| at.t - t);
    let turn = Event::new(
        "turn",
        Direction::Rising,
        Action::Change(Box::new(|_, _, v: &mut [f64]| v[0] = -v[0])),
        |at| at.q[0] - 0.25,
    );
    let far = Event::new("far", Direction::Rising, Action::Record, |at| at.q[0] - 0.3);
    let mut dynamics =
        free_fall(&slider(), vec![]).with_events(vec![clock(0.3), clock(0.1), turn, far, clock(0.25)]);
    let (found, end) = happenings(&mut dynamics, Method::Dop853, 1e-6, (&[0.0], &[1.0]), 1.0);
    let order: Vec<Happening> = found.iter().map(|o| o.what).collect();
    let index = |i| Happening::Event { index: i };
    // The turn and the third clock are at the same time: either may come first.
    assert!(
        order == [index(1), index(2), index(4), index(0)]
            || order == [index(1), index(4), index(2), index(0)],
        "{found:?}"
    );
    assert!((end.q()[0] + 0.5).abs() < 1e-14);
}

/// An oscillator that is thrown back at zero follows |cos t|: the event leaves its function at zero, on the side from which it came.
#[test]
fn orders_survive_events() {
    for (method, counts) in [
        (Method::Rk4 { step: 1.0 }, [30, 45, 60, 90]),
        (Method::Tsit5, [24, 32, 44, 60]),
        (Method::Dop853, [6, 8, 11, 14]),
        (Method::Rodas4, [40, 60, 80, 120]),
        (Method::Rodas5p, [30, 40, 55, 75]),
    ] {
        let error = |n: usize| {
            let bounce = Event::new(
                "bounce",
                Direction::Either,
                Action::Change(Box::new(|_, _, v: &mut [f64]| v[0] = -v[0])),
                |at| at.q[0],
            );
            let mut dynamics = oscillator(vec![bounce]);
            let accept = Tolerances { rtol: f64::INFINITY, atol: f64::INFINITY, max_step: f64::INFINITY };
            let mut i = Integrator::new(&slider(), method, accept, 0.0, &[1.0], &[0.0], &[]);
            let end = 6.0;
            for k in 1..=n {
                let t = end * k as f64 / n as f64;
                while i.t() < t {
                    i.propose(t - i.t());
                    i.step(&mut dynamics, t, false).unwrap();
                }
            }
            assert_eq!(i.occurrences().len(), 2);
            (i.q()[0] - 6f64.cos().abs()).abs().max((i.v()[0] + 6f64.sin()).abs())
        };
        let points = counts.map(|n| ((n as f64).ln(), error(n).ln()));
        let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / points.len() as f64;
        let (x, y) = (mean(|p| p.0), mean(|p| p.1));
        let slope = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>()
            / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>();
        let order = f64::from(method.order());
        // Where the step is cut depends on the number of steps, so the points scatter about the line; a location of lower order
        // than the method would cost one or more.
        assert!(-slope > order - 0.5, "{method:?}: observed {:.2}, {points:?}", -slope);
    }
}

#[test]
fn a_checkpoint_between_events_continues_bit_for_bit() {
    let make = || {
        let bounce = Event::new(
            "bounce",
            Direction::Falling,
            Action::Change(Box::new(|_, _, v: &mut [f64]| v[0] *= -0.9)),
            |at| at.q[0],
        );
        let record = Event::new("record", Direction::Either, Action::Record, |at| at.q[0] - 0.4);
        oscillator(vec![bounce, record])
    };
    let start =
        || Integrator::new(&slider(), Method::Dop853, Tolerances::new(1e-8), 0.0, &[1.0], &[0.0], &[]);
    let go = |dynamics: &mut Dynamics, i: &mut Integrator, steps: usize| {
        let mut trace = Vec::new();
        for _ in 0..steps {
            i.step(dynamics, 50.0, false).unwrap();
            trace.extend([i.t(), i.q()[0], i.v()[0]].map(f64::to_bits));
        }
        trace
    };
    let whole = go(&mut make(), &mut start(), 60);
    for at in 1..50 {
        let (mut dynamics, mut first) = (make(), start());
        go(&mut dynamics, &mut first, at);
        let mut second = start();
        second.restore(first.checkpoint());
        let rest = go(&mut make(), &mut second, 60 - at);
        assert_eq!(rest[..], whole[3 * at..], "after {at} steps");
    }
}

/// Events that bring each other about without time between them are refused, not run for ever.
#[test]
fn events_without_time_between_them_are_refused() {
    let back = |from: f64, to: f64| {
        let direction = if to > from { Direction::Falling } else { Direction::Rising };
        let jump = Action::Change(Box::new(move |_, q: &mut [f64], _: &mut [f64]| q[0] = to));
        Event::new("jump", direction, jump, move |at| at.q[0] - from)
    };
    // Each throws the block over the threshold of the other.
    let mut dynamics = free_fall(&slider(), vec![]).with_events(vec![back(0.5, 0.2), back(0.3, 0.6)]);
    let mut i = Integrator::new(&slider(), Method::Dop853, Tolerances::new(1e-8), 0.0, &[0.4], &[1.0], &[]);
    let failed = (0..1000).find_map(|_| i.step(&mut dynamics, 10.0, false).err());
    let text = failed.unwrap().describe(&slider());
    assert!(text.contains("without time between them"), "{text}");
}

/// A pendulum's kinetic energy passes a level where its height says, sin² + cos² = 1 says the rest; a conserved sum does not pass.
#[test]
fn energies_pass_levels() {
    let looks = |name: &str, level: f64, total: bool| {
        Event::of_energies(name, Direction::Either, Action::Record, move |_, e| {
            e.kinetic + if total { e.potential } else { 0.0 } - level
        })
    };
    // x = cos t, kinetic ½ sin² t, potential ½ cos² t.
    let mut dynamics = oscillator(vec![looks("kinetic", 0.25, false), looks("total", 0.4, true)]);
    let (found, _) = happenings(&mut dynamics, Method::Dop853, 1e-11, (&[1.0], &[0.0]), 4.0);
    let quarter = FRAC_PI_2 / 2.0;
    // Errors of the motion at 1e-11, as above.
    all_near(&times(&found, 0), &[quarter, 3.0 * quarter, 5.0 * quarter], 5e-9);
    assert!(times(&found, 1).is_empty());
}

fn midpoint(events: Vec<Event>, t_end: f64) -> (Vec<(f64, f64)>, Vec<Occurrence>, Stepper, Dynamics) {
    let mut dynamics = oscillator(events);
    let start = phipsi_model::State { q: vec![1.0], v: vec![0.0], t: 0.0 };
    let scheme = Scheme::Midpoint { step: 0.1 };
    let mut stepper = Stepper::new(&mut dynamics, scheme, Tolerances::new(1e-9), &start, &[]).unwrap();
    let (mut states, mut found) = (vec![(1.0, 0.0)], Vec::new());
    while stepper.t() < t_end - 1e-6 {
        let info = stepper.step(&mut dynamics, t_end, false).unwrap();
        found.extend_from_slice(stepper.occurrences());
        assert_eq!(info.t1, stepper.t());
        states.push((stepper.q()[0], stepper.v()[0]));
        if info.stop {
            break;
        }
    }
    (states, found, stepper, dynamics)
}

/// On an oscillator the midpoint method's steps are parabolas, q + s v − s² q/2: where one is zero is known. What is recorded leaves no
/// trace in the motion, and a stop ends the run at the root.
#[test]
fn the_midpoint_method_knows_where_its_steps_pass() {
    let zero = |action| Event::new("zero", Direction::Either, action, |at| at.q[0]);
    let clock = Event::new("clock", Direction::Rising, Action::Record, |at| at.t - 2.25);
    let (bare, none, ..) = midpoint(vec![], 10.0);
    let (states, found, ..) = midpoint(vec![zero(Action::Record), clock], 10.0);
    assert!(none.is_empty() && states == bare);
    let root = |n: usize| {
        let (q, v) = bare[n];
        let root = (v * v + 2.0 * q * q).sqrt();
        let s = if v < 0.0 { 2.0 * q / (root - v) } else { -2.0 * q / (root + v) };
        0.1 * n as f64 + s
    };
    let passes = |n: &usize| bare[*n].0 * bare[n + 1].0 < 0.0;
    let want: Vec<f64> = (0..bare.len() - 1).filter(passes).map(root).collect();
    // Rounding of time, and of q over its rate.
    all_near(&times(&found, 0), &want, 1e-14);
    assert_eq!(want.len(), 3);
    all_near(&times(&found, 1), &[2.25], 1e-14);
    let (states, found, mut stepper, mut dynamics) = midpoint(vec![zero(Action::Stop)], 10.0);
    assert_eq!((found.len(), found[0].t), (1, stepper.t()));
    assert!((stepper.t() - want[0]).abs() < 1e-14 && states[states.len() - 1].0.abs() < 1e-15);
    // A checkpoint there is of that place.
    let kept = stepper.checkpoint();
    let (t, q, v) = (stepper.t(), stepper.q().to_vec(), stepper.v().to_vec());
    stepper.step(&mut dynamics, 10.0, false).unwrap();
    assert!(stepper.restore(kept) && (stepper.t(), stepper.q(), stepper.v()) == (t, &q[..], &v[..]));
}
