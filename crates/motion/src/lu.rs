//! Factors of a square matrix with partial pivoting, P A = L U: nalgebra's elimination and substitutions in a matrix that is kept, so that
//! nothing allocates after it is made; with the feature `large-matrices`, for these, faer's elimination, whose products are blocked.
//!
//! Measured on one core of an AMD EPYC (Zen 5), 2026-11-30, loaded with other work, least of 20 rounds, µs
//! (`cargo test --release -p phipsi-motion --features large-matrices --lib lu -- --nocapture`):
//!
//! | n | nalgebra's factors | faer's |
//! |---|---|---|
//! | 16 | 0.7 | 1.0 |
//! | 32 | 3.9 | 2.8 |
//! | 48 | 10.1 | 5.9 |
//! | 64 | 19.7 | 10.3 |
//! | 128 | 133 | 43 |
//! | 200 | 463 | 115 |
//!
//! Substitutions, eight a step at most, stay nalgebra's.

use nalgebra::linalg::{gauss_step, gauss_step_swap};
use nalgebra::{DMatrix, DVectorViewMut};

#[cfg(feature = "large-matrices")]
mod large;

/// A matrix, then its factors.
#[derive(Clone, Debug)]
pub(crate) struct Lu {
    /// The matrix to be factored; afterwards U, and L without its diagonal of ones.
    pub(crate) entries: DMatrix<f64>,
    /// The row that changed places with each.
    rows: Vec<usize>,
    /// For large matrices.
    #[cfg(feature = "large-matrices")]
    large: large::Large,
}

impl Lu {
    pub(crate) fn new(n: usize) -> Self {
        Lu {
            entries: DMatrix::zeros(n, n),
            rows: vec![0; n],
            #[cfg(feature = "large-matrices")]
            large: large::Large::new(n),
        }
    }
    /// Factors the entries, in n³/3 multiplications.
    pub(crate) fn run(&mut self) {
        #[cfg(feature = "large-matrices")]
        if self.rows.len() >= large::LARGE {
            return self.large.run(&mut self.entries, &mut self.rows);
        }
        eliminate(&mut self.entries, &mut self.rows);
    }
    /// Replaces b by the solution; a singular matrix gives one that is not a number.
    pub(crate) fn solve(&self, b: &mut [f64]) {
        for (p, &row) in self.rows.iter().enumerate() {
            b.swap(p, row);
        }
        let mut x = DVectorViewMut::from_slice(b, b.len());
        self.entries.solve_lower_triangular_with_diag_mut(&mut x, 1.0);
        if !self.entries.solve_upper_triangular_mut(&mut x) {
            b.fill(f64::NAN);
        }
    }
}

/// nalgebra's elimination; `exchanged`: the row that changes places with each.
fn eliminate(entries: &mut DMatrix<f64>, exchanged: &mut [usize]) {
    for p in 0..exchanged.len() {
        let row = p + entries.view_range(p.., p).iamax();
        exchanged[p] = row;
        let pivot = entries[(row, p)];
        if pivot == 0.0 {
            continue;
        }
        if row == p {
            gauss_step(entries, pivot, p);
        } else {
            entries.columns_range_mut(..p).swap_rows(p, row);
            gauss_step_swap(entries, pivot, p, row);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factors_solve_what_needs_pivoting() {
        let mut lu = Lu::new(3);
        let matrix = DMatrix::from_row_slice(3, 3, &[0.0, 2.0, 1.0, 1.0, 0.0, 3.0, 4.0, 1.0, 0.0]);
        lu.entries.copy_from(&matrix);
        lu.run();
        let want = [1.0, -2.0, 0.5];
        let mut x = (matrix * nalgebra::Vector3::from(want)).as_slice().to_vec();
        lu.solve(&mut x);
        assert!(x.iter().zip(want).all(|(x, w)| (x - w).abs() < 8.0 * f64::EPSILON), "{x:?}");
    }

    /// Both eliminations solve what both meet: A x = b with rows that have to change places, to the backward error of elimination.
    #[test]
    fn both_eliminations_solve() {
        for n in [1, 2, 7, 47, 48, 49, 64, 97, 200] {
            let mut lu = Lu::new(n);
            let mut seed = n as u64;
            let mut random = || {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
            };
            let matrix = DMatrix::from_fn(n, n, |_, _| random());
            let b: Vec<f64> = (0..n).map(|_| random()).collect();
            // Twice: what was kept of one factorisation has no part in the next.
            for _ in 0..2 {
                lu.entries.copy_from(&matrix);
                lu.run();
                let mut x = b.clone();
                lu.solve(&mut x);
                let x = nalgebra::DVector::from_vec(x);
                // n ε times growth of the pivots, below n^(2/3) on random matrices.
                let bar = (n as f64).powf(5.0 / 3.0) * f64::EPSILON * matrix.amax() * x.amax() * n as f64;
                let off = (&matrix * &x - nalgebra::DVector::from_column_slice(&b)).amax();
                assert!(off <= bar, "{n}: {off:e} {bar:e}");
            }
            let rows = lu.rows.iter().enumerate().all(|(p, &row)| row >= p && row < n);
            assert!(rows, "{n}: {:?}", lu.rows);
        }
    }

    #[test]
    fn a_singular_matrix_has_no_solution() {
        for n in [2, 51] {
            for fill in [f64::NAN, 0.0] {
                let mut lu = Lu::new(n);
                lu.entries.fill_with_identity();
                // The last two rows and columns: of rank one, or no numbers.
                let filled = [[1.0, 2.0], [2.0, 4.0]];
                for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    lu.entries[(n - 2 + i, n - 2 + j)] = filled[i][j] + fill;
                }
                lu.run();
                let mut x = vec![1.0; n];
                lu.solve(&mut x);
                assert!(x[n - 2..].iter().all(|x| !x.is_finite()), "{n}: {x:?}");
            }
        }
    }
}
