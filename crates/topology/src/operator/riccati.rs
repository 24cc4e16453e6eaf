//! The innovations factorisation of H φ M φ* H* by the Riccati equation.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | P(k) | M(k) + Σ over children E P⁺ E* | paper 1 (9.5), paper 2 (2.4) corrected |
//! | D | H P H* | paper 1 (9.6) |
//! | G | P H* D⁻¹ | paper 1 (9.6) corrected |
//! | τ̄ | I − G H; P⁺ = τ̄ P | paper 1 (9.4) |
//! | K | E G | paper 2 table 1 |
//! | ψ | (I − E τ̄)⁻¹ | paper 2 (2.5) |

use super::band::Band;
use super::blocks::Blocks;
use super::leaf::{Edges, Leaf};
use super::{Node, Operator, OperatorError};
use nalgebra::{DMatrix, DMatrixView};
use phipsi_spatial::Real;
use std::ops::AddAssign;

/// H φ M φ* H* = (I + H φ K) D (I + H φ K)*, and what the factors are made of.
#[derive(Clone, Debug)]
pub struct Innovations<T> {
    /// H.
    pub hinge: Operator<T>,
    /// φ.
    pub phi: Operator<T>,
    /// P, one block a node.
    pub articulated: Operator<T>,
    /// D, one block a node.
    pub pivots: Operator<T>,
    /// D⁻¹.
    pub inverse_pivots: Operator<T>,
    /// G, one block a node.
    pub gain: Operator<T>,
    /// τ̄ = I − G H.
    pub tau_bar: Operator<T>,
    /// K = E G.
    pub shifted_gain: Operator<T>,
    /// E_ψ = E τ̄.
    pub e_psi: Operator<T>,
    /// ψ = (I − E τ̄)⁻¹.
    pub psi: Operator<T>,
}

impl<T: Real> Innovations<T> {
    /// Solves the Riccati equation of `hinge` · (I − `edges`)⁻¹ · `inertia`, tip to base. `hinge` and `inertia` are one block a
    /// node, `inertia` symmetric. Cost O(n), cubic in the size of a block.
    ///
    /// # Errors
    /// [`OperatorError::Singular`] if a D is not positive definite; [`OperatorError::NotEdges`],
    /// [`OperatorError::NotDiagonal`] if the arguments are other operators; [`OperatorError::Spaces`] if they do not fit.
    pub fn new(
        hinge: &Operator<T>,
        edges: &Operator<T>,
        inertia: &Operator<T>,
    ) -> Result<Self, OperatorError> {
        let phi = Operator::resolvent("φ", edges)?;
        Self::of(hinge, &phi, inertia)
    }
    pub(super) fn of(
        hinge: &Operator<T>,
        phi: &Operator<T>,
        inertia: &Operator<T>,
    ) -> Result<Self, OperatorError> {
        let expression = &(&(hinge * phi) * inertia) * &(&phi.adjoint() * &hinge.adjoint());
        expression.check()?;
        let not_diagonal = |a: &Operator<T>| OperatorError::NotDiagonal { expression: a.to_string() };
        let diagonal = |a| Band::of(a).and_then(Band::into_diagonal).ok_or_else(|| not_diagonal(a));
        let (H, M) = (diagonal(hinge)?, diagonal(inertia)?);
        let edges = edges_of(phi).ok_or_else(|| OperatorError::NotEdges { expression: phi.to_string() })?;
        let n = H.len();
        let mut P = M;
        // Blocks in the order of the nodes, whatever the order of the sweep.
        let empty = |shape: &dyn Fn(usize) -> (usize, usize)| {
            let numbers = (0..n).map(|k| shape(k).0 * shape(k).1).sum();
            let mut blocks = Blocks::with_capacity(n, numbers);
            (0..n).map(shape).for_each(|(rows, columns)| blocks.push_empty(rows, columns));
            blocks
        };
        let (state, joint) = (phi.rows(), hinge.rows());
        let pivots = empty(&|k| (joint.size(k), joint.size(k)));
        let (mut D, mut D_inverse) = (pivots.clone(), pivots);
        let mut G = empty(&|k| (state.size(k), joint.size(k)));
        let mut tau_bar = empty(&|k| (state.size(k), state.size(k)));
        for k in (0..n).rev() {
            let column = P.get(k) * H.get(k).transpose();
            let pivot = symmetric(&(H.get(k) * &column));
            let inverse = inverse_of_positive(&pivot).map_err(|pivot| OperatorError::Singular {
                expression: expression.to_string(),
                node: k,
                pivot,
            })?;
            let gain = &column * &inverse;
            if let Some(p) = edges.tree.parent(k) {
                let through = symmetric(&(P.get(k) - &gain * column.transpose()));
                let e = edges.blocks.get(k);
                let moved = symmetric(&(e * through * e.transpose()));
                P.get_mut(p).add_assign(&moved);
            }
            let size = state.size(k);
            tau_bar.get_mut(k).copy_from(&(DMatrix::identity(size, size) - &gain * H.get(k)));
            D.get_mut(k).copy_from(&pivot);
            D_inverse.get_mut(k).copy_from(&inverse);
            G.get_mut(k).copy_from(&gain);
        }
        let shifted = |blocks: &Blocks<T>| {
            let block = |(k, block): (usize, DMatrixView<'_, T>)| match edges.tree.parent(k) {
                Some(_) => edges.blocks.get(k) * block,
                None => DMatrix::from_element(0, 0, T::zero()),
            };
            Edges { tree: edges.tree.clone(), blocks: blocks.iter().enumerate().map(block).collect() }
        };
        let (K, E_psi) = (shifted(&G), shifted(&tau_bar));
        Ok(Innovations {
            hinge: hinge.clone(),
            phi: phi.clone(),
            articulated: Operator::leaf("P", state, state, Leaf::Diagonal(P)),
            pivots: Operator::leaf("D", joint, joint, Leaf::Diagonal(D)),
            inverse_pivots: Operator::leaf("D⁻¹", joint, joint, Leaf::Diagonal(D_inverse)),
            gain: Operator::leaf("G", state, joint, Leaf::Diagonal(G)),
            tau_bar: Operator::leaf("τ̄", state, state, Leaf::Diagonal(tau_bar)),
            shifted_gain: Operator::leaf("K", state, joint, Leaf::Edges(K)),
            psi: Operator::leaf("ψ", state, state, Leaf::Resolvent(E_psi.clone())),
            e_psi: Operator::leaf("E_ψ", state, state, Leaf::Edges(E_psi)),
        })
    }
    /// I + H φ K.
    pub fn factor(&self) -> Operator<T> {
        Operator::identity(self.hinge.rows()) + &(&self.hinge * &self.phi) * &self.shifted_gain
    }
    /// L = I − H ψ K, the inverse of the factor.
    pub fn inverse_factor(&self) -> Operator<T> {
        Operator::identity(self.hinge.rows()) - &(&self.hinge * &self.psi) * &self.shifted_gain
    }
    /// L* D⁻¹ L.
    pub fn inverse(&self) -> Operator<T> {
        let l = self.inverse_factor();
        &(&l.adjoint() * &self.inverse_pivots) * &l
    }
}

