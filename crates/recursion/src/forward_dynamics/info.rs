//! How good a result of forward dynamics is: backward error and worst hinge.

use crate::composites::composite_inertias;
use crate::error::DynamicsError;
use crate::inverse_dynamics::inverse_dynamics;
use crate::layout::{GROUND, Layout};
use crate::mass_matrix::mass_matrix;
use phipsi_spatial::{Real, Wrench};

/// The hinge that loses most digits.
#[derive(Clone, Debug, PartialEq)]
pub struct WorstHinge {
    /// The joint's name.
    pub joint: String,
    /// Which of its degrees of freedom.
    pub component: usize,
    /// Articulated inertia D over the composite inertia of the same degree of freedom (joints outboard locked): the
    /// factor by which cancellation outboard of it can multiply rounding is the inverse. Zero where cancellation leaves no
    /// positive D, and the plain form fails.
    pub ratio: f64,
}

/// How good a forward dynamics result is.
#[derive(Clone, Debug, PartialEq)]
pub struct ForwardInfo {
    /// The hinge with the smallest D relative to its composite inertia.
    pub worst_hinge: Option<WorstHinge>,
    /// |τ − inverse dynamics of the result| over the sum of |terms|, largest component, in units of 1.
    pub backward_error: f64,
}

/// Backward error and worst hinge of accelerations `a` that forward dynamics gave for (q, v, tau).
///
/// The sum of terms of component i is |τ_i| + |M_ii a_i| + |bias_i| + Σ_j |M_ij a_j|, from the mass matrix.
/// With flexible bodies no hinge is named. Cost O(n · depth); O(nv · n) with flexible bodies. The accelerations may come from any form: where the plain one fails, its hinge is named.
///
/// # Errors
/// As [`super::ForwardDynamics::run`], but for hinges without a positive D.
pub fn forward_info<T: Real>(
    layout: &Layout<T>,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
    a: &[T],
) -> Result<ForwardInfo, DynamicsError> {
    if layout.is_flexible() {
        return flexible_info(layout, q, v, tau, wrenches, a);
    }
    let sweep = match crate::ArticulatedSweep::new(layout, q) {
        Ok(sweep) => Ok(sweep),
        Err(DynamicsError::SingularHinge { joint, component, .. }) => {
            Err(WorstHinge { joint, component, ratio: 0.0 })
        }
        Err(e) => return Err(e),
    };
    let back = inverse_dynamics(layout, q, v, a, wrenches)?;
    let bias = inverse_dynamics(layout, q, v, &vec![T::zero(); layout.nv()], wrenches)?;
    let (hinge, R) = composite_inertias(layout, q);
    let mut terms: Vec<f64> = (0..layout.nv()).map(|i| (tau[i].abs() + bias[i].abs()).to_f64()).collect();
    let mut worst: Option<(usize, f64)> = None;
    for (k, body) in layout.bodies.iter().enumerate() {
        for i in 0..body.hinge.nv() {
            let column = body.v + i;
            let mut f = R[k].momentum(body.hinge.axis(i));
            let own = body.hinge.project(i, &f);
            if let Ok(sweep) = &sweep {
                let ratio = (T::from_arithmetic(sweep.pivots[column].inverse) * own).recip().to_f64();
                if worst.is_none_or(|(_, smallest)| ratio < smallest) {
                    worst = Some((column, ratio));
                }
            }
            let (mut from, mut at) = (k, k);
            while at != GROUND {
                if at != from {
                    f = hinge[from].wrench_to_parent(f);
                }
                let up = &layout.bodies[at];
                for j in 0..up.hinge.nv() {
                    let row = up.v + j;
                    let entry = up.hinge.project(j, &f).abs();
                    terms[row] += (entry * a[column].abs()).to_f64();
                    if at != k {
                        terms[column] += (entry * a[row].abs()).to_f64();
                    }
                }
                (from, at) = (at, up.parent);
            }
        }
    }
    let relative = |i: usize| match (back[i] - tau[i]).abs().to_f64() {
        0.0 => 0.0,
        residual => residual / terms[i],
    };
    Ok(ForwardInfo {
        worst_hinge: sweep.err().or(worst.map(|(i, ratio)| {
            let (joint, component) = layout.joint_of_velocity(i);
            WorstHinge { joint: joint.into(), component, ratio }
        })),
        backward_error: (0..layout.nv()).map(relative).fold(0.0, f64::max),
    })
}

/// The same with the mass matrix as a whole, for models whose sweeps have modes besides hinges.
fn flexible_info<T: Real>(
    layout: &Layout<T>,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
    a: &[T],
) -> Result<ForwardInfo, DynamicsError> {
    let back = inverse_dynamics(layout, q, v, a, wrenches)?;
    let bias = inverse_dynamics(layout, q, v, &vec![T::zero(); layout.nv()], wrenches)?;
    let M = mass_matrix(layout, q)?;
    let mut backward_error = 0.0f64;
    for (i, row) in M.chunks_exact(layout.nv().max(1)).enumerate() {
        let inertial = row.iter().zip(a).fold(T::zero(), |sum, (m, a)| sum + (*m * *a).abs());
        let residual = (back[i] - tau[i]).abs().to_f64();
        if residual != 0.0 {
            backward_error =
                backward_error.max(residual / (tau[i].abs() + bias[i].abs() + inertial).to_f64());
        }
    }
    Ok(ForwardInfo { worst_hinge: None, backward_error })
}
