//! The innovations operator L = I − HψK as a matrix, and M⁻¹ = L* D⁻¹ L with it.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | z | K e_c of a unit innovation at c, moved inward by ψ: a register of columns goes its way to the base without being stored | 6 | soa.md 3.1 |
//! | L | I − HψK: ε = L T; entry (i, c) is −H(i) z(i), zero unless i lies on the way from c to the base | nv×nv | soa.md 3.1 |
//! | D | articulated joint inertias | nv | paper 1 (9.5) |
//!
//! L is unit triangular in the order of elimination (joints outboard first, components of a joint in their order). Nothing is
//! subtracted in products with it that the filter does not subtract too: it keeps the digits that a Cholesky factor of M loses
//! where heavy bodies hang on light ones. A floating base has its gains in its own axes (`floating_base.rs`).

use crate::articulated_sweep::{ArticulatedSweep, Pivot};
use crate::error::DynamicsError;
use crate::floating_base::{self, along_axes, each_axis};
use crate::ground_axes::{self, AXES, AXIS, Columns, OFFSET, Passages, Turning, along, each_way};
use crate::hinge::combine;
use crate::layout::{Layout, Shifts};
use crate::places::{Aligned, Places, Table, View, inside, vector};
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{Scalar, Vec3, Wrench};

mod columns;
mod products;

use columns::ColumnSweeps;
use products::Products;

/// Rows of the gain K of a degree of freedom.
const GAIN: usize = 0;
const GAINS: usize = 6;

/// L and D⁻¹ of one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Innovations<T> {
    passages: Passages,
    /// L. What is zero for every configuration is never anything else between calls.
    operator: Aligned<T>,
    /// D⁻¹, by places.
    inverse: Vec<T>,
    gains: Table<T, GAINS>,
    products: Products<T>,
    /// Where products with M⁻¹ take more time than sweeps over the columns.
    columns: Option<ColumnSweeps<T>>,
}

impl<T: Scalar> Innovations<T> {
    /// A workspace for a layout.
    pub(crate) fn new(layout: &Layout<T::Constant>, places: &Places) -> Self {
        Self::with(layout, places, Products::new(places, false, false, 0), None)
    }
    /// For products with M⁻¹, too, whose first columns may be `known` without it.
    pub(crate) fn with_products(layout: &Layout<T::Constant>, places: &Places, known: usize) -> Self {
        let columns = ColumnSweeps::new(layout, places);
        Self::with(layout, places, Products::new(places, columns.is_none(), true, known), columns)
    }
    fn with(
        layout: &Layout<T::Constant>,
        places: &Places,
        products: Products<T>,
        columns: Option<ColumnSweeps<T>>,
    ) -> Self {
        Innovations {
            passages: Passages::new::<T>(layout, places),
            operator: places.zeros(),
            inverse: vec![T::zero(); places.count],
            gains: Table::new(places),
            products,
            columns,
        }
    }
    /// Gains and pivots, to be set before [`Innovations::update`].
    #[inline(always)]
    pub(crate) fn gains(&mut self) -> Gains<'_, T> {
        Gains { gains: self.gains.view(), inverses: &mut self.inverse }
    }
    /// Sets three numbers of the known columns, one above the other: by places, the first one's row and their column of the first matrix.
    #[inline(always)]
    pub(crate) fn set_known(&mut self, (row, column): (usize, usize), x: Vec3<T>) {
        self.products.solution.view().set_three((row, column), x);
    }
    /// L of the gains, and of the bodies of the same configuration, in the axes of the ground. Cost O(n · depth), no allocation.
    #[inline(always)]
    pub(crate) fn update<W: Wide<T>, const N: usize>(
        &mut self,
        places: &Places,
        bodies: &mut View<'_, T, N>,
    ) {
        let Innovations { operator, gains, passages, .. } = self;
        let (operator, s): (&mut [T], usize) = (operator, places.stride);
        let mut gains = gains.view();
        let mut at = Places::group(places.margin, W::COUNT);
        while at < places.count {
            if places.all_of_base(at, W::COUNT) {
                at += W::COUNT;
                continue;
            }
            let mut z: Wrench<W> = gains.at(at).wrench(GAIN);
            for (place, joint) in passages.inward(at, W::COUNT) {
                each_way!(joint.columns(at, W::COUNT), |columns, ALL| {
                    let here = bodies.lane(Table::<T, N>::start(place));
                    let gain = gains.lane(Table::<T, GAINS>::start(place)).motion(GAIN);
                    let mut innovation = -along::<T, W>(&here.motion(AXIS), joint.linear, &z);
                    if !ALL && joint.inner > joint.first + 1 {
                        innovation = innovation.between(columns.from, columns.to);
                        // Axes of the joint that come after this one have no innovation here.
                        let later = place.saturating_sub(at).min(W::COUNT);
                        innovation -= innovation.between(later, columns.own.max(later));
                    } else if !ALL {
                        innovation = innovation.between(columns.own, columns.to);
                    }
                    z.moment = vector::<T, W>(gain.angular).scale_add(innovation, z.moment);
                    z.force = vector::<T, W>(gain.linear).scale_add(innovation, z.force);
                    innovation.store(&mut operator[place * s + at..]);
                    if !joint.shifts {
                        // Another axis of the joint, or the ground.
                    } else if joint.free {
                        // G = I: the joint passes its own force and nothing of what comes from outboard.
                        let Columns { from, own, to, .. } = columns;
                        let d = vector::<T, W>(here.vector(OFFSET));
                        let axes = bodies.at(at).motion::<W>(AXIS);
                        let passed = Wrench::new(d.cross_add(axes.linear, axes.angular), axes.linear);
                        z.moment = z.moment - inside(z.moment, from, to) + inside(passed.moment, from, own);
                        z.force = z.force - inside(z.force, from, to) + inside(passed.force, from, own);
                    } else {
                        z.moment =
                            columns.moving::<ALL, _, _>(here.vector(OFFSET)).cross_add(z.force, z.moment);
                    }
                });
            }
            for base in passages.bases(at, W::COUNT) {
                let columns = base.columns(at, W::COUNT);
                let axes = bodies.lane(Table::<T, N>::start(base.first)).vectors(AXES);
                let all = along_axes(&axes, &-z);
                let all = floating_base::innovations(&base_gains(&mut gains, base.first), all);
                each_axis!(|I| {
                    let x = all[I].between(columns.own, columns.to);
                    x.store(&mut operator[(base.first + I) * s + at..]);
                });
            }
            at += W::COUNT;
        }
        for &first in &places.bases {
            let own = floating_base::inverse(&base_gains(&mut gains, first));
            for (i, row) in own.iter().enumerate() {
                operator[(first + i) * s + first..][..6].copy_from_slice(row);
            }
        }
        for place in places.margin..places.count {
            operator[place * s + place] = T::one();
        }
    }
}

