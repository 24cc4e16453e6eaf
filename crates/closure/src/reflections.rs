//! Orthogonal elimination of a small matrix in place: row-sorted, column-pivoted Householder reflections.
//!
//! | symbol | meaning |
//! |---|---|
//! | a | the matrix, row after row, `width` numbers each, a whole number of [`GROUP`]s |
//! | step t | reflection of the rows from t on that leaves one number of its column; 1 − β v v*, v_t = 1 |
//! | v | the reflections, step after step, `most` numbers each, from row t on |
//! | R | what the steps leave at and above their rows; below them their columns are zero |
//!
//! Rows sorted by size and pivoted columns make the backward error small row by row, also where rows differ by many powers
//! of ten (Cox and Higham, BIT 38, 1998).

use crate::number::{larger, size};
use phipsi_spatial::Scalar;

/// Numbers of a row that are dealt with at a time, in the lanes of a register.
pub(crate) const GROUP: usize = 4;

/// A matrix that is eliminated, with the record of what was done.
pub(crate) struct Panel<'a, T> {
    pub(crate) a: &'a mut [T],
    pub(crate) width: usize,
    pub(crate) rows: usize,
    /// The row of the stack that now stands in each row.
    pub(crate) order: &'a mut [usize],
    pub(crate) v: &'a mut [T],
    pub(crate) most: usize,
    /// β of each step.
    pub(crate) beta: &'a mut [T],
    /// The column of each step.
    pub(crate) pivots: &'a mut [usize],
    /// Room for the squares of every column, and for the size of every row.
    pub(crate) squares: &'a mut [T],
    pub(crate) sizes: &'a mut [f64],
}

