//! Runs: stiff springs and dampers, fast spins, separatrices, light carts, long and late spans, singular positions on the way.
//!
//! Each has a closed form, or values at its end that are known. The bar is what the library says itself: its estimate of the error
//! times ten, or what rounding explains.

use super::chain::Chain;
use super::loops::Parallelograms;
use super::page::number;
use super::{Measured, Outcome, Scene};
use crate::record::Recording;
use crate::run::{Summary, run};
use crate::simulation::{Choice, Simulation, method_name};
use phipsi_model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder};
use phipsi_motion::forces::JointSpring;
use phipsi_motion::{Force, Method, Scheme, Tolerances};
use std::f64::consts::{FRAC_PI_2, PI};

const FAMILY: &str = "motions";

/// Relative change of parameters and start that κ is measured with: κ of 1e6 still is a small change, and errors of tight runs are
/// smaller by orders.
const STEP: f64 = 1e-7;

/// Rounding of a run: its evaluations are n ε κ each, and not independent.
const ROUNDING: f64 = 100.0;

/// A motion without a significant digit left is not right, whatever explains it.
const MEANINGFUL: f64 = 1e-3;

type Made = Result<Simulation, Box<dyn std::error::Error>>;

/// The error of a run's end.
type EndError = Box<dyn Fn(&Summary) -> f64 + Send>;

/// What a run is judged by.
struct Truth {
    /// Error of the end, rad or m; `None`: only what is conserved is known.
    error: Option<EndError>,
    /// Size of the motion.
    scale: f64,
    /// κ where it is not measured.
    kappa: Option<f64>,
    /// The error that must be kept, over the size, where it is not what the library tells.
    line: Option<f64>,
    /// Largest drift.
    drift: f64,
}

impl Truth {
    fn of(scale: f64, error: impl Fn(&Summary) -> f64 + Send + 'static) -> Self {
        Truth { error: Some(Box::new(error)), scale, kappa: None, line: None, drift: f64::INFINITY }
    }
    fn conserved(drift: f64) -> Self {
        Truth { error: None, scale: 1.0, kappa: None, line: None, drift }
    }
}

/// `make(s)`: the scene with its parameters or its start changed by parts of s.
fn scene(
    name: impl Into<String>,
    what: &str,
    truth: Truth,
    make: impl Fn(f64) -> Made + Send + 'static,
) -> Scene {
    Scene::new(FAMILY, name, what, move || judge(&truth, make))
}

fn judge(truth: &Truth, make: impl Fn(f64) -> Made) -> Measured {
    let go = |s: f64| -> Result<(Summary, String), Box<dyn std::error::Error>> {
        let mut simulation = make(s)?;
        // As `method = "auto"` of a scene file.
        if simulation.choice.why != Choice::asked(Method::Dop853).why
            && let Some(choice) = crate::stiffness::look(&mut simulation)
        {
            simulation.choice = choice;
        }
        simulation.every = (simulation.t_end - simulation.start.t) / 200.0;
        let method = method_name(simulation.choice.method).to_string();
        Ok((run(&mut simulation, &mut Recording::default())?, method))
    };
    let (summary, method) = match go(0.0) {
        Ok(done) => done,
        Err(e) => return Measured::refused(e),
    };
    let [angular, linear] = summary.momentum_error.unwrap_or_default();
    let drift = summary.energy_error.max(angular).max(linear);
    if summary.q.iter().chain(&summary.v).chain([&drift]).any(|x| !x.is_finite()) {
        return Measured::wrong("a number of the end is not finite, and no error said so");
    }
    let error = truth.error.as_ref().map(|error| error(&summary) / truth.scale);
    let kappa = truth.kappa.or_else(|| {
        truth.error.as_ref()?;
        let (other, _) = go(STEP).ok()?;
        let moved = other.q.iter().zip(&summary.q).fold(0.0f64, |m, (x, y)| m.max((x - y).abs()));
        Some((moved / (STEP * truth.scale)).max(1.0))
    });
    let explained = ROUNDING * f64::EPSILON * kappa.unwrap_or(1.0);
    let told = summary.error_estimate.as_ref().map(|e| e.q.map(|q| q / truth.scale));
    let mut message = match &told {
        Some(Some(told)) => format!("{method}; it tells {told:.0e}"),
        Some(None) => format!("{method}; it tells that the end is lost"),
        None => method,
    };
    let bar = truth.line.unwrap_or(explained.max(told.flatten().map_or(0.0, |told| 10.0 * told)));
    let outcome = if error.is_none_or(|e| e <= bar.min(MEANINGFUL)) && drift <= truth.drift {
        Outcome::Right
    } else if told.is_some_and(|told| told.is_none_or(|told| told > MEANINGFUL)) {
        Outcome::Warned
    } else {
        message = format!(
            "{message}; error {} where {bar:.0e} is required, drift {drift:.0e} where {:.0e}",
            number(error),
            truth.drift
        );
        Outcome::Wrong
    };
    Measured {
        error,
        kappa,
        backward: None,
        drift: Some(drift),
        steps: Some(summary.steps),
        wall_s: summary.wall_s,
        outcome,
        message,
    }
}

