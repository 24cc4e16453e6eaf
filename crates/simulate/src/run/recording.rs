//! What is looked at after a step: balances, samples that are due, limits that are passed.

use super::Runner;
use crate::error::SimulateError;
use crate::output::Measured;
use crate::record::{LimitPassed, Observer, Row};
use phipsi_molecule::Bath;
use phipsi_motion::{Balance, Dynamics, System, balance};
use phipsi_recursion::{DynamicsError, Kinematics};

impl Runner<'_> {
    pub(super) fn balance(&mut self) -> Result<Balance, DynamicsError> {
        let at = (self.stepper.t(), self.stepper.q(), self.stepper.v());
        let mut found = balance(&mut self.simulation.dynamics, &mut self.kinematics, at, self.stepper.aux())?;
        found.work += self.heat();
        Ok(found)
    }

    /// Energy that the bath has given.
    pub(super) fn heat(&self) -> f64 {
        self.bath.as_ref().map_or(0.0, Bath::heat)
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
            let dynamics = &mut self.simulation.dynamics;
            let model = dynamics.model();
            let (mut q, mut v) = (vec![0.0; model.nq()], vec![0.0; model.nv()]);
            let mut aux = vec![0.0; dynamics.auxiliary_len()];
            self.stepper
                .sample(dynamics, t, &mut q, &mut v, &mut aux)
                .map_err(|e| SimulateError::stopped(&e, dynamics.model()))?;
            let row =
                measure(dynamics, &mut self.kinematics, &self.simulation.outputs, (t, q, v), &aux, heat)?;
            observer.row(&row)?;
            self.rows += 1;
        }
        Ok(())
    }

    /// Notes the first time that each joint is beyond its limits.
    pub(super) fn watch_limits(&mut self, t0: f64) {
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
}

/// Everything recorded of one state.
pub(super) fn measure(
    dynamics: &mut Dynamics,
    kinematics: &mut Kinematics<f64>,
    outputs: &[crate::output::Output],
    (t, q, v): (f64, Vec<f64>, Vec<f64>),
    aux: &[f64],
    heat: f64,
) -> Result<Row, DynamicsError> {
    let mut balance = balance(dynamics, kinematics, (t, &q, &v), aux)?;
    balance.work += heat;
    let at = Measured {
        model: dynamics.model(),
        layout: dynamics.layout(),
        kinematics,
        q: &q,
        v: &v,
        balance: &balance,
    };
    let outputs = outputs.iter().map(|o| o.value(&at)).collect();
    let energy = [balance.kinetic, balance.potential, balance.work];
    let terms = dynamics.term_energies(t, &q, &v)?;
    Ok(Row { t, energy, terms, momentum: balance.momentum.to_array(), outputs, q, v })
}
