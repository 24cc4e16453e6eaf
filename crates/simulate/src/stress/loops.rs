//! Closed loops: near singular positions, redundant and contradictory rows, far and small places, unequal masses.
//!
//! Parallelograms in a row, in the x-z plane: cranks on the ground, a coupler between each two, closed by hinges. They are singular
//! where all rods lie in one line: at the angle zero.

use super::page::number;
use super::sensitivity::{STEP, largest};
use super::{Measured, Outcome, Scene, timed};
use phipsi_closure::{ClosedDynamics, ClosureMotion, Conditions};
use phipsi_model::{
    Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, ModelErrors, Placement,
    Random,
};
use phipsi_recursion::{InverseDynamics, Layout};
use phipsi_spatial::Dd;
use std::f64::consts::FRAC_PI_2;

const FAMILY: &str = "loops";

/// The budget: 4 n ε κ.
const FORWARD: f64 = 4.0;

/// Relative error of a model's frames, which the closures of double-double numbers must not resolve.
const DATA_ERROR: f64 = 16.0 * f64::EPSILON;

/// Parallelograms in a row.
#[derive(Clone, Debug)]
pub(super) struct Parallelograms {
    /// How many.
    pub count: usize,
    /// Length of every rod, m.
    pub length: f64,
    /// Of cranks and couplers, kg.
    pub masses: [f64; 2],
    /// Place of the first crank, m.
    pub offset: f64,
    /// How often each hinge is closed.
    pub closed: usize,
    /// What the closures keep.
    pub kind: ClosureKind,
    /// Angle of the cranks from the line of the ground, rad.
    pub angle: f64,
    /// Rate of the cranks, rad/s.
    pub rate: f64,
    /// Weight along −z, m/s².
    pub gravity: f64,
}

impl Default for Parallelograms {
    fn default() -> Self {
        Parallelograms {
            count: 1,
            length: 1.0,
            masses: [1.0; 2],
            offset: 0.0,
            closed: 1,
            kind: ClosureKind::Revolute,
            angle: 0.5,
            rate: 1.0,
            gravity: 9.81,
        }
    }
}

impl Parallelograms {
    /// The model: the cranks first, rods along x of their frames.
    pub fn model(&self) -> Result<Model, ModelErrors> {
        let l = self.length;
        let rod = |name: String, mass: f64| {
            let moment = mass * l * l / 12.0;
            Body::new(name, Inertia::from_principal(mass, [l / 2.0, 0.0, 0.0], [0.0, moment, moment]))
        };
        let at = |x: f64| Placement::from_xyz_rpy([x, 0.0, 0.0], [0.0; 3]);
        // Angles count from x towards z.
        let hinge = |name: String, x: f64| {
            Joint::new(name, JointKind::Continuous { axis: [0.0, -1.0, 0.0] }).at(at(x))
        };
        let mut builder = ModelBuilder::new("parallelograms").gravity([0.0, 0.0, -self.gravity]);
        for i in 0..=self.count {
            builder = builder.body(rod(format!("crank{i}"), self.masses[0])).joint(
                hinge(format!("a{i}"), self.offset + l * i as f64),
                "world",
                format!("crank{i}"),
            );
        }
        let pose = Placement::from_xyz_rpy([l, 0.0, 0.0], [FRAC_PI_2, 0.0, 0.0]);
        for i in 0..self.count {
            let coupler = format!("coupler{i}");
            builder = builder.body(rod(coupler.clone(), self.masses[1])).joint(
                hinge(format!("b{i}"), l),
                format!("crank{i}"),
                coupler.clone(),
            );
            for copy in 0..self.closed {
                builder = builder.closure(Closure {
                    name: format!("pin{i}{}", "'".repeat(copy)),
                    kind: self.kind,
                    body_a: coupler.clone(),
                    pose_a: pose,
                    body_b: format!("crank{}", i + 1),
                    pose_b: pose,
                });
            }
        }
        builder.build()
    }
    /// q and v on the closures.
    pub fn state(&self, model: &Model) -> [Vec<f64>; 2] {
        let mut state = [vec![0.0; model.nq()], vec![0.0; model.nv()]];
        for (k, joint) in model.joints().iter().enumerate() {
            let sign = if joint.name.starts_with('a') { 1.0 } else { -1.0 };
            state[0][model.q_offset(k)] = sign * self.angle;
            state[1][model.v_offset(k)] = sign * self.rate;
        }
        state
    }
    /// The same with masses and weight changed at random.
    fn changed(&self, random: &mut Random) -> Self {
        let mut change = |x: f64| x * (1.0 + STEP * random.signed());
        Parallelograms { masses: self.masses.map(&mut change), gravity: change(self.gravity), ..self.clone() }
    }
}

