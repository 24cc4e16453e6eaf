//! Systems of OpenMM: particles, constraints and tables of forces from the XML that OpenMM writes.
//!
//! The file is made in OpenMM's Python by
//! `open("system.xml", "w").write(openmm.XmlSerializer.serialize(system))`, with a system from
//! `forcefield.createSystem(topology, nonbondedMethod=NoCutoff, constraints=None)`. Units: nm, ps, Da, kJ/mol, e, rad.
//!
//! | OpenMM | here |
//! |---|---|
//! | HarmonicBondForce, HarmonicAngleForce, PeriodicTorsionForce, RBTorsionForce, CMAPTorsionForce | the variants of [`ForceKind`] |
//! | NonbondedForce, GBSAOBCForce, CustomNonbondedForce, CustomGBForce, methods NoCutoff and CutoffNonPeriodic; NonbondedForce also CutoffPeriodic | the same |
//! | CustomBondForce, CustomAngleForce, CustomTorsionForce | the same; energies as [`Formula`] |
//! | global parameters | their default values, as numbers in the formulas |
//! | CMMotionRemover, barostats, AndersenThermostat | ignored: they are no energies |
//! | periodic cutoffs of other forces, Ewald sums, other forces in a periodic box, virtual sites, parameter offsets | refused |
//! | any other force | refused, or ignored where [`SystemOptions::ignore`] names it |
//!
//! Everything is checked: numbers are finite, particles exist and differ within one interaction, no pair has two
//! exceptions. An error names the force, the entry and the line.

mod bonded;
mod custom;
mod formula;
mod nonbonded;
mod reader;
mod spline;
mod table;

pub use formula::{Call, Formula, Slope};
pub use spline::{hermite, natural_slopes, periodic_slopes};
pub use table::Table;

use crate::file::read_text;
use crate::report::{Loaded, Note, Report};
use crate::suggest::{quote, shown};
use crate::xml;
use reader::{Entry, NO_CUTOFF, Reader};
use roxmltree::Node;
use std::collections::BTreeMap;
use std::path::Path;

/// Particles and the forces between them.
#[derive(Clone, Debug, Default)]
pub struct System {
    /// Masses, Da; 0 is a particle that does not move.
    pub masses: Vec<f64>,
    /// Distances that are kept.
    pub constraints: Vec<Constraint>,
    /// The forces that have an energy, in the order of the file.
    pub forces: Vec<Force>,
    /// Global parameters of the forces and their default values.
    pub global_parameters: BTreeMap<String, f64>,
    /// The periodic box: a, b, c as rows, nm, in the reduced form a = (aₓ, 0, 0), b = (bₓ, b_y, 0). Only forces that say so use it.
    pub box_vectors: Option<[[f64; 3]; 3]>,
}

/// A distance that is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constraint {
    /// The particles.
    pub atoms: [usize; 2],
    /// The distance, nm.
    pub distance: f64,
}

/// A force.
#[derive(Clone, Debug)]
pub struct Force {
    /// Its name; that of its class where it has none.
    pub name: String,
    /// Its class in OpenMM.
    pub class: String,
    /// Its force group.
    pub group: i32,
    /// Its line in the file.
    pub line: Option<u32>,
    /// What it is.
    pub kind: ForceKind,
}

/// The tables of a force.
#[derive(Clone, Debug)]
pub enum ForceKind {
    /// ½ k (r − r₀)².
    HarmonicBond(Vec<HarmonicBond>),
    /// ½ k (θ − θ₀)².
    HarmonicAngle(Vec<HarmonicAngle>),
    /// k (1 + cos(n φ − phase)), φ = π for trans.
    PeriodicTorsion(Vec<PeriodicTorsion>),
    /// Σ Cₙ cosⁿ(φ − π).
    RbTorsion(Vec<RbTorsion>),
    /// An energy map of two torsions.
    CmapTorsion(CmapTorsion),
    /// Lennard-Jones and Coulomb energies of all pairs.
    Nonbonded(Nonbonded),
    /// Generalized Born energy with the radii of Onufriev, Bashford and Case, and a surface energy.
    GbsaObc(GbsaObc),
    /// A function of distances, named `r`.
    CustomBond(CustomBonded<2>),
    /// A function of angles, named `theta`.
    CustomAngle(CustomBonded<3>),
    /// A function of torsions, named `theta`.
    CustomTorsion(CustomBonded<4>),
    /// A function of the distance `r` of all pairs and of their parameters.
    CustomNonbonded(CustomNonbonded),
    /// Values of each particle computed from all others, and energies of them.
    CustomGb(CustomGb),
}

