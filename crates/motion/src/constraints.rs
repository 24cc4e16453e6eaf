//! Closures and prescribed motions in the equations of motion.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | 𝓜, C, J, λ | as in `phipsi_closure::closed_dynamics` | paper 2 §4.6 |
//! | γ | what the rows of closures are given: zero, or a function of time | |
//! | T_a | forces of the actuators of prescribed degrees of freedom | paper 2 (4.22) |
//! | W | their work and that of moving closures: Ẇ = T_a·v_a + λ·γ̇ | J v = γ̇ |

use crate::dynamics::MotionError;
use crate::prescription::{Course, PrescribedJoint, Prescription};
use crate::system::Projected;
use phipsi_closure::{ClosedDynamics, ClosureError, ClosureMotion, Conditions, Prescribed};
use phipsi_model::Model;
use phipsi_recursion::DynamicsError;
use phipsi_spatial::Wrench;

/// The solver of a model with closures, prescribed motions, or both.
pub(crate) struct Constraints {
    closed: ClosedDynamics<f64>,
    joints: Vec<PrescribedJoint>,
    /// Rows that move, among all rows.
    rows: Vec<(usize, Course)>,
    active: Vec<bool>,
    acceleration: Vec<f64>,
    /// γ, γ̇, γ̈.
    gamma: [Vec<f64>; 3],
    lambda: Vec<f64>,
    /// T with the actuators' forces.
    forces: Vec<f64>,
    rates: Vec<f64>,
    /// The smallest pivot since it was asked for.
    sharpest: f64,
}

/// Below this pivot, over the scale of its loop, a state counts as near a singular position.
const SINGULAR: f64 = 1e-2;

/// What the functions of time say at an instant.
struct Held<'a> {
    gamma: &'a [Vec<f64>; 3],
    active: &'a [bool],
    acceleration: &'a [f64],
    moves: bool,
    drives: bool,
}

