//! Composites and columns, tip to base. Symbols: those of [`crate::mass_matrix`].

use super::entries::{Blocks, Entries};
use crate::composites::Composites;
use crate::floating_base::each_axis;
use crate::hinge::{Hinge, each_component};
use crate::layout::{GROUND, Layout, Pending, Shifts};
use crate::link::{Link, Shift, each_shape};
use crate::places::{Aligned, Places, vector};
use core::ops::Range;
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{Mat3, RigidInertia, Scalar, Transform, Turn, Vec3, Wrench};

/// Numbers of f.
const SIX: usize = 6;

/// What a sweep works with.
#[derive(Clone, Debug)]
pub(super) struct Work<T> {
    pub(super) shifts: Shifts<T>,
    pub(super) places: Places,
    pending: Pending<RigidInertia<T>>,
    columns: Aligned<T>,
}

impl<T: Scalar> Work<T> {
    pub(super) fn new(layout: &Layout<T::Constant>) -> Self {
        let places = Places::new::<T>(layout);
        Work {
            shifts: Shifts::new(layout),
            pending: Pending::new(layout, RigidInertia::zero()),
            columns: Aligned::new(SIX * places.count),
            places,
        }
    }
    /// f of the degree of freedom of a place, after a sweep in registers of one number.
    #[inline(always)]
    pub(super) fn column(&self, place: usize) -> Wrench<T> {
        load(&self.columns[SIX * place..][..SIX])
    }
    /// A sweep that begins at the tips; shifts are set.
    #[inline(always)]
    pub(super) fn sweep<'a>(&'a mut self, layout: &'a Layout<T::Constant>) -> Sweep<'a, T> {
        let Work { shifts, places, pending, columns } = self;
        Sweep { layout, shifts, places, composites: Composites::begin(layout, shifts, pending), columns }
    }
}

/// The bodies so far.
pub(super) struct Sweep<'a, T: Scalar> {
    pub(super) layout: &'a Layout<T::Constant>,
    shifts: &'a Shifts<T>,
    pub(super) places: &'a Places,
    pub(super) composites: Composites<'a, T>,
    /// f of degrees of freedom outboard of the bodies so far, in the axes of the last of these on its way: six registers for those of a
    /// register, which hold nothing yet of the places before.
    columns: &'a mut [T],
}

impl<T: Scalar> Sweep<'_, T> {
    /// Past some bodies, from the last to the first.
    #[inline(always)]
    pub(super) fn inboard<W: Wide<T>, E: Entries<T, W> + Blocks<T>>(
        &mut self,
        bodies: Range<usize>,
        entries: &mut E,
    ) {
        let layout = self.layout;
        for (k, body) in bodies.clone().zip(&layout.bodies[bodies]).rev() {
            let (R, passage) = (self.composites.next(k, body), self.shifts.at(k, body));
            if body.floats() {
                self.base(k, &R, entries);
                continue;
            }
            if let Some(pose) = passage.general {
                self.pass(k, &R, &body.hinge, &Pose(pose_side_by_side(pose)), entries);
                continue;
            }
            let shift = side_by_side(passage.shift);
            match body.hinge {
                Hinge::Revolute => each_shape!(&body.link, |link| {
                    self.pass(k, &R, &Hinge::Revolute, &ByLink { link, shift }, entries);
                }),
                Hinge::Prismatic => {
                    self.pass(k, &R, &Hinge::Prismatic, &ByLink { link: &body.link, shift }, entries);
                }
                _ => self.pass(k, &R, &body.hinge, &ByLink { link: &body.link, shift }, entries),
            }
        }
    }
    /// f of a degree of freedom outboard of all bodies that are to come.
    #[inline(always)]
    pub(super) fn set_column<W: Wide<T>>(&mut self, place: usize, f: &Wrench<T>) {
        let lane = place % W::COUNT;
        let six = &mut self.columns[SIX * (place - lane)..][..SIX * W::COUNT];
        let ([a, b, c], [d, e, g]) = (f.moment.0, f.force.0);
        six[lane] = a;
        six[W::COUNT + lane] = b;
        six[2 * W::COUNT + lane] = c;
        six[3 * W::COUNT + lane] = d;
        six[4 * W::COUNT + lane] = e;
        six[5 * W::COUNT + lane] = g;
    }
    /// A floating base: its rows are the columns themselves, in its axes.
    #[inline(always)]
    fn base<W: Wide<T>, E: Entries<T, W> + Blocks<T>>(
        &mut self,
        k: usize,
        R: &RigidInertia<T>,
        entries: &mut E,
    ) {
        let (first, end) = (self.places.first[k], self.places.end[k]);
        let mut at = Places::group(first + 6, W::COUNT);
        while at < end {
            let f: [W; 6] = load(&self.columns[SIX * at..]).to_array();
            each_axis!(|I| entries.put(first + I, at, up_to(f[I], end - at)));
            at += W::COUNT;
        }
        entries.put_block(first, &R.to_articulated().to_rows());
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
            // The last register may have columns of other branches beyond.
            let (six, to) = (&mut self.columns[SIX * at..][..SIX * W::COUNT], end - at);
            let before: Wrench<W> = load(six);
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
                    moved = first_of(moved, before, to);
                }
                store(moved, six);
            }
            at += W::COUNT;
            // Between the register of its own column and the last one.
            if matches!(hinge, Hinge::Revolute) && at >= inner {
                let whole = Places::group(end, W::COUNT);
                if at < whole
                    && let Some(row) = entries.side_by_side(first, at)
                {
                    pass_whole(&mut self.columns[SIX * at..SIX * whole], to_parent, grounded, row);
                    at = whole;
                }
            }
        }
    }
}

/// Past a hinge: registers all of whose columns are outboard of it.
#[inline(always)]
fn pass_whole<T: Scalar, W: Wide<T>, P: ToParent<W>>(
    columns: &mut [T],
    to_parent: &P,
    grounded: bool,
    row: &mut [T],
) {
    let registers = columns.chunks_exact_mut(SIX * W::COUNT).zip(row.chunks_exact_mut(W::COUNT));
    if grounded {
        for (six, entries) in registers {
            load::<T, W>(six).moment.0[2].store(entries);
        }
        return;
    }
    for (six, entries) in registers {
        let f: Wrench<W> = load(six);
        f.moment.0[2].store(entries);
        store(to_parent.wrench(f), six);
    }
}

/// Six registers, side by side.
#[inline(always)]
fn load<T: Scalar, W: Wide<T>>(six: &[T]) -> Wrench<W> {
    let six = &six[..SIX * W::COUNT];
    Wrench::from_array([
        W::load(six),
        W::load(&six[W::COUNT..]),
        W::load(&six[2 * W::COUNT..]),
        W::load(&six[3 * W::COUNT..]),
        W::load(&six[4 * W::COUNT..]),
        W::load(&six[5 * W::COUNT..]),
    ])
}

#[inline(always)]
fn store<T: Scalar, W: Wide<T>>(f: Wrench<W>, six: &mut [T]) {
    let six = &mut six[..SIX * W::COUNT];
    let ([a, b, c], [d, e, g]) = (f.moment.0, f.force.0);
    a.store(six);
    b.store(&mut six[W::COUNT..]);
    c.store(&mut six[2 * W::COUNT..]);
    d.store(&mut six[3 * W::COUNT..]);
    e.store(&mut six[4 * W::COUNT..]);
    g.store(&mut six[5 * W::COUNT..]);
}

/// Zero from place `to` of a register on.
#[inline(always)]
pub(super) fn up_to<T: Scalar, W: Wide<T>>(x: W, to: usize) -> W {
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
