//! The mass matrix by composite bodies.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | R(k) | M(k) + Σ φ(k,c) R(c) φ*(k,c), inertia of everything outboard of joint k, joints locked | paper 2 (4.12) |
//! | M(q) | H φ M φ* H* = H (R + φ~R + R φ~*) H* | soa.md 3.1 |
//! | S | an axis of a joint, a column of H* | paper 2 (2.3) |
//! | f | R S of a degree of freedom, carried inboard by φ | |
//!
//! All vectors are in the axes of the ground (`ground_axes.rs`): forces stay as they are while f goes from body to body, and
//! only moments change. Columns of M lie side by side in a register, which goes its way to the base without being stored.

use crate::error::{DynamicsError, check_length};
use crate::flexible::Composite;
use crate::floating_base::{along_axes, each_axis, seen_rigid};
use crate::ground_axes::{
    self, AXES, AXIS, COMPOSITE, OFFSET, OwnInertias, ROWS, Turning, Way, along, each_own_inertia,
    gather_composites, spread, ways,
};
use crate::layout::{GROUND, Layout, Shifts};
use crate::places::{Panels, Places, Table, View, inside, vector};
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{RigidInertia, Scalar, Wrench};

/// Workspace of the mass matrix.
#[derive(Clone, Debug)]
pub struct MassMatrix<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    places: Places,
    bodies: Table<T::Arithmetic, ROWS>,
    turning: Turning<T::Arithmetic>,
    own: OwnInertias<T::Arithmetic>,
    ways: Vec<Way>,
    /// True if any axis may have a linear part.
    linear: bool,
    /// M by places, above the diagonal, where columns lie side by side. What is zero for every configuration is never anything else between calls.
    upper: Panels<T::Arithmetic>,
    /// For a layout with flexible bodies.
    flexible: Option<Box<Composite<T>>>,
}

impl<T: Scalar> MassMatrix<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let places = Places::new::<T::Arithmetic>(layout);
        let ways = ways::<T::Arithmetic, ROWS>(layout, &places);
        MassMatrix {
            shifts: Shifts::new(layout),
            bodies: ground_axes::table(&places),
            turning: Turning::new(layout, &places),
            own: OwnInertias::new(layout, &places),
            linear: ways.iter().any(|way| way.linear),
            ways,
            upper: Panels::new(&places),
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
        T::Arithmetic::dispatch_beside_numbers(Gather { work: self, layout, q });
        T::Arithmetic::dispatch_wide(Sweep { work: self, layout, out });
        Ok(())
    }
}

/// Composites of all bodies.
struct Gather<'a, T: Scalar> {
    work: &'a mut MassMatrix<T>,
    layout: &'a Layout<T::Constant>,
    q: &'a [T::Arithmetic],
}

impl<T: Scalar> WideKernel<T::Arithmetic> for Gather<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T::Arithmetic>>(self) {
        let Gather { work, layout, q } = self;
        let MassMatrix { shifts, places, bodies, turning, own, .. } = work;
        let view = &mut bodies.view();
        shifts.set_all(layout, q);
        turning.outboard::<W, ROWS>(layout, shifts, places, view);
        each_own_inertia!(T::Arithmetic, W, layout, places, own, view, |group, inertia| {
            group.set_rigid(COMPOSITE, &inertia)
        });
        gather_composites(layout, places, view);
        spread::<_, W, ROWS>(places, view, COMPOSITE..ROWS);
    }
}

/// Columns on their way to the base.
struct Sweep<'a, T: Scalar> {
    work: &'a mut MassMatrix<T>,
    layout: &'a Layout<T::Constant>,
    out: &'a mut [T::Arithmetic],
}

impl<T: Scalar> WideKernel<T::Arithmetic> for Sweep<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T::Arithmetic>>(self) {
        let Sweep { work, layout, out } = self;
        let MassMatrix { places, bodies, ways, linear, upper, .. } = work;
        let (view, nv) = (&mut bodies.view(), layout.nv());
        if places.clears(W::COUNT) {
            clear::<_, W>(out);
        }
        let mut at = Places::group(places.margin, W::COUNT);
        while at < places.count {
            if places.all_of_base(at, W::COUNT) {
                at += W::COUNT;
                continue;
            }
            let group = view.at(at);
            let R: RigidInertia<W> = group.rigid(COMPOSITE);
            let f = if *linear { R.momentum(group.motion(AXIS)) } else { R.spin(group.vector(AXIS)) };
            if W::COUNT > 1 {
                let panel = upper.panel_mut(at);
                carry::<_, W>(places, ways, view, at, f, |row, x| {
                    let row = row * T::Arithmetic::COLUMNS;
                    x.store(&mut panel[row..row + W::COUNT]);
                });
            } else {
                carry::<_, W>(places, ways, view, at, f, |row, x| {
                    let (i, j) = (places.dof(row), places.dof(at));
                    x.store(&mut out[i * nv + j..]);
                    x.store(&mut out[j * nv + i..]);
                });
            }
            at += W::COUNT;
        }
        for &first in &places.bases {
            let base = view.at(first);
            let R = seen_rigid(&base.axes(), &base.rigid(COMPOSITE)).to_articulated().to_rows();
            if W::COUNT > 1 {
                upper.set_block(first, &R);
                continue;
            }
            for (i, row) in R.iter().enumerate() {
                for (j, &x) in row.iter().enumerate() {
                    out[places.dof(first + i) * nv + places.dof(first + j)] = x;
                }
            }
        }
        if W::COUNT > 1 {
            places.write_symmetric::<_, W>(upper, out);
        }
    }
}

/// Zeros, by stores alone: small matrices would feel a call.
#[inline(always)]
fn clear<T: Scalar, W: Wide<T>>(x: &mut [T]) {
    let mut groups = x.chunks_exact_mut(W::COUNT);
    for group in &mut groups {
        W::zero().store(group);
    }
    W::zero().store_first(groups.into_remainder());
}

/// f of the degrees of freedom from place `at` on, on its way to the base: past their own places, then past those inboard of the
/// first, which are all that are inboard of any.
#[inline(always)]
fn carry<T: Scalar, W: Wide<T>>(
    places: &Places,
    ways: &[Way],
    view: &View<'_, T, ROWS>,
    at: usize,
    mut f: Wrench<W>,
    mut put: impl FnMut(usize, W),
) {
    let lowest = at.max(places.margin);
    let mut place = at + W::COUNT - 1;
    while let Some(way) = ways.get(place) {
        let here = view.lane(way.start);
        if way.base {
            let (first, to) = (way.next, way.end - at);
            let all = along_axes(&here.vectors(AXES), &f);
            each_axis!(|I| if first + I <= place {
                put(first + I, if to >= W::COUNT { all[I] } else { all[I].between(0, to) });
            });
            place = if first > lowest { first - 1 } else { GROUND };
            continue;
        }
        // Columns of what lies outboard have not begun yet; those beyond are of other branches.
        let (from, to) = (place.saturating_sub(at), way.end - at);
        let whole = to >= W::COUNT;
        let x: W = along(&here.motion(AXIS), way.linear, &f);
        put(place, if whole { x } else { x.between(0, to) });
        if way.shifts {
            let d = vector::<T, W>(here.vector(OFFSET));
            let d = if whole && from == 0 { d } else { inside(d, from, to.min(W::COUNT)) };
            f.moment = d.cross_add(f.force, f.moment);
        }
        place = if place > lowest { place - 1 } else { way.next };
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
