//! Orthogonal elimination of a small matrix in place: row-sorted, column-pivoted Householder reflections.
//!
//! | symbol | meaning |
//! |---|---|
//! | a | the matrix, column after column, with `lead` numbers from one column to the next |
//! | step t | reflection of the rows from t on that leaves one number of its column; 1 − β v v*, v_t = 1 |
//! | R | what the steps leave at and above their rows; below them the reflections are kept |
//!
//! Rows sorted by size and pivoted columns make the backward error small row by row, also where rows differ by many powers
//! of ten (Cox and Higham, BIT 38, 1998).

use crate::number::{larger, size};
use phipsi_spatial::Scalar;

/// A matrix that is eliminated, with the record of what was done.
pub(crate) struct Panel<'a, T> {
    pub(crate) a: &'a mut [T],
    pub(crate) lead: usize,
    pub(crate) rows: usize,
    /// Number of columns that the reflections act on.
    pub(crate) columns: usize,
    /// The row of the stack that now stands in each row.
    pub(crate) order: &'a mut [usize],
    /// β of each step.
    pub(crate) beta: &'a mut [T],
    /// The column of each step.
    pub(crate) pivots: &'a mut [usize],
}

impl<T: Scalar> Panel<'_, T> {
    /// The largest number of a row in some columns.
    #[inline(always)]
    fn row_size(&self, row: usize, columns: core::ops::Range<usize>) -> T {
        let mut most = T::zero();
        for c in columns {
            most = larger(most, size(self.a[c * self.lead + row]));
        }
        most
    }
    /// Sorts the rows from `first` on by their largest number in some columns, largest first.
    #[inline(always)]
    pub(crate) fn sort_rows(&mut self, first: usize, columns: core::ops::Range<usize>) {
        for i in first..self.rows {
            let mut best = (i, self.row_size(i, columns.clone()));
            for row in i + 1..self.rows {
                let found = self.row_size(row, columns.clone());
                if found.min_lane() > best.1.min_lane() {
                    best = (row, found);
                }
            }
            if best.0 != i {
                for c in 0..self.columns {
                    self.a.swap(c * self.lead + i, c * self.lead + best.0);
                }
                self.order.swap(i, best.0);
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
        let mut t = first;
        loop {
            let mut best = (usize::MAX, T::zero());
            for c in columns.clone() {
                if self.pivots[first..t].contains(&c) {
                    continue;
                }
                let square = square(&self.a[c * self.lead + t..c * self.lead + self.rows]);
                if best.0 == usize::MAX || square.min_lane() > best.1.min_lane() {
                    best = (c, square);
                }
            }
            // Squares may have been lost, or be too large for a number.
            let safe = best.1.min_lane() > 1e-200 && best.1.min_lane() < 1e200;
            best = if safe { (best.0, best.1.sqrt()) } else { self.longest(first, t, columns.clone()) };
            let full = t - first >= most || t >= self.rows;
            if full || best.0 == usize::MAX || best.1.min_lane() <= tolerance {
                return (t, best.1.min_lane());
            }
            self.pivots[t] = best.0;
            self.beta[t] = self.reflect(t, best.0, best.1);
            t += 1;
        }
    }
    /// The longest column of what remains.
    #[inline(always)]
    fn longest(&self, first: usize, t: usize, columns: core::ops::Range<usize>) -> (usize, T) {
        let mut best = (usize::MAX, T::zero());
        for c in columns.filter(|c| !self.pivots[first..t].contains(c)) {
            let norm = norm(&self.a[c * self.lead + t..c * self.lead + self.rows]);
            if norm.min_lane() > best.1.min_lane() {
                best = (c, norm);
            }
        }
        best
    }
    /// One reflection, of the rows from t on, that leaves in column `pivot` one number of size `length`.
    #[inline(always)]
    fn reflect(&mut self, t: usize, pivot: usize, length: T) -> T {
        let (start, end) = (pivot * self.lead + t, pivot * self.lead + self.rows);
        let head = self.a[start];
        let left = if head.min_lane() < 0.0 { length } else { -length };
        let scale = (head - left).recip();
        for x in &mut self.a[start + 1..end] {
            *x *= scale;
        }
        self.a[start] = left;
        let beta = (left - head) / left;
        for c in 0..self.columns {
            if c == pivot || self.pivots[..t].contains(&c) {
                continue;
            }
            let at = c * self.lead + t;
            let mut sum = self.a[at];
            for i in 1..end - start {
                sum = self.a[start + i].fma(self.a[at + i], sum);
            }
            let sum = sum * beta;
            self.a[at] -= sum;
            for i in 1..end - start {
                self.a[at + i] = (-sum).fma(self.a[start + i], self.a[at + i]);
            }
        }
        beta
    }
}

/// The record of an elimination, to apply it to vectors.
pub(crate) struct Record<'a, T> {
    pub(crate) a: &'a [T],
    pub(crate) lead: usize,
    pub(crate) rows: usize,
    pub(crate) steps: usize,
    pub(crate) order: &'a [usize],
    pub(crate) beta: &'a [T],
    pub(crate) pivots: &'a [usize],
}

