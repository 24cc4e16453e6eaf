//! The linearised dynamics, by dual numbers along every deviation.

use crate::dense::NotPositive;
use crate::forward_dynamics::forward_dynamics;
use crate::inverse_dynamics_derivatives::{fixed, fixed_wrenches, seeded, tangent};
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::{Real, Wrench};

/// The rate of `difference`(q̄, q) while q̄ moves with v̄ and q with v.
fn deviation_rate<T: Real>(model: &Model, q: [&[T]; 2], v: [&[T]; 2]) -> Vec<T> {
    let moving = |i: usize| seeded(q[i], &tangent(model, q[i], v[i]));
    model.difference(&moving(0), &moving(1)).into_iter().map(|x| x.rate).collect()
}

/// A and B of `phipsi_recursion::linearize`; q with unit quaternions.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn linearize<T: Real>(
    model: &Model,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<(DMatrix<T>, DMatrix<T>), NotPositive> {
    let nv = model.nv();
    let wrenches = wrenches.map(fixed_wrenches);
    let mut a = DMatrix::from_element(2 * nv, 2 * nv, T::zero());
    let mut b = DMatrix::from_element(2 * nv, nv, T::zero());
    for j in 0..3 * nv {
        let part = |at: usize| {
            let unit = |i: usize| if at + i == j { T::one() } else { T::zero() };
            (0..nv).map(unit).collect::<Vec<T>>()
        };
        let increment = seeded(&vec![T::zero(); nv], &part(0));
        let moved = model.integrate(&fixed(q), &increment);
        let (speed, force) = (seeded(v, &part(nv)), seeded(tau, &part(2 * nv)));
        let upper = deviation_rate(model, [&fixed(q), &moved], [&fixed(v), &speed]);
        let lower = forward_dynamics(model, &moved, &speed, &force, wrenches.as_deref())?;
        for (i, x) in upper.iter().chain(&lower).enumerate() {
            if j < 2 * nv {
                a[(i, j)] = x.rate;
            } else {
                b[(i, j - 2 * nv)] = x.rate;
            }
        }
    }
    Ok((a, b))
}
