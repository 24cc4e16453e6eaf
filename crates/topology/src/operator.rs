//! Operators over a tree: expressions that stay sweeps until they are applied.
//!
//! | operator | meaning | cost of an application | source |
//! |---|---|---|---|
//! | [`Operator::identity`] | I | 0 | |
//! | [`Operator::diagonal`] | one block a node: H, M, P, D, G | O(n) | paper 2 (2.3) |
//! | [`Operator::edges`] | one block an edge, from a node to its parent: E_φ, E_ψ, K | O(n) | paper 2 (2.1) |
//! | [`Operator::resolvent`] | (I − E)⁻¹, the inward sweep; its adjoint is the outward sweep: φ, ψ | O(n) | paper 2 (2.2), (3.6), (3.7) |
//! | [`Operator::pick_off`] | blocks at chosen nodes: B | O(1) a node | paper 2 §2.7 |
//!
//! Products, sums, multiples and adjoints of operators are operators; none forms a matrix, and an application costs the sum of
//! its factors'. Inverses exist where an identity provides one ([`Operator::inverse`]). Blocks may have any sizes: this crate
//! knows no physics.
//!
//! ```
//! use nalgebra::DMatrix;
//! use phipsi_topology::{Operator, Space, Tree};
//! use std::sync::Arc;
//! // A root with two children: what the children have is passed on doubled.
//! let tree = Arc::new(Tree::new(vec![None, Some(0), Some(0)])?);
//! let space = Space::uniform(3, 1);
//! let doubled = DMatrix::from_element(1, 1, 2.0);
//! let edges = Operator::edges("E", &tree, &space, &space, vec![DMatrix::zeros(0, 0), doubled.clone(), doubled])?;
//! let phi = Operator::resolvent("φ", &edges)?;
//! assert_eq!(phi.apply(&[1.0, 10.0, 100.0])?, [221.0, 10.0, 100.0]);
//! assert_eq!(phi.adjoint().apply(&[1.0, 10.0, 100.0])?, [1.0, 12.0, 102.0]);
//! let back = phi.inverse()?; // I − E, without forming a matrix
//! assert_eq!((&back * &phi).apply(&[1.0, 10.0, 100.0])?, [1.0, 10.0, 100.0]);
//! assert_eq!(format!("{}", &phi * &phi.adjoint()), "φ φ*");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod band;
mod blocks;
mod composite;
mod error;
mod inverse;
mod leaf;
mod riccati;
mod show;
mod space;

pub use error::OperatorError;
pub use riccati::Innovations;
pub use space::Space;

use crate::Tree;
use leaf::{Edges, Leaf};
use nalgebra::DMatrix;
use phipsi_spatial::Real;
use std::ops::{Add, Mul, Neg, Sub};
use std::sync::Arc;

/// A linear map between two spaces, as an expression. Cheap to copy.
#[derive(Clone, Debug)]
pub struct Operator<T> {
    rows: Space,
    columns: Space,
    node: Node<T>,
}

#[derive(Clone, Debug)]
enum Node<T> {
    Leaf {
        name: Arc<str>,
        leaf: Arc<Leaf<T>>,
        adjoint: bool,
    },
    Scaled(T, Arc<Operator<T>>),
    Sum(Arc<[Operator<T>]>),
    Product(Arc<[Operator<T>]>),
    /// A product or sum whose spaces do not fit: every evaluation returns the error.
    Mismatch(Arc<OperatorError>),
}

