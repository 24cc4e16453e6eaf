//! Sweeps over a large tree, branch by branch: the branches of a trunk on threads of their own.
//!
//! Every body is met by the same steps, and what children give is added in the same order, as in one sweep over all bodies:
//! results have the same bits, however many threads there are. Threads are those of the pool that the call is made in
//! (feature `parallel`); with one of them, sweeps over all bodies are faster.

use crate::error::DynamicsError;
use crate::layout::{Branch, Layout, Pending};
use core::ops::Range;

/// What is computed on a run of bodies: outward, then inward. Bodies have their numbers in the layout.
pub(crate) trait Recursion: Send {
    /// The same on a branch of the run.
    type Part<'a>: Recursion
    where
        Self: 'a;
    /// From base to tip.
    fn outward(&mut self, bodies: Range<usize>) -> Result<(), DynamicsError>;
    /// The branches, once their trunk was met outward.
    fn parts<'a>(&'a mut self, branch: &'a Branch) -> Vec<Self::Part<'a>>;
    /// Takes what a branch, met inward, gives to bodies before it.
    fn take(&mut self, branch: usize);
    /// From tip to base.
    fn inward(&mut self, bodies: Range<usize>) -> Result<(), DynamicsError>;
}

/// Runs a recursion on a branch. An error is that of the tipmost body that fails.
pub(crate) fn recur<R: Recursion>(mut run: R, branch: &Branch) -> Result<(), DynamicsError> {
    for bodies in &branch.trunk {
        run.outward(bodies.clone())?;
    }
    let mut results = recur_on_parts(&mut run, branch);
    for (i, bodies) in branch.trunk.iter().enumerate().rev() {
        run.inward(bodies.clone())?;
        if let Some(result) = results.pop() {
            result?;
            run.take(i - 1);
        }
    }
    Ok(())
}

/// True if branches may run side by side.
pub(crate) fn several_threads() -> bool {
    #[cfg(feature = "parallel")]
    return rayon::current_num_threads() > 1;
    #[cfg(not(feature = "parallel"))]
    false
}

#[cfg(feature = "parallel")]
fn recur_on_parts<R: Recursion>(run: &mut R, branch: &Branch) -> Vec<Result<(), DynamicsError>> {
    use rayon::prelude::*;
    let parts = run.parts(branch).into_par_iter().zip(&branch.branches);
    // Branches differ in size: each is a task.
    parts.with_max_len(1).map(|(part, branch)| recur(part, branch)).collect()
}

#[cfg(not(feature = "parallel"))]
fn recur_on_parts<R: Recursion>(run: &mut R, branch: &Branch) -> Vec<Result<(), DynamicsError>> {
    run.parts(branch).into_iter().zip(&branch.branches).map(|(part, branch)| recur(part, branch)).collect()
}

/// What children in a run of bodies give to bodies that an inward sweep meets later; and the same of the run's branches.
#[derive(Clone, Debug)]
pub(crate) struct Given<X> {
    pub(crate) pending: Pending<X>,
    /// What the body just done gives to the next.
    pub(crate) hand: X,
    empty: X,
    bodies: Range<usize>,
    pub(crate) branches: Vec<Given<X>>,
}

impl<X: Copy> Given<X> {
    /// For a layout; `empty` is what a tip has from outboard.
    pub(crate) fn new<C: phipsi_spatial::Scalar>(layout: &Layout<C>, empty: X) -> Self {
        match &layout.branches {
            Some(whole) => Self::of(whole, empty),
            None => Given {
                pending: Pending::of_at_most(layout.waiting, empty),
                hand: empty,
                empty,
                bodies: 0..0,
                branches: Vec::new(),
            },
        }
    }
    fn of(branch: &Branch, empty: X) -> Self {
        Given {
            pending: Pending::of_at_most(branch.waiting, empty),
            hand: empty,
            empty,
            bodies: branch.bodies.clone(),
            branches: branch.branches.iter().map(|b| Self::of(b, empty)).collect(),
        }
    }
    /// Refuses branches of another layout than the one that the workspace was made for.
    pub(crate) fn check(&self, branch: &Branch) -> Result<(), DynamicsError> {
        let (expected, found) = (branch.bodies.len(), self.bodies.len());
        if self.bodies != branch.bodies || self.branches.len() != branch.branches.len() {
            return Err(DynamicsError::Shape { argument: "workspace", expected, found });
        }
        self.branches.iter().zip(&branch.branches).try_for_each(|(own, branch)| own.check(branch))
    }
    /// Before an inward sweep.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.pending.clear();
        self.hand = self.empty;
    }
    /// Takes what a branch gave.
    pub(crate) fn take(&mut self, branch: usize) {
        let branch = &self.branches[branch];
        self.pending.take_all(&branch.pending);
        self.hand = branch.hand;
    }
}
