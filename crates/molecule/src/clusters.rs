//! Rigid clusters of atoms: what is left when the hinges are cut.
//!
//! A hinge is a bond about which its two sides turn. By default these are all bonds that lie on no ring and have more than
//! one atom on either side. A hinge is locked, and said to be, if one of its clusters lies on one line with all its hinges:
//! turning about that line moves nothing. Bonds of flexible rings are hinges too, one of each ring a closure (`rings.rs`), unless all
//! other bonds of the ring are rigid, which locks the last; a hinge may bend besides, which opens a bond angle (`angles.rs`).

use crate::angles::{Angles, Bend};
use crate::atoms::{Atoms, MoleculeError, MoleculeErrors};
use crate::bond_kind::{BondKind, Chemistry};
use crate::bridges::bridges;
use crate::clustering::{Clustering, Hinges, check_clustering};
use crate::rings::{Rings, SMALL};
use phipsi_spatial::Vec3;

/// Atoms nearer than this to a line (nm) lie on it: a rotor that close to its axis has less than a tenth of the inertia of
/// a hydroxyl and would set the time step. Five degrees of a bond to hydrogen.
const LINEAR: f64 = 0.01;

/// A hinge between two clusters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HingeBond {
    /// The bond, as it was given.
    pub atoms: [usize; 2],
    /// The clusters of its two atoms.
    pub clusters: [usize; 2],
    /// Its kind.
    pub kind: BondKind,
    /// Its sides turn about the bond; otherwise they bend only.
    pub turns: bool,
    /// The angle that is open at one of its ends.
    pub bend: Option<Bend>,
}

impl HingeBond {
    /// The open angle h–i–j at it: i–j is the hinge, h rests in the cluster of i.
    pub fn open_angle(&self) -> Option<[usize; 3]> {
        let Bend { reference, center } = self.bend?;
        let other = if self.atoms[0] == center { self.atoms[1] } else { self.atoms[0] };
        Some([reference, center, other])
    }
}

/// A hinge that was asked for and does not turn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LockedHinge {
    /// The bond.
    pub atoms: [usize; 2],
    /// Why.
    pub why: String,
}

/// Molecules as rigid clusters and hinges; the hinges make a forest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Clusters {
    /// Atoms of each cluster, ascending; clusters in the order of their first atoms.
    pub clusters: Vec<Vec<usize>>,
    /// The cluster of each atom.
    pub cluster_of: Vec<usize>,
    /// Hinges, in the order of the bonds.
    pub hinges: Vec<HingeBond>,
    /// Bonds of flexible rings at which the rings are cut, and closed again: length and both adjacent angles are kept, the sides
    /// turn about the bond.
    pub closures: Vec<HingeBond>,
    /// Hinges that were locked.
    pub locked: Vec<LockedHinge>,
}

/// Union-find with path halving.
struct Union(Vec<usize>);

impl Union {
    fn find(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }
    fn join(&mut self, i: usize, j: usize) {
        let (a, b) = (self.find(i), self.find(j));
        self.0[a.max(b)] = a.min(b);
    }
}

impl Clusters {
    /// Divides molecules. `positions`: one for each atom, nm; they tell only which clusters are linear.
    ///
    /// # Errors
    /// [`MoleculeErrors`]: tables that contradict each other, and hinges on rings.
    pub fn new(
        atoms: &Atoms,
        positions: &[Vec3<f64>],
        clustering: &Clustering,
    ) -> Result<Self, MoleculeErrors> {
        let mut errors = atoms.check();
        if positions.len() != atoms.len() {
            errors.push(MoleculeError::new(
                "positions",
                format!("{} entries", positions.len()),
                format!("one for each of the {} atoms", atoms.len()),
                "give the positions of the same atoms",
            ));
        }
        if errors.is_empty() {
            errors = check_clustering(atoms, clustering);
        }
        if let Some(i) = positions.iter().position(|x| x.0.iter().any(|c| !c.is_finite())) {
            errors.push(MoleculeError::new(
                format!("atom {}", i),
                format!("position {:?} nm", positions[i].0),
                "finite numbers",
                "correct the position",
            ));
        }
        if !errors.is_empty() {
            return Err(MoleculeErrors(errors));
        }
        let mut division = Division::new(atoms, clustering);
        division.choose(clustering)?;
        division.lock_rings(clustering, positions)?;
        division.lock_linear(positions, &clustering.angles);
        let small = std::mem::take(&mut division.small);
        let mut clusters = division.finish();
        clusters.open_angles(atoms, positions, &clustering.angles, &small)?;
        Ok(clusters)
    }
    /// Number of hinges that turn.
    pub fn torsions(&self) -> usize {
        self.hinges.iter().filter(|h| h.turns).count()
    }
    /// Number of open bond angles.
    pub fn bends(&self) -> usize {
        self.hinges.iter().filter(|h| h.bend.is_some()).count()
    }
    /// Atoms at rest in each cluster: its own, and the far ends of its hinges that do not bend on this side.
    pub fn at_rest(&self) -> Vec<Vec<usize>> {
        let mut at_rest = self.clusters.clone();
        for hinge in &self.hinges {
            for side in 0..2 {
                if hinge.bend.is_none_or(|b| b.center == hinge.atoms[1 - side]) {
                    at_rest[hinge.clusters[side]].push(hinge.atoms[1 - side]);
                }
            }
        }
        at_rest
    }
}

