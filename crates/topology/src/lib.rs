//! Trees of bodies: spanning trees of graphs, and the gather and scatter operations of paper 2 §3.1 over any blocks.
//!
//! [`Operator`] is an expression of operators over a tree: (I − E)⁻¹, block diagonals, pick-offs, their products, sums, adjoints
//! and inverses. It is evaluated as sweeps.
//!
//! Storage is parents before children, so that tip to base is a reverse loop; the papers number tip = 1 … base = N.

// Recursions carry the papers' symbols: P, D, G, H, M.
#![allow(non_snake_case)]

pub mod graph;
pub mod operator;
pub mod tree;

pub use graph::{Edge, SpanningTree, TreeEdge, spanning_tree};
pub use operator::{Innovations, Operator, OperatorError, Space};
pub use tree::{Tree, TreeError};
