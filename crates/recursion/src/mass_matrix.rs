//! The mass matrix by composite bodies.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | R(k) | M(k) + Σ φ(k,c) R(c) φ*(k,c), inertia of everything outboard of joint k, joints locked | paper 2 (4.12) |
//! | M(q) | H φ M φ* H* = H (R + φ~R + R φ~*) H* | soa.md 3.1 |

use crate::articulated_sweep::Pending;
use crate::columns::Columns;
use crate::error::{DynamicsError, check_length};
use crate::kernel::kernel;
use crate::layout::{GROUND, Layout, Shifts};
use num_traits::Zero;
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

/// Workspace of the mass matrix.
#[derive(Clone, Debug)]
pub struct MassMatrix<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    pending: Pending<RigidInertia<T::Arithmetic>>,
    columns: Columns<T::Arithmetic>,
}

impl<T: Scalar> MassMatrix<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        MassMatrix {
            shifts: Shifts::new(layout),
            pending: Pending::new(layout, RigidInertia::zero()),
            columns: Columns::new(layout),
        }
    }
    /// The mass matrix, full and symmetric, by rows.
    ///
    /// # Computes
    /// M = H φ M φ* H* (soa.md 3.1): the momentum of the composite body outboard of a joint, moving along its axis, is
    /// carried to the base; its components along the axes on the way are entries of M.
    ///
    /// # Shapes & units
    /// `q`: nq; `out`: nv×nv; kg·m², kg·m or kg.
    ///
    /// # Cost
    /// O(n · depth) besides writing the zeros; no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn run(&mut self, layout: &Layout<T::Constant>, q: &[T], out: &mut [T]) -> Result<(), DynamicsError> {
        let nv = layout.nv();
        check_length("q", q, layout.nq())?;
        check_length("out", out, nv * nv)?;
        check_length("workspace", self.shifts.all(), layout.len())?;
        let (q, out) = (T::arithmetic(q), T::arithmetic_mut(out));
        T::Arithmetic::dispatch(Sweep { work: self, layout, q, out });
        Ok(())
    }
}

kernel! {
    Sweep<'a, T> {
        work: &'a mut MassMatrix<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        out: &'a mut [T::Arithmetic],
    } -> () {
        let nv = layout.nv();
        out.fill(T::Arithmetic::zero());
        work.shifts.set_all(layout, q);
        work.pending.clear();
        work.columns.clear();
        let mut hand = RigidInertia::zero();
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let own = RigidInertia::constant(&body.inertia);
            let R = work.pending.all(body, &mut hand, |a, b| *a = *a + *b).map_or(own, |R| R + own);
            for i in 0..body.hinge.nv() {
                work.columns.push(body.v + i, R.momentum(body.hinge.axis(i)));
            }
            let outboard = work.columns.outboard(layout, k);
            for i in 0..body.hinge.nv() {
                let row = body.v + i;
                work.columns.project(&body.hinge, i, outboard.clone(), |column, entry| {
                    out[row * nv + column] = entry;
                    out[column * nv + row] = entry;
                });
            }
            if body.parent != GROUND {
                let passage = work.shifts.at(k, body);
                work.pending.give(k, body, &mut hand, passage.rigid_to_parent(&R));
                work.columns.move_to_parent(passage, outboard);
            }
        }
    }
}

/// [`MassMatrix::run`] for a single call.
///
/// # Errors
/// As there.
pub fn mass_matrix<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv() * layout.nv()];
    MassMatrix::new(layout).run(layout, q, &mut out)?;
    Ok(out)
}
