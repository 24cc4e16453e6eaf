//! The error estimate on a second thread beside the run: the same numbers as after the run, and it ends when the run does.

use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder, State};
use phipsi_motion::forces::{Control, JointTorque};
use phipsi_motion::{ErrorEstimate, Force, ForceError, Loads, Method, Signal, Situation};
use phipsi_simulate::scene::{load, parse};
use phipsi_simulate::{
    Choice, Observer, Progress, Recording, Row, RunState, SimulateError, Simulation, StepRecord, Summary,
    resume, run,
};
use std::cell::Cell;
use std::path::Path;
use std::sync::Barrier;
use std::time::Duration;

/// True where a second thread has a processor.
fn has_two() -> bool {
    std::thread::available_parallelism().is_ok_and(|n| n.get() > 1)
}

/// A run on at most so many threads.
fn on(make: &dyn Fn() -> Simulation, threads: usize) -> Summary {
    let mut simulation = make();
    simulation.threads = Some(threads);
    run(&mut simulation, &mut Recording::default()).unwrap()
}

/// The estimate to the last bit.
fn bits(e: &ErrorEstimate) -> (String, [Option<u64>; 3], u64) {
    (e.how.clone(), [e.q, e.v, e.horizon].map(|x| x.map(f64::to_bits)), e.evaluations)
}

/// The estimate, once it is the same on one thread and on two.
fn same(name: &str, make: &dyn Fn() -> Simulation) -> (ErrorEstimate, bool) {
    let [one, two] = [1, 2].map(|threads| on(make, threads));
    let number = |s: &Summary| s.q.iter().chain(&s.v).map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!((number(&one), one.evaluations), (number(&two), two.evaluations), "{name}");
    assert!(!one.estimated_beside, "{name}");
    let [one, beside] = [one, two].map(|s| (s.error_estimate.unwrap(), s.estimated_beside));
    assert_eq!(bits(&one.0), bits(&beside.0), "{name}");
    beside
}

fn example(name: &str, overrides: &[&str]) -> Simulation {
    let overrides: Vec<String> = overrides.iter().map(|o| format!("integrator.{o}")).collect();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(name);
    let mut simulation = load(&path, &overrides).unwrap().simulation;
    simulation.estimate = true;
    simulation
}

/// Trees, a free base under given motions and servos, loops, moving closures, stiff methods, fixed steps, lost ends.
#[test]
fn examples_have_the_same_estimate_on_two_threads() {
    let tolerance = |decade: i32| [format!("rtol=1e-{decade}"), format!("atol=1e-{decade}")];
    let cases: [(&str, &[&str], &str); 14] = [
        ("benchmarks/pendulum.toml", &["t_end=5"], "dop853"),
        ("benchmarks/double_pendulum.toml", &["t_end=4"], "dop853"),
        ("benchmarks/chain10.toml", &["t_end=2"], "tsit5"),
        ("benchmarks/chain10.toml", &["t_end=20"], "dop853"),
        ("benchmarks/torque_free.toml", &["t_end=25"], "dop853"),
        ("benchmarks/andrews.toml", &[], "dop853"),
        ("benchmarks/bricard.toml", &["t_end=3"], "dop853"),
        ("benchmarks/car_axis.toml", &[], "tsit5"),
        ("benchmarks/n_four_bar.toml", &["t_end=0.5"], "dop853"),
        ("benchmarks/flyball.toml", &["t_end=1"], "rodas5p"),
        ("benchmarks/spatial_slider_crank.toml", &["t_end=1"], "rodas4"),
        ("satellite_arm.toml", &["t_end=10"], "dop853"),
        ("satellite_two_arms.toml", &["t_end=5"], "dop853"),
        ("benchmarks/light_cart_pole.toml", &["t_end=2"], "dop853"),
    ];
    let mut ways = std::collections::BTreeSet::new();
    for (name, more, method) in cases {
        for decade in [6, 8, 10] {
            let method = format!("method={method}");
            let [rtol, atol] = tolerance(decade);
            let overrides = [more, &[&method, &rtol, &atol]].concat();
            let (estimate, beside) = same(&format!("{name} {overrides:?}"), &|| example(name, &overrides));
            assert_eq!(beside, has_two(), "{name}");
            ways.insert(estimate.how);
        }
    }
    let fixed = || {
        let mut simulation = Simulation::new(&pendulum(), Vec::new(), 3.0).unwrap();
        simulation.choice = Choice::asked(Method::Rk4 { step: 0.01 });
        simulation
    };
    ways.insert(same("rk4", &fixed).0.how);
    // Merged steps, three companions.
    assert!(ways.len() >= 4, "{ways:?}");
}

/// A ball of 1 kg over the ground.
const BALL: &str = r#"
[model]
gravity = [0, 0, -10]
[[body]]
name = "ball"
inertial = { mass = 1.0, inertia = { ixx = 0.1, iyy = 0.1, izz = 0.1 } }
[[joint]]
name = "height"
type = "prismatic"
parent = "world"
child = "ball"
axis = [0, 0, 1]
limit = { lower = 0 }
dynamics = { friction = 0.0 }
[initial]
q.height = 1.25
[integrator]
t_end = 4
[joint_stops]
restitution = 0.5
[outputs]
energy = { energy = "total" }
"#;