impl<T: Real> Operator<T> {
    fn leaf(name: &str, rows: &Space, columns: &Space, leaf: Leaf<T>) -> Self {
        let node = Node::Leaf { name: name.into(), leaf: Arc::new(leaf), adjoint: false };
        Operator { rows: rows.clone(), columns: columns.clone(), node }
    }
    /// I.
    pub fn identity(space: &Space) -> Self {
        Self::leaf("I", space, space, Leaf::Identity)
    }
    /// One block a node: block k has the rows of node k in `rows` and its columns in `columns`.
    ///
    /// # Errors
    /// [`OperatorError::Block`] if a block has another shape or is missing.
    pub fn diagonal(
        name: &str,
        rows: &Space,
        columns: &Space,
        blocks: Vec<DMatrix<T>>,
    ) -> Result<Self, OperatorError> {
        check_count(name, rows.blocks(), blocks.len())?;
        check_count(name, columns.blocks(), blocks.len())?;
        for (k, block) in blocks.iter().enumerate() {
            check_block(name, k, (rows.size(k), columns.size(k)), block)?;
        }
        Ok(Self::leaf(name, rows, columns, Leaf::Diagonal(blocks.into_iter().collect())))
    }
    /// One block an edge, given by its child: E(p, k) has the rows of the parent p and the columns of k. A root's is ignored.
    ///
    /// # Errors
    /// As [`Operator::diagonal`].
    pub fn edges(
        name: &str,
        tree: &Arc<Tree>,
        rows: &Space,
        columns: &Space,
        mut blocks: Vec<DMatrix<T>>,
    ) -> Result<Self, OperatorError> {
        check_count(name, tree.len(), blocks.len())?;
        check_count(name, rows.blocks(), blocks.len())?;
        check_count(name, columns.blocks(), blocks.len())?;
        for (k, block) in blocks.iter_mut().enumerate() {
            match tree.parent(k) {
                Some(p) => check_block(name, k, (rows.size(p), columns.size(k)), block)?,
                None => *block = DMatrix::from_element(0, 0, T::zero()),
            }
        }
        let blocks = blocks.into_iter().collect();
        Ok(Self::leaf(name, rows, columns, Leaf::Edges(Edges { tree: tree.clone(), blocks })))
    }
    /// (I − E)⁻¹ of an operator that is edges, or a product or sum that gives edges.
    ///
    /// # Errors
    /// [`OperatorError::NotEdges`] if it is something else; [`OperatorError::Spaces`] if its rows are not its columns.
    pub fn resolvent(name: &str, edges: &Self) -> Result<Self, OperatorError> {
        if edges.rows != edges.columns {
            return Err(OperatorError::spaces(edges, edges));
        }
        let not = || OperatorError::NotEdges { expression: edges.to_string() };
        let blocks = band::Band::of(edges).and_then(band::Band::into_edges).ok_or_else(not)?;
        Ok(Self::leaf(name, &edges.rows, &edges.columns, Leaf::Resolvent(blocks)))
    }
    /// Blocks at chosen nodes: block j has the rows of node `nodes[j]` and any number of columns. What acts at points
    /// becomes what acts on nodes.
    ///
    /// # Errors
    /// As [`Operator::diagonal`]; [`OperatorError::Node`] if there is no such node.
    pub fn pick_off(
        name: &str,
        rows: &Space,
        nodes: Vec<usize>,
        blocks: Vec<DMatrix<T>>,
    ) -> Result<Self, OperatorError> {
        check_count(name, nodes.len(), blocks.len())?;
        for (j, (block, &k)) in blocks.iter().zip(&nodes).enumerate() {
            if k >= rows.blocks() {
                return Err(OperatorError::Node { name: name.into(), node: k, nodes: rows.blocks() });
            }
            check_block(name, j, (rows.size(k), block.ncols()), block)?;
        }
        let columns = Space::new(blocks.iter().map(DMatrix::ncols));
        let blocks = blocks.into_iter().collect();
        Ok(Self::leaf(name, rows, &columns, Leaf::PickOff { nodes, blocks }))
    }

    /// What it maps to.
    pub fn rows(&self) -> &Space {
        &self.rows
    }
    /// What it maps from.
    pub fn columns(&self) -> &Space {
        &self.columns
    }
    /// The error of a product or sum whose spaces do not fit.
    ///
    /// # Errors
    /// [`OperatorError::Spaces`].
    pub fn check(&self) -> Result<(), OperatorError> {
        match &self.node {
            Node::Mismatch(error) => Err((**error).clone()),
            _ => Ok(()),
        }
    }

