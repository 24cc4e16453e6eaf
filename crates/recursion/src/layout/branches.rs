//! A large tree cut into branches that do not depend on each other.
//!
//! A branch is a run of bodies: subtrees of one parent, or all of the tree. Its trunk is the path to the heaviest tip with
//! all twigs too small to be worth a thread; the larger subtrees along the path, and what the path is beyond the last of
//! them, are branches of their own. A subtree beside the path has at most half of the bodies, so that branches are nested
//! no deeper than log₂ n. The cut depends on the tree alone: threads change who works, never what is computed.

use super::{GROUND, LayoutBody};
use core::ops::Range;
use phipsi_spatial::Real;

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
pub(super) fn cut_large<C: Real>(bodies: &[LayoutBody<C>]) -> Option<Branch> {
    if bodies.len() < LARGE { None } else { cut(bodies, least(bodies.len())) }
}

/// The whole tree as a branch, cut into branches of `least` bodies or more; nothing if there are no two to cut.
pub(super) fn cut<C: Real>(bodies: &[LayoutBody<C>], least: usize) -> Option<Branch> {
    let mut size = vec![1; bodies.len()];
    for (k, body) in bodies.iter().enumerate().rev() {
        if body.parent != GROUND {
            size[body.parent] += size[k];
        }
    }
    let tree = Tree { bodies, size: &size, least: least.max(1) };
    let whole = tree.branch(0..bodies.len())?;
    if whole.branches.is_empty() { None } else { Some(whole) }
}

struct Tree<'a, C> {
    bodies: &'a [LayoutBody<C>],
    /// Bodies of each subtree.
    size: &'a [usize],
    least: usize,
}

impl<C: Real> Tree<'_, C> {
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
        Some(Branch {
            v: from..to,
            general: first.general..last.general + usize::from(last.is_general()),
            outside: first.parent,
            waiting: super::arrange::most_waiting(run, bodies.start),
            bodies,
            trunk,
            branches,
            by_v,
        })
    }
    /// The branches along the path to the heaviest tip.
    fn along_path(&self, bodies: &Range<usize>) -> Vec<Branch> {
        let mut branches = Vec::new();
        // Siblings: from, to; the last is the heaviest.
        let mut siblings = bodies.clone();
        // The heaviest sibling where a branch was found beside it last.
        let mut rest = bodies.end..bodies.end;
        while !siblings.is_empty() {
            let before = branches.len();
            let heaviest = self.beside_path(&siblings, &mut branches);
            if branches.len() > before {
                rest = heaviest..siblings.end;
            }
            siblings = heaviest + 1..siblings.end;
        }
        if rest.len() >= self.least {
            branches.extend(self.branch(rest));
        }
        branches
    }
    /// Branches among siblings but the last, which is returned: large ones, and runs of small ones.
    fn beside_path(&self, siblings: &Range<usize>, branches: &mut Vec<Branch>) -> usize {
        let mut sibling = siblings.start;
        let mut group = sibling..sibling;
        while sibling + self.size[sibling] < siblings.end {
            let next = sibling + self.size[sibling];
            group = if self.size[sibling] >= self.least { sibling..next } else { group.start..next };
            if group.len() >= self.least {
                branches.extend(self.branch(group));
                group = next..next;
            }
            sibling = next;
        }
        sibling
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
