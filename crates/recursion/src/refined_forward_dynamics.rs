//! Forward dynamics with one step of iterative refinement: θ̈ ← θ̈ + M⁻¹(T − inverse dynamics of θ̈).
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | θ̈ | accelerations of the plain recursion | [`mod@crate::forward_dynamics`] |
//! | T | generalised forces | paper 1 |
//! | residual | T − inverse dynamics of θ̈; its accelerations are those of a tree at rest without weight | soa.md 2.2 |

use crate::error::{DynamicsError, check_length};
use crate::forward_dynamics::ForwardDynamics;
use crate::inverse_dynamics::InverseDynamics;
use crate::layout::Layout;
use phipsi_spatial::{Scalar, Wrench};

/// Workspace of refined forward dynamics.
#[derive(Clone, Debug)]
pub struct RefinedForwardDynamics<T: Scalar> {
    forward: ForwardDynamics<T>,
    inverse: InverseDynamics<T>,
    weightless: Layout<T::Constant>,
    rest: Vec<T>,
    residual: Vec<T>,
    correction: Vec<T>,
}

impl<T: Scalar> RefinedForwardDynamics<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let zero = vec![T::zero(); layout.nv()];
        RefinedForwardDynamics {
            forward: ForwardDynamics::symmetric(layout),
            inverse: InverseDynamics::new(layout),
            weightless: layout.clone().inertial(),
            rest: zero.clone(),
            residual: zero.clone(),
            correction: zero,
        }
    }
    /// Accelerations of generalised forces `tau` at (q, v); arguments as of [`ForwardDynamics::run`].
    ///
    /// # Cost
    /// O(n): two forward and one inverse dynamics; no allocation.
    ///
    /// # Accuracy
    /// Error of the plain form times itself, at least n·ε·κ: 1e-9 becomes 1e-14. Where the plain form has no digits left the
    /// refined one has none either, and may be worse.
    ///
    /// # Errors
    /// As [`ForwardDynamics::run`].
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        tau: &[T],
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        check_length("workspace", &self.rest, layout.nv())?;
        self.forward.run(layout, q, v, tau, wrenches, out)?;
        self.inverse.run(layout, q, v, out, wrenches, &mut self.residual)?;
        for (residual, tau) in self.residual.iter_mut().zip(tau) {
            *residual = *tau - *residual;
        }
        self.forward.run(&self.weightless, q, &self.rest, &self.residual, None, &mut self.correction)?;
        for (out, correction) in out.iter_mut().zip(&self.correction) {
            *out += *correction;
        }
        Ok(())
    }
}

/// [`RefinedForwardDynamics::run`] for a single call.
///
/// # Errors
/// As there.
pub fn refined_forward_dynamics<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    RefinedForwardDynamics::new(layout).run(layout, q, v, tau, wrenches, &mut out)?;
    Ok(out)
}