    /// A*: ⟨A* f, v⟩ = ⟨f, A v⟩. Of a product the adjoints in reverse order.
    pub fn adjoint(&self) -> Self {
        let node = match &self.node {
            Node::Leaf { leaf, .. } if matches!(**leaf, Leaf::Identity) => self.node.clone(),
            Node::Leaf { name, leaf, adjoint } => {
                Node::Leaf { name: name.clone(), leaf: leaf.clone(), adjoint: !adjoint }
            }
            Node::Scaled(s, a) => Node::Scaled(*s, Arc::new(a.adjoint())),
            Node::Sum(terms) => Node::Sum(terms.iter().map(Self::adjoint).collect()),
            Node::Product(factors) => Node::Product(factors.iter().rev().map(Self::adjoint).collect()),
            Node::Mismatch(error) => Node::Mismatch(error.clone()),
        };
        Operator { rows: self.columns.clone(), columns: self.rows.clone(), node }
    }
    /// s A.
    pub fn scaled(&self, s: T) -> Self {
        let node = match &self.node {
            Node::Mismatch(error) => Node::Mismatch(error.clone()),
            Node::Scaled(inner, a) => Node::Scaled(*inner * s, a.clone()),
            _ => Node::Scaled(s, Arc::new(self.clone())),
        };
        Operator { node, ..self.clone() }
    }

