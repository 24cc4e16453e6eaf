//! Force fields: energies and forces of an OpenMM System, term by term, in double precision.
//!
//! One file per term; its formula is on its first page. Every term agrees with OpenMM's Reference platform
//! (`tests/energies.rs`).

mod born_integrals;
mod born_pairs;
mod cells;
mod check;
mod cmap;
mod custom_bonded;
mod custom_gb;
mod custom_nonbonded;
mod exclusions;
mod generalized_born;
mod geometry;
mod harmonic_angle;
mod harmonic_bond;
mod image;
mod left_out;
mod lennard_jones_table;
mod neighbors;
mod nonbonded;
mod periodic_torsion;
mod rb_torsion;
mod recognize;
mod split;
mod sweep;
mod tiles;

pub use left_out::{LeftOut, RigidGroups};

use crate::{Potential, PotentialError};
use phipsi_formats::system::{Force, ForceKind, System};
use phipsi_spatial::Vec3;
use phipsi_spatial::lanes::Level;
use std::fmt;

/// Most atoms that an error names.
const MOST_NAMED: usize = 4;

/// The energy of a System: a sum of named terms.
///
/// # Computes
/// One term for each force of the System, called by its name; a second one of the same name is called `NAME#2`.
///
/// # Shapes & units
/// positions in nm, one for each particle · energies in kJ/mol, one for each term · forces in kJ/mol/nm, −∂E/∂x.
///
/// # Cost
/// O(N²) for N particles where the System has a force between all pairs, otherwise linear in the number of its entries.
/// [`Potential::evaluate`] does not allocate.
///
/// # Errors
/// In [`Potential::evaluate`]: positions, energies or forces that are not finite, with the term and the atoms.
///
/// # Checked by
/// OpenMM's Reference platform: `tests/energies.rs`; differences of the energy: `tests/energies.rs`.
///
/// # Elsewhere
/// OpenMM `Context.getState(getEnergy=True, getForces=True, groups={…})`.
///
/// # Example
/// ```
/// use phipsi_formats::system::{SystemOptions, read_system};
/// use phipsi_molecule::{ForceField, Potential};
/// use phipsi_spatial::Vec3;
/// let text = r#"<System><Particles><Particle mass="12"/><Particle mass="16"/></Particles>
///   <Forces><Force type="HarmonicBondForce" name="CO"><Bonds><Bond p1="0" p2="1" d="0.125" k="64"/></Bonds></Force></Forces>
/// </System>"#;
/// let (system, _) = read_system(text, "co.xml", &SystemOptions::default()).into_result(true)?;
/// let mut field = ForceField::new(&system)?;
/// let positions = [Vec3([0.0; 3]), Vec3([0.0, 0.0, 0.25])];
/// let (mut energies, mut forces) = ([0.0], [Vec3([0.0; 3]); 2]);
/// field.evaluate(&positions, &mut energies, &mut forces)?;
/// assert_eq!((field.terms()[0].as_str(), energies[0], forces[0].0), ("CO", 0.5, [0.0, 0.0, 8.0]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ForceField {
    names: Vec<String>,
    terms: Vec<Term>,
    /// Energies of what each term leaves out.
    constants: Vec<f64>,
    particles: usize,
    level: Level,
}

/// A System that is no force field: an entry that its tables contradict.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ForceFieldError {
    /// The force.
    pub force: String,
    /// What was found.
    pub found: String,
    /// What is required.
    pub required: String,
}

impl fmt::Display for ForceFieldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ForceFieldError { force, found, required } = self;
        write!(f, "force `{force}`: {found}; required: {required}; correct the system")
    }
}

impl std::error::Error for ForceFieldError {}