/// A body on a joint at the world's origin.
fn single(kind: JointKind, inertia: Inertia, gravity: f64) -> Result<Model, Box<dyn std::error::Error>> {
    Ok(ModelBuilder::new("body")
        .gravity([0.0, 0.0, -gravity])
        .body(Body::new("body", inertia))
        .joint(Joint::new("joint", kind), "world", "body")
        .build()?)
}

fn tolerance(simulation: &mut Simulation, tolerance: f64) {
    simulation.tolerances = Tolerances::new(tolerance);
    simulation.choice = Choice::automatic(simulation.tolerances, 0);
}

/// A mass of 1 kg on a spring and damper, released at q = 1 m.
fn oscillator(stiffness: f64, damping: f64, t_end: f64, begin: f64) -> impl Fn(f64) -> Made + Send {
    move |s| {
        let mass = Inertia::from_principal(1.0, [0.0; 3], [0.1; 3]);
        let model = single(JointKind::Prismatic { axis: [1.0, 0.0, 0.0] }, mass, 0.0)?;
        let stiffness = stiffness * (1.0 + s);
        let spring =
            JointSpring { name: "spring".into(), coordinate: 0, dof: 0, stiffness, damping, rest: 0.0 };
        let forces: Vec<Box<dyn Force>> = vec![Box::new(spring)];
        let mut simulation = Simulation::new(&model, forces, begin + t_end)?;
        simulation.start.q[0] = 1.0;
        simulation.start.t = begin;
        Ok(simulation)
    }
}

/// The same at time t: x'' + c x' + k x = 0.
fn oscillation(k: f64, c: f64, t: f64) -> f64 {
    let square = c * c / 4.0 - k;
    if square == 0.0 {
        return (1.0 + c / 2.0 * t) * (-c / 2.0 * t).exp();
    }
    if square < 0.0 {
        let w = (-square).sqrt();
        return (-c / 2.0 * t).exp() * ((w * t).cos() + c / (2.0 * w) * (w * t).sin());
    }
    let root = square.sqrt();
    let fast = c / 2.0 + root;
    // The slow root is the quotient: the difference would lose its digits.
    let slow = k / fast;
    (fast * (-slow * t).exp() - slow * (-fast * t).exp()) / (fast - slow)
}

