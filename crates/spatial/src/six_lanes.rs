//! Six-vectors in lanes: what one state offers to SIMD where there are no other states.
//!
//! A packed six-vector is (x, y, z, any | x, y, z, any): moment and force, or angular and linear part; fourth numbers are finite and do not
//! matter. Turns act on both halves at once, with the partner coordinate brought by a permutation.

use crate::Scalar;
use core::ops::{Add, Mul, Neg, Sub};

/// A rigid inertia as [`SixLanes::rigid`] reads it: the columns of J, three numbers each; m; the columns of h~, three numbers each; a zero. A
/// register of four numbers takes a column and a number that does not matter.
pub type RigidEntries<C> = [C; 20];

/// The entries of a rigid inertia, in the order of [`RigidEntries`].
pub fn rigid_entries<C: Scalar>(m: &crate::RigidInertia<C>) -> RigidEntries<C> {
    let ([x, y, z], J, o) = (m.first_moment.0, &m.inertia, C::zero());
    let [a, b, c] = [[J.xx, J.xy, J.xz], [J.xy, J.yy, J.yz], [J.xz, J.yz, J.zz]];
    let [[d, e, f], [g, h, i], [j, k, l]] = [[o, z, -y], [-z, o, x], [y, -x, o]];
    [a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2], m.mass, d, e, f, g, h, i, j, k, l, o]
}

/// Where each column of a rigid inertia takes its lanes from; 19 is a zero. Columns are those of [[J, h~], [−h~, m 1]].
pub(crate) const RIGID_COLUMNS: [[usize; 8]; 6] = [
    [0, 1, 2, 19, 19, 13, 16, 19],
    [3, 4, 5, 19, 11, 19, 17, 19],
    [6, 7, 8, 19, 12, 15, 19, 19],
    [19, 11, 12, 19, 9, 19, 19, 19],
    [13, 19, 15, 19, 19, 9, 19, 19],
    [16, 17, 19, 19, 19, 19, 9, 19],
];

/// A packed six-vector of numbers `T`.
///
/// Everything but [`SixLanes::is_fast`] and [`SixLanes::zeros`] is only to be called where the former is true or the type is
/// [`Eight`]: elsewhere a processor may meet instructions that it does not have.
pub trait SixLanes<T: Scalar>:
    Copy
    + core::fmt::Debug
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
{
    /// True if lanes are those of a register.
    const IN_REGISTERS: bool;
    /// True where the processor works on all lanes at once.
    fn is_fast() -> bool;
    /// Eight lanes.
    fn of(x: [T; 8]) -> Self;
    /// The lanes.
    fn to_array(self) -> [T; 8];
    /// One number in all lanes.
    fn fill(x: T) -> Self;
    /// Zeros, on every processor: workspaces are filled with them before anything is asked.
    #[inline(always)]
    fn zeros() -> Self {
        Self::fill(T::zero())
    }
    /// 1 / x of every lane.
    fn reciprocal(self) -> Self;
    /// `self * a + b`.
    fn times_plus(self, a: Self, b: Self) -> Self;
    /// `b − self * a`.
    fn subtract_from(self, a: Self, b: Self) -> Self;
    /// `b − self * a` with zero in lane I.
    fn eliminate<const I: usize>(self, a: Self, b: Self) -> Self;
    /// (x, y, z, 0) in both halves.
    fn halves(x: T, y: T, z: T) -> Self;
    /// (x, y, z, 0) in the first half, zeros in the second.
    fn first_half(x: T, y: T, z: T) -> Self;
    /// (c, c, 1, 0) and (−s, s, 0, 0) in both halves: a turn about z is v ↦ c∘v + s∘(v with x and y exchanged).
    #[inline(always)]
    fn about_z(cos: T, sin: T) -> (Self, Self) {
        (Self::halves(cos, cos, T::one()), Self::halves(-sin, sin, T::zero()))
    }
    /// (1, c, c, 0) and (0, −s, s, 0) in both halves.
    #[inline(always)]
    fn about_x(cos: T, sin: T) -> (Self, Self) {
        (Self::halves(T::one(), cos, cos), Self::halves(T::zero(), -sin, sin))
    }
    /// x and y of both halves exchanged.
    fn swap_xy(self) -> Self;
    /// y and z of both halves exchanged.
    fn swap_yz(self) -> Self;
    /// (y, z, x) of both halves.
    fn yzx(self) -> Self;
    /// (z, x, y) of both halves.
    fn zxy(self) -> Self;
    /// Moment + l × force, where `ahead` is (y, z, x) and `back` (z, x, y) of l in the first half, with zeros in the second.
    fn levered(self, ahead: Self, back: Self) -> Self;
    /// Lane I in all lanes.
    fn broadcast<const I: usize>(self) -> Self;
    /// Lane 0.
    fn lane_0(self) -> T;
    /// The vector with x in lane 2.
    fn with_lane_2(self, x: Self) -> Self;
    /// The six columns of a rigid inertia.
    fn rigid(m: &RigidEntries<T::Constant>) -> [Self; 6];
    /// The same of an inertia that is not a constant.
    fn rigid_columns(m: &RigidEntries<T>) -> [Self; 6];
}

