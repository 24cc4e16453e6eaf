//! The passage from a body to its parent through one joint: φ(p, k), as turns about z, x, z and one shift.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | R | Z(θ₀) X(α) Z(q + θ₁): axes of the body in the parent's; Z, X turn about a coordinate axis | |
//! | l | origin of the body in the parent, before Z(θ₀) | |
//! | φ(p, k) | Z(θ₀) ∘ shift by l ∘ X(α) ∘ Z(q + θ₁) | soa.md 3.0 |
//!
//! The layout turns each body about its joint axis so that θ₀ vanishes for one of its children, and marks α = 0 and
//! α = ±90°, which cost nothing, and hinges whose body has the parent's origin (l = 0), on which columns and velocities are not shifted. Ball
//! and free joints pass through a general rotation.

use crate::hinge::Hinge;
use core::ops::Neg;
use phipsi_spatial::{
    Axis, Mat3, Motion, Quaternion, Real, RigidInertia, Scalar, Transform, Turn, Vec3, Wrench,
};

mod abreast;
mod articulated;
mod compliance;
mod quarter;

/// Angles that cost less than others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Twist {
    /// α = 0.
    Straight,
    /// α = 90°.
    Quarter,
    /// α = −90°.
    BackQuarter,
    /// Any other.
    Oblique,
}

/// Pose of a joint frame in the parent's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link<C> {
    first: Turn<C>,
    twist: Turn<C>,
    last: Turn<C>,
    offset: Vec3<C>,
    pub(crate) shape: Twist,
    pub(crate) has_first: bool,
    /// True of a hinge with l = 0.
    pub(crate) concentric: bool,
}

/// One copy of an expression for every shape of a link without first turn, in which the shape is a constant, so that each
/// copy has no branches; and one for links with a first turn.
///
/// Without optimisation nothing is known of a constant, and the copies would only fill the stack: there is one.
#[cfg(debug_assertions)]
macro_rules! each_shape {
    ($link:expr, |$known:ident| $step:expr) => {{
        let $known = $link;
        $step
    }};
}
#[cfg(not(debug_assertions))]
macro_rules! each_shape {
    ($link:expr, |$known:ident| $step:expr) => {
        match $link.shape {
            _ if $link.has_first => {
                let $known = $link;
                $step
            }
            $crate::link::Twist::Straight => {
                let $known = &$link.known($crate::link::Twist::Straight);
                $step
            }
            $crate::link::Twist::Quarter => {
                let $known = &$link.known($crate::link::Twist::Quarter);
                $step
            }
            $crate::link::Twist::BackQuarter => {
                let $known = &$link.known($crate::link::Twist::BackQuarter);
                $step
            }
            $crate::link::Twist::Oblique => {
                let $known = &$link.known($crate::link::Twist::Oblique);
                $step
            }
        }
    };
}
pub(crate) use each_shape;

/// A link at one configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift<T> {
    /// Z(q + θ₁).
    pub(crate) turn: Turn<T>,
    /// l with what the joint displaces.
    pub(crate) offset: Vec3<T>,
}

impl<T: Scalar> Shift<T> {
    /// The identity.
    #[inline(always)]
    pub fn identity() -> Self {
        Shift { turn: Turn::none(), offset: Vec3::zero() }
    }
}