fn springs() -> Vec<Scene> {
    let mut all = Vec::new();
    for decade in [0, 4, 8, 12] {
        let k = 10f64.powi(decade);
        let t_end = 1000.0 / k.sqrt();
        let exact = oscillation(k, 0.0, t_end);
        let truth = Truth::of(1.0, move |s| (s.q[0] - exact).abs());
        let what = "1 kg on a spring of that stiffness, N/m: 160 periods";
        all.push(scene(format!("spring-1e{decade}"), what, truth, oscillator(k, 0.0, t_end, 0.0)));
    }
    for (name, k, c) in [
        ("damped-1e6", 1e6, 1e6),
        ("damped-1e12", 1e12, 1e12),
        ("damper-1e12", 1.0, 1e12),
        ("critical-1e12", 1e12, 2e6),
    ] {
        let exact = oscillation(k, c, 1.0);
        let truth = Truth::of(1.0, move |s| (s.q[0] - exact).abs());
        let what = "1 kg on a spring and a damper, N/m and N·s/m, for 1 s";
        all.push(scene(name, what, truth, oscillator(k, c, 1.0, 0.0)));
    }
    let exact = oscillation(1.0, 0.0, 1e5);
    let truth = Truth::of(1.0, move |s| (s.q[0] - exact).abs());
    all.push(
        scene("long-1e5", "an oscillator of 1 rad/s for 1e5 s", truth, oscillator(1.0, 0.0, 1e5, 0.0)).slow(),
    );
    for (name, begin, line) in [("late-1e9", 1e9, 1e-6), ("late-1e17", 1e17, 1.0)] {
        let exact = oscillation(1.0, 0.0, 10.0);
        // Times are rounded to ε × 1e9 there: the truth is of that span.
        let truth = Truth { line: Some(line), ..Truth::of(1.0, move |s: &Summary| (s.q[0] - exact).abs()) };
        all.push(scene(
            name,
            "an oscillator of 1 rad/s that starts that late, s",
            truth,
            oscillator(1.0, 0.0, 10.0, begin),
        ));
    }
    // Its steps are shorter than time resolves at the end: it must be refused, within its first steps.
    let never = Truth::of(1.0, |_| f64::NAN);
    let what = "an oscillator of 1 rad/s for 1e300 s";
    all.push(scene("swing-1e300", what, never, oscillator(1.0, 0.0, 1e300, 0.0)).slow());
    let truth = Truth::of(1e300, |s| (s.q[0] - 1e300).abs());
    all.push(scene("span-1e300", "a body that moves freely at 1 m/s for 1e300 s", truth, |s| {
        let mass = Inertia::from_principal(1.0, [0.0; 3], [0.1; 3]);
        let model = single(JointKind::Prismatic { axis: [1.0, 0.0, 0.0] }, mass, 0.0)?;
        let mut simulation = Simulation::new(&model, Vec::new(), 1e300)?;
        simulation.start.v[0] = 1.0 + s;
        // Increments of 1e298 m are not resolved to a nanometre.
        simulation.tolerances.atol = 1e290;
        Ok(simulation)
    }));
    all
}

/// A pendulum of two rods whose elbow is a spring of 1e12 N·m/rad: as good as one rod.
fn stiff_elbow() -> Scene {
    let pendulum = |elbow: Option<f64>, g: f64| -> Made {
        let rod = |m: f64, l: f64| {
            let moment = m * l * l / 12.0;
            Inertia::from_principal(m, [0.0, 0.0, -l / 2.0], [moment, moment, 0.0])
        };
        let hinge = |name: &str| Joint::new(name, JointKind::Continuous { axis: [0.0, -1.0, 0.0] });
        let builder = ModelBuilder::new("pendulum").gravity([0.0, 0.0, -g]);
        let Some(stiffness) = elbow else {
            let model = builder
                .body(Body::new("rod", rod(2.0, 2.0)))
                .joint(hinge("hinge"), "world", "rod")
                .build()?;
            let mut simulation = Simulation::new(&model, Vec::new(), 10.0)?;
            simulation.start.q[0] = 1.0;
            tolerance(&mut simulation, 1e-13);
            return Ok(simulation);
        };
        let at = phipsi_model::Placement::from_xyz_rpy([0.0, 0.0, -1.0], [0.0; 3]);
        let model = builder
            .body(Body::new("upper", rod(1.0, 1.0)))
            .body(Body::new("lower", rod(1.0, 1.0)))
            .joint(hinge("hinge"), "world", "upper")
            .joint(hinge("elbow").at(at), "upper", "lower")
            .build()?;
        let spring = JointSpring {
            name: "elbow".into(),
            coordinate: 1,
            dof: 1,
            stiffness,
            damping: 1e-3 * stiffness,
            rest: 0.0,
        };
        let forces: Vec<Box<dyn Force>> = vec![Box::new(spring)];
        let mut simulation = Simulation::new(&model, forces, 10.0)?;
        simulation.start.q[0] = 1.0;
        Ok(simulation)
    };
    // The elbow bends by the moment over its stiffness, 1e-11 rad: the two pendulums are as near as that.
    let error = move |s: &Summary| {
        let exact = pendulum(None, 9.81).ok().and_then(|mut p| run(&mut p, &mut Recording::default()).ok());
        exact.map_or(f64::NAN, |exact| (exact.q[0] - s.q[0]).abs())
    };
    let what = "a pendulum whose elbow is a spring of 1e12 N·m/rad and a damper of 1e9, for 10 s";
    scene("stiff-elbow", what, Truth::of(1.0, error), move |s| pendulum(Some(1e12), 9.81 * (1.0 + s)))
}

