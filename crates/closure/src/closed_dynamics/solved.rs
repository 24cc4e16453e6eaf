//! A solved state: multipliers, constraint forces and what prescribed motions need.

use super::{ClosedDynamics, ClosedInfo};
use crate::compiled::Number;
use crate::error::{ClosureError, check_length};
use crate::factors::Redundant;
use phipsi_spatial::Wrench;

/// A solved state; it borrows the workspace, so that what it gives belongs to that state.
#[derive(Debug)]
pub struct Solved<'a, T: Number> {
    pub(super) dynamics: &'a mut ClosedDynamics<T>,
    pub(super) info: ClosedInfo,
}

impl<T: Number> Solved<'_, T> {
    /// How good it is.
    pub fn info(&self) -> ClosedInfo {
        self.info
    }
    /// Rows that were found to be implied by others.
    pub fn redundant(&self) -> &[Redundant] {
        &self.dynamics.factors.redundant
    }
    /// Multipliers: the force of each closure on the body of its frame B, in the axes of frame A, at the origin of B; its rows in
    /// the order of the kind, N·m of angular ones and N. Of least norm, moments counted divided by [`ClosedDynamics::length`],
    /// where rows are redundant. `out`: rows.
    ///
    /// With redundant rows only their sum is determined, and single ones may be large near singular positions; the
    /// [generalised force](Self::generalized_constraint_force) is unique.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`] for a wrong length.
    pub fn closure_forces(&mut self, out: &mut [T]) -> Result<(), ClosureError> {
        check_length("out", out, self.dynamics.rows())?;
        let ClosedDynamics { structure, factors, solution, .. } = &mut *self.dynamics;
        solution.least_norm(structure, factors);
        solution.multipliers(structure, out);
        Ok(())
    }
    /// J*λ: the generalised force of all closures. `out`: nv.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`] for a wrong length.
    pub fn generalized_constraint_force(&self, out: &mut [T]) -> Result<(), ClosureError> {
        let ClosedDynamics { structure, layout, tree, frames, solution, .. } = &*self.dynamics;
        check_length("out", out, layout.nv())?;
        solution.constraint_force(structure, tree, frames, out);
        Ok(())
    }
    /// The generalised forces with what the prescribed degrees of freedom need for their accelerations. Arguments as those of the
    /// run, with the accelerations that it gave; `out`: nv, `tau` where nothing is prescribed.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`] for a wrong length.
    pub fn generalized_forces(
        &mut self,
        q: &[T],
        v: &[T],
        tau: &[T],
        acceleration: &[T],
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), ClosureError> {
        check_length("tau", tau, self.dynamics.layout.nv())?;
        let ClosedDynamics { structure, layout, tree, frames, factors, solution, inverse, work, .. } =
            &mut *self.dynamics;
        inverse.run(layout, q, v, acceleration, wrenches, out)?;
        solution.constraint_force(structure, tree, frames, work);
        for i in 0..tau.len() {
            out[i] = if factors.is_passive(i) { tau[i] } else { out[i] - work[i] };
        }
        Ok(())
    }
}