impl<'a> Held<'a> {
    fn conditions(&self, wrenches: Option<&'a [Wrench<f64>]>) -> Conditions<'a, f64> {
        let [position, velocity, acceleration] = self.gamma;
        Conditions {
            wrenches,
            motion: self.moves.then_some(ClosureMotion { position, velocity, acceleration }),
            prescribed: self
                .drives
                .then_some(Prescribed { active: self.active, acceleration: self.acceleration }),
        }
    }
}

impl Constraints {
    /// For a model; `None` if it is a tree of which nothing is prescribed.
    ///
    /// # Errors
    /// [`ClosureError`]: bodies that are flexible, a coupling that cannot be; [`MotionError::Prescription`].
    pub(crate) fn new(model: &Model, prescription: &Prescription) -> Result<Option<Self>, MotionError> {
        if model.closures().is_empty() && model.couplings().is_empty() && prescription.is_empty() {
            return Ok(None);
        }
        let closed = ClosedDynamics::new(model)?;
        let (nv, n) = (model.nv(), closed.rows());
        let refuse = |what: String| Err(MotionError::Prescription { what });
        let mut active = vec![false; nv];
        for p in &prescription.joints {
            if p.dof >= nv || active[p.dof] {
                let what = if p.dof >= nv { "does not exist" } else { "is given twice" };
                return refuse(format!("the motion of degree of freedom {} {what}", p.dof));
            }
            if matches!(p.course, Course::Position { .. }) && p.coordinate.is_none_or(|c| c >= model.nq()) {
                return refuse(format!("degree of freedom {} has no coordinate to be given", p.dof));
            }
            active[p.dof] = true;
        }
        let mut rows = Vec::new();
        for p in &prescription.closures {
            let range = if p.closure < closed.closures() { closed.closure(p.closure).1 } else { 0..0 };
            let row = range.start + p.row;
            if !range.contains(&row) || rows.iter().any(|(r, _)| *r == row) {
                return refuse(format!(
                    "row {} of closure {} does not exist or is given twice",
                    p.row, p.closure
                ));
            }
            if !matches!(p.course, Course::Position { .. }) {
                return refuse(format!("closure {} moves by its position only", p.closure));
            }
            rows.push((row, p.course.clone()));
        }
        Ok(Some(Constraints {
            closed,
            joints: prescription.joints.clone(),
            rows,
            active,
            acceleration: vec![0.0; nv],
            gamma: std::array::from_fn(|_| vec![0.0; n]),
            lambda: vec![0.0; n],
            forces: vec![0.0; nv],
            rates: vec![0.0; n],
            sharpest: f64::INFINITY,
        }))
    }
    /// Degrees of freedom whose motion is given.
    pub(crate) fn active(&self) -> &[bool] {
        &self.active
    }
    /// Evaluates the functions of time.
    fn hold(&mut self, t: f64) -> (&mut ClosedDynamics<f64>, Held<'_>) {
        for p in &self.joints {
            self.acceleration[p.dof] = p.course.acceleration(t);
        }
        for (row, course) in &self.rows {
            self.gamma[0][*row] = course.position(t).unwrap_or_default();
            self.gamma[1][*row] = course.velocity(t).unwrap_or_default();
            self.gamma[2][*row] = course.acceleration(t);
        }
        let held = Held {
            gamma: &self.gamma,
            active: &self.active,
            acceleration: &self.acceleration,
            moves: !self.rows.is_empty(),
            drives: !self.joints.is_empty(),
        };
        (&mut self.closed, held)
    }
    /// Accelerations; returns the power of actuators and moving closures if it is asked for.
    pub(crate) fn run(
        &mut self,
        (t, q, v): (f64, &[f64], &[f64]),
        tau: &[f64],
        wrenches: Option<&[Wrench<f64>]>,
        power: bool,
        v_dot: &mut [f64],
    ) -> Result<f64, ClosureError> {
        let mut forces = std::mem::take(&mut self.forces);
        let mut lambda = std::mem::take(&mut self.lambda);
        let (closed, held) = self.hold(t);
        let conditions = held.conditions(wrenches);
        let (mut done, mut sharpest) = (0.0, f64::INFINITY);
        let mut solve = || {
            let mut solved = closed.run(q, v, tau, &conditions, v_dot)?;
            sharpest = solved.info().smallest_pivot;
            if power && held.moves {
                solved.closure_forces(&mut lambda)?;
                done += lambda.iter().zip(&held.gamma[1]).map(|(l, rate)| l * rate).sum::<f64>();
            }
            if power && held.drives {
                solved.generalized_forces(q, v, tau, v_dot, wrenches, &mut forces)?;
                let driven = (0..v.len()).filter(|&i| held.active[i]);
                done += driven.map(|i| (forces[i] - tau[i]) * v[i]).sum::<f64>();
            }
            Ok(done)
        };
        let result = solve();
        self.sharpest = self.sharpest.min(sharpest);
        (self.forces, self.lambda) = (forces, lambda);
        result
    }
    /// Puts prescribed coordinates where they are given, then the others onto the closures, with the least change in kinetic
    /// energy.
    pub(crate) fn project(
        &mut self,
        t: f64,
        q: &mut [f64],
        v: &mut [f64],
    ) -> Result<Projected, ClosureError> {
        self.follow(t, q, v);
        let (mut position_rows, mut rates) =
            (std::mem::take(&mut self.lambda), std::mem::take(&mut self.rates));
        let result = self.project_rows(t, (q, v), &mut position_rows, &mut rates);
        (self.lambda, self.rates) = (position_rows, rates);
        result
    }
    fn project_rows(
        &mut self,
        t: f64,
        (q, v): (&mut [f64], &mut [f64]),
        position_rows: &mut [f64],
        rates: &mut [f64],
    ) -> Result<Projected, ClosureError> {
        let (closed, held) = self.hold(t);
        if closed.rows() == 0 {
            return Ok(Projected::default());
        }
        let conditions = held.conditions(None);
        let moved = closed.project_position(q, &conditions)?;
        let position = moved.residual[1];
        // Near a singular position a projection of rounding would multiply it by 1/σ.
        let speed = v.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let rounding = 32.0 * f64::EPSILON * closed.length().max(1.0) * speed;
        closed.residual(q, Some(v), &conditions, position_rows, rates)?;
        let velocity = largest(rates);
        if velocity <= rounding {
            return Ok(Projected { position, velocity, energy_removed: 0.0 });
        }
        let turned = closed.project_velocity(q, v, &conditions)?;
        Ok(Projected { position, velocity: turned.residual[1], energy_removed: turned.energy_removed })
    }
    /// True if an evaluation since the last call was near a singular position.
    pub(crate) fn was_near_singular(&mut self) -> bool {
        std::mem::replace(&mut self.sharpest, f64::INFINITY) < SINGULAR
    }
    /// Puts prescribed coordinates where they are given.
    pub(crate) fn follow(&self, t: f64, q: &mut [f64], v: &mut [f64]) {
        for p in &self.joints {
            if let (Some(x), Some(i)) = (p.course.position(t), p.coordinate) {
                q[i] = x;
            }
            if let Some(x) = p.course.velocity(t) {
                v[p.dof] = x;
            }
        }
    }
    /// Largest residuals of the closures, m or rad, and of their rates.
    pub(crate) fn residual(&mut self, t: f64, q: &[f64], v: &[f64]) -> Result<[f64; 2], ClosureError> {
        let (mut position, mut velocity) =
            (std::mem::take(&mut self.lambda), std::mem::take(&mut self.rates));
        let (closed, held) = self.hold(t);
        let result = closed.residual(q, Some(v), &held.conditions(None), &mut position, &mut velocity);
        let largest = [largest(&position), largest(&velocity)];
        (self.lambda, self.rates) = (position, velocity);
        result.map(|()| largest)
    }
    /// Closes the loops from a rough guess; degrees of freedom with `kept` stay as they are, besides prescribed ones.
    pub(crate) fn assemble(
        &mut self,
        t: f64,
        (q, v): (&mut [f64], &mut [f64]),
        kept: [&[bool]; 2],
    ) -> Result<Projected, ClosureError> {
        for kept in kept {
            if kept.len() != self.active.len() {
                let (expected, found) = (self.active.len(), kept.len());
                return Err(DynamicsError::Shape { argument: "kept", expected, found }.into());
            }
        }
        self.follow(t, q, v);
        let [still, held_rates] = kept.map(|kept| {
            kept.iter().zip(&self.active).map(|(kept, active)| *kept || *active).collect::<Vec<bool>>()
        });
        let (closed, held) = self.hold(t);
        if closed.rows() == 0 {
            return Ok(Projected::default());
        }
        let mut conditions = held.conditions(None);
        conditions.prescribed = Some(Prescribed { active: &still, acceleration: held.acceleration });
        let moved = closed.assemble(q, &conditions)?;
        conditions.prescribed = Some(Prescribed { active: &held_rates, acceleration: held.acceleration });
        let turned = closed.project_velocity(q, v, &conditions)?;
        Ok(Projected {
            position: moved.residual[1],
            velocity: turned.residual[1],
            energy_removed: turned.energy_removed,
        })
    }
    /// Names of the closures, then of the joints that follow others, with the rows of each.
    pub(crate) fn loops(&self) -> Vec<(String, usize)> {
        let of = |i: usize| {
            let (name, rows) = self.closed.closure(i);
            (name.to_string(), rows.len())
        };
        (0..self.closed.closures()).map(of).collect()
    }
    /// Independent rows among all of them at a state.
    pub(crate) fn rank(&mut self, t: f64, q: &[f64], v: &[f64]) -> Result<usize, ClosureError> {
        let mut work = v.to_vec();
        let (closed, held) = self.hold(t);
        Ok(closed.project_velocity(q, &mut work, &held.conditions(None))?.rank)
    }
}

/// The largest magnitude; a number that is none stays.
fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0f64, |most, x| if x.is_nan() || most.is_nan() { f64::NAN } else { most.max(x.abs()) })
}
