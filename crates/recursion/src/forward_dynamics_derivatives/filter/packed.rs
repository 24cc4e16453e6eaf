//! The filter's step on six-vectors in lanes ([`crate::packed`]), in the axes of the ground.
//!
//! φ (P − U D⁻¹ U*) φ* is calculated as φ P φ* − (φ U) D⁻¹ (φ U)*: P moves while D waits for its sums and its division.

use super::{Carried, Moved, Sweep, pivot};
use crate::error::DynamicsError;
use crate::ground_axes::{AXIS, COMPOSITE, OFFSET};
use crate::inverse_dynamics_derivatives::{ALPHA, FORCE, ROWS};
use crate::layout::{GROUND, LayoutBody};
use crate::packed::{Lever, Packed};
use crate::places::{Aligned, Places, View, each_place};
use phipsi_spatial::wide::{WIDEST, Wide};
use phipsi_spatial::{RigidInertia, Scalar, SixLanes, Vec3, Wrench};

/// Numbers of a body: its own inertia as [`SixLanes::rigid_columns`] reads it, the force of its turning and of loads as a packed
/// six-vector, and d as [`Lever`] reads it.
const NUMBERS: usize = 32;
const INERTIA: usize = 0;
const TURNING: usize = 16;
const LEVER: usize = 24;

/// What the step reads of the bodies, one body after the other, by places.
#[derive(Clone, Debug)]
pub(super) struct OwnNumbers<T>(Aligned<T>);

impl<T: Scalar> OwnNumbers<T> {
    /// Empty where numbers have no lanes.
    pub(super) fn new(places: &Places) -> Self {
        if T::COLUMNS == 1 { OwnNumbers(Aligned::new(0)) } else { Self::with_room(places) }
    }
    pub(super) fn with_room(places: &Places) -> Self {
        OwnNumbers(Aligned::new(NUMBERS * places.count))
    }
    /// Turns the rows of the table over.
    #[inline(always)]
    pub(super) fn gather<W: Wide<T>>(&mut self, places: &Places, view: &mut View<'_, T, ROWS>) {
        let zero = W::zero();
        for &at in places.with_bodies(W::COUNT) {
            let group = view.at(at);
            let RigidInertia { mass, first_moment: Vec3([x, y, z]), inertia: J } =
                group.rigid::<W>(COMPOSITE);
            let Wrench { moment: Vec3([a, b, c]), force: Vec3([d, e, f]) } = group.wrench::<W>(FORCE);
            let Vec3([u, v, w]) = group.vector::<W>(OFFSET);
            let rows = [
                [J.xx, J.xy, J.xz, J.yy, J.yz, J.zz, x, y],
                [z, -x, -y, -z, mass, zero, zero, zero],
                [a, b, c, zero, d, e, f, zero],
                [u, v, w, u, v, zero, zero, zero],
            ];
            let bodies = &mut self.0[at * NUMBERS..][..W::COUNT * NUMBERS];
            for (part, rows) in rows.into_iter().enumerate() {
                turn_over::<T, W>(rows, part * WIDEST, bodies);
            }
        }
    }
    /// Of all bodies.
    #[inline(always)]
    pub(super) fn all(&self) -> &[T] {
        &self.0
    }
}

/// Writes eight rows of some places, from number `first` of each place on.
#[inline(always)]
fn turn_over<T: Scalar, W: Wide<T>>(rows: [W; WIDEST], first: usize, bodies: &mut [T]) {
    for part in 0..WIDEST / W::COUNT {
        let mut tile = [W::zero(); WIDEST];
        each_place!(W, I => tile[I] = rows[part * W::COUNT + I]);
        W::transpose(&mut tile);
        let start = first + part * W::COUNT;
        W::store_rows(&tile, NUMBERS, &mut bodies[start..]);
    }
}

/// Eight numbers from the first of a slice on.
#[inline(always)]
fn eight<T: Scalar, S: SixLanes<T>>(x: &[T]) -> S {
    let mut numbers = [T::zero(); 8];
    numbers.copy_from_slice(&x[..8]);
    S::of(numbers)
}