impl ForceKind {
    /// The distance from which on pairs have no energy, nm.
    pub fn cutoff(&self) -> Option<f64> {
        match self {
            ForceKind::Nonbonded(force) => force.cutoff.map(|cutoff| cutoff.distance),
            ForceKind::GbsaObc(force) => force.cutoff,
            ForceKind::CustomNonbonded(force) => force.cutoff.map(|cutoff| cutoff.distance),
            ForceKind::CustomGb(force) => force.cutoff,
            _ => None,
        }
    }
}

/// A harmonic spring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HarmonicBond {
    /// The particles.
    pub atoms: [usize; 2],
    /// r₀, nm.
    pub length: f64,
    /// k, kJ/mol/nm².
    pub stiffness: f64,
}

/// A harmonic angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HarmonicAngle {
    /// The particles, the vertex second.
    pub atoms: [usize; 3],
    /// θ₀, rad.
    pub angle: f64,
    /// k, kJ/mol/rad².
    pub stiffness: f64,
}

/// One Fourier term of a torsion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeriodicTorsion {
    /// The particles.
    pub atoms: [usize; 4],
    /// n.
    pub periodicity: u32,
    /// The phase, rad.
    pub phase: f64,
    /// k, kJ/mol.
    pub stiffness: f64,
}

/// A torsion by powers of the cosine (Ryckaert and Bellemans).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RbTorsion {
    /// The particles.
    pub atoms: [usize; 4],
    /// C₀ … C₅, kJ/mol.
    pub coefficients: [f64; 6],
}

/// Energy maps of pairs of torsions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CmapTorsion {
    /// The maps.
    pub maps: Vec<CmapMap>,
    /// The pairs of torsions.
    pub torsions: Vec<CmapPair>,
}

/// A periodic map of two angles.
#[derive(Clone, Debug, PartialEq)]
pub struct CmapMap {
    /// Number n of nodes in each direction.
    pub size: usize,
    /// The energy at (2πi/n, 2πj/n) is number i + n j, kJ/mol.
    pub energies: Vec<f64>,
}

/// Two torsions and their map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CmapPair {
    /// The map.
    pub map: usize,
    /// The particles of the first and of the second torsion.
    pub atoms: [[usize; 4]; 2],
}

/// Where a sum over pairs ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cutoff {
    /// Pairs at this distance or beyond have no energy, nm.
    pub distance: f64,
    /// Where a smooth factor begins to switch energies off (in NonbondedForce: Lennard-Jones energies), nm, below
    /// [`Cutoff::distance`].
    pub switching: Option<f64>,
}

/// Pairs at their nearest images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Periodic {
    /// The box: [`System::box_vectors`].
    pub box_vectors: [[f64; 3]; 3],
    /// Exceptions too are at their nearest images.
    pub exceptions: bool,
    /// The mean Lennard-Jones energy beyond the cutoff is added.
    pub dispersion_correction: bool,
}

/// Lennard-Jones and Coulomb energies of all pairs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Nonbonded {
    /// Of all pairs but the exceptions.
    pub cutoff: Option<Cutoff>,
    /// Where pairs within the cutoff are at their nearest images.
    pub periodic: Option<Periodic>,
    /// Dielectric constant beyond the cutoff, in the reaction field; without a cutoff it has no effect.
    pub reaction_field_dielectric: f64,
    /// One for each particle.
    pub particles: Vec<NonbondedParticle>,
    /// Pairs that have parameters of their own, which replace those of their particles.
    pub exceptions: Vec<NonbondedException>,
}

/// Charge and size of a particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonbondedParticle {
    /// e.
    pub charge: f64,
    /// nm; that of a pair is the mean.
    pub sigma: f64,
    /// kJ/mol; that of a pair is the geometric mean.
    pub epsilon: f64,
}

/// A pair that has its own parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonbondedException {
    /// The particles.
    pub atoms: [usize; 2],
    /// e².
    pub charge_product: f64,
    /// nm.
    pub sigma: f64,
    /// kJ/mol.
    pub epsilon: f64,
}

/// Generalized Born energy (OBC2) and surface energy (ACE).
#[derive(Clone, Debug, PartialEq)]
pub struct GbsaObc {
    /// Pairs at this distance or beyond are left out, nm, and the energy of the others is shifted to 0 there.
    pub cutoff: Option<f64>,
    /// Dielectric constant of the solvent.
    pub solvent_dielectric: f64,
    /// Dielectric constant of the molecule.
    pub solute_dielectric: f64,
    /// Energy of the surface, kJ/mol/nm².
    pub surface_area_energy: f64,
    /// One for each particle.
    pub particles: Vec<GbsaParticle>,
}

