//! The filter's step on six-vectors in lanes ([`crate::packed`]), in the axes of the ground.
//!
//! φ (P − U D⁻¹ U*) φ* is calculated as φ P φ* − (φ U) D⁻¹ (φ U)*: P moves while D waits for its sums and its division.

use super::{Carried, Moved, Sweep, own_inertia, pivot};
use crate::error::DynamicsError;
use crate::ground_axes::{AXIS, OFFSET};
use crate::inverse_dynamics_derivatives::{ALPHA, FORCE, ROWS};
use crate::layout::{GROUND, LayoutBody};
use crate::packed::{Lever, Packed};
use crate::places::Table;
use phipsi_spatial::six_lanes::rigid_entries;
use phipsi_spatial::{Scalar, SixLanes, Vec3, Wrench};

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
        body: &LayoutBody<T::Constant>,
        place: usize,
        Sweep { layout, view, gains, residuals, .. }: &mut Sweep<'_, '_, T>,
    ) -> Result<(), DynamicsError> {
        let here = view.lane(Table::<T, ROWS>::start(place));
        let M = <T::Six as SixLanes<T>>::rigid_columns(&rigid_entries(&own_inertia(&here)));
        for i in 0..6 {
            self.P[i] = self.P[i] + M[i];
        }
        let turning = here.motion(FORCE);
        self.z = self.z + Packed::lanes(&Wrench::new(turning.angular, turning.linear));
        let root = body.parent == GROUND;
        if !root {
            self.add_acceleration(&here.motion(ALPHA));
        }
        let s = here.vector(AXIS);
        let b = if LINEAR { here.vector(AXIS + 3) } else { Vec3::zero() };
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
        let [x, y, z] = here.vector(OFFSET).0;
        let lever = Lever::new(x, y, z);
        let (dx, dy, dz) = (T::Six::fill(x), T::Six::fill(y), T::Six::fill(z));
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
