//! Which joints of a graph with loops become its tree, and which are cut.
//!
//! | symbol | meaning |
//! |---|---|
//! | rows | 6 − freedoms of a joint: what it costs to close it again |
//! | m_k | rows of the loops that are open at tree joint k: those whose cycle contains it |
//! | Σ m_k² | cost of the dynamics: linear in the loops where cycles hardly overlap, whatever their number |
//!
//! The tree decides: two rails of one chain each nest all loops of a ladder, pieces of rail on the rungs keep them apart.

use std::collections::{BTreeSet, VecDeque};
use std::fmt;

/// A joint between two bodies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GraphJoint {
    /// The bodies; `None` is the ground.
    pub bodies: [Option<usize>; 2],
    /// Its degrees of freedom, 0 … 6.
    pub freedoms: usize,
    /// The user's own decision; `None` leaves it to [`choose_cuts`].
    pub cut: Option<bool>,
}

/// A tree joint, from the ground outward.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TreeJoint {
    /// The body that it carries.
    pub body: usize,
    /// Its index among the joints; `None`: nothing connects the body to what stands before it, so it moves freely.
    pub joint: Option<usize>,
    /// Body on its inboard side.
    pub parent: Option<usize>,
}

/// A tree, the cut joints, and what they cost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CutChoice {
    /// Parents before children.
    pub tree: Vec<TreeJoint>,
    /// Cut joints, in their own order.
    pub cuts: Vec<usize>,
    /// What it costs.
    pub cost: Cost,
    /// What the breadth-first tree, the depth-first tree and the one of short loops would cost.
    pub starts: [Cost; 3],
}

/// What a tree costs, in the order of importance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cost {
    /// Σ m_k².
    pub nesting: usize,
    /// Bodies on the longest path.
    pub depth: usize,
    /// Rows of all cut joints, and six for every body that had to be let free.
    pub rows: usize,
}

impl fmt::Display for CutChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [breadth, depth, short] = self.starts;
        write!(
            f,
            "{} joints cut, {} rows, sum of squared open rows {} (breadth first {}, depth first {}, short loops {}), depth {}",
            self.cuts.len(),
            self.cost.rows,
            self.cost.nesting,
            breadth.nesting,
            depth.nesting,
            short.nesting,
            self.cost.depth
        )
    }
}

/// Most rounds of exchanges.
const MOST_ROUNDS: usize = 20;

/// Chooses the joints to cut: least Σ m_k², then the least depth, then the fewest rows.
///
/// # Method
/// The best of the breadth-first tree, the depth-first tree and one that keeps what many short loops share, then exchanges: every cut joint against every joint of its cycle,
/// as long as the cost falls. A user's decision is never changed; of joints that the user keeps in a loop of such, the last is
/// cut all the same. Joints that name no body, or one body twice, are cut.
///
/// # Cost
/// Once per model: for every exchange that is tried the lengths of the cycles that the joint is in; O(bodies) for one that costs no
/// more than what there is.
///
/// # Example
/// ```
/// use phipsi_closure::{GraphJoint, choose_cuts};
/// let hinge = |a: Option<usize>, b: usize| GraphJoint { bodies: [a, Some(b)], freedoms: 1, cut: None };
/// let ball = GraphJoint { bodies: [Some(1), Some(2)], freedoms: 3, cut: None };
/// let choice = choose_cuts(3, &[hinge(None, 0), hinge(Some(0), 1), hinge(None, 2), ball]);
/// assert_eq!(choice.cuts, [3]); // the ball leaves fewest rows
/// ```
pub fn choose_cuts(bodies: usize, joints: &[GraphJoint]) -> CutChoice {
    let graph = Graph { bodies, joints };
    let begun = [Start::Breadth, Start::Depth, Start::ShortLoops].map(|start| {
        let kept = graph.start(start);
        (graph.layout(&kept), kept)
    });
    let starts = [begun[0].0.cost, begun[1].0.cost, begun[2].0.cost];
    let [breadth, depth, short] = begun;
    let better = |a: (Laid, Vec<bool>), b: (Laid, Vec<bool>)| if a.0.cost <= b.0.cost { a } else { b };
    let (best, mut kept) = better(better(breadth, depth), short);
    let mut best = best.index(&graph, &kept);
    let mut shared = vec![0; bodies];
    for _ in 0..MOST_ROUNDS {
        let before = best.cost;
        for cut in 0..joints.len() {
            if kept[cut] || joints[cut].cut == Some(true) || !graph.is_real(cut) {
                continue;
            }
            let mut choice = None;
            let cycle = best.cycle(&graph, cut);
            for &body in &cycle {
                let Some(inside) = best.joint(body).filter(|&j| joints[j].cut != Some(false)) else {
                    continue;
                };
                // Depth and rows decide between equals only.
                let least = choice.as_ref().map_or(best.cost, |(_, t): &(usize, Laid)| t.cost).nesting;
                if best.nesting_after(&graph, &cycle, cut, body, &mut shared) > least {
                    continue;
                }
                (kept[cut], kept[inside]) = (true, false);
                let trial = graph.layout(&kept);
                (kept[cut], kept[inside]) = (false, true);
                if trial.cost < choice.as_ref().map_or(best.cost, |(_, t): &(usize, Laid)| t.cost) {
                    choice = Some((inside, trial));
                }
            }
            if let Some((inside, trial)) = choice {
                (kept[cut], kept[inside]) = (true, false);
                best = trial.index(&graph, &kept);
            }
        }
        if best.cost == before {
            break;
        }
    }
    let cuts = (0..joints.len()).filter(|&j| !kept[j]).collect();
    CutChoice { tree: best.tree, cuts, cost: best.cost, starts }
}

