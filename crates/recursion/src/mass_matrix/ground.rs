//! The mass matrix of a deep tree: all vectors in the axes of the ground (`ground_axes.rs`).
//!
//! Bodies cost more than in their own axes, for these have to be turned. But forces stay as they are while f goes from body to body, and
//! only moments change: a pair of degrees of freedom takes 9 multiplications and not 22, and columns go their way without being stored.
//!
//! Symbols: those of [`crate::mass_matrix`]; S is an axis of a joint, a column of H* (paper 2 (2.3)).

use super::clear;
use super::entries::{Blocks, Entries, Rows, Scattered};
use super::sweep::{Work, up_to};
use crate::floating_base::{along_axes, each_axis, seen_rigid};
use crate::ground_axes::{
    self, AXES, AXIS, COMPOSITE, OFFSET, OwnInertias, ROWS, Turning, along, each_own_inertia,
    gather_composites, linear_axes, spread,
};
use crate::layout::{GROUND, Layout};
use crate::places::{Lane, Places, Table, View, inside, vector};
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{RigidInertia, Scalar, Wrench};

/// Degrees of freedom on the way of the average one, from which on a tree is deep: a chain of 32 is. On chains of 64 columns in the axes
/// of the bodies took 1.3 times as long, on an arm with a hand of 9 joints 0.85 times (Zen 4, AVX-512).
const DEEP: usize = 16;

/// What there is of the bodies in the axes of the ground.
#[derive(Clone, Debug)]
pub(super) struct InGround<T> {
    bodies: Table<T, ROWS>,
    turning: Turning<T>,
    own: OwnInertias<T>,
    ways: Vec<Way>,
    /// True if any axis may have a linear part.
    linear: bool,
}

impl<T: Scalar> InGround<T> {
    /// For a tree that is deep.
    pub(super) fn new(layout: &Layout<T::Constant>, places: &Places) -> Option<Self> {
        (places.pairs() >= DEEP * layout.nv().max(1)).then(|| Self::of_any(layout, places))
    }
    /// For any tree.
    pub(super) fn of_any(layout: &Layout<T::Constant>, places: &Places) -> Self {
        let ways = ways::<T>(layout, places);
        InGround {
            bodies: ground_axes::table(places),
            turning: Turning::new(layout, places),
            own: OwnInertias::new(layout, places),
            linear: ways.iter().any(|way| matches!(way.joint, Joint::Other { linear: true, .. })),
            ways,
        }
    }
}

/// Composites of all bodies.
pub(super) struct Gather<'a, T: Scalar> {
    pub(super) work: &'a mut Work<T>,
    pub(super) ground: &'a mut InGround<T>,
    pub(super) layout: &'a Layout<T::Constant>,
    pub(super) q: &'a [T],
}

impl<T: Scalar> WideKernel<T> for Gather<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T>>(self) {
        let Gather { work: Work { shifts, places, .. }, ground, layout, q } = self;
        let InGround { bodies, turning, own, .. } = ground;
        let view = &mut bodies.view();
        shifts.set_all(layout, q);
        turning.outboard::<W, ROWS>(layout, shifts, places, view);
        each_own_inertia!(T, W, layout, places, own, view, |group, inertia| {
            group.set_rigid(COMPOSITE, &inertia)
        });
        gather_composites(layout, places, view);
        spread::<_, W, ROWS>(places, view, COMPOSITE..ROWS);
    }
}

/// Columns on their way to the base.
pub(super) struct Sweep<'a, T> {
    pub(super) places: &'a Places,
    pub(super) ground: &'a mut InGround<T>,
    pub(super) zeros: bool,
    pub(super) nv: usize,
    pub(super) out: &'a mut [T],
}

impl<T: Scalar> WideKernel<T> for Sweep<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T>>(self) {
        let Sweep { places, ground, zeros, nv, out } = self;
        if zeros {
            clear::<_, W>(out);
        }
        if places.in_order && W::COUNT > 1 {
            ground.carry_all::<W, _>(places, &mut Rows { places, nv, out: &mut *out });
            places.mirror::<_, W>(places.margin, nv, out);
        } else {
            ground.carry_all::<W, _>(places, &mut Scattered { places, nv, out });
        }
    }
}

impl<T: Scalar> InGround<T> {
    /// Columns of all degrees of freedom, and blocks of floating bases.
    #[inline(always)]
    fn carry_all<W: Wide<T>, E: Entries<T, W> + Blocks<T>>(&mut self, places: &Places, entries: &mut E) {
        let InGround { bodies, ways, linear, .. } = self;
        let view = &mut bodies.view();
        let mut at = Places::group(places.margin, W::COUNT);
        while at < places.count {
            if !places.all_of_base(at, W::COUNT) {
                let group = view.at(at);
                let R: RigidInertia<W> = group.rigid(COMPOSITE);
                let f = if *linear { R.momentum(group.motion(AXIS)) } else { R.spin(group.vector(AXIS)) };
                carry(places, ways, view, at, f, entries);
            }
            at += W::COUNT;
        }
        for &first in &places.bases {
            let base = view.at(first);
            let R = seen_rigid(&base.axes(), &base.rigid(COMPOSITE));
            entries.put_block(first, &R.to_articulated().to_rows());
        }
    }
}

