//! Turning vectors and inertias about a coordinate axis: what a hinge does, at a tenth of the cost of a general rotation.
//!
//! | symbol | meaning |
//! |---|---|
//! | R | the rotation by θ in the plane of two coordinate axes: [[c, −s], [s, c]] |
//!
//! Symmetric blocks are turned by c², cs and s² of sums without cancellation, so that a needle's small moment survives a
//! quarter turn.

use crate::{ArticulatedInertia, Mat3, Motion, RigidInertia, Scalar, Sym3, Vec3, Wrench};

/// Cosine and sine of an angle, with their products.
#[derive(Clone, Copy, Debug)]
struct Products<T> {
    c: T,
    s: T,
    cc: T,
    cs: T,
    ss: T,
}

/// A coordinate axis to turn about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// x: turns y towards z.
    X,
    /// z: turns x towards y.
    Z,
}

/// Rotation by an angle about a coordinate axis: the child's axes in the parent's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn<T> {
    /// Cosine.
    pub cos: T,
    /// Sine.
    pub sin: T,
}

impl<T: Scalar> Turn<T> {
    /// By an angle in rad.
    #[inline(always)]
    pub fn by(angle: T) -> Self {
        let (sin, cos) = angle.sin_cos();
        Turn { cos, sin }
    }
    /// By zero.
    #[inline(always)]
    pub fn none() -> Self {
        Turn { cos: T::one(), sin: T::zero() }
    }
    /// A constant of the model, in every lane.
    #[inline(always)]
    pub fn constant(x: &Turn<T::Constant>) -> Self {
        Turn { cos: T::constant(x.cos), sin: T::constant(x.sin) }
    }
    /// By the sum of two angles.
    #[inline(always)]
    pub fn then(self, b: Self) -> Self {
        Turn { cos: self.cos.fma(b.cos, -(self.sin * b.sin)), sin: self.sin.fma(b.cos, self.cos * b.sin) }
    }
    /// R (a, b).
    #[inline(always)]
    fn pair(self, a: T, b: T) -> (T, T) {
        (self.cos.fma(a, -(self.sin * b)), self.sin.fma(a, self.cos * b))
    }
    /// Rᵀ (a, b).
    #[inline(always)]
    fn pair_back(self, a: T, b: T) -> (T, T) {
        (self.cos.fma(a, self.sin * b), self.cos.fma(b, -(self.sin * a)))
    }
    /// A vector of the child, in the parent's axes.
    #[inline(always)]
    pub fn up(self, axis: Axis, v: Vec3<T>) -> Vec3<T> {
        let [x, y, z] = v.0;
        match axis {
            Axis::X => {
                let (y, z) = self.pair(y, z);
                Vec3([x, y, z])
            }
            Axis::Z => {
                let (x, y) = self.pair(x, y);
                Vec3([x, y, z])
            }
        }
    }
    /// A vector of the parent, in the child's axes.
    #[inline(always)]
    pub fn down(self, axis: Axis, v: Vec3<T>) -> Vec3<T> {
        let [x, y, z] = v.0;
        match axis {
            Axis::X => {
                let (y, z) = self.pair_back(y, z);
                Vec3([x, y, z])
            }
            Axis::Z => {
                let (x, y) = self.pair_back(x, y);
                Vec3([x, y, z])
            }
        }
    }
    /// The same about z, and a vector of the child.
    #[inline(always)]
    pub fn down_plus(self, v: Vec3<T>, plus: Vec3<T>) -> Vec3<T> {
        let ([x, y, z], [a, b, c]) = (v.0, plus.0);
        Vec3([self.cos.fma(x, self.sin.fma(y, a)), self.cos.fma(y, (-self.sin).fma(x, b)), z + c])
    }
    /// Both parts of a wrench, in the parent's axes.
    #[inline(always)]
    pub fn wrench_up(self, axis: Axis, f: Wrench<T>) -> Wrench<T> {
        Wrench::new(self.up(axis, f.moment), self.up(axis, f.force))
    }
    /// Both parts of a motion, in the child's axes.
    #[inline(always)]
    pub fn motion_down(self, axis: Axis, v: Motion<T>) -> Motion<T> {
        Motion::new(self.down(axis, v.angular), self.down(axis, v.linear))
    }
    #[inline(always)]
    fn products(self) -> Products<T> {
        let (c, s) = (self.cos, self.sin);
        Products { c, s, cc: c * c, cs: c * s, ss: s * s }
    }
    /// R S Rᵀ.
    #[inline(always)]
    pub fn symmetric_up(self, axis: Axis, m: &Sym3<T>) -> Sym3<T> {
        symmetric(self.products(), axis, m)
    }
    /// R A Rᵀ.
    #[inline(always)]
    pub fn matrix_up(self, axis: Axis, m: &Mat3<T>) -> Mat3<T> {
        full(self.products(), axis, m)
    }
    /// A rigid inertia, in the parent's axes.
    #[inline(always)]
    pub fn rigid_up(self, axis: Axis, m: &RigidInertia<T>) -> RigidInertia<T> {
        RigidInertia {
            mass: m.mass,
            first_moment: self.up(axis, m.first_moment),
            inertia: self.symmetric_up(axis, &m.inertia),
        }
    }
    /// An articulated inertia, in the parent's axes.
    #[inline(always)]
    pub fn articulated_up(self, axis: Axis, p: &ArticulatedInertia<T>) -> ArticulatedInertia<T> {
        let t = self.products();
        ArticulatedInertia {
            inertia: symmetric(t, axis, &p.inertia),
            coupling: full(t, axis, &p.coupling),
            mass: symmetric(t, axis, &p.mass),
        }
    }
}

