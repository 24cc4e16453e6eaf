//! Steps of the filter on one state whose six-vectors lie in lanes: an inertia is its six columns.
//!
//! The same recursion as in [`crate::articulated_sweep`], with all 36 entries in place of 21, in fewer instructions.
//!
//! | symbol | meaning |
//! |---|---|
//! | P | articulated inertia, by columns |
//! | z | bias force |
//! | U, D, G | column, pivot and gain of a hinge about z |

use crate::articulated_sweep::Pivot;
use crate::link::{Link, Shift};
use phipsi_spatial::six_lanes::RigidEntries;
use phipsi_spatial::{ArticulatedInertia, Mat3, Motion, Scalar, SixLanes, Sym3, Turn, Vec3, Wrench};

/// True for numbers of a state by itself: every state of a batch takes the steps that lanes of states take, for the same bits.
#[inline(always)]
pub(crate) fn is_lone<T: Scalar>() -> bool {
    core::any::TypeId::of::<T>() != core::any::TypeId::of::<T::Arithmetic>()
}

/// P and z of a body, or what its children gave.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Packed<S> {
    pub(crate) P: [S; 6],
    pub(crate) z: S,
}

/// Coefficients of a turn of both halves: v' = c∘v + s∘(v with two coordinates exchanged).
#[derive(Clone, Copy)]
struct Coefficients<S> {
    c: S,
    s: S,
}

impl<S> Coefficients<S> {
    #[inline(always)]
    fn about_z<T: Scalar>(turn: Turn<T>) -> Self
    where
        S: SixLanes<T>,
    {
        let (c, s) = S::about_z(turn.cos, turn.sin);
        Coefficients { c, s }
    }
    #[inline(always)]
    fn about_x<T: Scalar>(turn: Turn<T>) -> Self
    where
        S: SixLanes<T>,
    {
        let (c, s) = S::about_x(turn.cos, turn.sin);
        Coefficients { c, s }
    }
    #[inline(always)]
    fn z_up<T: Scalar>(self, v: S) -> S
    where
        S: SixLanes<T>,
    {
        self.c.times_plus(v, self.s * v.swap_xy())
    }
    #[inline(always)]
    fn x_up<T: Scalar>(self, v: S) -> S
    where
        S: SixLanes<T>,
    {
        self.c.times_plus(v, self.s * v.swap_yz())
    }
}

/// Columns i and j turned as the coordinates of a vector: (c a − s b, s a + c b).
#[inline(always)]
fn turn_columns<T: Scalar, S: SixLanes<T>>(c: S, s: S, a: S, b: S) -> (S, S) {
    (s.subtract_from(b, c * a), s.times_plus(a, c * b))
}

/// A gain and 1/D.
#[inline(always)]
pub(crate) fn pivot<T: Scalar, S: SixLanes<T>>(G: S, inverse: T) -> Pivot<T> {
    let [a, b, c, _, d, e, f, _] = G.to_array();
    Pivot { gain: Wrench::new(Vec3([a, b, c]), Vec3([d, e, f])), inverse }
}

/// What the filter keeps of a hinge or slider.
#[derive(Clone, Copy)]
pub(crate) struct Eliminated<T, S> {
    /// G.
    pub(crate) gain: S,
    /// 1/D.
    pub(crate) inverse: T,
    /// ν.
    pub(crate) nu: T,
}