/// Gains of a floating base, by rows.
#[inline(always)]
fn base_gains<T: Scalar>(gains: &mut View<'_, T, GAINS>, first: usize) -> [[T; 6]; 6] {
    let mut rows = [[T::zero(); 6]; 6];
    each_axis!(|I| rows[I] = gains.at(first + I).wrench::<T>(GAIN).to_array());
    rows
}

/// Gains in the axes of the ground, those of a floating base in its own, and D⁻¹, by places.
pub(crate) struct Gains<'a, T> {
    gains: View<'a, T, GAINS>,
    inverses: &'a mut [T],
}

impl<T: Scalar> Gains<'_, T> {
    #[inline(always)]
    pub(crate) fn set(&mut self, place: usize, gain: Wrench<T>, inverse: T) {
        self.gains.at(place).set_wrench(GAIN, gain);
        self.inverses[place] = inverse;
    }
    /// Those of a floating base.
    #[inline(always)]
    pub(crate) fn set_base(&mut self, first: usize, gains: &[[T; 6]; 6], inverses: &[T; 6]) {
        each_axis!(|I| self.set(first + I, Wrench::from_array(gains[I]), inverses[I]));
    }
    #[inline(always)]
    pub(crate) fn base(&mut self, first: usize) -> [[T; 6]; 6] {
        base_gains(&mut self.gains, first)
    }
    #[inline(always)]
    pub(crate) fn gain(&mut self, place: usize) -> Wrench<T> {
        self.gains.at(place).wrench(GAIN)
    }
}

/// L, D⁻¹ and what they are calculated from.
#[derive(Clone, Debug)]
pub(crate) struct InnovationsSweep<T> {
    pub(crate) places: Places,
    bodies: Table<T, { ground_axes::ROWS }>,
    turning: Turning<T>,
    pub(crate) innovations: Innovations<T>,
}

impl<T: Scalar> InnovationsSweep<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let places = Places::new::<T>(layout);
        let (bodies, innovations) = (ground_axes::table(&places), Innovations::new(layout, &places));
        InnovationsSweep { turning: Turning::new(layout, &places), places, bodies, innovations }
    }
    /// [`Innovations::update`], with the pivots of an articulated sweep and the shifts of the same configuration.
    #[inline(always)]
    pub(crate) fn update<W: Wide<T>>(
        &mut self,
        layout: &Layout<T::Constant>,
        pivots: &[Pivot<T>],
        shifts: &Shifts<T>,
    ) {
        let mut bodies = self.bodies.view();
        self.turning.outboard::<W, _>(layout, shifts, &self.places, &mut bodies);
        let mut gains = self.innovations.gains();
        for (body, &first) in layout.bodies().iter().zip(&self.places.first) {
            let axes = bodies.at(first).axes();
            for i in 0..body.hinge.nv() {
                let Pivot { gain, inverse } = pivots[body.v + i];
                if body.floats() {
                    gains.set(first + i, gain, inverse);
                    continue;
                }
                let gain = Wrench::new(combine(&axes, gain.moment), combine(&axes, gain.force));
                gains.set(first + i, gain, inverse);
            }
        }
        self.innovations.update::<W, _>(&self.places, &mut bodies);
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
