//! What is looked at after a step: balances, samples that are due, limits that are passed.

use super::Runner;
use crate::error::SimulateError;
use crate::output::Measured;
use crate::record::{LimitPassed, Observer, Row};
use crate::simulation::Simulation;
use phipsi_molecule::Bath;
use phipsi_motion::{Balance, System, balance};
use phipsi_recursion::DynamicsError;

impl Runner<'_> {
    pub(super) fn balance(&mut self) -> Result<Balance, DynamicsError> {
        let at = (self.stepper.t(), self.stepper.q(), self.stepper.v());
        let (dynamics, kinematics) = match &mut self.phase {
            Some(phase) => (&mut phase.dynamics, &mut phase.kinematics),
            None => (&mut self.simulation.dynamics, &mut self.kinematics),
        };
        let mut found = balance(dynamics, kinematics, at, self.stepper.aux())?;
        found.work += self.heat();
        Ok(found)
    }

    /// Energy that the bath and changes of clusters have given.
    pub(super) fn heat(&self) -> f64 {
        let given = self.phase.as_ref().map_or(0.0, |phase| phase.state.given);
        self.bath.as_ref().map_or(0.0, Bath::heat) + given
    }

    /// Records the samples that are due up to the present time.
    pub(super) fn record_due(&mut self, observer: &mut dyn Observer) -> Result<(), SimulateError> {
        let end = self.end();
        let samples = self.simulation.samples_until(end);
        // Times of fixed steps are multiples of the step, those of samples of the interval: equal up to rounding.
        let slack = self.simulation.choice.method.fixed_step().map_or(0.0, |step| 1e-6 * step);
        while self.rows < samples
            && self.simulation.sample_time_until(self.rows, end) <= self.stepper.t() + slack
        {
            let t = self.simulation.sample_time_until(self.rows, end);
            let heat = self.heat();
            let dynamics = match &mut self.phase {
                Some(phase) => &mut phase.dynamics,
                None => &mut self.simulation.dynamics,
            };
            let model = dynamics.model();
            let (mut q, mut v) = (vec![0.0; model.nq()], vec![0.0; model.nv()]);
            let mut aux = vec![0.0; dynamics.auxiliary_len()];
            self.stepper
                .sample(dynamics, t, &mut q, &mut v, &mut aux)
                .map_err(|e| SimulateError::stopped(&e, dynamics.model()))?;
            let row = self.measure(t, q, v, &aux, heat)?;
            if let Some(phase) = &mut self.phase {
                phase.state.near.clone_from(&row.q);
            }
            observer.row(&row)?;
            self.rows += 1;
        }
        Ok(())
    }

    /// Notes the first time that each joint is beyond its limits.
    pub(super) fn watch_limits(&mut self, t0: f64) {
        // A model of other clusters has other coordinates, and no limits.
        if self.phase.is_some() {
            return;
        }
        let (q, t1) = (self.stepper.q(), self.stepper.t());
        for &(k, i, [lower, upper]) in &self.limited {
            let limit = if q[i] < lower { lower } else { upper };
            if (lower..=upper).contains(&q[i]) || lower > upper {
                continue;
            }
            let joint = &self.simulation.dynamics.model().joints()[k].name;
            if self.limits.iter().all(|l| l.joint != *joint) {
                self.limits.push(LimitPassed {
                    joint: joint.clone(),
                    position: q[i],
                    limit,
                    between: [t0, t1],
                });
            }
        }
    }

    /// Everything recorded of one state of the present clusters, in the coordinates of the scene's model.
    pub(super) fn measure(
        &mut self,
        t: f64,
        q: Vec<f64>,
        v: Vec<f64>,
        aux: &[f64],
        heat: f64,
    ) -> Result<Row, SimulateError> {
        let Simulation { dynamics, outputs, molecule, .. } = &mut *self.simulation;
        let (mut found, terms, q, v) = match (&mut self.phase, molecule) {
            (Some(phase), Some(molecule)) => {
                let own = &mut phase.dynamics;
                let found = balance(own, &mut phase.kinematics, (t, &q, &v), aux)?;
                let terms = own.term_energies(t, &q, &v)?;
                let (q, v) = phase.recorded(molecule, &q, &v)?;
                self.kinematics.set_position(dynamics.layout(), &q)?;
                self.kinematics.set_velocity(dynamics.layout(), &v)?;
                (found, terms, q, v)
            }
            _ => {
                let found = balance(dynamics, &mut self.kinematics, (t, &q, &v), aux)?;
                let terms = dynamics.term_energies(t, &q, &v)?;
                (found, terms, q, v)
            }
        };
        found.work += heat;
        let at = Measured {
            model: dynamics.model(),
            layout: dynamics.layout(),
            kinematics: &self.kinematics,
            q: &q,
            v: &v,
            balance: &found,
        };
        let outputs = outputs.iter().map(|o| o.value(&at)).collect();
        let energy = [found.kinetic, found.potential, found.work];
        Ok(Row { t, energy, terms, momentum: found.momentum.to_array(), outputs, q, v })
    }
}