impl<S> Packed<S> {
    #[inline(always)]
    pub(crate) fn zero<T: Scalar>() -> Self
    where
        S: SixLanes<T>,
    {
        let o = S::zeros();
        Packed { P: [o; 6], z: o }
    }
    #[inline(always)]
    pub(crate) fn add<T: Scalar>(&mut self, x: &Self)
    where
        S: SixLanes<T>,
    {
        for i in 0..6 {
            self.P[i] = self.P[i] + x.P[i];
        }
        self.z = self.z + x.z;
    }
    /// Adds the body's own inertia M and the forces b of its turning: (ω × J ω, ω × (ω × h)).
    #[inline(always)]
    pub(crate) fn add_body<T: Scalar>(&mut self, M: &RigidEntries<T::Constant>, omega: Vec3<T>)
    where
        S: SixLanes<T>,
    {
        let M = S::rigid(M);
        let [x, y, z] = omega.0;
        let momentum = M[0].times_plus(S::fill(x), M[1].times_plus(S::fill(y), M[2] * S::fill(z)));
        let b = S::halves(z, x, y).subtract_from(momentum.yzx(), S::halves(y, z, x) * momentum.zxy());
        for i in 0..6 {
            self.P[i] = self.P[i] + M[i];
        }
        self.z = self.z + b;
    }
    /// z += P a for a hinge about z, whose a has no component along it.
    #[inline(always)]
    pub(crate) fn add_coriolis<T: Scalar>(&mut self, a: &Motion<T>)
    where
        S: SixLanes<T>,
    {
        let (P, [x, y, _], [u, v, w]) = (&self.P, a.angular.0, a.linear.0);
        let angular = P[0].times_plus(S::fill(x), P[1].times_plus(S::fill(y), self.z));
        let linear = P[3].times_plus(S::fill(u), P[4].times_plus(S::fill(v), P[5] * S::fill(w)));
        self.z = angular + linear;
    }
    /// z += P a.
    #[inline(always)]
    pub(crate) fn add_acceleration<T: Scalar>(&mut self, a: &Motion<T>)
    where
        S: SixLanes<T>,
    {
        self.z = self.P[2].times_plus(S::fill(a.angular.0[2]), self.z);
        self.add_coriolis(a);
    }
    /// Filter step of a hinge about z: P⁺ and z⁺ from T. On failure D.
    #[inline(always)]
    pub(crate) fn eliminate_revolute<T: Scalar>(&mut self, T: T) -> Result<Eliminated<T, S>, f64>
    where
        S: SixLanes<T>,
    {
        let U = self.P[2];
        let D = U.broadcast::<2>();
        if !D.lane_0().is_positive() {
            return Err(D.lane_0().min_lane());
        }
        let inverse = D.reciprocal();
        let G = U * inverse;
        // By rows of P itself, which is symmetric to rounding only: row and column of the axis vanish together.
        self.P[0] = G.eliminate::<2>(self.P[0].broadcast::<2>(), self.P[0]);
        self.P[1] = G.eliminate::<2>(self.P[1].broadcast::<2>(), self.P[1]);
        self.P[3] = G.eliminate::<2>(self.P[3].broadcast::<2>(), self.P[3]);
        self.P[4] = G.eliminate::<2>(self.P[4].broadcast::<2>(), self.P[4]);
        self.P[5] = G.eliminate::<2>(self.P[5].broadcast::<2>(), self.P[5]);
        let all = S::fill(T);
        let epsilon = all - self.z.broadcast::<2>();
        // H G = 1: the component of z⁺ along the axis is T itself.
        self.z = G.times_plus(epsilon, self.z).with_lane_2(all);
        Ok(Eliminated { gain: G, inverse: inverse.lane_0(), nu: (epsilon * inverse).lane_0() })
    }
    /// The same for a joint along z.
    #[inline(always)]
    pub(crate) fn eliminate_prismatic<T: Scalar>(&mut self, T: T) -> Result<Eliminated<T, S>, f64>
    where
        S: SixLanes<T>,
    {
        let U = self.P[5];
        let D = U.broadcast::<6>();
        if !D.lane_0().is_positive() {
            return Err(D.lane_0().min_lane());
        }
        let inverse = D.reciprocal();
        let G = U * inverse;
        self.P[0] = G.eliminate::<6>(self.P[0].broadcast::<6>(), self.P[0]);
        self.P[1] = G.eliminate::<6>(self.P[1].broadcast::<6>(), self.P[1]);
        self.P[2] = G.eliminate::<6>(self.P[2].broadcast::<6>(), self.P[2]);
        self.P[3] = G.eliminate::<6>(self.P[3].broadcast::<6>(), self.P[3]);
        self.P[4] = G.eliminate::<6>(self.P[4].broadcast::<6>(), self.P[4]);
        self.P[5] = S::fill(T::zero());
        let epsilon = S::fill(T) - self.z.broadcast::<6>();
        self.z = G.times_plus(epsilon, self.z);
        Ok(Eliminated { gain: G, inverse: inverse.lane_0(), nu: (epsilon * inverse).lane_0() })
    }
    /// φ P⁺ φ* and φ z⁺, and φ G. With `HINGE`, after [`Packed::eliminate_revolute`]: the column of the hinge is zero.
    #[inline(always)]
    pub(crate) fn moved<T: Scalar, const HINGE: bool>(
        &self,
        link: &Link<T::Constant>,
        shift: &Shift<T>,
        gain: S,
    ) -> (Self, S)
    where
        S: SixLanes<T>,
    {
        let (turn, twist, [lx, ly, lz]) = (shift.turn, link.twist::<T>(), shift.offset.0);
        let up = Up {
            z: Coefficients::about_z(turn),
            x: Coefficients::about_x(twist),
            lever: Lever::new(lx, ly, lz),
        };
        let [a, b, g, d, e, f] = self.P;
        let (a, b, d, e, f) = (up.of(a), up.of(b), up.of(d), up.of(e), up.of(f));
        let (force, gain) = (up.of(self.z), up.of(gain));
        // The same from the right.
        let (c, s) = (S::fill(turn.cos), S::fill(turn.sin));
        let (a, b) = turn_columns(c, s, a, b);
        let (d, e) = turn_columns(c, s, d, e);
        let (c, s) = (S::fill(twist.cos), S::fill(twist.sin));
        let (b, g) = if HINGE { (c * b, s * b) } else { turn_columns(c, s, b, up.of(g)) };
        let (e, f) = turn_columns(c, s, e, f);
        let (lx, ly, lz) = (S::fill(lx), S::fill(ly), S::fill(lz));
        let a = lz.subtract_from(e, ly.times_plus(f, a));
        let b = lx.subtract_from(f, lz.times_plus(d, b));
        let g = ly.subtract_from(d, lx.times_plus(e, g));
        let moved = Packed { P: [a, b, g, d, e, f], z: force };
        match link.first_turn::<T>() {
            Some(first) => (moved.turned(first), Coefficients::about_z(first).z_up(gain)),
            None => (moved, gain),
        }
    }
    /// Turned about z, from both sides.
    #[inline(always)]
    fn turned<T: Scalar>(&self, turn: Turn<T>) -> Self
    where
        S: SixLanes<T>,
    {
        let (about, P) = (Coefficients::about_z(turn), &self.P);
        let (c, s) = (S::fill(turn.cos), S::fill(turn.sin));
        let (a, b) = turn_columns(c, s, about.z_up(P[0]), about.z_up(P[1]));
        let (d, e) = turn_columns(c, s, about.z_up(P[3]), about.z_up(P[4]));
        Packed { P: [a, b, about.z_up(P[2]), d, e, about.z_up(P[5])], z: about.z_up(self.z) }
    }
    /// A wrench in lanes.
    #[inline(always)]
    pub(crate) fn lanes<T: Scalar>(f: &Wrench<T>) -> S
    where
        S: SixLanes<T>,
    {
        let ([a, b, c], [d, e, f], o) = (f.moment.0, f.force.0, T::zero());
        S::of([a, b, c, o, d, e, f, o])
    }
    /// The same numbers for steps that have no packed form.
    #[inline(always)]
    pub(crate) fn unpack<T: Scalar>(&self) -> (ArticulatedInertia<T>, Wrench<T>)
    where
        S: SixLanes<T>,
    {
        let [a, b, c, d, e, f] = self.P;
        let (a, b, c) = (a.to_array(), b.to_array(), c.to_array());
        let (d, e, f, z) = (d.to_array(), e.to_array(), f.to_array(), self.z.to_array());
        let P = ArticulatedInertia {
            inertia: Sym3 { xx: a[0], xy: b[0], xz: c[0], yy: b[1], yz: c[1], zz: c[2] },
            coupling: Mat3([[d[0], e[0], f[0]], [d[1], e[1], f[1]], [d[2], e[2], f[2]]]),
            mass: Sym3 { xx: d[4], xy: e[4], xz: f[4], yy: e[5], yz: f[5], zz: f[6] },
        };
        (P, Wrench::new(Vec3([z[0], z[1], z[2]]), Vec3([z[4], z[5], z[6]])))
    }
    /// The reverse of [`Packed::unpack`].
    #[inline(always)]
    pub(crate) fn pack<T: Scalar>(P: &ArticulatedInertia<T>, z: &Wrench<T>) -> Self
    where
        S: SixLanes<T>,
    {
        let (J, C, m, o) = (&P.inertia, &P.coupling.0, &P.mass, T::zero());
        let ([a, b, c], [d, e, f]) = (z.moment.0, z.force.0);
        Packed {
            P: [
                S::of([J.xx, J.xy, J.xz, o, C[0][0], C[0][1], C[0][2], o]),
                S::of([J.xy, J.yy, J.yz, o, C[1][0], C[1][1], C[1][2], o]),
                S::of([J.xz, J.yz, J.zz, o, C[2][0], C[2][1], C[2][2], o]),
                S::of([C[0][0], C[1][0], C[2][0], o, m.xx, m.xy, m.xz, o]),
                S::of([C[0][1], C[1][1], C[2][1], o, m.xy, m.yy, m.yz, o]),
                S::of([C[0][2], C[1][2], C[2][2], o, m.xz, m.yz, m.zz, o]),
            ],
            z: S::of([a, b, c, o, d, e, f, o]),
        }
    }
}

/// φ(p, k) on columns, before Z(θ₀).
#[derive(Clone, Copy)]
struct Up<S> {
    z: Coefficients<S>,
    x: Coefficients<S>,
    lever: Lever<S>,
}

impl<S> Up<S> {
    #[inline(always)]
    fn of<T: Scalar>(self, v: S) -> S
    where
        S: SixLanes<T>,
    {
        self.lever.up(self.x.x_up(self.z.z_up(v)))
    }
}

/// Shifts of wrenches by a vector.
#[derive(Clone, Copy)]
pub(crate) struct Lever<S> {
    /// (y, z, x) and (z, x, y), in the first half.
    ahead: S,
    back: S,
}

impl<S> Lever<S> {
    #[inline(always)]
    pub(crate) fn new<T: Scalar>(x: T, y: T, z: T) -> Self
    where
        S: SixLanes<T>,
    {
        Lever { ahead: S::first_half(y, z, x), back: S::first_half(z, x, y) }
    }
    /// Moment + l × force.
    #[inline(always)]
    pub(crate) fn up<T: Scalar>(self, v: S) -> S
    where
        S: SixLanes<T>,
    {
        v.levered(self.ahead, self.back)
    }
}
