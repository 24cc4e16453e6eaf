//! Three-vectors, 3×3 matrices and symmetric 3×3 matrices over any [`Scalar`].

use crate::Scalar;
use core::ops::{Add, AddAssign, Mul, Neg, Sub, SubAssign};

/// A three-vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vec3<T>(pub [T; 3]);

/// A 3×3 matrix, by rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mat3<T>(pub [[T; 3]; 3]);

/// A symmetric 3×3 matrix, by its six different entries.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs)]
pub struct Sym3<T> {
    pub xx: T,
    pub xy: T,
    pub xz: T,
    pub yy: T,
    pub yz: T,
    pub zz: T,
}

impl<T: Scalar> Vec3<T> {
    /// From three components.
    #[inline(always)]
    pub fn new(x: T, y: T, z: T) -> Self {
        Vec3([x, y, z])
    }
    /// The zero vector.
    #[inline(always)]
    pub fn zero() -> Self {
        Vec3([T::zero(); 3])
    }
    /// The i-th coordinate vector.
    #[inline(always)]
    pub fn unit(i: usize) -> Self {
        let mut e = Self::zero();
        e.0[i] = T::one();
        e
    }
    /// From f64 components, exactly.
    pub fn splat(v: [f64; 3]) -> Self {
        Vec3(v.map(T::splat))
    }
    /// Constants of the model, in every lane.
    #[inline(always)]
    pub fn constant(v: Vec3<T::Constant>) -> Self {
        Vec3([T::constant(v.0[0]), T::constant(v.0[1]), T::constant(v.0[2])])
    }
    /// a · b.
    #[inline(always)]
    pub fn dot(self, b: Self) -> T {
        self.0[0].fma(b.0[0], self.0[1].fma(b.0[1], self.0[2] * b.0[2]))
    }
    /// a × b.
    #[inline(always)]
    pub fn cross(self, b: Self) -> Self {
        let ([a0, a1, a2], [b0, b1, b2]) = (self.0, b.0);
        Vec3([a1.fma(b2, -(a2 * b1)), a2.fma(b0, -(a0 * b2)), a0.fma(b1, -(a1 * b0))])
    }
    /// a × b + c.
    #[inline(always)]
    pub fn cross_add(self, b: Self, c: Self) -> Self {
        let ([a0, a1, a2], [b0, b1, b2], c) = (self.0, b.0, c.0);
        Vec3([
            a1.fma(b2, (-a2).fma(b1, c[0])),
            a2.fma(b0, (-a0).fma(b2, c[1])),
            a0.fma(b1, (-a1).fma(b0, c[2])),
        ])
    }
    /// s a + b.
    #[inline(always)]
    pub fn scale_add(self, s: T, b: Self) -> Self {
        Vec3([self.0[0].fma(s, b.0[0]), self.0[1].fma(s, b.0[1]), self.0[2].fma(s, b.0[2])])
    }
    /// s a.
    #[inline(always)]
    pub fn scale(self, s: T) -> Self {
        Vec3([self.0[0] * s, self.0[1] * s, self.0[2] * s])
    }
    /// |a|.
    #[inline(always)]
    pub fn norm(self) -> T {
        self.dot(self).sqrt()
    }
}

impl<T: Scalar> Add for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Vec3([self.0[0] + b.0[0], self.0[1] + b.0[1], self.0[2] + b.0[2]])
    }
}
impl<T: Scalar> Sub for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Vec3([self.0[0] - b.0[0], self.0[1] - b.0[1], self.0[2] - b.0[2]])
    }
}
impl<T: Scalar> Neg for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Vec3([-self.0[0], -self.0[1], -self.0[2]])
    }
}
impl<T: Scalar> AddAssign for Vec3<T> {
    #[inline(always)]
    fn add_assign(&mut self, b: Self) {
        *self = *self + b;
    }
}
impl<T: Scalar> SubAssign for Vec3<T> {
    #[inline(always)]
    fn sub_assign(&mut self, b: Self) {
        *self = *self - b;
    }
}

