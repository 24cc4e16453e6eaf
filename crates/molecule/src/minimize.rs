//! Minimisation of a molecule's potential in its torsions and bases, and the announcement of strained starts.

use crate::lbfgs::{MinimizeOptions, Minimum, lbfgs};
use crate::molecular_forces::{MolecularError, MolecularForces};
use crate::potential::Potential;
use phipsi_motion::Conservative;
use std::fmt;

/// A force on an atom above this (kJ/mol/nm) is announced: at 300 K hardly any exceeds a tenth of it.
pub const STRAINED: f64 = 1e5;

/// A start with an atom that is pushed hard.
#[derive(Clone, Debug, PartialEq)]
pub struct Strain {
    /// The atom.
    pub atom: String,
    /// The force on it, kJ/mol/nm.
    pub force: f64,
    /// The nearest atom of another cluster, and its distance, nm; bonded ones and their neighbours do not count.
    pub nearest: Option<(String, f64)>,
}

impl fmt::Display for Strain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Strain { atom, force, nearest } = self;
        write!(f, "atom {atom} starts with a force of {force:.1e} kJ/mol/nm")?;
        if let Some((other, distance)) = nearest {
            write!(f, ", its nearest atom {other} at {distance:.3} nm")?;
        }
        write!(
            f,
            "; above {STRAINED:.0e} a run needs minimising first, and what torsions cannot resolve stays"
        )
    }
}

/// The strain at a configuration, if an atom's force exceeds [`STRAINED`].
///
/// # Errors
/// [`MolecularError`] of the potential.
pub fn strain<P: Potential>(
    forces: &mut MolecularForces<P>,
    q: &[f64],
) -> Result<Option<Strain>, MolecularError> {
    let torsion = forces.torsion().clone();
    forces.evaluate(q, &mut vec![0.0; torsion.model().nv()])?;
    let Some((atom, force)) = forces.largest_force().filter(|(_, force)| *force > STRAINED) else {
        return Ok(None);
    };
    let neighbors = torsion.atoms().neighbors();
    let mut near = vec![atom];
    near.extend(&neighbors[atom]);
    near.extend(neighbors[atom].iter().flat_map(|&n| &neighbors[n]));
    let cluster_of = &torsion.clusters().cluster_of;
    let positions = forces.positions();
    let distance = |i: &usize| (positions[*i] - positions[atom]).norm();
    let others = (0..positions.len()).filter(|i| cluster_of[*i] != cluster_of[atom] && !near.contains(i));
    let nearest = others.min_by(|a, b| distance(a).total_cmp(&distance(b)));
    Ok(Some(Strain {
        atom: torsion.atoms().label(atom),
        force,
        nearest: nearest.map(|i| (torsion.atoms().label(i), distance(&i))),
    }))
}

/// Minimises from a configuration. The strain of the start is returned with the minimum.
///
/// # Errors
/// [`MolecularError`] of the potential at the start; flexible rings that are open there.
pub fn minimize<P: Potential>(
    forces: &mut MolecularForces<P>,
    q: &[f64],
    options: &MinimizeOptions,
) -> Result<(Minimum, Option<Strain>), MolecularError> {
    let torsion = forces.torsion().clone();
    let strain = strain(forces, q)?;
    let minimum = lbfgs(torsion.model(), torsion.layout(), forces, q, options)?;
    Ok((minimum, strain))
}