/// f of the degrees of freedom from place `at` on, on its way to the base: past their own places, then past those inboard of the
/// first, which are all that are inboard of any.
#[inline(always)]
fn carry<T: Scalar, W: Wide<T>, E: Entries<T, W>>(
    places: &Places,
    ways: &[Way],
    view: &View<'_, T, ROWS>,
    at: usize,
    mut f: Wrench<W>,
    entries: &mut E,
) {
    let (lowest, last) = (at.max(places.margin), at + W::COUNT - 1);
    let mut place = last;
    while let Some(way) = ways.get(place) {
        let (here, outboard) = (view.lane(way.start), way.end - at);
        if way.joint == Joint::Base {
            let first = way.next;
            let all = along_axes(&here.vectors(AXES), &f);
            each_axis!(|I| if first + I <= last {
                entries.put(first + I, at, up_to(all[I], outboard));
            });
            // Before it are bodies that it does not carry.
            if first <= lowest {
                return;
            }
            place = first - 1;
            continue;
        }
        if place >= lowest {
            // Columns of what lies outboard have not begun yet; those beyond are of other branches.
            let x = pass::<_, _, false>(way, &here, (place - at, outboard.min(W::COUNT)), &mut f);
            entries.put(place, at, x);
            place = if place > lowest { place - 1 } else { way.next };
            continue;
        }
        let x = if outboard >= W::COUNT {
            pass::<_, _, true>(way, &here, (0, W::COUNT), &mut f)
        } else {
            pass::<_, _, false>(way, &here, (0, outboard), &mut f)
        };
        entries.put(place, at, x);
        place = way.next;
    }
}

/// S* f of the columns `from` to `to` of a register, or of `ALL`; they go on to the body inboard, where there is one.
#[inline(always)]
fn pass<T: Scalar, W: Wide<T>, const ALL: bool>(
    way: &Way,
    here: &Lane<'_, T, ROWS>,
    (from, to): (usize, usize),
    f: &mut Wrench<W>,
) -> W {
    let (linear, shifts) = match way.joint {
        Joint::Other { linear, shifts } => (linear, shifts),
        _ => (false, true),
    };
    let x: W = along(&here.motion(AXIS), linear, f);
    if shifts {
        let d = vector::<T, W>(here.vector(OFFSET));
        let d = if ALL || W::COUNT == 1 { d } else { inside(d, from, to) };
        f.moment = d.cross_add(f.force, f.moment);
    }
    if ALL { x } else { up_to(x, to) }
}

/// A degree of freedom on the way from those outboard of it to the base.
#[derive(Clone, Copy, Debug)]
struct Way {
    /// Where its lane of the table starts.
    start: usize,
    /// One past the last place outboard.
    end: usize,
    /// The place that comes after it, towards the base; [`GROUND`] after the last. Of a floating base its first place.
    next: usize,
    joint: Joint,
}

/// What columns pass at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Joint {
    /// An axis without linear part; from there they go to the origin of another body.
    Hinge,
    Other {
        /// True if its axis may have a linear part.
        linear: bool,
        /// True if the way goes on from the origin of the body to that of another.
        shifts: bool,
    },
    /// An axis of a floating base, whose lane is that of its first place.
    Base,
}

/// The ways from all places.
fn ways<T: Scalar>(layout: &Layout<T::Constant>, places: &Places) -> Vec<Way> {
    let linear = linear_axes::<T>(layout, places);
    let last = |k: usize| places.own(k).end - 1;
    let start = Table::<T, ROWS>::start;
    let empty = |at| Way { start: start(at), end: places.count, next: GROUND, joint: Joint::Hinge };
    let mut ways: Vec<Way> = (0..places.margin).map(empty).collect();
    for (k, body) in layout.bodies().iter().enumerate() {
        let base = body.floats();
        for at in places.own(k) {
            let first = at == places.first[k];
            let next = match body.parent {
                _ if base => places.first[k],
                _ if !first => at - 1,
                GROUND => GROUND,
                parent => last(parent),
            };
            let joint = match (linear[at], first && body.parent != GROUND) {
                _ if base => Joint::Base,
                (false, true) => Joint::Hinge,
                (linear, shifts) => Joint::Other { linear, shifts },
            };
            ways.push(Way { start: start(if base { next } else { at }), end: places.end[k], next, joint });
        }
    }
    ways
}
