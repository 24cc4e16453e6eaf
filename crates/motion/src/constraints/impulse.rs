//! What holds a joint, and what an impulse at a joint does.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | N | from impulses to changes of velocity of the mechanism with its loops and given motions | nv×nv |
//! | W_a | work of actuators and moving closures in an impact: their impulses times their velocities | |

use super::Constraints;
use crate::dynamics::MotionError;
use phipsi_closure::{ClosedDynamics, ClosureError, ClosureMotion, Conditions, Prescribed};
use phipsi_model::Model;
use phipsi_spatial::Wrench;

impl Constraints {
    /// Makes it ready for impulses.
    pub(crate) fn with_impulses(mut self, model: &Model) -> Result<Self, MotionError> {
        // Weight and elastic forces have no impulse.
        let still = model.clone().with_gravity([0.0; 3]).without_stiffness();
        self.still = Some(Box::new(ClosedDynamics::new(&still)?));
        Ok(self)
    }
    /// Accelerations, and the forces besides `tau` that hold the active degrees of freedom: `holding`, nv.
    pub(crate) fn run_holding(
        &mut self,
        (t, q, v): (f64, &[f64], &[f64]),
        tau: &[f64],
        wrenches: Option<&[Wrench<f64>]>,
        v_dot: &mut [f64],
        holding: &mut [f64],
    ) -> Result<(), ClosureError> {
        let (closed, held) = self.hold(t);
        let conditions = held.conditions(wrenches);
        let mut solved = closed.run(q, v, tau, &conditions, v_dot)?;
        solved.generalized_forces(q, v, tau, v_dot, wrenches, holding)?;
        holding.iter_mut().zip(tau).for_each(|(h, tau)| *h -= tau);
        Ok(())
    }
    /// N at one degree of freedom: `out` gets the change of velocities by a unit impulse. Returns W_a of it at velocities `v`.
    pub(crate) fn respond(
        &mut self,
        (t, q, v): (f64, &[f64], &[f64]),
        dof: usize,
        out: &mut [f64],
    ) -> Result<f64, ClosureError> {
        let Some(mut still) = self.still.take() else { return Ok(0.0) };
        let (n, rows) = (v.len(), self.lambda.len());
        let rest = vec![0.0; n.max(rows)];
        let mut unit = vec![0.0; n];
        unit[dof] = 1.0;
        let mut lambda = std::mem::take(&mut self.lambda);
        let mut forces = std::mem::take(&mut self.forces);
        let given = std::mem::take(&mut self.given);
        let (_, held) = self.hold(t);
        let conditions = Conditions {
            wrenches: None,
            motion: held.moves.then_some(ClosureMotion {
                position: &held.gamma[0],
                velocity: &rest[..rows],
                acceleration: &rest[..rows],
            }),
            prescribed: given
                .contains(&true)
                .then_some(Prescribed { active: &given, acceleration: &rest[..n] }),
        };
        let mut solve = || {
            let mut solved = still.run(q, &rest[..n], &unit, &conditions, out)?;
            let mut work = 0.0;
            if held.moves {
                solved.closure_forces(&mut lambda)?;
                work += lambda.iter().zip(&held.gamma[1]).map(|(l, rate)| l * rate).sum::<f64>();
            }
            if conditions.prescribed.is_some() {
                solved.generalized_forces(q, &rest[..n], &unit, out, None, &mut forces)?;
                let driven = (0..n).filter(|&i| given[i]);
                work += driven.map(|i| (forces[i] - unit[i]) * v[i]).sum::<f64>();
            }
            Ok(work)
        };
        let result = solve();
        (self.lambda, self.forces, self.given) = (lambda, forces, given);
        self.still = Some(still);
        result
    }
}
