//! The mass matrix by composite bodies.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | R(k) | M(k) + Σ φ(k,c) R(c) φ*(k,c), inertia of everything outboard of joint k, joints locked | paper 2 (4.12) |
//! | M(q) | H φ M φ* H* = H (R + φ~R + R φ~*) H* | soa.md 3.1 |

use crate::error::{DynamicsError, check_length};
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{RigidInertia, Scalar, Transform};

/// Composite inertias R of all bodies with their hinge transforms, tip to base.
pub(crate) fn composite_inertias<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> (Vec<Transform<T>>, Vec<RigidInertia<T>>) {
    let hinge: Vec<_> = layout.bodies.iter().map(|b| b.pose(q)).collect();
    let mut R: Vec<_> = layout.bodies.iter().map(|b| RigidInertia::constant(&b.inertia)).collect();
    for (k, body) in layout.bodies.iter().enumerate().rev() {
        if body.parent != GROUND {
            R[body.parent] = R[body.parent] + hinge[k].rigid_to_parent(&R[k]);
        }
    }
    (hinge, R)
}

/// The mass matrix, full and symmetric, by rows.
///
/// # Shapes & units
/// `q`: nq; result: nv×nv; kg·m², kg·m or kg.
///
/// # Cost
/// O(n · depth) besides writing the zeros.
///
/// # Errors
/// [`DynamicsError::Shape`].
pub fn mass_matrix<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<Vec<T>, DynamicsError> {
    check_length("q", q, layout.nq())?;
    let nv = layout.nv();
    let (hinge, R) = composite_inertias(layout, q);
    let mut matrix = vec![T::zero(); nv * nv];
    for (k, body) in layout.bodies.iter().enumerate() {
        for i in 0..body.hinge.nv() {
            let column = body.v + i;
            let mut f = R[k].momentum(body.hinge.axis(i));
            for j in 0..=i {
                let entry = body.hinge.project(j, &f);
                matrix[(body.v + j) * nv + column] = entry;
                matrix[column * nv + body.v + j] = entry;
            }
            let (mut child, mut ancestor) = (k, body.parent);
            while ancestor != GROUND {
                f = hinge[child].wrench_to_parent(f);
                let up = &layout.bodies[ancestor];
                for j in 0..up.hinge.nv() {
                    let entry = up.hinge.project(j, &f);
                    matrix[(up.v + j) * nv + column] = entry;
                    matrix[column * nv + up.v + j] = entry;
                }
                (child, ancestor) = (ancestor, up.parent);
            }
        }
    }
    Ok(matrix)
}