/// What the tree of some joints costs.
pub(crate) fn cost_of(bodies: usize, joints: &[GraphJoint], kept: &[bool]) -> Cost {
    Graph { bodies, joints }.layout(kept).cost
}

struct Graph<'a> {
    bodies: usize,
    joints: &'a [GraphJoint],
}

/// In which order joints are taken into a first tree.
#[derive(Clone, Copy)]
enum Start {
    /// As searches from the ground meet them.
    Breadth,
    Depth,
    /// Those that are in most of the shortest loops first: what is in one alone is best cut.
    ShortLoops,
}

/// A tree from the ground.
struct Laid {
    tree: Vec<TreeJoint>,
    /// Place in `tree` and depth of every body.
    place: Vec<usize>,
    depth: Vec<usize>,
    /// m of the joint of every body.
    open: Vec<usize>,
    /// The cut joints whose cycles it is in, after [`Laid::index`].
    through: Vec<Vec<usize>>,
    cost: Cost,
}

impl Laid {
    /// The joint that carries a body.
    fn joint(&self, body: usize) -> Option<usize> {
        self.tree[self.place[body]].joint
    }
    /// The bodies whose joints lie between the two ends of a cut joint.
    fn cycle(&self, graph: &Graph<'_>, cut: usize) -> Vec<usize> {
        let mut found = Vec::new();
        self.walk(graph, cut, |body| found.push(body));
        found
    }
    /// Fills `through`.
    fn index(mut self, graph: &Graph<'_>, kept: &[bool]) -> Self {
        self.through = vec![Vec::new(); graph.bodies];
        for cut in (0..graph.joints.len()).filter(|&j| !kept[j] && graph.is_real(j)) {
            for body in self.cycle(graph, cut) {
                self.through[body].push(cut);
            }
        }
        self
    }
    /// Σ m² with `cut` in the tree instead of the joint of `body`, which is in its cycle: every other cycle that the joint was in now
    /// goes the other way round, over what it does not share with that of `cut`. `shared`: room for all bodies, zero between calls.
    fn nesting_after(
        &self,
        graph: &Graph<'_>,
        cycle: &[usize],
        cut: usize,
        body: usize,
        shared: &mut [usize],
    ) -> usize {
        let mut turned = 0;
        for &x in self.through[body].iter().filter(|&&x| x != cut) {
            turned += graph.rows(x);
            self.walk(graph, x, |k| shared[k] += graph.rows(x));
        }
        let before: usize = cycle.iter().map(|&k| self.open[k] * self.open[k]).sum();
        let opened = self.joint(body).map_or(0, |j| graph.rows(j)) + turned;
        let after = |k: usize| self.open[k] + opened - graph.rows(cut) - 2 * shared[k];
        let after: usize = cycle.iter().filter(|&&k| k != body).map(|&k| after(k) * after(k)).sum();
        for &x in self.through[body].iter().filter(|&&x| x != cut) {
            self.walk(graph, x, |k| shared[k] = 0);
        }
        self.cost.nesting - before + after + opened * opened
    }
    /// Visits the bodies whose joints lie between the two ends of a cut joint.
    fn walk(&self, graph: &Graph<'_>, cut: usize, mut visit: impl FnMut(usize)) {
        let [mut a, mut b] = graph.joints[cut].bodies;
        let depth = |body: Option<usize>| body.map_or(0, |k| self.depth[k]);
        while a != b {
            let deeper = if depth(a) >= depth(b) { &mut a } else { &mut b };
            let Some(body) = *deeper else { return };
            visit(body);
            *deeper = self.tree[self.place[body]].parent;
        }
    }
}

