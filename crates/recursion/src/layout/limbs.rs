//! Limbs of a tree that are alike: one limb in each lane.
//!
//! A limb is a subtree of hinges and sliders. Four of the same shape, the legs of a quadruped, the legs and the outer parts of the arms of a
//! humanoid, four of the branches of a branching tree, are swept as one, with constants that differ from lane to lane. What is
//! left is the trunk, which meets the limbs where they stand in the order of bodies.

use super::arrange::most_waiting;
use super::branches::subtree_sizes;
use super::{GROUND, Layout, LayoutBody};
use crate::hinge::Hinge;
use core::ops::Range;
use phipsi_spatial::{Abreast, Real, RigidInertia, Scalar, Sym3, Vec3};
use std::collections::HashMap;

/// Marks a parent that is a body of the trunk, or the ground.
pub(crate) const TRUNK: usize = usize::MAX - 1;

/// Limbs that a group has: with fewer, a register does no more than single numbers would, in the same time.
const LIMBS: Range<usize> = 3..5;
/// Bodies of a limb. One alone is hardly worth its way into lanes (an estimate); 48 of 0.9 kB fill a first cache of 48 KiB.
const BODIES: Range<usize> = 2..48;

/// Four limbs of one shape.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Limbs<C: Scalar> {
    /// One limb's bodies, with a limb in each lane.
    pub(crate) layout: Layout<C::Abreast>,
    /// First body of the limb in each lane. A lane without a limb repeats another.
    pub(crate) roots: [usize; 4],
    /// How many limbs.
    pub(crate) count: usize,
    /// Their parents.
    pub(crate) parents: [usize; 4],
    /// True if that is one body: what it is given is one sum.
    pub(crate) together: bool,
    /// Where each coordinate of the limbs is in q,
    pub(crate) q: Vec<[usize; 4]>,
    /// and in v.
    pub(crate) v: Vec<[usize; 4]>,
}

/// What limbs give to a body of the trunk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gift {
    pub(crate) group: usize,
    /// Lane of the limb; of limbs that give together, the first.
    pub(crate) lane: usize,
    /// First body of the limb.
    pub(crate) root: usize,
}

/// A tree with limbs that are alike.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LimbPlan<C: Scalar> {
    pub(crate) groups: Vec<Limbs<C>>,
    /// The whole tree, where limbs that give together count as one child.
    pub(crate) layout: Layout<C>,
    /// Bodies of the trunk, and what is given to them or to a body before them by the limb behind them.
    pub(crate) trunk: Vec<(Range<usize>, Option<Gift>)>,
}

impl<C: Real> LimbPlan<C> {
    /// The limbs of a tree, if it has any and the processor has lanes for them. Cost O(n).
    pub(super) fn new(layout: &Layout<C>) -> Option<Box<Self>> {
        let bodies = &layout.bodies[..];
        if C::Abreast::COUNT < 4 || !C::Abreast::is_fast() {
            return None;
        }
        let size = subtree_sizes(bodies);
        let found = alike(bodies, &size);
        if found.is_empty() {
            return None;
        }
        let (mut groups, mut limbs, mut whole) = (Vec::new(), Vec::new(), layout.clone());
        for roots in found {
            let group = groups.len();
            let of_group = Limbs::new(bodies, &roots, size[roots[0]]);
            // Given by the limb that stands first: it may follow its parent.
            let one = of_group.together && of_group.parents[0] != GROUND;
            for (lane, &root) in roots.iter().enumerate() {
                limbs.push((root, if one && lane > 0 { None } else { Some(Gift { group, lane, root }) }));
            }
            if one {
                whole.bodies[of_group.parents[0]].children -= roots.len() - 1;
            }
            groups.push(of_group);
        }
        limbs.sort_unstable_by_key(|(root, _)| *root);
        let (mut trunk, mut start) = (Vec::with_capacity(limbs.len() + 1), 0);
        for (root, gift) in limbs {
            trunk.push((start..root, gift));
            start = root + size[root];
        }
        trunk.push((start..bodies.len(), None));
        Some(Box::new(LimbPlan { groups, layout: whole, trunk }))
    }
}

