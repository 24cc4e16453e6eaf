//! The two Lyapunov recursions along a tree: what composite bodies and costates' covariances are made of.
//!
//! | operator | recursion | source |
//! |---|---|---|
//! | R, inward | R(p) = M(p) + Σ over children E(p,k) R(k) E*(p,k) | paper 1 (6.2), paper 2 (4.12) |
//! | Υ, Q, outward | Υ(k) = E*(p,k) Υ(p) E(p,k) + N(k) | paper 1 (10.2), paper 2 (4.10), (4.19) |
//!
//! R = E R E* + M holds on chains and trees. E* Υ E has blocks between siblings, so that Υ is the diagonal of its solution
//! on trees and the whole of it on chains only.

use super::band::Band;
use super::blocks::Blocks;
use super::leaf::Leaf;
use super::{Operator, OperatorError};
use phipsi_spatial::Real;
use std::ops::AddAssign;

impl<T: Real> Operator<T> {
    /// The block diagonal R with R = E R E* + M. `edges`: E, one block an edge; `source`: M, one block a node. Cost O(n).
    ///
    /// # Errors
    /// [`OperatorError::NotEdges`], [`OperatorError::NotDiagonal`] if the arguments are other operators.
    pub fn inward_composite(name: &str, edges: &Self, source: &Self) -> Result<Self, OperatorError> {
        let (edges, mut blocks, space) = parts(edges, source)?;
        for k in (0..blocks.len()).rev() {
            if let Some(p) = edges.tree.parent(k) {
                let e = edges.blocks.get(k);
                let moved = e * blocks.get(k) * e.transpose();
                blocks.get_mut(p).add_assign(&moved);
            }
        }
        Ok(Self::leaf(name, &space, &space, Leaf::Diagonal(blocks)))
    }
    /// The block diagonal Υ with Υ(k) = E*(p,k) Υ(p) E(p,k) + N(k), Υ = N at the roots. Arguments, cost and errors as
    /// [`Operator::inward_composite`].
    ///
    /// # Errors
    /// As [`Operator::inward_composite`].
    pub fn outward_composite(name: &str, edges: &Self, source: &Self) -> Result<Self, OperatorError> {
        let (edges, mut blocks, space) = parts(edges, source)?;
        for k in 0..blocks.len() {
            if let Some(p) = edges.tree.parent(k) {
                let e = edges.blocks.get(k);
                let moved = e.transpose() * blocks.get(p) * e;
                blocks.get_mut(k).add_assign(&moved);
            }
        }
        Ok(Self::leaf(name, &space, &space, Leaf::Diagonal(blocks)))
    }
}

type Parts<T> = (super::leaf::Edges<T>, Blocks<T>, super::Space);

fn parts<T: Real>(edges: &Operator<T>, source: &Operator<T>) -> Result<Parts<T>, OperatorError> {
    (&(edges * source) * &edges.adjoint()).check()?;
    let not_edges = || OperatorError::NotEdges { expression: edges.to_string() };
    let blocks = Band::of(edges).and_then(Band::into_edges).ok_or_else(not_edges)?;
    let diagonal = Band::of(source)
        .and_then(Band::into_diagonal)
        .ok_or_else(|| OperatorError::NotDiagonal { expression: source.to_string() })?;
    Ok((blocks, diagonal, source.rows().clone()))
}
