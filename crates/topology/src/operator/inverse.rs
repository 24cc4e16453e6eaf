//! Inverses that an identity provides, as sweeps.
//!
//! | expression | inverse | source |
//! |---|---|---|
//! | diagonal Δ | Δ⁻¹, block by block | |
//! | φ = (I − E)⁻¹ | I − E | paper 2 (2.2) |
//! | Δ + E | (I + Δ⁻¹ E)⁻¹ Δ⁻¹ | paper 2 (2.2) |
//! | Δ + U φ V, where V Δ⁻¹ U is diagonal or edges | Δ⁻¹ − Δ⁻¹ U (φ⁻¹ + V Δ⁻¹ U)⁻¹ V Δ⁻¹ | paper 1 Lemmas 5, 6; paper 2 (4.14) |
//! | U φ M φ* U* | L* D⁻¹ L by the Riccati equation ([`Operator::innovations`]) | paper 2 (4.15) |
//! | A B | B⁻¹ A⁻¹ | |
//!
//! With U = H and V = K the third is (I + H φ K)⁻¹ = I − H ψ K: ψ comes out by itself.

use super::band::Band;
use super::blocks::Blocks;
use super::leaf::{Edges, Leaf};
use super::{Node, Operator, OperatorError};
use nalgebra::{DMatrix, DMatrixView};
use phipsi_spatial::Real;

impl<T: Real> Operator<T> {
    /// A⁻¹ as sweeps, where an identity provides it. Cost O(n); no matrix larger than a block is formed.
    ///
    /// # Errors
    /// [`OperatorError::NoInverse`] if none of the identities applies; [`OperatorError::Singular`] if a block that must be
    /// inverted is singular; [`OperatorError::Spaces`] of an expression whose spaces do not fit.
    pub fn inverse(&self) -> Result<Self, OperatorError> {
        self.check()?;
        if self.rows != self.columns {
            return Err(self.no_inverse(&format!("it maps {} to {}", self.columns, self.rows)));
        }
        match &self.node {
            Node::Scaled(s, a) => return Ok(a.inverse()?.scaled(s.recip())),
            Node::Leaf { leaf, adjoint, .. } => {
                if let Leaf::Resolvent(edges) = &**leaf {
                    let edges = self.unnamed("E", Leaf::Edges(edges.clone()));
                    let inverse = &Self::identity(&self.rows) - &edges;
                    return Ok(if *adjoint { inverse.adjoint() } else { inverse });
                }
            }
            Node::Product(factors) => return self.inverse_of_product(factors),
            _ => {}
        }
        if let Some(band) = Band::of(self) {
            return self.inverse_of_band(band);
        }
        if let Some(band) = Band::of(&self.adjoint()) {
            return Ok(self.inverse_of_band(band)?.adjoint());
        }
        let Node::Sum(terms) = &self.node else {
            return Err(self.no_inverse("it is no resolvent, diagonal, product or sum"));
        };
        match self.inverse_of_sum(terms) {
            Err(OperatorError::NoInverse { .. }) => {
                let adjoint = self.adjoint();
                let Node::Sum(terms) = &adjoint.node else { unreachable!("the adjoint of a sum is a sum") };
                self.inverse_of_sum(terms).map(|inverse| inverse.adjoint())
            }
            result => result,
        }
    }

    fn no_inverse(&self, why: &str) -> OperatorError {
        OperatorError::NoInverse { expression: self.to_string(), why: why.into() }
    }
    fn unnamed(&self, name: &str, leaf: Leaf<T>) -> Self {
        Self::leaf(name, &self.rows, &self.rows, leaf)
    }

    fn inverse_of_product(&self, factors: &[Self]) -> Result<Self, OperatorError> {
        if factors.iter().all(|a| a.rows == a.columns) {
            let all: Result<Vec<_>, _> = factors.iter().rev().map(Self::inverse).collect();
            match all {
                Err(OperatorError::NoInverse { .. }) => {}
                result => return Ok(Self::product_of(result?, &self.rows)),
            }
        }
        if let Some(band) = Band::of(self) {
            return self.inverse_of_band(band);
        }
        self.innovations().map(|innovations| innovations.inverse())
    }
    fn product_of(factors: Vec<Self>, space: &super::Space) -> Self {
        factors.iter().fold(Self::identity(space), |product, factor| &product * factor)
    }