/// Charge and size of a particle in [`GbsaObc`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GbsaParticle {
    /// e.
    pub charge: f64,
    /// nm.
    pub radius: f64,
    /// Factor of the radius where it displaces solvent.
    pub scale: f64,
}

/// An energy of one coordinate of N particles.
#[derive(Clone, Debug)]
pub struct CustomBonded<const N: usize> {
    /// Function of the coordinate, then of the parameters.
    pub energy: Formula,
    /// Name of the coordinate: `r` or `theta`.
    pub coordinate: &'static str,
    /// Names of the parameters.
    pub parameter_names: Vec<String>,
    /// The particles of each entry.
    pub atoms: Vec<[usize; N]>,
    /// The parameters of all entries, entry by entry.
    pub parameters: Vec<f64>,
}

/// An energy of all pairs but the excluded ones.
#[derive(Clone, Debug)]
pub struct CustomNonbonded {
    /// Where it ends.
    pub cutoff: Option<Cutoff>,
    /// Function of `r`, then of the parameters of the particle with the smaller index (their names end in 1), then of
    /// those of the other (2).
    pub energy: Formula,
    /// Names of the parameters.
    pub parameter_names: Vec<String>,
    /// The parameters of all particles, particle by particle.
    pub parameters: Vec<f64>,
    /// Pairs without energy.
    pub exclusions: Vec<[usize; 2]>,
}

/// Values of each particle and energies of them.
#[derive(Clone, Debug)]
pub struct CustomGb {
    /// Pairs at this distance or beyond are left out, nm.
    pub cutoff: Option<f64>,
    /// Names of the parameters.
    pub parameter_names: Vec<String>,
    /// The parameters of all particles, particle by particle.
    pub parameters: Vec<f64>,
    /// The values: the first a sum over pairs, the others functions of one particle.
    pub values: Vec<GbValue>,
    /// The energies.
    pub energies: Vec<GbEnergy>,
    /// Pairs that are left out of what is [`GbScope::PairWithExclusions`].
    pub exclusions: Vec<[usize; 2]>,
}

/// What a function of [`CustomGb`] depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GbScope {
    /// One particle: its parameters, then the values before.
    Particle,
    /// A pair that is not excluded: `r`; of the first particle (1) the parameters, then, in an energy, all values; the
    /// same of the second (2).
    PairWithExclusions,
    /// Any pair, with the same variables.
    Pair,
}

/// A value of each particle.
#[derive(Clone, Debug)]
pub struct GbValue {
    /// Its name.
    pub name: String,
    /// What it depends on. That of a pair is summed over the second particle, which takes every other one.
    pub scope: GbScope,
    /// The function.
    pub formula: Formula,
}

/// An energy of each particle or pair.
#[derive(Clone, Debug)]
pub struct GbEnergy {
    /// What it depends on. In a pair the first particle is that with the smaller index.
    pub scope: GbScope,
    /// The function, kJ/mol.
    pub formula: Formula,
}

/// How a System is read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SystemOptions {
    /// Names or classes of forces that are left out.
    pub ignore: Vec<String>,
}

/// The tables of a System in XML; `source` is its name in the report.
///
/// # Cost
/// O(n log n) in the length of the text.
///
/// # Errors
/// In the report: XML that is not well formed, and everything that the module's page calls an error or refused.
///
/// # Example
/// ```
/// use phipsi_formats::system::{ForceKind, SystemOptions, read_system};
/// let text = r#"<System type="System" version="1">
///   <Particles><Particle mass="12"/><Particle mass="16"/></Particles>
///   <Constraints/>
///   <Forces><Force type="HarmonicBondForce" name="CO" usesPeriodic="0" version="2" forceGroup="0">
///     <Bonds><Bond p1="0" p2="1" d=".1128" k="1100000"/></Bonds>
///   </Force></Forces>
/// </System>"#;
/// let (system, _) = read_system(text, "co.xml", &SystemOptions::default()).into_result(true)?;
/// let ForceKind::HarmonicBond(bonds) = &system.forces[0].kind else { panic!() };
/// assert_eq!((system.forces[0].name.as_str(), bonds[0].length), ("CO", 0.1128));
/// # Ok::<(), Box<phipsi_formats::Report>>(())
/// ```
pub fn read_system(text: &str, source: &str, options: &SystemOptions) -> Loaded<System> {
    let mut report = Report::new(source);
    let document = match xml::parse(text) {
        Ok(document) => document,
        Err(problem) => {
            report.errors.push(problem);
            return Loaded { value: None, report };
        }
    };
    let mut reader = Reader::new(text, report);
    let system = read_root(&mut reader, document.root_element(), options);
    let report = reader.report;
    Loaded { value: system.filter(|_| report.errors.is_empty()), report }
}

