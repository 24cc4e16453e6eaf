//! One joint of the layout: its hinge map H* and its transform.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | H* | hinge map: columns are the joint's axes in the child frame | 6×r | paper 2 (2.3) |
//! | X | pose of the child frame in the parent's frame, with φ(p, k) its action on wrenches | | soa.md 3.0 |
//!
//! Axes are coordinate axes of the child frame, so that H* is a choice of columns of the identity (helical: one column
//! with two entries) and never multiplied.

use phipsi_spatial::{Mat3, Motion, Quaternion, Scalar, Transform, Vec3, Wrench};

/// A joint of the layout, axis along z. A universal joint is two hinges in a layout, a fixed one none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hinge<C> {
    /// Rotation about z.
    Revolute,
    /// Translation along z.
    Prismatic,
    /// Rotation about z with `pitch` metres along z for every radian.
    Helical {
        /// m/rad.
        pitch: C,
    },
    /// Rotation about, translation along z.
    Cylindrical,
    /// Motion in the x-y plane.
    Planar,
    /// Translation along x, y, z.
    Translation,
    /// Rotation about a point.
    Spherical,
    /// Six degrees of freedom.
    Free,
}

/// Does a step for every degree of freedom `i` of a hinge, in order or `reversed`; `$c` is its component of a six-vector, a
/// constant in each copy of the step, so that components are registers and not memory. Helical joints, whose axis has two
/// components, are left to `$helical`.
macro_rules! each_component {
    ($hinge:expr, |$i:ident, $c:ident| $step:expr, $helical:expr) => {
        each_component!(@ $hinge, $i, $c, $step, $helical,
            [(0, 2), (1, 5)], [(0, 2), (1, 3), (2, 4)], [(0, 3), (1, 4), (2, 5)], [(0, 0), (1, 1), (2, 2)],
            [(0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5)])
    };
    (reversed $hinge:expr, |$i:ident, $c:ident| $step:expr, $helical:expr) => {
        each_component!(@ $hinge, $i, $c, $step, $helical,
            [(1, 5), (0, 2)], [(2, 4), (1, 3), (0, 2)], [(2, 5), (1, 4), (0, 3)], [(2, 2), (1, 1), (0, 0)],
            [(5, 5), (4, 4), (3, 3), (2, 2), (1, 1), (0, 0)])
    };
    (@ $hinge:expr, $i:ident, $c:ident, $step:expr, $helical:expr,
        $cylindrical:tt, $planar:tt, $translation:tt, $spherical:tt, $free:tt) => {
        match $hinge {
            $crate::hinge::Hinge::Revolute => each_component!(@@ $i, $c, $step, [(0, 2)]),
            $crate::hinge::Hinge::Prismatic => each_component!(@@ $i, $c, $step, [(0, 5)]),
            $crate::hinge::Hinge::Helical { .. } => $helical,
            $crate::hinge::Hinge::Cylindrical => each_component!(@@ $i, $c, $step, $cylindrical),
            $crate::hinge::Hinge::Planar => each_component!(@@ $i, $c, $step, $planar),
            $crate::hinge::Hinge::Translation => each_component!(@@ $i, $c, $step, $translation),
            $crate::hinge::Hinge::Spherical => each_component!(@@ $i, $c, $step, $spherical),
            $crate::hinge::Hinge::Free => each_component!(@@ $i, $c, $step, $free),
        }
    };
    (@@ $i:ident, $c:ident, $step:expr, [$(($n:literal, $component:literal)),*]) => {{
        $({
            const $i: usize = $n;
            const $c: usize = $component;
            $step
        })*
    }};
}
pub(crate) use each_component;

impl<C> Hinge<C> {
    /// Components of a six-vector (angular first) that the joint's degrees of freedom are, in the order of v.
    #[inline(always)]
    pub fn components(&self) -> &'static [usize] {
        match self {
            Hinge::Revolute | Hinge::Helical { .. } => &[2],
            Hinge::Prismatic => &[5],
            Hinge::Cylindrical => &[2, 5],
            Hinge::Planar => &[2, 3, 4],
            Hinge::Translation => &[3, 4, 5],
            Hinge::Spherical => &[0, 1, 2],
            Hinge::Free => &[0, 1, 2, 3, 4, 5],
        }
    }
    /// Number of degrees of freedom.
    #[inline(always)]
    pub fn nv(&self) -> usize {
        self.components().len()
    }
}