/// Work in progress: clusters as a union-find of atoms, hinges as indices of bonds.
struct Division<'a> {
    atoms: &'a Atoms,
    neighbors: Vec<Vec<usize>>,
    is_free: Vec<bool>,
    union: Union,
    hinges: Vec<usize>,
    closures: Vec<usize>,
    /// Hinges whose torsion is not asked for: an angle at them is.
    bent_only: Vec<usize>,
    /// Small flexible rings, whose angles have to give way.
    small: Vec<Vec<usize>>,
    locked: Vec<LockedHinge>,
}

impl<'a> Division<'a> {
    fn new(atoms: &'a Atoms, clustering: &Clustering) -> Self {
        let mut is_free = vec![false; atoms.len()];
        clustering.free.iter().for_each(|&i| is_free[i] = true);
        Division {
            atoms,
            neighbors: atoms.neighbors(),
            is_free,
            union: Union((0..atoms.len()).collect()),
            hinges: Vec::new(),
            closures: Vec::new(),
            bent_only: Vec::new(),
            small: Vec::new(),
            locked: Vec::new(),
        }
    }

    /// A bond that ties its atoms: none of them is free.
    fn ties(&self, bond: &[usize; 2]) -> bool {
        !bond.iter().any(|&i| self.is_free[i])
    }

    /// Hinges by the user's choice and by kind; all other bonds join their atoms.
    fn choose(&mut self, clustering: &Clustering) -> Result<(), MoleculeErrors> {
        let bonds = &self.atoms.bonds;
        let sides = bridges(self.atoms.len(), bonds);
        let sorted = |b: &[usize; 2]| [b[0].min(b[1]), b[0].max(b[1])];
        let mut in_ring = Vec::new();
        let mut is_hinge: Vec<bool> = match &clustering.hinges {
            Hinges::Rotatable => sides.iter().map(|s| s.is_bridge && s.smaller > 1).collect(),
            Hinges::Bonds(wanted) => {
                let wanted: std::collections::HashSet<_> = wanted.iter().map(sorted).collect();
                bonds.iter().map(|b| wanted.contains(&sorted(b))).collect()
            }
            Hinges::Clusters(clusters) => {
                let mut cluster = vec![usize::MAX; self.atoms.len()];
                for (c, list) in clusters.iter().enumerate() {
                    for &i in list {
                        cluster[i] = c;
                        self.union.join(list[0], i);
                    }
                }
                bonds.iter().map(|b| cluster[b[0]] != cluster[b[1]]).collect()
            }
        };
        let mut flexible = vec![false; bonds.len()];
        for (b, bond) in bonds.iter().enumerate().filter(|(b, _)| !sides[*b].is_bridge) {
            let Some(ring) = clustering.rings.ring_of(self.atoms, &self.neighbors, *bond) else { continue };
            flexible[b] = true;
            if matches!(clustering.hinges, Hinges::Rotatable) {
                is_hinge[b] = true;
            }
            if is_hinge[b] && ring.len() <= SMALL && !self.small.contains(&ring) {
                self.small.push(ring);
            }
        }
        for (b, bond) in bonds.iter().enumerate().filter(|(b, _)| sides[*b].is_bridge) {
            if !is_hinge[b] && clustering.angles.opens(*bond) {
                is_hinge[b] = true;
            }
        }
        let chemistry = Chemistry::new(self.atoms, &self.neighbors);
        for (b, bond) in bonds.iter().enumerate() {
            if !self.ties(bond) {
                continue;
            }
            if is_hinge[b] && !clustering.rigid.contains(&chemistry.kind(*bond)) {
                self.hinges.push(b);
                if !sides[b].is_bridge && !flexible[b] {
                    in_ring.push(b);
                }
            } else {
                self.union.join(bond[0], bond[1]);
            }
        }
        if in_ring.is_empty() {
            return Ok(());
        }
        let error = |&b: &usize| {
            MoleculeError::new(
                format!("hinge {}", self.atoms.bond_label(bonds[b])),
                "it lies on a ring",
                "hinges outside rings, or a flexible ring",
                "make the ring flexible (`rings`), take it from the hinges, or put the atoms of the ring into one cluster",
            )
        };
        Err(MoleculeErrors(in_ring.iter().map(error).collect()))
    }