impl<T: Scalar> Record<'_, T> {
    #[inline(always)]
    fn reflect(&self, t: usize, x: &mut [T]) {
        let v = &self.a[self.pivots[t] * self.lead..][t..self.rows];
        let mut sum = x[t];
        for i in 1..v.len() {
            sum = v[i].fma(x[t + i], sum);
        }
        let sum = sum * self.beta[t];
        x[t] -= sum;
        for i in 1..v.len() {
            x[t + i] = (-sum).fma(v[i], x[t + i]);
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

/// x*x.
#[inline(always)]
fn square<T: Scalar>(x: &[T]) -> T {
    let mut sum = T::zero();
    for x in x {
        sum = x.fma(*x, sum);
    }
    sum
}

/// |x|, without overflow or underflow of the squares.
#[inline(always)]
fn norm<T: Scalar>(x: &[T]) -> T {
    let mut most = T::zero();
    for x in x {
        most = larger(most, size(*x));
    }
    if most == T::zero() || !most.is_positive() {
        return most;
    }
    let scale = most.recip();
    let mut sum = T::zero();
    for x in x {
        let y = *x * scale;
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
            let (rows, columns) = (1 + random.below(9), 1 + random.below(6));
            let lead = rows + random.below(3);
            let sizes: Vec<f64> = (0..rows).map(|_| 10f64.powf(6.0 * random.signed())).collect();
            let mut a = vec![0.0f64; lead * columns];
            for c in 0..columns {
                for i in 0..rows {
                    a[c * lead + i] = sizes[i] * random.signed();
                }
            }
            let original = a.clone();
            let mut order: Vec<usize> = (0..rows).collect();
            let (mut beta, mut pivots) = (vec![0.0; columns], vec![0; columns]);
            let mut panel = Panel {
                a: &mut a,
                lead,
                rows,
                columns,
                order: &mut order,
                beta: &mut beta,
                pivots: &mut pivots,
            };
            panel.sort_rows(0, 0..columns);
            let (steps, _) = panel.eliminate(0, 0..columns, 0.0, columns);
            assert_eq!(steps, rows.min(columns), "seed {seed}");
            let record = Record { a: &a, lead, rows, steps, order: &order, beta: &beta, pivots: &pivots };
            for c in 0..columns {
                let at = pivots[..steps].iter().position(|&p| p == c);
                let mut x: Vec<f64> = (0..rows)
                    .map(|i| if at.is_none_or(|t| i <= t) { a[c * lead + i] } else { 0.0 })
                    .collect();
                let mut stack = vec![0.0; rows];
                record.apply(&mut x, &mut stack);
                for i in 0..rows {
                    let error = (stack[i] - original[c * lead + i]).abs();
                    // A few roundings per step, in units of the row's own size.
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
