//! Composites and columns, tip to base. Symbols: those of [`crate::mass_matrix`].

use super::entries::Entries;
use crate::composites::Composites;
use crate::hinge::{Hinge, each_component};
use crate::layout::{GROUND, Layout, Pending, Shifts};
use crate::link::{Link, Shift, each_shape};
use crate::places::{Places, Table, View, vector};
use core::ops::Range;
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{Mat3, RigidInertia, Scalar, Transform, Turn, Vec3, Wrench};

/// f of every degree of freedom.
pub(super) const ROWS: usize = 6;

/// What a sweep works with.
#[derive(Clone, Debug)]
pub(super) struct Work<T> {
    pub(super) shifts: Shifts<T>,
    pub(super) places: Places,
    pending: Pending<RigidInertia<T>>,
    pub(super) columns: Table<T, ROWS>,
}

impl<T: Scalar> Work<T> {
    pub(super) fn new(layout: &Layout<T::Constant>) -> Self {
        let places = Places::new::<T>(layout);
        Work {
            shifts: Shifts::new(layout),
            pending: Pending::new(layout, RigidInertia::zero()),
            columns: Table::new(&places),
            places,
        }
    }
    /// A sweep that begins at the tips; shifts are set.
    #[inline(always)]
    pub(super) fn sweep<'a>(&'a mut self, layout: &'a Layout<T::Constant>) -> Sweep<'a, T> {
        let Work { shifts, places, pending, columns } = self;
        Sweep {
            layout,
            shifts,
            places,
            composites: Composites::begin(layout, shifts, pending),
            columns: columns.view(),
        }
    }
}

/// The bodies so far.
pub(super) struct Sweep<'a, T: Scalar> {
    pub(super) layout: &'a Layout<T::Constant>,
    shifts: &'a Shifts<T>,
    pub(super) places: &'a Places,
    pub(super) composites: Composites<'a, T>,
    /// Of degrees of freedom outboard of the bodies so far f in the axes of the last of these on its way. Before them there is nothing yet.
    pub(super) columns: View<'a, T, ROWS>,
}

impl<T: Scalar> Sweep<'_, T> {
    /// Past some bodies, from the last to the first.
    #[inline(always)]
    pub(super) fn inboard<W: Wide<T>, E: Entries<T, W>>(&mut self, bodies: Range<usize>, entries: &mut E) {
        let layout = self.layout;
        for (k, body) in bodies.clone().zip(&layout.bodies[bodies]).rev() {
            let R = self.composites.next(k, body);
            let passage = self.shifts.at(k, body);
            if let Some(pose) = passage.general {
                self.pass(k, &R, &body.hinge, &Pose(pose_side_by_side(pose)), entries);
                continue;
            }
            let shift = side_by_side(passage.shift);
            if let Hinge::Revolute = body.hinge {
                each_shape!(&body.link, |link| {
                    self.pass(k, &R, &Hinge::Revolute, &ByLink { link, shift }, entries);
                });
            } else {
                self.pass(k, &R, &body.hinge, &ByLink { link: &body.link, shift }, entries);
            }
        }
    }
    /// Past one body: its own columns begin, its joint's rows are put, and all goes to the parent.
    #[inline(always)]
    fn pass<W: Wide<T>, P: ToParent<W>, E: Entries<T, W>>(
        &mut self,
        k: usize,
        R: &RigidInertia<T>,
        hinge: &Hinge<T::Constant>,
        to_parent: &P,
        entries: &mut E,
    ) {
        let (first, end) = (self.places.first[k], self.places.end[k]);
        let (inner, grounded) = (first + hinge.nv(), self.layout.bodies[k].parent == GROUND);
        let mut at = Places::group(first, W::COUNT);
        while at < end {
            let to = end - at;
            let mut group = self.columns.at(at);
            let before: Wrench<W> = group.wrench(0);
            let mut f = before;
            if at < inner {
                each_component!(
                    hinge,
                    |I, C| begin(&mut f, first + I, at, &R.column(C)),
                    begin(&mut f, first, at, &R.momentum(hinge.axis(0)))
                );
            }
            each_component!(
                hinge,
                |I, C| entries.put(first + I, at, up_to(f.get(C), to)),
                entries.put(first, at, up_to(hinge.project(0, &f), to))
            );
            if !grounded {
                let mut moved = to_parent.wrench(f);
                if to < W::COUNT {
                    // What is beyond is on another branch.
                    moved = first_of(moved, before, to);
                }
                group.set_wrench(0, moved);
            }
            at += W::COUNT;
        }
    }
}

/// Zero from place `to` of a register on.
#[inline(always)]
fn up_to<T: Scalar, W: Wide<T>>(x: W, to: usize) -> W {
    if to < W::COUNT { x.between(0, to) } else { x }
}

/// The columns before place `to` of a register, and others from there on.
#[inline(always)]
fn first_of<T: Scalar, W: Wide<T>>(f: Wrench<W>, others: Wrench<W>, to: usize) -> Wrench<W> {
    let ([a, b, c], [d, e, g]) = (f.moment.0, f.force.0);
    let ([u, v, w], [x, y, z]) = (others.moment.0, others.force.0);
    Wrench::from_array([
        a.up_to(to, u),
        b.up_to(to, v),
        c.up_to(to, w),
        d.up_to(to, x),
        e.up_to(to, y),
        g.up_to(to, z),
    ])
}

/// The column of a place, if it is in the register from place `at` on.
#[inline(always)]
fn begin<T: Scalar, W: Wide<T>>(f: &mut Wrench<W>, place: usize, at: usize, column: &Wrench<T>) {
    let lane = place.wrapping_sub(at);
    if lane >= W::COUNT {
        return;
    }
    let ([a, b, c], [d, e, g]) = (f.moment.0, f.force.0);
    let ([u, v, w], [x, y, z]) = (column.moment.0, column.force.0);
    *f = Wrench::from_array([
        a.with(lane, u),
        b.with(lane, v),
        c.with(lane, w),
        d.with(lane, x),
        e.with(lane, y),
        g.with(lane, z),
    ]);
}

/// φ(p, k) on columns side by side.
trait ToParent<W> {
    fn wrench(&self, f: Wrench<W>) -> Wrench<W>;
}

struct ByLink<'a, W: Scalar> {
    link: &'a Link<W::Constant>,
    shift: Shift<W>,
}

impl<W: Scalar> ToParent<W> for ByLink<'_, W> {
    #[inline(always)]
    fn wrench(&self, f: Wrench<W>) -> Wrench<W> {
        self.link.wrench_to_parent(&self.shift, f)
    }
}

struct Pose<W>(Transform<W>);

impl<W: Scalar> ToParent<W> for Pose<W> {
    #[inline(always)]
    fn wrench(&self, f: Wrench<W>) -> Wrench<W> {
        self.0.wrench_to_parent(f)
    }
}

#[inline(always)]
fn side_by_side<T: Scalar, W: Wide<T>>(shift: &Shift<T>) -> Shift<W> {
    let Turn { cos, sin } = shift.turn;
    Shift { turn: Turn { cos: W::broadcast(cos), sin: W::broadcast(sin) }, offset: vector(shift.offset) }
}

#[inline(always)]
fn pose_side_by_side<T: Scalar, W: Wide<T>>(pose: &Transform<T>) -> Transform<W> {
    let [x, y, z] = pose.rotation.0;
    let rotation = Mat3([vector(Vec3(x)).0, vector(Vec3(y)).0, vector(Vec3(z)).0]);
    Transform::new(rotation, vector(pose.translation))
}
