//! A large tree cut into branches that do not depend on each other.
//!
//! A branch is a run of bodies: subtrees of one parent, or all of the tree. Its trunk is the path to the heaviest tip with
//! all twigs too small to be worth a thread; the larger subtrees beside the path, and what the path is beyond the last of
//! them, are branches of their own. A subtree beside the path has at most half of the bodies, so that branches are nested
//! no deeper than log₂ n. The cut depends on the tree alone: threads change who works, never what is computed.

use super::LayoutBody;
use core::ops::Range;
use phipsi_spatial::Scalar;

/// Smallest tree that is cut: another thread takes some time to begin.
const LARGE: usize = 8192;

/// Bodies that the branches of a tree of `n` bodies have at least: enough that a start in cold memory (some microseconds)
/// does not show, few enough that many threads have work.
fn least(n: usize) -> usize {
    (n / 64).clamp(1024, 8192)
}

/// A run of bodies whose parents are among them or are all one body.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Branch {
    pub(crate) bodies: Range<usize>,
    /// Their degrees of freedom.
    pub(crate) v: Range<usize>,
    /// Their places among the bodies on ball and free joints.
    pub(crate) general: Range<usize>,
    /// The parent of those whose parent is not among them.
    pub(crate) outside: usize,
    /// Most contributions that wait at once in an inward sweep.
    pub(crate) waiting: usize,
    /// Runs of the trunk, before, between and behind `branches`; some are empty.
    pub(crate) trunk: Vec<Range<usize>>,
    /// Base to tip.
    pub(crate) branches: Vec<Branch>,
    /// Their numbers in the order of v.
    pub(crate) by_v: Vec<usize>,
}

/// A large tree as a branch with branches; nothing if it is small or has none.
pub(super) fn cut_large<C: Scalar>(bodies: &[LayoutBody<C>]) -> Option<Branch> {
    if bodies.len() < LARGE { None } else { cut(bodies, least(bodies.len())) }
}

/// The whole tree as a branch, cut into branches of `least` bodies or more; nothing if there are no two to cut.
pub(super) fn cut<C: Scalar>(bodies: &[LayoutBody<C>], least: usize) -> Option<Branch> {
    let size = subtree_sizes(bodies);
    let tree = Tree { bodies, size: &size, least: least.max(1) };
    let whole = tree.branch(0..bodies.len())?;
    if whole.branches.is_empty() { None } else { Some(whole) }
}

/// Bodies of each subtree; parents may be bodies of other trees.
pub(super) fn subtree_sizes<C>(bodies: &[LayoutBody<C>]) -> Vec<usize> {
    let mut size = vec![1; bodies.len()];
    for (k, body) in bodies.iter().enumerate().rev() {
        let own = size[k];
        if let Some(parent) = size.get_mut(body.parent) {
            *parent += own;
        }
    }
    size
}

struct Tree<'a, C> {
    bodies: &'a [LayoutBody<C>],
    /// Bodies of each subtree.
    size: &'a [usize],
    least: usize,
}

impl<C: Scalar> Tree<'_, C> {
    /// A run of subtrees of one parent; nothing if its numbers are no run.
    fn branch(&self, bodies: Range<usize>) -> Option<Branch> {
        let run = &self.bodies[bodies.clone()];
        let (first, last) = (run.first()?, run.last()?);
        let from = run.iter().map(|b| b.v).min()?;
        let to = run.iter().map(|b| b.v + b.hinge.nv()).max()?;
        if run.iter().map(|b| b.hinge.nv()).sum::<usize>() != to - from {
            return None;
        }
        let mut branches = self.along_path(&bodies);
        if branches.len() == 1 {
            branches.clear();
        }
        let mut trunk = Vec::with_capacity(branches.len() + 1);
        let mut start = bodies.start;
        for branch in &branches {
            trunk.push(start..branch.bodies.start);
            start = branch.bodies.end;
        }
        trunk.push(start..bodies.end);
        let mut by_v: Vec<usize> = (0..branches.len()).collect();
        by_v.sort_by_key(|&i| branches[i].v.start);
        let parents: Vec<usize> = run.iter().map(|b| b.parent).collect();
        Some(Branch {
            v: from..to,
            general: first.general..last.general + usize::from(last.is_general()),
            outside: first.parent,
            waiting: super::arrange::most_waiting(&parents, bodies.start),
            bodies,
            trunk,
            branches,
            by_v,
        })
    }
    /// The branches along the path to the heaviest tip.
    fn along_path(&self, bodies: &Range<usize>) -> Vec<Branch> {
        // Before the path; and behind it, deepest last.
        let (mut branches, mut behind) = (Vec::new(), Vec::new());
        let mut siblings = bodies.clone();
        // The heaviest sibling's subtree where a branch was found beside it last.
        let mut rest = bodies.end..bodies.end;
        while let Some(heaviest) = self.heaviest(&siblings) {
            let before = self.beside_path(siblings.start..heaviest.start);
            let after = self.beside_path(heaviest.end..siblings.end);
            if !before.is_empty() || !after.is_empty() {
                rest = heaviest.clone();
            }
            branches.extend(before);
            behind.push(after);
            siblings = heaviest.start + 1..heaviest.end;
        }
        if rest.len() >= self.least {
            branches.extend(self.branch(rest));
        }
        branches.extend(behind.into_iter().rev().flatten());
        branches
    }
    /// The largest subtree of siblings, the last of equals.
    fn heaviest(&self, siblings: &Range<usize>) -> Option<Range<usize>> {
        self.subtrees(siblings.clone()).max_by_key(|subtree| subtree.len())
    }
    /// The subtrees of siblings.
    fn subtrees(&self, siblings: Range<usize>) -> impl Iterator<Item = Range<usize>> {
        let mut next = siblings.start;
        core::iter::from_fn(move || {
            let start = next;
            next += if start < siblings.end { self.size[start] } else { 0 };
            (next > start).then_some(start..next)
        })
    }
    /// Branches among siblings: large ones, and runs of small ones.
    fn beside_path(&self, siblings: Range<usize>) -> Vec<Branch> {
        let mut branches = Vec::new();
        let mut group = siblings.start..siblings.start;
        for subtree in self.subtrees(siblings) {
            group = if subtree.len() >= self.least { subtree.clone() } else { group.start..subtree.end };
            if group.len() >= self.least {
                branches.extend(self.branch(group));
                group = subtree.end..subtree.end;
            }
        }
        branches
    }
}

/// The parts of `numbers`, which begins at number `first`, that belong to `runs`, in their order. Runs do not overlap and are
/// in order.
pub(crate) fn carve<X>(
    numbers: &mut [X],
    first: usize,
    runs: impl Iterator<Item = Range<usize>>,
) -> Vec<&mut [X]> {
    let (mut rest, mut at) = (numbers, first);
    runs.map(|run| {
        let (_, behind) = core::mem::take(&mut rest).split_at_mut(run.start - at);
        let (own, behind) = behind.split_at_mut(run.len());
        (rest, at) = (behind, run.end);
        own
    })
    .collect()
}