/// Eight numbers of any scalar, one after the other.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub struct Eight<T>([T; 8]);

macro_rules! each {
    ($i:ident => $x:expr) => {
        Eight([
            {
                const $i: usize = 0;
                $x
            },
            {
                const $i: usize = 1;
                $x
            },
            {
                const $i: usize = 2;
                $x
            },
            {
                const $i: usize = 3;
                $x
            },
            {
                const $i: usize = 4;
                $x
            },
            {
                const $i: usize = 5;
                $x
            },
            {
                const $i: usize = 6;
                $x
            },
            {
                const $i: usize = 7;
                $x
            },
        ])
    };
}

impl<T: Scalar> Add for Eight<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        each!(I => self.0[I] + b.0[I])
    }
}
impl<T: Scalar> Sub for Eight<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        each!(I => self.0[I] - b.0[I])
    }
}
impl<T: Scalar> Mul for Eight<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        each!(I => self.0[I] * b.0[I])
    }
}
impl<T: Scalar> Neg for Eight<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        each!(I => -self.0[I])
    }
}

impl<T: Scalar> Eight<T> {
    #[inline(always)]
    fn pick(self, lanes: [usize; 8]) -> Self {
        each!(I => self.0[lanes[I]])
    }
}

impl<T: Scalar> SixLanes<T> for Eight<T> {
    const IN_REGISTERS: bool = false;
    #[inline(always)]
    fn is_fast() -> bool {
        false
    }
    #[inline(always)]
    fn of(x: [T; 8]) -> Self {
        Eight(x)
    }
    #[inline(always)]
    fn to_array(self) -> [T; 8] {
        self.0
    }
    #[inline(always)]
    fn fill(x: T) -> Self {
        Eight([x; 8])
    }
    #[inline(always)]
    fn reciprocal(self) -> Self {
        each!(I => self.0[I].recip())
    }
    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        each!(I => self.0[I].fma(a.0[I], b.0[I]))
    }
    #[inline(always)]
    fn subtract_from(self, a: Self, b: Self) -> Self {
        each!(I => (-self.0[I]).fma(a.0[I], b.0[I]))
    }
    #[inline(always)]
    fn eliminate<const I: usize>(self, a: Self, b: Self) -> Self {
        let mut x = self.subtract_from(a, b);
        x.0[I] = T::zero();
        x
    }
    #[inline(always)]
    fn halves(x: T, y: T, z: T) -> Self {
        let o = T::zero();
        Eight([x, y, z, o, x, y, z, o])
    }
    #[inline(always)]
    fn first_half(x: T, y: T, z: T) -> Self {
        let o = T::zero();
        Eight([x, y, z, o, o, o, o, o])
    }
    #[inline(always)]
    fn swap_xy(self) -> Self {
        self.pick([1, 0, 2, 3, 5, 4, 6, 7])
    }
    #[inline(always)]
    fn swap_yz(self) -> Self {
        self.pick([0, 2, 1, 3, 4, 6, 5, 7])
    }
    #[inline(always)]
    fn yzx(self) -> Self {
        self.pick([1, 2, 0, 3, 5, 6, 4, 7])
    }
    #[inline(always)]
    fn zxy(self) -> Self {
        self.pick([2, 0, 1, 3, 6, 4, 5, 7])
    }
    #[inline(always)]
    fn levered(self, ahead: Self, back: Self) -> Self {
        let (zxy, yzx) = (self.pick([6, 4, 5, 7, 6, 4, 5, 7]), self.pick([5, 6, 4, 7, 5, 6, 4, 7]));
        back.subtract_from(yzx, ahead.times_plus(zxy, self))
    }
    #[inline(always)]
    fn broadcast<const I: usize>(self) -> Self {
        Eight([self.0[I]; 8])
    }
    #[inline(always)]
    fn lane_0(self) -> T {
        self.0[0]
    }
    #[inline(always)]
    fn with_lane_2(mut self, x: Self) -> Self {
        self.0[2] = x.0[2];
        self
    }
    #[inline(always)]
    fn rigid(m: &RigidEntries<T::Constant>) -> [Self; 6] {
        RIGID_COLUMNS.map(|lanes| Eight(lanes.map(|i| T::constant(m[i]))))
    }
    #[inline(always)]
    fn rigid_columns(m: &RigidEntries<T>) -> [Self; 6] {
        RIGID_COLUMNS.map(|lanes| Eight(lanes.map(|i| m[i])))
    }
}