/// The tables of a System in an XML file.
///
/// # Errors
/// In the report: a file that cannot be read, is larger than 256 MiB or is not UTF-8; else as [`read_system`].
pub fn read_system_file(path: impl AsRef<Path>, options: &SystemOptions) -> Loaded<System> {
    let source = path.as_ref().display().to_string();
    match read_text(path.as_ref(), "an OpenMM System") {
        Ok(text) => read_system(&text, &source, options),
        Err(problem) => {
            let mut report = Report::new(source);
            report.errors.push(problem);
            Loaded { value: None, report }
        }
    }
}

fn read_root(reader: &mut Reader, root: Node<'_, '_>, options: &SystemOptions) -> Option<System> {
    let place = "System";
    let tag = root.tag_name().name();
    if tag != "System" {
        let to_do = match tag {
            "ForceField" => {
                "this is a force field: give the system that forcefield.createSystem(…) makes of it"
            }
            "State" | "Integrator" => "serialize the system: openmm.XmlSerializer.serialize(system)",
            _ => "give the text of openmm.XmlSerializer.serialize(system)",
        };
        reader.error(root, "document", format!("root element {}", quote(tag)), "<System>", to_do);
        return None;
    }
    reader.check_attributes(&Entry::whole(root, place), &["openmmVersion", "type", "version"]);
    let lists = ["PeriodicBoxVectors", "Particles", "Constraints", "Forces"];
    let lists = reader.lists(root, place, &lists, &["PeriodicBoxVectors", "Constraints"]);
    let [box_vectors, particles, constraints, forces] = lists;
    reader.box_vectors = box_vectors.and_then(|node| read_box(reader, node));
    let masses = read_masses(reader, particles?);
    if masses.is_empty() {
        reader.error(root, place, "no particles", "at least one", "serialize a system that has particles");
        return None;
    }
    let mut system = System { masses, box_vectors: reader.box_vectors, ..System::default() };
    for entry in reader.entries(constraints, place, "Constraint", "constraint") {
        reader.check_attributes(&entry, &["p1", "p2", "d"]);
        let atoms = reader.atoms(&entry, ["p1", "p2"], system.masses.len());
        let distance = reader.non_negative(&entry, "d");
        if let (Some(atoms), Some(distance)) = (atoms, distance) {
            system.constraints.push(Constraint { atoms, distance });
        }
    }
    for entry in reader.entries(forces, place, "Force", "force") {
        read_force(reader, entry.node, options, &mut system);
    }
    summarize(reader, &system);
    Some(system)
}

/// The box vectors; `None` where an attribute is missing or no number, which is an error only of a force that uses them.
fn read_box(reader: &mut Reader, node: Node<'_, '_>) -> Option<[[f64; 3]; 3]> {
    let [a, b, c] = reader.lists(node, "System", &["A", "B", "C"], &[]);
    let vector = |node: Option<Node<'_, '_>>| -> Option<[f64; 3]> {
        let number = |name: &str| node?.attribute(name)?.trim().parse::<f64>().ok().filter(|x| x.is_finite());
        Some([number("x")?, number("y")?, number("z")?])
    };
    Some([vector(a)?, vector(b)?, vector(c)?])
}

fn read_masses(reader: &mut Reader, list: Node<'_, '_>) -> Vec<f64> {
    let mut masses = Vec::new();
    for entry in reader.entries(Some(list), "System", "Particle", "particle") {
        reader.check_attributes(&entry, &["mass"]);
        masses.push(reader.non_negative(&entry, "mass").unwrap_or(0.0));
        if let Some(site) = entry.node.children().find(Node::is_element) {
            let found = format!("a virtual site ({})", shown(site.tag_name().name()));
            let to_do = "use a model without virtual sites, such as tip3p instead of tip4pew for water";
            reader.error(site, &entry.place(), found, "an ordinary particle", to_do);
        }
    }
    masses
}

/// Forces that are no energies, and what they are.
const NO_ENERGY: [(&str, &str); 7] = [
    ("CMMotionRemover", "removal of the motion of the center of mass"),
    ("AndersenThermostat", "thermostat"),
    ("MonteCarloBarostat", "barostat"),
    ("MonteCarloAnisotropicBarostat", "barostat"),
    ("MonteCarloMembraneBarostat", "barostat"),
    ("MonteCarloFlexibleBarostat", "barostat"),
    ("RPMDMonteCarloBarostat", "barostat"),
];

