//! Bodies in the axes of the ground, each about its own origin: what sweeps over pairs of joints run on.
//!
//! | rows | meaning |
//! |---|---|
//! | `AXES` | x, y, z of the body |
//! | `OFFSET` | d: the body's origin from its parent's; at every axis of its joint |
//! | `AXIS` | S of the degree of freedom, a column of H* |
//! | `COMPOSITE` | R: mass, first moment and inertia, about the body's origin |
//!
//! φ(p, k) is a shift by d alone, six multiplications for a wrench. Only directions refer to the ground; no distance does.

use crate::hinge::Hinge;
use crate::layout::{GROUND, Layout, LayoutBody};
use crate::places::{Group, Places, Table, View, inside, vector};
use core::ops::Range;
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{Mat3, Motion, RigidInertia, Scalar, Sym3, Vec3, Wrench};

mod turning;

pub(crate) use turning::Turning;

pub(crate) const AXES: usize = 0;
pub(crate) const OFFSET: usize = 9;
pub(crate) const AXIS: usize = 12;
pub(crate) const COMPOSITE: usize = 18;
/// The rows of this table; others may follow.
pub(crate) const ROWS: usize = 28;

/// The axes of a body.
pub(crate) type Directions<T> = [Vec3<T>; 3];

/// The ground's axes.
#[inline(always)]
pub(crate) fn ground<T: Scalar>() -> Directions<T> {
    [Vec3::unit(0), Vec3::unit(1), Vec3::unit(2)]
}

impl<T: Scalar, const N: usize> Group<'_, T, N> {
    #[inline(always)]
    pub(crate) fn axes(&self) -> Directions<T> {
        [self.vector(AXES), self.vector(AXES + 3), self.vector(AXES + 6)]
    }
    #[inline(always)]
    pub(crate) fn rigid<W: Wide<T>>(&self, r: usize) -> RigidInertia<W> {
        RigidInertia { mass: self.get(r), first_moment: self.vector(r + 1), inertia: self.symmetric(r + 4) }
    }
    #[inline(always)]
    pub(crate) fn set_rigid<W: Wide<T>>(&mut self, r: usize, m: &RigidInertia<W>) {
        self.set(r, m.mass);
        self.set_vector(r + 1, m.first_moment);
        self.set_symmetric(r + 4, &m.inertia);
    }
}

/// Column i of H*, in the axes that the body's are given in.
#[inline(always)]
pub(crate) fn axis<T: Scalar>(hinge: &Hinge<T::Constant>, axes: &Directions<T>, i: usize) -> Motion<T> {
    let zero = Vec3::zero();
    if let Hinge::Revolute = hinge {
        return Motion::new(axes[2], zero);
    }
    let linear = match hinge {
        Hinge::Helical { pitch } => axes[2].scale(T::constant(*pitch)),
        _ => zero,
    };
    match hinge.components()[i] {
        c @ 0..3 => Motion::new(axes[c], linear),
        c => Motion::new(zero, axes[c - 3]),
    }
}

/// Puts a body into the table.
#[inline(always)]
pub(crate) fn set_body<T: Scalar, const N: usize>(
    view: &mut View<'_, T, N>,
    at: usize,
    body: &LayoutBody<T::Constant>,
    axes: &Directions<T>,
    offset: Vec3<T>,
) {
    let mut here = view.at(at);
    here.set_vector(AXES, axes[0]);
    here.set_vector(AXES + 3, axes[1]);
    here.set_vector(AXES + 6, axes[2]);
    here.set_vector(OFFSET, offset);
    if let Hinge::Revolute = body.hinge {
        here.set_vector(AXIS, axes[2]);
        return;
    }
    set_axes(view, at, body);
}

/// The columns of H* and the offset of a body in the table that is on another joint than a hinge.
#[inline(always)]
fn set_axes<T: Scalar, const N: usize>(view: &mut View<'_, T, N>, at: usize, body: &LayoutBody<T::Constant>) {
    // Read again: numbers chosen by an index would all have to lie in memory, for hinges, too.
    let (axes, offset) = (view.at(at).axes(), view.at(at).vector::<T>(OFFSET));
    for i in 0..body.hinge.nv() {
        view.at(at + i).set_motion(AXIS, axis(&body.hinge, &axes, i));
        view.at(at + i).set_vector(OFFSET, offset);
    }
}