impl<T: Scalar> Panel<'_, T> {
    /// Sorts the rows from `first` on by their largest number in some columns, largest first.
    #[inline(always)]
    pub(crate) fn sort_rows(&mut self, first: usize, columns: core::ops::Range<usize>) {
        match self.width {
            12 => self.sort_known::<12>(first, columns),
            16 => self.sort_known::<16>(first, columns),
            _ => self.sort_known::<0>(first, columns),
        }
    }
    /// The same for rows of W numbers; of any number with W = 0.
    #[inline(always)]
    fn sort_known<const W: usize>(&mut self, first: usize, columns: core::ops::Range<usize>) {
        let Panel { a, width, rows, order, v, most, sizes, .. } = self;
        let (width, rows) = (if W == 0 { *width } else { W }, *rows);
        for row in first..rows {
            let numbers = &a[row * width..][columns.clone()];
            sizes[row] = numbers.iter().fold(0.0, |most: f64, x| most.max(x.min_lane().abs()));
        }
        for i in first..rows {
            let mut best = i;
            for row in i + 1..rows {
                if sizes[row] > sizes[best] {
                    best = row;
                }
            }
            if best != i {
                let (upper, lower) = a.split_at_mut(best * width);
                upper[i * width..][..width].swap_with_slice(&mut lower[..width]);
                order.swap(i, best);
                sizes.swap(i, best);
                for t in 0..first {
                    v.swap(t * *most + i, t * *most + best);
                }
            }
        }
    }
    /// Reflections with the steps from `first` on, in the columns `columns`, until no column of what remains is longer than
    /// `tolerance`, or `most` steps are done. Returns the number of all steps and the longest column left.
    #[inline(always)]
    pub(crate) fn eliminate(
        &mut self,
        first: usize,
        columns: core::ops::Range<usize>,
        tolerance: f64,
        most: usize,
    ) -> (usize, f64) {
        // The widths of one loop alone and beside another one, in copies whose rows are registers.
        match self.width {
            12 => self.eliminate_known::<12>(first, columns, tolerance, most),
            16 => self.eliminate_known::<16>(first, columns, tolerance, most),
            _ => self.eliminate_known::<0>(first, columns, tolerance, most),
        }
    }
    /// The same for rows of W numbers; of any number with W = 0.
    #[inline(always)]
    fn eliminate_known<const W: usize>(
        &mut self,
        first: usize,
        columns: core::ops::Range<usize>,
        tolerance: f64,
        most: usize,
    ) -> (usize, f64) {
        let width = if W == 0 { self.width } else { W };
        let mut t = first;
        self.squares.fill(T::zero());
        for row in self.a[t.min(self.rows) * width..self.rows * width].chunks_exact(width) {
            for (to, from) in
                self.squares.as_chunks_mut::<GROUP>().0.iter_mut().zip(row.as_chunks::<GROUP>().0)
            {
                *to = add_squares(*from, *to);
            }
        }
        loop {
            let mut best = (usize::MAX, T::zero());
            // Columns of earlier steps are zero here.
            for c in columns.clone() {
                if best.0 == usize::MAX || self.squares[c].min_lane() > best.1.min_lane() {
                    best = (c, self.squares[c]);
                }
            }
            // Squares may have been lost, or be too large for a number.
            let safe = best.1.min_lane() > 1e-200 && best.1.min_lane() < 1e200;
            best = if safe { (best.0, best.1.sqrt()) } else { self.longest(first, t, columns.clone()) };
            let full = t - first >= most || t >= self.rows;
            if full || best.0 == usize::MAX || best.1.min_lane() <= tolerance {
                return (t, best.1.min_lane());
            }
            let unit = if safe { T::splat(1.0) } else { best.1 };
            self.pivots[t] = best.0;
            self.beta[t] = self.reflect::<W>(t, best.0, best.1, unit);
            t += 1;
        }
    }
    /// The longest column of what remains.
    #[inline(always)]
    fn longest(&self, first: usize, t: usize, columns: core::ops::Range<usize>) -> (usize, T) {
        let mut best = (usize::MAX, T::zero());
        for c in columns.filter(|c| !self.pivots[first..t].contains(c)) {
            let norm = norm((t..self.rows).map(|row| self.a[row * self.width + c]));
            if norm.min_lane() > best.1.min_lane() {
                best = (c, norm);
            }
        }
        best
    }
    /// One reflection, of the rows from t on, that leaves in column `pivot` one number of size `length`; and the squares of what
    /// remains. Products of two numbers over `unit` are numbers.
    #[inline(always)]
    fn reflect<const W: usize>(&mut self, t: usize, pivot: usize, length: T, unit: T) -> T {
        let (width, rows) = (if W == 0 { self.width } else { W }, self.rows);
        let head = self.a[t * width + pivot];
        let left = if head.min_lane() < 0.0 { length } else { -length };
        let scale = (head - left).recip() * unit;
        let beta = (left - head) / left;
        let v = &mut self.v[t * self.most..][t + 1..rows];
        let (upper, lower) = self.a[..rows * width].split_at_mut((t + 1) * width);
        let first = &mut upper[t * width..];
        let inverse = if unit == T::splat(1.0) { unit } else { unit.recip() };
        for (v, row) in v.iter_mut().zip(lower.chunks_exact(width)) {
            *v = row[pivot] * inverse;
        }
        // v/scale until all columns are done: so that products need not wait for a root and a quotient.
        let mut step = Step { v, scale, beta, first, lower, squares: self.squares, width, pivot };
        let mut at = 0;
        while at < width {
            at = match width - at {
                12 => step.reflect::<12>(at),
                16.. => step.reflect::<16>(at),
                8.. => step.reflect::<8>(at),
                _ => step.reflect::<GROUP>(at),
            };
        }
        let Step { v, first, .. } = step;
        first[pivot] = left;
        for v in v {
            *v *= scale;
        }
        beta
    }
}

/// A reflection on its way through the columns.
struct Step<'a, T> {
    v: &'a mut [T],
    scale: T,
    beta: T,
    /// The row of the head, and the rows below it.
    first: &'a mut [T],
    lower: &'a mut [T],
    squares: &'a mut [T],
    width: usize,
    pivot: usize,
}

