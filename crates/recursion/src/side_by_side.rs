//! Matrices whose rows and columns are degrees of freedom, laid out for registers of several columns.
//!
//! Degrees of freedom are in the order of the layout's bodies, so that those of a body and all outboard of it are a range. A
//! sweep inward takes the columns of a range in groups from its end downward: what the last group covers beyond the range
//! belongs to bodies that come later, and is overwritten when they come. A margin before the first place gives it room.

use crate::layout::{GROUND, Layout};
use phipsi_spatial::wide::{WIDEST, Wide};
use phipsi_spatial::{Scalar, Vec3, Wrench};

/// Rows that a product takes at once.
pub(crate) const ROWS: usize = 4;

/// Where degrees of freedom are.
#[derive(Clone, Debug)]
pub(crate) struct Places {
    /// Place of the first degree of freedom of every body.
    pub(crate) first: Vec<usize>,
    /// One past the last place outboard of every body.
    pub(crate) end: Vec<usize>,
    /// The places of all.
    pub(crate) margin: usize,
    pub(crate) past: usize,
    /// Length of a row.
    pub(crate) stride: usize,
    /// Degree of freedom of the model at every place.
    dof: Vec<usize>,
    /// True if the model's order is that of the places.
    in_order: bool,
}

impl Places {
    /// For matrices of `T`.
    pub(crate) fn new<T: Scalar>(layout: &Layout<T::Constant>) -> Self {
        let (margin, nv) = (T::COLUMNS, layout.nv());
        let stride = margin + nv.next_multiple_of(T::COLUMNS.max(ROWS));
        let (mut first, mut end, mut dof) = (Vec::new(), Vec::new(), vec![0; margin]);
        for (body, outboard) in layout.bodies().iter().zip(&layout.outboard_dofs) {
            first.push(dof.len());
            end.push(dof.len() + outboard);
            dof.extend(body.v..body.v + body.hinge.nv());
        }
        let in_order = (0..nv).all(|i| dof[margin + i] == i);
        Places { first, end, margin, past: margin + nv, stride, dof, in_order }
    }
    /// A matrix of zeros.
    pub(crate) fn zeros<T: Scalar>(&self) -> Vec<T> {
        vec![T::zero(); self.stride * (self.margin + (self.past - self.margin).next_multiple_of(ROWS))]
    }
    /// For every [`ROWS`] rows, the range of columns where rows of the places outboard of them are not zero.
    pub(crate) fn outboard_spans(&self) -> Vec<(usize, usize)> {
        let mut spans: Vec<(usize, usize)> = Vec::new();
        for p in (self.margin..self.past).step_by(ROWS) {
            let bodies = (0..self.first.len()).filter(|&k| {
                let inner = self.first.get(k + 1).copied().unwrap_or(self.past);
                self.first[k] < p + ROWS && inner > p
            });
            let (mut low, mut high) = (p, p);
            for k in bodies {
                low = low.min(self.first[k]);
                high = high.max(self.end[k]);
            }
            spans.push((low, high));
        }
        spans
    }
    /// For every [`ROWS`] rows, the ranges of places on their ways to the base, their own bodies' included.
    pub(crate) fn inboard_spans<T: Scalar>(&self, layout: &Layout<T::Constant>) -> Vec<Vec<(usize, usize)>> {
        let mut spans = Vec::new();
        for p in (self.margin..self.past).step_by(ROWS) {
            let mut met = vec![false; self.past];
            for k in 0..self.first.len() {
                let inner = self.first[k] + layout.bodies()[k].hinge.nv();
                if self.first[k] >= p + ROWS || inner <= p {
                    continue;
                }
                let mut at = k;
                while at != GROUND {
                    let inner = self.first[at] + layout.bodies()[at].hinge.nv();
                    met[self.first[at]..inner].fill(true);
                    at = layout.bodies()[at].parent;
                }
            }
            let mut ranges: Vec<(usize, usize)> = Vec::new();
            for i in (0..self.past).filter(|&i| met[i]) {
                match ranges.last_mut() {
                    Some(last) if last.1 == i => last.1 = i + 1,
                    _ => ranges.push((i, i + 1)),
                }
            }
            spans.push(ranges);
        }
        spans
    }
    /// Writes numbers of row `row`, from column `at`, to the model's matrix.
    #[inline(always)]
    pub(crate) fn write<T: Scalar, W: Wide<T>>(&self, row: usize, at: usize, x: W, out: &mut [T]) {
        let nv = self.past - self.margin;
        let count = W::COUNT.min(self.past - at);
        if self.in_order {
            let start = (row - self.margin) * nv + at - self.margin;
            x.store_first(&mut out[start..start + count]);
            return;
        }
        if W::COUNT == 1 {
            x.store(&mut out[self.dof[row] * nv + self.dof[at]..]);
            return;
        }
        let mut numbers = [T::zero(); WIDEST];
        x.store(&mut numbers);
        for lane in 0..count {
            out[self.dof[row] * nv + self.dof[at + lane]] = numbers[lane];
        }
    }
    /// Writes a whole matrix.
    #[inline(always)]
    pub(crate) fn write_all<T: Scalar, W: Wide<T>>(&self, matrix: &[T], out: &mut [T]) {
        for row in self.margin..self.past {
            let mut at = self.margin;
            while at < self.past {
                self.write(row, at, W::load(&matrix[row * self.stride + at..]), out);
                at += W::COUNT;
            }
        }
    }
    /// Fills the model's matrix below the diagonal of the places, from what is above.
    #[inline(always)]
    pub(crate) fn mirror<T: Scalar>(&self, out: &mut [T]) {
        let nv = self.past - self.margin;
        for row in self.margin..self.past {
            let i = self.dof[row];
            for column in row + 1..self.past {
                let c = self.dof[column];
                out[c * nv + i] = out[i * nv + c];
            }
        }
    }
}