/// The terms. Each adds its forces to those given, and returns its energy.
#[derive(Clone, Debug)]
enum Term {
    HarmonicBond(harmonic_bond::HarmonicBonds),
    HarmonicAngle(harmonic_angle::HarmonicAngles),
    PeriodicTorsion(periodic_torsion::PeriodicTorsions),
    RbTorsion(rb_torsion::RbTorsions),
    Cmap(cmap::Cmap),
    Nonbonded(nonbonded::NonbondedPairs),
    GeneralizedBorn(generalized_born::GeneralizedBorn),
    CustomBond(custom_bonded::CustomTerms<2>),
    CustomAngle(custom_bonded::CustomTerms<3>),
    CustomTorsion(custom_bonded::CustomTerms<4>),
    LennardJonesTable(lennard_jones_table::LennardJonesTable),
    CustomNonbonded(custom_nonbonded::CustomPairs),
    CustomGb(custom_gb::CustomGbTerm),
}

impl Term {
    fn new(force: &Force, n: usize) -> Term {
        match &force.kind {
            ForceKind::HarmonicBond(bonds) => Term::HarmonicBond(harmonic_bond::HarmonicBonds::new(bonds)),
            ForceKind::HarmonicAngle(angles) => {
                Term::HarmonicAngle(harmonic_angle::HarmonicAngles::new(angles))
            }
            ForceKind::PeriodicTorsion(torsions) => {
                Term::PeriodicTorsion(periodic_torsion::PeriodicTorsions::new(torsions))
            }
            ForceKind::RbTorsion(torsions) => Term::RbTorsion(rb_torsion::RbTorsions::new(torsions)),
            ForceKind::CmapTorsion(tables) => Term::Cmap(cmap::Cmap::new(tables)),
            ForceKind::Nonbonded(tables) => Term::Nonbonded(nonbonded::NonbondedPairs::new(tables)),
            ForceKind::GbsaObc(tables) => {
                Term::GeneralizedBorn(generalized_born::GeneralizedBorn::from_gbsa_obc(tables))
            }
            ForceKind::CustomBond(tables) => Term::CustomBond(custom_bonded::CustomTerms::new(tables)),
            ForceKind::CustomAngle(tables) => Term::CustomAngle(custom_bonded::CustomTerms::new(tables)),
            ForceKind::CustomTorsion(tables) => Term::CustomTorsion(custom_bonded::CustomTerms::new(tables)),
            ForceKind::CustomNonbonded(tables) => match recognize::lennard_jones(tables, n) {
                Some(term) => Term::LennardJonesTable(term),
                None => Term::CustomNonbonded(custom_nonbonded::CustomPairs::new(tables, n)),
            },
            ForceKind::CustomGb(tables) => match recognize::obc2(tables) {
                Some(term) => Term::GeneralizedBorn(term),
                None => Term::CustomGb(custom_gb::CustomGbTerm::new(tables, n)),
            },
        }
    }

    fn evaluate(&mut self, level: Level, positions: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        match self {
            Term::HarmonicBond(term) => term.evaluate(positions, forces),
            Term::HarmonicAngle(term) => term.evaluate(positions, forces),
            Term::PeriodicTorsion(term) => term.evaluate(positions, forces),
            Term::RbTorsion(term) => term.evaluate(positions, forces),
            Term::Cmap(term) => term.evaluate(positions, forces),
            Term::Nonbonded(term) => term.evaluate(level, positions, forces),
            Term::GeneralizedBorn(term) => term.evaluate(level, positions, forces),
            Term::CustomBond(term) => term.evaluate(positions, forces),
            Term::CustomAngle(term) => term.evaluate(positions, forces),
            Term::CustomTorsion(term) => term.evaluate(positions, forces),
            Term::LennardJonesTable(term) => term.evaluate(positions, forces),
            Term::CustomNonbonded(term) => term.evaluate(positions, forces),
            Term::CustomGb(term) => term.evaluate(positions, forces),
        }
    }
}

impl ForceField {
    /// The force field of a System.
    ///
    /// # Errors
    /// [`ForceFieldError`] for tables that contradict each other; the reader of Systems lets none through.
    pub fn new(system: &System) -> Result<ForceField, ForceFieldError> {
        let n = system.masses.len();
        let mut names: Vec<String> = Vec::new();
        let mut terms = Vec::new();
        for force in &system.forces {
            check::force(force, n)?;
            names.push(unused_name(&force.name, &names));
            terms.push(Term::new(force, n));
        }
        Ok(ForceField { constants: vec![0.0; names.len()], names, terms, particles: n, level: Level::best() })
    }

