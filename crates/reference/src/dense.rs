//! L D L* of a dense symmetric matrix, in a given order of elimination.

use nalgebra::DMatrix;
use phipsi_model::{JointKind, Model};
use phipsi_spatial::Real;
use std::fmt;

/// A pivot that is not positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NotPositive {
    /// The degree of freedom where elimination stopped.
    pub degree_of_freedom: usize,
}

impl fmt::Display for NotPositive {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "pivot of degree of freedom {} is not positive", self.degree_of_freedom)
    }
}

impl std::error::Error for NotPositive {}

/// Factors of a symmetric matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct Factors<T> {
    size: usize,
    order: Vec<usize>,
    /// Unit lower triangular, rows and columns in the order of elimination.
    l: DMatrix<T>,
    d: Vec<T>,
}

impl<T: Real> Factors<T> {
    /// Eliminates in `order`. A pivot that is not above `threshold` times its diagonal entry is an error.
    ///
    /// # Errors
    /// [`NotPositive`].
    pub fn new(a: &DMatrix<T>, order: Vec<usize>, threshold: f64) -> Result<Self, NotPositive> {
        let n = order.len();
        let mut l = DMatrix::from_element(n, n, T::zero());
        let mut d = Vec::with_capacity(n);
        for j in 0..n {
            let diagonal = a[(order[j], order[j])];
            // l(j, k) d(k), k < j.
            let row: Vec<T> = (0..j).map(|k| l[(j, k)] * d[k]).collect();
            let pivot = (0..j).fold(diagonal, |sum, k| sum - l[(j, k)] * row[k]);
            if !pivot.is_positive() || pivot <= diagonal * T::splat(threshold) {
                return Err(NotPositive { degree_of_freedom: order[j] });
            }
            l[(j, j)] = T::one();
            for i in j + 1..n {
                let sum = (0..j).fold(a[(order[i], order[j])], |sum, k| sum - l[(i, k)] * row[k]);
                l[(i, j)] = sum / pivot;
            }
            d.push(pivot);
        }
        Ok(Factors { size: a.nrows(), order, l, d })
    }
    /// L⁻¹ b in the order of elimination.
    fn forward(&self, b: &[T]) -> Vec<T> {
        let mut x: Vec<T> = self.order.iter().map(|&i| b[i]).collect();
        for i in 0..x.len() {
            x[i] = (0..i).fold(x[i], |sum, k| sum - self.l[(i, k)] * x[k]);
        }
        x
    }
    /// x in the order of elimination, by index of the matrix; zero where `order` has no entry.
    fn scattered(&self, x: &[T]) -> Vec<T> {
        let mut out = vec![T::zero(); self.size];
        self.order.iter().zip(x).for_each(|(&i, x)| out[i] = *x);
        out
    }
    /// L⁻¹ b; zero where `order` has no entry.
    pub fn innovations(&self, b: &[T]) -> Vec<T> {
        self.scattered(&self.forward(b))
    }
    /// A⁻¹ b; zero where `order` has no entry.
    pub fn solve(&self, b: &[T]) -> Vec<T> {
        let n = self.order.len();
        let mut x = self.forward(b);
        for i in 0..n {
            x[i] /= self.d[i];
        }
        for i in (0..n).rev() {
            x[i] = (i + 1..n).fold(x[i], |sum, k| sum - self.l[(k, i)] * x[k]);
        }
        self.scattered(&x)
    }
    /// The pivots, by index of the matrix; zero where `order` has no entry.
    pub fn pivots(&self) -> Vec<T> {
        self.scattered(&self.d)
    }
}

/// Joints from the tips to the base; the degrees of freedom of one joint in their own order, but those of a universal joint,
/// which is two hinges, from the outer one inward.
pub fn tips_first(model: &Model) -> Vec<usize> {
    let mut order = Vec::with_capacity(model.nv());
    for k in (0..model.len()).rev() {
        match model.joints()[k].kind {
            JointKind::Universal { .. } => order.extend(model.v_range(k).rev()),
            _ => order.extend(model.v_range(k)),
        }
    }
    order
}
