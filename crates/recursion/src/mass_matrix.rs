//! The mass matrix by composite bodies.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | R(k) | M(k) + Σ φ(k,c) R(c) φ*(k,c), inertia of everything outboard of joint k, joints locked | paper 2 (4.12) |
//! | M(q) | H φ M φ* H* = H (R + φ~R + R φ~*) H* | soa.md 3.1 |
//! | f | R H* of every degree of freedom outboard, carried to the body by φ: columns side by side | |
//!
//! Vectors are in the axes of the ground, each body's about its own origin ([`crate::ground_axes`]).

use crate::error::{DynamicsError, check_length};
use crate::ground_axes::{
    self, AXIS, COMPOSITE, OFFSET, each_own_inertia, linear_axes, spread, turn_outboard,
};
use crate::layout::Pending;
use crate::layout::{GROUND, Layout, LayoutBody, Shifts};
use crate::places::{Places, Table, View, vector};
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{RigidInertia, Scalar, Transform, Wrench};

/// Rows of f, after those of `ground_axes`.
const COLUMN: usize = ground_axes::ROWS;
const ROWS: usize = COLUMN + 6;

/// Composite inertias R of all bodies with their hinge transforms, tip to base.
pub(crate) fn composite_inertias<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> (Vec<Transform<T>>, Vec<RigidInertia<T>>) {
    let hinge: Vec<_> = layout.bodies.iter().map(|b| b.pose(q)).collect();
    let mut R: Vec<_> = layout.bodies.iter().map(|b| RigidInertia::constant(&b.inertia)).collect();
    for (k, body) in layout.bodies.iter().enumerate().rev() {
        if body.parent != GROUND {
            R[body.parent] = R[body.parent] + hinge[k].rigid_to_parent(&R[k]);
        }
    }
    (hinge, R)
}

/// Workspace of the mass matrix.
#[derive(Clone, Debug)]
pub struct MassMatrix<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    places: Places,
    table: Table<T::Arithmetic, ROWS>,
    linear: Vec<bool>,
}

impl<T: Scalar> MassMatrix<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let places = Places::new::<T::Arithmetic>(layout);
        MassMatrix {
            shifts: Shifts::new(layout),
            table: ground_axes::table(&places),
            linear: linear_axes::<T>(layout, &places),
            places,
        }
    }
    /// The mass matrix, full and symmetric, by rows.
    ///
    /// # Computes
    /// M = H φ M φ* H* (soa.md 3.1): the momentum of the composite body outboard of a joint, moving along its axis, is
    /// carried to the base; its components along the axes on the way are entries of M.
    ///
    /// # Shapes & units
    /// `q`: nq; `out`: nv×nv; kg·m², kg·m or kg.
    ///
    /// # Cost
    /// O(n · depth) besides writing the zeros; no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    #[inline(always)]
    pub fn run(&mut self, layout: &Layout<T::Constant>, q: &[T], out: &mut [T]) -> Result<(), DynamicsError> {
        let nv = layout.nv();
        check_length("q", q, layout.nq())?;
        check_length("out", out, nv * nv)?;
        check_length("workspace", self.shifts.all(), layout.len())?;
        let (q, out) = (T::arithmetic(q), T::arithmetic_mut(out));
        T::Arithmetic::dispatch_wide(Sweep { work: self, layout, q, out });
        Ok(())
    }
}

/// Composite inertias R of bodies, tip to base.
pub(crate) struct Composites<'a, T: Scalar> {
    layout: &'a Layout<T::Constant>,
    shifts: &'a Shifts<T>,
    pending: &'a mut Pending<RigidInertia<T>>,
    hand: RigidInertia<T>,
}

impl<'a, T: Scalar> Composites<'a, T> {
    #[inline(always)]
    pub(crate) fn begin(
        layout: &'a Layout<T::Constant>,
        shifts: &'a Shifts<T>,
        pending: &'a mut Pending<RigidInertia<T>>,
    ) -> Self {
        pending.clear();
        Composites { layout, shifts, pending, hand: RigidInertia::zero() }
    }
    /// R of body `k`, after all bodies that are stored after it.
    #[inline(always)]
    pub(crate) fn next(&mut self, k: usize, body: &LayoutBody<T::Constant>) -> RigidInertia<T> {
        let R = match self.pending.all(body, &mut self.hand, |a, b| *a = *a + *b) {
            Some(R) => R,
            None => RigidInertia::constant(&body.inertia),
        };
        if body.follows_parent(k) {
            // The first child gives also what its parent has of its own.
            let own = RigidInertia::constant(&self.layout.bodies[body.parent].inertia);
            self.hand = self.shifts.at(k, body).rigid_onto_parent(&R, &own);
        } else if body.parent != GROUND {
            let moved = self.shifts.at(k, body).rigid_to_parent(&R);
            self.pending.give(k, body, &mut self.hand, moved);
        }
        R
    }
}

