//! M⁻¹ = L* D⁻¹ L as a matrix and products with it, of a few rows and columns at a time, that leave out what is zero for every
//! configuration.
//!
//! Entry (i, c) of L differs from zero only if i lies on the way from c to the base, entry (c, j) of a derivative of forces only
//! if one of c and j lies on the other's way. Columns are taken in panels of a few registers, rows in groups.

use super::Innovations;
use crate::places::{Places, ROWS, mirror};
use phipsi_spatial::Scalar;
use phipsi_spatial::wide::Wide;

/// Registers side by side in a panel.
const SIDE: usize = 2;

/// Ranges of places.
type Ranges = Vec<(usize, usize)>;

/// Where products have terms, and M⁻¹.
#[derive(Clone, Debug)]
pub(super) struct Products<T> {
    /// For every panel: places on the way of its columns, or outboard of them.
    related: Vec<Ranges>,
    /// For every group of rows: places on their ways.
    inboard: Vec<Ranges>,
    /// M⁻¹, by places.
    inverse: Vec<T>,
    /// D⁻¹ L of a panel.
    panel: Vec<T>,
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

impl<T: Scalar> Products<T> {
    pub(super) fn new(places: &Places) -> Self {
        let (width, count, margin) = (SIDE * T::COLUMNS, places.count, places.margin);
        // The first place of a place's joint, and one past the last place outboard.
        let mut joint: Vec<(usize, usize)> = (0..count).map(|p| (p, p)).collect();
        for k in 0..places.first.len() {
            joint[places.own(k)].fill((places.first[k], places.end[k]));
        }
        let inboard_of = |c: usize, p: usize| joint[c].0 <= p && p < joint[c].1;
        let panels = (Places::group(margin, T::COLUMNS)..count).step_by(width);
        let related = panels.map(|left| {
            let panel = left.max(margin)..(left + width).min(count);
            ranges(count, |c| panel.clone().any(|p| inboard_of(c, p) || inboard_of(p, c)))
        });
        let inboard = places
            .blocks()
            .map(|row| ranges(count, |c| (row.max(margin)..row + ROWS).any(|r| inboard_of(c, r))));
        Products {
            related: related.collect(),
            inboard: inboard.collect(),
            inverse: places.zeros(),
            panel: vec![T::zero(); count * width],
            width,
        }
    }
}

/// Calls a step for the columns of every panel: two registers at once where `$both`, else one.
macro_rules! each_panel {
    ($t:ty, $w:ty, $places:expr, $width:expr, $both:expr, |$panel:ident, $at:ident, $inner:ident, $G:ident| $step:expr) => {
        let mut $at = Places::group($places.margin, <$t>::COLUMNS);
        let mut $panel = 0;
        while $at < $places.count {
            let end = ($at + $width).min($places.count);
            let left = $at;
            while $at < end {
                let $inner = $at - left;
                if $both && $at + SIDE * <$w as Wide<$t>>::COUNT <= end {
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
    /// M⁻¹ = L* D⁻¹ L, full and symmetric, also in the model's order.
    #[inline(always)]
    pub(crate) fn inverse_mass_matrix<W: Wide<T>>(&mut self, places: &Places, out: &mut [T]) {
        let Innovations { operator, inverse: pivots, products, .. } = self;
        let Products { inboard, inverse, panel, width, .. } = products;
        let (width, s) = (*width, places.stride);
        each_panel!(T, W, places, width, true, |_index, at, inner, G| {
            let end = at + G * W::COUNT;
            let rows = operator.chunks_exact(s).zip(&*pivots);
            for ((l, pivot), y) in rows.zip(panel.chunks_exact_mut(width)) {
                for g in 0..G {
                    let x = W::load(&l[at..end][g * W::COUNT..]) * W::broadcast(*pivot);
                    x.store(&mut y[inner + g * W::COUNT..]);
                }
            }
            for (row, terms) in places.blocks().zip(&*inboard).take_while(|(row, _)| *row < end) {
                let sums = sums::<T, W, 1, G>((operator, s, row), terms, ([&panel[..]], width, inner));
                for r in 0..ROWS {
                    for g in 0..G {
                        sums[0][g][r].store(&mut inverse[(row + r) * s + at + g * W::COUNT..]);
                    }
                }
            }
        });
        mirror::<T, W>(inverse, places.count, s);
        places.write_all::<T, W>(inverse, out);
    }
    /// −M⁻¹ B for two matrices B of the places, to the model's order, after [`Innovations::inverse_mass_matrix`].
    #[inline(always)]
    pub(crate) fn negative_solve<W: Wide<T>>(&self, places: &Places, b: [&[T]; 2], out: [&mut [T]; 2]) {
        let (Products { related, inverse, width, .. }, s) = (&self.products, places.stride);
        // Sums of two matrices in two registers each are sixteen: only AVX-512 has names for more.
        let both = size_of::<W>() >= 64;
        each_panel!(T, W, places, *width, both, |panel, at, _inner, G| {
            for row in places.blocks() {
                let sums = sums::<T, W, 2, G>((inverse, s, row), &related[panel], (b, s, at));
                for r in 0..ROWS {
                    for g in 0..G {
                        places.write(row + r, at + g * W::COUNT, -sums[0][g][r], out[0]);
                        places.write(row + r, at + g * W::COUNT, -sums[1][g][r], out[1]);
                    }
                }
            }
        });
    }
}

/// Sums of rows of M matrices, from a column on, with the weights in [`ROWS`] columns of another from `row` on.
#[inline(always)]
fn sums<T: Scalar, W: Wide<T>, const M: usize, const G: usize>(
    (weights, stride, row): (&[T], usize, usize),
    terms: &[(usize, usize)],
    (matrices, length, at): ([&[T]; M], usize, usize),
) -> [[[W; ROWS]; G]; M] {
    let mut sums = [[[W::zero(); ROWS]; G]; M];
    for &(low, high) in terms {
        let weights = weights[low * stride..high * stride].chunks_exact(stride);
        for (c, weights) in (low..high).zip(weights) {
            let weights = &weights[row..row + ROWS];
            for m in 0..M {
                let x = &matrices[m][c * length + at..][..G * W::COUNT];
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
