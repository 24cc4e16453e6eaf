//! Bonds, angles, torsions and maps.

use super::sections::Sections;
use super::{CALORIE, Pointers};
use crate::system::{CmapMap, CmapPair, CmapTorsion, HarmonicAngle, HarmonicBond, PeriodicTorsion};

/// A pair of atoms at the ends of a torsion, with what divides its Coulomb and its Lennard-Jones energy.
pub(super) struct Pair14 {
    pub atoms: [usize; 2],
    pub scee: f64,
    pub scnb: f64,
}

/// Atoms, which of them have a minus sign, and a type.
type Entry<const N: usize> = ([usize; N], [bool; N], usize);

/// Entries of atoms and a type: `terms` numbers a type, atoms as three times their index. Signs are kept.
fn entries<const N: usize>(
    sections: &mut Sections<'_>,
    names: [&str; 2],
    counts: [usize; 2],
    types: usize,
    n: usize,
) -> Option<Vec<Entry<N>>> {
    let mut found = Vec::new();
    for (name, count) in names.into_iter().zip(counts) {
        let numbers = sections.integers(name, Some(count * (N + 1)))?;
        for (k, entry) in numbers.chunks_exact(N + 1).enumerate() {
            let atoms: [usize; N] = std::array::from_fn(|i| entry[i].unsigned_abs() as usize / 3);
            let negative: [bool; N] = std::array::from_fn(|i| entry[i] < 0);
            let whole = entry[..N].iter().all(|x| x % 3 == 0) && atoms.iter().all(|a| *a < n);
            let differ = (0..N).all(|i| !atoms[..i].contains(&atoms[i]));
            let kind = usize::try_from(entry[N] - 1).ok().filter(|k| *k < types);
            match kind {
                Some(kind) if whole && differ => found.push((atoms, negative, kind)),
                _ => {
                    let required = format!(
                        "three times the indices of {N} different atoms of {n}, and a type of {types}"
                    );
                    let text = format!("entry {} is {entry:?}", k + 1);
                    sections.error(sections.line(name), name, text, &required, "write the file anew");
                    return None;
                }
            }
        }
    }
    Some(found)
}

pub(super) fn bonds(sections: &mut Sections<'_>, pointers: &Pointers, n: usize) -> Option<Vec<HarmonicBond>> {
    let types = pointers.count(15);
    let k = sections.reals("BOND_FORCE_CONSTANT", types)?;
    let length = sections.reals("BOND_EQUIL_VALUE", types)?;
    let (names, counts) =
        (["BONDS_INC_HYDROGEN", "BONDS_WITHOUT_HYDROGEN"], [pointers.count(2), pointers.count(12)]);
    let entries = entries::<2>(sections, names, counts, types, n)?;
    let bond = |(atoms, _, t): ([usize; 2], _, usize)| HarmonicBond {
        atoms,
        length: 0.1 * length[t],
        stiffness: 2.0 * k[t] * CALORIE * 100.0,
    };
    Some(entries.into_iter().map(bond).collect())
}

pub(super) fn angles(
    sections: &mut Sections<'_>,
    pointers: &Pointers,
    n: usize,
) -> Option<Vec<HarmonicAngle>> {
    let types = pointers.count(16);
    let k = sections.reals("ANGLE_FORCE_CONSTANT", types)?;
    let angle = sections.reals("ANGLE_EQUIL_VALUE", types)?;
    let (names, counts) =
        (["ANGLES_INC_HYDROGEN", "ANGLES_WITHOUT_HYDROGEN"], [pointers.count(4), pointers.count(13)]);
    let entries = entries::<3>(sections, names, counts, types, n)?;
    let convert = |(atoms, _, t): ([usize; 3], _, usize)| HarmonicAngle {
        atoms,
        angle: angle[t],
        stiffness: 2.0 * k[t] * CALORIE,
    };
    Some(entries.into_iter().map(convert).collect())
}

