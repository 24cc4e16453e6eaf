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
use phipsi_closure::{ClosedDynamics, ClosedForm, ClosureError, ClosureMotion, Conditions, Prescribed};
use phipsi_model::Model;
use phipsi_recursion::DynamicsError;
use phipsi_spatial::{Dd, Wrench};

mod impulse;

/// The solver of a model with closures, prescribed motions, or both.
#[derive(Clone)]
pub(crate) struct Constraints {
    closed: ClosedDynamics<f64>,
    joints: Vec<PrescribedJoint>,
    /// Rows that move, among all rows.
    rows: Vec<(usize, Course)>,
    /// Degrees of freedom whose motion is given, and the same with those that stops and friction hold.
    given: Vec<bool>,
    active: Vec<bool>,
    held: bool,
    acceleration: Vec<f64>,
    /// γ, γ̇, γ̈.
    gamma: [Vec<f64>; 3],
    lambda: Vec<f64>,
    /// T with the actuators' forces.
    forces: Vec<f64>,
    rates: Vec<f64>,
    /// The same in double-double, near singular positions; none without closures.
    wide: Option<Box<Wide>>,
    /// The same mechanism without weight and stiffness, for impulses; none where nothing strikes.
    still: Option<Box<ClosedDynamics<f64>>>,
}

/// Below this pivot σ, over the scale of its loop, a state is near a singular position of the closures. There, rounding of q and
/// v that leaves the closures by ε makes accelerations of ε v²/σ², which error control would take for errors of the method.
const NEAR_SINGULAR: f64 = 0.05;

/// Relative error of a model's frames: a few roundings each.
const DATA_ERROR: f64 = 16.0 * f64::EPSILON;

/// A residual that rounding of given numbers explains, m or rad.
const ROUNDING: f64 = 1e-13;

/// Accelerations near singular positions: state projected and equations solved in double-double.
#[derive(Clone)]
struct Wide {
    closed: ClosedDynamics<Dd>,
    model: Model,
    q: Vec<Dd>,
    v: Vec<Dd>,
    tau: Vec<Dd>,
    out: Vec<Dd>,
    acceleration: Vec<Dd>,
    gamma: [Vec<Dd>; 3],
    wrenches: Vec<Wrench<Dd>>,
}

