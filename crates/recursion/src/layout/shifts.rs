//! The shift operators φ(p, k) of a layout at one configuration.

use super::{Branch, Layout, LayoutBody, carve};
use crate::hinge::{Hinge, combine};
use crate::link::Shift;
use core::ops::Range;
use phipsi_spatial::{Motion, RigidInertia, Scalar, Transform, Turn, Vec3, Wrench};

/// φ(p, k) of all bodies at one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Shifts<T> {
    shift: Vec<Shift<T>>,
    general: Vec<Transform<T>>,
    /// Where sines are taken together: of all hinges, by their coordinates, or of the first coordinates of some bodies. As many as bodies at
    /// least, so that each run of bodies has some to work with.
    q: Vec<T>,
    sin: Vec<T>,
    cos: Vec<T>,
}

/// Bodies of a run whose sines are taken together: they cost less so, and stay in the nearest cache until they are used.
pub(crate) const TOGETHER: usize = 256;

/// One number has lanes for the sines of several coordinates; lanes of states are full with one.
const fn sines_together<T: Scalar>() -> bool {
    T::LANES == 1
}

impl<T: Scalar> Shifts<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let general = layout.bodies.iter().filter(|b| b.is_general()).count();
        let together = sines_together::<T>();
        let (n, nq) = if together { (layout.len(), layout.nq()) } else { (0, 0) };
        // Registers are written as a whole, the last one beyond the last angle.
        let room = nq + T::COLUMNS;
        Shifts {
            shift: layout.bodies.iter().map(|b| b.link.at_rest()).collect(),
            general: vec![Transform::identity(); general],
            q: vec![T::zero(); n],
            sin: vec![T::zero(); room],
            cos: vec![T::one(); room],
        }
    }
    #[inline(always)]
    pub(crate) fn set_all(&mut self, layout: &Layout<T::Constant>, q: &[T]) {
        let mut run = self.run();
        run.begin_all(layout, q);
        for (k, body) in layout.bodies.iter().enumerate() {
            run.set::<true>(k, k, body, q);
        }
    }
    /// The turn of a body on a hinge.
    #[inline(always)]
    pub(crate) fn turn(&self, k: usize) -> Turn<T> {
        self.shift[k].turn
    }
    pub(crate) fn all(&self) -> &[Shift<T>] {
        &self.shift
    }
    /// The shift of body `k`.
    #[inline(always)]
    pub(crate) fn at<'a>(&'a self, k: usize, body: &'a LayoutBody<T::Constant>) -> Passage<'a, T> {
        let general = if body.is_general() { Some(&self.general[body.general]) } else { None };
        Passage { body, shift: &self.shift[k], general }
    }
    /// Those of all bodies, as a run.
    #[inline(always)]
    pub(crate) fn run(&mut self) -> ShiftRun<'_, T> {
        let Shifts { shift, general, q, sin, cos } = self;
        ShiftRun { shift, general, first_general: 0, q, sin, cos }
    }
}

/// φ(p, k) of a run of bodies, numbered from the run's first.
pub(crate) struct ShiftRun<'a, T> {
    shift: &'a mut [Shift<T>],
    general: &'a mut [Transform<T>],
    first_general: usize,
    q: &'a mut [T],
    sin: &'a mut [T],
    cos: &'a mut [T],
}

impl<T: Scalar> ShiftRun<'_, T> {
    /// The same run, lent.
    pub(crate) fn again(&mut self) -> ShiftRun<'_, T> {
        let ShiftRun { shift, general, first_general, q, sin, cos } = self;
        ShiftRun { shift, general, first_general: *first_general, q, sin, cos }
    }
    /// Takes the sines of all hinges.
    #[inline(always)]
    pub(crate) fn begin_all(&mut self, layout: &Layout<T::Constant>, q: &[T]) {
        if sines_together::<T>() {
            let Range { start, end } = layout.angles;
            T::sin_cos_all(&q[start..end], &mut self.sin[start..], &mut self.cos[start..]);
        }
    }
    /// Takes the sines of some bodies' first coordinates, whose shifts are set next.
    #[inline(always)]
    pub(crate) fn begin(&mut self, bodies: &[LayoutBody<T::Constant>], q: &[T]) {
        if !sines_together::<T>() || !bodies.iter().any(|b| matches!(b.hinge, Hinge::Revolute)) {
            return;
        }
        let count = bodies.len();
        for (x, body) in self.q.iter_mut().zip(bodies) {
            *x = q[body.q];
        }
        T::sin_cos_all(&self.q[..count], self.sin, self.cos);
    }
    /// Z(q + θ₁) of a hinge. Sines are those of `ALL` hinges, or the `i`th of the bodies that [`ShiftRun::begin`] took.
    #[inline(always)]
    pub(crate) fn turned<const ALL: bool>(
        &self,
        i: usize,
        body: &LayoutBody<T::Constant>,
        q: &[T],
    ) -> Turn<T> {
        if sines_together::<T>() {
            let i = if ALL { body.q } else { i };
            body.link.turned_by(Turn { cos: self.cos[i], sin: self.sin[i] })
        } else {
            body.link.turned(q[body.q])
        }
    }
    /// Sets the shift of body number `k`; `ALL` and `i` as in [`ShiftRun::turned`].
    #[inline(always)]
    pub(crate) fn set<const ALL: bool>(
        &mut self,
        k: usize,
        i: usize,
        body: &LayoutBody<T::Constant>,
        q: &[T],
    ) {
        if let Hinge::Revolute = body.hinge {
            self.shift[k].turn = self.turned::<ALL>(i, body, q);
            return;
        }
        let (shift, general) = body.link.at(&body.hinge, &q[body.q..]);
        self.shift[k] = shift;
        if let Some(pose) = general {
            self.general[body.general - self.first_general] = pose;
        }
    }
    #[inline(always)]
    pub(crate) fn set_turn(&mut self, k: usize, turn: Turn<T>) {
        self.shift[k].turn = turn;
    }
    /// The shift of body number `k`, its own offset included.
    #[inline(always)]
    pub(crate) fn shift(&self, k: usize) -> &Shift<T> {
        &self.shift[k]
    }
    /// The turn of a body on a hinge.
    #[inline(always)]
    pub(crate) fn turn(&self, k: usize) -> Turn<T> {
        self.shift[k].turn
    }
    /// The shift of body number `k`.
    #[inline(always)]
    pub(crate) fn at<'b>(&'b self, k: usize, body: &'b LayoutBody<T::Constant>) -> Passage<'b, T> {
        let general =
            if body.is_general() { Some(&self.general[body.general - self.first_general]) } else { None };
        Passage { body, shift: &self.shift[k], general }
    }
    /// Those of a branch's branches.
    pub(crate) fn carve(&mut self, branch: &Branch) -> Vec<ShiftRun<'_, T>> {
        let ShiftRun { shift, general, q, sin, cos, .. } = self;
        let (runs, first) = (&branch.branches, branch.bodies.start);
        let bodies = || runs.iter().map(|b| b.bodies.clone());
        let mut general =
            carve(general, branch.general.start, runs.iter().map(|b| b.general.clone())).into_iter();
        let mut sines = carve(q, first, bodies()).into_iter().zip(carve(sin, first, bodies())).zip(carve(
            cos,
            first,
            bodies(),
        ));
        let each = carve(shift, first, bodies()).into_iter().zip(runs);
        each.map_while(|(shift, b)| {
            let ((q, sin), cos) = sines.next()?;
            let (general, first_general) = (general.next()?, b.general.start);
            Some(ShiftRun { shift, general, first_general, q, sin, cos })
        })
        .collect()
    }
}

