//! L-BFGS on the increments of a model, with the kinetic metric as its first guess of the curvature.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | s, y | step and change of the gradient, each in the axes of its own configuration | Nocedal & Wright 7.2 |
//! | H₀ | γ M(q)⁻¹, γ = s·y / y·M⁻¹y: a torsion and a shift weigh by what they move; on closures their solution (`surface.rs`) | |
//! | α | step length by bisection to the weak Wolfe conditions | Nocedal & Wright 3.1 |
//!
//! On closures forces and directions are their parts along them, and trial configurations are put on them; a pair (s, y) is taken to
//! the next configuration as it is, and the direction that comes of it is projected.
//!
//! The method is here because libraries step on vectors: `liblbfgs` and `lbfgs` take slices, `argmin` parameters with
//! addition, and none takes a metric.

use crate::surface::Surface;
use phipsi_closure::ClosureError;
use phipsi_model::Model;
use phipsi_motion::Conservative;
use phipsi_recursion::{DynamicsError, Layout};
use std::collections::VecDeque;

/// Pairs (s, y) that are kept.
const MEMORY: usize = 10;
/// Wolfe's two constants: decrease, and slope that must be left.
const DECREASE: f64 = 1e-4;
const SLOPE: f64 = 0.9;
/// Bisections of one line search.
const MOST_TRIALS: usize = 40;

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MinimizeOptions {
    /// Largest generalised force at the end: kJ/mol/rad, and kJ/mol/nm for bases.
    pub largest_force: f64,
    /// Most evaluations of the potential.
    pub evaluations: usize,
    /// Longest step: root mean square displacement by mass, nm.
    pub longest_step: f64,
}

impl Default for MinimizeOptions {
    /// 0.01 kJ/mol/rad (kJ/mol/nm), 10 000 evaluations, 0.02 nm.
    fn default() -> Self {
        MinimizeOptions { largest_force: 0.01, evaluations: 10_000, longest_step: 0.02 }
    }
}

/// Where a minimisation ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Minimum {
    /// The configuration.
    pub q: Vec<f64>,
    /// Its potential energy.
    pub energy: f64,
    /// Its largest generalised force.
    pub largest_force: f64,
    /// The joint with that force.
    pub joint: String,
    /// Evaluations of the potential.
    pub evaluations: usize,
    /// The largest generalised force is as small as was asked for.
    pub converged: bool,
}

/// A pair of the memory.
struct Pair {
    s: Vec<f64>,
    y: Vec<f64>,
    /// 1/(s·y).
    inverse: f64,
}

/// A configuration of a line search with its forces.
#[derive(Clone)]
struct Trial {
    q: Vec<f64>,
    forces: Vec<f64>,
}