    /// Hinges on rings of clusters. Those between atoms of one group, and the last of a ring whose other bonds are rigid, are locked;
    /// of a flexible ring one is a closure; other such rings are closed by groups, or must not be.
    fn lock_rings(&mut self, clustering: &Clustering, positions: &[Vec3<f64>]) -> Result<(), MoleculeErrors> {
        for group in &clustering.groups {
            for &i in group {
                self.union.join(group[0], i);
            }
        }
        let hinges = std::mem::take(&mut self.hinges);
        let ends: Vec<[usize; 2]> = hinges.iter().map(|&b| self.ends(b)).collect();
        let sides = bridges(self.atoms.len(), &ends);
        let mut errors = Vec::new();
        let mut cyclic = Vec::new();
        for (h, &b) in hinges.iter().enumerate() {
            let bond = self.atoms.bonds[b];
            if sides[h].is_bridge {
                self.hinges.push(b);
            } else if clustering.rings.includes(bond) && ends[h][0] != ends[h][1] {
                cyclic.push(b);
            } else if clustering.groups.is_empty() && ends[h][0] == ends[h][1] {
                if clustering.rigid.is_empty() {
                    errors.push(MoleculeError::new(
                        format!("hinge {}", self.atoms.bond_label(bond)),
                        "no other bond of its ring turns",
                        "several bonds of a ring that turn",
                        "add other bonds of the ring to the hinges, or take it from them",
                    ));
                } else {
                    self.lock(b, "the other bonds of its ring are rigid, and with them the ring");
                }
            } else if clustering.groups.is_empty() {
                errors.push(MoleculeError::new(
                    format!("hinge {}", self.atoms.bond_label(bond)),
                    "its two clusters are also joined by other hinges",
                    "clusters without rings between them, or flexible rings",
                    "make the ring flexible (`rings`), or put the atoms of the ring into one cluster",
                ));
            } else {
                self.lock(b, "both its sides are in one rigid group");
            }
        }
        if !errors.is_empty() {
            return Err(MoleculeErrors(errors));
        }
        self.cut(cyclic, positions);
        self.hinges.sort_unstable();
        Ok(())
    }

    /// Divides hinges on rings into those of a tree and one closure for each ring; bonds that are good to cut come last.
    fn cut(&mut self, mut cyclic: Vec<usize>, positions: &[Vec3<f64>]) {
        let atoms = self.atoms;
        // What a side keeps off the axis of its last hinge: its atoms, and hinges besides the bond that is cut.
        let mut near: Vec<Vec<usize>> = vec![Vec::new(); atoms.len()];
        for i in 0..atoms.len() {
            near[self.union.find(i)].push(i);
        }
        for b in self.hinges.iter().chain(&cyclic).copied().collect::<Vec<_>>() {
            let [i, j] = atoms.bonds[b];
            let ends = self.ends(b);
            near[ends[0]].push(j);
            near[ends[1]].push(i);
        }
        let mut has_inertia = |b: usize| {
            let [i, j] = atoms.bonds[b];
            let ends = self.ends(b);
            [(ends[0], j), (ends[1], i)].into_iter().all(|(c, far)| {
                let kept = near[c].iter().filter(|&&a| a != far).map(|&a| positions[a]);
                !is_linear(&kept.collect::<Vec<_>>())
            })
        };
        let good: std::collections::HashSet<usize> =
            cyclic.iter().copied().filter(|&b| has_inertia(b)).collect();
        let rank = |b: usize| match good.contains(&b) {
            true => 1 + Rings::cut_rank(atoms, &self.neighbors, atoms.bonds[b]),
            false => 0,
        };
        cyclic.sort_by_key(|&b| (rank(b), b));
        let mut joined = Union((0..atoms.len()).collect());
        for i in 0..atoms.len() {
            let root = self.union.find(i);
            joined.join(root, i);
        }
        for &b in &self.hinges {
            joined.join(atoms.bonds[b][0], atoms.bonds[b][1]);
        }
        for b in cyclic {
            let [i, j] = atoms.bonds[b];
            if joined.find(i) == joined.find(j) {
                self.closures.push(b);
            } else {
                joined.join(i, j);
                self.hinges.push(b);
            }
        }
        self.closures.sort_unstable();
    }

