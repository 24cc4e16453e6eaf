//! Fast and slow terms, for multiple time steps.

use super::{ForceField, Term};

impl ForceField {
    /// The terms of bonds, angles, torsions and energy maps, and those of pairs: what stiffens a step and is cheap, and what is
    /// dear. Exceptions (1-4 pairs) are with the pairs. Together they are this force field.
    pub fn split(self) -> [ForceField; 2] {
        let ForceField { names, terms, constants, particles, level } = self;
        let mut parts = [(); 2].map(|()| ForceField {
            names: Vec::new(),
            terms: Vec::new(),
            constants: Vec::new(),
            particles,
            level,
        });
        for ((name, term), constant) in names.into_iter().zip(terms).zip(constants) {
            let part = &mut parts[usize::from(term.is_of_pairs())];
            part.names.push(name);
            part.terms.push(term);
            part.constants.push(constant);
        }
        parts
    }
}

impl Term {
    fn is_of_pairs(&self) -> bool {
        match self {
            Term::HarmonicBond(_)
            | Term::HarmonicAngle(_)
            | Term::PeriodicTorsion(_)
            | Term::RbTorsion(_)
            | Term::Cmap(_)
            | Term::CustomBond(_)
            | Term::CustomAngle(_)
            | Term::CustomTorsion(_) => false,
            Term::Nonbonded(_)
            | Term::GeneralizedBorn(_)
            | Term::LennardJonesTable(_)
            | Term::CustomNonbonded(_)
            | Term::CustomGb(_) => true,
        }
    }
}
