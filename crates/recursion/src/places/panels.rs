//! A symmetric matrix on its way from registers to the model's order.

use super::{Aligned, Places};
use phipsi_spatial::Scalar;
use phipsi_spatial::wide::{WIDEST, Wide};

/// A step for every place of a register, whose number is a constant: an array of registers then needs no memory.
macro_rules! each_place {
    ($w:ty, $i:ident => $step:expr) => {
        each_place!($w, $i => $step; 0 1 2 3 4 5 6 7)
    };
    ($w:ty, $i:ident => $step:expr; $($number:literal)*) => {$(
        if $number < <$w>::COUNT {
            const $i: usize = $number;
            $step;
        }
    )*};
}

pub(crate) use each_place;

impl Places {
    /// Writes a symmetric matrix, given above its diagonal, to the model's: where zeros have been written, entries of related degrees of
    /// freedom and some zeros beside them.
    #[inline(always)]
    pub(crate) fn write_symmetric<T: Scalar, W: Wide<T>>(&self, upper: &Panels<T>, out: &mut [T]) {
        let (nv, upper) = (self.count - self.margin, upper.read());
        if !self.in_order {
            for row in self.margin..self.count {
                let (i, end) = (self.dof[row], self.outboard[row]);
                for (at, &j) in self.dof[..end].iter().enumerate().skip(row) {
                    let x = upper.get(row, at);
                    out[i * nv + j] = x;
                    out[j * nv + i] = x;
                }
            }
            return;
        }
        let mut left = Self::group(self.margin, W::COUNT);
        while left < self.count {
            let end = self.outboard_end(left, W::COUNT);
            self.write_tile::<T, W, true>(upper.tile(left, left), left, left, out);
            let mut top = left + W::COUNT;
            while top < end {
                self.write_tile::<T, W, false>(upper.tile(left, top), left, top, out);
                top += W::COUNT;
            }
            while top < self.count && !self.clears(W::COUNT) {
                self.write_tile::<T, W, false>([W::zero(); WIDEST], left, top, out);
                top += W::COUNT;
            }
            left += W::COUNT;
        }
    }
    /// Writes a tile of a symmetric matrix to the model's, whose order is that of the places: rows from place `left` on, columns from
    /// `top` on, and the same turned over.
    #[inline(always)]
    pub(crate) fn write_tile<T: Scalar, W: Wide<T>, const DIAGONAL: bool>(
        &self,
        tile: [W; WIDEST],
        left: usize,
        top: usize,
        out: &mut [T],
    ) {
        let (nv, margin) = (self.count - self.margin, self.margin);
        // Rows of the tile that are empty.
        let hidden = margin.saturating_sub(left);
        let mut below = tile;
        W::transpose(&mut below);
        let (row, column) = (left + hidden - margin, top.max(margin) - margin);
        if DIAGONAL {
            each_place!(W, I => below[I] = below[I].up_to(I, tile[I]));
        } else {
            put_rows(tile, (hidden, 0), nv, &mut out[row * nv + column..]);
        }
        let skip = if DIAGONAL { hidden } else { 0 };
        put_rows(below, (skip, hidden), nv, &mut out[column * nv + row..]);
    }
}

/// Writes the rows of a tile from `first` on, without their first `cut` numbers, to a matrix of rows of `nv` numbers that is given from the
/// place of the first of them on.
#[inline(always)]
fn put_rows<T: Scalar, W: Wide<T>>(
    tile: [W; WIDEST],
    (first, cut): (usize, usize),
    nv: usize,
    mut out: &mut [T],
) {
    // Row by row: places by multiplication would all be kept for the next tile.
    if first == 0 && cut == 0 {
        each_place!(W, I => {
            if (1..).contains(&I) {
                out = out.get_mut(nv..).unwrap_or_default();
            }
            tile[I].store(&mut out[..W::COUNT]);
        });
        return;
    }
    each_place!(W, I => if (first..).contains(&I) {
        if (first + 1..).contains(&I) {
            out = out.get_mut(nv..).unwrap_or_default();
        }
        tile[I].store_from(cut, &mut out[..W::COUNT - cut]);
    });
}

/// A matrix by panels of [`Scalar::COLUMNS`] columns, one row after the other, so that tiles lie together.
#[derive(Clone, Debug)]
pub(crate) struct Panels<T> {
    numbers: Aligned<T>,
    rows: usize,
}

impl<T: Scalar> Panels<T> {
    /// Zeros.
    pub(crate) fn new(places: &Places) -> Self {
        Panels { numbers: Aligned::new(places.count * places.count), rows: places.count }
    }
    #[inline(always)]
    fn index(&self, row: usize, column: usize) -> usize {
        index::<T>(self.rows, row, column)
    }
    #[inline(always)]
    fn read(&self) -> PanelRows<'_, T> {
        PanelRows { numbers: &self.numbers, rows: self.rows }
    }
    /// Writes what is above the diagonal of a block that begins on it.
    #[inline(always)]
    pub(crate) fn set_block(&mut self, first: usize, block: &[[T; 6]; 6]) {
        for j in 0..6 {
            let start = self.index(first, first + j);
            let column = &mut self.numbers[start..start + 5 * T::COLUMNS + 1];
            for i in 0..=j {
                column[i * T::COLUMNS] = block[i][j];
            }
        }
    }
    /// The panel of the columns from place `column` on, each row from there on at multiples of [`Scalar::COLUMNS`].
    #[inline(always)]
    pub(crate) fn panel_mut(&mut self, column: usize) -> &mut [T] {
        let (start, end) = (self.index(0, column), self.index(self.rows, Places::group(column, T::COLUMNS)));
        &mut self.numbers[start..end]
    }
}

/// Where a number of a matrix in panels is.
#[inline(always)]
fn index<T: Scalar>(rows: usize, row: usize, column: usize) -> usize {
    (column / T::COLUMNS * rows + row) * T::COLUMNS + column % T::COLUMNS
}

/// [`Panels`] to be read, for the time of a sweep.
struct PanelRows<'a, T> {
    numbers: &'a [T],
    rows: usize,
}

impl<T: Scalar> PanelRows<'_, T> {
    #[inline(always)]
    fn get(&self, row: usize, column: usize) -> T {
        self.numbers[index::<T>(self.rows, row, column)]
    }
    /// As many rows as a register has columns.
    #[inline(always)]
    fn tile<W: Wide<T>>(&self, row: usize, column: usize) -> [W; WIDEST] {
        let start = index::<T>(self.rows, row, Places::group(column, T::COLUMNS));
        let lane = column & (T::COLUMNS - W::COUNT.min(T::COLUMNS));
        let rows = &self.numbers[start..][..W::COUNT * T::COLUMNS];
        let mut tile = [W::zero(); WIDEST];
        each_place!(W, I => tile[I] = W::load(&rows[..W::COUNT * T::COLUMNS][I * T::COLUMNS + lane..][..W::COUNT]));
        tile
    }
}