    /// With the instructions of a level instead of [`Level::best`], or of [`Level::Scalar`] where this processor does not have
    /// them. Energies and forces are the same to the last bit.
    #[must_use]
    pub fn at_level(mut self, level: Level) -> ForceField {
        self.level = level;
        self
    }

    /// Leaves out what is constant while the groups move as rigid bodies: bonds, angles, torsions and pairs whose atoms all belong
    /// to one group. Their energies, at these positions, stay in the energies of their terms; their forces, which move no rigid
    /// body, are no longer in the forces. Generalized Born energies, energy maps and custom energies of pairs are evaluated as
    /// before.
    ///
    /// # Errors
    /// As [`Potential::evaluate`]; the force field is then as before.
    ///
    /// # Example
    /// ```
    /// use phipsi_formats::system::{SystemOptions, read_system};
    /// use phipsi_molecule::{ForceField, Potential, RigidGroups};
    /// use phipsi_spatial::Vec3;
    /// let text = r#"<System><Particles><Particle mass="12"/><Particle mass="16"/></Particles>
    ///   <Forces><Force type="HarmonicBondForce" name="CO"><Bonds><Bond p1="0" p2="1" d="0.125" k="64"/></Bonds></Force></Forces>
    /// </System>"#;
    /// let (system, _) = read_system(text, "co.xml", &SystemOptions::default()).into_result(true)?;
    /// let mut field = ForceField::new(&system)?;
    /// let positions = [Vec3([0.0; 3]), Vec3([0.0, 0.0, 0.25])];
    /// let left_out = field.leave_out(&RigidGroups::new(2, [vec![0, 1]]), &positions)?;
    /// assert_eq!((left_out[0].entries, left_out[0].energy), ([1, 1], 0.5));
    /// let (mut energies, mut forces) = ([0.0], [Vec3([0.0; 3]); 2]);
    /// field.evaluate(&positions, &mut energies, &mut forces)?;
    /// assert_eq!((energies[0], forces[0].0), (0.5, [0.0; 3]));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn leave_out(
        &mut self,
        groups: &RigidGroups,
        positions: &[Vec3<f64>],
    ) -> Result<Vec<LeftOut>, PotentialError> {
        let mut forces = vec![Vec3::zero(); positions.len()];
        let mut energies = vec![0.0; self.terms.len()];
        self.evaluate(positions, &mut energies, &mut forces)?;
        let mut left_out = Vec::new();
        for ((term, name), constant) in self.terms.iter_mut().zip(&self.names).zip(&mut self.constants) {
            let Some((entries, energy)) = term.leave_out(groups, self.level, positions, &mut forces) else {
                continue;
            };
            *constant += energy;
            left_out.push(LeftOut { term: name.clone(), entries, energy });
        }
        Ok(left_out)
    }

    /// Number of particles.
    pub fn particles(&self) -> usize {
        self.particles
    }

    /// The energy of one term, whose forces are added to `forces`; 0 for a term that does not exist.
    ///
    /// # Errors
    /// As [`Potential::evaluate`].
    pub fn evaluate_term(
        &mut self,
        term: usize,
        positions: &[Vec3<f64>],
        forces: &mut [Vec3<f64>],
    ) -> Result<f64, PotentialError> {
        self.check_shapes(positions, forces, self.terms.len())?;
        let Some(kernel) = self.terms.get_mut(term) else { return Ok(0.0) };
        let energy = self.constants[term] + kernel.evaluate(self.level, positions, forces);
        if energy.is_finite() && forces.iter().all(is_finite) {
            return Ok(energy);
        }
        Err(self.find_term(positions, forces))
    }

    fn check_shapes(
        &self,
        positions: &[Vec3<f64>],
        forces: &[Vec3<f64>],
        energies: usize,
    ) -> Result<(), PotentialError> {
        let error = |atoms, message| PotentialError { term: "positions".into(), atoms, message };
        let (n, terms) = (self.particles, self.terms.len());
        if positions.len() != n || forces.len() != n || energies != terms {
            let message = format!(
                "{} positions, {} forces and {energies} energies; required: {n}, {n} and {terms}",
                positions.len(),
                forces.len(),
            );
            return Err(error(Vec::new(), message));
        }
        let bad: Vec<usize> = (0..n).filter(|&i| !is_finite(&positions[i])).take(MOST_NAMED).collect();
        if !bad.is_empty() {
            return Err(error(bad, "a position is not finite; go back to the last good positions".into()));
        }
        Ok(())
    }

    /// Which term is not finite, and between which atoms. It may allocate and be slow: this is the end of a run.
    #[cold]
    fn find_term(&mut self, positions: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> PotentialError {
        let mut term = String::new();
        let mut atoms = Vec::new();
        for (name, kernel) in self.names.iter().zip(&mut self.terms) {
            forces.fill(Vec3::zero());
            let energy = kernel.evaluate(self.level, positions, forces);
            atoms = (0..forces.len()).filter(|&i| !is_finite(&forces[i])).collect();
            if !energy.is_finite() || !atoms.is_empty() {
                term = name.clone();
                break;
            }
        }
        let mut message = String::from("the energy or a force is not finite");
        if let Some((distance, pair)) = closest_pair(positions, &atoms) {
            message +=
                &format!("; the closest of its atoms, {} and {}, are {distance} nm apart", pair[0], pair[1]);
            if atoms.is_empty() || atoms.len() > MOST_NAMED {
                atoms = pair.to_vec();
            }
        }
        message += "; separate atoms that coincide, and atoms 1-2-3 of a torsion that lie on a line";
        PotentialError { term, atoms, message }
    }
}

