//! Six-vectors of all degrees of freedom, side by side, that move together through the joints: columns of 6×n operators.
//!
//! Columns lie at the places of their degrees of freedom ([`crate::places`]), so that those outboard of a joint are a range, and
//! the same few numbers of φ(p, k) act on all of it, in registers of several columns ([`Wide`]). An inward sweep begins columns
//! from the last to the first. Registers are counted from the end of a range; what the last one does to columns before the range
//! is forgotten, because these have not begun yet.

use crate::layout::{LayoutBody, Passage};
use crate::link::Shift;
use crate::places::{Places, vector};
use phipsi_spatial::wide::{WIDEST, Wide};
use phipsi_spatial::{Mat3, Scalar, Transform, Turn, Vec3, Wrench};

/// Six rows of numbers, one place for each column; moment x, y, z, force x, y, z.
#[derive(Clone, Debug)]
pub(crate) struct Columns<T> {
    numbers: Vec<T>,
    count: usize,
}

impl<T: Scalar> Columns<T> {
    pub(crate) fn new(places: &Places) -> Self {
        Columns { numbers: vec![T::zero(); 6 * places.count + WIDEST], count: places.count }
    }
    /// The rows, in cache lines of their own.
    #[inline(always)]
    pub(crate) fn rows(&mut self) -> Rows<'_, T> {
        let start = self.numbers.as_ptr().align_offset(64).min(WIDEST);
        let all = &mut self.numbers[start..start + 6 * self.count];
        let (a, all) = all.split_at_mut(self.count);
        let (b, all) = all.split_at_mut(self.count);
        let (c, all) = all.split_at_mut(self.count);
        let (d, all) = all.split_at_mut(self.count);
        let (e, f) = all.split_at_mut(self.count);
        let f = &mut f[..self.count];
        Rows { rows: [a, b, c, d, e, f], count: self.count }
    }
}

/// See [`Columns`].
pub(crate) struct Rows<'a, T> {
    rows: [&'a mut [T]; 6],
    count: usize,
}

impl<T: Scalar> Rows<'_, T> {
    /// One column.
    #[inline(always)]
    pub(crate) fn set(&mut self, place: usize, f: Wrench<T>) {
        for (row, x) in self.rows.iter_mut().zip(f.to_array()) {
            row[place] = x;
        }
    }
    /// Component `c` of the columns from place `at` on.
    #[inline(always)]
    pub(crate) fn component<W: Wide<T>>(&self, c: usize, at: usize) -> W {
        W::load(&self.rows[c][at..])
    }
    /// The columns from place `at` on.
    #[inline(always)]
    pub(crate) fn load<W: Wide<T>>(&self, at: usize) -> Wrench<W> {
        let [a, b, c, d, e, f] = &self.rows;
        let (n, end) = (self.count, at + W::COUNT);
        Wrench::from_array([
            W::load(&a[..n][at..end]),
            W::load(&b[..n][at..end]),
            W::load(&c[..n][at..end]),
            W::load(&d[..n][at..end]),
            W::load(&e[..n][at..end]),
            W::load(&f[..n][at..end]),
        ])
    }
    /// Writes the columns from place `at` on.
    #[inline(always)]
    pub(crate) fn store<W: Wide<T>>(&mut self, at: usize, x: Wrench<W>) {
        let n = self.count;
        for (row, x) in self.rows.iter_mut().zip(x.to_array()) {
            x.store(&mut row[..n][at..at + W::COUNT]);
        }
    }
}

/// φ(p, k) of one body, for several columns at once.
pub(crate) struct WidePassage<'a, T: Scalar, W> {
    body: &'a LayoutBody<T::Constant>,
    shift: Shift<W>,
    general: Option<Transform<W>>,
}

impl<'a, T: Scalar, W: Wide<T>> WidePassage<'a, T, W> {
    #[inline(always)]
    pub(crate) fn new(body: &'a LayoutBody<T::Constant>, passage: Passage<'_, T>) -> Self {
        let Turn { cos, sin } = passage.shift.turn;
        let shift = Shift {
            turn: Turn { cos: W::broadcast(cos), sin: W::broadcast(sin) },
            offset: vector(passage.shift.offset),
        };
        let general = match passage.general {
            Some(x) => {
                let [a, b, c] = x.rotation.0;
                let rotation = Mat3([vector(Vec3(a)).0, vector(Vec3(b)).0, vector(Vec3(c)).0]);
                Some(Transform::new(rotation, vector(x.translation)))
            }
            None => None,
        };
        WidePassage { body, shift, general }
    }
    /// φ f.
    #[inline(always)]
    pub(crate) fn wrench_to_parent(&self, f: Wrench<W>) -> Wrench<W> {
        match &self.general {
            Some(x) => x.wrench_to_parent(f),
            None => self.body.link.wrench_to_parent(&self.shift, f),
        }
    }
}
