//! Forces of active and accelerations of passive degrees of freedom by the partitioned dense equations.

use crate::dense::{Factors, NotPositive, tips_first};
use crate::inverse_dynamics::inverse_dynamics;
use crate::mass_matrix::mass_matrix;
use phipsi_model::Model;
use phipsi_spatial::{Real, Wrench};

/// M_pp a_p = τ_p − (C + M a_a)_p, then τ_a = (C + M a)_a. `a` counts where `active`, `tau` elsewhere; all of both return.
///
/// # Errors
/// [`NotPositive`] if M_pp is not positive definite.
pub fn hybrid_dynamics<T: Real>(
    model: &Model,
    q: &[T],
    v: &[T],
    active: &[bool],
    a: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<(Vec<T>, Vec<T>), NotPositive> {
    let chosen = |want: bool, x: &[T]| -> Vec<T> {
        x.iter().zip(active).map(|(&x, &is)| if is == want { x } else { T::zero() }).collect()
    };
    let mut a = chosen(true, a);
    let held = inverse_dynamics(model, q, v, &a, wrenches);
    let rest: Vec<T> = tau.iter().zip(&held).map(|(&t, &h)| t - h).collect();
    let passive: Vec<usize> = tips_first(model).into_iter().filter(|&i| !active[i]).collect();
    let solution = Factors::new(&mass_matrix(model, q), passive, 0.0)?.solve(&rest);
    a.iter_mut().zip(solution).for_each(|(a, x)| *a += x);
    let forces = inverse_dynamics(model, q, v, &a, wrenches);
    let tau = chosen(false, tau).iter().zip(chosen(true, &forces)).map(|(&x, y)| x + y).collect();
    Ok((a, tau))
}