impl<T: Scalar> Step<'_, T> {
    /// `C` columns from `at` on. Returns the column after them.
    #[inline(always)]
    fn reflect<const C: usize>(&mut self, at: usize) -> usize {
        let mut dot = [T::zero(); C];
        for (v, row) in self.v.iter().zip(self.lower.chunks_exact(self.width)) {
            dot = scale_add(*v, columns(row, at), dot);
        }
        let first: [T; C] = columns(self.first, at);
        let sums = multiply(scale_add(self.scale, dot, first), [self.beta; C]);
        let change = multiply(sums, [-self.scale; C]);
        self.first[at..at + C].copy_from_slice(&scale_add(-T::splat(1.0), sums, first));
        // Zero below the head, whatever rounding leaves there.
        let mut keep = [T::splat(1.0); C];
        for (i, keep) in keep.iter_mut().enumerate() {
            *keep = T::splat(f64::from(at + i != self.pivot));
        }
        let mut squares = [T::zero(); C];
        for (v, row) in self.v.iter().zip(self.lower.chunks_exact_mut(self.width)) {
            let left = multiply(scale_add(*v, change, columns(row, at)), keep);
            row[at..at + C].copy_from_slice(&left);
            squares = add_squares(left, squares);
        }
        self.squares[at..at + C].copy_from_slice(&squares);
        at + C
    }
}

/// `C` numbers of a row.
#[inline(always)]
fn columns<T: Scalar, const C: usize>(row: &[T], at: usize) -> [T; C] {
    let mut numbers = [T::zero(); C];
    numbers.copy_from_slice(&row[at..at + C]);
    numbers
}

/// `factor` · x + y.
#[inline(always)]
fn scale_add<T: Scalar, const C: usize>(factor: T, x: [T; C], mut y: [T; C]) -> [T; C] {
    for (x, y) in x.into_iter().zip(&mut y) {
        *y = factor.fma(x, *y);
    }
    y
}

/// Products, number by number.
#[inline(always)]
fn multiply<T: Scalar, const C: usize>(mut x: [T; C], y: [T; C]) -> [T; C] {
    for (x, y) in x.iter_mut().zip(y) {
        *x *= y;
    }
    x
}

/// `sums` + the squares of numbers.
#[inline(always)]
fn add_squares<T: Scalar, const C: usize>(x: [T; C], mut sums: [T; C]) -> [T; C] {
    for (x, sum) in x.into_iter().zip(&mut sums) {
        *sum = x.fma(x, *sum);
    }
    sums
}

/// `to` += `factor` · `from`; both are whole numbers of groups, each read before it is written, so that it is one in registers.
#[inline(always)]
pub(crate) fn add_scaled<T: Scalar>(to: &mut [T], factor: T, from: &[T]) {
    for (to, from) in to.as_chunks_mut::<GROUP>().0.iter_mut().zip(from.as_chunks::<GROUP>().0) {
        *to = scale_add::<T, GROUP>(factor, *from, *to);
    }
}

/// The record of an elimination, to apply it to vectors.
pub(crate) struct Record<'a, T> {
    pub(crate) v: &'a [T],
    pub(crate) most: usize,
    pub(crate) rows: usize,
    pub(crate) steps: usize,
    pub(crate) order: &'a [usize],
    pub(crate) beta: &'a [T],
}