/// Number l of `x`, from `skip` on, becomes the number `column` of row `first` + l of a matrix.
#[inline(always)]
pub(crate) fn scatter<T: Scalar, W: Wide<T>>(
    x: W,
    matrix: &mut [T],
    stride: usize,
    (first, column): (usize, usize),
    skip: usize,
) {
    let rows = &mut matrix[(first + skip) * stride..];
    if W::COUNT == 1 {
        x.store(&mut rows[column..]);
        return;
    }
    let mut numbers = [T::zero(); WIDEST];
    x.store(&mut numbers);
    for (row, x) in rows.chunks_exact_mut(stride).zip(&numbers[skip..W::COUNT]) {
        row[column] = *x;
    }
}

/// N rows of equal length, one place for each column. Their lengths are known to be equal where they are used, so that one
/// test of a range serves all.
pub(crate) struct Rows<'a, T, const N: usize> {
    rows: [&'a mut [T]; N],
    length: usize,
}

impl<'a, T: Scalar, const N: usize> Rows<'a, T, N> {
    /// The first rows of `numbers`.
    #[inline(always)]
    pub(crate) fn new(mut numbers: &'a mut [T], length: usize) -> Self {
        let mut rows: [&'a mut [T]; N] = [(); N].map(
            #[inline(always)]
            |()| Default::default(),
        );
        for row in &mut rows {
            (*row, numbers) = numbers.split_at_mut(length);
        }
        Rows { rows, length }
    }
    /// Row `r`, from place `at` on.
    #[inline(always)]
    pub(crate) fn load<W: Wide<T>>(&self, r: usize, at: usize) -> W {
        W::load(&self.rows[r][..self.length][at..at + W::COUNT])
    }
    #[inline(always)]
    pub(crate) fn store<W: Wide<T>>(&mut self, r: usize, at: usize, x: W) {
        x.store(&mut self.rows[r][..self.length][at..at + W::COUNT]);
    }
    /// Rows `r` to `r` + 2.
    #[inline(always)]
    pub(crate) fn vector<W: Wide<T>>(&self, r: usize, at: usize) -> Vec3<W> {
        Vec3([self.load(r, at), self.load(r + 1, at), self.load(r + 2, at)])
    }
    #[inline(always)]
    pub(crate) fn set_vector<W: Wide<T>>(&mut self, r: usize, at: usize, x: Vec3<W>) {
        self.store(r, at, x.0[0]);
        self.store(r + 1, at, x.0[1]);
        self.store(r + 2, at, x.0[2]);
    }
    /// Rows `r` to `r` + 5.
    #[inline(always)]
    pub(crate) fn wrench<W: Wide<T>>(&self, r: usize, at: usize) -> Wrench<W> {
        Wrench::new(self.vector(r, at), self.vector(r + 3, at))
    }
    #[inline(always)]
    pub(crate) fn set_wrench<W: Wide<T>>(&mut self, r: usize, at: usize, f: Wrench<W>) {
        self.set_vector(r, at, f.moment);
        self.set_vector(r + 3, at, f.force);
    }
}
