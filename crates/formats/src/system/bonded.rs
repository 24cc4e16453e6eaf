//! Bonds, angles, torsions and energy maps.

use super::reader::{Entry, Reader};
use super::{CmapMap, CmapPair, CmapTorsion, HarmonicAngle, HarmonicBond, PeriodicTorsion, RbTorsion};
use roxmltree::Node;
use std::f64::consts::PI;

/// Largest periodicity; the phase n φ loses as many units of rounding.
const LARGEST_PERIODICITY: i64 = 1000;

const TORSION: [&str; 4] = ["p1", "p2", "p3", "p4"];

pub(super) fn bonds(
    reader: &mut Reader,
    node: Node<'_, '_>,
    place: &str,
    n: usize,
) -> Option<Vec<HarmonicBond>> {
    reader.check_force(node, place, &[]);
    let [list] = reader.lists(node, place, &["Bonds"], &[]);
    let mut bonds = Vec::new();
    for entry in reader.entries(list, place, "Bond", "bond") {
        reader.check_attributes(&entry, &["p1", "p2", "d", "k"]);
        let atoms = reader.atoms(&entry, ["p1", "p2"], n);
        let (length, stiffness) = (reader.non_negative(&entry, "d"), reader.number(&entry, "k"));
        if let (Some(atoms), Some(length), Some(stiffness)) = (atoms, length, stiffness) {
            bonds.push(HarmonicBond { atoms, length, stiffness });
        }
    }
    Some(bonds)
}

pub(super) fn angles(
    reader: &mut Reader,
    node: Node<'_, '_>,
    place: &str,
    n: usize,
) -> Option<Vec<HarmonicAngle>> {
    reader.check_force(node, place, &[]);
    let [list] = reader.lists(node, place, &["Angles"], &[]);
    let mut angles = Vec::new();
    for entry in reader.entries(list, place, "Angle", "angle") {
        reader.check_attributes(&entry, &["p1", "p2", "p3", "a", "k"]);
        let atoms = reader.atoms(&entry, ["p1", "p2", "p3"], n);
        let (angle, stiffness) = (reader.non_negative(&entry, "a"), reader.number(&entry, "k"));
        // As OpenMM: 180 degrees may have been rounded up.
        if let Some(angle) = angle.filter(|a| *a > PI * 1.000001) {
            let _ = reader.bad::<()>(&entry, "a", &angle.to_string(), "an angle from 0 to 3.14159 (radians)");
        }
        if let (Some(atoms), Some(angle), Some(stiffness)) = (atoms, angle, stiffness) {
            angles.push(HarmonicAngle { atoms, angle, stiffness });
        }
    }
    Some(angles)
}

pub(super) fn torsions(
    reader: &mut Reader,
    node: Node<'_, '_>,
    place: &str,
    n: usize,
) -> Option<Vec<PeriodicTorsion>> {
    reader.check_force(node, place, &[]);
    let [list] = reader.lists(node, place, &["Torsions"], &[]);
    let mut torsions = Vec::new();
    for entry in reader.entries(list, place, "Torsion", "torsion") {
        reader.check_attributes(&entry, &["p1", "p2", "p3", "p4", "periodicity", "phase", "k"]);
        let atoms = reader.atoms(&entry, TORSION, n);
        let periodicity = reader.integer_in(&entry, "periodicity", 1, LARGEST_PERIODICITY);
        let (phase, stiffness) = (reader.number(&entry, "phase"), reader.number(&entry, "k"));
        if let (Some(atoms), Some(periodicity), Some(phase), Some(stiffness)) =
            (atoms, periodicity, phase, stiffness)
        {
            torsions.push(PeriodicTorsion { atoms, periodicity: periodicity as u32, phase, stiffness });
        }
    }
    Some(torsions)
}

pub(super) fn rb_torsions(
    reader: &mut Reader,
    node: Node<'_, '_>,
    place: &str,
    n: usize,
) -> Option<Vec<RbTorsion>> {
    const C: [&str; 6] = ["c0", "c1", "c2", "c3", "c4", "c5"];
    reader.check_force(node, place, &[]);
    let [list] = reader.lists(node, place, &["Torsions"], &[]);
    let mut torsions = Vec::new();
    for entry in reader.entries(list, place, "Torsion", "torsion") {
        reader.check_attributes(&entry, &["p1", "p2", "p3", "p4", "c0", "c1", "c2", "c3", "c4", "c5"]);
        let atoms = reader.atoms(&entry, TORSION, n);
        let coefficients = C.map(|name| reader.number(&entry, name));
        if let (Some(atoms), false) = (atoms, coefficients.contains(&None)) {
            torsions.push(RbTorsion { atoms, coefficients: coefficients.map(Option::unwrap_or_default) });
        }
    }
    Some(torsions)
}

pub(super) fn cmap(reader: &mut Reader, node: Node<'_, '_>, place: &str, n: usize) -> Option<CmapTorsion> {
    reader.check_force(node, place, &[]);
    let [maps, torsions] = reader.lists(node, place, &["Maps", "Torsions"], &[]);
    let mut force = CmapTorsion::default();
    for map in reader.entries(maps, place, "Map", "map") {
        let map = read_map(reader, &map, place)?;
        force.maps.push(map);
    }
    const A: [&str; 4] = ["a1", "a2", "a3", "a4"];
    const B: [&str; 4] = ["b1", "b2", "b3", "b4"];
    for entry in reader.entries(torsions, place, "Torsion", "torsion") {
        reader.check_attributes(&entry, &["map", "a1", "a2", "a3", "a4", "b1", "b2", "b3", "b4"]);
        let map = reader.integer_in(&entry, "map", 0, force.maps.len() as i64 - 1);
        let (a, b) = (reader.atoms(&entry, A, n), reader.atoms(&entry, B, n));
        if let (Some(map), Some(a), Some(b)) = (map, a, b) {
            force.torsions.push(CmapPair { map, atoms: [a, b] });
        }
    }
    Some(force)
}

fn read_map(reader: &mut Reader, map: &Entry<'_, '_>, place: &str) -> Option<CmapMap> {
    reader.check_attributes(map, &["size"]);
    let size = reader.integer_in(map, "size", 2, 1_000_000)?;
    let mut energies = Vec::new();
    for entry in reader.entries(Some(map.node), place, "Energy", "energy") {
        reader.check_attributes(&entry, &["e"]);
        energies.push(reader.number(&entry, "e")?);
    }
    if size.checked_mul(size) != Some(energies.len()) {
        let found = format!("size {size} and {} energies", energies.len());
        reader.error(map.node, &map.place(), found, "size² energies", "serialize the system again");
        return None;
    }
    Some(CmapMap { size, energies })
}