impl Graph<'_> {
    /// What it costs to close a joint.
    fn rows(&self, joint: usize) -> usize {
        6usize.saturating_sub(self.joints[joint].freedoms)
    }
    /// True if a joint connects two things that there are.
    fn is_real(&self, joint: usize) -> bool {
        let [a, b] = self.joints[joint].bodies;
        a != b && [a, b].iter().flatten().all(|k| *k < self.bodies)
    }
    /// Joints at every body, the ground last.
    fn around(&self, used: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        let mut around = vec![Vec::new(); self.bodies + 1];
        for (j, joint) in self.joints.iter().enumerate() {
            if self.is_real(j) && used(j) {
                joint.bodies.iter().for_each(|b| around[b.unwrap_or(self.bodies)].push(j));
            }
        }
        around
    }
    /// The joints of a spanning tree: those that the user keeps first, those that the user cuts never.
    fn start(&self, order: Start) -> Vec<bool> {
        let mut kept = vec![false; self.joints.len()];
        // The user's own joints become the tree as far as they go together.
        let mut group: Vec<usize> = (0..=self.bodies).collect();
        fn root(group: &mut [usize], mut k: usize) -> usize {
            while group[k] != k {
                group[k] = group[group[k]];
                k = group[k];
            }
            k
        }
        let ends = |j: usize| self.joints[j].bodies.map(|b| b.unwrap_or(self.bodies));
        let mut unite = |j: usize, kept: &mut [bool]| {
            let [a, b] = ends(j).map(|k| root(&mut group, k));
            if a != b {
                group[a] = b;
                kept[j] = true;
            }
        };
        for j in (0..self.joints.len()).filter(|&j| self.is_real(j) && self.joints[j].cut == Some(false)) {
            unite(j, &mut kept);
        }
        // The others in the order in which a search from the ground meets them.
        let around = self.around(|j| self.joints[j].cut != Some(true));
        if let Start::ShortLoops = order {
            let shared = self.short_loops(&around);
            let mut by_loops: Vec<usize> = (0..shared.len()).collect();
            by_loops.sort_by_key(|&j| std::cmp::Reverse(shared[j]));
            for j in by_loops.into_iter().filter(|&j| self.is_real(j) && self.joints[j].cut != Some(true)) {
                unite(j, &mut kept);
            }
            return kept;
        }
        let mut seen = vec![false; self.bodies + 1];
        for first in std::iter::once(self.bodies).chain(0..self.bodies) {
            if std::mem::replace(&mut seen[first], true) {
                continue;
            }
            let mut queue: VecDeque<(usize, usize)> = VecDeque::new();
            let mut here = first;
            loop {
                let next = around[here].iter().map(|&j| {
                    let [a, b] = ends(j);
                    (j, if a == here { b } else { a })
                });
                let depth_first = matches!(order, Start::Depth);
                if depth_first {
                    queue.extend(next.rev());
                } else {
                    queue.extend(next);
                }
                let take = |queue: &mut VecDeque<(usize, usize)>| {
                    if depth_first { queue.pop_back() } else { queue.pop_front() }
                };
                let found = std::iter::from_fn(|| take(&mut queue)).find(|(_, body)| !seen[*body]);
                let Some((j, body)) = found else { break };
                seen[body] = true;
                unite(j, &mut kept);
                here = body;
            }
        }
        kept
    }
    /// For every joint, how many of the shortest loops it is in: one of each joint, each counted once.
    fn short_loops(&self, around: &[Vec<usize>]) -> Vec<usize> {
        let mut shared = vec![0; self.joints.len()];
        let mut known = BTreeSet::new();
        // The joint by which a search came to a body, and the bodies that it has met.
        let (mut by, mut met) = (vec![usize::MAX; self.bodies + 1], Vec::new());
        let ends = |j: usize| self.joints[j].bodies.map(|b| b.unwrap_or(self.bodies));
        for joint in (0..self.joints.len()).filter(|&j| self.is_real(j)) {
            let [from, to] = ends(joint);
            met.push(from);
            by[from] = joint;
            let mut next = 0;
            while next < met.len() && by[to] == usize::MAX {
                let here = met[next];
                for &j in around[here].iter().filter(|&&j| j != joint) {
                    let [a, b] = ends(j);
                    let other = if a == here { b } else { a };
                    if by[other] == usize::MAX {
                        by[other] = j;
                        met.push(other);
                    }
                }
                next += 1;
            }
            if by[to] != usize::MAX {
                let (mut cycle, mut here) = (vec![joint], to);
                while here != from {
                    let j = by[here];
                    cycle.push(j);
                    let [a, b] = ends(j);
                    here = if a == here { b } else { a };
                }
                cycle.sort_unstable();
                if !known.contains(&cycle) {
                    cycle.iter().for_each(|&j| shared[j] += 1);
                    known.insert(cycle);
                }
            }
            met.drain(..).for_each(|k| by[k] = usize::MAX);
        }
        shared
    }
    /// The tree of some joints, and its cost.
    fn layout(&self, kept: &[bool]) -> Laid {
        let around = self.around(|j| kept[j]);
        let (mut tree, mut place) = (Vec::with_capacity(self.bodies), vec![usize::MAX; self.bodies]);
        let mut depth = vec![0; self.bodies];
        let mut rows = 0;
        for first in std::iter::once(self.bodies).chain(0..self.bodies) {
            if first < self.bodies {
                if place[first] != usize::MAX {
                    continue;
                }
                place[first] = tree.len();
                depth[first] = 1;
                rows += 6;
                tree.push(TreeJoint { body: first, joint: None, parent: None });
            }
            let mut stack = vec![first];
            while let Some(here) = stack.pop() {
                let inboard = (here < self.bodies).then_some(here);
                for &j in &around[here] {
                    let [a, b] = self.joints[j].bodies;
                    let Some(body) = (if a == inboard { b } else { a }) else { continue };
                    if place[body] != usize::MAX {
                        continue;
                    }
                    place[body] = tree.len();
                    depth[body] = inboard.map_or(1, |k| depth[k] + 1);
                    tree.push(TreeJoint { body, joint: Some(j), parent: inboard });
                    stack.push(body);
                }
            }
        }
        let deepest = depth.iter().fold(0, |most, d| most.max(*d));
        let cost = Cost { nesting: 0, depth: deepest, rows };
        let mut laid = Laid { tree, place, depth, open: vec![0; self.bodies], through: Vec::new(), cost };
        for cut in (0..self.joints.len()).filter(|&j| !kept[j] && self.is_real(j)) {
            let m = self.rows(cut);
            laid.cost.rows += m;
            for body in laid.cycle(self, cut) {
                laid.open[body] += m;
            }
        }
        laid.cost.nesting = laid.open.iter().map(|m| m * m).sum();
        laid
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joint(a: Option<usize>, b: Option<usize>, freedoms: usize) -> GraphJoint {
        GraphJoint { bodies: [a, b], freedoms, cut: None }
    }

    /// Rails of n pieces each, on the ground, and a rung across at every joint.
    fn ladder(n: usize) -> (usize, Vec<GraphJoint>) {
        let (left, right, rung) = (|i: usize| i, |i: usize| n + i, |i: usize| 2 * n + i);
        let mut joints = Vec::new();
        for i in 0..n {
            joints.push(joint(i.checked_sub(1).map(left), Some(left(i)), 1));
            joints.push(joint(i.checked_sub(1).map(right), Some(right(i)), 1));
            joints.push(joint(Some(left(i)), Some(rung(i)), 1));
            joints.push(joint(Some(right(i)), Some(rung(i)), 1));
        }
        (3 * n, joints)
    }

    #[test]
    fn rails_hang_on_rungs() {
        for n in [4usize, 16, 40] {
            let (bodies, joints) = ladder(n);
            let choice = choose_cuts(bodies, &joints);
            assert_eq!(choice.cuts.len(), n);
            assert_eq!(choice.tree.len(), bodies);
            // Two open loops at most at a joint: linear. Both rails as chains cost n³.
            assert!(choice.cost.nesting <= 300 * n, "{n}: {choice}");
            assert!(n < 16 || choice.starts[0].nesting > 4 * choice.cost.nesting, "{n}: {choice}");
        }
    }

    /// Against all spanning trees of small graphs.
    #[test]
    fn small_graphs_are_cut_best_or_nearly() {
        let mut random = phipsi_model::Random::new(1);
        let (mut exact, mut tried) = (0, 0);
        for _ in 0..60 {
            let bodies = 2 + random.below(4);
            let mut joints = vec![joint(None, Some(0), 1)];
            for k in 1..bodies {
                joints.push(joint(Some(random.below(k)), Some(k), 1 + random.below(3)));
            }
            for _ in 0..1 + random.below(3) {
                let a = if random.below(3) == 0 { None } else { Some(random.below(bodies)) };
                joints.push(joint(a, Some(random.below(bodies)), 1 + random.below(3)));
            }
            let choice = choose_cuts(bodies, &joints);
            let graph = Graph { bodies, joints: &joints };
            let mut best: Option<Cost> = None;
            for mask in 0u32..1 << joints.len() {
                let kept: Vec<bool> =
                    (0..joints.len()).map(|j| mask >> j & 1 == 1 && graph.is_real(j)).collect();
                let laid = graph.layout(&kept);
                let whole = laid.tree.iter().all(|t| t.joint.is_some());
                if whole && kept.iter().filter(|k| **k).count() == bodies {
                    best = Some(best.map_or(laid.cost, |b| b.min(laid.cost)));
                }
            }
            let best = best.unwrap();
            assert!(choice.cost.nesting <= 2 * best.nesting, "{choice} {best:?}");
            exact += usize::from(choice.cost == best);
            tried += 1;
        }
        assert!(10 * exact >= 9 * tried, "{exact} of {tried}");
    }

    /// What an exchange is expected to cost is what the new tree costs.
    #[test]
    fn exchanges_cost_what_is_expected() {
        let mut random = phipsi_model::Random::new(2);
        let mut compared = 0;
        for _ in 0..100 {
            let bodies = 2 + random.below(8);
            let mut joints = Vec::new();
            for k in 0..bodies {
                let a = if random.below(4) == 0 { None } else { k.checked_sub(1 + random.below(2)) };
                joints.push(GraphJoint {
                    // Some bodies float.
                    cut: if random.below(6) == 0 { Some(true) } else { None },
                    ..joint(a, Some(k), random.below(7))
                });
            }
            for _ in 0..random.below(6) {
                joints.push(joint(Some(random.below(bodies)), Some(random.below(bodies)), random.below(7)));
            }
            let graph = Graph { bodies, joints: &joints };
            let mut kept = graph.start([Start::Breadth, Start::Depth, Start::ShortLoops][random.below(3)]);
            let laid = graph.layout(&kept).index(&graph, &kept);
            let mut shared = vec![0; bodies];
            for cut in (0..joints.len()).filter(|&j| graph.is_real(j) && joints[j].cut.is_none()) {
                if kept[cut] {
                    continue;
                }
                let cycle = laid.cycle(&graph, cut);
                for &body in &cycle {
                    let inside = laid.joint(body).unwrap();
                    let expected = laid.nesting_after(&graph, &cycle, cut, body, &mut shared);
                    (kept[cut], kept[inside]) = (true, false);
                    assert_eq!(expected, graph.layout(&kept).cost.nesting, "{joints:?}");
                    (kept[cut], kept[inside]) = (false, true);
                    compared += 1;
                }
            }
        }
        assert!(compared > 300, "{compared}");
    }

    #[test]
    fn the_user_decides() {
        let joints = [
            GraphJoint { cut: Some(true), ..joint(None, Some(0), 1) },
            joint(Some(0), Some(1), 1),
            GraphJoint { cut: Some(false), ..joint(Some(1), Some(2), 3) },
            joint(None, Some(2), 1),
        ];
        let choice = choose_cuts(3, &joints);
        assert_eq!(choice.cuts, [0]);
        let wrong = [joint(Some(0), Some(0), 1), joint(Some(7), Some(0), 1)];
        let choice = choose_cuts(1, &wrong);
        assert_eq!(choice.tree, [TreeJoint { body: 0, joint: None, parent: None }]);
        assert_eq!(choice.cuts, [0, 1]);
    }

    /// A platform on six legs hangs on one of them: fifteen rows, not eighteen with a free platform.
    #[test]
    fn a_platform_hangs_on_a_leg() {
        let mut joints = Vec::new();
        for leg in 0..6 {
            joints.push(joint(None, Some(1 + 2 * leg), 2));
            joints.push(joint(Some(1 + 2 * leg), Some(2 + 2 * leg), 1));
            joints.push(joint(Some(2 + 2 * leg), Some(0), 3));
        }
        let choice = choose_cuts(13, &joints);
        assert_eq!((choice.cuts.len(), choice.cost.rows), (5, 15), "{choice}");
    }
}