    fn ends(&mut self, b: usize) -> [usize; 2] {
        self.atoms.bonds[b].map(|i| self.union.find(i))
    }

    fn lock(&mut self, b: usize, why: &str) {
        let atoms = self.atoms.bonds[b];
        self.union.join(atoms[0], atoms[1]);
        self.locked.push(LockedHinge { atoms, why: why.into() });
    }

    /// Locks one hinge of every cluster that lies on one line with its hinges, until there is none.
    fn lock_linear(&mut self, positions: &[Vec3<f64>], angles: &Angles) {
        let mut members: Vec<Vec<usize>> = vec![Vec::new(); self.atoms.len()];
        for i in 0..self.atoms.len() {
            members[self.union.find(i)].push(i);
        }
        let mut hinges_of: Vec<Vec<usize>> = vec![Vec::new(); self.atoms.len()];
        for &b in &self.hinges.clone() {
            self.ends(b).into_iter().for_each(|c| hinges_of[c].push(b));
        }
        // Bonds at which rings are closed keep their far ends at rest too, but cannot be locked.
        let mut closed_at: Vec<Vec<usize>> = vec![Vec::new(); self.atoms.len()];
        for &b in &self.closures.clone() {
            self.ends(b).into_iter().for_each(|c| closed_at[c].push(b));
        }
        let mut open: Vec<usize> = (0..self.atoms.len()).rev().filter(|&c| !members[c].is_empty()).collect();
        let mut is_locked = vec![false; self.atoms.bonds.len()];
        while let Some(c) = open.pop() {
            hinges_of[c].retain(|&b| !is_locked[b]);
            if members[c].is_empty() || hinges_of[c].is_empty() {
                continue;
            }
            // The atoms at the far ends of hinges keep their places in the cluster too.
            let bonds = hinges_of[c].iter().chain(&closed_at[c]).map(|&b| self.atoms.bonds[b]);
            let points: Vec<Vec3<f64>> =
                members[c].iter().copied().chain(bonds.flatten()).map(|i| positions[i]).collect();
            if !is_linear(&points) {
                continue;
            }
            let Some(&b) = hinges_of[c].iter().find(|b| !self.bent_only.contains(b)) else { continue };
            if angles.opens(self.atoms.bonds[b]) {
                self.bent_only.push(b);
                continue;
            }
            let [one, other] = self.ends(b);
            is_locked[b] = true;
            self.lock(b, "its axis is the line on which all atoms of one side lie, which it would not move");
            let joined = self.union.find(one);
            let gone = if joined == one { other } else { one };
            let (moved, hinges) = (std::mem::take(&mut members[gone]), std::mem::take(&mut hinges_of[gone]));
            let closures = std::mem::take(&mut closed_at[gone]);
            members[joined].extend(moved);
            hinges_of[joined].extend(hinges);
            closed_at[joined].extend(closures);
            open.push(joined);
        }
        self.hinges.retain(|&b| !is_locked[b]);
    }

    fn finish(mut self) -> Clusters {
        let n = self.atoms.len();
        let mut number = vec![usize::MAX; n];
        let mut clusters: Vec<Vec<usize>> = Vec::new();
        let mut cluster_of = Vec::with_capacity(n);
        for i in 0..n {
            let root = self.union.find(i);
            if number[root] == usize::MAX {
                number[root] = clusters.len();
                clusters.push(Vec::new());
            }
            clusters[number[root]].push(i);
            cluster_of.push(number[root]);
        }
        let chemistry = Chemistry::new(self.atoms, &self.neighbors);
        let hinge = |&b: &usize| {
            let atoms = self.atoms.bonds[b];
            HingeBond {
                atoms,
                clusters: atoms.map(|i| cluster_of[i]),
                kind: chemistry.kind(atoms),
                turns: !self.bent_only.contains(&b),
                bend: None,
            }
        };
        let [hinges, closures] = [&self.hinges, &self.closures].map(|list| list.iter().map(hinge).collect());
        Clusters { clusters, cluster_of, hinges, closures, locked: self.locked }
    }
}

/// True if all points are within [`LINEAR`] of the line through the first and the farthest from it.
pub(crate) fn is_linear(points: &[Vec3<f64>]) -> bool {
    let Some(&first) = points.first() else { return true };
    let far =
        points.iter().fold(first, |far, &x| if (x - first).norm() > (far - first).norm() { x } else { far });
    let line = far - first;
    let length = line.norm();
    length == 0.0 || points.iter().all(|&x| line.cross(x - first).norm() <= LINEAR * length)
}
