//! What an operator's rows and columns are: blocks, one per node.

use std::fmt;
use std::sync::Arc;

/// A stack of blocks of given sizes: six numbers a body, or as many numbers a joint as it has degrees of freedom.
#[derive(Clone, PartialEq, Eq)]
pub struct Space {
    /// Where each block begins, and the end.
    starts: Arc<[usize]>,
}

impl Space {
    /// Blocks of these sizes.
    pub fn new(sizes: impl IntoIterator<Item = usize>) -> Self {
        let mut starts = vec![0];
        let mut end = 0;
        for size in sizes {
            end += size;
            starts.push(end);
        }
        Space { starts: starts.into() }
    }
    /// `count` blocks of one size.
    pub fn uniform(count: usize, size: usize) -> Self {
        Self::new(std::iter::repeat_n(size, count))
    }
    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.starts.len() - 1
    }
    /// Numbers in all blocks.
    pub fn dimension(&self) -> usize {
        self.starts[self.blocks()]
    }
    /// Numbers in block k.
    pub fn size(&self, k: usize) -> usize {
        self.starts[k + 1] - self.starts[k]
    }
    /// Where block k is.
    pub fn range(&self, k: usize) -> std::ops::Range<usize> {
        self.starts[k]..self.starts[k + 1]
    }
}

impl fmt::Debug for Space {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Space({} blocks, {} numbers)", self.blocks(), self.dimension())
    }
}

impl fmt::Display for Space {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} numbers in {} blocks", self.dimension(), self.blocks())
    }
}