    /// (Δ + E)⁻¹ = (I + Δ⁻¹E)⁻¹ Δ⁻¹.
    fn inverse_of_band(&self, band: Band<T>) -> Result<Self, OperatorError> {
        let Some(diagonal) = band.diagonal else {
            return Err(self.no_inverse("it has no diagonal blocks: some power of it is zero"));
        };
        let inverse = self.inverse_blocks(&diagonal)?;
        let resolvent = band.edges.map(|edges| {
            let block = |(k, e): (usize, DMatrixView<'_, T>)| match edges.tree.parent(k) {
                Some(p) => -(inverse.get(p) * e),
                None => e.into_owned(),
            };
            let blocks = edges.blocks.iter().enumerate().map(block).collect();
            self.unnamed("(I − E)⁻¹", Leaf::Resolvent(Edges { blocks, tree: edges.tree.clone() }))
        });
        let is_one = diagonal.iter().all(|d| d == DMatrix::identity(d.nrows(), d.ncols()));
        Ok(match (resolvent, is_one) {
            (Some(resolvent), true) => resolvent,
            (Some(resolvent), false) => resolvent * self.unnamed("Δ⁻¹", Leaf::Diagonal(inverse)),
            (None, _) => {
                let name = format!("{}⁻¹", super::show::in_brackets(self));
                self.unnamed(&name, Leaf::Diagonal(inverse))
            }
        })
    }

    /// Blocks inverted one by one.
    pub(super) fn inverse_blocks(&self, blocks: &Blocks<T>) -> Result<Blocks<T>, OperatorError> {
        let one = |(node, block): (usize, DMatrixView<'_, T>)| {
            inverse_of_block(block).map_err(|pivot| OperatorError::Singular {
                expression: self.to_string(),
                node,
                pivot,
            })
        };
        blocks.iter().enumerate().map(one).collect()
    }

    /// (Δ + U φ V)⁻¹ for a sum in which one term has a resolvent and the others are diagonal.
    fn inverse_of_sum(&self, terms: &[Self]) -> Result<Self, OperatorError> {
        let (mut diagonal, mut sweep): (Option<Self>, Option<&Self>) = (None, None);
        for term in terms {
            if Band::of(term).is_some() {
                diagonal = Some(diagonal.map_or_else(|| term.clone(), |sum| &sum + term));
            } else if sweep.replace(term).is_some() {
                return Err(self.no_inverse("two of its terms are sweeps over the tree"));
            }
        }
        let sweep = sweep.ok_or_else(|| self.no_inverse("no term is a sweep from the tips to the base"))?;
        let diagonal = diagonal.ok_or_else(|| self.no_inverse("no term is diagonal"))?;
        let blocks = Band::of(&diagonal)
            .and_then(Band::into_diagonal)
            .ok_or_else(|| self.no_inverse("beside the sweep there are edges"))?;
        let is_one = diagonal.is_identity();
        let delta_inverse = if is_one {
            diagonal.clone()
        } else {
            diagonal.unnamed("Δ⁻¹", Leaf::Diagonal(self.inverse_blocks(&blocks)?))
        };
        let (scale, product) = match &sweep.node {
            Node::Scaled(s, a) => (*s, &**a),
            _ => (T::one(), sweep),
        };
        let factors = product.factors();
        let is_resolvent = |a: &Self| match &a.node {
            Node::Leaf { leaf, adjoint: false, .. } => matches!(**leaf, Leaf::Resolvent(_)),
            _ => false,
        };
        let at = factors
            .iter()
            .position(is_resolvent)
            .ok_or_else(|| self.no_inverse("no factor sweeps from the tips to the base"))?;
        let phi = &factors[at];
        let u = Self::product(&factors[..at], phi.rows()).scaled(scale);
        let v = Self::product(&factors[at + 1..], phi.columns());
        let between = &(&v * &delta_inverse) * &u;
        let middle = phi.inverse()? + &between;
        if Band::of(&middle).is_none() {
            let why = format!("`{between}` is neither one block a node nor one block an edge");
            return Err(self.no_inverse(&why));
        }
        let psi = middle.inverse()?;
        let left = &(&delta_inverse * &u) * &psi;
        Ok(&delta_inverse - &(&left * &(&v * &delta_inverse)))
    }
}

/// Gauss–Jordan elimination with row pivoting; the pivot where it stopped is the error.
fn inverse_of_block<T: Real>(block: DMatrixView<'_, T>) -> Result<DMatrix<T>, f64> {
    let n = block.nrows();
    let (mut a, mut inverse) = (block.into_owned(), DMatrix::identity(n, n));
    let scale = block.iter().fold(T::zero(), |m, x| m.larger(x.abs())).to_f64();
    for j in 0..n {
        let best = (j..n).max_by(|&i, &k| a[(i, j)].abs().to_f64().total_cmp(&a[(k, j)].abs().to_f64()));
        let best = best.unwrap_or(j);
        let pivot = a[(best, j)];
        if !pivot.is_finite() || pivot.abs().to_f64() <= scale * f64::MIN_POSITIVE {
            return Err(pivot.to_f64());
        }
        a.swap_rows(j, best);
        inverse.swap_rows(j, best);
        let reciprocal = pivot.recip();
        for m in [&mut a, &mut inverse] {
            for c in 0..n {
                m[(j, c)] *= reciprocal;
            }
        }
        for i in (0..n).filter(|&i| i != j) {
            let factor = a[(i, j)];
            for m in [&mut a, &mut inverse] {
                for c in 0..n {
                    let x = m[(j, c)];
                    m[(i, c)] -= factor * x;
                }
            }
        }
    }
    Ok(inverse)
}
