//! M⁻¹ as a full matrix and as an O(n) product.
//!
//! Column i of M⁻¹ is the acceleration of a unit force at degree of freedom i: the filter of
//! [`crate::ArticulatedSweep`] runs only along the path from i to the base, the smoother over all bodies
//! (the element-wise form is Lemma 13 of paper 1, corrected in soa.md 3.3).

use crate::articulated_sweep::{ArticulatedSweep, SolveWorkspace, filter, smooth};
use crate::error::{DynamicsError, check_length};
use crate::layout::{GROUND, Layout};
use num_traits::{One, Zero};
use phipsi_spatial::{Motion, Scalar, Wrench};

/// M⁻¹ x in O(n). `q`: nq; `x`: nv.
///
/// # Errors
/// [`DynamicsError::Shape`]; otherwise those of [`ArticulatedSweep::new`].
pub fn solve_mass_matrix<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    x: &[T],
) -> Result<Vec<T>, DynamicsError> {
    check_length("x", x, layout.nv())?;
    let sweep = ArticulatedSweep::new(layout, q)?;
    let mut out = x.to_vec();
    sweep.solve_in_place(layout, &mut out, &mut SolveWorkspace::new(layout));
    Ok(out)
}

/// The inverse of the mass matrix, full and symmetric, by rows. `q`: nq; result: nv×nv. Cost O(n²).
///
/// # Errors
/// As [`ArticulatedSweep::new`].
pub fn mass_matrix_inverse<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> Result<Vec<T>, DynamicsError> {
    let sweep = ArticulatedSweep::new(layout, q)?;
    let nv = layout.nv();
    let mut matrix = vec![T::zero(); nv * nv];
    let mut residuals = vec![T::Arithmetic::zero(); nv];
    let mut alpha = vec![Motion::zero(); layout.len()];
    for (k, body) in layout.bodies.iter().enumerate() {
        for i in 0..body.hinge.nv() {
            residuals.iter_mut().for_each(|x| *x = T::Arithmetic::zero());
            residuals[body.v + i] = T::Arithmetic::one();
            // Filter along the path from k to the base: everywhere else z and ν are zero.
            let (mut at, mut z) = (k, Wrench::zero());
            while at != GROUND {
                let b = &layout.bodies[at];
                let dofs = b.v..b.v + b.hinge.nv();
                filter(&b.hinge, &sweep.pivots[dofs.clone()], &mut z, &mut residuals[dofs]);
                z = sweep.shifts.at(at, b).wrench_to_parent(z);
                at = b.parent;
            }
            for (j, b) in layout.bodies.iter().enumerate() {
                let dofs = b.v..b.v + b.hinge.nv();
                alpha[j] = if b.parent == GROUND {
                    Motion::zero()
                } else {
                    sweep.shifts.at(j, b).motion_to_child(alpha[b.parent])
                };
                smooth(&b.hinge, &sweep.pivots[dofs.clone()], &mut alpha[j], &mut residuals[dofs]);
            }
            let row = body.v + i;
            for column in row..nv {
                let entry = T::from_arithmetic(residuals[column]);
                matrix[row * nv + column] = entry;
                matrix[column * nv + row] = entry;
            }
        }
    }
    Ok(matrix)
}