/// Does a step for all bodies, side by side where there are registers for it, from each group or body and its own inertia in
/// the axes of the ground.
macro_rules! each_own_inertia {
    ($t:ty, $w:ty, $layout:expr, $places:expr, $own:expr, $view:expr, |$group:ident, $inertia:ident| $step:expr) => {
        if <$w as Wide<$t>>::COUNT == 1 {
            for (body, &at) in $layout.bodies().iter().zip(&$places.first) {
                let mut $group = $view.at(at);
                let own = RigidInertia::<$w>::constant(&body.inertia);
                let $inertia = $crate::ground_axes::turned::<$t, $w, _>(&$group, &own);
                $step;
            }
        } else {
            for &at in $places.with_bodies(<$w as Wide<$t>>::COUNT) {
                let mut $group = $view.at(at);
                let $inertia = $crate::ground_axes::turned::<$t, $w, _>(&$group, &$own.at(at));
                $step;
            }
        }
    };
}
pub(crate) use each_own_inertia;

/// Does a step for all bodies, side by side where there are registers for it.
macro_rules! each_body {
    ($t:ty, $w:ty, $places:expr, $view:expr, |$group:ident| $step:expr) => {
        for &at in $places.with_bodies(<$w as Wide<$t>>::COUNT) {
            let mut $group = $view.at(at);
            $step;
        }
    };
}
pub(crate) use each_body;

/// An inertia in the axes of the ground.
#[inline(always)]
pub(crate) fn turned<T: Scalar, W: Wide<T>, const N: usize>(
    group: &Group<'_, T, N>,
    own: &RigidInertia<W>,
) -> RigidInertia<W> {
    let axes = Mat3::from_columns(group.vector(AXES), group.vector(AXES + 3), group.vector(AXES + 6));
    RigidInertia { mass: own.mass, first_moment: axes * own.first_moment, inertia: own.inertia.rotate(&axes) }
}

/// Composites of all bodies, tip to base, from their own inertias.
#[inline(always)]
pub(crate) fn gather_composites<T: Scalar, const N: usize>(
    layout: &Layout<T::Constant>,
    places: &Places,
    view: &mut View<'_, T, N>,
) {
    let (bodies, first) = (layout.bodies(), &places.first[..layout.len()]);
    let mut k = bodies.len();
    // From every tip along a run of first children, whose sum stays in registers.
    while k > 0 {
        k -= 1;
        let mut R = view.at(first[k]).rigid::<T>(COMPOSITE);
        while bodies[k].parent != GROUND {
            let (body, d) = (&bodies[k], view.at(first[k]).vector::<T>(OFFSET));
            let mut parent = view.at(first[body.parent]);
            R = R.shifted_onto(d, &parent.rigid(COMPOSITE));
            parent.set_rigid(COMPOSITE, &R);
            if !body.follows_parent(k) {
                break;
            }
            k -= 1;
        }
    }
}

/// An axis of a joint on the way from those outboard of it to the base; of a floating base its first one alone is passed, in the end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Passage {
    /// The joint's first place, one past its last, and one past the last place outboard.
    pub(crate) first: usize,
    pub(crate) inner: usize,
    pub(crate) end: usize,
    /// The place passed next, inboard: of the joint's next axis, or the first one of the joint inboard; [`GROUND`] in the end.
    inboard: usize,
    /// The first place of the joint before it in the order of bodies, and one past its last; of a joint's last axis only.
    before: usize,
    before_end: usize,
    /// True if columns go on from here to the origin of a body inboard that lies elsewhere.
    pub(crate) shifts: bool,
    /// True if the axis may have a linear part.
    pub(crate) linear: bool,
    /// True if its joint holds nothing, inside a tree.
    pub(crate) free: bool,
}

impl Passage {
    /// The columns of a register from place `at` on, seen from here.
    #[inline(always)]
    pub(crate) fn columns(&self, at: usize, count: usize) -> Columns {
        if count == 1 {
            let own = self.inner > at;
            return Columns { from: 0, own: usize::from(own), to: 1, all: !own };
        }
        Columns {
            from: self.first.saturating_sub(at),
            own: self.inner.saturating_sub(at).min(count),
            to: (self.end - at).min(count),
            all: self.inner <= at && self.end >= at + count,
        }
    }
}

/// Columns of a register where a joint is passed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Columns {
    /// The first one that has begun.
    pub(crate) from: usize,
    /// One past the last of the joint's own.
    pub(crate) own: usize,
    /// One past the last outboard.
    pub(crate) to: usize,
    /// True if all are of joints outboard.
    pub(crate) all: bool,
}

impl Columns {
    /// Zero beyond the columns that are outboard; `ALL` are.
    #[inline(always)]
    pub(crate) fn outboard<const ALL: bool, T: Scalar, W: Wide<T>>(&self, x: W) -> W {
        if ALL || W::COUNT == 1 { x } else { x.between(0, self.to) }
    }
    /// What a joint moves columns by, and zero in those that do not move; `ALL` do.
    #[inline(always)]
    pub(crate) fn moving<const ALL: bool, T: Scalar, W: Wide<T>>(&self, d: Vec3<T>) -> Vec3<W> {
        let d = vector::<T, W>(d);
        if ALL || W::COUNT == 1 { d } else { inside(d, self.from, self.to) }
    }
}