/// Torsions, and the 1-4 pairs: those whose third and fourth atoms have no minus sign.
pub(super) fn torsions(
    sections: &mut Sections<'_>,
    pointers: &Pointers,
    n: usize,
) -> Option<(Vec<PeriodicTorsion>, Vec<Pair14>)> {
    let types = pointers.count(17);
    let k = sections.reals("DIHEDRAL_FORCE_CONSTANT", types)?;
    let periodicity = sections.reals("DIHEDRAL_PERIODICITY", types)?;
    let phase = sections.reals("DIHEDRAL_PHASE", types)?;
    let mut scale = |name: &str, default: f64| match sections.has(name) {
        true => sections.reals(name, types),
        false => Some(vec![default; types]),
    };
    let (scee, scnb) = (scale("SCEE_SCALE_FACTOR", 1.2)?, scale("SCNB_SCALE_FACTOR", 2.0)?);
    // A negative periodicity says that the next term belongs to the same torsion.
    if let Some(t) = periodicity.iter().position(|p| p.fract() != 0.0 || !(1.0..=12.0).contains(&p.abs())) {
        let name = "DIHEDRAL_PERIODICITY";
        let found = format!("field {} is {}", t + 1, periodicity[t]);
        sections.error(sections.line(name), name, found, "a whole number of 1…12 in size", "correct it");
        return None;
    }
    let (names, counts) =
        (["DIHEDRALS_INC_HYDROGEN", "DIHEDRALS_WITHOUT_HYDROGEN"], [pointers.count(6), pointers.count(14)]);
    let entries = entries::<4>(sections, names, counts, types, n)?;
    let (mut torsions, mut pairs) = (Vec::with_capacity(entries.len()), Vec::new());
    for (atoms, negative, t) in entries {
        let periodicity = periodicity[t].abs() as u32;
        torsions.push(PeriodicTorsion { atoms, periodicity, phase: phase[t], stiffness: k[t] * CALORIE });
        if negative[2] || negative[3] {
            continue;
        }
        if scee[t] <= 0.0 || scnb[t] <= 0.0 {
            let name = if scee[t] <= 0.0 { "SCEE_SCALE_FACTOR" } else { "SCNB_SCALE_FACTOR" };
            let found = format!("field {} is not positive, but type {} has 1-4 pairs", t + 1, t + 1);
            sections.error(sections.line(name), name, found, "a positive number", "correct it");
            return None;
        }
        pairs.push(Pair14 { atoms: [atoms[0], atoms[3]], scee: scee[t], scnb: scnb[t] });
    }
    Some((torsions, pairs))
}

/// Energy maps of pairs of torsions; `None` where there are none, or with an error.
pub(super) fn maps(sections: &mut Sections<'_>, n: usize) -> Option<CmapTorsion> {
    if !sections.has("CMAP_COUNT") {
        return None;
    }
    let counts = sections.integers("CMAP_COUNT", Some(2))?;
    let [terms, types] = [0, 1].map(|i| usize::try_from(counts[i]).unwrap_or(0));
    let mut maps = Vec::new();
    for (t, size) in sections.integers("CMAP_RESOLUTION", Some(types))?.into_iter().enumerate() {
        let Some(size) = usize::try_from(size).ok().filter(|s| (2..=1000).contains(s) && s % 2 == 0) else {
            let line = sections.line("CMAP_RESOLUTION");
            let found = format!("field {} is {size}", t + 1);
            sections.error(line, "CMAP_RESOLUTION", found, "an even number of nodes", "correct it");
            return None;
        };
        let map = sections.reals(&format!("CMAP_PARAMETER_{:02}", t + 1), size * size)?;
        // There the map begins at −180° and its second angle is fastest.
        let turned = |k: usize| (k + size / 2) % size;
        let node = |k: usize| CALORIE * map[size * turned(k % size) + turned(k / size)];
        maps.push(CmapMap { size, energies: (0..size * size).map(node).collect() });
    }
    let numbers = sections.integers("CMAP_INDEX", Some(6 * terms))?;
    let mut torsions = Vec::new();
    for (k, entry) in numbers.chunks_exact(6).enumerate() {
        let index = |x: i64, most: usize| usize::try_from(x - 1).ok().filter(|i| *i < most);
        let atoms: Vec<usize> = entry[..5].iter().filter_map(|x| index(*x, n)).collect();
        match (&atoms[..], index(entry[5], types)) {
            (&[i, j, k, l, m], Some(map)) => {
                torsions.push(CmapPair { map, atoms: [[i, j, k, l], [j, k, l, m]] })
            }
            _ => {
                let found = format!("entry {} is {entry:?}", k + 1);
                let required = format!("five atoms of {n} and a map of {types}, counted from 1");
                sections.error(
                    sections.line("CMAP_INDEX"),
                    "CMAP_INDEX",
                    found,
                    &required,
                    "write the file anew",
                );
                return None;
            }
        }
    }
    Some(CmapTorsion { maps, torsions })
}
