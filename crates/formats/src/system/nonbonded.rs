//! Lennard-Jones, Coulomb and generalized Born energies.

use super::reader::Reader;
use super::{GbsaObc, GbsaParticle, Nonbonded, NonbondedException, NonbondedParticle};
use roxmltree::Node;
use std::collections::HashMap;

/// Methods of a NonbondedForce; the custom ones have the first three.
pub(super) const METHODS: [&str; 6] =
    ["NoCutoff", "CutoffNonPeriodic", "CutoffPeriodic", "Ewald", "PME", "LJPME"];

/// What a NonbondedForce may have beside its particles; without a periodic box most of it has no effect.
const ATTRIBUTES: [&str; 19] = [
    "method",
    "cutoff",
    "useSwitchingFunction",
    "switchingDistance",
    "ewaldTolerance",
    "rfDielectric",
    "dispersionCorrection",
    "alpha",
    "nx",
    "ny",
    "nz",
    "ljAlpha",
    "ljnx",
    "ljny",
    "ljnz",
    "recipForceGroup",
    "includeDirectSpace",
    "exceptionsUsePeriodic",
    "exceptionsUsePeriodicBoundaryConditions",
];

/// Smallest radius that GBSAOBCForce can use: its offset, nm.
const SMALLEST_RADIUS: f64 = 0.009;

pub(super) fn nonbonded(reader: &mut Reader, node: Node<'_, '_>, place: &str, n: usize) -> Option<Nonbonded> {
    reader.check_force(node, place, &ATTRIBUTES);
    let cutoff = reader.switched_cutoff(node, place, &METHODS);
    let at = super::Entry::whole(node, place);
    let reaction_field_dielectric = match cutoff {
        Some(_) => reader.positive(&at, "rfDielectric")?,
        None => 0.0,
    };
    const LISTS: [&str; 5] =
        ["Particles", "Exceptions", "GlobalParameters", "ParticleOffsets", "ExceptionOffsets"];
    let lists = reader.lists(node, place, &LISTS, &LISTS[2..]);
    let [particles, exceptions, globals, particle_offsets, exception_offsets] = lists;
    let _ = globals;
    for list in [particle_offsets, exception_offsets].into_iter().flatten() {
        if let Some(offset) = list.children().find(Node::is_element) {
            let to_do = "set the parameters themselves: force.setParticleParameters(…)";
            reader.error(offset, place, "a parameter offset", "no parameter offsets", to_do);
        }
    }
    let mut force = Nonbonded { cutoff, reaction_field_dielectric, ..Nonbonded::default() };
    for entry in reader.entries(particles, place, "Particle", "particle") {
        reader.check_attributes(&entry, &["q", "sig", "eps"]);
        let charge = reader.number(&entry, "q").unwrap_or(0.0);
        let sigma = reader.non_negative(&entry, "sig").unwrap_or(0.0);
        let epsilon = reader.non_negative(&entry, "eps").unwrap_or(0.0);
        force.particles.push(NonbondedParticle { charge, sigma, epsilon });
    }
    reader.check_count(node, place, force.particles.len(), n);
    let mut seen = HashMap::new();
    for entry in reader.entries(exceptions, place, "Exception", "exception") {
        reader.check_attributes(&entry, &["p1", "p2", "q", "sig", "eps"]);
        let Some(atoms) = reader.atoms(&entry, ["p1", "p2"], n) else { continue };
        let charge_product = reader.number(&entry, "q").unwrap_or(0.0);
        let sigma = reader.non_negative(&entry, "sig").unwrap_or(0.0);
        let epsilon = reader.non_negative(&entry, "eps").unwrap_or(0.0);
        let pair = [atoms[0].min(atoms[1]), atoms[0].max(atoms[1])];
        if let Some(first) = seen.insert(pair, force.exceptions.len()) {
            let found = format!("a second exception of particles {} and {}", pair[0], pair[1]);
            let to_do = format!("remove it or exception {first}");
            reader.error(entry.node, &entry.place(), found, "at most one", &to_do);
        }
        force.exceptions.push(NonbondedException { atoms, charge_product, sigma, epsilon });
    }
    Some(force)
}

pub(super) fn gbsa_obc(reader: &mut Reader, node: Node<'_, '_>, place: &str, n: usize) -> Option<GbsaObc> {
    let known = ["method", "cutoff", "soluteDielectric", "solventDielectric", "surfaceAreaEnergy"];
    reader.check_force(node, place, &known);
    let cutoff = reader.cutoff(node, place, &METHODS[..3]);
    let at = super::Entry::whole(node, place);
    let solute_dielectric = reader.positive(&at, "soluteDielectric")?;
    let solvent_dielectric = reader.positive(&at, "solventDielectric")?;
    // Version 1 of the format has no such attribute; this was the energy then.
    let surface_area_energy = reader.number_or(&at, "surfaceAreaEnergy", 2.25936)?;
    let [list] = reader.lists(node, place, &["Particles"], &[]);
    let mut particles = Vec::new();
    for entry in reader.entries(list, place, "Particle", "particle") {
        reader.check_attributes(&entry, &["q", "r", "scale"]);
        let charge = reader.number(&entry, "q").unwrap_or(0.0);
        let radius = reader.number(&entry, "r").unwrap_or(1.0);
        let scale = reader.non_negative(&entry, "scale").unwrap_or(0.0);
        if radius <= SMALLEST_RADIUS {
            let required = format!("more than the offset {SMALLEST_RADIUS} nm");
            let _ = reader.bad::<()>(&entry, "r", &radius.to_string(), &required);
        }
        particles.push(GbsaParticle { charge, radius, scale });
    }
    reader.check_count(node, place, particles.len(), n);
    Some(GbsaObc { cutoff, solvent_dielectric, solute_dielectric, surface_area_energy, particles })
}
