//! Bridges of a graph: edges that lie on no ring, and the number of nodes on either side of each.

/// What one edge does to the graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Side {
    /// Without it the graph falls apart.
    pub is_bridge: bool,
    /// For a bridge, the smaller number of nodes on a side.
    pub smaller: usize,
}

/// For every edge, by one depth-first search with low links. Cost O(nodes + edges), no recursion.
pub(crate) fn bridges(nodes: usize, edges: &[[usize; 2]]) -> Vec<Side> {
    let mut adjacent: Vec<Vec<(usize, usize)>> = vec![Vec::new(); nodes];
    for (e, &[i, j]) in edges.iter().enumerate() {
        adjacent[i].push((j, e));
        adjacent[j].push((i, e));
    }
    const UNSEEN: usize = usize::MAX;
    let mut order = vec![UNSEEN; nodes];
    let mut low = vec![UNSEEN; nodes];
    let mut size = vec![1usize; nodes];
    let mut sides = vec![Side { is_bridge: false, smaller: 0 }; edges.len()];
    let mut count = 0;
    for root in 0..nodes {
        if order[root] != UNSEEN {
            continue;
        }
        // (node, edge to its parent, next neighbour); bridges with the size of their outer side.
        let mut stack = vec![(root, UNSEEN, 0usize)];
        let mut found: Vec<(usize, usize)> = Vec::new();
        (order[root], low[root]) = (count, count);
        count += 1;
        while let Some(&mut (node, edge, ref mut next)) = stack.last_mut() {
            if let Some(&(other, e)) = adjacent[node].get(*next) {
                *next += 1;
                if e == edge {
                    continue;
                }
                if order[other] == UNSEEN {
                    (order[other], low[other]) = (count, count);
                    count += 1;
                    stack.push((other, e, 0));
                } else {
                    low[node] = low[node].min(order[other]);
                }
            } else {
                stack.pop();
                if let Some(&(parent, _, _)) = stack.last() {
                    low[parent] = low[parent].min(low[node]);
                    size[parent] += size[node];
                    if low[node] > order[parent] {
                        found.push((edge, size[node]));
                    }
                }
            }
        }
        for (edge, outer) in found {
            sides[edge] = Side { is_bridge: true, smaller: outer.min(size[root] - outer) };
        }
    }
    sides
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::Random;

    /// Against the definition: what is reachable without the edge.
    #[test]
    fn bridges_are_those_of_the_definition() {
        for seed in 0..200 {
            let mut random = Random::new(seed);
            let nodes = 2 + random.below(12);
            let wanted = random.below(16);
            let edges: Vec<[usize; 2]> = (0..wanted)
                .map(|_| [random.below(nodes), random.below(nodes)])
                .filter(|[i, j]| i != j)
                .collect();
            for (e, side) in bridges(nodes, &edges).iter().enumerate() {
                let reach = |from: usize| {
                    let mut seen = vec![false; nodes];
                    seen[from] = true;
                    for _ in 0..nodes {
                        for (k, &[i, j]) in edges.iter().enumerate() {
                            if k != e && (seen[i] || seen[j]) {
                                (seen[i], seen[j]) = (true, true);
                            }
                        }
                    }
                    seen
                };
                let [i, j] = edges[e];
                let (a, b) = (reach(i), reach(j));
                assert_eq!(side.is_bridge, !a[j], "edge {e}, seed {seed}: {edges:?}");
                if side.is_bridge {
                    let count = |x: &[bool]| x.iter().filter(|s| **s).count();
                    assert_eq!(side.smaller, count(&a).min(count(&b)), "edge {e}, seed {seed}: {edges:?}");
                }
            }
        }
    }
}
