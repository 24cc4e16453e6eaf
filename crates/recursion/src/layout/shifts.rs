//! The shift operators φ(p, k) of a layout at one configuration.

use super::{Layout, LayoutBody};
use crate::hinge::{Hinge, combine};
use crate::link::Shift;
use phipsi_spatial::{Motion, RigidInertia, Scalar, Transform, Turn, Vec3, Wrench};

/// φ(p, k) of all bodies at one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Shifts<T> {
    shift: Vec<Shift<T>>,
    general: Vec<Transform<T>>,
    /// Of every coordinate, where they cost less together.
    sin: Vec<T>,
    cos: Vec<T>,
}

impl<T: Scalar> Shifts<T> {
    /// One number has lanes for the sines of several coordinates; lanes of states are full with one.
    const TOGETHER: bool = T::LANES == 1;

    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let general = layout.bodies.iter().filter(|b| b.is_general()).count();
        Shifts {
            shift: layout.bodies.iter().map(|b| b.link.at_rest()).collect(),
            general: vec![Transform::identity(); general],
            sin: vec![T::zero(); if Self::TOGETHER { layout.nq() } else { 0 }],
            cos: vec![T::one(); if Self::TOGETHER { layout.nq() } else { 0 }],
        }
    }
    /// Takes the coordinates that the next shifts are set at.
    #[inline(always)]
    pub(crate) fn begin(&mut self, q: &[T]) {
        if Self::TOGETHER {
            T::sin_cos_all(q, &mut self.sin, &mut self.cos);
        }
    }
    /// Sets the shift of body `k`, at the coordinates that [`Shifts::begin`] took.
    #[inline(always)]
    pub(crate) fn set(&mut self, k: usize, body: &LayoutBody<T::Constant>, q: &[T]) {
        if let Hinge::Revolute = body.hinge {
            self.shift[k].turn = self.turned(body, q);
            return;
        }
        let (shift, general) = body.link.at(&body.hinge, &q[body.q..]);
        self.shift[k] = shift;
        if let Some(pose) = general {
            self.general[body.general] = pose;
        }
    }
    #[inline(always)]
    pub(crate) fn set_all(&mut self, layout: &Layout<T::Constant>, q: &[T]) {
        self.begin(q);
        for (k, body) in layout.bodies.iter().enumerate() {
            self.set(k, body, q);
        }
    }
    /// Z(q + θ₁) of a body on a hinge, at the coordinates that [`Shifts::begin`] took.
    #[inline(always)]
    pub(crate) fn turned(&self, body: &LayoutBody<T::Constant>, q: &[T]) -> Turn<T> {
        if Self::TOGETHER {
            body.link.turned_by(Turn { cos: self.cos[body.q], sin: self.sin[body.q] })
        } else {
            body.link.turned(q[body.q])
        }
    }
    /// The turn of a body on a hinge.
    #[inline(always)]
    pub(crate) fn turn(&self, k: usize) -> Turn<T> {
        self.shift[k].turn
    }
    #[inline(always)]
    pub(crate) fn set_turn(&mut self, k: usize, turn: Turn<T>) {
        self.shift[k].turn = turn;
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
        let [a, b, c] = [0, 1, 2].map(|i| x.rotation.column(i));
        ([combine(&axes, a), combine(&axes, b), combine(&axes, c)], combine(&axes, x.translation))
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