impl<C: Real> Limbs<C> {
    /// Of three or four limbs, by their first bodies, in increasing order.
    fn new(bodies: &[LayoutBody<C>], roots: &[usize], size: usize) -> Self {
        let count = roots.len();
        let roots = [0, 1, 2, 3].map(|lane: usize| roots[lane.min(count - 1)]);
        let (mut q, mut v) = (Vec::with_capacity(size), Vec::with_capacity(size));
        let each = (0..size).map(|i| {
            let four = roots.map(|root| &bodies[root + i]);
            q.push(four.map(|body| body.q));
            v.push(four.map(|body| body.v));
            let parent = if i == 0 { TRUNK } else { four[0].parent - roots[0] };
            let hinge =
                if matches!(four[0].hinge, Hinge::Revolute) { Hinge::Revolute } else { Hinge::Prismatic };
            LayoutBody {
                parent,
                children: four[0].children,
                hinge,
                q: i,
                v: i,
                link: super::Link::abreast(four.map(|body| &body.link)),
                general: 0,
                inertia: rigid_abreast(four.map(|body| &body.inertia)),
            }
        });
        let bodies_abreast: Vec<LayoutBody<C::Abreast>> = each.collect();
        // Counted as behind two bodies, of which the first is the parent.
        let behind = |parent: usize| if parent == TRUNK { 0 } else { parent + 2 };
        let parents: Vec<usize> = bodies_abreast.iter().map(|body| behind(body.parent)).collect();
        let waiting = most_waiting(&parents, 2);
        let parents = roots.map(|root| bodies[root].parent);
        let together = parents.iter().all(|p| *p == parents[0]);
        Limbs { layout: Layout::of_limbs(bodies_abreast, waiting), roots, count, parents, together, q, v }
    }
}

fn rigid_abreast<C: Real>(of: [&RigidInertia<C>; 4]) -> RigidInertia<C::Abreast> {
    let number = |part: &dyn Fn(&RigidInertia<C>) -> C| C::Abreast::of(of.map(part));
    let moment = |i: usize| number(&|m| m.first_moment.0[i]);
    let inertia = |part: &dyn Fn(&Sym3<C>) -> C| number(&|m| part(&m.inertia));
    RigidInertia {
        mass: number(&|m| m.mass),
        first_moment: Vec3([moment(0), moment(1), moment(2)]),
        inertia: Sym3 {
            xx: inertia(&|s| s.xx),
            xy: inertia(&|s| s.xy),
            xz: inertia(&|s| s.xz),
            yy: inertia(&|s| s.yy),
            yz: inertia(&|s| s.yz),
            zz: inertia(&|s| s.zz),
        },
    }
}

/// First bodies of limbs that are alike and do not overlap, group by group, the largest limbs first.
fn alike<C>(bodies: &[LayoutBody<C>], size: &[usize]) -> Vec<Vec<usize>> {
    let shapes = shapes(bodies, size);
    let mut of_shape: HashMap<usize, Vec<usize>> = HashMap::new();
    for (k, shape) in shapes.iter().enumerate() {
        if let Some(shape) = shape
            && BODIES.contains(&size[k])
        {
            of_shape.entry(*shape).or_default().push(k);
        }
    }
    let mut all: Vec<Vec<usize>> = of_shape.into_values().filter(|of| of.len() >= LIMBS.start).collect();
    all.sort_unstable_by_key(|of| (std::cmp::Reverse(size[of[0]]), of[0]));
    let mut taken = vec![false; bodies.len()];
    let mut groups = Vec::new();
    for of in all {
        // Larger limbs came first: where the first body is free, all are.
        let free: Vec<usize> = of.into_iter().filter(|&k| !taken[k]).collect();
        for group in free.chunks(LIMBS.end - 1).filter(|group| LIMBS.contains(&group.len())) {
            for &k in group {
                taken[k..k + size[k]].fill(true);
            }
            groups.push(group.to_vec());
        }
    }
    groups
}

/// A number for the shape of each subtree that can be a limb: kinds of joints, and the order of children.
fn shapes<C>(bodies: &[LayoutBody<C>], size: &[usize]) -> Vec<Option<usize>> {
    let mut known: HashMap<(bool, Vec<usize>), usize> = HashMap::new();
    let mut shapes = vec![None; bodies.len()];
    // Of the subtrees seen so far whose parents are yet to come, tip to base; nothing for one that is no limb.
    let mut waiting: Vec<Option<usize>> = Vec::new();
    for (k, body) in bodies.iter().enumerate().rev() {
        let outboard = waiting.split_off(waiting.len().saturating_sub(body.children));
        let slides = match body.hinge {
            Hinge::Revolute => Some(false),
            Hinge::Prismatic => Some(true),
            _ => None,
        };
        if size[k] < BODIES.end
            && let Some(slides) = slides
            && let Some(outboard) = outboard.into_iter().collect::<Option<Vec<usize>>>()
        {
            let next = known.len();
            shapes[k] = Some(*known.entry((slides, outboard)).or_insert(next));
        }
        if body.parent != GROUND {
            waiting.push(shapes[k]);
        }
    }
    shapes
}

#[cfg(test)]
mod tests;