fn parsed(text: &str) -> Simulation {
    parse(text.into(), "test", "test.toml", Path::new(""), &[]).unwrap().simulation
}

#[test]
fn stops_friction_and_events_have_the_same_estimate_on_two_threads() {
    let record = format!("{BALL}[[event]]\nname = \"low\"\nwhen = \"q.height - 0.1\"\n");
    let rough =
        BALL.replace("friction = 0.0", "friction = 2.0").replace("restitution = 0.5", "restitution = 0.9");
    let short = rough.replace("t_end = 4", "t_end = 1.7\nrtol = 1e-6");
    for (name, text) in [("bounces", BALL), ("events", &record), ("rough", &rough), ("short", &short)] {
        assert_eq!(same(name, &|| parsed(text)).1, has_two(), "{name}");
    }
    // What the companion did not know of cannot be followed: a run that an event ends is judged afterwards.
    let stops = format!("{record}action = \"stop\"\n");
    assert!(!same("ended by an event", &|| parsed(&stops)).1);
    // The same event, but it does not happen.
    let never = stops.replace("q.height - 0.1", "q.height + 0.1");
    assert_eq!(same("not ended", &|| parsed(&never)).1, has_two());
}

fn pendulum() -> Model {
    let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
    ModelBuilder::new("pendulum")
        .body(Body::new("rod", rod))
        .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
        .build()
        .unwrap()
}

/// A force with one owner.
struct Own(JointTorque);

impl Force for Own {
    fn name(&self) -> &str {
        "own"
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        aux: &[f64],
        rates: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        self.0.add(at, aux, rates, loads)
    }
}

type Make<'a> = &'a dyn Fn() -> Box<dyn Force>;

/// Forces that have a second one, and forces that have none: the same numbers, but only the first beside the run.
#[test]
fn a_force_without_a_second_one_is_judged_after_the_run() {
    let value = Signal::function(|t: f64| t.sin(), |t: f64| t.cos());
    let torque = JointTorque { name: "torque".into(), dof: 0, value };
    let law = |t: f64, _: &[f64], _: &[f64], tau: &mut [f64]| {
        tau[0] = t.sin();
        Ok::<(), String>(())
    };
    let kinds: [(Make<'_>, bool); 4] = [
        (&|| Box::new(torque.clone()), true),
        (&|| Box::new(Own(torque.clone())), false),
        (&|| Box::new(Control::new("law", 1, law)), false),
        (&|| Box::new(Control::shared("law", 1, law)), true),
    ];
    let mut found = Vec::new();
    for (force, can) in kinds {
        let make = || Simulation::new(&pendulum(), vec![force()], 3.0).unwrap();
        let (estimate, beside) = same("a force", &make);
        assert_eq!(beside, can && has_two());
        found.push(bits(&estimate));
    }
    assert!(found.iter().all(|e| *e == found[0]), "{found:?}");
}

/// Stops after so many steps, or when the estimate begins.
struct Halted {
    recording: Recording,
    after: usize,
    in_estimate: bool,
    estimating: Cell<bool>,
    state: Option<RunState>,
}

impl Halted {
    fn new(after: usize, in_estimate: bool) -> Self {
        let recording = Recording::default();
        Halted { recording, after, in_estimate, estimating: Cell::new(false), state: None }
    }
}

impl Observer for Halted {
    fn row(&mut self, row: &Row) -> Result<(), SimulateError> {
        self.recording.row(row)
    }
    fn step(&mut self, step: &StepRecord, progress: &Progress<'_>) -> Result<(), SimulateError> {
        self.recording.step(step, progress)
    }
    fn stopped(&mut self, progress: &Progress<'_>) -> Result<(), SimulateError> {
        self.state = Some(progress.state());
        Ok(())
    }
    fn stop(&self) -> bool {
        self.recording.steps.len() >= self.after || (self.in_estimate && self.estimating.get())
    }
    fn estimating(&mut self) {
        self.estimating.set(true);
    }
    fn step_ends(&mut self) -> Result<Vec<f64>, SimulateError> {
        self.recording.step_ends()
    }
    fn spread_rows(&mut self, most: usize) -> Result<Vec<State>, SimulateError> {
        self.recording.spread_rows(most)
    }
}

/// Interrupted at several places and resumed, on one thread or two before and after: the estimate of a run that was not.
#[test]
fn resumed_runs_have_the_estimate_of_whole_ones() {
    let double = || example("benchmarks/double_pendulum.toml", &["t_end=4", "rtol=1e-10", "atol=1e-10"]);
    let loose = || example("benchmarks/andrews.toml", &["method=dop853", "rtol=1e-6", "atol=1e-6"]);
    let bounces = || parsed(BALL);
    let cases: [(&str, &dyn Fn() -> Simulation); 3] =
        [("merged", &double), ("companion", &loose), ("bounces", &bounces)];
    for (name, make) in cases {
        let whole = on(make, 1);
        for (after, before, then) in [(1, 2, 2), (7, 1, 2), (7, 2, 1)] {
            let mut simulation = make();
            simulation.threads = Some(before);
            let mut halted = Halted::new(after, false);
            let part = run(&mut simulation, &mut halted).unwrap();
            assert!(!part.finished && part.error_estimate.is_none(), "{name}");
            let mut simulation = make();
            simulation.threads = Some(then);
            let rest = resume(&mut simulation, halted.state.unwrap(), &mut halted.recording).unwrap();
            assert_eq!(rest.estimated_beside, then > 1 && has_two(), "{name}");
            assert_eq!((&rest.q, &rest.v, rest.steps), (&whole.q, &whole.v, whole.steps), "{name}");
            let [rest, whole] = [&rest, &whole].map(|s| bits(s.error_estimate.as_ref().unwrap()));
            assert_eq!(rest, whole, "{name} after {after}");
        }
    }
}

/// Waits at its first row until all runs have begun, and in its first step until all have or have not begun their companions.
struct Together<'a> {
    recording: Recording,
    begun: &'a Barrier,
}

