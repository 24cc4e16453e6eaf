//! The mass matrix by composite bodies.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | R(k) | M(k) + Σ φ(k,c) R(c) φ*(k,c), inertia of everything outboard of joint k, joints locked | paper 2 (4.12) |
//! | M(q) | H φ M φ* H* = H (R + φ~R + R φ~*) H* | soa.md 3.1 |
//! | f | R H* of every degree of freedom outboard, carried to the body by φ: columns in lanes | |

use crate::columns::{Columns, Rows, WidePassage};
use crate::error::{DynamicsError, check_length};
use crate::flexible::Composite;
use crate::hinge::Hinge;
use crate::layout::Pending;
use crate::layout::{GROUND, Layout, LayoutBody, Shifts};
use crate::places::{Places, mirror};
use core::ops::Range;
use num_traits::Zero;
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{RigidInertia, Scalar, Transform, Wrench};

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
    pending: Pending<RigidInertia<T::Arithmetic>>,
    places: Places,
    columns: Columns<T::Arithmetic>,
    /// A row of M before its entries go to their places.
    line: Vec<T::Arithmetic>,
    /// True if more than a third of M may differ from zero.
    dense: bool,
    /// For a layout with flexible bodies.
    flexible: Option<Box<Composite<T>>>,
}

impl<T: Scalar> MassMatrix<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let places = Places::new::<T::Arithmetic>(layout);
        MassMatrix {
            shifts: Shifts::new(layout),
            pending: Pending::new(layout, RigidInertia::zero()),
            columns: Columns::new(&places),
            line: vec![T::Arithmetic::zero(); places.count],
            dense: 3 * places.pairs() > layout.nv() * layout.nv(),
            places,
            flexible: layout.flexible().map(|tree| Box::new(Composite::new(tree))),
        }
    }
    /// The mass matrix, full and symmetric, by rows.
    ///
    /// # Computes
    /// M = H φ M φ* H* (soa.md 3.1): the momentum of the composite body outboard of a joint, moving along its axis, is
    /// carried to the base; its components along the axes on the way are entries of M. Closures and couplings stay open.
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
        if let Some(tree) = layout.flexible() {
            return Composite::run_checked(&mut self.flexible, tree, nv, q, out);
        }
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
        let MassMatrix { shifts, pending, places, columns, line, dense, .. } = work;
        let mut columns = columns.rows();
        let mut matrix = Matrix { out, nv: layout.nv(), places, line, dense: *dense };
        if !matrix.dense {
            matrix.out.fill(T::Arithmetic::zero());
        }
        shifts.set_all(layout, q);
        let mut composites = Composites::begin(layout, shifts, pending);
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let R = composites.next(k, body);
            let passage = shifts.at(k, body);
            let passage = WidePassage::<T::Arithmetic, W>::new(body, passage);
            match body.hinge {
                Hinge::Revolute => step::<_, W, 2>(&mut matrix, &mut columns, k, body, &passage, &R),
                Hinge::Prismatic => step::<_, W, 5>(&mut matrix, &mut columns, k, body, &passage, &R),
                _ => general_step(&mut matrix, &mut columns, k, body, &passage, &R),
            }
        }
        if *dense {
            mirror::<_, W>(matrix.out, layout.nv(), layout.nv());
        }
    }
}

/// A joint of one degree of freedom along component `C`: its own column never leaves the registers before it is moved.
#[inline(always)]
fn step<T: Scalar, W: Wide<T>, const C: usize>(
    matrix: &mut Matrix<'_, T>,
    columns: &mut Rows<'_, T>,
    k: usize,
    body: &LayoutBody<T::Constant>,
    passage: &WidePassage<'_, T, W>,
    R: &RigidInertia<T>,
) {
    let own = R.column(C).to_array();
    let range = matrix.places.outboard(k);
    let in_order = matrix.places.in_order();
    let mut at = range.end;
    while at > range.start {
        at -= W::COUNT;
        let mut f = columns.load::<W>(at);
        if at <= range.start {
            let (lane, x) = (range.start - at, f.to_array());
            f = Wrench::from_array([
                x[0].with(lane, own[0]),
                x[1].with(lane, own[1]),
                x[2].with(lane, own[2]),
                x[3].with(lane, own[3]),
                x[4].with(lane, own[4]),
                x[5].with(lane, own[5]),
            ]);
        }
        matrix.put(in_order, body.v, range.start, at, f.get(C));
        if body.parent != GROUND {
            columns.store(at, passage.wrench_to_parent(f));
        }
    }
    matrix.finish::<W>(in_order, body.v, range);
}

