//! The inward sweep of forward dynamics on numbers as they are: lanes of states, and scalars without lanes of their own.
//!
//! Symbols: those of [`crate::forward_dynamics`].

use super::{Moved, Run};
use crate::articulated_sweep::{
    eliminate, filter, filter_prismatic, filter_revolute, prismatic_pivot, revolute_pivot,
};
use crate::error::DynamicsError;
use crate::hinge::Hinge;
use crate::layout::{GROUND, LayoutBody, each_kind};
use crate::link::each_shape;
use core::ops::Range;
use phipsi_spatial::{ArticulatedInertia, Motion, RigidInertia, Scalar, Vec3, Wrench};

impl<T: Scalar> Run<'_, T> {
    /// Kalman filter: `residuals` holds T before and ν after.
    ///
    /// P and z of the present body stay in memory, for they are more than the registers hold: what a branch of the program
    /// would hand on in registers goes to the stack and back.
    #[inline(always)]
    pub(super) fn sweep_inboard<const WHOLE: bool>(
        &mut self,
        numbers: Range<usize>,
    ) -> Result<(), DynamicsError> {
        let (layout, first) = (self.call.layout, self.first::<WHOLE>());
        let bodies = &layout.bodies[first..first + numbers.end];
        let nothing = RigidInertia::zero();
        for i in numbers.rev() {
            let (k, body) = (first + i, &bodies[i]);
            if body.children == 0 {
                self.given.hand = (RigidInertia::constant(&body.inertia).to_articulated(), Wrench::zero());
            } else {
                for _ in 1..body.children {
                    add_moved(&mut self.given.hand, self.given.pending.take());
                }
            }
            // What goes to the next body gets its own inertia, too.
            let own = if body.follows_parent(k) { &layout.bodies[body.parent].inertia } else { &nothing };
            match body.hinge {
                Hinge::Revolute => self.filter_revolute_body::<WHOLE>(i, body, own)?,
                Hinge::Prismatic => self.filter_prismatic_body::<WHOLE>(i, body, own)?,
                _ => each_kind!(body, |known| self.filter_body::<WHOLE>(i, known, own))?,
            }
            if body.parent != GROUND && !body.follows_parent(k) {
                self.given.pending.put(&self.given.hand);
            }
        }
        Ok(())
    }
    /// Σ φ z⁺ + b.
    #[inline(always)]
    fn bias<const WHOLE: bool>(&self, i: usize, body: &LayoutBody<T::Constant>) -> Wrench<T::Arithmetic> {
        let z = RigidInertia::constant(&body.inertia).gyroscopic(self.moving[i].omega) + self.given.hand.1;
        match self.call.loads {
            Some(loads) => z + loads[self.first::<WHOLE>() + i],
            None => z,
        }
    }
    #[inline(always)]
    fn filter_revolute_body<const WHOLE: bool>(
        &mut self,
        i: usize,
        body: &LayoutBody<T::Constant>,
        own: &RigidInertia<T::Constant>,
    ) -> Result<(), DynamicsError> {
        let v = body.v - self.first_v::<WHOLE>();
        let pivot = match revolute_pivot(&self.given.hand.0) {
            Ok(pivot) => pivot,
            Err((component, D)) => return Err(self.call.layout.singular(body.v + component, D)),
        };
        self.pivots[v] = pivot;
        let coriolis = self.moving[i].coriolis;
        let mut z = self.bias::<WHOLE>(i, body);
        if body.parent == GROUND {
            self.residuals[v] = filter_revolute(&pivot, &mut z, self.residuals[v]);
            return Ok(());
        }
        z += revolute_coriolis_force(&self.given.hand.0, coriolis);
        self.residuals[v] = filter_revolute(&pivot, &mut z, self.residuals[v]);
        let turn = self.shifts.turn(i);
        let own = RigidInertia::constant(own);
        each_shape!(body.link, |link| {
            let here = &mut self.given.hand;
            here.1 = link.wrench_to_parent(&link.hinged(turn), z);
            here.0 = link.eliminated_to_parent(turn, &here.0, &pivot.gain).plus_rigid(&own);
        });
        Ok(())
    }
    #[inline(always)]
    fn filter_prismatic_body<const WHOLE: bool>(
        &mut self,
        i: usize,
        body: &LayoutBody<T::Constant>,
        own: &RigidInertia<T::Constant>,
    ) -> Result<(), DynamicsError> {
        let v = body.v - self.first_v::<WHOLE>();
        let pivot = match prismatic_pivot(&self.given.hand.0) {
            Ok(pivot) => pivot,
            Err((component, D)) => return Err(self.call.layout.singular(body.v + component, D)),
        };
        self.pivots[v] = pivot;
        let coriolis = self.moving[i].coriolis;
        let mut z = self.bias::<WHOLE>(i, body);
        if body.parent == GROUND {
            self.residuals[v] = filter_prismatic(&pivot, &mut z, self.residuals[v]);
            return Ok(());
        }
        // A slider's a does not turn.
        let P = &self.given.hand.0;
        z += Wrench::new(P.coupling * coriolis.linear, P.mass * coriolis.linear);
        self.residuals[v] = filter_prismatic(&pivot, &mut z, self.residuals[v]);
        let shift = *self.shifts.shift(i);
        let own = RigidInertia::constant(own);
        each_shape!(body.link, |link| {
            let here = &mut self.given.hand;
            here.1 = link.wrench_to_parent(&shift, z);
            here.0 = link.slid_to_parent(&shift, &here.0, &pivot.gain).plus_rigid(&own);
        });
        Ok(())
    }
    #[inline(always)]
    fn filter_body<const WHOLE: bool>(
        &mut self,
        i: usize,
        body: &LayoutBody<T::Constant>,
        own: &RigidInertia<T::Constant>,
    ) -> Result<(), DynamicsError> {
        let coriolis = self.moving[i].coriolis;
        let P = self.given.hand.0;
        let mut z = self.bias::<WHOLE>(i, body);
        if body.parent != GROUND {
            z += P.times(coriolis);
        }
        let v = body.v - self.first_v::<WHOLE>();
        let dofs = v..v + body.hinge.nv();
        let pivots = &mut self.pivots[dofs.clone()];
        let passage = self.shifts.at(i, body);
        let moved = match eliminate(body, passage, P, pivots) {
            Ok(moved) => moved,
            Err((component, D)) => return Err(self.call.layout.singular(body.v + component, D)),
        };
        filter(&body.hinge, pivots, &mut z, &mut self.residuals[dofs]);
        self.given.hand = (moved.plus_rigid(&RigidInertia::constant(own)), passage.wrench_to_parent(z));
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