struct Sweep<'a, T: Scalar> {
    work: &'a mut MassMatrix<T>,
    layout: &'a Layout<T::Constant>,
    q: &'a [T::Arithmetic],
    out: &'a mut [T::Arithmetic],
}

impl<T: Scalar> WideKernel<T::Arithmetic> for Sweep<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T::Arithmetic>>(self) {
        let Sweep { work, layout, q, out } = self;
        let MassMatrix { shifts, places, table, linear } = work;
        let view = &mut table.view();
        shifts.set_all(layout, q);
        turn_outboard::<_, W, _>(layout, shifts, places, view);
        each_own_inertia!(T::Arithmetic, W, layout, places, view, |group, own| {
            group.set_rigid(COMPOSITE, &own);
        });
        gather_inboard(layout, places, view);
        spread(layout, places, view, COMPOSITE..COLUMN);
        let mut at = Places::group(places.margin, W::COUNT);
        while at < places.count {
            let mut group = view.at(at);
            let (R, axis) = (group.rigid::<W>(COMPOSITE), group.motion::<W>(AXIS));
            let f = if linear[at..at + W::COUNT].iter().any(|x| *x) {
                R.momentum(axis)
            } else {
                R.spin(axis.angular)
            };
            group.set_wrench(COLUMN, f);
            at += W::COUNT;
        }
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            meet::<_, W>(places, view, linear, (k, body), out);
        }
        places.mirror::<_, W>(out);
    }
}

/// R of all bodies, tip to base, from their own inertias.
#[inline(always)]
fn gather_inboard<T: Scalar>(layout: &Layout<T::Constant>, places: &Places, view: &mut View<'_, T, ROWS>) {
    for (k, body) in layout.bodies.iter().enumerate().rev() {
        if body.parent != GROUND {
            let here = view.at(places.first[k]);
            let (R, d) = (here.rigid::<T>(COMPOSITE), here.vector(OFFSET));
            let mut parent = view.at(places.first[body.parent]);
            let sum = R.shifted_onto(d, &parent.rigid(COMPOSITE));
            parent.set_rigid(COMPOSITE, &sum);
        }
    }
}

/// A joint meets all columns outboard of it, and moves them on: its rows of M above the diagonal.
#[inline(always)]
fn meet<T: Scalar, W: Wide<T>>(
    places: &Places,
    view: &mut View<'_, T, ROWS>,
    linear: &[bool],
    (k, body): (usize, &LayoutBody<T::Constant>),
    out: &mut [T],
) {
    let (first, end) = (places.first[k], places.end[k]);
    let count = body.hinge.nv();
    let here = view.at(first);
    let (d, mut axis) = (here.vector::<T>(OFFSET), here.motion::<T>(AXIS));
    let mut at = Places::group(first, W::COUNT);
    while at < end {
        let (from, to) = (first.saturating_sub(at), (end - at).min(W::COUNT));
        let f: Wrench<W> = view.at(at).wrench(COLUMN);
        for i in 0..count {
            if count > 1 {
                axis = view.at(first + i).motion(AXIS);
            }
            let along = ground_axes::along::<T, W>(&axis, linear[first], &f);
            places.write(first + i, at, along.between(from, to), out);
        }
        if body.parent != GROUND {
            let mut d = vector::<T, W>(d);
            d.0 = [d.0[0].between(from, to), d.0[1].between(from, to), d.0[2].between(from, to)];
            view.at(at).set_vector(COLUMN, d.cross_add(f.force, f.moment));
        }
        at += W::COUNT;
    }
    while at < places.count {
        for i in 0..count {
            places.write(first + i, at, W::zero(), out);
        }
        at += W::COUNT;
    }
}

/// [`MassMatrix::run`] for a single call.
///
/// # Errors
/// As there.
pub fn mass_matrix<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv() * layout.nv()];
    MassMatrix::new(layout).run(layout, q, &mut out)?;
    Ok(out)
}
