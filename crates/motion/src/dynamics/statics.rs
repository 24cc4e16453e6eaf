//! Weight and conservative forces alone, for the midpoint method.

use super::{Dynamics, MotionError};
use crate::conservative::Conservative;
use crate::force::Situation;
use phipsi_recursion::potential_energy;
use phipsi_spatial::Wrench;

impl Conservative for Dynamics {
    type Error = MotionError;

    fn evaluate(&mut self, q: &[f64], out: &mut [f64]) -> Result<f64, MotionError> {
        if self.is_prescribed() {
            return Err(MotionError::Driven);
        }
        if self.is_switching() {
            let what = "the midpoint method knows no stops, dry friction and events that change the state; \
                        use \"dop853\" or \"tsit5\"";
            return Err(MotionError::Switch { what: what.into() });
        }
        if let Some(force) = self.forces.iter().find(|f| !f.needs().conservative || !f.auxiliary().is_empty())
        {
            return Err(MotionError::NotConservative { force: force.name().into() });
        }
        let rest = std::mem::take(&mut self.rest);
        let result = self.evaluate_at(q, &rest, out);
        self.rest = rest;
        result
    }
}

impl Dynamics {
    fn evaluate_at(&mut self, q: &[f64], rest: &[f64], out: &mut [f64]) -> Result<f64, MotionError> {
        self.tau.iter_mut().for_each(|x| *x = 0.0);
        self.wrenches.iter_mut().for_each(|w| *w = Wrench::zero());
        self.place(q, rest)?;
        self.add_forces(true, (0.0, q, rest), &[], &mut [])?;
        let (model, layout, kinematics) = (&self.model, &self.layout, Some(&self.kinematics));
        let at = Situation { model, layout, t: 0.0, q, v: rest, kinematics };
        let springs: f64 = self.forces.iter().map(|f| f.potential(&at)).sum();
        // What holds the tree at rest against weight and wrenches is their opposite.
        self.inverse.run(&self.layout, q, rest, rest, Some(&self.wrenches), out)?;
        for (out, tau) in out.iter_mut().zip(&self.tau) {
            *out = tau - *out;
        }
        Ok(potential_energy(&self.layout, q)? + springs)
    }
}