impl<C: Copy> Hinge<C> {
    /// H* x.
    #[inline(always)]
    pub fn expand<T: Scalar<Constant = C>>(&self, x: &[T]) -> Motion<T> {
        let o = T::zero();
        match self {
            Hinge::Revolute => Motion::new(Vec3([o, o, x[0]]), Vec3::zero()),
            Hinge::Prismatic => Motion::new(Vec3::zero(), Vec3([o, o, x[0]])),
            Hinge::Helical { pitch } => {
                Motion::new(Vec3([o, o, x[0]]), Vec3([o, o, T::constant(*pitch) * x[0]]))
            }
            Hinge::Cylindrical => Motion::new(Vec3([o, o, x[0]]), Vec3([o, o, x[1]])),
            Hinge::Planar => Motion::new(Vec3([o, o, x[0]]), Vec3([x[1], x[2], o])),
            Hinge::Translation => Motion::new(Vec3::zero(), Vec3([x[0], x[1], x[2]])),
            Hinge::Spherical => Motion::new(Vec3([x[0], x[1], x[2]]), Vec3::zero()),
            Hinge::Free => Motion::new(Vec3([x[0], x[1], x[2]]), Vec3([x[3], x[4], x[5]])),
        }
    }
    /// c = (0, δω × δv) for (δω, δv) = H* v: what the turning of the child's axes adds to H* v̇. It lies in the range of H*,
    /// and is not zero for planar and free joints only.
    #[inline(always)]
    pub fn turning<T: Scalar<Constant = C>>(&self, v: &[T]) -> Motion<T> {
        match self {
            Hinge::Planar | Hinge::Free => {
                let joint = self.expand(v);
                Motion::new(Vec3::zero(), joint.angular.cross(joint.linear))
            }
            _ => Motion::zero(),
        }
    }
    /// a −= the components of c along the joint's axes.
    #[inline(always)]
    pub fn subtract_turning<T: Scalar<Constant = C>>(&self, v: &[T], a: &mut [T]) {
        if matches!(self, Hinge::Planar | Hinge::Free) {
            let c = self.turning(v);
            for (a, &i) in a.iter_mut().zip(self.components()) {
                *a -= c.get(i);
            }
        }
    }
    /// The i-th axis: column i of H*.
    #[inline(always)]
    pub fn axis<T: Scalar<Constant = C>>(&self, i: usize) -> Motion<T> {
        let mut axis = Motion::unit(self.components()[i]);
        if let Hinge::Helical { pitch } = self {
            axis.linear.0[2] = T::constant(*pitch);
        }
        axis
    }
    /// The i-th component of H f.
    #[inline(always)]
    pub fn project<T: Scalar<Constant = C>>(&self, i: usize, f: &Wrench<T>) -> T {
        let along = f.get(self.components()[i]);
        match self {
            Hinge::Helical { pitch } => along + T::constant(*pitch) * f.force.0[2],
            _ => along,
        }
    }
    /// Adds the i-th axis times x to a motion.
    #[inline(always)]
    pub fn add_axis<T: Scalar<Constant = C>>(&self, i: usize, x: T, to: &mut Motion<T>) {
        to.add_to(self.components()[i], x);
        if let Hinge::Helical { pitch } = self {
            to.linear.0[2] += T::constant(*pitch) * x;
        }
    }
    /// The pose of the child frame in the parent's, from the constant pose of the joint frame and the coordinates.
    #[inline(always)]
    pub fn transform<T: Scalar<Constant = C>>(&self, placement: &Transform<C>, q: &[T]) -> Transform<T> {
        let fixed = Transform::constant(placement);
        match self {
            Hinge::Revolute => turned(&fixed, q[0]),
            Hinge::Prismatic => moved(&fixed, q[0]),
            Hinge::Helical { pitch } => turned(&moved(&fixed, T::constant(*pitch) * q[0]), q[0]),
            Hinge::Cylindrical => turned(&moved(&fixed, q[1]), q[0]),
            Hinge::Planar => {
                let shift = fixed.rotation.column(0).scale(q[0]) + fixed.rotation.column(1).scale(q[1]);
                turned(&Transform::new(fixed.rotation, fixed.translation + shift), q[2])
            }
            Hinge::Translation => {
                Transform::new(fixed.rotation, fixed.translation + fixed.rotation * Vec3([q[0], q[1], q[2]]))
            }
            Hinge::Spherical => {
                let r = Quaternion([q[0], q[1], q[2], q[3]]).to_rotation();
                Transform::new(fixed.rotation * r, fixed.translation)
            }
            Hinge::Free => {
                let r = Quaternion([q[3], q[4], q[5], q[6]]).to_rotation();
                let shift = fixed.rotation * Vec3([q[0], q[1], q[2]]);
                Transform::new(fixed.rotation * r, fixed.translation + shift)
            }
        }
    }
}

/// Three axes of a frame in another, and its origin there.
pub(crate) type Axes<T> = ([Vec3<T>; 3], Vec3<T>);

/// A vector, given its components along three axes.
#[inline(always)]
pub(crate) fn combine<T: Scalar>([x, y, z]: &[Vec3<T>; 3], v: Vec3<T>) -> Vec3<T> {
    x.scale_add(v.0[0], y.scale_add(v.0[1], z.scale(v.0[2])))
}

/// A frame turned by q about its own z axis.
#[inline(always)]
fn turned<T: Scalar>(x: &Transform<T>, q: T) -> Transform<T> {
    let (s, c) = q.sin_cos();
    let (a, b) = (x.rotation.column(0), x.rotation.column(1));
    let rotation = Mat3::from_columns(a.scale(c) + b.scale(s), b.scale(c) - a.scale(s), x.rotation.column(2));
    Transform::new(rotation, x.translation)
}

/// A frame moved by d along its own z axis.
#[inline(always)]
fn moved<T: Scalar>(x: &Transform<T>, d: T) -> Transform<T> {
    Transform::new(x.rotation, x.translation + x.rotation.column(2).scale(d))
}
