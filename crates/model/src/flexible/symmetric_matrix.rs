//! Symmetric sparse matrices of finite element models.

use nalgebra::DMatrix;
use std::fmt;

/// Symmetry to this part of the largest entry, where both triangles are given.
const SYMMETRY: f64 = 1e-8;

/// A symmetric sparse matrix.
///
/// # Example
/// ```
/// use phipsi_model::SymmetricMatrix;
/// let chain = SymmetricMatrix::from_triangle(2, [(0, 0, 2.0), (1, 0, -1.0), (1, 1, 1.0)])?;
/// assert_eq!(chain.entries().count(), 3);
/// assert!(SymmetricMatrix::from_triangle(2, [(2, 0, 1.0)]).is_err());
/// # Ok::<(), phipsi_model::MatrixError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SymmetricMatrix {
    size: usize,
    /// Row, column, value; row ≥ column, column after column, none twice.
    entries: Vec<(usize, usize, f64)>,
}

/// Why numbers are no symmetric matrix.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum MatrixError {
    /// An entry outside the matrix.
    Outside {
        /// Row and column, from 0.
        at: [usize; 2],
        /// Number of rows.
        size: usize,
    },
    /// An entry that is not finite.
    NotFinite {
        /// Row and column, from 0.
        at: [usize; 2],
        /// The entry.
        found: f64,
    },
    /// Two entries that should be equal.
    NotSymmetric {
        /// Row and column of the first, from 0.
        at: [usize; 2],
        /// The entries of the two triangles.
        found: [f64; 2],
    },
}

impl fmt::Display for MatrixError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MatrixError::Outside { at: [i, j], size } => {
                write!(f, "entry ({i}, {j}) of a {size}×{size} matrix; indices below {size} are required")
            }
            MatrixError::NotFinite { at: [i, j], found } => {
                write!(f, "entry ({i}, {j}) is {found}; a finite number is required")
            }
            MatrixError::NotSymmetric { at: [i, j], found: [a, b] } => write!(
                f,
                "entries ({i}, {j}) and ({j}, {i}) are {a:e} and {b:e}; a symmetric matrix is required: correct one of them"
            ),
        }
    }
}

impl std::error::Error for MatrixError {}

