//! Operators that hold blocks, and the sweeps that apply them.
//!
//! | leaf | y = A x | y = A* x |
//! |---|---|---|
//! | diagonal | y(k) = A(k) x(k) | y(k) = A*(k) x(k) |
//! | edges E | y(p) = Σ over children E(p,k) x(k) | y(k) = E*(p,k) x(p) |
//! | resolvent (I − E)⁻¹ | y(p) = x(p) + Σ E(p,k) y(k), tip to base | y(k) = x(k) + E*(p,k) y(p), base to tip |
//! | pick-off | y(node j) = Σ A(j) x(j) | y(j) = A*(j) x(node j) |

use super::Space;
use super::blocks::Blocks;
use crate::Tree;
use phipsi_spatial::Real;
use std::sync::Arc;

/// One block E(p, k) for every node k that has a parent p: rows of p, columns of k.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Edges<T> {
    pub(crate) tree: Arc<Tree>,
    /// By child; empty at roots.
    pub(crate) blocks: Blocks<T>,
}

/// An operator that holds numbers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Leaf<T> {
    Identity,
    Diagonal(Blocks<T>),
    Edges(Edges<T>),
    Resolvent(Edges<T>),
    /// Column block j stands in the rows of node `nodes[j]`.
    PickOff {
        nodes: Vec<usize>,
        blocks: Blocks<T>,
    },
}

/// y += A x; A: its rows, at least one, and its numbers.
fn multiply_add<T: Real>((rows, a): (usize, &[T]), x: &[T], y: &mut [T]) {
    for (column, &x) in a.chunks_exact(rows).zip(x) {
        for (y, &a) in y.iter_mut().zip(column) {
            *y += a * x;
        }
    }
}

/// y += A* x; A: its rows, at least one, and its numbers.
fn transpose_multiply_add<T: Real>((rows, a): (usize, &[T]), x: &[T], y: &mut [T]) {
    for (column, y) in a.chunks_exact(rows).zip(y) {
        *y = column.iter().zip(x).fold(*y, |sum, (&a, &x)| sum + a * x);
    }
}

/// Two blocks of one vector, the first to read and the second to write.
fn from_to<T>(y: &mut [T], from: std::ops::Range<usize>, to: std::ops::Range<usize>) -> (&[T], &mut [T]) {
    if from.start < to.start {
        let (low, high) = y.split_at_mut(to.start);
        (&low[from], &mut high[..to.end - to.start])
    } else {
        let (low, high) = y.split_at_mut(from.start);
        (&high[..from.end - from.start], &mut low[to])
    }
}

impl<T: Real> Leaf<T> {
    /// A x; `rows` and `columns` are those of A.
    pub(crate) fn apply(&self, rows: &Space, columns: &Space, x: &[T]) -> Vec<T> {
        let mut y = match self {
            Leaf::Identity | Leaf::Resolvent(_) => x.to_vec(),
            _ => vec![T::zero(); rows.dimension()],
        };
        match self {
            Leaf::Identity => {}
            Leaf::Diagonal(blocks) => {
                for k in 0..blocks.len() {
                    let a = blocks.columns(k);
                    multiply_add(a, &x[columns.range(k)], &mut y[rows.range(k)]);
                }
            }
            Leaf::Edges(edges) => {
                for k in 0..edges.blocks.len() {
                    let a = edges.blocks.columns(k);
                    if let Some(p) = edges.tree.parent(k) {
                        multiply_add(a, &x[columns.range(k)], &mut y[rows.range(p)]);
                    }
                }
            }
            Leaf::Resolvent(edges) => {
                for k in (0..edges.blocks.len()).rev() {
                    let a = edges.blocks.columns(k);
                    if let Some(p) = edges.tree.parent(k) {
                        let (child, parent) = from_to(&mut y, rows.range(k), rows.range(p));
                        multiply_add(a, child, parent);
                    }
                }
            }
            Leaf::PickOff { nodes, blocks } => {
                for (j, &k) in nodes.iter().enumerate() {
                    let a = blocks.columns(j);
                    multiply_add(a, &x[columns.range(j)], &mut y[rows.range(k)]);
                }
            }
        }
        y
    }

    /// A* x; `rows` and `columns` are those of A.
    pub(crate) fn apply_adjoint(&self, rows: &Space, columns: &Space, x: &[T]) -> Vec<T> {
        let mut y = match self {
            Leaf::Identity | Leaf::Resolvent(_) => x.to_vec(),
            _ => vec![T::zero(); columns.dimension()],
        };
        match self {
            Leaf::Identity => {}
            Leaf::Diagonal(blocks) => {
                for k in 0..blocks.len() {
                    let a = blocks.columns(k);
                    transpose_multiply_add(a, &x[rows.range(k)], &mut y[columns.range(k)]);
                }
            }
            Leaf::Edges(edges) => {
                for k in 0..edges.blocks.len() {
                    let a = edges.blocks.columns(k);
                    if let Some(p) = edges.tree.parent(k) {
                        transpose_multiply_add(a, &x[rows.range(p)], &mut y[columns.range(k)]);
                    }
                }
            }
            Leaf::Resolvent(edges) => {
                for k in 0..edges.blocks.len() {
                    let a = edges.blocks.columns(k);
                    if let Some(p) = edges.tree.parent(k) {
                        let (parent, child) = from_to(&mut y, rows.range(p), rows.range(k));
                        transpose_multiply_add(a, parent, child);
                    }
                }
            }
            Leaf::PickOff { nodes, blocks } => {
                for (j, &k) in nodes.iter().enumerate() {
                    let a = blocks.columns(j);
                    transpose_multiply_add(a, &x[rows.range(k)], &mut y[columns.range(j)]);
                }
            }
        }
        y
    }

    /// Multiplications and additions of one application.
    pub(crate) fn cost(&self) -> u64 {
        let of = |blocks: &Blocks<T>| 2 * blocks.numbers() as u64;
        match self {
            Leaf::Identity => 0,
            Leaf::Diagonal(blocks) | Leaf::PickOff { blocks, .. } => of(blocks),
            Leaf::Edges(edges) | Leaf::Resolvent(edges) => of(&edges.blocks),
        }
    }
}