impl<T: Scalar> Mat3<T> {
    /// The identity.
    #[inline(always)]
    pub fn identity() -> Self {
        Mat3([Vec3::unit(0).0, Vec3::unit(1).0, Vec3::unit(2).0])
    }
    /// The zero matrix.
    #[inline(always)]
    pub fn zero() -> Self {
        Mat3([[T::zero(); 3]; 3])
    }
    /// Constants of the model, in every lane.
    #[inline(always)]
    pub fn constant(m: &Mat3<T::Constant>) -> Self {
        let [a, b, c] = m.0;
        Mat3([Vec3::constant(Vec3(a)).0, Vec3::constant(Vec3(b)).0, Vec3::constant(Vec3(c)).0])
    }
    /// The matrix with these columns.
    #[inline(always)]
    pub fn from_columns(a: Vec3<T>, b: Vec3<T>, c: Vec3<T>) -> Self {
        let ([a0, a1, a2], [b0, b1, b2], [c0, c1, c2]) = (a.0, b.0, c.0);
        Mat3([[a0, b0, c0], [a1, b1, c1], [a2, b2, c2]])
    }
    /// The j-th column.
    #[inline(always)]
    pub fn column(&self, j: usize) -> Vec3<T> {
        Vec3([self.0[0][j], self.0[1][j], self.0[2][j]])
    }
    /// The i-th row.
    #[inline(always)]
    pub fn row(&self, i: usize) -> Vec3<T> {
        Vec3(self.0[i])
    }
    /// The transpose.
    #[inline(always)]
    pub fn transpose(&self) -> Self {
        Mat3([self.column(0).0, self.column(1).0, self.column(2).0])
    }
    /// Aᵀ v.
    #[inline(always)]
    pub fn transpose_mul(&self, v: Vec3<T>) -> Vec3<T> {
        Vec3([self.column(0).dot(v), self.column(1).dot(v), self.column(2).dot(v)])
    }
    /// The skew matrix of a: `skew(a) b = a × b`.
    #[inline(always)]
    pub fn skew(a: Vec3<T>) -> Self {
        let ([x, y, z], o) = (a.0, T::zero());
        Mat3([[o, -z, y], [z, o, -x], [-y, x, o]])
    }
    /// s A.
    #[inline(always)]
    pub fn scale(&self, s: T) -> Self {
        Mat3([self.row(0).scale(s).0, self.row(1).scale(s).0, self.row(2).scale(s).0])
    }
}

impl<T: Scalar> Mul<Vec3<T>> for Mat3<T> {
    type Output = Vec3<T>;
    #[inline(always)]
    fn mul(self, v: Vec3<T>) -> Vec3<T> {
        Vec3([self.row(0).dot(v), self.row(1).dot(v), self.row(2).dot(v)])
    }
}
impl<T: Scalar> Mul for Mat3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Mat3::from_columns(self * b.column(0), self * b.column(1), self * b.column(2))
    }
}
impl<T: Scalar> Add for Mat3<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Mat3([(self.row(0) + b.row(0)).0, (self.row(1) + b.row(1)).0, (self.row(2) + b.row(2)).0])
    }
}
impl<T: Scalar> Sub for Mat3<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Mat3([(self.row(0) - b.row(0)).0, (self.row(1) - b.row(1)).0, (self.row(2) - b.row(2)).0])
    }
}

