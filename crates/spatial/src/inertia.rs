//! Rigid and articulated inertias, in their unique entries (10 and 21).

use crate::{Mat3, Motion, Scalar, Sym3, Vec3, Wrench};

/// The spatial inertia M = [[J, h~], [−h~, m I]] of a rigid body about its frame's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidInertia<T> {
    /// m, kg.
    pub mass: T,
    /// h = m c with c the centre of mass, kg·m.
    pub first_moment: Vec3<T>,
    /// J about the frame's origin, kg·m².
    pub inertia: Sym3<T>,
}

/// The inertia P = [[J, C], [Cᵀ, m]] of an articulated body (paper 2, (2.4)); unlike a rigid one it has a mass *matrix*.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArticulatedInertia<T> {
    /// J, kg·m².
    pub inertia: Sym3<T>,
    /// C, kg·m.
    pub coupling: Mat3<T>,
    /// m, kg.
    pub mass: Sym3<T>,
}

impl<T: Scalar> RigidInertia<T> {
    /// No inertia.
    pub fn zero() -> Self {
        RigidInertia { mass: T::zero(), first_moment: Vec3::zero(), inertia: Sym3::zero() }
    }
    /// From mass, centre of mass, and inertia about the centre of mass.
    pub fn from_center_of_mass(mass: T, center: Vec3<T>, about_center: Sym3<T>) -> Self {
        RigidInertia {
            mass,
            first_moment: center.scale(mass),
            inertia: about_center + Sym3::point_mass(mass, center),
        }
    }
    /// Constants of the model, in every lane.
    #[inline(always)]
    pub fn constant(m: &RigidInertia<T::Constant>) -> Self {
        RigidInertia {
            mass: T::constant(m.mass),
            first_moment: Vec3::constant(m.first_moment),
            inertia: Sym3::constant(&m.inertia),
        }
    }
    /// The i-th column of M: the momentum of the i-th unit motion.
    #[inline(always)]
    pub fn column(&self, i: usize) -> Wrench<T> {
        let ([x, y, z], o) = (self.first_moment.0, T::zero());
        match i {
            0 => Wrench::new(self.inertia.column(0), Vec3([o, -z, y])),
            1 => Wrench::new(self.inertia.column(1), Vec3([z, o, -x])),
            2 => Wrench::new(self.inertia.column(2), Vec3([-y, x, o])),
            3 => Wrench::new(Vec3([o, z, -y]), Vec3([self.mass, o, o])),
            4 => Wrench::new(Vec3([-z, o, x]), Vec3([o, self.mass, o])),
            _ => Wrench::new(Vec3([y, -x, o]), Vec3([o, o, self.mass])),
        }
    }
    /// M V: the momentum of the body about its frame's origin.
    #[inline(always)]
    pub fn momentum(&self, v: Motion<T>) -> Wrench<T> {
        Wrench::new(
            self.inertia * v.angular + self.first_moment.cross(v.linear),
            v.linear.scale(self.mass) - self.first_moment.cross(v.angular),
        )
    }
    /// M (ω, 0), with the bits of [`Self::momentum`].
    #[inline(always)]
    pub fn spin(&self, omega: Vec3<T>) -> Wrench<T> {
        Wrench::new(self.inertia * omega, Vec3::zero() - self.first_moment.cross(omega))
    }
    /// (ω × J ω, ω × (ω × h)): with M α, α the inertial acceleration of the frame's origin, the rate of momentum about it.
    ///
    /// No velocity of the origin enters, so that a common velocity of all bodies costs no digits.
    #[inline(always)]
    pub fn gyroscopic(&self, omega: Vec3<T>) -> Wrench<T> {
        Wrench::new(omega.cross(self.inertia * omega), omega.cross(omega.cross(self.first_moment)))
    }
    /// M α and the forces of turning: the rate of momentum of [`Self::gyroscopic`].
    #[inline(always)]
    pub fn force(&self, omega: Vec3<T>, alpha: Motion<T>) -> Wrench<T> {
        let (J, h) = (&self.inertia, self.first_moment);
        let moment = omega.cross_add(*J * omega, h.cross_add(alpha.linear, *J * alpha.angular));
        let tangential = alpha.angular.cross_add(h, alpha.linear.scale(self.mass));
        Wrench::new(moment, omega.cross_add(omega.cross(h), tangential))
    }
    /// The same inertia as an articulated one.
    #[inline(always)]
    pub fn to_articulated(&self) -> ArticulatedInertia<T> {
        ArticulatedInertia {
            inertia: self.inertia,
            coupling: Mat3::skew(self.first_moment),
            mass: Sym3::diagonal(self.mass),
        }
    }
}

impl<T: Scalar> core::ops::Add for RigidInertia<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        RigidInertia {
            mass: self.mass + b.mass,
            first_moment: self.first_moment + b.first_moment,
            inertia: self.inertia + b.inertia,
        }
    }
}

