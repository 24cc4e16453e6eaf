//! What children give to bodies that an inward sweep meets later.

use super::{GROUND, Layout, LayoutBody};
use phipsi_spatial::Scalar;

/// Contributions of children to bodies that come later in an inward sweep: the first child's in hand, the others' on a stack.
#[derive(Clone, Debug)]
pub(crate) struct Pending<X> {
    stack: Vec<X>,
    top: usize,
}

impl<X: Copy> Pending<X> {
    pub(crate) fn new<C: Scalar>(layout: &Layout<C>, empty: X) -> Self {
        Self::of_at_most(layout.waiting, empty)
    }
    /// For at most `count` contributions that wait at once.
    pub(crate) fn of_at_most(count: usize, empty: X) -> Self {
        Pending { stack: vec![empty; count], top: 0 }
    }
    /// What a run of bodies gave to bodies before it.
    pub(crate) fn take_all(&mut self, run: &Self) {
        let given = &run.stack[..run.top];
        self.stack[self.top..self.top + given.len()].copy_from_slice(given);
        self.top += given.len();
    }
    pub(crate) fn clear(&mut self) {
        self.top = 0;
    }
    /// What body `k`, just done, gives to its parent: kept in hand if the parent is next.
    #[inline(always)]
    pub(crate) fn give<C: Scalar>(&mut self, k: usize, body: &LayoutBody<C>, hand: &mut X, x: X) {
        if body.follows_parent(k) {
            *hand = x;
        } else if body.parent != GROUND {
            self.stack[self.top] = x;
            self.top += 1;
        }
    }
    /// The contribution put last.
    #[inline(always)]
    pub(crate) fn take(&mut self) -> &X {
        self.top -= 1;
        &self.stack[self.top]
    }
    #[inline(always)]
    pub(crate) fn put(&mut self, x: &X) {
        self.stack[self.top] = *x;
        self.top += 1;
    }
    /// What is in hand from the first child with what all others gave; nothing at a tip.
    #[inline(always)]
    pub(crate) fn all<C>(
        &mut self,
        body: &LayoutBody<C>,
        hand: &mut X,
        add: impl Fn(&mut X, &X),
    ) -> Option<X> {
        if body.children == 0 {
            return None;
        }
        for _ in 1..body.children {
            add(hand, self.take());
        }
        Some(*hand)
    }
}
