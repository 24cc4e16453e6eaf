//! Lennard-Jones, Coulomb and generalized Born energies.

use super::reader::Reader;
use super::{Cutoff, GbsaObc, GbsaParticle, Nonbonded, NonbondedException, NonbondedParticle, Periodic};
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
    let is_periodic = node.attribute("method").is_some_and(|text| text.trim() == "2");
    let (cutoff, periodic) = match is_periodic {
        true => periodic(reader, node, place).unzip(),
        false => (reader.switched_cutoff(node, place, &METHODS), None),
    };
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
    let mut force = Nonbonded { cutoff, periodic, reaction_field_dielectric, ..Nonbonded::default() };
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

/// The cutoff and the box of method CutoffPeriodic: reduced vectors, all widths at least twice the cutoff.
fn periodic(reader: &mut Reader, node: Node<'_, '_>, place: &str) -> Option<(Cutoff, Periodic)> {
    let at = super::Entry::whole(node, place);
    let distance = reader.positive(&at, "cutoff")?;
    let cutoff = reader.switching(node, place, distance)?;
    let to_do = "set the System's box: system.setDefaultPeriodicBoxVectors(a, b, c)";
    let Some(box_vectors) = reader.box_vectors else {
        let found = "method 2 (CutoffPeriodic) without periodic box vectors";
        reader.error(node, place, found, "<PeriodicBoxVectors> of nine finite numbers", to_do);
        return None;
    };
    let [a, b, c] = box_vectors;
    // A rounding beyond half, as OpenMM allows it.
    let within = |x: f64, width: f64| 2.0 * x.abs() <= (1.0 + 1e-6) * width;
    let upper = [a[1], a[2], b[2]];
    let is_reduced = upper == [0.0; 3] && within(b[0], a[0]) && within(c[0], a[0]) && within(c[1], b[1]);
    if !(a[0] > 0.0 && b[1] > 0.0 && c[2] > 0.0 && is_reduced) {
        let required = "a = (ax, 0, 0), b = (bx, by, 0), c = (cx, cy, cz) with |bx|, |cx| at most ax/2, |cy| at most by/2";
        reader.error(node, place, format!("periodic box vectors {a:?}, {b:?}, {c:?}"), required, to_do);
        return None;
    }
    if 2.0 * distance > a[0].min(b[1]).min(c[2]) {
        let found = format!("a cutoff of {distance} nm in a box of {}, {}, {} nm", a[0], b[1], c[2]);
        reader.error(
            node,
            place,
            found,
            "at most half of each width",
            "make the cutoff smaller or the box larger",
        );
        return None;
    }
    let flag = |name: &str| node.attribute(name).is_some_and(|text| text.trim() != "0");
    let exceptions = flag("exceptionsUsePeriodic") || flag("exceptionsUsePeriodicBoundaryConditions");
    Some((cutoff, Periodic { box_vectors, exceptions, dispersion_correction: flag("dispersionCorrection") }))
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