impl Observer for Together<'_> {
    fn row(&mut self, row: &Row) -> Result<(), SimulateError> {
        if self.recording.rows.is_empty() {
            self.begun.wait();
        }
        self.recording.row(row)
    }
    fn step(&mut self, step: &StepRecord, progress: &Progress<'_>) -> Result<(), SimulateError> {
        if self.recording.steps.is_empty() {
            self.begun.wait();
        }
        self.recording.step(step, progress)
    }
    fn step_ends(&mut self) -> Result<Vec<f64>, SimulateError> {
        self.recording.step_ends()
    }
    fn spread_rows(&mut self, most: usize) -> Result<Vec<State>, SimulateError> {
        self.recording.spread_rows(most)
    }
}

/// As many runs at once as there are processors: no companion has one of its own, and the estimates are those of one run alone.
#[test]
fn runs_that_keep_all_processors_busy_have_no_companions_beside_them() {
    let make = || example("benchmarks/double_pendulum.toml", &["t_end=4", "rtol=1e-10", "atol=1e-10"]);
    let alone = on(&make, 1);
    let many = std::thread::available_parallelism().map_or(1, |n| n.get());
    let begun = Barrier::new(many);
    let summaries: Vec<Summary> = std::thread::scope(|scope| {
        let runs: Vec<_> = (0..many)
            .map(|_| {
                scope.spawn(|| {
                    let mut watcher = Together { recording: Recording::default(), begun: &begun };
                    run(&mut make(), &mut watcher).unwrap()
                })
            })
            .collect();
        runs.into_iter().map(|run| run.join().unwrap()).collect()
    });
    for summary in &summaries {
        assert!(!summary.estimated_beside);
        assert_eq!((&summary.q, &summary.v), (&alone.q, &alone.v));
        let [one, other] = [summary, &alone].map(|s| bits(s.error_estimate.as_ref().unwrap()));
        assert_eq!(one, other);
    }
}

/// A torque whose copy, which the companion has, is slow; it fails from a time on.
struct Slow {
    is_copy: bool,
    fails_from: f64,
}

impl Force for Slow {
    fn name(&self) -> &str {
        "slow"
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        if self.is_copy {
            std::thread::sleep(Duration::from_millis(2));
        }
        if at.t > self.fails_from {
            return Err(ForceError { force: "slow".into(), t: at.t, message: "it is over".into() });
        }
        loads.tau[0] += at.t.sin();
        Ok(())
    }
    fn another(&self) -> Option<Box<dyn Force>> {
        Some(Box::new(Slow { is_copy: true, fails_from: self.fails_from }))
    }
}

/// A companion that would take minutes ends with a run that fails or that the user stops, before its next evaluation.
#[test]
fn a_companion_ends_with_its_run() {
    let make = |fails_from: f64| {
        let slow = Slow { is_copy: false, fails_from };
        let mut simulation = Simulation::new(&pendulum(), vec![Box::new(slow)], 1000.0).unwrap();
        simulation.threads = Some(2);
        simulation
    };
    // Tens of thousands of evaluations of 2 ms: one that waited for its companion would hang for minutes.
    let failed = run(&mut make(20.0), &mut Recording::default());
    assert!(failed.unwrap_err().to_string().contains("it is over"));
    let mut halted = Halted::new(50, false);
    let stopped = run(&mut make(f64::INFINITY), &mut halted).unwrap();
    assert!(!stopped.finished && stopped.error_estimate.is_none() && halted.state.is_some());
    let mut halted = Halted::new(usize::MAX, true);
    let in_estimate = run(&mut make(f64::INFINITY), &mut halted).unwrap();
    assert!(!in_estimate.finished && in_estimate.error_estimate.is_none());
    assert!(in_estimate.t == 1000.0 && in_estimate.estimated_beside == has_two());
}
