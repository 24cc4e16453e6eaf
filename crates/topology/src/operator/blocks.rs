//! The blocks of an operator, one behind the other in memory, so that a sweep reads them as a stream.

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut};
use phipsi_spatial::Real;

/// Matrices of any sizes, each in column order.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Blocks<T> {
    numbers: Vec<T>,
    places: Vec<Place>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    start: usize,
    rows: u32,
    columns: u32,
}

impl<T: Real> Blocks<T> {
    /// None yet, with room for `count` blocks of `numbers` numbers altogether.
    pub(super) fn with_capacity(count: usize, numbers: usize) -> Self {
        Blocks { numbers: Vec::with_capacity(numbers), places: Vec::with_capacity(count) }
    }
    pub(super) fn len(&self) -> usize {
        self.places.len()
    }
    /// Numbers in all blocks.
    pub(super) fn numbers(&self) -> usize {
        self.numbers.len()
    }
    /// Block k.
    pub(super) fn get(&self, k: usize) -> DMatrixView<'_, T> {
        let Place { rows, columns, .. } = self.places[k];
        DMatrixView::from_slice(self.columns(k).1, rows as usize, columns as usize)
    }
    /// Block k, to write.
    pub(super) fn get_mut(&mut self, k: usize) -> DMatrixViewMut<'_, T> {
        let Place { start, rows, columns } = self.places[k];
        let (rows, columns) = (rows as usize, columns as usize);
        DMatrixViewMut::from_slice(&mut self.numbers[start..start + rows * columns], rows, columns)
    }
    /// Rows of block k, at least one, and its numbers, column after column.
    pub(super) fn columns(&self, k: usize) -> (usize, &[T]) {
        let Place { start, rows, columns } = self.places[k];
        let rows = rows as usize;
        (rows.max(1), &self.numbers[start..start + rows * columns as usize])
    }
    /// One more block.
    pub(super) fn push(&mut self, block: &DMatrix<T>) {
        self.push_empty(block.nrows(), block.ncols());
        let start = self.numbers.len() - block.len();
        self.numbers[start..].copy_from_slice(block.as_slice());
    }
    /// One more block, of zeros.
    pub(super) fn push_empty(&mut self, rows: usize, columns: usize) {
        self.places.push(Place { start: self.numbers.len(), rows: rows as u32, columns: columns as u32 });
        self.numbers.resize(self.numbers.len() + rows * columns, T::zero());
    }
    pub(super) fn iter(&self) -> impl DoubleEndedIterator<Item = DMatrixView<'_, T>> + ExactSizeIterator {
        (0..self.len()).map(|k| self.get(k))
    }
    pub(super) fn to_matrices(&self) -> Vec<DMatrix<T>> {
        self.iter().map(|block| block.into_owned()).collect()
    }
}

impl<T: Real> FromIterator<DMatrix<T>> for Blocks<T> {
    fn from_iter<I: IntoIterator<Item = DMatrix<T>>>(blocks: I) -> Self {
        let blocks = blocks.into_iter();
        let mut all = Blocks::with_capacity(blocks.size_hint().0, 0);
        blocks.for_each(|block| all.push(&block));
        all
    }
}
