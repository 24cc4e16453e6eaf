//! Rows of a matrix, one after the other. The chunks of a slice are the same, but begin with a division for their count.

/// Pieces of `stride` numbers, as long as there are whole ones.
pub(crate) struct Rows<'a, T> {
    rest: &'a [T],
    stride: usize,
}

impl<'a, T> Rows<'a, T> {
    #[inline(always)]
    pub(crate) fn new(numbers: &'a [T], stride: usize) -> Self {
        Rows { rest: numbers, stride }
    }
}

impl<'a, T> Iterator for Rows<'a, T> {
    type Item = &'a [T];
    #[inline(always)]
    fn next(&mut self) -> Option<&'a [T]> {
        let (row, rest) = self.rest.split_at_checked(self.stride)?;
        self.rest = rest;
        Some(row)
    }
}

/// The same, to be written.
pub(crate) struct RowsMut<'a, T> {
    rest: &'a mut [T],
    stride: usize,
}

impl<'a, T> RowsMut<'a, T> {
    #[inline(always)]
    pub(crate) fn new(numbers: &'a mut [T], stride: usize) -> Self {
        RowsMut { rest: numbers, stride }
    }
}

impl<'a, T> Iterator for RowsMut<'a, T> {
    type Item = &'a mut [T];
    #[inline(always)]
    fn next(&mut self) -> Option<&'a mut [T]> {
        let (row, rest) = core::mem::take(&mut self.rest).split_at_mut_checked(self.stride)?;
        self.rest = rest;
        Some(row)
    }
}
