//! M⁻¹ = L* D⁻¹ L as a matrix and products with it, of a few rows and columns at a time, that leave out what is zero for every
//! configuration.
//!
//! Entry (i, c) of L differs from zero only if i lies on the way from c to the base, entry (c, j) of a derivative of forces only
//! if one of c and j lies on the other's way. Columns are taken in panels of a few registers, rows in groups.

use super::Innovations;
use crate::places::{Aligned, Places, ROWS, each_place};
use phipsi_spatial::Scalar;
use phipsi_spatial::wide::{WIDEST, Wide};

/// Registers side by side in a panel.
const SIDE: usize = 2;

/// Ranges of places.
type Ranges = Vec<(usize, usize)>;

/// Where products have terms, and M⁻¹.
#[derive(Clone, Debug)]
pub(super) struct Products<T> {
    /// For every panel: places on the way of its columns, or outboard of them.
    related: Vec<Ranges>,
    /// For every group of rows of M⁻¹: places on their ways.
    inboard: Vec<Ranges>,
    /// M⁻¹, by places, where it is read again.
    inverse: Aligned<T>,
    /// Numbers in a row of a panel.
    width: usize,
}

/// The ranges where `near` is true.
fn ranges(count: usize, near: impl Fn(usize) -> bool) -> Ranges {
    let mut ranges = Ranges::new();
    for c in (0..count).filter(|&c| near(c)) {
        match ranges.last_mut() {
            Some(last) if last.1 == c => last.1 = c + 1,
            _ => ranges.push((c, c + 1)),
        }
    }
    ranges
}

/// Rows of M⁻¹ that are summed up at once: a tile of the widest registers.
const fn rows_of_inverse<T: Scalar>() -> usize {
    if T::COLUMNS == 1 { ROWS } else { WIDEST }
}

impl<T: Scalar> Products<T> {
    /// For M⁻¹, and for products with it if `solves`.
    pub(super) fn new(places: &Places, solves: bool) -> Self {
        let (width, count, margin) = (SIDE * T::COLUMNS, places.count, places.margin);
        // The first place of a place's joint, and one past the last place outboard.
        let mut joint: Vec<(usize, usize)> = (0..count).map(|p| (p, p)).collect();
        for k in 0..places.first.len() {
            joint[places.own(k)].fill((places.first[k], places.end[k]));
        }
        let inboard_of = |c: usize, p: usize| joint[c].0 <= p && p < joint[c].1;
        let panels = (Places::group(margin, T::COLUMNS)..count).step_by(width);
        let related = panels.take_while(|_| solves).map(|left| {
            let panel = left.max(margin)..(left + width).min(count);
            ranges(count, |c| panel.clone().any(|p| inboard_of(c, p) || inboard_of(p, c)))
        });
        let rows = rows_of_inverse::<T>();
        let inboard = (Places::group(margin, rows)..count).step_by(rows).map(|row| {
            let rows = row.max(margin)..row + rows;
            ranges(count, |c| rows.clone().any(|r| inboard_of(c, r)))
        });
        let kept = solves || !places.in_order();
        let inverse = if kept { places.zeros() } else { Aligned::new(0) };
        Products { related: related.collect(), inboard: inboard.collect(), inverse, width }
    }
}