/// The block [[a, b], [b, d]] turned in its own plane.
#[inline(always)]
fn block<T: Scalar>(t: Products<T>, a: T, b: T, d: T) -> (T, T, T) {
    let twice = (t.cs + t.cs) * b;
    (t.cc.fma(a, t.ss.fma(d, -twice)), t.cs.fma(a - d, (t.cc - t.ss) * b), t.ss.fma(a, t.cc.fma(d, twice)))
}

#[inline(always)]
fn symmetric<T: Scalar>(t: Products<T>, axis: Axis, m: &Sym3<T>) -> Sym3<T> {
    let turn = Turn { cos: t.c, sin: t.s };
    match axis {
        Axis::Z => {
            let (xx, xy, yy) = block(t, m.xx, m.xy, m.yy);
            let (xz, yz) = turn.pair(m.xz, m.yz);
            Sym3 { xx, xy, xz, yy, yz, zz: m.zz }
        }
        Axis::X => {
            let (yy, yz, zz) = block(t, m.yy, m.yz, m.zz);
            let (xy, xz) = turn.pair(m.xy, m.xz);
            Sym3 { xx: m.xx, xy, xz, yy, yz, zz }
        }
    }
}

/// R A Rᵀ.
#[inline(always)]
fn full<T: Scalar>(t: Products<T>, axis: Axis, m: &Mat3<T>) -> Mat3<T> {
    // Indices of the plane, and the axis.
    let (i, j, k) = match axis {
        Axis::Z => (0, 1, 2),
        Axis::X => (1, 2, 0),
    };
    let turn = Turn { cos: t.c, sin: t.s };
    let (a, b, c, d) = (m.0[i][i], m.0[i][j], m.0[j][i], m.0[j][j]);
    let sum = t.cs * (b + c);
    let difference = t.cs * (a - d);
    let mut out = *m;
    out.0[i][i] = t.cc.fma(a, t.ss.fma(d, -sum));
    out.0[j][j] = t.ss.fma(a, t.cc.fma(d, sum));
    out.0[i][j] = t.cc.fma(b, (-t.ss).fma(c, difference));
    out.0[j][i] = t.cc.fma(c, (-t.ss).fma(b, difference));
    (out.0[i][k], out.0[j][k]) = turn.pair(m.0[i][k], m.0[j][k]);
    (out.0[k][i], out.0[k][j]) = turn.pair(m.0[k][i], m.0[k][j]);
    out
}

/// What is left of an articulated inertia after a hinge about z has been eliminated has no row and column z in J and no row z
/// in C; these functions turn the entries that are left.
impl<T: Scalar> Turn<T> {
    /// xx, xy, yy of J, turned about z.
    #[inline(always)]
    pub fn flat_inertia_z(self, [xx, xy, yy]: [T; 3]) -> [T; 3] {
        let (xx, xy, yy) = block(self.products(), xx, xy, yy);
        [xx, xy, yy]
    }
    /// Rows x and y of C, turned about z.
    #[inline(always)]
    pub fn flat_coupling_z(self, [[a, b, e], [c, d, f]]: [[T; 3]; 2]) -> [[T; 3]; 2] {
        let t = self.products();
        let sum = t.cs * (b + c);
        let difference = t.cs * (a - d);
        let (xz, yz) = self.pair(e, f);
        [
            [t.cc.fma(a, t.ss.fma(d, -sum)), t.cc.fma(b, (-t.ss).fma(c, difference)), xz],
            [t.cc.fma(c, (-t.ss).fma(b, difference)), t.ss.fma(a, t.cc.fma(d, sum)), yz],
        ]
    }
    /// All of J from xx, xy, yy, turned about x.
    #[inline(always)]
    pub fn flat_inertia_x(self, [xx, xy, yy]: [T; 3]) -> Sym3<T> {
        let t = self.products();
        Sym3 { xx, xy: t.c * xy, xz: t.s * xy, yy: t.cc * yy, yz: t.cs * yy, zz: t.ss * yy }
    }
    /// All of C from rows x and y, turned about x.
    #[inline(always)]
    pub fn flat_coupling_x(self, [x, y]: [[T; 3]; 2]) -> Mat3<T> {
        let (xy, xz) = self.pair(x[1], x[2]);
        let (yy, yz) = self.pair(y[1], y[2]);
        let row = Vec3([y[0], yy, yz]);
        Mat3([[x[0], xy, xz], row.scale(self.cos).0, row.scale(self.sin).0])
    }
}

