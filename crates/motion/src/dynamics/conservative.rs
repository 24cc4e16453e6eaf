//! Weight and conservative forces, for the midpoint method: those that change fast, with the weight, and those that change slowly.

use super::{Dynamics, MotionError};
use crate::conservative::{Conservative, Part};
use crate::force::{Loads, Situation};
use phipsi_recursion::potential_energy;
use phipsi_spatial::Wrench;

impl Conservative for Dynamics {
    type Error = MotionError;

    fn evaluate(&mut self, q: &[f64], out: &mut [f64]) -> Result<f64, MotionError> {
        self.check_conservative()?;
        self.evaluate_part(Part::Fast, q, out)
    }
    fn has_slow(&self) -> bool {
        self.forces.iter().any(|f| f.is_slow())
    }
    fn evaluate_slow(&mut self, q: &[f64], out: &mut [f64]) -> Result<f64, MotionError> {
        self.check_conservative()?;
        self.evaluate_part(Part::Slow, q, out)
    }
}

impl Dynamics {
    fn check_conservative(&self) -> Result<(), MotionError> {
        if self.is_prescribed() {
            return Err(MotionError::Driven);
        }
        if self.is_switching() {
            let what = "the midpoint method knows no stops, dry friction and events that change the state; \
                        use \"dop853\" or \"tsit5\"";
            return Err(MotionError::Switch { what: what.into() });
        }
        match self.forces.iter().find(|f| !f.needs().conservative || !f.auxiliary().is_empty()) {
            Some(force) => Err(MotionError::NotConservative { force: force.name().into() }),
            None => Ok(()),
        }
    }

    fn evaluate_part(&mut self, part: Part, q: &[f64], out: &mut [f64]) -> Result<f64, MotionError> {
        let rest = std::mem::take(&mut self.rest);
        let result = self.evaluate_at(part, q, &rest, out);
        self.rest = rest;
        result
    }

    fn evaluate_at(
        &mut self,
        part: Part,
        q: &[f64],
        rest: &[f64],
        out: &mut [f64],
    ) -> Result<f64, MotionError> {
        self.tau.iter_mut().for_each(|x| *x = 0.0);
        self.wrenches.iter_mut().for_each(|w| *w = Wrench::zero());
        self.place(q, rest)?;
        let (model, layout, kinematics) = (&self.model, &self.layout, Some(&self.kinematics));
        let at = Situation { model, layout, t: 0.0, q, v: rest, kinematics };
        let mut loads = Loads { tau: &mut self.tau, wrenches: &mut self.wrenches };
        let mut energy = 0.0;
        for force in self.forces.iter_mut().filter(|f| f.is_slow() == (part == Part::Slow)) {
            force.add(&at, &[], &mut [], &mut loads)?;
            energy += force.potential(&at);
        }
        // What holds the tree at rest against weight and wrenches is their opposite.
        self.inverse.run(&self.layout, q, rest, rest, Some(&self.wrenches), out)?;
        for (out, tau) in out.iter_mut().zip(&self.tau) {
            *out = tau - *out;
        }
        if part == Part::Fast {
            return Ok(potential_energy(&self.layout, q)? + energy);
        }
        // The weight belongs to the fast part.
        self.inverse.run(&self.layout, q, rest, rest, None, &mut self.tau)?;
        out.iter_mut().zip(&self.tau).for_each(|(out, weight)| *out += weight);
        Ok(energy)
    }
}