impl SymmetricMatrix {
    /// From the diagonal and the entries of one triangle, either of the two; entries that are named twice are added.
    ///
    /// # Errors
    /// [`MatrixError`].
    pub fn from_triangle(
        size: usize,
        entries: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, MatrixError> {
        let mut sorted = Vec::new();
        for (i, j, value) in entries {
            check(size, (i, j, value))?;
            sorted.push((i.max(j), i.min(j), value));
        }
        Ok(SymmetricMatrix { size, entries: summed(sorted) })
    }
    /// From the entries of both triangles; entries that are named twice are added. Triangles may differ by 1e-8 of the largest
    /// entry; their mean is taken.
    ///
    /// # Errors
    /// [`MatrixError`].
    pub fn from_entries(
        size: usize,
        entries: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, MatrixError> {
        let (mut lower, mut upper) = (Vec::new(), Vec::new());
        for (i, j, value) in entries {
            check(size, (i, j, value))?;
            if i >= j {
                lower.push((i, j, value));
            }
            if i <= j {
                upper.push((j, i, value));
            }
        }
        let (lower, upper) = (summed(lower), summed(upper));
        let largest = lower.iter().chain(&upper).fold(0.0f64, |most, x| most.max(x.2.abs()));
        let (mut a, mut b) = (lower.into_iter().peekable(), upper.into_iter().peekable());
        let mut entries = Vec::new();
        let place = |x: &(usize, usize, f64)| (x.1, x.0);
        loop {
            // A triangle may lack an entry that the other has: it is zero there.
            let (i, j, found) = match (a.peek().copied(), b.peek().copied()) {
                (None, None) => break,
                (Some(x), Some(y)) if place(&x) == place(&y) => {
                    a.next();
                    b.next();
                    (x.0, x.1, [x.2, y.2])
                }
                (Some(x), y) if y.is_none_or(|y| place(&x) < place(&y)) => {
                    a.next();
                    (x.0, x.1, [x.2, 0.0])
                }
                (_, Some(y)) => {
                    b.next();
                    (y.0, y.1, [0.0, y.2])
                }
                (Some(_), None) => break,
            };
            let [x, y] = found;
            if (x - y).abs() > SYMMETRY * largest {
                return Err(MatrixError::NotSymmetric { at: [i, j], found });
            }
            entries.push((i, j, 0.5 * x + 0.5 * y));
        }
        Ok(SymmetricMatrix { size, entries })
    }
    /// From a dense matrix: its entries but zeros.
    ///
    /// # Errors
    /// [`MatrixError`]; a matrix that is not square lacks entries.
    pub fn from_dense(matrix: &DMatrix<f64>) -> Result<Self, MatrixError> {
        let size = matrix.nrows();
        let all = (0..matrix.ncols()).flat_map(|j| (0..size).map(move |i| (i, j, matrix[(i, j)])));
        Self::from_entries(size, all.filter(|x| x.2 != 0.0))
    }
    /// Number of rows, and of columns.
    pub fn size(&self) -> usize {
        self.size
    }
    /// Row, column and value of the diagonal and the lower triangle, column after column; none twice.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        self.entries.iter().copied()
    }
}

#[cfg(feature = "finite-elements")]
impl SymmetricMatrix {
    /// With these numbers on the diagonal.
    pub(crate) fn diagonal(numbers: impl Iterator<Item = f64>) -> Self {
        let entries: Vec<_> = numbers.enumerate().map(|(i, a)| (i, i, a)).collect();
        SymmetricMatrix { size: entries.len(), entries }
    }
    /// A x, of as many rows as the matrix has. Cost: entries times columns.
    pub(crate) fn times(&self, x: &DMatrix<f64>) -> DMatrix<f64> {
        let mut product = DMatrix::zeros(self.size, x.ncols());
        for (x, mut y) in x.column_iter().zip(product.column_iter_mut()) {
            for &(i, j, a) in &self.entries {
                y[i] += a * x[j];
                if i != j {
                    y[j] += a * x[i];
                }
            }
        }
        product
    }
    /// Largest |(A x)_i| over Σ_j |A_ij x_j|, and its row: what should vanish.
    pub(crate) fn relative_product(&self, x: &DMatrix<f64>) -> (f64, usize) {
        let product = self.times(x);
        let sizes = SymmetricMatrix {
            size: self.size,
            entries: self.entries.iter().map(|&(i, j, a)| (i, j, a.abs())).collect(),
        };
        let sizes = sizes.times(&x.abs());
        let mut worst = (0.0, 0);
        for (index, (value, size)) in product.iter().zip(sizes.iter()).enumerate() {
            if *size > 0.0 && value.abs() / size > worst.0 {
                worst = (value.abs() / size, index % self.size);
            }
        }
        worst
    }
    /// The block of these rows and columns, which the new numbers count.
    pub(crate) fn principal(&self, rows: &[usize]) -> SymmetricMatrix {
        let place = places(self.size, rows);
        let kept = self.entries.iter().filter_map(|&(i, j, a)| Some((place[i]?, place[j]?, a)));
        let sorted = kept.map(|(i, j, a)| (i.max(j), i.min(j), a)).collect();
        SymmetricMatrix { size: rows.len(), entries: summed(sorted) }
    }
    /// The block of some rows and other columns, dense.
    pub(crate) fn block(&self, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
        let (row, column) = (places(self.size, rows), places(self.size, columns));
        let mut block = DMatrix::zeros(rows.len(), columns.len());
        for &(i, j, a) in &self.entries {
            for (i, j) in [(i, j), (j, i)] {
                if let (Some(r), Some(c)) = (row[i], column[j]) {
                    block[(r, c)] = a;
                }
            }
        }
        block
    }
}

/// Where each index is in a list.
#[cfg(feature = "finite-elements")]
fn places(size: usize, list: &[usize]) -> Vec<Option<usize>> {
    let mut places = vec![None; size];
    list.iter().enumerate().for_each(|(new, &old)| places[old] = Some(new));
    places
}

fn check(size: usize, (i, j, value): (usize, usize, f64)) -> Result<(), MatrixError> {
    if i >= size || j >= size {
        return Err(MatrixError::Outside { at: [i, j], size });
    }
    if !value.is_finite() {
        return Err(MatrixError::NotFinite { at: [i, j], found: value });
    }
    Ok(())
}

/// Sorted, with equal places added.
fn summed(mut entries: Vec<(usize, usize, f64)>) -> Vec<(usize, usize, f64)> {
    entries.sort_by_key(|x| (x.1, x.0));
    entries.dedup_by(|next, first| {
        let same = (next.0, next.1) == (first.0, first.1);
        if same {
            first.2 += next.2;
        }
        same
    });
    entries
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_agree_and_doubles_are_added() {
        let triangle = [(0, 0, 2.0), (1, 0, -0.5), (0, 1, -0.5), (1, 1, 1.0)];
        let full = [(1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0), (0, 0, 1.5), (0, 0, 0.5)];
        let a = SymmetricMatrix::from_triangle(2, triangle).unwrap();
        assert_eq!(a, SymmetricMatrix::from_entries(2, full).unwrap());
        assert_eq!(a.entries().collect::<Vec<_>>(), [(0, 0, 2.0), (1, 0, -1.0), (1, 1, 1.0)]);
        let skew = SymmetricMatrix::from_entries(2, [(0, 1, 1.0), (1, 0, 2.0)]).unwrap_err();
        assert_eq!(skew, MatrixError::NotSymmetric { at: [1, 0], found: [2.0, 1.0] });
        let half = SymmetricMatrix::from_entries(3, [(2, 1, 1.0)]).unwrap_err();
        assert!(half.to_string().contains("(2, 1) and (1, 2)"), "{half}");
        assert!(SymmetricMatrix::from_triangle(1, [(0, 0, f64::NAN)]).is_err());
    }
}
