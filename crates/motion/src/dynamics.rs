//! The equations of motion of a mechanism under its forces, as a [`System`] for the integrators.
//!
//! Auxiliary slots, in this order: the work of non-conservative forces (if the plan integrates it), the impulse of external
//! forces (angular about the centre of mass, linear; world axes), then each force's own.

use crate::constraints::Constraints;
use crate::event::Events;
use crate::force::Force;
use crate::plan::Plan;
use crate::switch::Switches;
use crate::system::{Linearization, Projected, System, differences};
use phipsi_closure::ClosedFormChoice;
use phipsi_model::Model;
use phipsi_recursion::{FormChoice, FormForwardDynamics, InverseDynamics, Kinematics, Layout};
use phipsi_spatial::Wrench;

mod conservative;
mod construction;
mod error;
mod form;
mod linearization;
mod loads;
mod switching;

pub use error::MotionError;
use linearization::Tangent;

/// A mechanism with its forces.
pub struct Dynamics {
    model: Model,
    layout: Layout<f64>,
    forces: Vec<Box<dyn Force>>,
    plan: Plan,
    /// First auxiliary slot of each force.
    slots: Vec<usize>,
    names: Vec<String>,
    kinematics: Kinematics<f64>,
    solver: Solver,
    form_choice: Option<FormChoice>,
    closed_choice: Option<ClosedFormChoice>,
    inverse: InverseDynamics<f64>,
    rest: Vec<f64>,
    tau: Vec<f64>,
    wrenches: Vec<Wrench<f64>>,
    moving_mass: f64,
    tangent: Option<Tangent>,
    aux_dot: Vec<f64>,
    /// Times at which given motions are not smooth.
    given_breaks: Vec<f64>,
    switches: Switches,
    /// Holds joints of a tree.
    holder: Option<Box<Constraints>>,
}

/// What gives the accelerations.
#[derive(Clone)]
enum Solver {
    /// A tree of passive joints.
    Tree(FormForwardDynamics),
    /// Loops, prescribed motions, or both.
    Constrained(Box<Constraints>),
}

impl Dynamics {
    /// What is computed.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }
    /// True if the model has loops or prescribed motions.
    pub fn is_constrained(&self) -> bool {
        matches!(self.solver, Solver::Constrained(_))
    }
    /// True if motions of joints or closures are given.
    pub fn is_prescribed(&self) -> bool {
        matches!(&self.solver, Solver::Constrained(c) if c.is_prescribed())
    }
    /// Degrees of freedom whose motion is given.
    pub fn active(&self) -> Vec<bool> {
        match &self.solver {
            Solver::Tree(_) => vec![false; self.model.nv()],
            Solver::Constrained(c) => c.given().to_vec(),
        }
    }
    /// Closures and couplings (by their following joint), with the number of rows of each.
    pub fn loops(&self) -> Vec<(String, usize)> {
        match &self.solver {
            Solver::Tree(_) => Vec::new(),
            Solver::Constrained(c) => c.loops(),
        }
    }
    /// Number of independent rows of all closures at a state.
    ///
    /// # Errors
    /// [`MotionError`].
    pub fn rank(&mut self, t: f64, q: &[f64], v: &[f64]) -> Result<usize, MotionError> {
        match &mut self.solver {
            Solver::Tree(_) => Ok(0),
            Solver::Constrained(c) => Ok(c.rank(t, q, v)?),
        }
    }
    /// Largest residuals of closures: positions (m, rad) and velocities; `None` without closures.
    ///
    /// # Errors
    /// [`MotionError`].
    pub fn closure_residual(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
    ) -> Result<Option<[f64; 2]>, MotionError> {
        match &mut self.solver {
            Solver::Constrained(c) if self.plan.loops => Ok(Some(c.residual(t, q, v)?)),
            _ => Ok(None),
        }
    }
    /// Puts coordinates whose motion is given where they are at time t.
    pub fn follow(&self, t: f64, q: &mut [f64], v: &mut [f64]) {
        if let Solver::Constrained(c) = &self.solver {
            c.follow(t, q, v);
        }
    }
    /// Closes the loops from a rough guess, then makes the velocities consistent. Degrees of freedom (nv) that are `kept` stay:
    /// the first ones in position, the second in velocity.
    ///
    /// # Errors
    /// [`MotionError::Closure`] if the loops cannot be closed from here.
    pub fn assemble(
        &mut self,
        t: f64,
        q: &mut [f64],
        v: &mut [f64],
        kept: [&[bool]; 2],
    ) -> Result<Projected, MotionError> {
        match &mut self.solver {
            Solver::Tree(_) => Ok(Projected::default()),
            Solver::Constrained(c) => Ok(c.assemble(t, (q, v), kept)?),
        }
    }
    /// The compiled model.
    pub fn layout(&self) -> &Layout<f64> {
        &self.layout
    }
    /// The forces.
    pub fn forces(&self) -> &[Box<dyn Force>] {
        &self.forces
    }
    /// Names of the auxiliary slots.
    pub fn auxiliary_names(&self) -> &[String] {
        &self.names
    }
    /// The integrated work, if the plan has it.
    pub fn work(&self, auxiliary: &[f64]) -> f64 {
        if self.plan.work { auxiliary[0] } else { 0.0 }
    }
    /// The integrated impulse of external forces, if the plan has it.
    pub fn impulse(&self, auxiliary: &[f64]) -> Wrench<f64> {
        if self.plan.impulse {
            let first = usize::from(self.plan.work);
            Wrench::from_array(std::array::from_fn(|i| auxiliary[first + i]))
        } else {
            Wrench::zero()
        }
    }
    /// For a method without auxiliary quantities (midpoint): no integrals of work and impulse. Momentum is then balanced only
    /// where no external force changes it.
    pub fn leave_out_integrals(&mut self) {
        self.plan.momentum &= !self.plan.impulse;
        (self.plan.work, self.plan.impulse) = (false, false);
        self.names.clear();
        self.tangent = None;
        self.slots = vec![0];
        for force in &self.forces {
            self.names.extend(force.auxiliary());
            self.slots.push(self.names.len());
        }
    }
    /// Times at which a force is not smooth, sorted, without repetition.
    pub fn breaks(&self) -> Vec<f64> {
        let mut breaks: Vec<f64> = self.forces.iter().flat_map(|f| f.breaks()).collect();
        breaks.extend(&self.given_breaks);
        breaks.sort_by(f64::total_cmp);
        breaks.dedup();
        breaks
    }
}