impl<T: Scalar> Carried<T> for Packed<T::Six> {
    #[inline(always)]
    fn zero() -> Self {
        Packed::zero::<T>()
    }
    #[inline(always)]
    fn add(&mut self, other: &Self) {
        Packed::add::<T>(self, other);
    }
    #[inline(always)]
    fn of((P, z): &Moved<T>) -> Self {
        Packed::pack(P, z)
    }
    #[inline(always)]
    fn numbers(&self) -> Moved<T> {
        self.unpack()
    }
    #[inline(always)]
    fn pass_axis<const LINEAR: bool>(
        &mut self,
        own: &[T],
        body: &LayoutBody<T::Constant>,
        place: usize,
        Sweep { layout, view, gains, residuals, .. }: &mut Sweep<'_, '_, T>,
    ) -> Result<(), DynamicsError> {
        let (own, here) = (&own[place * NUMBERS..][..NUMBERS], view.at(place));
        let mut entries = [T::zero(); 16];
        entries.copy_from_slice(&own[INERTIA..][..16]);
        let M = <T::Six as SixLanes<T>>::rigid_columns(&entries);
        for i in 0..6 {
            self.P[i] = self.P[i] + M[i];
        }
        self.z = self.z + eight(&own[TURNING..]);
        let root = body.parent == GROUND;
        if !root {
            self.add_acceleration(&here.motion::<T>(ALPHA));
        }
        let s = here.vector::<T>(AXIS);
        let b = if LINEAR { here.vector::<T>(AXIS + 3) } else { Vec3::zero() };
        let P = &self.P;
        let mut U = sum([P[0], P[1], P[2]], s);
        let mut D = sum(first(U), s);
        let mut along = sum(first(self.z), s);
        let trace = P[0].broadcast::<0>() + P[1].broadcast::<1>() + P[2].broadcast::<2>();
        let mut scale = trace.lane_0();
        if LINEAR {
            U = U + sum([P[3], P[4], P[5]], b);
            D = sum(first(U), s) + sum(second(U), b);
            along = along + sum(second(self.z), b);
            let mass = P[3].broadcast::<4>() + P[4].broadcast::<5>() + P[5].broadcast::<6>();
            scale = s.dot(s) * scale + b.dot(b) * mass.lane_0();
        }
        pivot(layout, body.v, D.lane_0(), scale)?;
        let wide = D.reciprocal();
        let inverse = wide.lane_0();
        let innovation = T::Six::fill(residuals[body.v]) - along;
        residuals[body.v] = (innovation * wide).lane_0();
        let [x, y, z, _, u, v, w, _] = (U * wide).to_array();
        gains.set(place, Wrench::new(Vec3([x, y, z]), Vec3([u, v, w])), inverse);
        if root {
            return Ok(());
        }
        let lever = Lever::of_three::<T>(&own[LEVER..]);
        let (dx, dy, dz) =
            (T::Six::fill(own[LEVER]), T::Six::fill(own[LEVER + 1]), T::Six::fill(own[LEVER + 2]));
        let [a, b, c, d, e, f] = self.P;
        let (d, e, f) = (lever.up(d), lever.up(e), lever.up(f));
        let (a, b, c) = (lever.up(a), lever.up(b), lever.up(c));
        // The same from the right.
        let a = dz.subtract_from(e, dy.times_plus(f, a));
        let b = dx.subtract_from(f, dz.times_plus(d, b));
        let c = dy.subtract_from(d, dx.times_plus(e, c));
        let U = lever.up(U);
        let G = U * wide;
        self.P = [
            G.subtract_from(U.broadcast::<0>(), a),
            G.subtract_from(U.broadcast::<1>(), b),
            G.subtract_from(U.broadcast::<2>(), c),
            G.subtract_from(U.broadcast::<4>(), d),
            G.subtract_from(U.broadcast::<5>(), e),
            G.subtract_from(U.broadcast::<6>(), f),
        ];
        self.z = G.times_plus(innovation, lever.up(self.z));
        Ok(())
    }
}

/// x a + y b + z c.
#[inline(always)]
fn sum<T: Scalar, S: SixLanes<T>>([a, b, c]: [S; 3], Vec3([x, y, z]): Vec3<T>) -> S {
    a.times_plus(S::fill(x), b.times_plus(S::fill(y), c * S::fill(z)))
}

/// Coordinates of the first half, each in all lanes.
#[inline(always)]
fn first<T: Scalar, S: SixLanes<T>>(x: S) -> [S; 3] {
    [x.broadcast::<0>(), x.broadcast::<1>(), x.broadcast::<2>()]
}

/// The same of the second half.
#[inline(always)]
fn second<T: Scalar, S: SixLanes<T>>(x: S) -> [S; 3] {
    [x.broadcast::<4>(), x.broadcast::<5>(), x.broadcast::<6>()]
}
