//! Composite inertias in the bodies' own axes: R(k) = M(k) + Σ φ(k,c) R(c) φ*(k,c), paper 2 (4.12).

use crate::layout::{GROUND, Layout, LayoutBody, Pending, Shifts};
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

/// Composite inertias R of bodies, tip to base.
pub(crate) struct Composites<'a, T: Scalar> {
    layout: &'a Layout<T::Constant>,
    shifts: &'a Shifts<T>,
    pending: &'a mut Pending<RigidInertia<T>>,
    hand: RigidInertia<T>,
}

impl<'a, T: Scalar> Composites<'a, T> {
    #[inline(always)]
    pub(crate) fn begin(
        layout: &'a Layout<T::Constant>,
        shifts: &'a Shifts<T>,
        pending: &'a mut Pending<RigidInertia<T>>,
    ) -> Self {
        pending.clear();
        Composites { layout, shifts, pending, hand: RigidInertia::zero() }
    }
    /// φ R φ* of the limb that begins with body `root`, in place of its bodies.
    #[inline(always)]
    pub(crate) fn take(&mut self, root: usize, moved: &RigidInertia<T>) {
        let body = &self.layout.bodies[root];
        if body.follows_parent(root) {
            let own = RigidInertia::constant(&self.layout.bodies[body.parent].inertia);
            self.hand = *moved + own;
        } else if body.parent != GROUND {
            self.pending.put(moved);
        }
    }
    /// φ R φ* of the first body, whose parent is in another tree.
    #[inline(always)]
    pub(crate) fn given(&mut self) -> RigidInertia<T> {
        *self.pending.take()
    }
    /// R of body `k`, after all bodies that are stored after it.
    #[inline(always)]
    pub(crate) fn next(&mut self, k: usize, body: &LayoutBody<T::Constant>) -> RigidInertia<T> {
        let R = match self.pending.all(body, &mut self.hand, |a, b| *a = *a + *b) {
            Some(R) => R,
            None => RigidInertia::constant(&body.inertia),
        };
        if body.follows_parent(k) {
            // The first child gives also what its parent has of its own.
            let own = RigidInertia::constant(&self.layout.bodies[body.parent].inertia);
            self.hand = self.shifts.at(k, body).rigid_onto_parent(&R, &own);
        } else if body.parent != GROUND {
            let moved = self.shifts.at(k, body).rigid_to_parent(&R);
            self.pending.give(k, body, &mut self.hand, moved);
        }
        R
    }
}