impl System for Dynamics {
    type Error = MotionError;

    fn model(&self) -> &Model {
        &self.model
    }

    fn auxiliary_len(&self) -> usize {
        self.names.len()
    }

    fn derivative(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
        v_dot: &mut [f64],
        aux_dot: &mut [f64],
    ) -> Result<(), MotionError> {
        self.collect(t, (q, v, aux), aux_dot)?;
        let wrenches = self.plan.wrenches.then_some(&self.wrenches[..]);
        let holder = self.holder.as_mut().filter(|_| self.switches.any_held);
        match (&mut self.solver, holder) {
            (Solver::Tree(forward), None) => {
                forward.run(&self.layout, q, v, &self.tau, wrenches, v_dot)?;
            }
            (Solver::Constrained(c), _) | (Solver::Tree(_), Some(c)) => {
                let wants_power = self.plan.work && self.plan.prescribed;
                let power = c.run((t, q, v), &self.tau, wrenches, wants_power, v_dot)?;
                if wants_power {
                    aux_dot[0] += power;
                }
            }
        }
        Ok(())
    }

    fn project(&mut self, t: f64, q: &mut [f64], v: &mut [f64]) -> Result<Option<Projected>, MotionError> {
        match &mut self.solver {
            Solver::Tree(_) => Ok(None),
            Solver::Constrained(c) => Ok(Some(c.project(t, q, v)?)),
        }
    }

    fn events(&mut self) -> Option<&mut dyn Events<Error = MotionError>> {
        if self.functions() > 0 { Some(self) } else { None }
    }

    fn is_autonomous(&self) -> bool {
        matches!(self.solver, Solver::Tree(_)) && self.forces.iter().all(|f| f.is_autonomous())
    }

    fn linearize(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
        out: &mut Linearization,
    ) -> Result<u64, MotionError> {
        let loops = matches!(self.solver, Solver::Constrained(_)) || self.switches.any_held;
        if loops || !self.analytic(t, (q, v, aux), out)? {
            return differences(self, t, (q, v, aux), out);
        }
        if !aux.is_empty() {
            self.auxiliary_rates(t, (q, v, aux), out)?;
        }
        Ok(0)
    }
}