impl<T: Scalar> Record<'_, T> {
    #[inline(always)]
    fn reflect(&self, t: usize, x: &mut [T]) {
        let v = &self.v[t * self.most..][t + 1..self.rows];
        let (head, rest) = x[t..self.rows].split_at_mut(1);
        let mut sum = head[0];
        for (v, x) in v.iter().zip(rest.iter()) {
            sum = v.fma(*x, sum);
        }
        let sum = sum * self.beta[t];
        head[0] -= sum;
        for (v, x) in v.iter().zip(rest) {
            *x = (-sum).fma(*v, *x);
        }
    }
    /// Q* of a stack: `stack` holds it as it was stacked, `x` gets the result.
    #[inline(always)]
    pub(crate) fn apply_transposed(&self, stack: &[T], x: &mut [T]) {
        for row in 0..self.rows {
            x[row] = stack[self.order[row]];
        }
        for t in 0..self.steps {
            self.reflect(t, x);
        }
    }
    /// Q of a vector: `x` is used up, `stack` gets the result in the order of the stack.
    #[inline(always)]
    pub(crate) fn apply(&self, x: &mut [T], stack: &mut [T]) {
        for t in (0..self.steps).rev() {
            self.reflect(t, x);
        }
        for row in 0..self.rows {
            stack[self.order[row]] = x[row];
        }
    }
}

/// |x|, without overflow or underflow of the squares.
#[inline(always)]
fn norm<T: Scalar>(x: impl Iterator<Item = T> + Clone) -> T {
    let mut most = T::zero();
    for x in x.clone() {
        most = larger(most, size(x));
    }
    if most == T::zero() || !most.is_positive() {
        return most;
    }
    let scale = most.recip();
    let mut sum = T::zero();
    for x in x {
        let y = x * scale;
        sum = y.fma(y, sum);
    }
    most * sum.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::Random;

    /// Q R is the matrix, for matrices with rows of very different sizes; Q Q* x is x.
    #[test]
    fn reflections_reproduce_the_matrix_row_by_row() {
        for seed in 0..50 {
            let mut random = Random::new(seed);
            let (rows, columns) = (1 + random.below(9), 1 + random.below(18));
            let width = columns.next_multiple_of(GROUP);
            let most = rows + random.below(3);
            let sizes: Vec<f64> = (0..rows).map(|_| 10f64.powf(6.0 * random.signed())).collect();
            let mut a = vec![0.0f64; most * width];
            for i in 0..rows {
                for c in 0..columns {
                    a[i * width + c] = sizes[i] * random.signed();
                }
            }
            let original = a.clone();
            let mut order: Vec<usize> = (0..rows).collect();
            let (mut beta, mut pivots) = (vec![0.0; columns], vec![0; columns]);
            let (mut v, mut squares, mut room) =
                (vec![0.0; columns * most], vec![0.0; width], vec![0.0; most]);
            let mut panel = Panel {
                a: &mut a,
                width,
                rows,
                order: &mut order,
                v: &mut v,
                most,
                beta: &mut beta,
                pivots: &mut pivots,
                squares: &mut squares,
                sizes: &mut room,
            };
            panel.sort_rows(0, 0..columns);
            let (steps, _) = panel.eliminate(0, 0..columns, 0.0, columns);
            assert_eq!(steps, rows.min(columns), "seed {seed}");
            let record = Record { v: &v, most, rows, steps, order: &order, beta: &beta };
            for c in 0..columns {
                let mut x: Vec<f64> = (0..rows).map(|i| a[i * width + c]).collect();
                let mut stack = vec![0.0; rows];
                record.apply(&mut x, &mut stack);
                for i in 0..rows {
                    let error = (stack[i] - original[i * width + c]).abs();
                    // A few roundings per step, of which there are at most nine, in units of the row's own size.
                    assert!(error <= 64.0 * f64::EPSILON * sizes[i], "seed {seed}: {error:e}");
                }
            }
            let x: Vec<f64> = (0..rows).map(|_| random.signed()).collect();
            let (mut y, mut back) = (vec![0.0; rows], vec![0.0; rows]);
            record.apply_transposed(&x, &mut y);
            record.apply(&mut y, &mut back);
            for i in 0..rows {
                assert!((x[i] - back[i]).abs() < 64.0 * f64::EPSILON);
            }
        }
    }
}