fn read_force(reader: &mut Reader, node: Node<'_, '_>, options: &SystemOptions, system: &mut System) {
    let class = node.attribute("type").unwrap_or_default();
    let name = node.attribute("name").filter(|name| !name.is_empty()).unwrap_or(class);
    let place = format!("force `{}`", shown(name));
    if options.ignore.iter().any(|ignored| ignored == class || ignored == name) {
        reader.ignored(node, &place, format!("{}, as asked for", shown(class)));
        return;
    }
    if let Some((_, what)) = NO_ENERGY.iter().find(|(known, _)| *known == class) {
        reader.ignored(node, &place, format!("{class}, {what}"));
        return;
    }
    let n = system.masses.len();
    let errors = reader.count;
    let globals = &mut system.global_parameters;
    let kind = match class {
        "HarmonicBondForce" => bonded::bonds(reader, node, &place, n).map(ForceKind::HarmonicBond),
        "HarmonicAngleForce" => bonded::angles(reader, node, &place, n).map(ForceKind::HarmonicAngle),
        "PeriodicTorsionForce" => bonded::torsions(reader, node, &place, n).map(ForceKind::PeriodicTorsion),
        "RBTorsionForce" => bonded::rb_torsions(reader, node, &place, n).map(ForceKind::RbTorsion),
        "CMAPTorsionForce" => bonded::cmap(reader, node, &place, n).map(ForceKind::CmapTorsion),
        "NonbondedForce" => nonbonded::nonbonded(reader, node, &place, n).map(ForceKind::Nonbonded),
        "GBSAOBCForce" => nonbonded::gbsa_obc(reader, node, &place, n).map(ForceKind::GbsaObc),
        "CustomBondForce" => {
            custom::bonded(reader, node, &place, n, &custom::BOND, globals).map(ForceKind::CustomBond)
        }
        "CustomAngleForce" => {
            custom::bonded(reader, node, &place, n, &custom::ANGLE, globals).map(ForceKind::CustomAngle)
        }
        "CustomTorsionForce" => {
            custom::bonded(reader, node, &place, n, &custom::TORSION, globals).map(ForceKind::CustomTorsion)
        }
        "CustomNonbondedForce" => {
            custom::nonbonded(reader, node, &place, n, globals).map(ForceKind::CustomNonbonded)
        }
        "CustomGBForce" => custom::gb(reader, node, &place, n, globals).map(ForceKind::CustomGb),
        _ => {
            let found = format!("class {}", quote(class));
            let to_do = format!(
                "leave it out of the system (system.removeForce(index)), or ignore it by its name; make the rest by \
                 {NO_CUTOFF}"
            );
            reader.error(node, &place, found, "a force that phipsi has", &to_do);
            None
        }
    };
    // A force with errors is not kept, so that no half table leaves the reader.
    let Some(kind) = kind.filter(|_| reader.count == errors) else { return };
    let group = node.attribute("forceGroup").and_then(|text| text.trim().parse().ok()).unwrap_or(0);
    system.forces.push(Force {
        name: name.into(),
        class: class.into(),
        group,
        line: reader.line(node),
        kind,
    });
}

fn summarize(reader: &mut Reader, system: &System) {
    let mut what = format!("particles: {}", system.masses.len());
    if !system.constraints.is_empty() {
        what += &format!(", constraints: {}", system.constraints.len());
    }
    let mut notes = vec![Note::new(None, "System", what)];
    for force in &system.forces {
        let what =
            if force.name == force.class { "energy".into() } else { format!("energy, {}", force.class) };
        let place = format!("force `{}`", shown(&force.name));
        if let Some(cutoff) = force.kind.cutoff() {
            let mut what = format!("pairs from {cutoff} nm on are left out");
            if let ForceKind::Nonbonded(Nonbonded { periodic: Some(periodic), .. }) = &force.kind {
                what += ", at their nearest images in the periodic box";
                if periodic.dispersion_correction {
                    what += ", with the mean Lennard-Jones energy beyond";
                }
            }
            reader.report.approximated.push(Note::new(force.line, place.clone(), what));
        }
        notes.push(Note::new(force.line, place, what));
    }
    for (name, value) in &system.global_parameters {
        notes.push(Note::new(None, format!("parameter `{}`", shown(name)), format!("default value {value}")));
    }
    reader.report.used.splice(0..0, notes);
}
