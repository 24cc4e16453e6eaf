//! AMBER's files: what is read of them, and what is said of wrong ones. Energies are compared with OpenMM's in `validation`.

use phipsi_formats::prmtop::{PrmtopOptions, read_inpcrd, read_prmtop};
use phipsi_formats::system::{ForceKind, System};

/// Alanine dipeptide in ff14SB, and in ff19SB with its energy maps, written by ParmEd 4.3.1.
const FF14SB: &str = include_str!("../../../examples/ala_dipeptide.prmtop");
const FF19SB: &str = include_str!("../../../validation/data/prmtop/ala_dipeptide_ff19sb.prmtop");
const COORDINATES: &str = include_str!("../../../examples/ala_dipeptide.inpcrd");

fn errors(text: &str) -> Vec<String> {
    let report = read_prmtop(text, "a.prmtop", &PrmtopOptions { obc2: Some([78.5, 1.0]) }).report;
    report.errors.iter().map(|p| format!("{}: {}; {}", p.place, p.found, p.required)).collect()
}

fn tables(text: &str) -> System {
    read_prmtop(text, "a.prmtop", &PrmtopOptions::default()).into_result(true).unwrap().0.system
}

#[test]
fn atoms_and_tables() {
    let options = PrmtopOptions { obc2: Some([80.0, 2.0]) };
    let (prmtop, report) = read_prmtop(FF14SB, "a.prmtop", &options).into_result(true).unwrap();
    assert_eq!((prmtop.atoms.atoms.len(), prmtop.atoms.residues, prmtop.atoms.bonds.len()), (22, 3, 21));
    let atom = &prmtop.atoms.atoms[8];
    assert_eq!((atom.name.as_str(), atom.residue_name.as_str(), atom.residue_number), ("CA", "ALA", 2));
    assert_eq!(atom.element, "C");
    let names: Vec<&str> = prmtop.system.forces.iter().map(|f| f.name.as_str()).collect();
    let wanted =
        ["HarmonicBondForce", "HarmonicAngleForce", "PeriodicTorsionForce", "NonbondedForce", "GBSAOBCForce"];
    assert_eq!(names, wanted);
    let ForceKind::GbsaObc(solvent) = &prmtop.system.forces[4].kind else { panic!() };
    assert_eq!((solvent.solvent_dielectric, solvent.solute_dielectric), (80.0, 2.0));
    let ForceKind::Nonbonded(pairs) = &prmtop.system.forces[3].kind else { panic!() };
    // Neutral to the eight digits of 22 charges; 98 pairs are excluded or scaled.
    assert!(pairs.particles.iter().map(|p| p.charge).sum::<f64>().abs() < 1e-7);
    assert_eq!(pairs.exceptions.len(), 98);
    assert!(report.used[0].what.contains("22, of 3 residues"));
    assert_eq!(prmtop.system.masses.len(), 22);
}

#[test]
fn energy_maps() {
    let system = tables(FF19SB);
    let ForceKind::CmapTorsion(maps) = &system.forces[3].kind else { panic!() };
    assert_eq!((maps.maps.len(), maps.maps[0].size, maps.torsions.len()), (1, 24, 1));
    assert_eq!(maps.torsions[0].atoms, [[4, 6, 8, 10], [6, 8, 10, 16]]);
}

#[test]
fn coordinates() {
    let (x, report) = read_inpcrd(COORDINATES, "a.inpcrd", 22).into_result(true).unwrap();
    assert_eq!((x[0], x[21].len()), ([-0.0094, 0.004, 0.0235], 3));
    assert!(report.ignored.is_empty());
    let of = |text: &str, n: usize| {
        let problem = read_inpcrd(text, "a.inpcrd", n).report.errors.remove(0);
        format!("{:?}: {}; {}", problem.line, problem.found, problem.required)
    };
    assert!(of(COORDINATES, 21).contains("\"22\" atoms; 21 atoms"));
    assert!(of("a\n    1\n   1.0000000         nan  -3.5000000\n", 1).contains("Some(3): \"nan\""));
    assert!(of("a\n    2\n   1.0000000   2.0000000  -3.5000000\n", 2).contains("3 numbers; 6"));
    assert!(of("", 1).contains("no number"));
    // Velocities and the box of rst7 files.
    let text = format!("a\n    1  0.5\n{}{}", "   1.0000000".repeat(6), "\n  10.0000000");
    let loaded = read_inpcrd(&text, "a.rst7", 1);
    assert_eq!((loaded.value, loaded.report.ignored.len()), (Some(vec![[0.1; 3]]), 1));
}