impl Wide {
    fn new(model: &Model) -> Result<Self, ClosureError> {
        let closed = ClosedDynamics::new(model)?.with_data_error(DATA_ERROR);
        let zeros = |n: usize| vec![Dd::from_f64(0.0); n];
        Ok(Wide {
            model: model.clone(),
            q: zeros(model.nq()),
            v: zeros(model.nv()),
            tau: zeros(model.nv()),
            out: zeros(model.nv()),
            acceleration: zeros(model.nv()),
            gamma: std::array::from_fn(|_| zeros(closed.rows())),
            wrenches: vec![Wrench::zero(); model.len()],
            closed,
        })
    }
    /// Accelerations on the closures next to the state; `out` stays as it is if there is no such place.
    fn run(
        &mut self,
        (q, v): (&[f64], &[f64]),
        tau: &[f64],
        conditions: &Conditions<'_, f64>,
        out: &mut [f64],
    ) {
        let lift =
            |to: &mut [Dd], from: &[f64]| to.iter_mut().zip(from).for_each(|(a, b)| *a = Dd::from_f64(*b));
        lift(&mut self.q, q);
        lift(&mut self.v, v);
        lift(&mut self.tau, tau);
        self.model.normalize(&mut self.q);
        if let Some(given) = &conditions.motion {
            let parts = [given.position, given.velocity, given.acceleration];
            self.gamma.iter_mut().zip(parts).for_each(|(to, from)| lift(to, from));
        }
        if let Some(given) = &conditions.prescribed {
            lift(&mut self.acceleration, given.acceleration);
        }
        for (to, from) in self.wrenches.iter_mut().zip(conditions.wrenches.unwrap_or_default()) {
            *to = Wrench::from_array(from.to_array().map(Dd::from_f64));
        }
        let [position, velocity, acceleration] = &self.gamma;
        let wide = Conditions {
            wrenches: conditions.wrenches.map(|_| &self.wrenches[..]),
            motion: conditions.motion.map(|_| ClosureMotion { position, velocity, acceleration }),
            prescribed: conditions
                .prescribed
                .map(|given| Prescribed { active: given.active, acceleration: &self.acceleration }),
        };
        let placed = match self.closed.project_position(&mut self.q, &wide) {
            // Redundant rows contradict the others by the rounding of the closures' frames: the others are closed.
            Err(ClosureError::NotClosed { residual, .. }) if residual <= ROUNDING => Ok(()),
            other => other.map(|_| ()),
        };
        let solved = placed
            .and_then(|_| self.closed.project_velocity(&self.q, &mut self.v, &wide))
            .and_then(|_| self.closed.run(&self.q, &self.v, &self.tau, &wide, &mut self.out).map(|_| ()));
        if solved.is_ok() {
            out.iter_mut().zip(&self.out).for_each(|(to, from)| *to = from.hi);
        }
    }
}

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
    /// For a model; `None` if it is a tree of which nothing is prescribed, unless it is `forced`.
    ///
    /// # Errors
    /// [`ClosureError`]: a coupling that cannot be; [`MotionError::Prescription`].
    pub(crate) fn new(
        model: &Model,
        prescription: &Prescription,
        forced: bool,
    ) -> Result<Option<Self>, MotionError> {
        let tree = model.closures().is_empty() && model.couplings().is_empty();
        if tree && prescription.is_empty() && !forced {
            return Ok(None);
        }
        Self::general(model, prescription).map(Some)
    }
    /// The same also for a tree of which nothing is prescribed: stops and friction may hold its joints.
    pub(crate) fn general(model: &Model, prescription: &Prescription) -> Result<Self, MotionError> {
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
        Ok(Constraints {
            closed,
            joints: prescription.joints.clone(),
            rows,
            given: active.clone(),
            active,
            held: false,
            acceleration: vec![0.0; nv],
            gamma: std::array::from_fn(|_| vec![0.0; n]),
            lambda: vec![0.0; n],
            forces: vec![0.0; nv],
            rates: vec![0.0; n],
            wide: if n > 0 { Some(Box::new(Wide::new(model)?)) } else { None },
            still: None,
        })
    }
    /// The same, solved in another form.
    ///
    /// # Errors
    /// As [`ClosedDynamics::with_form`].
    pub(crate) fn set_form(&mut self, form: ClosedForm) -> Result<(), ClosureError> {
        let all = std::iter::once(&mut self.closed).chain(self.still.as_deref_mut());
        for closed in all.filter(|closed| closed.form() != form) {
            *closed = closed.clone().with_form(form)?;
        }
        Ok(())
    }
    /// True if motions of joints or closures are given.
    pub(crate) fn is_prescribed(&self) -> bool {
        !(self.joints.is_empty() && self.rows.is_empty())
    }
    /// Degrees of freedom whose motion is given.
    pub(crate) fn given(&self) -> &[bool] {
        &self.given
    }
    /// Holds these degrees of freedom, besides those whose motion is given, at zero acceleration.
    pub(crate) fn hold_joints(&mut self, held: &[bool]) {
        self.held = false;
        for i in 0..self.active.len() {
            self.active[i] = self.given[i] || held[i];
            if held[i] && !self.given[i] {
                (self.acceleration[i], self.held) = (0.0, true);
            }
        }
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
            drives: self.held || !self.joints.is_empty(),
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
        let mut wide = self.wide.take();
        let (closed, held) = self.hold(t);
        let conditions = held.conditions(wrenches);
        let (mut done, mut pivot) = (0.0, f64::INFINITY);
        let mut solve = || {
            let mut solved = closed.run(q, v, tau, &conditions, v_dot)?;
            pivot = solved.info().smallest_pivot;
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
        if pivot < NEAR_SINGULAR
            && let Some(wide) = &mut wide
        {
            wide.run((q, v), tau, &conditions, v_dot);
        }
        (self.forces, self.lambda, self.wide) = (forces, lambda, wide);
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
        let (closed, held) = self.hold(t);
        if closed.rows() == 0 {
            return Ok(Projected::default());
        }
        let conditions = held.conditions(None);
        let moved = closed.project_position(q, &conditions)?;
        let turned = closed.project_velocity(q, v, &conditions)?;
        Ok(Projected {
            position: moved.residual[1],
            velocity: turned.residual[1],
            energy_removed: turned.energy_removed,
        })
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
