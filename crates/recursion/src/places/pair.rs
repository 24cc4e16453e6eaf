//! Two matrices of the places side by side, so that a product takes the columns of both as those of one.

use super::{Aligned, Places, Rows, RowsMut, WIDEST, each_place};
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{Scalar, Vec3};

/// Rows by places; of every row the columns of the first matrix, then those of the second. What is zero for every
/// configuration is never anything else between calls.
#[derive(Clone, Debug)]
pub(crate) struct Pair<T> {
    numbers: Aligned<T>,
    shape: Shape,
}

/// Where the numbers of a [`Pair`] are.
#[derive(Clone, Copy, Debug)]
struct Shape {
    /// From a row to the next: an odd number of cache lines.
    stride: usize,
    /// Numbers of a row before its first column, for registers that begin before it.
    lead: usize,
    /// Empty places before the first one.
    margin: usize,
    /// Columns of one matrix.
    nv: usize,
}

impl Shape {
    /// Where the column of a place is in the first matrix; a place may be empty, if a register that begins there is not.
    #[inline(always)]
    fn index(&self, row: usize, at: usize) -> usize {
        row * self.stride + (at + self.lead - self.margin)
    }
}

impl<T: Scalar> Pair<T> {
    /// Zeros.
    pub(crate) fn new(places: &Places) -> Self {
        let (lead, margin, nv) = (T::COLUMNS, places.margin, places.count - places.margin);
        let lines = (lead + 2 * nv).div_ceil(T::COLUMNS);
        let stride = (lines / 2 * 2 + 1) * T::COLUMNS;
        let shape = Shape { stride, lead, margin, nv };
        // More rows, for those that are read from a column on, and for a block that has three at least.
        Pair { numbers: Aligned::new(stride * (places.count + 3)), shape }
    }
    /// No numbers.
    pub(crate) fn empty() -> Self {
        Pair { numbers: Aligned::new(0), shape: Shape { stride: 1, lead: 0, margin: 0, nv: 0 } }
    }
    /// Access to all rows, for the time of a sweep.
    #[inline(always)]
    pub(crate) fn view(&mut self) -> PairView<'_, T> {
        PairView { shape: self.shape, numbers: &mut self.numbers }
    }
    /// Access to all rows, to read them, for the time of a sweep.
    #[inline(always)]
    pub(crate) fn read(&self) -> PairRows<'_, T> {
        PairRows { shape: self.shape, numbers: &self.numbers }
    }
    /// Writes both matrices, to the model's order.
    #[inline(always)]
    pub(crate) fn write<W: Wide<T>>(&self, places: &Places, [first, second]: [&mut [T]; 2]) {
        let Shape { stride, lead, nv, .. } = self.shape;
        let rows = &self.numbers[places.margin * stride + lead..];
        places.write_rows::<T, W>(rows, stride, first);
        places.write_rows::<T, W>(&rows[nv..], stride, second);
    }
}

/// See [`Pair`].
#[derive(Clone, Copy)]
pub(crate) struct PairRows<'a, T> {
    shape: Shape,
    numbers: &'a [T],
}

impl<'a, T: Scalar> PairRows<'a, T> {
    /// Rows from `from` on and before `to`, each from column `column` of both matrices on: as many numbers as a row has.
    #[inline(always)]
    pub(crate) fn all(&self, from: usize, to: usize, column: usize) -> Rows<'a, T> {
        let (stride, start) = (self.shape.stride, self.shape.lead + column);
        Rows::new(&self.numbers[from * stride + start..to * stride + start], stride)
    }
    /// `W::COUNT` × `G` numbers of one row, from column `column` of both matrices on.
    #[inline(always)]
    pub(crate) fn one<W: Wide<T>, const G: usize>(&self, row: usize, column: usize) -> &'a [T] {
        let start = row * self.shape.stride + self.shape.lead + column;
        &self.numbers[start..start + G * W::COUNT]
    }
}

/// See [`Pair`].
pub(crate) struct PairView<'a, T> {
    shape: Shape,
    numbers: &'a mut [T],
}