/// C + l~ m.
#[inline(always)]
pub fn shift_coupling<T: Scalar>(C: &Mat3<T>, m: &Sym3<T>, l: Vec3<T>) -> Mat3<T> {
    Mat3::from_columns(
        l.cross_add(m.column(0), C.column(0)),
        l.cross_add(m.column(1), C.column(1)),
        l.cross_add(m.column(2), C.column(2)),
    )
}

/// J + l~ Cᵀ + C' l~ᵀ with C' from [`shift_coupling`].
#[inline(always)]
pub fn shift_inertia<T: Scalar>(J: &Sym3<T>, C: &Mat3<T>, moved: &Mat3<T>, l: Vec3<T>) -> Sym3<T> {
    let ([x, y, z], C, N) = (l.0, &C.0, &moved.0);
    // Entry (i, j): (l × row j of C)_i + (l × row i of C')_j.
    Sym3 {
        xx: cross_entry(y, z, N[0][1], N[0][2], cross_entry(y, z, C[0][1], C[0][2], J.xx)),
        xy: cross_entry(z, x, N[0][2], N[0][0], cross_entry(y, z, C[1][1], C[1][2], J.xy)),
        xz: cross_entry(x, y, N[0][0], N[0][1], cross_entry(y, z, C[2][1], C[2][2], J.xz)),
        yy: cross_entry(z, x, N[1][2], N[1][0], cross_entry(z, x, C[1][2], C[1][0], J.yy)),
        yz: cross_entry(x, y, N[1][0], N[1][1], cross_entry(z, x, C[2][2], C[2][0], J.yz)),
        zz: cross_entry(x, y, N[2][0], N[2][1], cross_entry(x, y, C[2][0], C[2][1], J.zz)),
    }
}

/// J + a d − b c: one component of a cross product.
#[inline(always)]
fn cross_entry<T: Scalar>(a: T, b: T, c: T, d: T, J: T) -> T {
    a.fma(d, (-b).fma(c, J))
}

impl<T: Scalar> ArticulatedInertia<T> {
    /// About a point at −l: φ P φ* with a pure shift, where l is the present origin seen from the new one.
    #[inline(always)]
    pub fn shifted(&self, l: Vec3<T>) -> Self {
        let moved = shift_coupling(&self.coupling, &self.mass, l);
        ArticulatedInertia {
            inertia: shift_inertia(&self.inertia, &self.coupling, &moved, l),
            coupling: moved,
            mass: self.mass,
        }
    }
}