fn spins() -> Vec<Scene> {
    let mut all = Vec::new();
    // Jacobi's closed form at t = 100 s for (1, 2, 3) and (1e-3, 1, 1e-3); all rates by 1e4 is the same motion in a ten-thousandth
    // of the time.
    let known = [0.446_960_797_706_577_1, 0.894_554_104_184_593_4, 0.258_054_228_594_495];
    let truth = Truth { drift: 1e-7, ..Truth::of(1e4, move |s| apart(&s.v, &known.map(|w| 1e4 * w))) };
    let what = "a free body of moments 1, 2, 3 at 1e4 rad/s about the middle axis: two flips";
    all.push(scene("flips-1e4", what, Truth { kappa: Some(1e6), ..truth }, |s| {
        let model =
            single(JointKind::Spherical, Inertia::from_principal(1.0, [0.0; 3], [1.0, 2.0, 3.0]), 0.0)?;
        let mut simulation = Simulation::new(&model, Vec::new(), 0.01)?;
        simulation.start.v = [1e-3, 1.0, 1e-3].map(|w| 1e4 * w * (1.0 + s)).to_vec();
        tolerance(&mut simulation, 1e-13);
        Ok(simulation)
    }));
    for (name, axial) in [("needle-spin", 1e-6), ("disc-spin", 2.0)] {
        let rate = (1.0 - axial) * 1e4;
        let exact = move |t: f64| [1e4, (rate * t).cos(), -(rate * t).sin()];
        let truth = Truth::of(1.0, move |s| apart(&s.v, &exact(0.05)));
        let what = "a symmetric body at 1e4 rad/s about its axis and 1 rad/s across it: 80 turns";
        all.push(scene(name, what, Truth { kappa: Some(1e4), ..truth }, move |_| {
            let moments = [axial, 1.0, 1.0];
            let model = single(JointKind::Spherical, Inertia::from_principal(1.0, [0.0; 3], moments), 0.0)?;
            let mut simulation = Simulation::new(&model, Vec::new(), 0.05)?;
            simulation.start.v = vec![1e4, 1.0, 0.0];
            tolerance(&mut simulation, 1e-12);
            Ok(simulation)
        }));
    }
    let norm = |s: &Summary| (s.q.iter().map(|x| x * x).sum::<f64>().sqrt() - 1.0).abs();
    let truth = Truth { kappa: Some(1.0), line: Some(2.0 * f64::EPSILON), ..Truth::of(1.0, norm) };
    all.push(scene(
        "quaternion-1e5-steps",
        "length of a spinning body's quaternion after 1e5 steps",
        truth,
        |_| {
            let model =
                single(JointKind::Spherical, Inertia::from_principal(1.0, [0.0; 3], [1.0, 2.0, 3.0]), 0.0)?;
            let mut simulation = Simulation::new(&model, Vec::new(), 100.0)?;
            simulation.start.v = vec![0.3, 1.0, 0.2];
            simulation.choice = Choice::asked(Scheme::Explicit(Method::Rk4 { step: 1e-3 }));
            simulation.estimate = false;
            Ok(simulation)
        },
    ));
    // Momentum: soa.md 2.3, without compensation.
    let what = "a free flyer: nine rods on a base 1e9 times heavier, for 10 s";
    all.push(scene("free-flyer-1e9", what, Truth::conserved(1e-11), |_| {
        let mut chain = Chain { base: Base::Free, gravity: 0.0, ..Chain::uniform(10) };
        chain.masses[0] = 1e9;
        let model = chain.model()?;
        let state = chain.state(3, 0.5, 1.0);
        let mut simulation = Simulation::new(&model, Vec::new(), 10.0)?;
        (simulation.start.q, simulation.start.v) = (state.q, state.v);
        tolerance(&mut simulation, 1e-12);
        Ok(simulation)
    }));
    all
}