impl<T: Scalar> Sym3<T> {
    /// The zero matrix.
    #[inline(always)]
    pub fn zero() -> Self {
        Self::diagonal(T::zero())
    }
    /// s I.
    #[inline(always)]
    pub fn diagonal(s: T) -> Self {
        let o = T::zero();
        Sym3 { xx: s, xy: o, xz: o, yy: s, yz: o, zz: s }
    }
    /// Constants of the model, in every lane.
    #[inline(always)]
    pub fn constant(s: &Sym3<T::Constant>) -> Self {
        let c = T::constant;
        Sym3 { xx: c(s.xx), xy: c(s.xy), xz: c(s.xz), yy: c(s.yy), yz: c(s.yz), zz: c(s.zz) }
    }
    /// The symmetric part's entries of a matrix, read from its upper triangle.
    #[inline(always)]
    pub fn from_upper(m: &Mat3<T>) -> Self {
        let a = &m.0;
        Sym3 { xx: a[0][0], xy: a[0][1], xz: a[0][2], yy: a[1][1], yz: a[1][2], zz: a[2][2] }
    }
    /// The full matrix.
    #[inline(always)]
    pub fn to_mat3(&self) -> Mat3<T> {
        Mat3([[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]])
    }
    /// The six entries xx, xy, xz, yy, yz, zz.
    pub fn entries(&self) -> [T; 6] {
        [self.xx, self.xy, self.xz, self.yy, self.yz, self.zz]
    }
    /// The j-th column.
    #[inline(always)]
    pub fn column(&self, j: usize) -> Vec3<T> {
        match j {
            0 => Vec3([self.xx, self.xy, self.xz]),
            1 => Vec3([self.xy, self.yy, self.yz]),
            _ => Vec3([self.xz, self.yz, self.zz]),
        }
    }
    /// R S Rᵀ.
    #[inline(always)]
    pub fn rotate(&self, r: &Mat3<T>) -> Self {
        let rs = *r * self.to_mat3();
        Sym3 {
            xx: rs.row(0).dot(r.row(0)),
            xy: rs.row(0).dot(r.row(1)),
            xz: rs.row(0).dot(r.row(2)),
            yy: rs.row(1).dot(r.row(1)),
            yz: rs.row(1).dot(r.row(2)),
            zz: rs.row(2).dot(r.row(2)),
        }
    }
    /// S += s (a bᵀ + b aᵀ)/2 with a = b: the symmetric rank-one update s a aᵀ.
    #[inline(always)]
    pub fn add_outer(&mut self, a: Vec3<T>, s: T) {
        let [x, y, z] = a.0;
        let [sx, sy, sz] = a.scale(s).0;
        self.xx += sx * x;
        self.xy += sx * y;
        self.xz += sx * z;
        self.yy += sy * y;
        self.yz += sy * z;
        self.zz += sz * z;
    }
    /// S += a bᵀ, where a is a multiple of b.
    #[inline(always)]
    pub fn add_product(&mut self, a: Vec3<T>, b: Vec3<T>) {
        let ([a0, a1, a2], [b0, b1, b2]) = (a.0, b.0);
        self.xx = a0.fma(b0, self.xx);
        self.xy = a0.fma(b1, self.xy);
        self.xz = a0.fma(b2, self.xz);
        self.yy = a1.fma(b1, self.yy);
        self.yz = a1.fma(b2, self.yz);
        self.zz = a2.fma(b2, self.zz);
    }
    /// The inertia matrix m (|c|² I − c cᵀ) of a point mass at c.
    #[inline(always)]
    pub fn point_mass(m: T, c: Vec3<T>) -> Self {
        let mut s = Self::diagonal(m * c.dot(c));
        s.add_outer(c, -m);
        s
    }
}

impl<T: Scalar> Mul<Vec3<T>> for Sym3<T> {
    type Output = Vec3<T>;
    #[inline(always)]
    fn mul(self, v: Vec3<T>) -> Vec3<T> {
        Vec3([self.column(0).dot(v), self.column(1).dot(v), self.column(2).dot(v)])
    }
}
impl<T: Scalar> Add for Sym3<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Sym3 {
            xx: self.xx + b.xx,
            xy: self.xy + b.xy,
            xz: self.xz + b.xz,
            yy: self.yy + b.yy,
            yz: self.yz + b.yz,
            zz: self.zz + b.zz,
        }
    }
}
