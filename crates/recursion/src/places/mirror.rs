//! The lower triangle of a symmetric matrix from its upper one, tile by tile.

use super::Places;
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
    /// Copies what is above the diagonal of a matrix to below, where degrees of freedom are related. Its first row and column are those of
    /// place `first`, not after the first one that is used; its rows are `stride` apart.
    #[inline(always)]
    pub(crate) fn mirror<T: Scalar, W: Wide<T>>(&self, first: usize, stride: usize, out: &mut [T]) {
        let mut left = Self::group(self.margin, W::COUNT);
        if left < first {
            self.mirror_first_rows::<T, W>(first - left, first, stride, out);
            left += W::COUNT;
        }
        while left < self.count {
            let (end, row) = (self.outboard_end(left, W::COUNT), left - first);
            let diagonal = row * stride + row;
            let tile = W::load_rows(stride, &out[diagonal..]);
            let mut below = tile;
            W::transpose(&mut below);
            each_place!(W, I => below[I] = below[I].up_to(I, tile[I]));
            W::store_rows(&below, stride, &mut out[diagonal..]);
            self.mirror_tiles::<T, W>((row, left + W::COUNT - first), end.saturating_sub(first), stride, out);
            left += W::COUNT;
        }
    }
    /// Tiles right of a diagonal one: rows from `row` on, columns from `column` on and before `end`.
    #[inline(always)]
    fn mirror_tiles<T: Scalar, W: Wide<T>>(
        &self,
        (row, mut column): (usize, usize),
        end: usize,
        stride: usize,
        out: &mut [T],
    ) {
        let (mut above, mut below) = (row * stride + column, column * stride + row);
        while column < end {
            // Hidden from the compiler, which would keep the place of every row for the next tile.
            let stride = core::hint::black_box(stride);
            let mut tile = W::load_rows(stride, &out[above..]);
            W::transpose(&mut tile);
            W::store_rows(&tile, stride, &mut out[below..]);
            (above, below, column) = (above + W::COUNT, below + W::COUNT * stride, column + W::COUNT);
        }
    }
    /// Rows of the first register, without its first `hidden` places, which are before the matrix.
    #[inline(always)]
    fn mirror_first_rows<T: Scalar, W: Wide<T>>(
        &self,
        hidden: usize,
        first: usize,
        stride: usize,
        out: &mut [T],
    ) {
        let (rows, end) = (W::COUNT - hidden, self.outboard_end(first - hidden, W::COUNT) - first);
        let mut tile = [W::zero(); WIDEST];
        each_place!(W, I => if I < rows {
            tile[I] = W::load_first(&out[I * stride..][..rows]);
        });
        let mut below = tile;
        W::transpose(&mut below);
        each_place!(W, I => if I < rows {
            below[I].up_to(I, tile[I]).store_first(&mut out[I * stride..][..rows]);
        });
        if rows >= end {
            return;
        }
        // The next rows overwrite what whole tiles have from them, but for the tile above their own diagonal.
        let mut tile = [W::zero(); WIDEST];
        each_place!(W, I => if I < rows {
            tile[I] = W::load(&out[I * stride + rows..]);
        });
        W::transpose(&mut tile);
        each_place!(W, I => tile[I].store_first(&mut out[(rows + I) * stride..][..rows]));
        self.mirror_tiles::<T, W>((0, rows + W::COUNT), end, stride, out);
    }
}