/// E of (I − E)⁻¹.
fn edges_of<T: Real>(phi: &Operator<T>) -> Option<&Edges<T>> {
    match &phi.node {
        Node::Leaf { leaf, adjoint: false, .. } => match &**leaf {
            Leaf::Resolvent(edges) => Some(edges),
            _ => None,
        },
        _ => None,
    }
}

impl<T: Real> Operator<T> {
    /// The innovations factorisation of an expression H φ M φ* H*, where H and M are one block a node or products that give it.
    ///
    /// # Errors
    /// [`OperatorError::NoInverse`] for other expressions; [`OperatorError::Singular`] if it is not positive definite.
    pub fn innovations(&self) -> Result<Innovations<T>, OperatorError> {
        self.check()?;
        let factors = self.factors();
        let why = "it has not the form H φ M φ* H*";
        let other = || OperatorError::NoInverse { expression: self.to_string(), why: why.into() };
        let at = factors.iter().position(|a| edges_of(a).is_some()).ok_or_else(other)?;
        let last = factors.len() - 1 - at;
        let palindrome =
            at < last && (0..=at).all(|i| factors[i].adjoint().is_same(&factors[factors.len() - 1 - i]));
        if !palindrome {
            return Err(other());
        }
        let phi = &factors[at];
        let hinge = Self::product(&factors[..at], phi.rows());
        let inertia = Self::product(&factors[at + 1..last], phi.columns());
        Innovations::of(&hinge, phi, &inertia)
    }
}

/// (A + A*)/2.
fn symmetric<T: Real>(a: &DMatrix<T>) -> DMatrix<T> {
    let half = T::splat(0.5);
    DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| (a[(i, j)] + a[(j, i)]) * half)
}

/// A⁻¹ by L D L*; the pivot that is not positive is the error.
fn inverse_of_positive<T: Real>(a: &DMatrix<T>) -> Result<DMatrix<T>, f64> {
    let n = a.nrows();
    // Columns of L⁻¹ beside the elimination: A⁻¹ = L^−* D⁻¹ L⁻¹.
    let (mut rest, mut l) = (a.clone(), DMatrix::<T>::identity(n, n));
    let mut pivots = Vec::with_capacity(n);
    for j in 0..n {
        let pivot = rest[(j, j)];
        if !pivot.is_positive() {
            return Err(pivot.to_f64());
        }
        pivots.push(pivot);
        for i in j + 1..n {
            let factor = rest[(i, j)] / pivot;
            for c in 0..n {
                let (x, y) = (rest[(j, c)], l[(j, c)]);
                rest[(i, c)] -= factor * x;
                l[(i, c)] -= factor * y;
            }
        }
    }
    let entry = |i: usize, j: usize| (0..n).fold(T::zero(), |sum, k| sum + l[(k, i)] * l[(k, j)] / pivots[k]);
    Ok(DMatrix::from_fn(n, n, entry))
}