/// Minimises a potential of a model's configuration, on its closures where it has any. `layout`: of the model without closures.
///
/// Ends without convergence where no step lowers the energy any more, at its rounding, or when the evaluations are used up.
///
/// # Errors
/// Of the potential at the start (a trial step without a value is shortened), of the mass matrix, and closures that are not closed
/// near the start.
pub fn lbfgs<C: Conservative>(
    model: &Model,
    layout: &Layout<f64>,
    system: &mut C,
    q: &[f64],
    options: &MinimizeOptions,
) -> Result<Minimum, C::Error>
where
    C::Error: From<DynamicsError> + From<ClosureError>,
{
    let nv = model.nv();
    let mut q = q.to_vec();
    let mut surface = Surface::new(model, layout, &mut q)?;
    let mass = model.total_mass();
    let mut forces = vec![0.0; nv];
    let mut energy = system.evaluate(&q, &mut forces)?;
    surface.along(&q, &mut forces)?;
    let mut evaluations = 1;
    let mut memory: VecDeque<Pair> = VecDeque::with_capacity(MEMORY);
    let mut trial = Trial { q: q.clone(), forces: forces.clone() };
    let mut best = trial.clone();
    let (mut step, mut best_step) = (vec![0.0; nv], vec![0.0; nv]);
    while largest(&forces).1 > options.largest_force && evaluations < options.evaluations {
        surface.place(&q)?;
        let mut direction = forces.clone();
        apply(&memory, &mut direction, |x| surface.solve(x));
        let mut square = surface.tangent(&q, &mut direction);
        let mut slope = -dot(&direction, &forces);
        if !(slope < 0.0 && slope.is_finite()) {
            memory.clear();
            direction.copy_from_slice(&forces);
            surface.solve(&mut direction);
            square = surface.tangent(&q, &mut direction);
            slope = -dot(&direction, &forces);
        }
        let displacement = (square / mass).sqrt();
        let longest = options.longest_step / displacement;
        let mut alpha = if memory.is_empty() { 0.1 * longest } else { longest.min(1.0) };
        let (mut low, mut high) = (0.0, f64::INFINITY);
        // An energy rounds by more than its own ε: its terms cancel.
        let noise = 1e3 * f64::EPSILON * (1.0 + energy.abs());
        let mut lower = None;
        for _ in 0..MOST_TRIALS {
            step.iter_mut().zip(&direction).for_each(|(s, d)| *s = alpha * d);
            evaluations += 1;
            let value = match surface.retract(&q, &step, &mut trial.q) {
                true => system.evaluate(&trial.q, &mut trial.forces).ok().filter(|e| e.is_finite()),
                false => None,
            };
            if value.is_some() {
                surface.along(&trial.q, &mut trial.forces)?;
            }
            match value {
                Some(e) if e <= energy + DECREASE * alpha * slope + noise => {
                    lower = Some(e);
                    let slope_there = -dot(&direction, &trial.forces);
                    std::mem::swap(&mut trial, &mut best);
                    best_step.copy_from_slice(&step);
                    if slope_there >= SLOPE * slope || alpha >= longest {
                        break;
                    }
                    low = alpha;
                }
                _ => high = alpha,
            }
            if evaluations >= options.evaluations {
                break;
            }
            alpha = if high.is_finite() { 0.5 * (low + high) } else { (2.0 * alpha).min(longest) };
        }
        let Some(lower) = lower else {
            if memory.is_empty() {
                break;
            }
            memory.clear();
            continue;
        };
        let y: Vec<f64> = forces.iter().zip(&best.forces).map(|(old, new)| old - new).collect();
        let product = dot(&best_step, &y);
        if product > f64::EPSILON * (dot(&best_step, &best_step) * dot(&y, &y)).sqrt() {
            if memory.len() == MEMORY {
                memory.pop_front();
            }
            memory.push_back(Pair { s: best_step.clone(), y, inverse: 1.0 / product });
        }
        energy = lower;
        std::mem::swap(&mut q, &mut best.q);
        std::mem::swap(&mut forces, &mut best.forces);
    }
    let (worst, size) = largest(&forces);
    let joint = if nv == 0 { String::new() } else { layout.joint_of_velocity(worst).0.to_string() };
    Ok(Minimum {
        q,
        energy,
        largest_force: size,
        joint,
        evaluations,
        converged: size <= options.largest_force,
    })
}

/// x ← H x by the two loops over the memory, with H₀ = γ M⁻¹.
fn apply(memory: &VecDeque<Pair>, x: &mut [f64], mut solve: impl FnMut(&mut [f64])) {
    let mut weights = Vec::with_capacity(memory.len());
    for pair in memory.iter().rev() {
        let a = pair.inverse * dot(&pair.s, x);
        x.iter_mut().zip(&pair.y).for_each(|(x, y)| *x -= a * y);
        weights.push(a);
    }
    solve(x);
    if let Some(last) = memory.back() {
        let mut z = last.y.clone();
        solve(&mut z);
        let gamma = 1.0 / (last.inverse * dot(&last.y, &z));
        x.iter_mut().for_each(|x| *x *= gamma);
    }
    for (pair, a) in memory.iter().zip(weights.into_iter().rev()) {
        let b = pair.inverse * dot(&pair.y, x);
        x.iter_mut().zip(&pair.s).for_each(|(x, s)| *x += (a - b) * s);
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The largest component in size, and which it is.
fn largest(x: &[f64]) -> (usize, f64) {
    x.iter().enumerate().fold((0, 0.0), |m, (i, x)| if x.abs() > m.1 { (i, x.abs()) } else { m })
}
