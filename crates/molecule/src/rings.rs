//! Flexible rings: which bonds of rings are hinges, and where a ring is cut.
//!
//! | ring | what it does when it is flexible |
//! |---|---|
//! | three or four atoms; up to six atoms with at most three neighbours each (aromatic) | stays rigid |
//! | five to seven atoms | one bond is a closure, the others turn, and three bond angles open: n − 3 degrees of freedom, as many as coordinates of pucker |
//! | larger | one bond is a closure, the others turn: n − 6 degrees of freedom |
//!
//! Both ends of the cut bond need atoms off the axes of their last hinges, or nothing would turn there: a sulfur of a disulfide
//! has none, and its ring is cut elsewhere.

use crate::atoms::Atoms;
use std::collections::VecDeque;

/// Rings of up to so many atoms cannot move without their angles: n − 6 degrees of freedom are too few.
pub(crate) const SMALL: usize = 7;

/// Rings below this size stay rigid.
const SMALLEST: usize = 5;

/// Angles of a small ring that open.
pub(crate) const OPEN_ANGLES: usize = 3;

const HYDROGEN: u8 = 1;

/// Which rings are flexible.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Rings {
    /// None.
    #[default]
    Rigid,
    /// All that are not aromatic or of fewer than five atoms.
    Flexible,
    /// Those whose bonds lie between atoms of one of these lists.
    Listed(Vec<Vec<usize>>),
}

/// Reports indices that are no atoms.
pub(crate) fn check_rings(rings: &Rings, check: &mut dyn FnMut(&str, &mut dyn Iterator<Item = &usize>)) {
    if let Rings::Listed(lists) = rings {
        check("rings", &mut lists.iter().flatten());
    }
}

impl Rings {
    /// A bond may be one of a flexible ring.
    pub(crate) fn includes(&self, bond: [usize; 2]) -> bool {
        match self {
            Rings::Rigid => false,
            Rings::Flexible => true,
            Rings::Listed(lists) => lists.iter().any(|list| bond.iter().all(|i| list.contains(i))),
        }
    }
    /// The smallest ring of a bond (its atoms, ascending) if it is flexible.
    pub(crate) fn ring_of(
        &self,
        atoms: &Atoms,
        neighbors: &[Vec<usize>],
        bond: [usize; 2],
    ) -> Option<Vec<usize>> {
        if !self.includes(bond) {
            return None;
        }
        let ring = smallest_ring(atoms.len(), neighbors, bond)?;
        let aromatic = ring.len() <= 6 && ring.iter().all(|&i| neighbors[i].len() <= 3);
        (ring.len() >= SMALLEST && !aromatic).then_some(ring)
    }
    /// The rank of a bond among those of its rings: the highest is cut. Bonds between atoms that carry nothing but hydrogens
    /// besides the ring; then those with one such end; last others.
    pub(crate) fn cut_rank(atoms: &Atoms, neighbors: &[Vec<usize>], bond: [usize; 2]) -> usize {
        let heavy = |a: usize| neighbors[a].iter().filter(|&&n| atoms.elements[n] != HYDROGEN).count();
        bond.into_iter().filter(|&a| heavy(a) <= 2).count()
    }
}

/// The atoms of the shortest path between the ends of a bond that does not use it.
fn smallest_ring(n: usize, neighbors: &[Vec<usize>], [from, to]: [usize; 2]) -> Option<Vec<usize>> {
    let mut before = vec![usize::MAX; n];
    let mut open = VecDeque::from([from]);
    before[from] = from;
    while let Some(i) = open.pop_front() {
        for &j in &neighbors[i] {
            if before[j] == usize::MAX && !(i == from && j == to) {
                before[j] = i;
                open.push_back(j);
            }
        }
    }
    if before[to] == usize::MAX {
        return None;
    }
    let mut ring = vec![to];
    while *ring.last()? != from {
        ring.push(before[*ring.last()?]);
    }
    ring.sort_unstable();
    Some(ring)
}
