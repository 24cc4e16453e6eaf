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
use crate::error::DynamicsError;
use crate::ground_axes::{self, AXIS, OFFSET, linear_axes};
use crate::hinge::{Hinge, combine};
use crate::layout::{GROUND, Layout, Shifts};
use crate::places::{Places, Table, View, inside, vector};
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{Motion, Scalar, Wrench};

mod columns;
mod products;

use columns::Columns;
use products::Products;

/// Rows of the gain K of a degree of freedom, and of z.
const GAIN: usize = 0;
const MOVED: usize = 6;

/// L and D⁻¹ of one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Innovations<T> {
    linear: Vec<bool>,
    /// L. What is zero for every configuration is never anything else between calls.
    operator: Vec<T>,
    /// D⁻¹, by places.
    inverse: Vec<T>,
    gains: Table<T, 12>,
    products: Products<T>,
    /// Where products with M⁻¹ take more time than sweeps over the columns.
    columns: Option<Columns<T>>,
}

impl<T: Scalar> Innovations<T> {
    /// A workspace for a layout.
    pub(crate) fn new(layout: &Layout<T::Constant>, places: &Places) -> Self {
        Innovations {
            linear: linear_axes::<T>(layout, places),
            operator: places.zeros(),
            inverse: vec![T::zero(); places.count],
            gains: Table::new(places),
            products: Products::new(places),
            columns: None,
        }
    }
    /// For products with M⁻¹, too.
    pub(crate) fn with_products(layout: &Layout<T::Constant>, places: &Places) -> Self {
        Innovations { columns: Columns::new(layout, places), ..Self::new(layout, places) }
    }
    /// Takes the pivots of an articulated sweep and the bodies of the same configuration in the axes of the ground. Cost
    /// O(n · depth), no allocation.
    #[inline(always)]
    pub(crate) fn update<W: Wide<T>, const N: usize>(
        &mut self,
        layout: &Layout<T::Constant>,
        places: &Places,
        pivots: &[Pivot<T>],
        bodies: &mut View<'_, T, N>,
    ) {
        let Innovations { operator, inverse: inverses, gains, linear, .. } = self;
        let s = places.stride;
        let mut gains = gains.view();
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let (first, end) = (places.first[k], places.end[k]);
            let (count, linear) = (body.hinge.nv(), linear[first]);
            let inner = first + count;
            let here = bodies.at(first);
            let (axes, d) = (here.axes(), here.vector::<T>(OFFSET));
            let mut joint: (Motion<T>, Wrench<T>) = (here.motion(AXIS), Wrench::zero());
            for i in 0..count {
                let Pivot { gain, inverse } = pivots[body.v + i];
                joint.1 = Wrench::new(combine(&axes, gain.moment), combine(&axes, gain.force));
                let mut own = gains.at(first + i);
                own.set_wrench(GAIN, joint.1);
                own.set_wrench(MOVED, joint.1);
                inverses[first + i] = inverse;
            }
            let mut at = Places::group(first, W::COUNT);
            while at < end {
                let (from, to) = (first.saturating_sub(at), (end - at).min(W::COUNT));
                let own = inner.saturating_sub(at).min(W::COUNT);
                let mut z: Wrench<W> = gains.at(at).wrench(MOVED);
                for i in 0..count {
                    let mut innovation;
                    if count > 1 {
                        joint = (bodies.at(first + i).motion(AXIS), gains.at(first + i).wrench(GAIN));
                        innovation = -ground_axes::along::<T, W>(&joint.0, linear, &z).between(from, to);
                        // Axes of the joint that come after this one have no innovation here.
                        let later = (first + i).saturating_sub(at).min(W::COUNT);
                        innovation -= innovation.between(later, own.max(later));
                    } else {
                        innovation =
                            -ground_axes::along::<T, W>(&joint.0, linear, &z).between(own, to.max(own));
                    }
                    z.moment = vector::<T, W>(joint.1.moment).scale_add(innovation, z.moment);
                    z.force = vector::<T, W>(joint.1.force).scale_add(innovation, z.force);
                    innovation.store(&mut operator[(first + i) * s + at..]);
                }
                if body.parent != GROUND {
                    let d = inside(vector::<T, W>(d), from, to);
                    let mut group = gains.at(at);
                    group.set_vector(MOVED, d.cross_add(z.force, z.moment));
                    group.set_vector(MOVED + 3, z.force);
                }
                at += W::COUNT;
            }
            for i in first..inner {
                operator[i * s + i] = T::one();
            }
            if matches!(body.hinge, Hinge::Free) && body.parent != GROUND {
                // G = I: the joint passes its own force and nothing of what comes from outboard.
                for at in first..end {
                    let mut passed = Wrench::zero();
                    if at < inner {
                        let axis = bodies.at(at).motion::<T>(AXIS);
                        passed = Wrench::new(d.cross_add(axis.linear, axis.angular), axis.linear);
                    }
                    gains.at(at).set_wrench(MOVED, passed);
                }
            }
        }
    }
}

/// L, D⁻¹ and what they are calculated from.
#[derive(Clone, Debug)]
pub(crate) struct InnovationsSweep<T> {
    pub(crate) places: Places,
    bodies: Table<T, { ground_axes::ROWS }>,
    pub(crate) innovations: Innovations<T>,
}

impl<T: Scalar> InnovationsSweep<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let places = Places::new::<T>(layout);
        let (bodies, innovations) = (ground_axes::table(&places), Innovations::new(layout, &places));
        InnovationsSweep { places, bodies, innovations }
    }
    /// [`Innovations::update`], with the bodies from the shifts of the same configuration.
    #[inline(always)]
    pub(crate) fn update<W: Wide<T>>(
        &mut self,
        layout: &Layout<T::Constant>,
        pivots: &[Pivot<T>],
        shifts: &Shifts<T>,
    ) {
        let mut bodies = self.bodies.view();
        ground_axes::turn_outboard::<T, _>(layout, shifts, &self.places, &mut bodies);
        self.innovations.update::<W, _>(layout, &self.places, pivots, &mut bodies);
    }
}

struct Update<'a, T: Scalar> {
    sweep: &'a mut InnovationsSweep<T>,
    layout: &'a Layout<T::Constant>,
    pivots: &'a [Pivot<T>],
    shifts: &'a Shifts<T>,
}

impl<T: Scalar> WideKernel<T> for Update<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T>>(self) {
        self.sweep.update::<W>(self.layout, self.pivots, self.shifts);
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
    let articulated = ArticulatedSweep::new(layout, q)?;
    let mut sweep = InnovationsSweep::new(layout);
    let (pivots, shifts) = (&articulated.pivots, &articulated.shifts);
    T::Arithmetic::dispatch_wide(Update { sweep: &mut sweep, layout, pivots, shifts });
    let mut out = vec![T::zero(); layout.nv() * layout.nv()];
    let operator = &sweep.innovations.operator;
    sweep.places.write_all::<_, T::Arithmetic>(operator, T::arithmetic_mut(&mut out));
    Ok(out)
}
