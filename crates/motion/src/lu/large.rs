//! Elimination of large matrices by faer, with its permutation as exchanges of rows, which the substitutions of small ones use.

use faer::dyn_stack::MemStack;
use faer::linalg::lu::partial_pivoting::factor::lu_in_place;
use faer::{MatMut, Par};
use nalgebra::DMatrix;
use std::mem::MaybeUninit;

/// Size from which faer eliminates. It is faster from 32 on, up to here by 4 µs at most: too little for digits that depend on the processor.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lu::eliminate;
    use std::time::Instant;

    /// Least times of both eliminations of one matrix, s.
    fn times(n: usize) -> [f64; 2] {
        let matrix = DMatrix::from_fn(n, n, |i, j| (1.0 + (i * n + j) as f64).sin());
        let (mut entries, mut rows, mut large) = (matrix.clone(), vec![0; n], Large::new(n));
        // Rooms of its own where it would have none.
        if n < LARGE {
            large = Large { order: rows.clone(), places: rows.clone(), rows_at: rows.clone(), ..large };
            large.room = vec![MaybeUninit::uninit(); n];
        }
        let repeats = (300_000 / (n * n * n)).max(1);
        let mut least = [f64::INFINITY; 2];
        for _ in 0..20 {
            for (k, least) in least.iter_mut().enumerate() {
                let clock = Instant::now();
                for _ in 0..repeats {
                    entries.copy_from(&matrix);
                    match k {
                        0 => eliminate(&mut entries, &mut rows),
                        _ => large.run(&mut entries, &mut rows),
                    }
                }
                *least = least.min(clock.elapsed().as_secs_f64() / repeats as f64);
            }
        }
        least
    }

    /// Large matrices are eliminated faster; four times as fast at 200, so that a busy machine does not hide it.
    #[test]
    fn large_matrices_are_worth_it() {
        for n in [16, 32, 40, LARGE, 64, 96, 128, 200] {
            let [small, large] = times(n);
            println!("| {n} | {:.2} | {:.2} |", 1e6 * small, 1e6 * large);
            assert!(n < 200 || large < small, "{n}: {large:e} s by faer, {small:e} s by nalgebra");
        }
    }
}