/// A step with the columns of a joint, in a copy of its own where all are outboard.
macro_rules! each_way {
    ($columns:expr, |$name:ident, $ALL:ident| $step:expr) => {
        let $name = $columns;
        if $name.all {
            const $ALL: bool = true;
            $step;
        } else {
            const $ALL: bool = false;
            $step;
        }
    };
}
pub(crate) use each_way;

/// The joints of a tree, as columns pass them.
#[derive(Clone, Debug)]
pub(crate) struct Passages {
    /// By places.
    axes: Vec<Passage>,
    /// Those of floating bases.
    bases: Vec<Passage>,
    /// The first place of the joint of every place.
    first: Vec<usize>,
    /// Places before every place, and before the end, whose axes may have linear parts.
    linear_before: Vec<usize>,
}

impl Passages {
    pub(crate) fn new<T: Scalar>(layout: &Layout<T::Constant>, places: &Places) -> Self {
        let linear = linear_axes::<T>(layout, places);
        let nothing = Passage {
            first: GROUND,
            inner: 0,
            end: 0,
            inboard: GROUND,
            before: GROUND,
            before_end: 0,
            shifts: false,
            linear: false,
            free: false,
        };
        let (mut axes, mut bases, mut first) =
            (vec![nothing; places.margin], Vec::new(), vec![0; places.margin]);
        // Floating bases are passed by themselves.
        let (mut before, mut before_end) = (GROUND, 0);
        // Of flexible trees there are no places.
        for (k, body) in layout.bodies().iter().enumerate().take_while(|_| places.count > 0) {
            let own = places.own(k);
            first.extend(own.clone().map(|_| own.start));
            let mut passage = Passage { first: own.start, inner: own.end, end: places.end[k], ..nothing };
            if body.floats() {
                bases.push(passage);
                // Columns that end on a base begin with what is before it.
                let skipped = Passage { first: GROUND, before, before_end, ..nothing };
                axes.extend(own.map(|_| skipped));
                continue;
            }
            let carrier = layout.bodies().get(body.parent).filter(|parent| !parent.floats());
            passage.free = matches!(body.hinge, Hinge::Free);
            for place in own.clone() {
                let last = place + 1 == own.end;
                axes.push(Passage {
                    inboard: if last {
                        carrier.map_or(GROUND, |_| places.first[body.parent])
                    } else {
                        place + 1
                    },
                    before: if last { before } else { GROUND },
                    before_end: if last { before_end } else { 0 },
                    shifts: last && body.parent != GROUND && !body.link.concentric,
                    linear: linear[place],
                    ..passage
                });
            }
            (before, before_end) = (own.start, own.end);
        }
        let counted = linear.iter().scan(0, |sum, &linear| {
            *sum += usize::from(linear);
            Some(*sum)
        });
        let linear_before = core::iter::once(0).chain(counted).collect();
        Passages { axes, bases, first, linear_before }
    }
    /// The first places of the joints of some places.
    #[inline(always)]
    pub(crate) fn first(&self, places: Range<usize>) -> &[usize] {
        &self.first[places]
    }
    /// True if the axis of a place may have a linear part.
    #[inline(always)]
    pub(crate) fn linear(&self, place: usize) -> bool {
        self.is_linear(place, 1)
    }
    /// True if an axis at one of `count` places from `at` on may have a linear part.
    #[inline(always)]
    pub(crate) fn is_linear(&self, at: usize, count: usize) -> bool {
        self.linear_before[at + count] > self.linear_before[at]
    }
    /// The floating bases that carry any of `count` places from `at` on, or are among them. What a column carries past all other joints is
    /// what it brings to its base.
    #[inline(always)]
    pub(crate) fn bases(&self, at: usize, count: usize) -> impl Iterator<Item = &Passage> {
        self.bases.iter().filter(move |base| base.first < at + count && base.end > at)
    }
    /// The axes of the joints of `count` places from `at` on, the last joint first, then those inboard of the first place, which are all
    /// that are inboard of any; axes of one joint in their order.
    #[inline(always)]
    pub(crate) fn inward(&self, at: usize, count: usize) -> Inward<'_> {
        let own = &self.axes[at + count - 1];
        // One column has nothing before it but what is inboard.
        let lowest = if count == 1 { usize::MAX } else { at };
        let next = if own.first == GROUND && own.before_end > lowest { own.before } else { own.first };
        Inward { axes: &self.axes, next, lowest }
    }
}

