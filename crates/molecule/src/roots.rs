//! Roots of the trees of clusters, and the clusters in order from them.
//!
//! The root is the mass centroid: the cluster whose heaviest branch is lightest. A light spinning base makes the implicit
//! drift of the midpoint method converge several times more slowly; ln det M and the distribution do not depend on it.

use crate::atoms::{Atoms, MoleculeError, MoleculeErrors};
use crate::clusters::Clusters;

/// A cluster in the order of its tree, parents before children.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rooted {
    /// The cluster.
    pub(crate) cluster: usize,
    /// The atom at its origin: the outboard end of its hinge, or the base atom.
    pub(crate) atom: usize,
    /// The hinge to its parent and the atom at the hinge's inboard end.
    pub(crate) hinge: Option<(usize, usize)>,
    /// It has hinges, to its parent or to children.
    pub(crate) has_hinges: bool,
}

/// All clusters, tree by tree; the base atom of a root is the given one, or the first of its cluster.
pub(crate) fn rooted(
    atoms: &Atoms,
    clusters: &Clusters,
    roots: &[usize],
) -> Result<Vec<Rooted>, MoleculeErrors> {
    let n = clusters.clusters.len();
    let mut hinges_of: Vec<Vec<usize>> = vec![Vec::new(); n];
    for (h, hinge) in clusters.hinges.iter().enumerate() {
        hinge.clusters.iter().for_each(|&c| hinges_of[c].push(h));
    }
    let walk = |start: usize, atom: usize| {
        let mut order =
            vec![Rooted { cluster: start, atom, hinge: None, has_hinges: !hinges_of[start].is_empty() }];
        let mut next = 0;
        while next < order.len() {
            let here = order[next];
            next += 1;
            for &h in &hinges_of[here.cluster] {
                if here.hinge.is_some_and(|(own, _)| own == h) {
                    continue;
                }
                let hinge = &clusters.hinges[h];
                let inner = usize::from(hinge.clusters[1] == here.cluster);
                let (atom, inboard) = (hinge.atoms[1 - inner], hinge.atoms[inner]);
                let cluster = hinge.clusters[1 - inner];
                order.push(Rooted { cluster, atom, hinge: Some((h, inboard)), has_hinges: true });
            }
        }
        order
    };
    let mut chosen: Vec<Option<usize>> = vec![None; n];
    let mut errors = Vec::new();
    for &atom in roots {
        match clusters.cluster_of.get(atom) {
            None => errors.push(MoleculeError::new(
                "roots",
                format!("atom {atom}"),
                format!("atoms of 0…{}", atoms.len().saturating_sub(1)),
                "correct the index; atoms count from 0",
            )),
            Some(&c) => chosen[c] = Some(atom),
        }
    }
    let mut seen = vec![false; n];
    let mut all = Vec::with_capacity(n);
    for start in 0..n {
        if seen[start] {
            continue;
        }
        let tree = walk(start, clusters.clusters[start][0]);
        tree.iter().for_each(|step| seen[step.cluster] = true);
        let wanted: Vec<usize> = tree.iter().filter_map(|step| chosen[step.cluster]).collect();
        if let [first, second, ..] = wanted[..] {
            errors.push(MoleculeError::new(
                "roots",
                format!("atoms {} and {} of one molecule", atoms.label(first), atoms.label(second)),
                "one root for each molecule",
                "remove one of them",
            ));
        }
        let atom =
            wanted.first().copied().unwrap_or_else(|| clusters.clusters[centroid(atoms, clusters, &tree)][0]);
        all.extend(walk(clusters.cluster_of[atom], atom));
    }
    if errors.is_empty() { Ok(all) } else { Err(MoleculeErrors(errors)) }
}

/// The cluster whose heaviest branch is lightest, the earliest in the walk of several.
fn centroid(atoms: &Atoms, clusters: &Clusters, tree: &[Rooted]) -> usize {
    let own = |c: usize| clusters.clusters[c].iter().map(|&i| atoms.masses[i]).sum::<f64>();
    let total: f64 = tree.iter().map(|step| own(step.cluster)).sum();
    // Mass of each subtree and its heaviest child, by place in the walk.
    let mut mass: Vec<f64> = tree.iter().map(|step| own(step.cluster)).collect();
    let mut heaviest = vec![0.0f64; tree.len()];
    let place: std::collections::HashMap<usize, usize> =
        tree.iter().enumerate().map(|(i, step)| (step.cluster, i)).collect();
    for i in (1..tree.len()).rev() {
        if let Some((_, inboard)) = tree[i].hinge {
            let parent = place[&clusters.cluster_of[inboard]];
            heaviest[parent] = heaviest[parent].max(mass[i]);
            mass[parent] += mass[i];
        }
    }
    let branch = |i: usize| heaviest[i].max(total - mass[i]);
    let best = (0..tree.len()).fold(0, |best, i| if branch(i) < branch(best) { i } else { best });
    tree[best].cluster
}