/// The text with a section's data replaced.
fn with(section: &str, data: &str) -> String {
    let start = FF14SB.find(&format!("%FLAG {section}\n")).unwrap();
    let data_at = start + FF14SB[start..].find(")\n").unwrap() + 2;
    let end = FF14SB[data_at..].find("%FLAG").map_or(FF14SB.len(), |at| data_at + at);
    format!("{}{data}\n{}", &FF14SB[..data_at], &FF14SB[end..])
}

/// The text with one number of POINTERS replaced.
fn with_pointer(place: usize, value: i32) -> String {
    let mut numbers = [
        22, 7, 12, 9, 25, 11, 39, 19, 0, 0, 100, 3, 9, 11, 19, 7, 11, 51, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 10,
        0, 0,
    ];
    numbers[place] = value;
    let lines = numbers.chunks(10).map(|line| line.iter().map(|n| format!("{n:8}")).collect::<String>());
    with("POINTERS", &lines.collect::<Vec<_>>().join("\n"))
}

#[test]
fn mistakes_name_their_section() {
    assert!(errors(&with_pointer(0, 22)).is_empty(), "the file itself is right");
    for (text, wanted) in [
        ("".to_string(), "does not begin with %VERSION"),
        (COORDINATES.to_string(), "does not begin with %VERSION"),
        (with_pointer(0, 0), "no atoms"),
        (with_pointer(0, 23), "section `ATOM_NAME`: 22 fields; 23, as POINTERS says"),
        (with_pointer(20, 1), "perturbation"),
        (with_pointer(29, 1), "cap of water"),
        (with_pointer(30, 4), "virtual sites"),
        (with_pointer(1, 9_999_999), "section `NONBONDED_PARM_INDEX`"),
        (with_pointer(2, -5), "section `POINTERS`: field 3 is -5"),
        (with("CHARGE", "  1.0"), "section `CHARGE`: 1 fields; 22"),
        (with("MASS", &"             inf".repeat(5)), "section `MASS`"),
        (with("RESIDUE_POINTER", "       1       7       7"), "do not rise"),
        (with("RESIDUE_POINTER", "       1       7      99"), "do not rise"),
        (FF14SB.replace("%FLAG RADII\n", "%FLAG ROUND\n"), "section `RADII`: no such section"),
        (FF14SB.replacen("%FORMAT(5E16.8)", "%FORMAT(eight)", 1), "format"),
        (format!("{FF14SB}\n%FLAG CHARGE\n"), "second section"),
        (with("CHARGE", &"       1.0000 é ".repeat(5)), "not ASCII"),
    ] {
        let found = errors(&text).join("\n");
        assert!(found.contains(wanted), "{wanted}: {found}");
    }
}

#[test]
fn coefficients_of_their_own_are_refused() {
    let mut lines: Vec<&str> = FF14SB.lines().collect();
    let at = lines.iter().position(|l| l.contains("LENNARD_JONES_ACOEF")).unwrap() + 2;
    let other = lines[at].replacen("E+", "E-", 2);
    lines[at] = &other;
    let found = errors(&lines.join("\n")).join("\n");
    assert!(found.contains("coefficients of their own"), "{found}");
}

#[test]
fn broken_files_do_not_panic() {
    let mut seed = 5u64;
    let mut index = |n: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % n
    };
    let pieces =
        ["-", "9", "0", " ", "%FLAG ", "\n", "E", "nan", "99999999", "é", "(", "10I8", "-2147483648"];
    let (mut accepted, mut refused) = (0, 0);
    for _ in 0..300 {
        let mut text = [FF14SB, FF19SB][index(2)].to_string();
        for _ in 0..1 + index(3) {
            let mut at = index(text.len());
            while !text.is_char_boundary(at) {
                at -= 1;
            }
            let piece = pieces[index(pieces.len())];
            match index(3) {
                0 => text.insert_str(at, piece),
                1 => text.truncate(at),
                _ => {
                    let mut end = (at + piece.len()).min(text.len());
                    while !text.is_char_boundary(end) {
                        end += 1;
                    }
                    text.replace_range(at..end, piece);
                }
            }
        }
        match errors(&text).is_empty() {
            true => accepted += 1,
            false => refused += 1,
        }
    }
    assert!(accepted > 5 && refused > 100, "{accepted} {refused}");
}
