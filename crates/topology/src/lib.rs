//! Trees of bodies: spanning trees of graphs, and the gather and scatter operations of paper 2 §3.1 over any blocks.
//!
//! Storage is parents before children, so that tip to base is a reverse loop; the papers number tip = 1 … base = N.

pub mod graph;
pub mod tree;

pub use graph::{Edge, SpanningTree, TreeEdge, spanning_tree};
pub use tree::{Tree, TreeError};