/// Any joint.
#[inline(always)]
fn general_step<T: Scalar, W: Wide<T>>(
    matrix: &mut Matrix<'_, T>,
    columns: &mut Rows<'_, T>,
    k: usize,
    body: &LayoutBody<T::Constant>,
    passage: &WidePassage<'_, T, W>,
    R: &RigidInertia<T>,
) {
    let range = matrix.places.outboard(k);
    let in_order = matrix.places.in_order();
    for (i, &c) in body.hinge.components().iter().enumerate() {
        let helical = matches!(body.hinge, Hinge::Helical { .. });
        let own = if helical { R.momentum(body.hinge.axis(i)) } else { R.column(c) };
        columns.set(range.start + i, own);
    }
    for (i, &c) in body.hinge.components().iter().enumerate() {
        let start = range.start + i;
        let mut at = range.end;
        while at > start {
            at -= W::COUNT;
            let mut along: W = columns.component(c, at);
            if let Hinge::Helical { pitch } = body.hinge {
                along = W::constant(pitch).fma(columns.component(5, at), along);
            }
            matrix.put(in_order, body.v + i, start, at, along);
        }
        matrix.finish::<W>(in_order, body.v + i, start..range.end);
    }
    if body.parent != GROUND {
        let mut at = range.end;
        while at > range.start {
            at -= W::COUNT;
            let f = columns.load(at);
            columns.store(at, passage.wrench_to_parent(f));
        }
    }
}

/// M on its way out: rows of the upper triangle, since parents come before children in v, too.
struct Matrix<'a, T> {
    out: &'a mut [T],
    nv: usize,
    places: &'a Places,
    line: &'a mut [T],
    dense: bool,
}

impl<T: Scalar> Matrix<'_, T> {
    /// Entries of row `v` for the columns from place `at` on; the row begins at place `start`.
    #[inline(always)]
    fn put<W: Wide<T>>(&mut self, in_order: bool, v: usize, start: usize, at: usize, along: W) {
        if !in_order {
            along.store(&mut self.line[at..]);
        } else if at >= start {
            along.store(&mut self.out[v * self.nv + v + (at - start)..]);
        } else {
            along.store_from(start - at, &mut self.out[v * self.nv + v..]);
        }
    }
    /// Ends row `v`.
    #[inline(always)]
    fn finish<W: Wide<T>>(&mut self, in_order: bool, v: usize, range: Range<usize>) {
        let nv = self.nv;
        if in_order {
            let end = v + range.len();
            if self.dense {
                clear::<T, W>(&mut self.out[v * nv + end..(v + 1) * nv]);
            } else {
                for c in v + 1..end {
                    self.out[c * nv + v] = self.out[v * nv + c];
                }
            }
            return;
        }
        if self.dense {
            clear::<T, W>(&mut self.out[v * nv + v..(v + 1) * nv]);
        }
        for (&c, &x) in self.places.dofs(range.clone()).iter().zip(&self.line[range]) {
            self.out[v * nv + c] = x;
            if !self.dense {
                self.out[c * nv + v] = x;
            }
        }
    }
}

/// Zeros, by stores alone: a call would drive what a sweep carries out of the registers.
#[inline(always)]
fn clear<T: Scalar, W: Wide<T>>(x: &mut [T]) {
    for group in x.chunks_mut(W::COUNT) {
        W::zero().store_first(group);
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
