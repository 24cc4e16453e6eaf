//! Factors of a square matrix with partial pivoting: nalgebra's elimination and substitutions in a matrix that is kept, so that
//! nothing allocates after it is made.

use nalgebra::linalg::{gauss_step, gauss_step_swap};
use nalgebra::{DMatrix, DVectorViewMut};

/// A matrix, then its factors.
#[derive(Clone, Debug)]
pub(crate) struct Lu {
    /// The matrix to be factored; afterwards U, and L without its diagonal of ones.
    pub(crate) entries: DMatrix<f64>,
    /// The row that changed places with each.
    rows: Vec<usize>,
}

impl Lu {
    pub(crate) fn new(n: usize) -> Self {
        Lu { entries: DMatrix::zeros(n, n), rows: vec![0; n] }
    }
    /// Factors the entries, in n³/3 multiplications.
    pub(crate) fn run(&mut self) {
        let n = self.rows.len();
        for p in 0..n {
            let row = p + self.entries.view_range(p.., p).iamax();
            self.rows[p] = row;
            let pivot = self.entries[(row, p)];
            if pivot == 0.0 {
                continue;
            }
            if row == p {
                gauss_step(&mut self.entries, pivot, p);
            } else {
                self.entries.columns_range_mut(..p).swap_rows(p, row);
                gauss_step_swap(&mut self.entries, pivot, p, row);
            }
        }
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

    #[test]
    fn a_singular_matrix_has_no_solution() {
        let mut lu = Lu::new(2);
        lu.entries.copy_from_slice(&[1.0, 2.0, 2.0, 4.0]);
        lu.run();
        let mut x = [1.0, 0.0];
        lu.solve(&mut x);
        assert!(x.iter().all(|x| !x.is_finite()), "{x:?}");
    }
}