impl<C: Real> Link<C> {
    /// From the joint frame's pose at q = 0.
    pub fn new(placement: &Transform<C>) -> Self {
        let r = &placement.rotation.0;
        // Third column: (sin θ₀ sin α, −cos θ₀ sin α, cos α).
        let sine = (r[0][2] * r[0][2] + r[1][2] * r[1][2]).sqrt();
        let rounding = C::splat(4.0 * C::EPSILON);
        let first =
            if sine > rounding { Turn { cos: -r[1][2] / sine, sin: r[0][2] / sine } } else { Turn::none() };
        Self::with_first(placement, first)
    }
    /// With θ₀ given: exact to rounding for any θ₀ whose line is right, also where α hardly differs from 0.
    fn with_first(placement: &Transform<C>, first: Turn<C>) -> Self {
        let columns = [0, 1, 2].map(|j| first.down(Axis::Z, placement.rotation.column(j)));
        // X(α) Z(θ₁): first row (cos θ₁, −sin θ₁, 0), last column (0, −sin α, cos α).
        let last = unit(columns[0].0[0], -columns[1].0[0]);
        let mut twist = unit(columns[2].0[2], -columns[2].0[1]);
        let rounding = C::splat(4.0 * C::EPSILON);
        let shape = if twist.sin.abs() <= rounding && twist.cos > C::zero() {
            twist = Turn::none();
            Twist::Straight
        } else if twist.cos.abs() <= rounding {
            let quarter = twist.sin > C::zero();
            twist = Turn { cos: C::zero(), sin: if quarter { C::one() } else { -C::one() } };
            if quarter { Twist::Quarter } else { Twist::BackQuarter }
        } else {
            Twist::Oblique
        };
        Link {
            first,
            twist,
            last,
            offset: first.down(Axis::Z, placement.translation),
            shape,
            has_first: first != Turn::none(),
            concentric: false,
        }
    }
    /// The link of a joint.
    pub(crate) fn of_joint(self, hinge: &Hinge<C>) -> Self {
        let concentric = matches!(hinge, Hinge::Revolute) && self.offset == Vec3::zero();
        Link { concentric, ..self }
    }
    /// θ₀.
    pub(crate) fn first(&self) -> Turn<C> {
        self.first
    }
    /// The same link after the parent's frame was turned by its own θ₀ about z.
    pub(crate) fn without_first(mut self) -> Self {
        (self.first, self.has_first) = (Turn::none(), false);
        self
    }
    /// The same link after the parent's frame was turned by `turn` about z.
    pub(crate) fn with_parent_turned(self, turn: Turn<C>) -> Self {
        let back = Turn { cos: turn.cos, sin: -turn.sin };
        let first = self.first.then(back);
        // Sums of angles have no rounding to hide where the twist is straight: all goes to the last turn.
        if self.shape == Twist::Straight {
            let mut link = self.without_first();
            link.last = first.then(self.last);
            link.offset = first.up(Axis::Z, self.offset);
            return link;
        }
        let link = Link { first, ..self }.facing();
        Link { has_first: link.first != Turn::none(), ..link }
    }
    /// With θ₀ within a quarter turn: Z(θ₀) l, X(α), Z(θ₁) are Z(θ₀ + π) (−l), X(−α), Z(θ₁ + π), where l turns but in z. Siblings
    /// on opposite axes have no first turn then.
    fn facing(mut self) -> Self {
        let back = |turn: Turn<C>| Turn { cos: -turn.cos, sin: -turn.sin };
        if self.first.cos < C::zero() {
            let [x, y, z] = self.offset.0;
            (self.first, self.last, self.twist.sin) = (back(self.first), back(self.last), -self.twist.sin);
            self.offset = Vec3([-x, -y, z]);
            self.shape = match self.shape {
                Twist::Quarter => Twist::BackQuarter,
                Twist::BackQuarter => Twist::Quarter,
                same => same,
            };
        }
        if self.first.sin.abs() <= C::splat(4.0 * C::EPSILON) && self.first.cos > C::zero() {
            self.first = Turn::none();
        }
        self
    }
    /// The same link after the body's own frame was turned by `turn` about z.
    pub(crate) fn with_body_turned(self, turn: Turn<C>) -> Self {
        Link { last: self.last.then(turn), ..self }
    }
    /// Pose of the joint frame in the parent's frame at q = 0.
    pub fn placement(&self) -> Transform<C> {
        let columns = [0, 1, 2].map(|i| self.vector_up(self.last, Vec3::unit(i)));
        let all = columns.map(|c| self.first_up(c));
        Transform::new(Mat3::from_columns(all[0], all[1], all[2]), self.first_up(self.offset))
    }
}

