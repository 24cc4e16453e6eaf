//! Systems broken at random: no panic, no hang, and what is accepted is sound.
//!
//! `PHIPSI_FUZZ_SECONDS=60` makes the test run that long, `PHIPSI_FUZZ_SEED=N` starts with another seed. A failure prints the
//! seed of its case.

use super::{ALL, read};
use phipsi_formats::system::{CustomBonded, ForceKind, Formula, System};
use phipsi_model::Random;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

const NUMBERS: [&str; 22] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "3",
    "4",
    "1e-9",
    "5e-324",
    "1e154",
    "1e308",
    "1e309",
    "nan",
    "-inf",
    "0x10",
    "1,5",
    "",
    " ",
    "2.5",
    "1e",
    "18446744073709551616",
    "-9223372036854775808",
];

const PIECES: [&str; 40] = [
    "<",
    ">",
    "/>",
    "</",
    "\"",
    "'",
    "&",
    "&#0;",
    "&lt;",
    "<!--",
    "-->",
    "<![CDATA[",
    "]]>",
    "<?xml ",
    "?>",
    "</System>",
    "</Force>",
    "</Forces>",
    "<Particles/>",
    "<Particle mass=\"1\"/>",
    "<Bond p1=\"0\" p2=\"1\" d=\".1\" k=\"1\"/>",
    "<Force type=\"HarmonicBondForce\"><Bonds/></Force>",
    "<Parameter name=\"r\"/>",
    "<Parameter name=\"a\" default=\"1\"/>",
    "curve(",
    "pair(type1, type2)",
    "curve(curve(curve(r)))",
    "; a = curve(r)",
    ";",
    "(",
    ")",
    ",",
    "r",
    "type1",
    "^",
    "é",
    "\u{1f980}",
    "\0",
    "\u{feff}",
    "\n",
];