/// See [`Passages::inward`].
pub(crate) struct Inward<'a> {
    axes: &'a [Passage],
    next: usize,
    lowest: usize,
}

impl<'a> Iterator for Inward<'a> {
    type Item = (usize, &'a Passage);
    #[inline(always)]
    fn next(&mut self) -> Option<(usize, &'a Passage)> {
        let place = self.next;
        let axis = self.axes.get(place)?;
        self.next = if axis.before_end > self.lowest { axis.before } else { axis.inboard };
        Some((place, axis))
    }
}

/// Inertias of the bodies in their own axes, by places, for registers of several bodies.
#[derive(Clone, Debug)]
pub(crate) struct OwnInertias<T>(Vec<[T; 10]>);

impl<T: Scalar> OwnInertias<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>, places: &Places) -> Self {
        if T::COLUMNS == 1 {
            return OwnInertias(Vec::new());
        }
        // Rows of a group lie together, as in a table.
        let mut numbers = vec![[T::zero(); 10]; places.count];
        for (body, &at) in layout.bodies().iter().zip(&places.first) {
            let RigidInertia { mass, first_moment: h, inertia: J } =
                RigidInertia::<T>::constant(&body.inertia);
            let entries = [mass, h.0[0], h.0[1], h.0[2], J.xx, J.xy, J.xz, J.yy, J.yz, J.zz];
            let group = numbers[Places::group(at, T::COLUMNS)..][..T::COLUMNS].as_flattened_mut();
            for (r, x) in entries.into_iter().enumerate() {
                group[r * T::COLUMNS + at % T::COLUMNS] = x;
            }
        }
        OwnInertias(numbers)
    }
    /// Those from place `at` on.
    #[inline(always)]
    pub(crate) fn at<W: Wide<T>>(&self, at: usize) -> RigidInertia<W> {
        let group = self.0[Places::group(at, T::COLUMNS)..][..T::COLUMNS].as_flattened();
        let lane = at & (T::COLUMNS - W::COUNT.min(T::COLUMNS));
        let mut x = [W::zero(); 10];
        for (r, x) in x.iter_mut().enumerate() {
            *x = W::load(&group[r * T::COLUMNS + lane..][..W::COUNT]);
        }
        let [mass, hx, hy, hz, xx, xy, xz, yy, yz, zz] = x;
        RigidInertia { mass, first_moment: Vec3([hx, hy, hz]), inertia: Sym3 { xx, xy, xz, yy, yz, zz } }
    }
}

/// Rows of the first degree of freedom of every joint, copied to its others; not of floating bases.
#[inline(always)]
pub(crate) fn spread<T: Scalar, W: Wide<T>, const N: usize>(
    places: &Places,
    view: &mut View<'_, T, N>,
    rows: impl Iterator<Item = usize> + Clone,
) {
    for joint in &places.several {
        let mut at = Places::group(joint.start, W::COUNT);
        while at < joint.end {
            let (from, to) = (joint.start.saturating_sub(at), (joint.end - at).min(W::COUNT));
            for r in rows.clone() {
                let x = W::broadcast(view.at(joint.start).get(r));
                view.at(at).set_between(r, from, to, x);
            }
            at += W::COUNT;
        }
    }
}

/// True where a column of H* may have a linear part; not of floating bases.
pub(crate) fn linear_axes<T: Scalar>(layout: &Layout<T::Constant>, places: &Places) -> Vec<bool> {
    let mut linear = vec![false; places.count];
    for (body, &first) in layout.bodies().iter().zip(&places.first) {
        let angular = matches!(body.hinge, Hinge::Revolute | Hinge::Spherical);
        linear[first..first + body.hinge.nv()].fill(!angular && !body.floats());
    }
    linear
}

/// S* f of a column of H*; `linear`: it may have a linear part.
#[inline(always)]
pub(crate) fn along<T: Scalar, W: Wide<T>>(axis: &Motion<T>, linear: bool, f: &Wrench<W>) -> W {
    let sum = dot(axis.angular, f.moment);
    if !linear {
        return sum;
    }
    // A sum of its own: both wait for one addition.
    sum + dot(axis.linear, f.force)
}

#[inline(always)]
pub(crate) fn dot<T: Scalar, W: Wide<T>>(a: Vec3<T>, b: Vec3<W>) -> W {
    let ([x, y, z], [u, v, w]) = (a.0, b.0);
    u.fma(W::broadcast(x), v.fma(W::broadcast(y), w * W::broadcast(z)))
}

/// A table with these rows and others.
pub(crate) fn table<T: Scalar, const N: usize>(places: &Places) -> Table<T, N> {
    const { assert!(N >= ROWS) };
    Table::new(places)
}