impl<C: Scalar> Link<C> {
    /// The same link, without first turn, of a known shape.
    #[cfg(not(debug_assertions))]
    #[inline(always)]
    pub(crate) fn known(&self, shape: Twist) -> Self {
        Link { shape, has_first: false, ..*self }
    }
    /// X(α).
    #[inline(always)]
    pub(crate) fn twist<T: Scalar<Constant = C>>(&self) -> Turn<T> {
        Turn::constant(&self.twist)
    }
    /// Z(θ₀) where it turns.
    #[inline(always)]
    pub(crate) fn first_turn<T: Scalar<Constant = C>>(&self) -> Option<Turn<T>> {
        if self.has_first { Some(Turn::constant(&self.first)) } else { None }
    }
    /// The link at q = 0: what a hinge about z keeps of it at all angles is the offset.
    pub(crate) fn at_rest<T: Scalar<Constant = C>>(&self) -> Shift<T> {
        self.hinged(Turn::constant(&self.last))
    }
    /// Z(q + θ₁).
    #[inline(always)]
    pub(crate) fn turned<T: Scalar<Constant = C>>(&self, q: T) -> Turn<T> {
        self.turned_by(Turn::by(q))
    }
    /// Z(q + θ₁) of Z(q).
    #[inline(always)]
    pub(crate) fn turned_by<T: Scalar<Constant = C>>(&self, q: Turn<T>) -> Turn<T> {
        q.then(Turn::constant(&self.last))
    }
    /// The link of a hinge about z that is turned.
    #[inline(always)]
    pub(crate) fn hinged<T: Scalar<Constant = C>>(&self, turn: Turn<T>) -> Shift<T> {
        Shift { turn, offset: Vec3::constant(self.offset) }
    }
    /// The link at coordinates `q` of its own joint, and for a joint that turns about no fixed axis the pose itself.
    #[inline(always)]
    pub(crate) fn at<T: Scalar<Constant = C>>(
        &self,
        hinge: &Hinge<C>,
        q: &[T],
    ) -> (Shift<T>, Option<Transform<T>>) {
        let offset = Vec3::constant(self.offset);
        let last = Turn::constant(&self.last);
        let shift = match hinge {
            Hinge::Revolute => self.hinged(self.turned(q[0])),
            Hinge::Prismatic => Shift { turn: last, offset: offset + self.axis::<T>().scale(q[0]) },
            Hinge::Helical { pitch } => Shift {
                turn: Turn::by(q[0]).then(last),
                offset: offset + self.axis::<T>().scale(T::constant(*pitch) * q[0]),
            },
            Hinge::Cylindrical => {
                Shift { turn: Turn::by(q[0]).then(last), offset: offset + self.axis::<T>().scale(q[1]) }
            }
            Hinge::Planar => Shift {
                turn: Turn::by(q[2]).then(last),
                offset: offset + self.vector_up(last, Vec3([q[0], q[1], T::zero()])),
            },
            Hinge::Translation => {
                Shift { turn: last, offset: offset + self.vector_up(last, Vec3([q[0], q[1], q[2]])) }
            }
            Hinge::Spherical => {
                let r = Quaternion([q[0], q[1], q[2], q[3]]).to_rotation();
                return (Shift::identity(), Some(self.general(&r, offset)));
            }
            Hinge::Free => {
                let r = Quaternion([q[3], q[4], q[5], q[6]]).to_rotation();
                let moved = offset + self.vector_up(last, Vec3([q[0], q[1], q[2]]));
                return (Shift::identity(), Some(self.general(&r, moved)));
            }
        };
        (shift, None)
    }
    /// The joint's axis, before Z(θ₀).
    #[inline(always)]
    fn axis<T: Scalar<Constant = C>>(&self) -> Vec3<T> {
        Vec3([T::zero(), -T::constant(self.twist.sin), T::constant(self.twist.cos)])
    }
    #[inline(always)]
    fn general<T: Scalar<Constant = C>>(&self, r: &Mat3<T>, offset: Vec3<T>) -> Transform<T> {
        let last = Turn::constant(&self.last);
        let x = self.first_up(self.vector_up(last, r.column(0)));
        let y = self.first_up(self.vector_up(last, r.column(1)));
        let z = self.first_up(self.vector_up(last, r.column(2)));
        Transform::new(Mat3::from_columns(x, y, z), self.first_up(offset))
    }
    /// The pose of the body in its parent.
    #[inline(always)]
    pub(crate) fn pose<T: Scalar<Constant = C>>(&self, shift: &Shift<T>) -> Transform<T> {
        let (Turn { cos, sin }, o) = (shift.turn, T::zero());
        let x = self.first_up(self.twist_up(Vec3([cos, sin, o])));
        let y = self.first_up(self.twist_up(Vec3([-sin, cos, o])));
        let z = self.first_up(self.axis());
        Transform::new(Mat3::from_columns(x, y, z), self.first_up(shift.offset))
    }

