//! Sums over a body and all outboard of it, from which the columns of the derivatives begin. Symbols: those of
//! [`crate::inverse_dynamics_derivatives`].

use super::{FORCE, MOMENT, MOMENTUM};
use crate::ground_axes::COMPOSITE;
use crate::places::Group;
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{Mat3, RigidInertia, Scalar, Sym3, Vec3, Wrench};

/// Sums over a body and all outboard of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Composite<T> {
    /// R.
    pub(super) inertia: RigidInertia<T>,
    /// −2N.
    pub(super) moment: Mat3<T>,
    /// −2l.
    pub(super) momentum: Vec3<T>,
    /// f.
    pub(super) force: Wrench<T>,
}

impl<T: Scalar> Composite<T> {
    /// The sums of one body; its force without that of its acceleration.
    #[inline(always)]
    pub(super) fn of_body(M: &RigidInertia<T>, omega: Vec3<T>) -> Self {
        // −2ω~Σ₂ with 2Σ₂ = tr(J) 1 − 2J: second moments of mass.
        let J = M.inertia;
        let trace = J.xx + J.yy + J.zz;
        let two = T::splat(2.0);
        let second = Sym3::diagonal(trace) + scaled(&J, -two);
        Composite {
            inertia: *M,
            moment: Mat3::from_columns(
                second.column(0).cross(omega),
                second.column(1).cross(omega),
                second.column(2).cross(omega),
            ),
            momentum: M.first_moment.cross(omega).scale(two),
            force: M.gyroscopic(omega),
        }
    }
    /// −2B x of an angular change of velocity.
    #[inline(always)]
    pub(super) fn gyroscopic(&self, x: Vec3<T>) -> Wrench<T> {
        Wrench::new(self.moment * x, self.momentum.cross(x))
    }
    /// Moved to the parent's origin, by d, and to its frame of reference; `drift` is −2u.
    #[inline(always)]
    pub(super) fn shifted(&self, d: Vec3<T>, drift: Vec3<T>) -> Self {
        let (inertia, l, mut moment) = (self.inertia.shifted(d), self.momentum, self.moment);
        let h = inertia.first_moment;
        let trace = d.dot(l) + h.dot(drift);
        for i in 0..3 {
            let row = h.scale_add(drift.0[i], d.scale_add(l.0[i], Vec3(moment.0[i])));
            moment.0[i] = row.0;
            moment.0[i][i] -= trace;
        }
        let force = self.force;
        Composite {
            inertia,
            moment,
            momentum: drift.scale_add(inertia.mass, l),
            force: Wrench::new(d.cross_add(force.force, force.moment), force.force),
        }
    }
    #[inline(always)]
    pub(super) fn plus(&self, other: &Self) -> Self {
        Composite {
            inertia: self.inertia + other.inertia,
            moment: self.moment + other.moment,
            momentum: self.momentum + other.momentum,
            force: self.force + other.force,
        }
    }
    #[inline(always)]
    pub(super) fn get<U: Scalar, const N: usize>(group: &Group<'_, U, N>) -> Self
    where
        T: Wide<U>,
    {
        Composite {
            inertia: group.rigid(COMPOSITE),
            moment: group.matrix(MOMENT),
            momentum: group.vector(MOMENTUM),
            force: group.wrench(FORCE),
        }
    }
    #[inline(always)]
    pub(super) fn put<U: Scalar, const N: usize>(&self, group: &mut Group<'_, U, N>)
    where
        T: Wide<U>,
    {
        group.set_rigid(COMPOSITE, &self.inertia);
        group.set_matrix(MOMENT, &self.moment);
        group.set_vector(MOMENTUM, self.momentum);
        group.set_wrench(FORCE, self.force);
    }
}

#[inline(always)]
fn scaled<T: Scalar>(a: &Sym3<T>, s: T) -> Sym3<T> {
    Sym3 { xx: a.xx * s, xy: a.xy * s, xz: a.xz * s, yy: a.yy * s, yz: a.yz * s, zz: a.zz * s }
}
