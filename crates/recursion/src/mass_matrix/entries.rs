//! Where entries of the mass matrix go.

use crate::places::Places;
use phipsi_spatial::Scalar;
use phipsi_spatial::wide::{WIDEST, Wide};

/// Takes entries of M.
pub(super) trait Entries<T: Scalar, W: Wide<T>> {
    /// Those of the row of a place, of the columns of a register from place `at` on. What is not above the diagonal has no meaning.
    fn put(&mut self, row: usize, at: usize, x: W);
    /// The row of a place, from the column of place `at` on, if its entries are to be put side by side.
    fn side_by_side(&mut self, row: usize, at: usize) -> Option<&mut [T]>;
}

/// Takes blocks of floating bases.
pub(super) trait Blocks<T> {
    /// The block on the diagonal that begins at a place.
    fn put_block(&mut self, first: usize, block: &[[T; 6]; 6]);
}

/// Rows of a matrix in the order of the places, above the diagonal; some numbers beside it, too.
pub(super) struct Rows<'a, T> {
    pub(super) places: &'a Places,
    pub(super) nv: usize,
    pub(super) out: &'a mut [T],
}

impl<T: Scalar, W: Wide<T>> Entries<T, W> for Rows<'_, T> {
    #[inline(always)]
    fn put(&mut self, row: usize, at: usize, x: W) {
        let margin = self.places.margin;
        let start = (row - margin) * self.nv;
        if at >= margin {
            x.store(&mut self.out[start + at - margin..][..W::COUNT]);
        } else {
            let hidden = margin - at;
            x.store_from(hidden, &mut self.out[start..][..W::COUNT - hidden]);
        }
    }
    #[inline(always)]
    fn side_by_side(&mut self, row: usize, at: usize) -> Option<&mut [T]> {
        let (row, column) = (row - self.places.margin, at - self.places.margin);
        Some(&mut self.out[row * self.nv + column..])
    }
}

impl<T: Scalar> Blocks<T> for Rows<'_, T> {
    #[inline(always)]
    fn put_block(&mut self, first: usize, block: &[[T; 6]; 6]) {
        let start = first - self.places.margin;
        for (i, row) in block.iter().enumerate() {
            self.out[(start + i) * self.nv + start..][..6].copy_from_slice(row);
        }
    }
}

/// Rows and columns of a matrix in the model's order.
pub(super) struct Scattered<'a, T> {
    pub(super) places: &'a Places,
    pub(super) nv: usize,
    pub(super) out: &'a mut [T],
}

impl<T: Scalar, W: Wide<T>> Entries<T, W> for Scattered<'_, T> {
    #[inline(always)]
    fn put(&mut self, row: usize, at: usize, x: W) {
        let (places, nv) = (self.places, self.nv);
        let i = places.dof(row);
        let mut numbers = [T::zero(); WIDEST];
        x.store(&mut numbers[..W::COUNT]);
        for place in row.max(at)..(at + W::COUNT).min(places.outboard_end(row, 1)) {
            let (j, x) = (places.dof(place), numbers[place - at]);
            self.out[i * nv + j] = x;
            self.out[j * nv + i] = x;
        }
    }
    #[inline(always)]
    fn side_by_side(&mut self, _: usize, _: usize) -> Option<&mut [T]> {
        None
    }
}

impl<T: Scalar> Blocks<T> for Scattered<'_, T> {
    #[inline(always)]
    fn put_block(&mut self, first: usize, block: &[[T; 6]; 6]) {
        for (i, row) in block.iter().enumerate() {
            for (j, &x) in row.iter().enumerate() {
                self.out[self.places.dof(first + i) * self.nv + self.places.dof(first + j)] = x;
            }
        }
    }
}