impl Potential for ForceField {
    fn terms(&self) -> &[String] {
        &self.names
    }

    fn is_isotropic(&self) -> bool {
        !self.terms.iter().any(|term| matches!(term, Term::Nonbonded(pairs) if pairs.is_periodic()))
    }
    fn evaluate(
        &mut self,
        positions: &[Vec3<f64>],
        energies: &mut [f64],
        forces: &mut [Vec3<f64>],
    ) -> Result<(), PotentialError> {
        self.check_shapes(positions, forces, energies.len())?;
        forces.fill(Vec3::zero());
        for ((term, constant), energy) in self.terms.iter_mut().zip(&self.constants).zip(&mut *energies) {
            *energy = constant + term.evaluate(self.level, positions, forces);
        }
        if energies.iter().all(|energy| energy.is_finite()) && forces.iter().all(is_finite) {
            return Ok(());
        }
        Err(self.find_term(positions, forces))
    }
}

fn is_finite(v: &Vec3<f64>) -> bool {
    v.0.iter().all(|x| x.is_finite())
}

/// The closest two of these atoms, of all where there are none.
fn closest_pair(positions: &[Vec3<f64>], atoms: &[usize]) -> Option<(f64, [usize; 2])> {
    let all: Vec<usize> = (0..positions.len()).collect();
    let atoms = if atoms.len() < 2 { &all } else { atoms };
    let mut closest: Option<(f64, [usize; 2])> = None;
    for (k, &i) in atoms.iter().enumerate() {
        for &j in &atoms[..k] {
            let distance = (positions[i] - positions[j]).norm();
            if closest.is_none_or(|(least, _)| distance < least) {
                closest = Some((distance, [j, i]));
            }
        }
    }
    closest
}

/// The name, or `NAME#2`, `NAME#3`, … where others have it.
fn unused_name(name: &str, taken: &[String]) -> String {
    let numbered = (2..).map(|k| format!("{name}#{k}"));
    let mut names = [name.to_string()].into_iter().chain(numbered);
    names.find(|name| !taken.contains(name)).unwrap_or_default()
}
