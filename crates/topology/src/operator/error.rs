//! What can be wrong with an operator.

use super::Operator;
use std::fmt;

/// An operator that cannot be made or evaluated.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum OperatorError {
    /// Another number of blocks than nodes.
    Count {
        /// The operator.
        name: String,
        /// How many nodes there are.
        expected: usize,
        /// How many blocks were given.
        found: usize,
    },
    /// A block has another shape than its place.
    Block {
        /// The operator.
        name: String,
        /// The block.
        block: usize,
        /// Rows and columns of its place.
        expected: (usize, usize),
        /// Rows and columns that it has.
        found: (usize, usize),
    },
    /// A pick-off at a node that does not exist.
    Node {
        /// The operator.
        name: String,
        /// The node.
        node: usize,
        /// How many there are.
        nodes: usize,
    },
    /// A product or sum of operators between other spaces.
    Spaces {
        /// The left operator and its rows and columns.
        left: String,
        /// The right operator and its rows and columns.
        right: String,
    },
    /// A vector of another length.
    Length {
        /// The operator.
        expression: String,
        /// Numbers in its columns.
        expected: usize,
        /// Numbers given.
        found: usize,
    },
    /// A resolvent of what is not one block an edge.
    NotEdges {
        /// The operator.
        expression: String,
    },
    /// A block diagonal is needed and something else was given.
    NotDiagonal {
        /// The operator.
        expression: String,
    },
    /// No identity gives the inverse of this expression.
    NoInverse {
        /// The operator.
        expression: String,
        /// What was tried last.
        why: String,
    },
    /// A block that must be inverted is singular.
    Singular {
        /// The operator.
        expression: String,
        /// The node.
        node: usize,
        /// The pivot where elimination stopped.
        pivot: f64,
    },
}

impl OperatorError {
    /// Two operators whose spaces do not fit.
    pub(super) fn spaces<T: phipsi_spatial::Real>(left: &Operator<T>, right: &Operator<T>) -> Self {
        let side = |a: &Operator<T>| format!("`{a}` (rows: {}; columns: {})", a.rows(), a.columns());
        OperatorError::Spaces { left: side(left), right: side(right) }
    }
}

impl fmt::Display for OperatorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            OperatorError::Count { name, expected, found } => {
                write!(f, "operator `{name}` has {found} blocks where {expected} nodes need one each")
            }
            OperatorError::Block { name, block, expected, found } => write!(
                f,
                "block {block} of operator `{name}` is {} × {}, its place {} × {}",
                found.0, found.1, expected.0, expected.1
            ),
            OperatorError::Node { name, node, nodes } => {
                write!(f, "operator `{name}` picks node {node}, but there are {nodes} nodes, counted from 0")
            }
            OperatorError::Spaces { left, right } => {
                write!(
                    f,
                    "{left} and {right} do not fit: a product needs the columns of the left to be the rows of the right, a sum equal rows and columns"
                )
            }
            OperatorError::Length { expression, expected, found } => {
                write!(f, "`{expression}` acts on {expected} numbers, given were {found}")
            }
            OperatorError::NotEdges { expression } => {
                write!(
                    f,
                    "`{expression}` is not one block an edge of the tree, as the resolvent (I − E)⁻¹ needs"
                )
            }
            OperatorError::NotDiagonal { expression } => {
                write!(f, "`{expression}` is not one block a node, as the recursion needs")
            }
            OperatorError::NoInverse { expression, why } => {
                write!(
                    f,
                    "no identity gives the inverse of `{expression}` as sweeps: {why}; small ones can be inverted as dense matrices"
                )
            }
            OperatorError::Singular { expression, node, pivot } => {
                write!(
                    f,
                    "`{expression}` has no inverse: the block of node {node} is singular (pivot {pivot:e})"
                )
            }
        }
    }
}

impl std::error::Error for OperatorError {}
