//! Products with L and L*, of a few rows and columns at a time, that leave out what is zero for every configuration.
//!
//! Entry (i, c) of L differs from zero only if i lies on the way from c to the base; entry (c, j) of a derivative of forces only
//! if one of c and j lies on the other's way. So an entry (i, j) of a product has terms only for those c that are on the way of
//! j, or outboard of it. Columns are taken in panels, which stay in the cache nearest to the processor while all rows pass.

use super::Innovations;
use crate::places::{Places, ROWS};
use core::ops::Range;
use phipsi_spatial::Scalar;
use phipsi_spatial::wide::Wide;

/// Registers side by side in a panel.
const SIDE: usize = 2;

/// For every group of rows and panel, the ranges of c.
#[derive(Clone, Debug)]
struct Terms {
    first: Vec<usize>,
    ranges: Vec<(usize, usize)>,
    panels: usize,
}

impl Terms {
    /// From what rows and what panels have in common.
    fn common(rows: &[Vec<bool>], panels: &[Vec<bool>]) -> Self {
        let (mut first, mut ranges) = (vec![0], Vec::new());
        for row in rows {
            for panel in panels {
                let mut open = false;
                for (c, both) in row.iter().zip(panel).map(|(a, b)| *a && *b).enumerate() {
                    match (open, both) {
                        (false, true) => ranges.push((c, c + 1)),
                        (true, true) => ranges.last_mut().into_iter().for_each(|r| r.1 = c + 1),
                        _ => {}
                    }
                    open = both;
                }
                first.push(ranges.len());
            }
        }
        Terms { first, ranges, panels: panels.len() }
    }
    #[inline(always)]
    fn of(&self, block: usize, panel: usize) -> &[(usize, usize)] {
        let i = block * self.panels + panel;
        &self.ranges[self.first[i]..self.first[i + 1]]
    }
}

/// Where products have terms, and room for a panel.
#[derive(Clone, Debug)]
pub(super) struct Products<T> {
    outboard: Terms,
    inboard: Terms,
    /// −D⁻¹ L B of a panel, for two matrices B.
    panel: [Vec<T>; 2],
    /// Numbers in a row of a panel.
    width: usize,
}

impl<T: Scalar> Products<T> {
    pub(super) fn new(places: &Places) -> Self {
        let width = SIDE * T::COLUMNS;
        let count = places.count;
        // One past the last place outboard of a place's joint, and the joint's first place.
        let mut joint: Vec<(usize, usize)> = (0..count).map(|p| (p, p)).collect();
        for k in 0..places.first.len() {
            joint[places.own(k)].fill((places.first[k], places.end[k]));
        }
        let inboard_of = |c: usize, p: usize| joint[c].0 <= p && p < joint[c].1;
        let mut related = Vec::new();
        for left in (Places::group(places.margin, T::COLUMNS)..count).step_by(width) {
            let panel = left.max(places.margin)..(left + width).min(count);
            let near = |c| panel.clone().any(|p| inboard_of(c, p) || inboard_of(p, c));
            related.push((0..count).map(|c| c >= places.margin && near(c)).collect());
        }
        let rows = |near: &dyn Fn(usize, usize) -> bool| -> Vec<Vec<bool>> {
            let rows = |row: usize| row.max(places.margin)..row + ROWS;
            places.blocks().map(|row| (0..count).map(|c| rows(row).any(|r| near(r, c))).collect()).collect()
        };
        Products {
            outboard: Terms::common(&rows(&|r, c| inboard_of(r, c)), &related),
            inboard: Terms::common(&rows(&|r, c| inboard_of(c, r)), &related),
            panel: [vec![T::zero(); count * width], vec![T::zero(); count * width]],
            width,
        }
    }
}

/// Calls a step for the columns of every panel: as many registers at once as there are side by side.
macro_rules! each_panel {
    ($t:ty, $w:ty, $places:expr, $width:expr, |$panel:ident, $at:ident, $inner:ident, $G:ident| $step:expr) => {
        let mut $at = Places::group($places.margin, <$t>::COLUMNS);
        let mut $panel = 0;
        while $at < $places.count {
            let end = ($at + $width).min($places.count);
            let left = $at;
            while $at < end {
                let $inner = $at - left;
                if $at + SIDE * <$w as Wide<$t>>::COUNT <= end {
                    const $G: usize = SIDE;
                    $step;
                    $at += SIDE * <$w as Wide<$t>>::COUNT;
                } else {
                    const $G: usize = 1;
                    $step;
                    $at += <$w as Wide<$t>>::COUNT;
                }
            }
            $panel += 1;
        }
    };
}

