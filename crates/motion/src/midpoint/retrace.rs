//! Whether a step leads back: what a Metropolis test of trajectories rests on.
//!
//! | symbol | meaning |
//! |---|---|
//! | T, R | a step of size h; reversal of the momenta |
//!
//! R T R T = 1 where the drift is solved by the same of its solutions there and back. Near configurations where M is singular (a chain of
//! atoms that is straight) it has several, or none that the iteration finds from the other end.

use super::{Midpoint, MidpointState};
use phipsi_recursion::DynamicsError;

impl Midpoint {
    /// The next drift starts to iterate from M⁻¹ p, so that what follows depends on (q, p) alone. Cost: one solution.
    ///
    /// # Errors
    /// [`DynamicsError::SingularHinge`].
    pub fn begin_anew(&mut self) -> Result<(), DynamicsError> {
        self.velocity()?;
        self.state.guess.copy_from_slice(&self.velocity);
        Ok(())
    }

    /// True if a step of −h from here, begun anew, leads to `before`, from which one of h with all forces together has come here; within
    /// `tolerance` relative to the largest coordinate and momentum and one. Forces are not evaluated. The state stays.
    pub fn retraces(&mut self, h: f64, before: &MidpointState, tolerance: f64) -> bool {
        if before.q.len() != self.state.q.len() || before.forces.len() != self.next_p.len() {
            return false;
        }
        // No forces are evaluated: there is room for the guess.
        self.next_forces.copy_from_slice(&self.state.guess);
        let back = self.step_back(h, before);
        self.state.guess.copy_from_slice(&self.next_forces);
        self.placed = false;
        back.is_some() && near(&self.next_q, &before.q, tolerance) && near(&self.next_p, &before.p, tolerance)
    }

    /// The end of a step back in `next_q` and `next_p`; `None` where it does not converge.
    fn step_back(&mut self, h: f64, before: &MidpointState) -> Option<()> {
        self.begin_anew().ok()?;
        let kick = -0.5 * h;
        for (p, (start, force)) in self.next_p.iter_mut().zip(self.state.p.iter().zip(&self.state.forces)) {
            *p = start + kick * force;
        }
        self.drift::<()>(-h).ok()?;
        self.next_p.iter_mut().zip(&before.forces).for_each(|(p, force)| *p += kick * force);
        if let Some(closed) = &mut self.closed {
            closed.place(&self.next_q).ok()?;
            closed.solve(&self.next_p, None, &mut self.velocity, &mut self.y).ok()?;
            std::mem::swap(&mut self.next_p, &mut self.y);
        }
        self.still.iter().for_each(|axis| axis.remove(&mut self.next_p));
        Some(())
    }
}

fn near(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    let scale = 1.0 + b.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance * scale)
}