fn mutate(r: &mut Random, text: &str) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..1 + r.below(5) {
        let n = bytes.len();
        let at = r.below(n + 1);
        let end = (at + [1, 4, 40, 400][r.below(4)]).min(n);
        match r.below(9) {
            0 if n > 0 => bytes[at.min(n - 1)] ^= 1 << r.below(8),
            1 => {
                bytes.drain(at..end);
            }
            2 => {
                let copy = bytes[at..end].to_vec();
                let to = r.below(n + 1);
                bytes.splice(to..to, copy);
            }
            3 if r.below(8) == 0 => bytes.truncate(at),
            4 | 5 => {
                let piece = PIECES[r.below(PIECES.len())];
                bytes.splice(at..at, piece.bytes());
            }
            _ => {
                let is_number = |b: &u8| b.is_ascii_digit() || *b == b'.' || *b == b'-';
                let Some(start) = bytes[at..].iter().position(is_number).map(|i| at + i) else { continue };
                let end = bytes[start..].iter().position(|b| !is_number(b)).map_or(n, |i| start + i);
                bytes.splice(start..end, NUMBERS[r.below(NUMBERS.len())].bytes());
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[test]
fn broken_systems_are_refused_or_sound() {
    let number = |variable: &str| std::env::var(variable).ok().and_then(|text| text.parse::<u64>().ok());
    let duration = number("PHIPSI_FUZZ_SECONDS").map_or(Duration::from_secs(3), Duration::from_secs);
    let first = number("PHIPSI_FUZZ_SEED").unwrap_or(0);
    let (start, mut seed, mut accepted) = (Instant::now(), first, 0u64);
    let mut slowest = (Duration::ZERO, first);
    while seed == first || start.elapsed() < duration {
        let began = Instant::now();
        match catch_unwind(AssertUnwindSafe(|| case(seed))) {
            Ok(sound) => accepted += u64::from(sound),
            Err(panic) => {
                eprintln!("PHIPSI_FUZZ_SEED={seed} reproduces this");
                std::panic::resume_unwind(panic);
            }
        }
        slowest = slowest.max((began.elapsed(), seed));
        seed += 1;
    }
    let (cases, (slowest, slow_seed)) = (seed - first, slowest);
    eprintln!("{cases} cases, {accepted} accepted, slowest {slowest:?} (seed {slow_seed})");
}

/// True if the system was accepted.
fn case(seed: u64) -> bool {
    let mut r = Random::new(seed);
    let text = mutate(&mut r, ALL);
    let read = read(&text);
    assert_eq!(read.value.is_none(), !read.report.errors.is_empty());
    let lines = text.split('\n').count();
    for problem in read.report.errors.iter().chain(&read.report.warnings) {
        let parts = [&problem.place, &problem.found, &problem.required, &problem.remedy];
        assert!(parts.iter().all(|part| !part.is_empty() && part.len() < 5000), "{problem:?}");
        assert!(problem.line.is_none_or(|line| (1..=lines).contains(&(line as usize))), "{problem:?}");
    }
    assert!(!read.report.to_string().is_empty());
    let Some(system) = read.value else { return false };
    sound(&system, &mut r);
    true
}

fn finite(what: &str, numbers: &[f64]) {
    assert!(numbers.iter().all(|x| x.is_finite()), "{what} {numbers:?}");
}

fn sound(system: &System, r: &mut Random) {
    let n = system.masses.len();
    finite("masses", &system.masses);
    assert!(n > 0 && system.masses.iter().all(|mass| *mass >= 0.0));
    let atoms = |atoms: &[usize]| {
        assert!(atoms.iter().all(|atom| *atom < n), "{atoms:?}");
        assert!((1..atoms.len()).all(|k| !atoms[..k].contains(&atoms[k])), "{atoms:?}");
    };
    for constraint in &system.constraints {
        atoms(&constraint.atoms);
        finite("constraint", &[constraint.distance]);
    }
    for force in &system.forces {
        match &force.kind {
            ForceKind::HarmonicBond(list) => list.iter().for_each(|entry| {
                atoms(&entry.atoms);
                finite("bond", &[entry.length, entry.stiffness]);
            }),
            ForceKind::HarmonicAngle(list) => list.iter().for_each(|entry| {
                atoms(&entry.atoms);
                finite("angle", &[entry.angle, entry.stiffness]);
            }),
            ForceKind::PeriodicTorsion(list) => list.iter().for_each(|entry| {
                atoms(&entry.atoms);
                finite("torsion", &[entry.phase, entry.stiffness]);
            }),
            ForceKind::RbTorsion(list) => list.iter().for_each(|entry| {
                atoms(&entry.atoms);
                finite("torsion", &entry.coefficients);
            }),
            ForceKind::CmapTorsion(cmap) => {
                for map in &cmap.maps {
                    assert_eq!(map.energies.len(), map.size * map.size);
                    finite("map", &map.energies);
                }
                for torsion in &cmap.torsions {
                    assert!(torsion.map < cmap.maps.len());
                    torsion.atoms.iter().for_each(|a| atoms(a));
                }
            }
            ForceKind::Nonbonded(tables) => {
                assert_eq!(tables.particles.len(), n);
                for p in &tables.particles {
                    finite("particle", &[p.charge, p.sigma, p.epsilon]);
                }
                for e in &tables.exceptions {
                    atoms(&e.atoms);
                    finite("exception", &[e.charge_product, e.sigma, e.epsilon]);
                }
            }
            ForceKind::GbsaObc(tables) => {
                assert_eq!(tables.particles.len(), n);
                for p in &tables.particles {
                    finite("particle", &[p.charge, p.radius, p.scale]);
                    assert!(p.radius > 0.009);
                }
            }
            ForceKind::CustomBond(tables) => custom(tables, atoms, r),
            ForceKind::CustomAngle(tables) => custom(tables, atoms, r),
            ForceKind::CustomTorsion(tables) => custom(tables, atoms, r),
            ForceKind::CustomNonbonded(tables) => {
                assert_eq!(tables.parameters.len(), n * tables.parameter_names.len());
                tables.exclusions.iter().for_each(|pair| atoms(pair));
                evaluate(&tables.energy, "r", r);
            }
            ForceKind::CustomGb(tables) => {
                assert_eq!(tables.parameters.len(), n * tables.parameter_names.len());
                tables.exclusions.iter().for_each(|pair| atoms(pair));
                let formulas = tables
                    .values
                    .iter()
                    .map(|v| &v.formula)
                    .chain(tables.energies.iter().map(|e| &e.formula));
                formulas.for_each(|formula| evaluate(formula, "r", r));
            }
        }
    }
}

fn custom<const N: usize>(tables: &CustomBonded<N>, atoms: impl Fn(&[usize]), r: &mut Random) {
    assert_eq!(tables.parameters.len(), tables.atoms.len() * tables.parameter_names.len());
    tables.atoms.iter().for_each(|a| atoms(a));
    finite("parameters", &tables.parameters);
    evaluate(&tables.energy, tables.coordinate, r);
}

/// A formula may have no value, but it may not panic.
fn evaluate(formula: &Formula, variable: &str, r: &mut Random) {
    let slope = formula.slope(variable);
    let mut buffer: Vec<f64> = (0..formula.slots()).map(|_| 3.0 * r.signed()).collect();
    formula.value_and_slopes(&mut buffer, &[&slope], &mut [0.0]);
    assert!(formula.value(&mut []).is_nan());
}
