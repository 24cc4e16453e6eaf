//! Rooted trees and forests in parents-before-children order, with gather and scatter.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | p(k) | parent of node k; `None` at a root, whose parent is the ground | paper 2 §3.1 |
//! | gather | f(p) = Σ over children k of φ(p, k) f(k), tip to base | paper 2 (3.6) |
//! | scatter | V(k) = φ*(p, k) V(p) for every child k, base to tip | paper 2 (3.7) |

use std::fmt;

/// A forest of nodes 0…n−1 with every parent before its children.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tree {
    parents: Vec<Option<usize>>,
}

/// A parent that does not stand before its child.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TreeError {
    /// Node `node` names `parent`, which is not an earlier node.
    ParentNotBefore {
        /// The node.
        node: usize,
        /// Its claimed parent.
        parent: usize,
    },
}

impl fmt::Display for TreeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let TreeError::ParentNotBefore { node, parent } = self;
        write!(
            f,
            "node {node} has parent {parent}, but parents must come before their children: sort the nodes"
        )
    }
}

impl std::error::Error for TreeError {}

impl Tree {
    /// From parents; `None` marks a root.
    ///
    /// # Errors
    /// [`TreeError::ParentNotBefore`] if a parent is not an earlier node.
    pub fn new(parents: Vec<Option<usize>>) -> Result<Self, TreeError> {
        for (node, parent) in parents.iter().enumerate() {
            if let Some(parent) = *parent
                && parent >= node
            {
                return Err(TreeError::ParentNotBefore { node, parent });
            }
        }
        Ok(Tree { parents })
    }
    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.parents.len()
    }
    /// True if there is no node.
    pub fn is_empty(&self) -> bool {
        self.parents.is_empty()
    }
    /// p(k).
    pub fn parent(&self, k: usize) -> Option<usize> {
        self.parents[k]
    }
    /// All parents.
    pub fn parents(&self) -> &[Option<usize>] {
        &self.parents
    }
    /// The children of every node, in storage order.
    pub fn children(&self) -> Vec<Vec<usize>> {
        let mut children = vec![Vec::new(); self.len()];
        for (k, parent) in self.parents.iter().enumerate() {
            if let Some(p) = *parent {
                children[p].push(k);
            }
        }
        children
    }
    /// Number of edges from each node to its root.
    pub fn depths(&self) -> Vec<usize> {
        let mut depths = vec![0; self.len()];
        for (k, parent) in self.parents.iter().enumerate() {
            depths[k] = parent.map_or(0, |p| depths[p] + 1);
        }
        depths
    }
    /// The nodes from k to its root, k first.
    pub fn path_to_root(&self, k: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(k), |&k| self.parents[k])
    }
    /// Gather, tip to base: `shift(p, k, value of k)` is added into the value of p, after k has all of its children's.
    ///
    /// ```
    /// # use phipsi_topology::Tree;
    /// let tree = Tree::new(vec![None, Some(0), Some(0), Some(2)])?;
    /// let mut mass = [1.0, 2.0, 3.0, 4.0];
    /// tree.gather(&mut mass, |_, _, &m| m, |total, m| *total += m);
    /// assert_eq!(mass, [10.0, 2.0, 7.0, 4.0]);
    /// # Ok::<(), phipsi_topology::TreeError>(())
    /// ```
    pub fn gather<A, B>(
        &self,
        values: &mut [A],
        mut shift: impl FnMut(usize, usize, &A) -> B,
        mut add: impl FnMut(&mut A, B),
    ) {
        for k in (0..self.len()).rev() {
            if let Some(p) = self.parents[k] {
                let shifted = shift(p, k, &values[k]);
                add(&mut values[p], shifted);
            }
        }
    }
    /// Scatter, base to tip: the value of k becomes `shift(k, parent's value, own value)`; roots see `ground`.
    pub fn scatter<A>(&self, ground: &A, values: &mut [A], mut shift: impl FnMut(usize, &A, &A) -> A) {
        for k in 0..self.len() {
            let inboard = self.parents[k].map_or(ground, |p| &values[p]);
            values[k] = shift(k, inboard, &values[k]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scatter_and_gather_are_adjoint() {
        let tree = Tree::new(vec![None, Some(0), Some(1), Some(1), None, Some(4)]).unwrap();
        let shift = [0.0, 2.0, 3.0, 5.0, 0.0, 7.0];
        let (x, y) = ([1.0, -2.0, 3.0, 0.5, 4.0, -1.0], [2.0, 1.0, -1.0, 3.0, 0.25, 6.0]);
        let (mut phi_x, mut phi_t_y) = (x, y);
        tree.gather(&mut phi_x, |_, k, v| shift[k] * v, |sum, v| *sum += v);
        tree.scatter(&0.0, &mut phi_t_y, |k, parent, own| shift[k] * parent + own);
        let dot = |a: &[f64; 6], b: &[f64; 6]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        assert_eq!(dot(&phi_x, &y), dot(&x, &phi_t_y));
    }

    #[test]
    fn a_child_before_its_parent_is_refused() {
        let error = Tree::new(vec![None, Some(2), Some(0)]).unwrap_err();
        assert_eq!(error, TreeError::ParentNotBefore { node: 1, parent: 2 });
    }
}
