//! Places of degrees of freedom in registers, for matrices and for what is kept of every degree of freedom.
//!
//! Degrees of freedom are in the order of the layout's bodies, so that those of a body and of all outboard of it are a range of
//! places. Places are counted in groups of [`Scalar::COLUMNS`], and the last place ends a group: the tips, which sweeps meet
//! most often, lie in as few groups as can be. [`Table`] keeps the rows of a group together, at distances that the compiler
//! knows.

use crate::layout::Layout;
use core::ops::Range;
use phipsi_spatial::wide::{WIDEST, Wide};
use phipsi_spatial::{Mat3, Motion, Scalar, Sym3, Vec3, Wrench};

/// Rows that a product takes at once.
pub(crate) const ROWS: usize = 4;

mod aligned;
mod mirror;
mod pair;
mod rows;
mod write;

pub(crate) use aligned::Aligned;
pub(crate) use mirror::each_place;
pub(crate) use pair::{Pair, PairRows, PairView};
pub(crate) use rows::{Rows, RowsMut};

/// Where degrees of freedom are.
#[derive(Clone, Debug)]
pub(crate) struct Places {
    /// Place of the first degree of freedom of every body.
    pub(crate) first: Vec<usize>,
    /// One past the last place outboard of every body.
    pub(crate) end: Vec<usize>,
    /// The first place of all; those before it are empty, enough for a register that ends there.
    pub(crate) margin: usize,
    /// Their number.
    pub(crate) count: usize,
    /// From a row of a matrix to the next: an odd number of cache lines, so that numbers of a column do not crowd each other out.
    pub(crate) stride: usize,
    /// The first places of floating bases.
    pub(crate) bases: Vec<usize>,
    /// The places of other joints of several degrees of freedom.
    pub(crate) several: Vec<Range<usize>>,
    /// Registers of 1, 2, 4 and 8 places with the first place of a body.
    with_bodies: [Vec<usize>; 4],
    /// Degree of freedom of the model at every place.
    dof: Vec<usize>,
    /// One past the last place outboard of any place of a register, for registers of 1, 2, 4 and 8 places, one after the other; nothing is
    /// outboard of the empty places.
    outboard_of_registers: [Vec<usize>; 4],
    /// True if the model's order is that of the places.
    pub(crate) in_order: bool,
}

impl Places {
    /// For matrices of `T`.
    pub(crate) fn new<T: Scalar>(layout: &Layout<T::Constant>) -> Self {
        // Of flexible trees there are none: who needs places refuses them, or goes another way.
        let nv = if layout.is_flexible() { 0 } else { layout.nv() };
        let count = (nv + T::COLUMNS - 1).next_multiple_of(T::COLUMNS.max(ROWS));
        let margin = count - nv;
        let stride = (count / T::COLUMNS / 2 * 2 + 1) * T::COLUMNS;
        let (mut first, mut end, mut dof) = (Vec::new(), Vec::new(), vec![0; margin]);
        let mut outboard = vec![0; margin];
        for (body, dofs) in layout.bodies().iter().zip(&layout.outboard_dofs) {
            first.push(dof.len());
            end.push(dof.len() + dofs);
            dof.extend(body.v..body.v + body.hinge.nv());
            outboard.extend(end.last().into_iter().cycle().take(body.hinge.nv()));
        }
        let bodies = layout.bodies().iter().zip(&first);
        let bases = bodies.filter(|(body, _)| body.floats()).map(|(_, &first)| first).collect();
        let several =
            layout.bodies().iter().zip(&first).filter(|(body, _)| !body.floats() && body.hinge.nv() > 1);
        let several = several.map(|(body, &first)| first..first + body.hinge.nv()).collect();
        let widths = [1, 2, 4, WIDEST];
        let with_bodies = widths.map(|width| {
            let mut registers: Vec<usize> = first.iter().map(|&at| Places::group(at, width)).collect();
            registers.dedup();
            registers
        });
        let in_order = (0..nv).all(|i| dof[margin + i] == i);
        let outboard_of_registers: [Vec<usize>; 4] = widths.map(|width| {
            outboard.chunks(width).map(|ends| ends.iter().copied().fold(0, usize::max)).collect()
        });
        Places {
            first,
            end,
            margin,
            count,
            stride,
            bases,
            several,
            with_bodies,
            dof,
            outboard_of_registers,
            in_order,
        }
    }
    /// The places of a body's own degrees of freedom.
    pub(crate) fn own(&self, k: usize) -> Range<usize> {
        self.first[k]..self.first.get(k + 1).copied().unwrap_or(self.count)
    }
    /// Degree of freedom of the model at a place.
    #[inline(always)]
    pub(crate) fn dof(&self, place: usize) -> usize {
        self.dof[place]
    }
    /// One past the last place outboard of any place of a register of `width` from `at` on.
    #[inline(always)]
    pub(crate) fn outboard_end(&self, at: usize, width: usize) -> usize {
        self.outboard_of_registers[width.trailing_zeros() as usize & 3][at / width]
    }
    /// Registers of `width` with the first place of a body.
    #[inline(always)]
    pub(crate) fn with_bodies(&self, width: usize) -> &[usize] {
        &self.with_bodies[width.trailing_zeros() as usize & 3]
    }
    /// True if a register of `width` from place `at` on holds nothing but places of one floating base.
    #[inline(always)]
    pub(crate) fn all_of_base(&self, at: usize, width: usize) -> bool {
        self.bases.iter().any(|&first| first <= at.max(self.margin) && at + width <= first + 6)
    }
    /// Pairs of a degree of freedom with one that is not inboard of it.
    pub(crate) fn pairs(&self) -> usize {
        (0..self.first.len()).map(|k| (self.end[k] - self.first[k]) * self.own(k).len()).sum()
    }
    /// A matrix of zeros.
    pub(crate) fn zeros<T: Scalar>(&self) -> Aligned<T> {
        Aligned::new(self.stride * self.count)
    }
    /// The first place of the group in which a place is, in registers of `width`.
    #[inline(always)]
    pub(crate) fn group(at: usize, width: usize) -> usize {
        at - at % width
    }
}

