//! The lowest modes of a large sparse model: subspace iteration on a sparse factor.
//!
//! | symbol | meaning |
//! |---|---|
//! | K, M | stiffness and mass with all interfaces clamped: K positive definite, M not necessarily |
//! | X | a basis of more columns than modes are wanted, so that those beyond hold back the error |
//! | Z, Y | M X, K⁻¹ Z: a step of inverse iteration |
//! | μ | 1/ω²: Y* M Y q = Y* K Y q μ, the Ritz values |
//!
//! Source: K.-J. Bathe, Finite Element Procedures, section 11.6. The factor is a sparse Cholesky factor of faer.

use super::SymmetricMatrix;
use super::craig_bampton::{sorted, symmetric};
use crate::Random;
use faer::Side;
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::Llt;
use faer::sparse::linalg::solvers::SymbolicLlt;
use faer::sparse::{SparseColMat, Triplet};
use nalgebra::{DMatrix, SymmetricEigen};

/// Columns beyond those wanted.
const GUARD: usize = 8;

/// Most iterations; a factor of three a step is slow already.
const MOST_ITERATIONS: usize = 200;

/// Relative change of the Ritz values that ends the iteration; frequencies stand to half of it.
const STANDING: f64 = 1e-13;

/// A direction of K's metric below this part of the largest is rounding: there is no mass behind it.
const MASSLESS: f64 = 1e-13;

/// K = c c*, sparse.
pub(super) struct Factor {
    llt: Llt<usize, f64>,
    size: usize,
}

impl Factor {
    /// `None` if the matrix is not positive definite.
    pub(super) fn new(matrix: &SymmetricMatrix) -> Option<Self> {
        let size = matrix.size();
        let entries: Vec<_> = matrix.entries().map(|(i, j, a)| Triplet::new(i, j, a)).collect();
        let sparse = SparseColMat::<usize, f64>::try_new_from_triplets(size, size, &entries).ok()?;
        let symbolic = SymbolicLlt::try_new(sparse.symbolic(), Side::Lower).ok()?;
        let llt = Llt::try_new_with_symbolic(symbolic, sparse.as_ref(), Side::Lower).ok()?;
        Some(Factor { llt, size })
    }
    /// x ← K⁻¹ x, column by column.
    pub(super) fn solve(&self, x: &mut DMatrix<f64>) {
        let columns = x.ncols();
        let dense = faer::MatMut::from_column_major_slice_mut(x.as_mut_slice(), self.size, columns);
        self.llt.solve_in_place(dense);
    }
}

/// Modes with all interfaces clamped.
#[derive(Default)]
pub(super) struct ClampedModes {
    /// Φ by columns.
    pub(super) shapes: DMatrix<f64>,
    /// ω, rad/s.
    pub(super) frequencies: Vec<f64>,
    /// About the next ω, if there is one with mass.
    pub(super) next: Option<f64>,
}

impl ClampedModes {
    /// The `count` lowest; the number of modes with mass if it is smaller.
    pub(super) fn lowest(factor: &Factor, mass: &SymmetricMatrix, count: usize) -> Result<Self, usize> {
        let size = mass.size();
        let width = (count + count.max(GUARD)).min(size);
        let mut random = Random::new(1);
        let mut x = DMatrix::from_fn(size, width, |_, _| random.signed());
        let mut before: Vec<f64> = Vec::new();
        for _ in 0..MOST_ITERATIONS {
            let z = mass.times(&x);
            let mut y = z.clone();
            factor.solve(&mut y);
            let (basis, mu) = ritz(&y, &z, mass);
            if mu.len() < count {
                return Err(mu.len());
            }
            x = basis;
            let standing =
                |k: usize| before.get(k).is_some_and(|old| (old - mu[k]).abs() <= STANDING * mu[k]);
            let done = (0..count).all(standing);
            before = mu;
            if done || width == size {
                break;
            }
        }
        let frequency = |mu: &f64| mu.sqrt().recip();
        Ok(ClampedModes {
            shapes: x.columns(0, count).into_owned(),
            frequencies: before.iter().take(count).map(frequency).collect(),
            next: before.get(count).map(frequency),
        })
    }
}

/// Y turned to Y* M Y = I, Y* K Y = diag 1/μ with K Y = Z, μ falling; directions without mass are left out.
fn ritz(y: &DMatrix<f64>, z: &DMatrix<f64>, mass: &SymmetricMatrix) -> (DMatrix<f64>, Vec<f64>) {
    let stiffness = symmetric(&(y.transpose() * z));
    let scale: Vec<f64> = (0..y.ncols())
        .map(|c| stiffness[(c, c)])
        .map(|k| if k > 0.0 { k.sqrt().recip() } else { 0.0 })
        .collect();
    let scaled = DMatrix::from_fn(y.ncols(), y.ncols(), |r, c| stiffness[(r, c)] * scale[r] * scale[c]);
    let eigen = SymmetricEigen::new(scaled);
    let largest = eigen.eigenvalues.max();
    if largest.is_nan() || largest <= 0.0 {
        return (DMatrix::zeros(y.nrows(), 0), Vec::new());
    }
    let kept: Vec<usize> = (0..y.ncols()).filter(|&c| eigen.eigenvalues[c] > MASSLESS * largest).collect();
    // Orthonormal in K's metric.
    let metric = DMatrix::from_fn(y.ncols(), kept.len(), |r, c| {
        scale[r] * eigen.eigenvectors[(r, kept[c])] / eigen.eigenvalues[kept[c]].sqrt()
    });
    let basis = y * metric;
    let heavy = symmetric(&(basis.transpose() * mass.times(&basis)));
    let eigen = SymmetricEigen::new(heavy);
    let mut order = sorted(&eigen.eigenvalues);
    order.reverse();
    order.retain(|&c| eigen.eigenvalues[c] > 0.0);
    let mu: Vec<f64> = order.iter().map(|&c| eigen.eigenvalues[c]).collect();
    let turn =
        DMatrix::from_fn(kept.len(), order.len(), |r, c| eigen.eigenvectors[(r, order[c])] / mu[c].sqrt());
    (basis * turn, mu)
}