    #[inline(always)]
    fn twist_up<T: Scalar<Constant = C>>(&self, v: Vec3<T>) -> Vec3<T> {
        let [x, y, z] = v.0;
        match self.shape {
            Twist::Straight => v,
            Twist::Quarter => Vec3([x, -z, y]),
            Twist::BackQuarter => Vec3([x, z, -y]),
            Twist::Oblique => Turn::constant(&self.twist).up(Axis::X, v),
        }
    }
    #[inline(always)]
    fn twist_down<T: Scalar<Constant = C>>(&self, v: Vec3<T>) -> Vec3<T> {
        let [x, y, z] = v.0;
        match self.shape {
            Twist::Straight => v,
            Twist::Quarter => Vec3([x, z, -y]),
            Twist::BackQuarter => Vec3([x, -z, y]),
            Twist::Oblique => Turn::constant(&self.twist).down(Axis::X, v),
        }
    }
    #[inline(always)]
    fn vector_up<T: Scalar<Constant = C>>(&self, turn: Turn<T>, v: Vec3<T>) -> Vec3<T> {
        self.twist_up(turn.up(Axis::Z, v))
    }
    #[inline(always)]
    fn vector_down<T: Scalar<Constant = C>>(&self, turn: Turn<T>, v: Vec3<T>) -> Vec3<T> {
        turn.down(Axis::Z, self.twist_down(v))
    }
    #[inline(always)]
    fn first_up<T: Scalar<Constant = C>>(&self, v: Vec3<T>) -> Vec3<T> {
        if self.has_first { Turn::constant(&self.first).up(Axis::Z, v) } else { v }
    }
    #[inline(always)]
    fn first_down<T: Scalar<Constant = C>>(&self, v: Vec3<T>) -> Vec3<T> {
        if self.has_first { Turn::constant(&self.first).down(Axis::Z, v) } else { v }
    }
    /// φ(p, k) f.
    #[inline(always)]
    pub(crate) fn wrench_to_parent<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        f: Wrench<T>,
    ) -> Wrench<T> {
        let force = self.vector_up(shift.turn, f.force);
        let mut moment = self.vector_up(shift.turn, f.moment);
        if !self.concentric {
            moment = shift.offset.cross_add(force, moment);
        }
        Wrench::new(self.first_up(moment), self.first_up(force))
    }
    /// φ*(p, k) V.
    #[inline(always)]
    pub(crate) fn motion_to_child<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        v: Motion<T>,
    ) -> Motion<T> {
        let angular = self.first_down(v.angular);
        let linear = angular.cross_add(shift.offset, self.first_down(v.linear));
        Motion::new(self.vector_down(shift.turn, angular), self.vector_down(shift.turn, linear))
    }
    /// φ*(p, k) V and a motion of the body.
    #[inline(always)]
    pub(crate) fn motion_to_child_plus<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        v: Motion<T>,
        plus: &Motion<T>,
    ) -> Motion<T> {
        let angular = self.first_down(v.angular);
        let linear = angular.cross_add(shift.offset, self.first_down(v.linear));
        Motion::new(
            shift.turn.down_plus(self.twist_down(angular), plus.angular),
            shift.turn.down_plus(self.twist_down(linear), plus.linear),
        )
    }
    /// Rᵀ ω and Rᵀ (ω × (ω × l)): what the parent's turning gives the body.
    #[inline(always)]
    pub(crate) fn carried<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        omega: Vec3<T>,
    ) -> (Vec3<T>, Vec3<T>) {
        let omega = self.first_down(omega);
        let centripetal = omega.cross(omega.cross(shift.offset));
        (self.vector_down(shift.turn, omega), self.vector_down(shift.turn, centripetal))
    }
    /// Rᵀ ω and φ*(p, k) α with Rᵀ (ω × (ω × l)): what the parent's motion gives the body.
    #[inline(always)]
    pub(crate) fn carried_along<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        (omega, alpha): (Vec3<T>, Motion<T>),
    ) -> (Vec3<T>, Motion<T>) {
        let (omega, angular) = (self.first_down(omega), self.first_down(alpha.angular));
        let mut linear = self.first_down(alpha.linear);
        if !self.concentric {
            let tangential = angular.cross_add(shift.offset, linear);
            linear = omega.cross_add(omega.cross(shift.offset), tangential);
        }
        let alpha = Motion::new(self.vector_down(shift.turn, angular), self.vector_down(shift.turn, linear));
        (self.vector_down(shift.turn, omega), alpha)
    }
    /// φ(p, k) M φ*(p, k) + `own`.
    #[inline(always)]
    pub(crate) fn rigid_onto_parent<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        M: &RigidInertia<T>,
        own: &RigidInertia<T>,
    ) -> RigidInertia<T> {
        if self.has_first {
            return self.rigid_to_parent(shift, M) + *own;
        }
        self.twisted_rigid(shift, M).shifted_onto(shift.offset, own)
    }
    /// Three axes of the parent, in any frame, turned into the body's; and the body's origin from the parent's, there.
    #[inline(always)]
    pub(crate) fn axes_to_child<T: Scalar<Constant = C>, V: Direction<T>>(
        &self,
        shift: &Shift<T>,
        axes: [V; 3],
    ) -> ([V; 3], V) {
        let [mut x, mut y, mut z] = axes;
        if self.has_first {
            (x, y) = turned(Turn::constant(&self.first), x, y);
        }
        let [a, b, c] = shift.offset.0;
        let origin = x.scale_add(a, y.scale_add(b, z.scale(c)));
        match self.shape {
            Twist::Straight => {}
            Twist::Quarter => (y, z) = (z, -y),
            Twist::BackQuarter => (y, z) = (-z, y),
            Twist::Oblique => (y, z) = turned(Turn::constant(&self.twist), y, z),
        }
        (x, y) = turned(shift.turn, x, y);
        ([x, y, z], origin)
    }
    /// M in axes after Z(θ₀), about the body's origin.
    #[inline(always)]
    fn twisted_rigid<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        M: &RigidInertia<T>,
    ) -> RigidInertia<T> {
        let turned = shift.turn.rigid_up(Axis::Z, M);
        RigidInertia {
            mass: turned.mass,
            first_moment: self.twist_up(turned.first_moment),
            inertia: self.twist_symmetric(&turned.inertia),
        }
    }
    /// φ(p, k) M φ*(p, k).
    #[inline(always)]
    pub(crate) fn rigid_to_parent<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        M: &RigidInertia<T>,
    ) -> RigidInertia<T> {
        let shifted = self.twisted_rigid(shift, M).shifted(shift.offset);
        if self.has_first { Turn::constant(&self.first).rigid_up(Axis::Z, &shifted) } else { shifted }
    }
}

/// Two axes turned in their plane.
#[inline(always)]
fn turned<T: Scalar, V: Direction<T>>(turn: Turn<T>, a: V, b: V) -> (V, V) {
    (a.scale_add(turn.cos, b.scale(turn.sin)), b.scale_add(turn.cos, a.scale(-turn.sin)))
}

/// A vector that is turned as a whole: of numbers, or in one register.
pub(crate) trait Direction<T>: Copy + Neg<Output = Self> {
    fn scale(self, x: T) -> Self;
    /// Self times `x`, and another.
    fn scale_add(self, x: T, other: Self) -> Self;
}

impl<T: Scalar> Direction<T> for Vec3<T> {
    #[inline(always)]
    fn scale(self, x: T) -> Self {
        Vec3::scale(self, x)
    }
    #[inline(always)]
    fn scale_add(self, x: T, other: Self) -> Self {
        Vec3::scale_add(self, x, other)
    }
}

/// (c, s) of length one.
fn unit<C: Real>(c: C, s: C) -> Turn<C> {
    let length = (c * c + s * s).sqrt();
    Turn { cos: c / length, sin: s / length }
}
