//! Multiple time steps of the midpoint method: the reversible reference system propagator (Tuckerman, Berne, Martyna 1992).
//!
//! | symbol | meaning |
//! |---|---|
//! | Q_s | generalised forces of the slow part |
//! | K(t) | p ← p + t Q_s; with loops, its part in the cotangent space of the closures |
//! | S(t) | the step of the method with the fast part |
//!
//! Where the system has a slow part, a step is K(h/2) S(h/n)ⁿ K(h/2), n = [`Midpoint::substeps`]: maps that are each symplectic and
//! reversible, together of second order.

use super::{DriftInfo, Midpoint};
use crate::conservative::{Conservative, Part, evaluate};
use crate::midpoint_error::MidpointError;
use phipsi_recursion::DynamicsError;

impl Midpoint {
    /// Evaluates the slow part at the present configuration where it has not been.
    pub(super) fn find_slow<C: Conservative>(
        &mut self,
        system: &mut C,
    ) -> Result<(), MidpointError<C::Error>> {
        let s = &mut self.state;
        if system.has_slow() && s.slow.is_empty() {
            let mut slow = vec![0.0; s.p.len()];
            s.potential += evaluate(system, Part::Slow, &self.layout, s.t, &s.q, &mut slow)?;
            s.slow = slow;
        }
        Ok(())
    }
    /// One step of size h: half a kick, a drift, the forces at its end, half a kick; between half-kicks of the slow part, where
    /// the system has one, as many of them as [`Midpoint::substeps`]. h may be negative.
    ///
    /// # Errors
    /// [`MidpointError`]; the state is that before the step.
    pub fn step<C: Conservative>(
        &mut self,
        system: &mut C,
        h: f64,
    ) -> Result<DriftInfo, MidpointError<C::Error>> {
        if !system.has_slow() {
            return self.step_once(system, h);
        }
        let mut saved = self.saved.take().unwrap_or_else(|| Box::new(self.state.clone()));
        saved.copy(&self.state);
        let done = self.step_several(system, h);
        if done.is_err() {
            self.state.copy(&saved);
            self.moved();
        }
        self.saved = Some(saved);
        done
    }

    /// Half a kick of the slow part, steps with the fast one, half a kick. The iterations are those of the worst drift.
    fn step_several<C: Conservative>(
        &mut self,
        system: &mut C,
        h: f64,
    ) -> Result<DriftInfo, MidpointError<C::Error>> {
        self.find_slow(system)?;
        let (start, steps) = (self.state.t, self.state.steps);
        let failed = |cause| MidpointError::Dynamics { t: start, cause };
        self.kick(0.5 * h).map_err(failed)?;
        let n = self.substeps.max(1);
        let mut worst = DriftInfo { iterations: 0, correction: 0.0 };
        for _ in 0..n {
            let info = self.step_once(system, h / n as f64)?;
            if info.iterations > worst.iterations {
                worst = info;
            }
        }
        let s = &mut self.state;
        (s.t, s.steps) = (start + h, steps + 1);
        s.potential += evaluate(system, Part::Slow, &self.layout, s.t, &s.q, &mut s.slow)?;
        self.kick(0.5 * h).map_err(failed)?;
        Ok(worst)
    }

    /// p ← p + h Q of the slow part; with loops, its part in the cotangent space of the closures.
    fn kick(&mut self, h: f64) -> Result<(), DynamicsError> {
        for (y, (p, force)) in self.y.iter_mut().zip(self.state.p.iter().zip(&self.state.slow)) {
            *y = p + h * force;
        }
        self.still.iter().for_each(|axis| axis.remove(&mut self.y));
        self.loops()?;
        match &mut self.closed {
            Some(closed) => closed.solve(&self.y, None, &mut self.velocity, &mut self.state.p),
            None => {
                self.state.p.copy_from_slice(&self.y);
                Ok(())
            }
        }
    }
}
