//! The inward sweep of forward dynamics on numbers as they are: lanes of states, and scalars without lanes of their own.
//!
//! Symbols: those of [`crate::forward_dynamics`].

use super::{ForwardDynamics, Moved};
use crate::articulated_sweep::{
    eliminate, filter, filter_prismatic, filter_revolute, prismatic_pivot, revolute_pivot,
};
use crate::error::DynamicsError;
use crate::hinge::Hinge;
use crate::layout::{GROUND, Layout, LayoutBody, each_kind};
use crate::link::each_shape;
use phipsi_spatial::{ArticulatedInertia, Motion, RigidInertia, Scalar, Vec3, Wrench};

impl<T: Scalar> ForwardDynamics<T> {
    /// Kalman filter: `residuals` holds T before and ν after.
    ///
    /// P and z of the present body stay in memory, for they are more than the registers hold: what a branch of the program
    /// would hand on in registers goes to the stack and back.
    #[inline(always)]
    pub(super) fn sweep_inboard(
        &mut self,
        layout: &Layout<T::Constant>,
        loaded: bool,
        residuals: &mut [T::Arithmetic],
    ) -> Result<(), DynamicsError> {
        self.pending.clear();
        let nothing = RigidInertia::zero();
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            if body.children == 0 {
                self.here = (RigidInertia::constant(&body.inertia).to_articulated(), Wrench::zero());
            } else {
                for _ in 1..body.children {
                    add_moved(&mut self.here, self.pending.take());
                }
            }
            // What goes to the next body gets its own inertia, too.
            let own = if body.follows_parent(k) { &layout.bodies[body.parent].inertia } else { &nothing };
            match body.hinge {
                Hinge::Revolute => self.filter_revolute_body(layout, k, body, loaded, own, residuals)?,
                Hinge::Prismatic => self.filter_prismatic_body(layout, k, body, loaded, own, residuals)?,
                _ => each_kind!(body, |known| self.filter_body(layout, k, known, loaded, own, residuals))?,
            }
            if body.parent != GROUND && !body.follows_parent(k) {
                self.pending.put(&self.here);
            }
        }
        Ok(())
    }
    /// Σ φ z⁺ + b.
    #[inline(always)]
    fn bias(&self, k: usize, body: &LayoutBody<T::Constant>, loaded: bool) -> Wrench<T::Arithmetic> {
        let z = RigidInertia::constant(&body.inertia).gyroscopic(self.moving[k].omega) + self.here.1;
        if loaded { z + self.loads[k] } else { z }
    }
    #[inline(always)]
    fn filter_revolute_body(
        &mut self,
        layout: &Layout<T::Constant>,
        k: usize,
        body: &LayoutBody<T::Constant>,
        loaded: bool,
        own: &RigidInertia<T::Constant>,
        residuals: &mut [T::Arithmetic],
    ) -> Result<(), DynamicsError> {
        let pivot = match revolute_pivot(&self.here.0) {
            Ok(pivot) => pivot,
            Err((i, D)) => return Err(layout.singular(body.v + i, D)),
        };
        self.pivots[body.v] = pivot;
        let coriolis = self.moving[k].coriolis;
        let mut z = self.bias(k, body, loaded);
        if body.parent == GROUND {
            residuals[body.v] = filter_revolute(&pivot, &mut z, residuals[body.v]);
            return Ok(());
        }
        z += revolute_coriolis_force(&self.here.0, coriolis);
        residuals[body.v] = filter_revolute(&pivot, &mut z, residuals[body.v]);
        let turn = self.shifts.turn(k);
        let own = RigidInertia::constant(own);
        each_shape!(body.link, |link| {
            self.here.1 = link.wrench_to_parent(&link.hinged(turn), z);
            self.here.0 = link.eliminated_to_parent(turn, &self.here.0, &pivot.gain).plus_rigid(&own);
        });
        Ok(())
    }
    #[inline(always)]
    fn filter_prismatic_body(
        &mut self,
        layout: &Layout<T::Constant>,
        k: usize,
        body: &LayoutBody<T::Constant>,
        loaded: bool,
        own: &RigidInertia<T::Constant>,
        residuals: &mut [T::Arithmetic],
    ) -> Result<(), DynamicsError> {
        let pivot = match prismatic_pivot(&self.here.0) {
            Ok(pivot) => pivot,
            Err((i, D)) => return Err(layout.singular(body.v + i, D)),
        };
        self.pivots[body.v] = pivot;
        let coriolis = self.moving[k].coriolis;
        let mut z = self.bias(k, body, loaded);
        if body.parent == GROUND {
            residuals[body.v] = filter_prismatic(&pivot, &mut z, residuals[body.v]);
            return Ok(());
        }
        // A slider's a does not turn.
        let P = &self.here.0;
        z += Wrench::new(P.coupling * coriolis.linear, P.mass * coriolis.linear);
        residuals[body.v] = filter_prismatic(&pivot, &mut z, residuals[body.v]);
        let shift = *self.shifts.at(k, body).shift;
        let own = RigidInertia::constant(own);
        each_shape!(body.link, |link| {
            self.here.1 = link.wrench_to_parent(&shift, z);
            self.here.0 = link.slid_to_parent(&shift, &self.here.0, &pivot.gain).plus_rigid(&own);
        });
        Ok(())
    }
    #[inline(always)]
    fn filter_body(
        &mut self,
        layout: &Layout<T::Constant>,
        k: usize,
        body: &LayoutBody<T::Constant>,
        loaded: bool,
        own: &RigidInertia<T::Constant>,
        residuals: &mut [T::Arithmetic],
    ) -> Result<(), DynamicsError> {
        let coriolis = self.moving[k].coriolis;
        let P = self.here.0;
        let mut z = self.bias(k, body, loaded);
        if body.parent != GROUND {
            z += P.times(coriolis);
        }
        let dofs = body.v..body.v + body.hinge.nv();
        let pivots = &mut self.pivots[dofs.clone()];
        let passage = self.shifts.at(k, body);
        let moved = match eliminate(body, passage, P, pivots) {
            Ok(moved) => moved,
            Err((i, D)) => return Err(layout.singular(body.v + i, D)),
        };
        filter(&body.hinge, pivots, &mut z, &mut residuals[dofs]);
        self.here = (moved.plus_rigid(&RigidInertia::constant(own)), passage.wrench_to_parent(z));
        Ok(())
    }
}

#[inline(always)]
fn add_moved<T: Scalar>(sum: &mut Moved<T>, x: &Moved<T>) {
    sum.0 = sum.0 + x.0;
    sum.1 += x.1;
}

/// P a, where a hinge about z has no a along it.
#[inline(always)]
fn revolute_coriolis_force<T: Scalar>(P: &ArticulatedInertia<T>, a: Motion<T>) -> Wrench<T> {
    let (J, C) = (&P.inertia, &P.coupling);
    let [x, y, _] = a.angular.0;
    let (cx, cy) = (C.row(0), C.row(1));
    let angular = Vec3([J.xx.fma(x, J.xy * y), J.xy.fma(x, J.yy * y), J.xz.fma(x, J.yz * y)]);
    let across = Vec3([cx.dot(a.linear), cy.dot(a.linear), C.row(2).dot(a.linear)]);
    Wrench::new(angular + across, cx.scale_add(x, cy.scale_add(y, P.mass * a.linear)))
}
