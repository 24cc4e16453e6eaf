//! Elimination of large matrices by faer, with its permutation as exchanges of rows, which the substitutions of small ones use.

use faer::dyn_stack::MemStack;
use faer::linalg::lu::partial_pivoting::factor::lu_in_place;
use faer::{MatMut, Par};
use nalgebra::DMatrix;
use std::mem::MaybeUninit;

/// Size from which faer eliminates: it is faster from 32 on, by as much as a step notices from here.
pub(super) const LARGE: usize = 48;

/// What faer's elimination needs, and what makes exchanges of its permutation; empty for small matrices.
#[derive(Clone, Debug)]
pub(super) struct Large {
    order: Vec<usize>,
    places: Vec<usize>,
    rows_at: Vec<usize>,
    room: Vec<MaybeUninit<usize>>,
}

impl Large {
    pub(super) fn new(n: usize) -> Self {
        let n = if n < LARGE { 0 } else { n };
        let zero = || vec![0; n];
        Large { order: zero(), places: zero(), rows_at: zero(), room: vec![MaybeUninit::uninit(); n] }
    }
    /// Factors a matrix; what it does to the rows becomes exchanges of each row with itself or a later one.
    pub(super) fn run(&mut self, entries: &mut DMatrix<f64>, exchanged: &mut [usize]) {
        let n = exchanged.len();
        let matrix = MatMut::from_column_major_slice_mut(entries.as_mut_slice(), n, n);
        let Large { order, places, rows_at, room } = self;
        lu_in_place(matrix, order, places, Par::Seq, MemStack::new_any(room), Default::default());
        // Row p of P A is row order[p] of A. From here on `places`: where each row of A is after the exchanges so far; `rows_at`: which row
        // is at each place.
        for i in 0..n {
            (places[i], rows_at[i]) = (i, i);
        }
        for p in 0..n {
            let place = places[order[p]];
            exchanged[p] = place;
            let row = rows_at[p];
            (rows_at[place], places[row]) = (row, place);
        }
    }
}
