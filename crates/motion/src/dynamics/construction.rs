//! Making the equations of motion of a mechanism: with the plan that it needs, or a given one.

use super::form::forward;
use super::{Dynamics, MotionError, Solver};
use crate::constraints::Constraints;
use crate::force::Force;
use crate::plan::Plan;
use crate::prescription::Prescription;
use crate::switch::Switches;
use phipsi_closure::ClosedFormChoice;
use phipsi_model::Model;
use phipsi_recursion::layout::GROUND;
use phipsi_recursion::{InverseDynamics, Kinematics, Layout};
use phipsi_spatial::Wrench;

impl Dynamics {
    /// With the plan that the scene needs.
    ///
    /// # Errors
    /// [`MotionError::Closure`] for a coupling that cannot be.
    pub fn new(model: &Model, forces: Vec<Box<dyn Force>>) -> Result<Self, MotionError> {
        Self::prescribed(model, forces, &Prescription::default())
    }
    /// The same where motions of joints or closures are given as functions of time.
    ///
    /// # Errors
    /// As [`Dynamics::new`]; [`MotionError::Prescription`].
    pub fn prescribed(
        model: &Model,
        forces: Vec<Box<dyn Force>>,
        prescription: &Prescription,
    ) -> Result<Self, MotionError> {
        let plan = Plan::new(model, &forces).with_prescription(model, prescription);
        Self::planned(model, forces, plan, prescription)
    }
    /// With a given plan; [`Plan::everything`] is the general code.
    ///
    /// # Errors
    /// As [`Dynamics::prescribed`].
    pub fn with_plan(
        model: &Model,
        forces: Vec<Box<dyn Force>>,
        plan: Plan,
        prescription: &Prescription,
    ) -> Result<Self, MotionError> {
        Self::planned(model, forces, plan, prescription)
    }
    pub(super) fn planned(
        model: &Model,
        forces: Vec<Box<dyn Force>>,
        plan: Plan,
        prescription: &Prescription,
    ) -> Result<Self, MotionError> {
        let layout = Layout::new(&model.clone().without_closures());
        let mut names = Vec::new();
        if plan.work {
            names.push("work".to_string());
        }
        if plan.impulse {
            names.extend(["x", "y", "z"].map(|a| format!("angular impulse {a}")));
            names.extend(["x", "y", "z"].map(|a| format!("impulse {a}")));
        }
        let mut slots = vec![names.len()];
        for force in &forces {
            names.extend(force.auxiliary());
            slots.push(names.len());
        }
        let mut closed_choice = None;
        let (solver, form_choice) =
            match Constraints::new(model, prescription, plan.loops || plan.prescribed)? {
                Some(mut constraints) => {
                    let choice = ClosedFormChoice::new(model, plan.form)?;
                    constraints.set_form(choice.form)?;
                    closed_choice = Some(choice);
                    (Solver::Constrained(Box::new(constraints)), None)
                }
                None => {
                    let (forward, choice) = forward(model, &layout, plan.form);
                    (Solver::Tree(forward), choice)
                }
            };
        let moving = layout.carriers().iter().filter(|c| c.body != GROUND);
        Ok(Dynamics {
            moving_mass: moving.map(|c| c.inertia.mass).sum(),
            kinematics: Kinematics::new(&layout),
            solver,
            form_choice,
            closed_choice,
            given_breaks: prescription.breaks(),
            switches: Switches::new(model, Vec::new())?,
            holder: None,
            inverse: InverseDynamics::new(&layout),
            tangent: None,
            aux_dot: Vec::new(),
            rest: vec![0.0; model.nv()],
            tau: vec![0.0; model.nv()],
            wrenches: vec![Wrench::zero(); model.len()],
            model: model.clone(),
            layout,
            forces,
            plan,
            slots,
            names,
        })
    }
    /// Another one like this, for a second thread; `None` where a force has no copy ([`Force::another`]). Both give the same numbers
    /// to the last bit.
    pub fn another(&self) -> Option<Self> {
        let forces = self.forces.iter().map(|f| f.another()).collect::<Option<Vec<_>>>()?;
        Some(Dynamics {
            model: self.model.clone(),
            layout: self.layout.clone(),
            forces,
            plan: self.plan.clone(),
            slots: self.slots.clone(),
            names: self.names.clone(),
            kinematics: self.kinematics.clone(),
            solver: self.solver.clone(),
            form_choice: self.form_choice,
            closed_choice: self.closed_choice.clone(),
            inverse: self.inverse.clone(),
            rest: self.rest.clone(),
            tau: self.tau.clone(),
            wrenches: self.wrenches.clone(),
            moving_mass: self.moving_mass,
            tangent: None,
            aux_dot: self.aux_dot.clone(),
            given_breaks: self.given_breaks.clone(),
            switches: self.switches.clone(),
            holder: self.holder.clone(),
        })
    }
}