impl<T: Scalar> Innovations<T> {
    /// M⁻¹ = L* D⁻¹ L, full and symmetric, also in the model's order.
    #[inline(always)]
    pub(crate) fn inverse_mass_matrix<W: Wide<T>>(&mut self, places: &Places, out: &mut [T]) {
        let Innovations { operator, inverse: pivots, products: Products { inboard, inverse, .. }, .. } = self;
        let ([operator, pivots], inverse): ([&[T]; 2], &mut [T]) = ([operator, pivots], inverse);
        let (s, rows) = (places.stride, rows_of_inverse::<T>());
        let mut at = Places::group(places.margin, W::COUNT);
        while at < places.count {
            let mut row = Places::group(places.margin, rows);
            for terms in inboard.iter() {
                if row >= at + W::COUNT {
                    break;
                }
                let sums = tile::<T, W>((operator, s), pivots, terms, row, at);
                for (top, tile) in
                    (row..).step_by(W::COUNT).zip(sums.chunks_exact(W::COUNT)).take(rows / W::COUNT)
                {
                    let empty = top + W::COUNT <= places.margin;
                    if top < at && !empty {
                        put_tile::<T, W, false>(places, tile, top, at, inverse, out);
                    } else if top == at {
                        put_tile::<T, W, true>(places, tile, top, at, inverse, out);
                    }
                }
                row += rows;
            }
            at += W::COUNT;
        }
        if !places.in_order() {
            places.write_all::<T, W>(inverse, out);
        }
    }
    /// −M⁻¹ B for two matrices B of the places, to the model's order, after [`Innovations::inverse_mass_matrix`].
    #[inline(always)]
    pub(crate) fn negative_solve<W: Wide<T>>(&self, places: &Places, b: [&[T]; 2], mut out: [&mut [T]; 2]) {
        // Sums of two matrices in two registers each are sixteen: only AVX-512 has names for more.
        let both = size_of::<W>() >= 64;
        let mut at = Places::group(places.margin, T::COLUMNS);
        for related in &self.products.related {
            let end = (at + self.products.width).min(places.count);
            while at < end {
                if both && at + SIDE * W::COUNT <= end {
                    self.solve_columns::<W, SIDE>(places, related, at, b, &mut out);
                    at += SIDE * W::COUNT;
                } else {
                    self.solve_columns::<W, 1>(places, related, at, b, &mut out);
                    at += W::COUNT;
                }
            }
        }
    }
    /// The same for the columns of `G` registers.
    #[inline(always)]
    fn solve_columns<W: Wide<T>, const G: usize>(
        &self,
        places: &Places,
        related: &Ranges,
        at: usize,
        b: [&[T]; 2],
        out: &mut [&mut [T]; 2],
    ) {
        let (inverse, s): (&[T], usize) = (&self.products.inverse, places.stride);
        for row in places.blocks() {
            let sums = sums::<T, W, G>((inverse, s, row), related, b, at);
            for (sums, out) in sums.into_iter().zip(out.iter_mut()) {
                for (g, sums) in sums.into_iter().enumerate() {
                    let mut negative = sums;
                    for x in &mut negative {
                        *x = -*x;
                    }
                    places.write_rows(row, at + g * W::COUNT, negative, out);
                }
            }
        }
    }
}

/// Rows of L* D⁻¹ L from `row` on, of the columns from `at` on.
#[inline(always)]
fn tile<T: Scalar, W: Wide<T>>(
    (operator, stride): (&[T], usize),
    pivots: &[T],
    terms: &Ranges,
    row: usize,
    at: usize,
) -> [W; WIDEST] {
    let rows = rows_of_inverse::<T>();
    let mut sums = [W::zero(); WIDEST];
    for &(low, high) in terms {
        let innovations = operator[low * stride..high * stride].chunks_exact(stride);
        for (l, pivot) in innovations.zip(&pivots[low..high]) {
            let x = W::load(&l[at..]) * W::broadcast(*pivot);
            let weights = &l[row..row + rows];
            for r in 0..rows {
                sums[r] = x.fma(W::broadcast(weights[r]), sums[r]);
            }
        }
    }
    sums
}

/// Puts a tile above the diagonal, or on it, where M⁻¹ has it, and the same turned over.
#[inline(always)]
fn put_tile<T: Scalar, W: Wide<T>, const DIAGONAL: bool>(
    places: &Places,
    rows: &[W],
    top: usize,
    at: usize,
    inverse: &mut [T],
    out: &mut [T],
) {
    let s = places.stride;
    let mut tile = [W::zero(); WIDEST];
    each_place!(W, I => tile[I] = rows[I]);
    let mut below = tile;
    W::transpose(&mut below);
    if !inverse.is_empty() {
        each_place!(W, I => {
            if !DIAGONAL {
                tile[I].store(&mut inverse[(top + I) * s + at..]);
            }
            let x = if DIAGONAL { below[I].up_to(I, tile[I]) } else { below[I] };
            x.store(&mut inverse[(at + I) * s + top..]);
        });
    }
    if places.in_order() {
        places.write_tile::<T, W, DIAGONAL>(tile, top, at, out);
    }
}

/// Sums of rows of two matrices, from a column on, with the weights in [`ROWS`] columns of another from `row` on.
#[inline(always)]
fn sums<T: Scalar, W: Wide<T>, const G: usize>(
    (weights, stride, row): (&[T], usize, usize),
    terms: &Ranges,
    matrices: [&[T]; 2],
    at: usize,
) -> [[[W; ROWS]; G]; 2] {
    let mut sums = [[[W::zero(); ROWS]; G]; 2];
    for &(low, high) in terms {
        let weights = weights[low * stride..high * stride].chunks_exact(stride);
        for (c, weights) in (low..high).zip(weights) {
            let weights = &weights[row..row + ROWS];
            for m in 0..2 {
                let x = &matrices[m][c * stride + at..][..G * W::COUNT];
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