fn widened(x: &[f64]) -> Vec<Dd> {
    x.iter().map(|&x| Dd::from_f64(x)).collect()
}

/// Accelerations in double-double numbers, and σ; with rates that are `changed` each for itself, as rounding does.
fn truth(scene: &Parallelograms, changed: Option<&mut Random>) -> Option<(Vec<Dd>, f64)> {
    let model = scene.model().ok()?;
    let [q, mut v] = scene.state(&model);
    if let Some(random) = changed {
        v.iter_mut().for_each(|v| *v *= 1.0 + STEP * random.signed());
    }
    let [q, v] = [q, v].map(|x| widened(&x));
    let mut closed = ClosedDynamics::<Dd>::new(&model).ok()?.with_data_error(DATA_ERROR);
    let zero = widened(&vec![0.0; model.nv()]);
    let mut out = zero.clone();
    let sigma = closed.run(&q, &v, &zero, &Conditions::default(), &mut out).ok()?.info().smallest_pivot;
    Some((out, sigma))
}

/// Accelerations of the scene, and their errors. `contradicts`: the first closure is given an acceleration across the plane.
fn judge(scene: &Parallelograms, contradicts: bool) -> Measured {
    let model = match scene.model() {
        Ok(model) => model,
        Err(e) => return Measured::refused(e),
    };
    let [q, v] = scene.state(&model);
    let mut closed = match ClosedDynamics::<f64>::new(&model) {
        Ok(closed) => closed,
        Err(e) => return Measured::refused(e),
    };
    let (zero, mut a, mut pulled) = (vec![0.0; model.nv()], vec![0.0; model.nv()], vec![0.0; model.nv()]);
    let rows = closed.rows();
    let (still, mut given) = (vec![0.0; rows], vec![0.0; rows]);
    // The last row of the first hinge is the offset along its axis.
    given[4.min(rows - 1)] = 1.0;
    let motion = ClosureMotion { position: &still, velocity: &still, acceleration: &given };
    let conditions = Conditions { motion: contradicts.then_some(motion), ..Default::default() };
    let (done, wall_s) = timed(|| {
        let solved = closed.run(&q, &v, &zero, &conditions, &mut a)?;
        solved.generalized_constraint_force(&mut pulled)?;
        Ok::<_, phipsi_closure::ClosureError>(solved.info())
    });
    let info = match done {
        Ok(info) => info,
        Err(e) => return Measured { wall_s, ..Measured::refused(e) },
    };
    if a.iter().any(|x| !x.is_finite()) {
        return Measured { wall_s, ..Measured::wrong("an acceleration is not finite, and no error said so") };
    }
    let n = model.len() as f64;
    let (mut error, mut sensitivity) = (None, None);
    if let (Some((exact, sigma)), false) = (truth(scene, None), contradicts) {
        let scale = largest(&exact);
        let off = a.iter().zip(&exact).fold(0.0f64, |m, (x, y)| m.max((Dd::from_f64(*x) - *y).hi.abs()));
        error = Some(off / scale);
        let mut kappa = (1.0 / sigma).max(1.0);
        for seed in 0..4 {
            let mut random = Random::new(seed);
            let other = scene.changed(&mut random);
            if let Some((other, _)) = truth(&other, Some(&mut random)) {
                let moved = other.iter().zip(&exact).fold(0.0f64, |m, (x, y)| m.max((*x - *y).hi.abs()));
                kappa = kappa.max(moved / (STEP * scale));
            }
        }
        sensitivity = Some(kappa);
    }
    let backward = backward_error(&model, (&q, &v), &a, &pulled);
    // A result without a digit is never right, whatever explains it.
    let explained = (FORWARD * n * f64::EPSILON * sensitivity.unwrap_or(1.0)).min(0.1);
    let allowed = 100.0 * n * f64::EPSILON;
    let mut message = format!("{} of {} rows, σ {:.0e}", info.rank, info.rows, info.smallest_pivot);
    let good = error.is_some_and(|e| e <= explained) && backward.is_none_or(|b| b <= allowed);
    let outcome = if let Some(found) = &info.inconsistency {
        message = format!("told: a row that the others imply contradicts them ({found:?})");
        Outcome::Warned
    } else if good {
        Outcome::Right
    } else if info.near_singular && error.is_none_or(|e| e <= 10.0 * info.error_estimate) {
        message = format!("{message}: near singular, an error up to {:.0e} is told", info.error_estimate);
        Outcome::Warned
    } else {
        message = format!(
            "{message}; error {} where {explained:.0e} is required, backward {}",
            number(error),
            number(backward)
        );
        Outcome::Wrong
    };
    Measured { error, kappa: sensitivity, backward, drift: None, steps: None, wall_s, outcome, message }
}