/// φ(p, k) of one body.
#[derive(Clone, Copy)]
pub(crate) struct Passage<'a, T: Scalar> {
    pub(super) body: &'a LayoutBody<T::Constant>,
    pub(crate) shift: &'a Shift<T>,
    pub(crate) general: Option<&'a Transform<T>>,
}

impl<T: Scalar> Passage<'_, T> {
    /// The pose of the body in its parent.
    #[inline(always)]
    pub(crate) fn pose(&self) -> Transform<T> {
        match self.general {
            Some(x) => *x,
            None => self.body.link.pose(self.shift),
        }
    }
    /// φ f.
    #[inline(always)]
    pub(crate) fn wrench_to_parent(&self, f: Wrench<T>) -> Wrench<T> {
        match self.general {
            Some(x) => x.wrench_to_parent(f),
            None => self.body.link.wrench_to_parent(self.shift, f),
        }
    }
    /// φ* V.
    #[inline(always)]
    pub(crate) fn motion_to_child(&self, v: Motion<T>) -> Motion<T> {
        match self.general {
            Some(x) => x.motion_to_child(v),
            None => self.body.link.motion_to_child(self.shift, v),
        }
    }
    /// Rᵀ ω and Rᵀ (ω × (ω × l)) of the parent's ω.
    #[inline(always)]
    pub(crate) fn carried(&self, omega: Vec3<T>) -> (Vec3<T>, Vec3<T>) {
        match self.general {
            Some(x) => {
                let centripetal = omega.cross(omega.cross(x.translation));
                (x.rotation.transpose_mul(omega), x.rotation.transpose_mul(centripetal))
            }
            None => self.body.link.carried(self.shift, omega),
        }
    }
    /// φ P φ*.
    #[inline(always)]
    pub(crate) fn articulated_to_parent(
        &self,
        P: &phipsi_spatial::ArticulatedInertia<T>,
    ) -> phipsi_spatial::ArticulatedInertia<T> {
        match self.general {
            Some(x) => x.articulated_to_parent(P),
            None => self.body.link.articulated_to_parent(self.shift, P),
        }
    }
    /// φ* Y φ of a compliance whose halves are exchanged ([`crate::upsilon::Compliance`]).
    #[inline(always)]
    pub(crate) fn compliance_to_child(
        &self,
        Y: &phipsi_spatial::ArticulatedInertia<T>,
    ) -> phipsi_spatial::ArticulatedInertia<T> {
        match self.general {
            Some(x) => x.inverse().articulated_to_parent(Y),
            None => self.body.link.compliance_to_child(self.shift, Y),
        }
    }
    /// φ M φ* + `own`.
    #[inline(always)]
    pub(crate) fn rigid_onto_parent(&self, M: &RigidInertia<T>, own: &RigidInertia<T>) -> RigidInertia<T> {
        match self.general {
            Some(x) => x.rigid_to_parent(M) + *own,
            None => self.body.link.rigid_onto_parent(self.shift, M, own),
        }
    }
    /// The parent's axes, in any frame, turned into the body's; and the body's origin from the parent's, there.
    #[inline(always)]
    pub(crate) fn axes_to_child(&self, axes: [Vec3<T>; 3]) -> ([Vec3<T>; 3], Vec3<T>) {
        let Some(x) = self.general else { return self.body.link.axes_to_child(self.shift, axes) };
        let own = |i: usize| combine(&axes, x.rotation.column(i));
        ([own(0), own(1), own(2)], combine(&axes, x.translation))
    }
    /// φ M φ*.
    #[inline(always)]
    pub(crate) fn rigid_to_parent(&self, M: &RigidInertia<T>) -> RigidInertia<T> {
        match self.general {
            Some(x) => x.rigid_to_parent(M),
            None => self.body.link.rigid_to_parent(self.shift, M),
        }
    }
}