    /// A x. Cost [`Operator::cost`].
    ///
    /// # Errors
    /// [`OperatorError::Length`]; [`OperatorError::Spaces`] of an expression whose spaces do not fit.
    pub fn apply(&self, x: &[T]) -> Result<Vec<T>, OperatorError> {
        self.check()?;
        if x.len() != self.columns.dimension() {
            let (expected, found) = (self.columns.dimension(), x.len());
            return Err(OperatorError::Length { expression: self.to_string(), expected, found });
        }
        Ok(self.image(x))
    }
    fn image(&self, x: &[T]) -> Vec<T> {
        match &self.node {
            Node::Leaf { leaf, adjoint: false, .. } => leaf.apply(&self.rows, &self.columns, x),
            Node::Leaf { leaf, adjoint: true, .. } => leaf.apply_adjoint(&self.columns, &self.rows, x),
            Node::Scaled(s, a) => a.image(x).into_iter().map(|y| y * *s).collect(),
            Node::Sum(terms) => {
                let mut sum = terms[0].image(x);
                for term in &terms[1..] {
                    sum.iter_mut().zip(term.image(x)).for_each(|(sum, y)| *sum += y);
                }
                sum
            }
            Node::Product(factors) => {
                let (last, rest) = factors.split_last().expect("a product has factors");
                rest.iter().rev().fold(last.image(x), |y, factor| factor.image(&y))
            }
            Node::Mismatch(_) => vec![],
        }
    }
    /// The matrix, column by column: for checks and small problems. Cost: the dimension of the columns times [`Operator::cost`].
    ///
    /// # Errors
    /// [`OperatorError::Spaces`] of an expression whose spaces do not fit.
    pub fn dense(&self) -> Result<DMatrix<T>, OperatorError> {
        self.check()?;
        let (rows, columns) = (self.rows.dimension(), self.columns.dimension());
        let mut matrix = DMatrix::from_element(rows, columns, T::zero());
        let mut unit = vec![T::zero(); columns];
        for j in 0..columns {
            unit[j] = T::one();
            let image = self.image(&unit);
            unit[j] = T::zero();
            for (i, x) in image.into_iter().enumerate() {
                matrix[(i, j)] = x;
            }
        }
        Ok(matrix)
    }
    /// Multiplications and additions of one application.
    pub fn cost(&self) -> u64 {
        match &self.node {
            Node::Leaf { leaf, .. } => leaf.cost(),
            Node::Scaled(_, a) => a.cost() + self.rows.dimension() as u64,
            Node::Sum(terms) => {
                let additions = (terms.len() - 1) * self.rows.dimension();
                terms.iter().map(Self::cost).sum::<u64>() + additions as u64
            }
            Node::Product(factors) => factors.iter().map(Self::cost).sum(),
            Node::Mismatch(_) => 0,
        }
    }
    /// The same operator under another name, with its blocks worked out where it is one block a node or one block an edge.
    ///
    /// # Errors
    /// [`OperatorError::Spaces`] of an expression whose spaces do not fit.
    pub fn named(&self, name: &str) -> Result<Self, OperatorError> {
        self.check()?;
        let leaf = match band::Band::of(self) {
            Some(band::Band { diagonal: Some(blocks), edges: None }) => Leaf::Diagonal(blocks),
            Some(band::Band { diagonal: None, edges: Some(edges) }) => Leaf::Edges(edges),
            _ => return Ok(self.clone()),
        };
        Ok(Self::leaf(name, &self.rows, &self.columns, leaf))
    }
    /// The block of rows of node i and columns of node j. Cost: of one block a node or an edge nothing, else the columns of j
    /// times [`Operator::cost`].
    ///
    /// # Errors
    /// [`OperatorError::Node`]; [`OperatorError::Spaces`] of an expression whose spaces do not fit.
    pub fn block(&self, i: usize, j: usize) -> Result<DMatrix<T>, OperatorError> {
        self.check()?;
        for (node, space) in [(i, &self.rows), (j, &self.columns)] {
            if node >= space.blocks() {
                let (name, nodes) = (self.to_string(), space.blocks());
                return Err(OperatorError::Node { name, node, nodes });
            }
        }
        if let Node::Leaf { leaf, adjoint: false, .. } = &self.node {
            match &**leaf {
                Leaf::Diagonal(blocks) if i == j => return Ok(blocks.get(i).into_owned()),
                Leaf::Edges(edges) if edges.tree.parent(j) == Some(i) => {
                    return Ok(edges.blocks.get(j).into_owned());
                }
                _ => {}
            }
        }
        let (rows, columns) = (self.rows.range(i), self.columns.range(j));
        let mut block = DMatrix::from_element(rows.len(), columns.len(), T::zero());
        let mut unit = vec![T::zero(); self.columns.dimension()];
        for (c, at) in columns.enumerate() {
            unit[at] = T::one();
            let image = self.image(&unit);
            unit[at] = T::zero();
            image[rows.clone()].iter().enumerate().for_each(|(r, &x)| block[(r, c)] = x);
        }
        Ok(block)
    }
    /// The blocks of an operator that is one block a node, or a product or sum that gives one. Cost O(n).
    ///
    /// # Errors
    /// [`OperatorError::NotDiagonal`] if it is something else; [`OperatorError::Spaces`] of an expression whose spaces do not
    /// fit.
    pub fn diagonal_blocks(&self) -> Result<Vec<DMatrix<T>>, OperatorError> {
        self.check()?;
        let not = || OperatorError::NotDiagonal { expression: self.to_string() };
        band::Band::of(self).and_then(band::Band::into_diagonal).map(|b| b.to_matrices()).ok_or_else(not)
    }
    /// The blocks, by child, of an operator that is one block an edge, or a product or sum that gives one; empty at roots.
    /// Cost O(n).
    ///
    /// # Errors
    /// [`OperatorError::NotEdges`] if it is something else; [`OperatorError::Spaces`] of an expression whose spaces do not fit.
    pub fn edge_blocks(&self) -> Result<Vec<DMatrix<T>>, OperatorError> {
        self.check()?;
        let not = || OperatorError::NotEdges { expression: self.to_string() };
        band::Band::of(self)
            .and_then(band::Band::into_edges)
            .map(|edges| edges.blocks.to_matrices())
            .ok_or_else(not)
    }
    /// The factors, of which a single operator is one.
    fn factors(&self) -> &[Self] {
        match &self.node {
            Node::Product(factors) => factors,
            _ => std::slice::from_ref(self),
        }
    }
    /// The product of factors that fit; `space` for none.
    fn product(factors: &[Self], space: &Space) -> Self {
        match factors {
            [] => Self::identity(space),
            [one] => one.clone(),
            [first, .., last] => {
                let (rows, columns) = (first.rows.clone(), last.columns.clone());
                Operator { rows, columns, node: Node::Product(factors.into()) }
            }
        }
    }
    /// True for the same expression of the same leaves.
    fn is_same(&self, other: &Self) -> bool {
        let all = |a: &[Self], b: &[Self]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.is_same(b));
        match (&self.node, &other.node) {
            (Node::Leaf { leaf: a, adjoint: x, .. }, Node::Leaf { leaf: b, adjoint: y, .. }) => {
                Arc::ptr_eq(a, b) && x == y
            }
            (Node::Scaled(s, a), Node::Scaled(t, b)) => s == t && a.is_same(b),
            (Node::Sum(a), Node::Sum(b)) | (Node::Product(a), Node::Product(b)) => all(a, b),
            _ => false,
        }
    }
    fn is_identity(&self) -> bool {
        matches!(&self.node, Node::Leaf { leaf, .. } if matches!(**leaf, Leaf::Identity))
    }

    fn times(&self, right: &Self) -> Self {
        let (rows, columns) = (self.rows.clone(), right.columns.clone());
        let node = match (&self.node, &right.node) {
            (Node::Mismatch(error), _) | (_, Node::Mismatch(error)) => Node::Mismatch(error.clone()),
            _ if self.columns != right.rows => Node::Mismatch(Arc::new(OperatorError::spaces(self, right))),
            _ if self.is_identity() => return right.clone(),
            _ if right.is_identity() => return self.clone(),
            _ => Node::Product(self.factors().iter().chain(right.factors()).cloned().collect()),
        };
        Operator { rows, columns, node }
    }
    fn plus(&self, right: &Self) -> Self {
        fn terms<T>(a: &Operator<T>) -> &[Operator<T>] {
            match &a.node {
                Node::Sum(terms) => terms,
                _ => std::slice::from_ref(a),
            }
        }
        let node = match (&self.node, &right.node) {
            (Node::Mismatch(error), _) | (_, Node::Mismatch(error)) => Node::Mismatch(error.clone()),
            _ if (&self.rows, &self.columns) != (&right.rows, &right.columns) => {
                Node::Mismatch(Arc::new(OperatorError::spaces(self, right)))
            }
            _ => Node::Sum(terms(self).iter().chain(terms(right)).cloned().collect()),
        };
        Operator { node, ..self.clone() }
    }
}

