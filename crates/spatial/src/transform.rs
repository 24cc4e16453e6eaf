//! Rigid transforms: the pose of a child frame in its parent's frame, and the shift operator φ(p, k) that it is.

use crate::{ArticulatedInertia, Mat3, Motion, Real, RigidInertia, Scalar, Sym3, Vec3, Wrench};

/// Pose of frame k in frame p: `x_p = R x_k + l`.
///
/// As an operator on six-vectors it is φ(p, k) = [[R, l~R], [0, R]] (soa.md 3.0): wrenches move inward with
/// [`wrench_to_parent`](Self::wrench_to_parent), motions outward with φ*(p, k), [`motion_to_child`](Self::motion_to_child).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform<T> {
    /// Axes of the child, as columns in the parent's axes.
    pub rotation: Mat3<T>,
    /// Origin of the child in the parent's frame, m.
    pub translation: Vec3<T>,
}

impl<T: Scalar> Transform<T> {
    /// From a rotation (child to parent) and the child's origin.
    #[inline(always)]
    pub fn new(rotation: Mat3<T>, translation: Vec3<T>) -> Self {
        Transform { rotation, translation }
    }
    /// The identity.
    #[inline(always)]
    pub fn identity() -> Self {
        Self::new(Mat3::identity(), Vec3::zero())
    }
    /// Constants of the model, in every lane.
    #[inline(always)]
    pub fn constant(x: &Transform<T::Constant>) -> Self {
        Self::new(Mat3::constant(&x.rotation), Vec3::constant(x.translation))
    }
    /// The pose of c in a, from the pose of b in a (`self`) and of c in b.
    #[inline(always)]
    pub fn compose(&self, inner: &Self) -> Self {
        Self::new(self.rotation * inner.rotation, self.point(inner.translation))
    }
    /// The pose of the parent in the child.
    #[inline(always)]
    pub fn inverse(&self) -> Self {
        Self::new(self.rotation.transpose(), -self.rotation.transpose_mul(self.translation))
    }
    /// A point given in the child's frame, in the parent's.
    #[inline(always)]
    pub fn point(&self, x: Vec3<T>) -> Vec3<T> {
        self.rotation * x + self.translation
    }
    /// φ(p, k) f: a wrench at k, moved to p.
    #[inline(always)]
    pub fn wrench_to_parent(&self, f: Wrench<T>) -> Wrench<T> {
        let force = self.rotation * f.force;
        Wrench::new(self.rotation * f.moment + self.translation.cross(force), force)
    }
    /// φ(p, k)⁻¹ f: a wrench at p, moved to k.
    #[inline(always)]
    pub fn wrench_to_child(&self, f: Wrench<T>) -> Wrench<T> {
        Wrench::new(
            self.rotation.transpose_mul(f.moment - self.translation.cross(f.force)),
            self.rotation.transpose_mul(f.force),
        )
    }
    /// φ*(p, k) V: a motion of p, moved to k.
    #[inline(always)]
    pub fn motion_to_child(&self, v: Motion<T>) -> Motion<T> {
        Motion::new(
            self.rotation.transpose_mul(v.angular),
            self.rotation.transpose_mul(v.linear + v.angular.cross(self.translation)),
        )
    }
    /// φ*(p, k)⁻¹ V: a motion of k, moved to p.
    #[inline(always)]
    pub fn motion_to_parent(&self, v: Motion<T>) -> Motion<T> {
        let angular = self.rotation * v.angular;
        Motion::new(angular, self.rotation * v.linear - angular.cross(self.translation))
    }
    /// φ(p, k) P φ*(p, k): an articulated inertia about k, moved to p.
    #[inline(always)]
    pub fn articulated_to_parent(&self, p: &ArticulatedInertia<T>) -> ArticulatedInertia<T> {
        let r = &self.rotation;
        let mass = p.mass.rotate(r);
        let coupling = *r * p.coupling * r.transpose();
        let l = Mat3::skew(self.translation);
        // J' = J + l~ Cᵀ + (C + l~ m) l~ᵀ, with l~ᵀ = −l~.
        let moved = coupling + l * mass.to_mat3();
        let shift = l * coupling.transpose() - moved * l;
        ArticulatedInertia { inertia: p.inertia.rotate(r) + Sym3::from_upper(&shift), coupling: moved, mass }
    }
    /// φ(p, k) M φ*(p, k): a rigid inertia about k, moved to p.
    #[inline(always)]
    pub fn rigid_to_parent(&self, m: &RigidInertia<T>) -> RigidInertia<T> {
        let r = &self.rotation;
        let h = *r * m.first_moment;
        let l = self.translation;
        // J' = J + (2 h·l + m l·l) I − h lᵀ − l hᵀ − m l lᵀ.
        let mut inertia = m.inertia.rotate(r) + Sym3::diagonal(h.dot(l) + h.dot(l) + m.mass * l.dot(l));
        let g = l.scale(m.mass) + h;
        let ([h0, h1, h2], [l0, l1, l2], [g0, g1, g2]) = (h.0, l.0, g.0);
        inertia.xx -= h0 * l0 + l0 * g0;
        inertia.xy -= h0 * l1 + l0 * g1;
        inertia.xz -= h0 * l2 + l0 * g2;
        inertia.yy -= h1 * l1 + l1 * g1;
        inertia.yz -= h1 * l2 + l1 * g2;
        inertia.zz -= h2 * l2 + l2 * g2;
        RigidInertia { mass: m.mass, first_moment: g, inertia }
    }
}

impl<T: Real> Transform<T> {
    /// The pose as a row-major 4×4 matrix of f64.
    pub fn to_homogeneous(&self) -> [[f64; 4]; 4] {
        let mut h = [[0.0; 4]; 4];
        for i in 0..3 {
            for j in 0..3 {
                h[i][j] = self.rotation.0[i][j].to_f64();
            }
            h[i][3] = self.translation.0[i].to_f64();
        }
        h[3][3] = 1.0;
        h
    }
}
