//! M⁻¹ = L* D⁻¹ L as a matrix and products with it, of a few rows and columns at a time, that leave out what is zero for every
//! configuration.
//!
//! Entry (i, c) of L differs from zero only if i lies on the way from c to the base, entry (c, j) of a derivative of forces only
//! if one of c and j lies on the other's way. Columns are taken in panels of a few registers, rows in groups.

use super::Innovations;
use crate::places::{Aligned, Pair, PairRows, PairView, Places, ROWS, Rows, each_place};
use phipsi_spatial::Scalar;
use phipsi_spatial::wide::{WIDEST, Wide};

/// Registers side by side in a panel, at most.
const SIDE: usize = 4;
/// What a term costs beside its multiplications (loads, a turn of the loop), in those of a register: an estimate. On a binary tree
/// of 63 bodies derivatives of forward dynamics took a quarter less time than with panels of three and four registers throughout.
const OVERHEAD: f64 = 0.75;
/// Rows of a product that are summed up at once, at most: with [`SIDE`] registers 24 of the 32 names that AVX-512 has, with two
/// 12 of AVX2's 16.
const MOST_ROWS: usize = 6;

/// Ranges of places.
type Ranges = Vec<(usize, usize)>;

/// Where products have terms, and M⁻¹.
#[derive(Clone, Debug)]
pub(super) struct Products<T> {
    panels: Vec<Panel>,
    /// For every group of rows of M⁻¹: places on their ways.
    inboard: Vec<Ranges>,
    /// M⁻¹, by places, and a row more, for rows that are read from a column on.
    inverse: Aligned<T>,
    /// Numbers of rows that a product sums up at once: three to six, nearly the same.
    blocks: Vec<usize>,
    /// −M⁻¹ B.
    pub(super) solution: Pair<T>,
    /// Columns at its beginning that are not of products.
    pub(super) known: usize,
}

/// Columns of two matrices that are taken together.
#[derive(Clone, Debug)]
struct Panel {
    /// The first of them, counted through both matrices.
    column: usize,
    /// Registers of [`Scalar::COLUMNS`].
    registers: usize,
    /// Places on the ways of the columns, or outboard of them.
    related: Ranges,
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

/// Registers in panels of at most [`SIDE`], given what is near each: the first register of every panel and how many it has. Wide
/// panels take each term of the product for several registers, narrow ones leave out more terms.
fn cheapest_panels(near: &[Vec<bool>]) -> Vec<(usize, usize)> {
    let terms = |own: &[Vec<bool>]| (0..own[0].len()).filter(|&c| own.iter().any(|near| near[c])).count();
    // Of the registers before each: the least cost, and the last panel.
    let mut best = vec![(0.0, 0)];
    for end in 1..=near.len() {
        let costs = (1..=SIDE.min(end)).map(|registers| {
            let first = end - registers;
            (best[first].0 + terms(&near[first..end]) as f64 * (registers as f64 + OVERHEAD), registers)
        });
        best.push(costs.fold((f64::INFINITY, 1), |best, next| if next.0 < best.0 { next } else { best }));
    }
    let (mut panels, mut end) = (Vec::new(), near.len());
    while end > 0 {
        let registers = best[end].1;
        end -= registers;
        panels.push((end, registers));
    }
    panels.reverse();
    panels
}

/// Rows of M⁻¹ that are summed up at once: a tile of the widest registers.
const fn rows_of_inverse<T: Scalar>() -> usize {
    if T::COLUMNS == 1 { ROWS } else { WIDEST }
}

impl<T: Scalar> Products<T> {
    /// For M⁻¹, for products with it if `solves`, and with room for a `solution` of those or of sweeps, whose first columns may
    /// be `known`.
    pub(super) fn new(places: &Places, solves: bool, solution: bool, known: usize) -> Self {
        let (count, margin) = (places.count, places.margin);
        // The first place of a place's joint, and one past the last place outboard.
        let mut joint: Vec<(usize, usize)> = (0..count).map(|p| (p, p)).collect();
        for k in 0..places.first.len() {
            joint[places.own(k)].fill((places.first[k], places.end[k]));
        }
        let inboard_of = |c: usize, p: usize| joint[c].0 <= p && p < joint[c].1;
        let nv = count - margin;
        let registers = if solves { (2 * nv - known).div_ceil(T::COLUMNS) } else { 0 };
        let near: Vec<Vec<bool>> = (0..registers)
            .map(|register| {
                let first = known + register * T::COLUMNS;
                let columns = first..(2 * nv).min(first + T::COLUMNS);
                let own: Vec<usize> = columns.map(|c| margin + c % nv).collect();
                (0..count).map(|c| own.iter().any(|&p| inboard_of(c, p) || inboard_of(p, c))).collect()
            })
            .collect();
        let panels = cheapest_panels(&near)
            .into_iter()
            .map(|(first, registers)| {
                let own = &near[first..first + registers];
                let related = ranges(count, |c| own.iter().any(|near| near[c]));
                Panel { column: known + first * T::COLUMNS, registers, related }
            })
            .collect();
        let rows = rows_of_inverse::<T>();
        let inboard = (Places::group(margin, rows)..count).step_by(rows).map(|row| {
            let rows = row.max(margin)..row + rows;
            ranges(count, |c| rows.clone().any(|r| inboard_of(c, r)))
        });
        let inverse = Aligned::new(places.stride * (count + 1));
        let solution = if solution { Pair::new(places) } else { Pair::empty() };
        let blocks = nv.div_ceil(MOST_ROWS);
        let blocks = (0..blocks).map(|block| nv * (block + 1) / blocks - nv * block / blocks).collect();
        Products { panels, inboard: inboard.collect(), inverse, blocks, solution, known }
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
                for part in 0..rows / W::COUNT {
                    let top = row + part * W::COUNT;
                    let mut tile = [W::zero(); WIDEST];
                    each_place!(W, I => tile[I] = sums[part * W::COUNT + I]);
                    if top == at {
                        put_tile::<T, W, true>(tile, (top, at, s), inverse);
                    } else if top < at && top + W::COUNT > places.margin {
                        put_tile::<T, W, false>(tile, (top, at, s), inverse);
                    }
                }
                row += rows;
            }
            at += W::COUNT;
        }
        places.write_all::<T, W>(inverse, out);
    }
    /// −M⁻¹ B for two matrices B, to the model's order, after [`Innovations::inverse_mass_matrix`].
    #[inline(always)]
    pub(crate) fn negative_solve<W: Wide<T>>(&mut self, places: &Places, b: &Pair<T>, out: [&mut [T]; 2]) {
        let Products { panels, inverse, blocks, solution, .. } = &mut self.products;
        let inverse = (&**inverse, places.stride);
        let (b, mut out_rows) = (b.read(), solution.view());
        // Sums of three and more registers: only AVX-512 has names for them.
        let wide = size_of::<W>() >= 64;
        for panel in panels.iter() {
            let (mut column, end) = (panel.column, panel.column + panel.registers * T::COLUMNS);
            while column < end {
                let registers = (end - column) / W::COUNT;
                let mut row = places.margin;
                for &rows in blocks.iter() {
                    let (product, out) = ((inverse, &panel.related, b), &mut out_rows);
                    match registers {
                        4 if wide => solve::<T, W, 4>(product, (row, rows), column, out),
                        3 if wide => solve::<T, W, 3>(product, (row, rows), column, out),
                        1 => solve::<T, W, 1>(product, (row, rows), column, out),
                        _ => solve::<T, W, 2>(product, (row, rows), column, out),
                    }
                    row += rows;
                }
                let taken = match registers {
                    3 | 4 if wide => registers,
                    1 => 1,
                    _ => 2,
                };
                column += taken * W::COUNT;
            }
        }
        solution.write::<W>(places, out);
    }
}