impl<T: Scalar> PairView<'_, T> {
    /// As [`PairRows::all`], to be written.
    #[inline(always)]
    pub(crate) fn all(&mut self, from: usize, to: usize, column: usize) -> RowsMut<'_, T> {
        let (stride, start) = (self.shape.stride, self.shape.lead + column);
        RowsMut::new(&mut self.numbers[from * stride + start..to * stride + start], stride)
    }
    /// As [`PairRows::one`], to be written.
    #[inline(always)]
    pub(crate) fn one<W: Wide<T>, const G: usize>(&mut self, row: usize, column: usize) -> &mut [T] {
        let start = row * self.shape.stride + self.shape.lead + column;
        &mut self.numbers[start..start + G * W::COUNT]
    }
    /// A number of each matrix, from registers of one number.
    #[inline(always)]
    pub(crate) fn set<W: Wide<T>>(&mut self, row: usize, place: usize, [a, b]: [W; 2]) {
        let row = &mut self.numbers[self.shape.index(row, place)..][..self.shape.nv + 1];
        a.store_first(&mut row[..1]);
        b.store_first(&mut row[self.shape.nv..]);
    }
    /// Three numbers of the first matrix, one above the other.
    #[inline(always)]
    pub(crate) fn set_three(&mut self, (row, place): (usize, usize), x: Vec3<T>) {
        let start = self.shape.index(row, place);
        let rows = &mut self.numbers[start..start + 2 * self.shape.stride + 1];
        for i in 0..3 {
            rows[i * self.shape.stride] = x.0[i];
        }
    }
    /// A block of six rows and columns of one of the matrices.
    #[inline(always)]
    pub(crate) fn set_block(&mut self, which: usize, (row, place): (usize, usize), block: &[[T; 6]; 6]) {
        let Shape { stride, nv, .. } = self.shape;
        let start = self.shape.index(row, place) + which * nv;
        let rows = &mut self.numbers[start..start + 5 * stride + 6];
        for i in 0..6 {
            rows[i * stride..i * stride + 6].copy_from_slice(&block[i]);
        }
    }
    /// A register of each matrix, of the columns from place `at` on.
    #[inline(always)]
    pub(crate) fn put<W: Wide<T>>(&mut self, row: usize, at: usize, [a, b]: [W; 2]) {
        let Shape { margin, nv, .. } = self.shape;
        let row = &mut self.numbers[self.shape.index(row, at)..][..nv + W::COUNT];
        a.store(&mut row[..]);
        let second = &mut row[nv..];
        if at >= margin { b.store(second) } else { b.store_between(margin - at, W::COUNT, second) }
    }
    /// Registers of both matrices, of rows from `top` on and of the columns from place `left` on. Of row `top` + i the columns
    /// before place `ends[i]` are written.
    #[inline(always)]
    pub(crate) fn put_tiles<W: Wide<T>>(
        &mut self,
        (top, left): (usize, usize),
        [a, b]: [[W; WIDEST]; 2],
        ends: &[usize],
    ) {
        let Shape { margin, nv, stride, .. } = self.shape;
        let (hidden, ends) = (margin.saturating_sub(left), &ends[..W::COUNT]);
        let rows = &mut self.numbers[self.shape.index(top, left)..];
        if hidden == 0 && ends[0] >= left + W::COUNT {
            W::store_rows(&a, stride, rows);
            W::store_rows(&b, stride, &mut rows[nv..]);
        } else {
            put_between(a, (left, hidden), ends, stride, rows);
            put_between(b, (left, hidden), ends, stride, &mut rows[nv..]);
        }
    }
}

/// Puts what is right of the `hidden` places, and before place `ends[i]` of row i, to rows that begin with place `left`. The other numbers
/// stay as they are but are written again: who reads a whole register would wait for a part of it.
#[inline(always)]
fn put_between<T: Scalar, W: Wide<T>>(
    mut tile: [W; WIDEST],
    (left, hidden): (usize, usize),
    ends: &[usize],
    stride: usize,
    rows: &mut [T],
) {
    let others = W::load_rows(stride, rows);
    each_place!(W, I => {
        let end = ends[I].saturating_sub(left).max(hidden).min(W::COUNT);
        tile[I] = others[I].up_to(hidden, tile[I]).up_to(end, others[I]);
    });
    W::store_rows(&tile, stride, rows);
}
