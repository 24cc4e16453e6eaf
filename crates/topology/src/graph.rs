//! Spanning trees of graphs of bodies and joints.
//!
//! Node 0 of the answer's order is whatever hangs first on the ground; edges that would close a loop are returned as cut.

/// An edge of the graph: a joint from `parent` (`None`: the ground) to `child`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Node on the inboard side as the user wrote it.
    pub parent: Option<usize>,
    /// Node on the outboard side as the user wrote it.
    pub child: usize,
}

/// An edge that the tree uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TreeEdge {
    /// The node it reaches.
    pub node: usize,
    /// Its index in the list of edges.
    pub edge: usize,
}

/// Nodes in depth-first order, each with the edge that reaches it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpanningTree {
    /// Parents before children; children of a node in the order of the edges.
    pub order: Vec<TreeEdge>,
    /// Edges that are not in the tree: each closes a loop.
    pub cut: Vec<usize>,
    /// Nodes that no edge chain reaches from the ground.
    pub unreached: Vec<usize>,
}

/// Depth-first spanning tree from the ground along the edges' own directions.
///
/// A node is reached by the first edge, in depth-first order, that leads to it; later edges to it are cut.
/// Cost O(nodes + edges); no recursion, so that depth is limited by memory only.
///
/// ```
/// # use phipsi_topology::{Edge, spanning_tree};
/// let edges = [Edge { parent: None, child: 0 }, Edge { parent: Some(0), child: 1 }, Edge { parent: Some(1), child: 0 }];
/// let tree = spanning_tree(2, &edges);
/// assert_eq!(tree.order.len(), 2);
/// assert_eq!(tree.cut, [2]);
/// ```
pub fn spanning_tree(nodes: usize, edges: &[Edge]) -> SpanningTree {
    // Outgoing edges of each node in one array: counting sort by parent, the ground last.
    let bucket = |e: &Edge| e.parent.unwrap_or(nodes);
    let mut start = vec![0usize; nodes + 2];
    for e in edges {
        start[bucket(e) + 1] += 1;
    }
    for i in 0..=nodes {
        start[i + 1] += start[i];
    }
    let mut fill = start.clone();
    let mut outgoing = vec![0usize; edges.len()];
    for (i, e) in edges.iter().enumerate() {
        outgoing[fill[bucket(e)]] = i;
        fill[bucket(e)] += 1;
    }
    let mut reached = vec![false; nodes];
    let mut used = vec![false; edges.len()];
    let mut order = Vec::with_capacity(nodes);
    let mut stack: Vec<usize> = outgoing[start[nodes]..start[nodes + 1]].iter().rev().copied().collect();
    while let Some(edge) = stack.pop() {
        let node = edges[edge].child;
        if reached[node] {
            continue;
        }
        reached[node] = true;
        used[edge] = true;
        order.push(TreeEdge { node, edge });
        stack.extend(outgoing[start[node]..start[node + 1]].iter().rev());
    }
    let cut = (0..edges.len()).filter(|&i| !used[i] && edges[i].parent.is_none_or(|p| reached[p])).collect();
    let unreached = (0..nodes).filter(|&k| !reached[k]).collect();
    SpanningTree { order, cut, unreached }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_first_keeps_the_order_of_edges() {
        let e = |parent, child| Edge { parent, child };
        let edges = [e(Some(0), 1), e(Some(0), 2), e(None, 0), e(Some(1), 3), e(Some(5), 4)];
        let tree = spanning_tree(6, &edges);
        let nodes: Vec<usize> = tree.order.iter().map(|t| t.node).collect();
        assert_eq!(nodes, [0, 1, 3, 2]);
        assert_eq!(tree.unreached, [4, 5]);
        assert!(tree.cut.is_empty());
    }

    #[test]
    fn a_long_chain_does_not_recurse() {
        let n = 200_000usize;
        let edges: Vec<Edge> = (0..n).map(|k| Edge { parent: k.checked_sub(1), child: k }).collect();
        assert_eq!(spanning_tree(n, &edges).order.len(), n);
    }
}