/// `N` numbers of every place.
#[derive(Clone, Debug)]
pub(crate) struct Table<T, const N: usize> {
    numbers: Aligned<T>,
}

impl<T: Scalar, const N: usize> Table<T, N> {
    pub(crate) fn new(places: &Places) -> Self {
        Table { numbers: Aligned::new(N * places.count.next_multiple_of(T::COLUMNS)) }
    }
    /// Access to all rows of a group, for the time of a sweep.
    #[inline(always)]
    pub(crate) fn view(&mut self) -> View<'_, T, N> {
        View { numbers: &mut self.numbers }
    }
}

impl<T: Scalar, const N: usize> Table<T, N> {
    /// Where the numbers of a place start.
    pub(crate) fn start(at: usize) -> usize {
        at / T::COLUMNS * (N * T::COLUMNS) + at % T::COLUMNS
    }
}

/// See [`Table`].
pub(crate) struct View<'a, T, const N: usize> {
    numbers: &'a mut [T],
}

impl<T: Scalar, const N: usize> View<'_, T, N> {
    /// The rows of the group in which place `at` is, from that place on.
    #[inline(always)]
    pub(crate) fn at(&mut self, at: usize) -> Group<'_, T, N> {
        let start = at / T::COLUMNS * (N * T::COLUMNS);
        Group { numbers: &mut self.numbers[start..start + N * T::COLUMNS], lane: at % T::COLUMNS }
    }
}

impl<T: Scalar, const N: usize> View<'_, T, N> {
    /// The numbers of a place, by where they start.
    #[inline(always)]
    pub(crate) fn lane(&self, start: usize) -> Lane<'_, T, N> {
        Lane { numbers: &self.numbers[start..start + (N - 1) * T::COLUMNS + 1] }
    }
}

/// The rows of one place.
pub(crate) struct Lane<'a, T, const N: usize> {
    numbers: &'a [T],
}

impl<T: Scalar, const N: usize> Lane<'_, T, N> {
    #[inline(always)]
    pub(crate) fn get(&self, r: usize) -> T {
        self.numbers[..(N - 1) * T::COLUMNS + 1][r * T::COLUMNS]
    }
    /// Rows `r` to `r` + 2.
    #[inline(always)]
    pub(crate) fn vector(&self, r: usize) -> Vec3<T> {
        Vec3([self.get(r), self.get(r + 1), self.get(r + 2)])
    }
    /// Rows `r` to `r` + 5.
    #[inline(always)]
    pub(crate) fn motion(&self, r: usize) -> Motion<T> {
        Motion::new(self.vector(r), self.vector(r + 3))
    }
    /// Rows `r` to `r` + 8, three vectors.
    #[inline(always)]
    pub(crate) fn vectors(&self, r: usize) -> [Vec3<T>; 3] {
        [self.vector(r), self.vector(r + 3), self.vector(r + 6)]
    }
}

/// Rows of one group, seen from one of its places. A register begins at a multiple of its own width.
pub(crate) struct Group<'a, T, const N: usize> {
    numbers: &'a mut [T],
    lane: usize,
}