impl<T: Scalar> ArticulatedInertia<T> {
    /// No inertia.
    #[inline(always)]
    pub fn zero() -> Self {
        ArticulatedInertia { inertia: Sym3::zero(), coupling: Mat3::zero(), mass: Sym3::zero() }
    }
    /// P + M, in the entries that M has.
    #[inline(always)]
    pub fn plus_rigid(&self, m: &RigidInertia<T>) -> Self {
        let ([x, y, z], [a, b, c]) = (m.first_moment.0, self.coupling.0);
        let s = &self.mass;
        ArticulatedInertia {
            inertia: self.inertia + m.inertia,
            coupling: Mat3([
                [a[0], a[1] - z, a[2] + y],
                [b[0] + z, b[1], b[2] - x],
                [c[0] - y, c[1] + x, c[2]],
            ]),
            mass: Sym3 { xx: s.xx + m.mass, yy: s.yy + m.mass, zz: s.zz + m.mass, ..*s },
        }
    }
    /// P V.
    #[inline(always)]
    pub fn times(&self, v: Motion<T>) -> Wrench<T> {
        Wrench::new(
            self.inertia * v.angular + self.coupling * v.linear,
            self.coupling.transpose_mul(v.angular) + self.mass * v.linear,
        )
    }
    /// The i-th column of P.
    #[inline(always)]
    pub fn column(&self, i: usize) -> Wrench<T> {
        if i < 3 {
            Wrench::new(self.inertia.column(i), self.coupling.row(i))
        } else {
            Wrench::new(self.coupling.column(i - 3), self.mass.column(i - 3))
        }
    }
    /// P += s U Uᵀ.
    #[inline(always)]
    pub fn add_outer(&mut self, u: Wrench<T>, s: T) {
        self.inertia.add_outer(u.moment, s);
        self.mass.add_outer(u.force, s);
        for i in 0..3 {
            let row = Vec3(self.coupling.0[i]) + u.force.scale(s * u.moment.0[i]);
            self.coupling.0[i] = row.0;
        }
    }
    /// P −= a bᵀ, where a is a multiple of b.
    #[inline(always)]
    pub fn subtract_outer(&mut self, a: Wrench<T>, b: Wrench<T>) {
        let (am, af) = (-a.moment, -a.force);
        self.inertia.add_product(am, b.moment);
        self.mass.add_product(af, b.force);
        for i in 0..3 {
            for j in 0..3 {
                self.coupling.0[i][j] = am.0[i].fma(b.force.0[j], self.coupling.0[i][j]);
            }
        }
    }
    /// The full 6×6 matrix, angular first.
    pub fn to_rows(&self) -> [[T; 6]; 6] {
        let mut rows = [[T::zero(); 6]; 6];
        for j in 0..6 {
            let c = self.column(j).to_array();
            for i in 0..6 {
                rows[i][j] = c[i];
            }
        }
        rows
    }
}

impl<T: Scalar> core::ops::Add for ArticulatedInertia<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        ArticulatedInertia {
            inertia: self.inertia + b.inertia,
            coupling: self.coupling + b.coupling,
            mass: self.mass + b.mass,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Quaternion, Transform};

    fn sample() -> (RigidInertia<f64>, Transform<f64>, Motion<f64>) {
        let about = Sym3 { xx: 0.5, xy: 0.02, xz: -0.03, yy: 0.4, yz: 0.01, zz: 0.6 };
        let m = RigidInertia::from_center_of_mass(2.0, Vec3([0.1, -0.3, 0.2]), about);
        let r = Quaternion::from_roll_pitch_yaw(0.3, -0.7, 1.9).to_rotation();
        let v = Motion::from_array([0.3, -0.2, 0.9, 1.0, -0.4, 0.1]);
        (m, Transform::new(r, Vec3([0.7, 0.2, -0.5])), v)
    }

    /// φ M φ* V computed with operators on vectors, with the rigid and with the articulated congruence.
    #[test]
    fn congruences_agree_with_shifted_vectors() {
        let (m, x, v) = sample();
        let want = x.wrench_to_parent(m.momentum(x.motion_to_child(v)));
        let rigid = x.rigid_to_parent(&m).momentum(v);
        let articulated = x.articulated_to_parent(&m.to_articulated()).times(v);
        for i in 0..6 {
            assert!((want.get(i) - rigid.get(i)).abs() < 20.0 * f64::EPSILON);
            assert!((want.get(i) - articulated.get(i)).abs() < 20.0 * f64::EPSILON);
        }
    }

    #[test]
    fn shift_operators_are_adjoint_and_invertible() {
        let (m, x, v) = sample();
        let f = m.momentum(v);
        let power = x.motion_to_child(v).dot(f) - v.dot(x.wrench_to_parent(f));
        assert!(power.abs() < 20.0 * f64::EPSILON);
        let back = x.wrench_to_child(x.wrench_to_parent(f)) - f;
        let there = x.motion_to_parent(x.motion_to_child(v)) - v;
        assert!(back.to_array().iter().chain(&there.to_array()).all(|e| e.abs() < 20.0 * f64::EPSILON));
    }

    /// ⟨V, X~* …⟩: the motion cross product is minus the adjoint of the force cross product.
    #[test]
    fn cross_products_are_adjoint() {
        let (m, x, v) = sample();
        let (w, f) = (x.motion_to_child(v), m.momentum(v));
        let sum = v.cross_motion(w).dot(f) + w.dot(v.cross_wrench(f));
        assert!(sum.abs() < 20.0 * f64::EPSILON);
    }
}
