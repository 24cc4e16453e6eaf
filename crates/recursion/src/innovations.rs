//! The innovations operator L = I − HψK as a matrix, and M⁻¹ = L* D⁻¹ L with it.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | z | K e_c of a unit innovation at c, moved inward by ψ | 6 | soa.md 3.1 |
//! | L | I − HψK: ε = L T; entry (i, c) is −H(i) z(i), zero unless i lies on the way from c to the base | nv×nv | soa.md 3.1 |
//! | D | articulated joint inertias | nv | paper 1 (9.5) |
//!
//! L is unit triangular in the order of elimination (joints outboard first, components of a joint in their order). Nothing is
//! subtracted in products with it that the filter does not subtract too: it keeps the digits that a Cholesky factor of M loses
//! where heavy bodies hang on light ones.

use crate::articulated_sweep::{ArticulatedSweep, Pivot};
use crate::columns::{WidePassage, vector};
use crate::error::DynamicsError;
use crate::hinge::Hinge;
use crate::layout::{GROUND, Layout, Shifts};
use crate::side_by_side::{Places, ROWS, Rows};
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{Scalar, Wrench};

/// L and D⁻¹ of one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Innovations<T> {
    pub(crate) places: Places,
    /// For groups of rows: where L, and where L*, is not zero.
    outboard: Vec<(usize, usize)>,
    inboard: Vec<Vec<(usize, usize)>>,
    /// L. What is zero for every configuration is never anything else between calls.
    operator: Vec<T>,
    /// D⁻¹, by places.
    inverse: Vec<T>,
    /// z of every column, by components.
    gains: Vec<T>,
    /// −D⁻¹ L B of two matrices B.
    scaled: [Vec<T>; 2],
}