impl<T: Scalar> Innovations<T> {
    /// −M⁻¹ B for two matrices B of the places, to the model's order.
    #[inline(always)]
    pub(crate) fn negative_solve<W: Wide<T>>(&mut self, places: &Places, b: [&[T]; 2], out: [&mut [T]; 2]) {
        let Innovations { operator, inverse, products, .. } = self;
        let width = products.width;
        each_panel!(T, W, places, width, |panel, at, inner, G| {
            for (block, row) in places.blocks().enumerate() {
                let terms = products.outboard.of(block, panel);
                let sums = along_rows::<T, W, G>(operator, places.stride, row, terms, b, at);
                for r in 0..ROWS {
                    let scale = -W::broadcast(inverse[row + r]);
                    for g in 0..G {
                        let place = (row + r) * width + inner + g * W::COUNT;
                        (sums[0][g][r] * scale).store(&mut products.panel[0][place..]);
                        (sums[1][g][r] * scale).store(&mut products.panel[1][place..]);
                    }
                }
            }
            let moved = [&products.panel[0][..], &products.panel[1][..]];
            for (block, row) in places.blocks().enumerate() {
                let terms = products.inboard.of(block, panel);
                let sums =
                    along_columns::<T, W, 2, G>(operator, places.stride, row, terms, moved, width, inner);
                for r in 0..ROWS {
                    for g in 0..G {
                        places.write(row + r, at + g * W::COUNT, sums[0][g][r], out[0]);
                        places.write(row + r, at + g * W::COUNT, sums[1][g][r], out[1]);
                    }
                }
            }
        });
    }
    /// M⁻¹ = L* D⁻¹ L, full and symmetric, in the model's order.
    #[inline(always)]
    pub(crate) fn inverse_mass_matrix<W: Wide<T>>(&mut self, places: &Places, out: &mut [T]) {
        let Innovations { operator, inverse, products, .. } = self;
        let width = products.width;
        each_panel!(T, W, places, width, |panel, at, inner, G| {
            let end = at + G * W::COUNT;
            let rows = operator.chunks_exact(places.stride).zip(&*inverse);
            for ((l, inverse), y) in rows.zip(products.panel[0].chunks_exact_mut(width)) {
                for g in 0..G {
                    let x = W::load(&l[at..end][g * W::COUNT..]) * W::broadcast(*inverse);
                    x.store(&mut y[inner + g * W::COUNT..]);
                }
            }
            for (block, row) in places.blocks().enumerate() {
                if row >= end {
                    break;
                }
                let (terms, moved) = (products.inboard.of(block, panel), [&products.panel[0][..]]);
                let sums =
                    along_columns::<T, W, 1, G>(operator, places.stride, row, terms, moved, width, inner);
                for r in 0..ROWS {
                    for g in 0..G {
                        places.write(row + r, at + g * W::COUNT, sums[0][g][r], out);
                    }
                }
            }
        });
        places.mirror::<T, W>(out);
    }
}

/// Sums of rows of two matrices, with the weights in [`ROWS`] rows of `operator` from `row` on.
#[inline(always)]
fn along_rows<T: Scalar, W: Wide<T>, const G: usize>(
    operator: &[T],
    stride: usize,
    row: usize,
    terms: &[(usize, usize)],
    matrices: [&[T]; 2],
    at: usize,
) -> [[[W; ROWS]; G]; 2] {
    let mut sums = [[[W::zero(); ROWS]; G]; 2];
    for &(low, high) in terms {
        let weights = rows(operator, stride, row, low..high);
        let range = low * stride..high * stride;
        let pairs =
            matrices[0][range.clone()].chunks_exact(stride).zip(matrices[1][range].chunks_exact(stride));
        for (c, (x, y)) in pairs.enumerate().take(high - low) {
            let (x, y) = (&x[at..at + G * W::COUNT], &y[at..at + G * W::COUNT]);
            for g in 0..G {
                let (x, y) = (W::load(&x[g * W::COUNT..]), W::load(&y[g * W::COUNT..]));
                for r in 0..ROWS {
                    let weight = W::broadcast(weights[r][c]);
                    sums[0][g][r] = x.fma(weight, sums[0][g][r]);
                    sums[1][g][r] = y.fma(weight, sums[1][g][r]);
                }
            }
        }
    }
    sums
}

/// A part of [`ROWS`] rows, of one length that the compiler knows to be the same.
#[inline(always)]
fn rows<T>(matrix: &[T], stride: usize, first: usize, part: Range<usize>) -> [&[T]; ROWS] {
    let (matrix, count) = (&matrix[first * stride..(first + ROWS) * stride], part.len());
    let (a, matrix) = matrix.split_at(stride);
    let (b, matrix) = matrix.split_at(stride);
    let (c, d) = matrix.split_at(stride);
    let (start, end) = (part.start, part.end);
    [&a[start..end][..count], &b[start..end][..count], &c[start..end][..count], &d[start..end][..count]]
}

/// Sums of rows of M panels, with the weights in [`ROWS`] columns of `operator` from `row` on.
#[inline(always)]
fn along_columns<T: Scalar, W: Wide<T>, const M: usize, const G: usize>(
    operator: &[T],
    stride: usize,
    row: usize,
    terms: &[(usize, usize)],
    panels: [&[T]; M],
    width: usize,
    inner: usize,
) -> [[[W; ROWS]; G]; M] {
    let mut sums = [[[W::zero(); ROWS]; G]; M];
    for &(low, high) in terms {
        let weights = operator[low * stride..high * stride].chunks_exact(stride);
        for (c, weights) in (low..high).zip(weights) {
            let weights = &weights[row..row + ROWS];
            for m in 0..M {
                let x = &panels[m][c * width + inner..][..G * W::COUNT];
                for g in 0..G {
                    let x = W::load(&x[g * W::COUNT..]);
                    for r in 0..ROWS {
                        sums[m][g][r] = x.fma(W::broadcast(weights[r]), sums[m][g][r]);
                    }
                }
            }
        }
    }
    sums
}
