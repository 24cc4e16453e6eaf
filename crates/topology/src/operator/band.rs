//! Expressions that are one block a node plus one block an edge: Δ + E, with their blocks worked out.
//!
//! Products and sums of diagonals and edges give such operators as long as no two edges follow each other. Inverses rest on
//! them: I − E_φ + K H is the inverse of ψ because K H is one block an edge again.

use super::blocks::Blocks;
use super::leaf::{Edges, Leaf};
use super::{Node, Operator};
use nalgebra::{DMatrix, DMatrixView};
use phipsi_spatial::Real;

/// Δ + E.
#[derive(Clone, Debug)]
pub(super) struct Band<T> {
    pub(super) diagonal: Option<Blocks<T>>,
    pub(super) edges: Option<Edges<T>>,
}

impl<T: Real> Band<T> {
    /// The expression as Δ + E, if it is one.
    pub(super) fn of(operator: &Operator<T>) -> Option<Self> {
        match &operator.node {
            Node::Leaf { leaf, adjoint, .. } => match (&**leaf, adjoint) {
                (Leaf::Identity, _) => {
                    let rows = &operator.rows;
                    let one = |k| DMatrix::identity(rows.size(k), rows.size(k));
                    Some(Band { diagonal: Some((0..rows.blocks()).map(one).collect()), edges: None })
                }
                (Leaf::Diagonal(blocks), false) => Some(Band { diagonal: Some(blocks.clone()), edges: None }),
                (Leaf::Diagonal(blocks), true) => {
                    let blocks = blocks.iter().map(|block| block.transpose()).collect();
                    Some(Band { diagonal: Some(blocks), edges: None })
                }
                (Leaf::Edges(edges), false) => Some(Band { diagonal: None, edges: Some(edges.clone()) }),
                _ => None,
            },
            Node::Scaled(s, a) => Some(Self::of(a)?.map(|block| block * *s)),
            Node::Sum(terms) => {
                let (first, rest) = terms.split_first()?;
                rest.iter().try_fold(Self::of(first)?, |sum, term| sum.plus(Self::of(term)?))
            }
            Node::Product(factors) => {
                let (first, rest) = factors.split_first()?;
                rest.iter().try_fold(Self::of(first)?, |product, factor| product.times(&Self::of(factor)?))
            }
            Node::Mismatch(_) => None,
        }
    }
    /// Its edges, if it is nothing else.
    pub(super) fn into_edges(self) -> Option<Edges<T>> {
        if self.diagonal.is_some() { None } else { self.edges }
    }
    /// Its diagonal, if it is nothing else.
    pub(super) fn into_diagonal(self) -> Option<Blocks<T>> {
        if self.edges.is_some() { None } else { self.diagonal }
    }

    fn map(self, f: impl Fn(DMatrixView<'_, T>) -> DMatrix<T>) -> Self {
        let all = |blocks: &Blocks<T>| blocks.iter().map(&f).collect();
        Band {
            diagonal: self.diagonal.map(|blocks| all(&blocks)),
            edges: self.edges.map(|e| Edges { blocks: all(&e.blocks), tree: e.tree }),
        }
    }
    fn plus(self, other: Self) -> Option<Self> {
        let sum = |a: &Blocks<T>, b: &Blocks<T>| a.iter().zip(b.iter()).map(|(a, b)| a + b).collect();
        let diagonal = match (self.diagonal, other.diagonal) {
            (Some(a), Some(b)) => Some(sum(&a, &b)),
            (a, b) => a.or(b),
        };
        let edges = match (self.edges, other.edges) {
            (Some(a), Some(b)) if a.tree == b.tree => {
                Some(Edges { blocks: sum(&a.blocks, &b.blocks), tree: a.tree })
            }
            (Some(_), Some(_)) => return None,
            (a, b) => a.or(b),
        };
        Some(Band { diagonal, edges })
    }
    /// (Δ + E)(Δ' + E'), unless edges follow edges.
    fn times(self, right: &Self) -> Option<Self> {
        if self.edges.is_some() && right.edges.is_some() {
            return None;
        }
        let product = |a: &Blocks<T>, b: &Blocks<T>| a.iter().zip(b.iter()).map(|(a, b)| a * b).collect();
        let diagonal = match (&self.diagonal, &right.diagonal) {
            (Some(a), Some(b)) => Some(product(a, b)),
            _ => None,
        };
        let edges = match (&self, right) {
            (Band { edges: Some(e), .. }, Band { diagonal: Some(d), .. }) => {
                let block = |(k, d): (usize, DMatrixView<'_, T>)| match e.tree.parent(k) {
                    Some(_) => e.blocks.get(k) * d,
                    None => e.blocks.get(k).into_owned(),
                };
                Some(Edges { blocks: d.iter().enumerate().map(block).collect(), tree: e.tree.clone() })
            }
            (Band { diagonal: Some(d), .. }, Band { edges: Some(e), .. }) => {
                let block = |(k, e_block): (usize, DMatrixView<'_, T>)| match e.tree.parent(k) {
                    Some(p) => d.get(p) * e_block,
                    None => e_block.into_owned(),
                };
                Some(Edges { blocks: e.blocks.iter().enumerate().map(block).collect(), tree: e.tree.clone() })
            }
            _ => None,
        };
        Some(Band { diagonal, edges })
    }
}