impl<T: Scalar> Innovations<T> {
    /// A workspace for a layout.
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let places = Places::new::<T>(layout);
        Innovations {
            outboard: places.outboard_spans(),
            inboard: places.inboard_spans::<T>(layout),
            operator: places.zeros(),
            inverse: vec![T::zero(); places.stride],
            gains: vec![T::zero(); 6 * places.stride],
            scaled: [places.zeros(), places.zeros()],
            places,
        }
    }
    /// Takes the pivots of an articulated sweep and the shifts of the same configuration. Cost O(n · depth), no allocation.
    #[inline(always)]
    pub(crate) fn update<W: Wide<T>>(
        &mut self,
        layout: &Layout<T::Constant>,
        pivots: &[Pivot<T>],
        shifts: &Shifts<T>,
    ) {
        let Innovations { places, operator, inverse: inverses, gains, .. } = self;
        let s = places.stride;
        let mut z = Rows::<T, 6>::new(gains, s);
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let (first, end) = (places.first[k], places.end[k]);
            let inner = first + body.hinge.nv();
            // Own columns, out of the way of the groups.
            let mut own = [Wrench::<T>::zero(); 6];
            for i in 0..inner - first {
                let Pivot { gain, inverse } = pivots[body.v + i];
                let row = &mut operator[(first + i) * s..(first + i + 1) * s];
                inverses[first + i] = inverse;
                let wide = Wrench::new(vector::<T, W>(gain.moment), vector(gain.force));
                let mut at = end;
                while at > inner {
                    at -= W::COUNT;
                    let mut moved = z.wrench::<W>(0, at);
                    let innovation = -match body.hinge {
                        Hinge::Revolute => moved.moment.0[2],
                        _ => body.hinge.project(i, &moved),
                    };
                    add_scaled(&mut moved, &wide, innovation);
                    innovation.store(&mut row[at..]);
                    z.set_wrench(0, at, moved);
                }
                if W::COUNT > 1 {
                    W::zero().store(&mut row[first - W::COUNT..]);
                }
                // Innovations of the axes before this one in the joint; none of those that come after.
                for c in 0..inner - first {
                    let entry = &mut row[first + c];
                    *entry = if c == i { T::one() } else { T::zero() };
                    if c < i {
                        let innovation = -body.hinge.project(i, &own[c]);
                        add_scaled(&mut own[c], &gain, innovation);
                        *entry = innovation;
                    }
                }
                own[i] = gain;
            }
            for i in 0..inner - first {
                z.set_wrench(0, first + i, own[i]);
            }
            if matches!(body.hinge, Hinge::Free) {
                // G = I: the joint passes its own force and nothing of what comes from outboard.
                for at in first..end {
                    let passed = if at < inner { Wrench::unit(at - first) } else { Wrench::zero() };
                    z.set_wrench::<T>(0, at, passed);
                }
            }
            if body.parent != GROUND {
                let passage = WidePassage::<T, W>::new(body, shifts.at(k, body));
                let mut at = end;
                while at > first {
                    at -= W::COUNT;
                    z.set_wrench(0, at, passage.wrench_to_parent(z.wrench::<W>(0, at)));
                }
            }
        }
    }
    /// −M⁻¹ B for two matrices B of the places, to the model's order.
    #[inline(always)]
    pub(crate) fn negative_solve<W: Wide<T>>(&mut self, b: [&[T]; 2], out: [&mut [T]; 2]) {
        let Innovations { places, outboard, inboard, operator, inverse, scaled: [first, second], .. } = self;
        let s = places.stride;
        // Y = −D⁻¹ L B.
        for (block, &(low, high)) in outboard.iter().enumerate() {
            let row = places.margin + block * ROWS;
            let (mut rows, n) = (operator[row * s..(row + ROWS) * s].chunks_exact(s), high - low);
            let mut next = || rows.next().unwrap_or_default()[low..high][..n].as_ref();
            let weights: [&[T]; ROWS] = [next(), next(), next(), next()];
            let mut at = places.margin;
            while at < places.past {
                let end = at + W::COUNT;
                let mut sums = [[W::zero(); ROWS]; 2];
                let rows =
                    b[0][low * s..high * s].chunks_exact(s).zip(b[1][low * s..high * s].chunks_exact(s));
                for (c, (x, y)) in rows.enumerate().take(n) {
                    let (x, y) = (W::load(&x[at..end]), W::load(&y[at..end]));
                    for r in 0..ROWS {
                        let weight = W::broadcast(weights[r][c]);
                        sums[0][r] = x.fma(weight, sums[0][r]);
                        sums[1][r] = y.fma(weight, sums[1][r]);
                    }
                }
                for r in 0..ROWS {
                    let scale = -W::broadcast(inverse[row + r]);
                    (sums[0][r] * scale).store(&mut first[(row + r) * s + at..]);
                    (sums[1][r] * scale).store(&mut second[(row + r) * s + at..]);
                }
                at += W::COUNT;
            }
        }
        // L* Y.
        let [out_first, out_second] = out;
        for (block, spans) in inboard.iter().enumerate() {
            let row = places.margin + block * ROWS;
            let mut at = places.margin;
            while at < places.past {
                let end = at + W::COUNT;
                let mut sums = [[W::zero(); ROWS]; 2];
                for &(low, high) in spans {
                    let range = low * s..high * s;
                    let rows =
                        first[range.clone()].chunks_exact(s).zip(second[range.clone()].chunks_exact(s));
                    for ((x, y), weights) in rows.zip(operator[range].chunks_exact(s)) {
                        let (x, y) = (W::load(&x[at..end]), W::load(&y[at..end]));
                        let weights = &weights[row..row + ROWS];
                        for r in 0..ROWS {
                            let weight = W::broadcast(weights[r]);
                            sums[0][r] = x.fma(weight, sums[0][r]);
                            sums[1][r] = y.fma(weight, sums[1][r]);
                        }
                    }
                }
                for r in 0..ROWS.min(places.past - row) {
                    places.write(row + r, at, sums[0][r], out_first);
                    places.write(row + r, at, sums[1][r], out_second);
                }
                at += W::COUNT;
            }
        }
    }
    /// M⁻¹ = L* D⁻¹ L, full and symmetric, in the model's order.
    #[inline(always)]
    pub(crate) fn inverse_mass_matrix<W: Wide<T>>(&self, out: &mut [T]) {
        let Innovations { places, inboard, operator, inverse, .. } = self;
        let s = places.stride;
        for (block, spans) in inboard.iter().enumerate() {
            let row = places.margin + block * ROWS;
            let mut at = row - (row - places.margin) % W::COUNT;
            while at < places.past {
                let end = at + W::COUNT;
                let mut sums = [W::zero(); ROWS];
                for &(low, high) in spans {
                    let rows = operator[low * s..high * s].chunks_exact(s);
                    for (weights, inverse) in rows.zip(&inverse[low..high]) {
                        let y = W::load(&weights[at..end]) * W::broadcast(*inverse);
                        let weights = &weights[row..row + ROWS];
                        for r in 0..ROWS {
                            sums[r] = y.fma(W::broadcast(weights[r]), sums[r]);
                        }
                    }
                }
                for r in 0..ROWS.min(places.past - row) {
                    places.write(row + r, at, sums[r], out);
                }
                at += W::COUNT;
            }
        }
        places.mirror(out);
    }
}

/// z += x g.
#[inline(always)]
fn add_scaled<T: Scalar>(z: &mut Wrench<T>, g: &Wrench<T>, x: T) {
    z.moment = g.moment.scale_add(x, z.moment);
    z.force = g.force.scale_add(x, z.force);
}

/// [`Innovations::update`] by itself.
struct Update<'a, T: Scalar> {
    innovations: &'a mut Innovations<T>,
    layout: &'a Layout<T::Constant>,
    pivots: &'a [Pivot<T>],
    shifts: &'a Shifts<T>,
}

impl<T: Scalar> WideKernel<T> for Update<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T>>(self) {
        self.innovations.update::<W>(self.layout, self.pivots, self.shifts);
    }
}

/// L(q) by rows, nv×nv. `q`: nq. Cost O(n · depth) besides writing the zeros.
///
/// # Errors
/// Those of [`crate::ArticulatedSweep::new`].
pub fn innovations_operator<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> Result<Vec<T>, DynamicsError> {
    let sweep = ArticulatedSweep::new(layout, q)?;
    let mut innovations = Innovations::new(layout);
    let (pivots, shifts) = (&sweep.pivots, &sweep.shifts);
    T::Arithmetic::dispatch_wide(Update { innovations: &mut innovations, layout, pivots, shifts });
    let mut out = vec![T::zero(); layout.nv() * layout.nv()];
    let Innovations { places, operator, .. } = &innovations;
    places.write_all::<_, T::Arithmetic>(operator, T::arithmetic_mut(&mut out));
    Ok(out)
}
