//! Derivatives of forward dynamics: −M⁻¹ times those of inverse dynamics, with dense factors.

use crate::articulated_sweep::factors;
use crate::dense::NotPositive;
use crate::forward_dynamics::forward_dynamics;
use crate::inverse_dynamics_derivatives::{Derivatives, inverse_dynamics_derivatives};
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::{Real, Wrench};

/// Derivatives of [`forward_dynamics`] at (q, v, tau); `d_last` is M⁻¹.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn forward_dynamics_derivatives<T: Real>(
    model: &Model,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Derivatives<T>, NotPositive> {
    let a = forward_dynamics(model, q, v, tau, wrenches)?;
    let of_forces = inverse_dynamics_derivatives(model, q, v, &a, wrenches);
    let factors = factors(model, q)?;
    let nv = model.nv();
    let solve = |b: &DMatrix<T>, sign: T| {
        let mut x = b.clone();
        for j in 0..nv {
            let column: Vec<T> = (0..nv).map(|i| b[(i, j)] * sign).collect();
            for (i, y) in factors.solve(&column).into_iter().enumerate() {
                x[(i, j)] = y;
            }
        }
        x
    };
    let mut one = DMatrix::from_element(nv, nv, T::zero());
    (0..nv).for_each(|i| one[(i, i)] = T::one());
    Ok(Derivatives {
        d_dq: solve(&of_forces.d_dq, -T::one()),
        d_dv: solve(&of_forces.d_dv, -T::one()),
        d_last: solve(&one, T::one()),
    })
}
