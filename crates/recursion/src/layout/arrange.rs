//! The order of a layout's bodies and the frames that they are given.

use super::{Carrier, GROUND, LayoutBody};
use crate::hinge::Hinge;
use crate::link::Link;
use phipsi_spatial::{Axis, Mat3, Real, RigidInertia, Transform, Turn};

/// A body before frames are turned and the order is chosen.
pub(super) struct Raw<C> {
    pub(super) parent: usize,
    pub(super) hinge: Hinge<C>,
    pub(super) q: usize,
    pub(super) v: usize,
    pub(super) placement: Transform<C>,
    pub(super) inertia: RigidInertia<C>,
}

/// A model's own order is kept if it is depth first and no more than this many contributions wait at once in it.
const WAITING: usize = 8;

/// Order, frames and links. Carriers follow. Returns also how many contributions wait at once.
pub(super) fn arrange<C: Real>(raw: &[Raw<C>], carriers: &mut [Carrier<C>]) -> (Vec<LayoutBody<C>>, usize) {
    let (order, heaviest) = depth_first(raw);
    let mut place = vec![GROUND; raw.len()];
    order.iter().enumerate().for_each(|(new, &old)| place[old] = new);
    let mut links: Vec<Link<C>> = raw.iter().map(|b| Link::new(&b.placement)).collect();
    // A body on an axis along z may be turned about it: away goes the first turn to its heaviest child.
    let mut turned = vec![Turn::none(); raw.len()];
    for (k, body) in raw.iter().enumerate() {
        let free = matches!(
            body.hinge,
            Hinge::Revolute | Hinge::Prismatic | Hinge::Helical { .. } | Hinge::Cylindrical
        );
        if free && heaviest[k] != GROUND {
            turned[k] = links[heaviest[k]].first();
        }
    }
    for (k, body) in raw.iter().enumerate() {
        if body.parent != GROUND && turned[body.parent] != Turn::none() {
            links[k] = if heaviest[body.parent] == k {
                links[k].without_first()
            } else {
                links[k].with_parent_turned(turned[body.parent])
            };
        }
        if turned[k] != Turn::none() {
            links[k] = links[k].with_body_turned(turned[k]);
        }
    }
    let into = |turn: Turn<C>| Turn { cos: turn.cos, sin: -turn.sin };
    for carrier in carriers.iter_mut().filter(|c| c.body != GROUND) {
        let turn = turned[carrier.body];
        if turn != Turn::none() {
            let columns = [0, 1, 2].map(|j| turn.down(Axis::Z, carrier.pose.rotation.column(j)));
            let rotation = Mat3::from_columns(columns[0], columns[1], columns[2]);
            carrier.pose = Transform::new(rotation, turn.down(Axis::Z, carrier.pose.translation));
        }
        carrier.body = place[carrier.body];
    }
    let mut general = 0;
    let mut bodies: Vec<LayoutBody<C>> = Vec::with_capacity(raw.len());
    for &old in &order {
        let b = &raw[old];
        let parent = if b.parent == GROUND { GROUND } else { place[b.parent] };
        if parent != GROUND {
            bodies[parent].children += 1;
        }
        let inertia = match turned[old] {
            turn if turn == Turn::none() => b.inertia,
            turn => into(turn).rigid_up(Axis::Z, &b.inertia),
        };
        let (children, link) = (0, links[old].of_joint(&b.hinge));
        let body = LayoutBody { parent, children, hinge: b.hinge, q: b.q, v: b.v, link, general, inertia };
        general += usize::from(body.is_general());
        bodies.push(body);
    }
    let parents: Vec<usize> = bodies.iter().map(|b| b.parent).collect();
    let waiting = most_waiting(&parents, 0);
    (bodies, waiting)
}

/// Most contributions that wait at once for a body with several children, tip to base, in a run of subtrees that begins at body
/// `first`; those to bodies before the run included.
pub(super) fn most_waiting(parents: &[usize], first: usize) -> usize {
    let (mut waiting, mut most) = (0usize, 0);
    let mut children = vec![0usize; parents.len()];
    for &parent in parents.iter().filter(|p| **p != GROUND && **p >= first) {
        children[parent - first] += 1;
    }
    for (k, &parent) in parents.iter().enumerate().rev() {
        waiting -= children[k].saturating_sub(1);
        if parent != GROUND && parent + 1 != first + k {
            waiting += 1;
            most = most.max(waiting);
        }
    }
    most
}

/// True if every body follows its parent or ends a subtree of it.
fn is_depth_first(parents: &[usize]) -> bool {
    let mut path: Vec<usize> = Vec::new();
    parents.iter().enumerate().all(|(k, &parent)| {
        while path.last().is_some_and(|&last| last != parent) {
            path.pop();
        }
        path.push(k);
        parent == GROUND || path.len() > 1
    })
}

/// Depth-first order, the model's own or lighter subtrees first; and the heaviest child of every body.
fn depth_first<C>(raw: &[Raw<C>]) -> (Vec<usize>, Vec<usize>) {
    let n = raw.len();
    let mut size = vec![1usize; n];
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); n];
    let mut roots = Vec::new();
    for (k, body) in raw.iter().enumerate().rev() {
        match body.parent {
            GROUND => roots.push(k),
            p => {
                size[p] += size[k];
                children[p].push(k);
            }
        }
    }
    let mut heaviest = vec![GROUND; n];
    for (k, list) in children.iter_mut().enumerate() {
        // In decreasing order: the stack below takes the last, the lightest, first. Stable, so that equals keep their order.
        list.sort_by_key(|&c| std::cmp::Reverse(size[c]));
        heaviest[k] = list.first().copied().unwrap_or(GROUND);
    }
    let parents: Vec<usize> = raw.iter().map(|b| b.parent).collect();
    if is_depth_first(&parents) && most_waiting(&parents, 0) <= WAITING {
        return ((0..n).collect(), heaviest);
    }
    let (mut order, mut stack) = (Vec::with_capacity(n), roots);
    while let Some(k) = stack.pop() {
        order.push(k);
        stack.extend(&children[k]);
    }
    (order, heaviest)
}