impl<T: Scalar> RigidInertia<T> {
    /// About a point at −l, and another inertia there: the sum with [`Self::shifted`], of which the moments of inertia, which
    /// come last, wait for one addition only.
    #[inline(always)]
    pub fn shifted_onto(&self, l: Vec3<T>, own: &Self) -> Self {
        let h = self.first_moment;
        let g = l.scale_add(self.mass, h);
        let ([x, y, z], [hx, hy, hz], [gx, gy, gz], J) = (l.0, h.0, g.0, &own.inertia);
        let (px, py, pz) = (x * (hx + gx), y * (hy + gy), z * (hz + gz));
        let displaced = Sym3 {
            xx: J.xx + (py + pz),
            xy: (-hx).fma(y, (-x).fma(gy, J.xy)),
            xz: (-hx).fma(z, (-x).fma(gz, J.xz)),
            yy: J.yy + (px + pz),
            yz: (-hy).fma(z, (-y).fma(gz, J.yz)),
            zz: J.zz + (px + py),
        };
        RigidInertia {
            mass: self.mass + own.mass,
            first_moment: g + own.first_moment,
            inertia: displaced + self.inertia,
        }
    }
    /// About a point at −l: as [`ArticulatedInertia::shifted`].
    #[inline(always)]
    pub fn shifted(&self, l: Vec3<T>) -> Self {
        let h = self.first_moment;
        let g = l.scale_add(self.mass, h);
        let ([x, y, z], [hx, hy, hz], [gx, gy, gz], J) = (l.0, h.0, g.0, &self.inertia);
        // J' = J + (h·l + g·l) I − h lᵀ − l gᵀ: products of the other two axes on the diagonal.
        let (px, py, pz) = (x * (hx + gx), y * (hy + gy), z * (hz + gz));
        RigidInertia {
            mass: self.mass,
            first_moment: g,
            inertia: Sym3 {
                xx: J.xx + (py + pz),
                xy: (-hx).fma(y, (-x).fma(gy, J.xy)),
                xz: (-hx).fma(z, (-x).fma(gz, J.xz)),
                yy: J.yy + (px + pz),
                yz: (-hy).fma(z, (-y).fma(gz, J.yz)),
                zz: J.zz + (px + py),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Transform;

    fn rotation(turn: Turn<f64>, axis: Axis) -> Mat3<f64> {
        let columns = [0, 1, 2].map(|i| turn.up(axis, Vec3::unit(i)));
        Mat3::from_columns(columns[0], columns[1], columns[2])
    }

    fn articulated() -> ArticulatedInertia<f64> {
        let mut p = RigidInertia::from_center_of_mass(
            2.0,
            Vec3([0.1, -0.3, 0.2]),
            Sym3 { xx: 0.5, xy: 0.02, xz: -0.03, yy: 0.4, yz: 0.01, zz: 0.6 },
        )
        .to_articulated();
        p.add_outer(Wrench::from_array([0.3, -0.2, 0.9, 1.0, -0.4, 0.1]), -0.2);
        p
    }

    fn close(a: &ArticulatedInertia<f64>, b: &ArticulatedInertia<f64>) {
        for (x, y) in a.to_rows().iter().flatten().zip(b.to_rows().iter().flatten()) {
            assert!((x - y).abs() < 64.0 * f64::EPSILON, "{x:e} {y:e}");
        }
    }

    #[test]
    fn turns_and_shifts_are_the_general_congruence() {
        for angle in [0.0, 0.3, -1.2, 2.9, std::f64::consts::FRAC_PI_2] {
            for axis in [Axis::X, Axis::Z] {
                let (turn, l) = (Turn::by(angle), Vec3([0.7, 0.2, -0.5]));
                let x = Transform::new(rotation(turn, axis), l);
                let p = articulated();
                let want = x.articulated_to_parent(&p);
                close(&want, &turn.articulated_up(axis, &p).shifted(l));
                let f = Wrench::from_array([0.3, -0.2, 0.9, 1.0, -0.4, 0.1]);
                let v = Motion::from_array([0.3, -0.2, 0.9, 1.0, -0.4, 0.1]);
                let power = turn.motion_down(axis, v).dot(f) - v.dot(turn.wrench_up(axis, f));
                assert!(power.abs() < 8.0 * f64::EPSILON);
                let m = RigidInertia::from_center_of_mass(2.0, l, Sym3::diagonal(0.3));
                let rigid = turn.rigid_up(axis, &m).shifted(l).to_articulated();
                close(&x.rigid_to_parent(&m).to_articulated(), &rigid);
            }
        }
    }

    #[test]
    fn an_eliminated_inertia_is_an_articulated_one_with_zeros() {
        let mut p = articulated();
        let column = p.column(2);
        p.add_outer(column, -1.0 / p.inertia.zz);
        let (J, C) = (&p.inertia, &p.coupling.0);
        let (a, b) = (Turn::by(0.7), Turn::by(-2.1));
        let inertia = b.flat_inertia_x(a.flat_inertia_z([J.xx, J.xy, J.yy]));
        let coupling = b.flat_coupling_x(a.flat_coupling_z([C[0], C[1]]));
        let mass = b.symmetric_up(Axis::X, &a.symmetric_up(Axis::Z, &p.mass));
        let both = b.articulated_up(Axis::X, &a.articulated_up(Axis::Z, &p));
        close(&both, &ArticulatedInertia { inertia, coupling, mass });
    }

    #[test]
    fn a_needle_survives_a_quarter_turn() {
        let needle = Sym3 { xx: 1e-20, xy: 0.0, xz: 0.0, yy: 1.0, yz: 0.0, zz: 1.0 };
        let turned = Turn::by(std::f64::consts::FRAC_PI_2).symmetric_up(Axis::Z, &needle);
        assert!((turned.yy - 1e-20).abs() < 1e-32);
    }
}