/// The largest |J*λ − inverse dynamics(a)| over the largest |J*λ| + |bias| + |𝓜a|, in double-double numbers. Not by components:
/// the forces of pins on a light rod cancel, and the rod's own terms say nothing of their size.
fn backward_error(model: &Model, (q, v): (&[f64], &[f64]), a: &[f64], pulled: &[f64]) -> Option<f64> {
    let layout = Layout::<Dd>::new(&model.clone().without_closures());
    let [q, v, a, pulled] = [q, v, a, pulled].map(widened);
    let mut inverse = InverseDynamics::new(&layout);
    let (mut back, mut bias) = (a.clone(), a.clone());
    inverse.run(&layout, &q, &v, &a, None, &mut back).ok()?;
    inverse.run(&layout, &q, &v, &widened(&vec![0.0; a.len()]), None, &mut bias).ok()?;
    let off = (0..a.len()).map(|i| (back[i] - pulled[i]).hi.abs()).fold(0.0, f64::max);
    let terms = |i: usize| pulled[i].hi.abs() + bias[i].hi.abs() + (back[i] - bias[i]).hi.abs();
    Some(if off == 0.0 { 0.0 } else { off / (0..a.len()).map(terms).fold(0.0, f64::max) })
}

fn scene(name: impl Into<String>, what: &str, scene: Parallelograms) -> Scene {
    Scene::new(FAMILY, name, what, move || judge(&scene, false))
}

pub(super) fn scenes() -> Vec<Scene> {
    let base = Parallelograms::default;
    let mut all = Vec::new();
    for decade in [2, 4, 6, 8, 12] {
        let near = Parallelograms { angle: 10f64.powi(-decade), ..base() };
        let what = "a parallelogram that far from the line in which it is singular, rad";
        all.push(scene(format!("singular-1e-{decade}"), what, near));
    }
    all.push(scene(
        "singular",
        "a parallelogram in one line: it has two freedoms",
        Parallelograms { angle: 0.0, ..base() },
    ));
    let many = Parallelograms { count: 100, angle: 1e-4, ..base() };
    all.push(scene("singular-100", "a hundred parallelograms 1e-4 rad from their line", many));
    all.push(scene("redundant-3", "a hinge closed three times", Parallelograms { closed: 3, ..base() }));
    let doubled = Parallelograms { closed: 2, angle: 1e-6, ..base() };
    all.push(scene("redundant-singular", "a hinge closed twice, 1e-6 rad from singular", doubled));
    let pair = Parallelograms { count: 100, closed: 2, ..base() };
    all.push(scene("redundant-100", "a hundred parallelograms, each closed twice", pair));
    let ball = Parallelograms { kind: ClosureKind::Spherical, ..base() };
    all.push(scene("ball", "a parallelogram closed by a ball: one row is implied", ball));
    all.push(Scene::new(
        FAMILY,
        "contradictory",
        "a row that the others imply is given another acceleration",
        || judge(&Parallelograms::default(), true),
    ));
    for (name, masses) in [("cranks", [1.0, 1e-12]), ("coupler", [1e-12, 1.0])] {
        let uneven = Parallelograms { masses, ..base() };
        all.push(scene(format!("heavy-{name}"), "the other rods are 1e12 times lighter", uneven));
    }
    for decade in [-6, 6] {
        let sized = Parallelograms { length: 10f64.powi(decade), ..base() };
        all.push(scene(format!("loop-size-1e{decade}"), "a parallelogram of rods of that length, m", sized));
    }
    for decade in [4, 8] {
        let far = Parallelograms { offset: 10f64.powi(decade), ..base() };
        all.push(scene(format!("loop-far-1e{decade}"), "a parallelogram that far from the origin, m", far));
    }
    let fast = Parallelograms { rate: 1e4, ..base() };
    all.push(scene("loop-rate-1e4", "cranks at 1e4 rad/s", fast));
    all
}