fn apart(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).fold(0.0, |m, (x, y)| m.max((x - y).abs()))
}

/// Arithmetic-geometric mean.
fn agm(mut a: f64, mut b: f64) -> f64 {
    for _ in 0..40 {
        (a, b) = ((a + b) / 2.0, (a * b).sqrt());
    }
    a
}

fn pendulums() -> Vec<Scene> {
    let mut all = Vec::new();
    for decade in [1, 2, 3, 6, 9] {
        let start = PI - 10f64.powi(-decade);
        // π less the start, to all digits: π is rounded.
        let delta = (PI - start) + 1.224_646_799_147_353_2e-16;
        let period = 2.0 * PI / 9.81f64.sqrt() / agm(1.0, (delta / 2.0).sin());
        let truth = Truth::of(PI, move |s| (s.q[0] - start).abs());
        // It goes over the top if its energy is off by its distance from it, δ²/2.
        let truth = Truth { kappa: Some(1.0 / (delta * delta)), ..truth };
        let what = "a pendulum released that far from the top, rad: back there after one period";
        all.push(scene(format!("separatrix-1e-{decade}"), what, truth, move |s| {
            let point = Inertia::from_principal(1.0, [0.0, 0.0, -1.0], [0.0; 3]);
            let model = single(JointKind::Continuous { axis: [0.0, -1.0, 0.0] }, point, 9.81 * (1.0 + s))?;
            let mut simulation = Simulation::new(&model, Vec::new(), period)?;
            simulation.start.q[0] = start;
            tolerance(&mut simulation, 1e-12);
            Ok(simulation)
        }));
    }
    // Quadrature: theta at t = 10 s.
    for (decade, theta) in [(6, -1.549_129_441_894_828_2), (9, -1.549_116_622_391_767_4)] {
        let truth = Truth::of(FRAC_PI_2, move |s: &Summary| (s.q[1] - theta).abs());
        let what = "a pole of 1 kg on a cart of that mass, kg: eleven turns of a millionth of a second";
        all.push(scene(format!("light-cart-1e-{decade}"), what, truth, move |s| {
            let cart = Inertia { mass: 10f64.powi(-decade), ..Inertia::ZERO };
            let pole = Inertia::from_principal(1.0, [0.0, 0.0, -1.0], [0.0; 3]);
            let model = ModelBuilder::new("cart")
                .gravity([0.0, 0.0, -9.81 * (1.0 + s)])
                .body(Body::new("cart", cart))
                .body(Body::new("pole", pole))
                .joint(Joint::new("rail", JointKind::Prismatic { axis: [1.0, 0.0, 0.0] }), "world", "cart")
                .joint(Joint::new("hinge", JointKind::Continuous { axis: [0.0, -1.0, 0.0] }), "cart", "pole")
                .build()?;
            let mut simulation = Simulation::new(&model, Vec::new(), 10.0)?;
            simulation.start.q[1] = FRAC_PI_2;
            tolerance(&mut simulation, 1e-13);
            Ok(simulation)
        }));
    }
    all
}

fn mechanisms() -> Vec<Scene> {
    // Closed form of two parallelograms released upright at 1 m/s: angle from upright at t = 10 s.
    let known = 31.750_597_186_986_102;
    let truth = Truth::of(known, move |s: &Summary| (FRAC_PI_2 - s.q[0] - known).abs());
    let what = "two parallelograms that turn through their singular line ten times";
    vec![scene("through-singular", what, truth, |s| {
        let linkage = Parallelograms { count: 2, angle: FRAC_PI_2, rate: -(1.0 + s), ..Default::default() };
        let model = linkage.model()?;
        let mut simulation = Simulation::new(&model, Vec::new(), 10.0)?;
        let [q, v] = linkage.state(&model);
        (simulation.start.q, simulation.start.v) = (q, v);
        tolerance(&mut simulation, 1e-12);
        Ok(simulation)
    })]
}

pub(super) fn scenes() -> Vec<Scene> {
    let mut all = springs();
    all.push(stiff_elbow());
    all.extend(spins());
    all.extend(pendulums());
    all.extend(mechanisms());
    all
}