/// M⁻¹ and from one row of it to the next, the places of terms, and B.
type Product<'a, T> = ((&'a [T], usize), &'a Ranges, PairRows<'a, T>);

/// −M⁻¹ B of so many rows from one on and of the columns of `G` registers.
#[inline(always)]
fn solve<T: Scalar, W: Wide<T>, const G: usize>(
    product: Product<'_, T>,
    (row, rows): (usize, usize),
    column: usize,
    out: &mut PairView<'_, T>,
) {
    match rows {
        6 => solve_rows::<T, W, G, 6>(product, row, column, out),
        5 => solve_rows::<T, W, G, 5>(product, row, column, out),
        4 => solve_rows::<T, W, G, 4>(product, row, column, out),
        // One and two degrees of freedom have three rows, too.
        _ => solve_rows::<T, W, G, 3>(product, row, column, out),
    }
}

/// The same of `R` rows from `row` on.
#[inline(always)]
fn solve_rows<T: Scalar, W: Wide<T>, const G: usize, const R: usize>(
    ((inverse, stride), related, b): Product<'_, T>,
    row: usize,
    column: usize,
    out: &mut PairView<'_, T>,
) {
    let mut sums = [[W::zero(); G]; R];
    for &(low, high) in related {
        let mut weights = Rows::new(&inverse[low * stride + row..high * stride + row], stride);
        for b in b.all(low, high, column) {
            let Some(weights) = weights.next() else { break };
            let (b, weights) = (&b[..G * W::COUNT], &weights[..R]);
            let mut x = [W::zero(); G];
            for g in 0..G {
                x[g] = -W::load(&b[g * W::COUNT..]);
            }
            // One weight at a time: with two registers a row, AVX2 has names for all.
            for r in 0..R {
                let weight = W::broadcast(weights[r]);
                for g in 0..G {
                    sums[r][g] = x[g].fma(weight, sums[r][g]);
                }
            }
        }
    }
    // By number: iterators over arrays of registers keep them in memory.
    for r in 0..R {
        let out = out.one::<W, G>(row + r, column);
        for g in 0..G {
            sums[r][g].store(&mut out[g * W::COUNT..]);
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
        let mut innovations = Rows::new(&operator[low * stride..high * stride], stride);
        for pivot in &pivots[low..high] {
            let Some(l) = innovations.next() else { break };
            let x = W::load(&l[at..]) * W::broadcast(*pivot);
            let weights = &l[row..row + rows];
            for r in 0..rows {
                sums[r] = x.fma(W::broadcast(weights[r]), sums[r]);
            }
        }
    }
    sums
}

/// Puts a tile above the diagonal, or on it, into M⁻¹, whose rows have `s` numbers, and the same turned over.
#[inline(always)]
fn put_tile<T: Scalar, W: Wide<T>, const DIAGONAL: bool>(
    tile: [W; WIDEST],
    (top, at, s): (usize, usize, usize),
    inverse: &mut [T],
) {
    let mut below = tile;
    W::transpose(&mut below);
    if DIAGONAL {
        each_place!(W, I => below[I] = below[I].up_to(I, tile[I]));
    } else {
        W::store_rows(&tile, s, &mut inverse[top * s + at..]);
    }
    W::store_rows(&below, s, &mut inverse[at * s + top..]);
}