impl<T: Scalar, const N: usize> Group<'_, T, N> {
    /// Index of row `r`; the mask, which changes nothing, tells the compiler that it is inside.
    #[inline(always)]
    fn index<W: Wide<T>>(&self, r: usize) -> usize {
        r * T::COLUMNS + (self.lane & (T::COLUMNS - W::COUNT.min(T::COLUMNS)))
    }
    #[inline(always)]
    pub(crate) fn get<W: Wide<T>>(&self, r: usize) -> W {
        let i = self.index::<W>(r);
        W::load(&self.numbers[..N * T::COLUMNS][i..i + W::COUNT])
    }
    #[inline(always)]
    pub(crate) fn set<W: Wide<T>>(&mut self, r: usize, x: W) {
        let i = self.index::<W>(r);
        x.store(&mut self.numbers[..N * T::COLUMNS][i..i + W::COUNT]);
    }
    /// Row `r` from place `from` of the register on and before place `to`.
    #[inline(always)]
    pub(crate) fn set_between<W: Wide<T>>(&mut self, r: usize, from: usize, to: usize, x: W) {
        let i = self.index::<W>(r);
        x.store_between(from, to, &mut self.numbers[..N * T::COLUMNS][i..i + W::COUNT]);
    }
    /// Rows `r` to `r` + 2.
    #[inline(always)]
    pub(crate) fn vector<W: Wide<T>>(&self, r: usize) -> Vec3<W> {
        Vec3([self.get(r), self.get(r + 1), self.get(r + 2)])
    }
    #[inline(always)]
    pub(crate) fn set_vector<W: Wide<T>>(&mut self, r: usize, x: Vec3<W>) {
        self.set(r, x.0[0]);
        self.set(r + 1, x.0[1]);
        self.set(r + 2, x.0[2]);
    }
    /// Rows `r` to `r` + 5.
    #[inline(always)]
    pub(crate) fn wrench<W: Wide<T>>(&self, r: usize) -> Wrench<W> {
        Wrench::new(self.vector(r), self.vector(r + 3))
    }
    #[inline(always)]
    pub(crate) fn set_wrench<W: Wide<T>>(&mut self, r: usize, f: Wrench<W>) {
        self.set_vector(r, f.moment);
        self.set_vector(r + 3, f.force);
    }
    #[inline(always)]
    pub(crate) fn motion<W: Wide<T>>(&self, r: usize) -> Motion<W> {
        Motion::new(self.vector(r), self.vector(r + 3))
    }
    #[inline(always)]
    pub(crate) fn set_motion<W: Wide<T>>(&mut self, r: usize, v: Motion<W>) {
        self.set_vector(r, v.angular);
        self.set_vector(r + 3, v.linear);
    }
    /// Rows `r` to `r` + 5, by columns of the upper triangle.
    #[inline(always)]
    pub(crate) fn symmetric<W: Wide<T>>(&self, r: usize) -> Sym3<W> {
        let [xx, xy, xz] = self.vector(r).0;
        let [yy, yz, zz] = self.vector(r + 3).0;
        Sym3 { xx, xy, xz, yy, yz, zz }
    }
    #[inline(always)]
    pub(crate) fn set_symmetric<W: Wide<T>>(&mut self, r: usize, m: &Sym3<W>) {
        self.set_vector(r, Vec3([m.xx, m.xy, m.xz]));
        self.set_vector(r + 3, Vec3([m.yy, m.yz, m.zz]));
    }
    /// Rows `r` to `r` + 8, by rows.
    #[inline(always)]
    pub(crate) fn matrix<W: Wide<T>>(&self, r: usize) -> Mat3<W> {
        Mat3([self.vector(r).0, self.vector(r + 3).0, self.vector(r + 6).0])
    }
    #[inline(always)]
    pub(crate) fn set_matrix<W: Wide<T>>(&mut self, r: usize, m: &Mat3<W>) {
        self.set_vector(r, Vec3(m.0[0]));
        self.set_vector(r + 3, Vec3(m.0[1]));
        self.set_vector(r + 6, Vec3(m.0[2]));
    }
}

/// The same vector in every place.
#[inline(always)]
pub(crate) fn vector<T: Scalar, W: Wide<T>>(v: Vec3<T>) -> Vec3<W> {
    Vec3([W::broadcast(v.0[0]), W::broadcast(v.0[1]), W::broadcast(v.0[2])])
}

/// Zero outside of some places of a register.
#[inline(always)]
pub(crate) fn inside<T: Scalar, W: Wide<T>>(v: Vec3<W>, from: usize, to: usize) -> Vec3<W> {
    Vec3([v.0[0].between(from, to), v.0[1].between(from, to), v.0[2].between(from, to)])
}