fn check_count(name: &str, expected: usize, found: usize) -> Result<(), OperatorError> {
    if expected == found {
        return Ok(());
    }
    Err(OperatorError::Count { name: name.into(), expected, found })
}

fn check_block<T>(
    name: &str,
    block: usize,
    expected: (usize, usize),
    found: &DMatrix<T>,
) -> Result<(), OperatorError> {
    let found = (found.nrows(), found.ncols());
    if expected == found {
        return Ok(());
    }
    Err(OperatorError::Block { name: name.into(), block, expected, found })
}

macro_rules! binary {
    ($trait:ident, $method:ident, |$a:ident, $b:ident| $result:expr) => {
        impl<T: Real> $trait<&Operator<T>> for &Operator<T> {
            type Output = Operator<T>;
            fn $method(self, right: &Operator<T>) -> Operator<T> {
                let ($a, $b) = (self, right);
                $result
            }
        }
        impl<T: Real> $trait<Operator<T>> for &Operator<T> {
            type Output = Operator<T>;
            fn $method(self, right: Operator<T>) -> Operator<T> {
                self.$method(&right)
            }
        }
        impl<T: Real> $trait<&Operator<T>> for Operator<T> {
            type Output = Operator<T>;
            fn $method(self, right: &Operator<T>) -> Operator<T> {
                (&self).$method(right)
            }
        }
        impl<T: Real> $trait for Operator<T> {
            type Output = Operator<T>;
            fn $method(self, right: Operator<T>) -> Operator<T> {
                (&self).$method(&right)
            }
        }
    };
}
binary!(Mul, mul, |a, b| a.times(b));
binary!(Add, add, |a, b| a.plus(b));
binary!(Sub, sub, |a, b| a.plus(&b.scaled(-T::one())));

impl<T: Real> Neg for &Operator<T> {
    type Output = Operator<T>;
    fn neg(self) -> Operator<T> {
        self.scaled(-T::one())
    }
}

impl<T: Real> Neg for Operator<T> {
    type Output = Operator<T>;
    fn neg(self) -> Operator<T> {
        -&self
    }
}
