//! Energies and forces of every term against OpenMM's Reference platform, and forces against differences of energies.
//!
//! `PHIPSI_MOLECULES` names another folder of molecules, each in a folder of its own: `NAME.ENVIRONMENT.xml[.gz]` and
//! `NAME.ref.json[.gz]`.

use allocation_counter::measure;
use flate2::read::GzDecoder;
use phipsi_formats::system::{ForceKind, Periodic, System, SystemOptions, read_system};
use phipsi_model::Random;
use phipsi_molecule::{ForceField, LeftOut, Potential, RigidGroups};
use phipsi_spatial::Vec3;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

type V = Vec3<f64>;

/// What was computed from the same structures in the reference data.
const ENVIRONMENTS: [&str; 4] = ["vacuum", "obc2", "obc2_native", "charmm36"];

/// Largest difference of an energy over Σ|terms|, and of a force over the largest force: 4500 ε.
///
/// Sums of n numbers in another order differ by √n ε of their absolute sum, n up to 4·10⁵ pairs, whose repulsion and
/// attraction cancel by up to 10 within one term; r⁻¹³ multiplies the rounding of a distance by 13.
const BAR: f64 = 1e-12;

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../validation/data/molecules")
}

/// The text of a file, gunzipped where its name ends in gz.
fn text(path: &Path) -> String {
    let mut text = String::new();
    let file = std::fs::File::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    if path.extension().is_some_and(|e| e == "gz") {
        GzDecoder::new(file).read_to_string(&mut text).unwrap();
    } else {
        std::io::BufReader::new(file).read_to_string(&mut text).unwrap();
    }
    text
}

/// The file, or the same with `.gz`.
fn either(path: PathBuf) -> Option<PathBuf> {
    let zipped = PathBuf::from(format!("{}.gz", path.display()));
    [path, zipped].into_iter().find(|path| path.exists())
}

fn system(path: &Path) -> System {
    let read = read_system(&text(path), &path.display().to_string(), &SystemOptions::default());
    read.into_result(true).unwrap_or_else(|report| panic!("{report}")).0
}

fn vectors(value: &Value) -> Vec<V> {
    let number = |x: &Value| x.as_f64().expect("a number");
    let row = |row: &Value| Vec3([0, 1, 2].map(|i| number(&row[i])));
    value.as_array().expect("an array").iter().map(row).collect()
}

fn largest(forces: &[V]) -> f64 {
    forces.iter().flat_map(|f| f.0).fold(0.0, |most, x| most.max(x.abs()))
}

fn largest_difference(a: &[V], b: &[V]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| largest(&[*a - *b])).fold(0.0, f64::max)
}

/// The worst figures of an environment, each with its place.
#[derive(Default)]
struct Worst {
    cases: usize,
    energy: (f64, String),
    term: (f64, String),
    force: (f64, String),
    cancelling_force: (f64, String),
    term_force: (f64, String),
}

fn note(worst: &mut (f64, String), value: f64, place: impl Fn() -> String) {
    if value.is_nan() || value > worst.0 || worst.1.is_empty() {
        *worst = (value, place());
    }
}

/// Compares one conformation.
fn compare(field: &mut ForceField, case: &Value, positions: &[V], place: &str, worst: &mut Worst) {
    let (n, count) = (positions.len(), field.terms().len());
    let (mut energies, mut forces) = (vec![0.0; count], vec![Vec3([f64::NAN; 3]); n]);
    field.evaluate(positions, &mut energies, &mut forces).unwrap_or_else(|e| panic!("{place}: {e}"));
    let reference = case["energy"].as_object().expect("energies");
    assert_eq!(reference.len(), count + 1, "{place}: {:?}", field.terms());
    let energy =
        |name: &str| reference.get(name).and_then(Value::as_f64).unwrap_or_else(|| panic!("{place}: {name}"));
    let scale: f64 = field.terms().iter().map(|name| energy(name).abs()).sum();
    for (name, value) in field.terms().iter().zip(&energies) {
        note(&mut worst.term, (value - energy(name)).abs() / scale, || format!("{place} {name}"));
    }
    let total: f64 = energies.iter().sum();
    note(&mut worst.energy, (total - energy("total")).abs() / scale, || place.into());
    let expected = vectors(&case["forces"]);
    let difference = largest_difference(&forces, &expected);
    let mut largest_of_term: f64 = 0.0;
    let mut by_term = Vec::new();
    for term in 0..count {
        let mut forces = vec![Vec3([0.0; 3]); n];
        field.evaluate_term(term, positions, &mut forces).unwrap();
        largest_of_term = largest_of_term.max(largest(&forces));
        if let Some(expected) = case["group_forces"].get(&field.terms()[term]) {
            by_term.push((term, largest_difference(&forces, &vectors(expected))));
        }
    }
    // A stiff term near its own minimum, such as an improper, has small forces with the rounding of large ones.
    for (term, difference) in by_term {
        note(&mut worst.term_force, difference / largest_of_term, || {
            format!("{place} {}", field.terms()[term])
        });
    }
    // In a minimum the forces of the terms cancel: what is left is not better than the rounding of each.
    let minimum = place.contains("\"min\"");
    let worst_force = if minimum { &mut worst.cancelling_force } else { &mut worst.force };
    let scale = if minimum { largest_of_term } else { largest(&expected) };
    note(worst_force, difference / scale, || place.into());
    worst.cases += 1;
}

#[test]
fn molecules_agree_with_openmm() {
    let folder = std::env::var_os("PHIPSI_MOLECULES").map_or_else(data, PathBuf::from);
    let mut worst: BTreeMap<&str, Worst> = BTreeMap::new();
    let mut names: Vec<_> =
        std::fs::read_dir(&folder).expect("the folder").map(|e| e.unwrap().path()).collect();
    names.sort();
    for path in names.iter().filter(|path| path.is_dir()) {
        let name = path.file_name().unwrap().to_string_lossy();
        let Some(reference) = either(path.join(format!("{name}.ref.json"))) else { continue };
        let reference: Value = serde_json::from_str(&text(&reference)).unwrap();
        for environment in ENVIRONMENTS {
            let Some(xml) = either(path.join(format!("{name}.{environment}.xml"))) else { continue };
            let system = system(&xml);
            let mut field = ForceField::new(&system).unwrap();
            for conformation in reference["conformations"].as_array().expect("conformations") {
                let place = format!("{name} {} {environment}", conformation["id"]);
                let positions = vectors(&conformation["positions"]);
                let case = &conformation[environment];
                compare(&mut field, case, &positions, &place, worst.entry(environment).or_default());
            }
        }
    }
    for environment in ENVIRONMENTS {
        let worst =
            worst.get(environment).unwrap_or_else(|| panic!("no {environment} in {}", folder.display()));
        for (what, (value, place)) in [
            ("total energy", &worst.energy),
            ("energy of a term", &worst.term),
            ("force", &worst.force),
            ("force in minima", &worst.cancelling_force),
            ("force of a term", &worst.term_force),
        ] {
            // Forces of single terms are not given for every environment.
            if place.is_empty() {
                continue;
            }
            println!("{environment:11} {:4} cases: {what:16} {value:.1e} ({place})", worst.cases);
            assert!(*value <= BAR, "{environment}: {what}: {value:e} > {BAR:e} ({place})");
        }
        assert!(worst.cases > 0 && !worst.energy.1.is_empty() && !worst.force.1.is_empty());
    }
}

/// Positions, and energies and forces of the terms.
type Conformation = (Vec<V>, Value);

/// Every kind of force and every feature of it: `make.py` beside the data writes them with OpenMM.
fn every_force() -> Vec<(String, System, Vec<Conformation>)> {
    cases("every_force", ["bonded", "pairs", "implicit"])
}

/// Forces with cutoffs, in the same way.
fn cutoffs() -> Vec<(String, System, Vec<Conformation>)> {
    let molecules = ["reaction_field", "switched", "born", "custom_born", "charmm"];
    let mut all = cases("cutoffs", molecules);
    all.extend(cases("cutoffs", ["custom_pairs", "custom_implicit"]));
    all
}

/// Cutoffs in a right and an oblique periodic box that the molecule reaches out of.
fn periodic() -> Vec<(String, System, Vec<Conformation>)> {
    cases("cutoffs", ["periodic", "periodic_switched"])
}

fn cases<const N: usize>(folder: &str, names: [&str; N]) -> Vec<(String, System, Vec<Conformation>)> {
    names
        .map(|name| {
            let folder = data().join(folder);
            let reference = text(&folder.join(format!("{name}.ref.json.gz")));
            let reference: Value = serde_json::from_str(&reference).unwrap();
            let conformations = reference["conformations"].as_array().unwrap().iter();
            let conformations =
                conformations.map(|c| (vectors(&c["positions"]), c["terms"].clone())).collect();
            (name.to_string(), system(&folder.join(format!("{name}.xml.gz"))), conformations)
        })
        .into()
}

#[test]
fn every_force_agrees_with_openmm() {
    for (name, system, conformations) in every_force().into_iter().chain(cutoffs()).chain(periodic()) {
        let mut field = ForceField::new(&system).unwrap();
        for (k, (positions, terms)) in conformations.iter().enumerate() {
            let expected = terms.as_object().unwrap();
            assert_eq!(field.terms().len(), expected.len(), "{:?}", field.terms());
            for term in 0..field.terms().len() {
                let place = format!("{name} {k} {}", field.terms()[term]);
                let expected = &expected[&field.terms()[term]];
                let mut forces = vec![Vec3([0.0; 3]); positions.len()];
                let energy = field.evaluate_term(term, positions, &mut forces).unwrap();
                let expected_forces = vectors(&expected["forces"]);
                let expected = expected["energy"].as_f64().unwrap();
                let difference = largest_difference(&forces, &expected_forces) / largest(&expected_forces);
                // At most 2775 pairs, whose energies cancel by less than 10².
                let relative = (energy - expected).abs() / expected.abs();
                assert!(relative <= BAR, "{place}: {energy} {expected}");
                assert!(difference <= BAR, "{place}: {difference:e}");
            }
        }
    }
}

/// Energies do not change when atoms go to their images, one by one, and forces move with them; without the mean energy beyond the
/// cutoff a far larger box gives what no box does.
#[test]
fn images_of_atoms_are_the_atoms() {
    for (name, system, conformations) in periodic() {
        let vectors = system.box_vectors.unwrap().map(Vec3);
        let mut field = ForceField::new(&system).unwrap();
        let (x, n) = (&conformations[0].0, conformations[0].0.len());
        let mut at = |x: &[V]| {
            let mut forces = vec![Vec3([0.0; 3]); n];
            (field.evaluate_term(0, x, &mut forces).unwrap(), forces)
        };
        let (energy, forces) = at(x);
        let mut random = Random::new(2);
        let moved: Vec<V> = x
            .iter()
            .map(|x| vectors.iter().fold(*x, |x, v| x + v.scale(random.below(5) as f64 - 2.0)))
            .collect();
        let (elsewhere, others) = at(&moved);
        let exceptions = name == "periodic_switched";
        // Exceptions that see no images are torn apart.
        assert_eq!((energy - elsewhere).abs() < 1e-10 * energy.abs(), exceptions, "{energy} {elsewhere}");
        if exceptions {
            assert!(largest_difference(&forces, &others) < 1e-10 * largest(&forces));
        }
        let mut wide = system.clone();
        let ForceKind::Nonbonded(tables) = &mut wide.forces[0].kind else { panic!("pairs") };
        let mut box_vectors = tables.periodic.unwrap().box_vectors;
        (0..3).for_each(|k| box_vectors[k][k] *= 16.0);
        tables.periodic = Some(Periodic { box_vectors, exceptions, dispersion_correction: false });
        let mut open = wide.clone();
        let ForceKind::Nonbonded(tables) = &mut open.forces[0].kind else { panic!("pairs") };
        tables.periodic = None;
        let of = |system: &System| {
            ForceField::new(system).unwrap().evaluate_term(0, x, &mut vec![Vec3([0.0; 3]); n]).unwrap()
        };
        assert!((of(&wide) - of(&open)).abs() < BAR * of(&open).abs(), "{} {}", of(&wide), of(&open));
    }
}

/// −∂E/∂x of every term by central differences, which know nothing of the gradients in the code.
#[test]
fn forces_are_slopes_of_energies() {
    for (name, system, conformations) in every_force() {
        let mut field = ForceField::new(&system).unwrap();
        let positions = &conformations[0].0;
        let n = positions.len();
        for term in 0..field.terms().len() {
            let place = format!("{name} {}", field.terms()[term]);
            let mut forces = vec![Vec3([0.0; 3]); n];
            let energy = field.evaluate_term(term, positions, &mut forces).unwrap();
            let mut energy_at = |atom: usize, axis: usize, h: f64| {
                let mut moved = positions.clone();
                moved[atom].0[axis] += h;
                field.evaluate_term(term, &moved, &mut vec![Vec3([0.0; 3]); n]).unwrap()
            };
            // Richardson: an error of h⁶ f⁽⁷⁾, with lengths of 0.1 nm over which the energies change by their size, and
            // of ε |E|/h of rounding. A spline's third derivative jumps: no better than h² f⁽³⁾ where a node is near.
            let (h, splines) = (2e-4, name == "pairs" || place.ends_with("CMAPTorsionForce"));
            let bar =
                if splines { 1e-5 } else { 1e-8 } * largest(&forces) + 30.0 * f64::EPSILON * energy.abs() / h;
            let mut worst: f64 = 0.0;
            for atom in 0..n {
                for axis in 0..3 {
                    let slope = |e: &mut dyn FnMut(usize, usize, f64) -> f64, h: f64| {
                        (e(atom, axis, h) - e(atom, axis, -h)) / (2.0 * h)
                    };
                    let [d1, d2, d4] = [1.0, 2.0, 4.0].map(|k| slope(&mut energy_at, k * h));
                    let (once, twice) = ((4.0 * d1 - d2) / 3.0, (4.0 * d2 - d4) / 3.0);
                    let difference = (16.0 * once - twice) / 15.0 + forces[atom].0[axis];
                    worst = worst.max(difference.abs());
                }
            }
            assert!(worst <= bar, "{place}: {worst:e} > {bar:e}");
        }
    }
}

#[test]
fn forces_have_no_sum_and_no_moment() {
    for (name, system, conformations) in every_force().into_iter().chain(cutoffs()) {
        let mut field = ForceField::new(&system).unwrap();
        for (positions, _) in &conformations {
            for term in 0..field.terms().len() {
                let mut forces = vec![Vec3([0.0; 3]); positions.len()];
                field.evaluate_term(term, positions, &mut forces).unwrap();
                let (mut sum, mut moment) = (Vec3([0.0; 3]), Vec3([0.0; 3]));
                for (x, f) in positions.iter().zip(&forces) {
                    sum += *f;
                    moment += x.cross(*f);
                }
                // 36 pairs or 20 entries, each of which is rounded once per atom.
                let bar = 200.0 * f64::EPSILON * largest(&forces);
                let place = || format!("{name} {}", field.terms()[term]);
                assert!(
                    largest(&[sum]) <= bar && largest(&[moment]) <= bar,
                    "{}: {sum:?} {moment:?}",
                    place()
                );
            }
        }
    }
}

#[test]
fn what_is_not_finite_is_an_error_with_its_atoms() {
    let (_, system, conformations) = every_force().swap_remove(1);
    let mut field = ForceField::new(&system).unwrap();
    let positions = &conformations[0].0;
    let (mut energies, mut forces) = (vec![0.0; field.terms().len()], vec![Vec3([0.0; 3]); positions.len()]);
    let mut moved = positions.clone();
    moved[4] = moved[7];
    let error = field.evaluate(&moved, &mut energies, &mut forces).unwrap_err();
    assert_eq!((error.term.as_str(), &error.atoms[..]), ("NonbondedForce", &[4usize, 7][..]));
    assert!(error.message.contains("4 and 7, are 0 nm apart"), "{error}");
    moved[3].0[1] = f64::NAN;
    let error = field.evaluate(&moved, &mut energies, &mut forces).unwrap_err();
    assert_eq!((error.term.as_str(), &error.atoms[..]), ("positions", &[3usize][..]));
    let error = field.evaluate(&positions[1..], &mut energies, &mut forces).unwrap_err();
    assert!(error.message.contains("8 positions") && error.message.contains("required: 9"), "{error}");
    field.evaluate(positions, &mut energies, &mut forces).unwrap();
    assert!(energies.iter().all(|energy| energy.is_finite()));
}

#[test]
fn nothing_is_allocated_in_an_evaluation() {
    assert_eq!(measure(|| drop(std::hint::black_box(vec![0u8; 8]))).count_total, 1);
    for (name, system, conformations) in every_force().into_iter().chain(cutoffs()).chain(periodic()) {
        let mut field = ForceField::new(&system).unwrap();
        let positions = &conformations[0].0;
        let (mut energies, mut forces) =
            (vec![0.0; field.terms().len()], vec![Vec3([0.0; 3]); positions.len()]);
        // The first evaluation makes the lists of neighbours.
        field.evaluate(positions, &mut energies, &mut forces).unwrap();
        let counted = measure(|| field.evaluate(positions, &mut energies, &mut forces).unwrap());
        assert_eq!(counted.count_total, 0, "{name}: {counted:?}");
    }
}

/// Numbers of the files replaced at random: what the reader accepts is a force field, and an evaluation has numbers or an
/// error. `PHIPSI_FUZZ_SECONDS` and `PHIPSI_FUZZ_SEED` as in the tests of the readers.
#[test]
fn systems_with_wrong_numbers_do_not_panic() {
    const NUMBERS: [&str; 16] = [
        "0", "-1", "1", "2", "3", "7", "8", "0.5", "1e-9", "1e-300", "5e-324", "1e154", "-1e200", "1e308",
        "-0", "1e6",
    ];
    let files = ["every_force/bonded", "every_force/pairs", "every_force/implicit", "cutoffs/custom_pairs"]
        .map(|name| text(&data().join(format!("{name}.xml.gz"))));
    let number = |variable: &str| std::env::var(variable).ok().and_then(|text| text.parse::<u64>().ok());
    let duration = number("PHIPSI_FUZZ_SECONDS").map_or(Duration::from_secs(2), Duration::from_secs);
    let first = number("PHIPSI_FUZZ_SEED").unwrap_or(0);
    let (start, mut seed, mut evaluated) = (Instant::now(), first, 0);
    while seed == first || start.elapsed() < duration {
        let run = std::panic::catch_unwind(|| {
            let mut r = Random::new(seed);
            let mut text = files[r.below(files.len())].clone();
            for _ in 0..1 + r.below(3) {
                let is_number = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
                let at = r.below(text.len());
                let Some(begin) = text[at..].find(is_number).map(|i| at + i) else { continue };
                let end = text[begin..].find(|c| !is_number(c)).map_or(text.len(), |i| begin + i);
                text.replace_range(begin..end, NUMBERS[r.below(NUMBERS.len())]);
            }
            let Some(system) = read_system(&text, "", &SystemOptions::default()).value else { return 0 };
            let mut field = ForceField::new(&system).expect("what the reader accepts");
            let n = system.masses.len();
            let size = [1e-300, 0.1, 0.3, 10.0, 1e150][r.below(5)];
            let x: Vec<V> = (0..n).map(|_| Vec3([0, 1, 2].map(|_| size * r.signed()))).collect();
            let (mut energies, mut forces) = (vec![0.0; field.terms().len()], vec![Vec3([0.0; 3]); n]);
            match field.evaluate(&x, &mut energies, &mut forces) {
                Ok(()) => {
                    assert!(energies.iter().chain(forces.iter().flat_map(|f| &f.0)).all(|x| x.is_finite()))
                }
                Err(error) => {
                    assert!(field.terms().contains(&error.term) && !error.atoms.is_empty(), "{error}")
                }
            }
            1
        });
        evaluated += run.unwrap_or_else(|panic| {
            eprintln!("PHIPSI_FUZZ_SEED={seed} reproduces this");
            std::panic::resume_unwind(panic)
        });
        seed += 1;
    }
    assert!(evaluated > 0 || seed == first + 1);
    println!("{} cases, {evaluated} evaluated", seed - first);
}

/// Rigid groups turned about the axis of a hinge: energies of all terms as before, forces that differ by none on any group.
#[test]
fn what_is_left_out_is_constant() {
    let files =
        ["met_enkephalin/met_enkephalin.vacuum", "ace_ala3_nme/ace_ala3_nme.charmm36", "cutoffs/switched"];
    for file in files {
        let system = system(&data().join(format!("{file}.xml.gz")));
        let n = system.masses.len();
        let molecule = if n == 42 { "ace_ala3_nme" } else { "met_enkephalin" };
        let reference = text(&data().join(format!("{molecule}/{molecule}.ref.json.gz")));
        let reference: Value = serde_json::from_str(&reference).unwrap();
        let x = vectors(&reference["conformations"][0]["positions"]);
        let bonds: Vec<[usize; 2]> = reference["bonds"]
            .as_array()
            .unwrap()
            .iter()
            .map(|b| [0, 1].map(|k| b[k].as_u64().unwrap() as usize))
            .collect();
        let hinge = bonds
            .iter()
            .copied()
            .find(|&bond| sides(n, &bonds, bond).is_some_and(|s| s.iter().all(|s| s.len() > 8)))
            .unwrap();
        let [first, second] = sides(n, &bonds, hinge).unwrap();
        let with = |side: &[usize], atom: usize| side.iter().copied().chain([atom]).collect::<Vec<_>>();
        let groups = RigidGroups::new(n, [with(&first, hinge[1]), with(&second, hinge[0])]);
        let (mut whole, mut field) = (ForceField::new(&system).unwrap(), ForceField::new(&system).unwrap());
        let left_out = field.leave_out(&groups, &x).unwrap();
        for LeftOut { term, entries: [out, all], .. } in &left_out {
            let whole = term == "HarmonicBondForce" || term == "HarmonicAngleForce";
            assert!(out <= all && (*out == *all || !whole), "{left_out:?}");
        }
        let some = |name: &str| {
            left_out.iter().any(|l| l.term == name && 0 < l.entries[0] && l.entries[0] < l.entries[1])
        };
        assert!(some("NonbondedForce"), "{left_out:?}");
        let axis = x[hinge[1]] - x[hinge[0]];
        let axis = axis.scale(1.0 / axis.norm());
        for angle in [0.0f64, 0.3, 2.0] {
            let mut turned = x.clone();
            for &i in &second {
                let d = x[i] - x[hinge[0]];
                let along = axis.scale(axis.dot(d));
                turned[i] =
                    x[hinge[0]] + along + (d - along).scale(angle.cos()) + axis.cross(d).scale(angle.sin());
            }
            let evaluate = |field: &mut ForceField| {
                let (mut energies, mut forces) = (vec![0.0; field.terms().len()], vec![Vec3([0.0; 3]); n]);
                field.evaluate(&turned, &mut energies, &mut forces).unwrap();
                let mut sums = vec![];
                for side in [&first, &second] {
                    let force = side.iter().fold(Vec3([0.0; 3]), |sum, &i| sum + forces[i]);
                    let moment = side
                        .iter()
                        .fold(Vec3([0.0; 3]), |sum, &i| sum + (turned[i] - x[hinge[0]]).cross(forces[i]));
                    sums.extend([force, Vec3([axis.dot(moment), 0.0, 0.0])]);
                }
                (energies, sums, largest(&forces))
            };
            let ((a, sums_a, size), (b, sums_b, _)) = (evaluate(&mut whole), evaluate(&mut field));
            for (term, (a, b)) in field.terms().iter().zip(a.iter().zip(&b)) {
                // Stiff bonds (2.5e5 kJ/mol/nm²) turn the rounding of a distance into 1e-9 kJ/mol at most.
                assert!((a - b).abs() <= 1e-9 + 1e-12 * a.abs(), "{file} {term}: {a} {b}");
            }
            // Only moments about the axis and forces between the groups move anything; the atoms on the axis share a force along it
            // and the reactions of angles across it.
            let moments =
                (sums_a[3].0[0] - sums_b[3].0[0]).abs().max((sums_a[1].0[0] - sums_b[1].0[0]).abs());
            assert!(moments <= 1e-11 * size, "{file}: {moments:e} of {size}");
        }
    }
}

/// The atoms on either side of a bond; `None` in a ring.
fn sides(n: usize, bonds: &[[usize; 2]], [i, j]: [usize; 2]) -> Option<[Vec<usize>; 2]> {
    let mut seen = vec![false; n];
    let mut found = vec![j];
    seen[j] = true;
    let mut k = 0;
    while k < found.len() {
        for &[a, b] in bonds.iter().filter(|bond| **bond != [i, j]) {
            for (from, to) in [(a, b), (b, a)] {
                if from == found[k] && !seen[to] {
                    seen[to] = true;
                    found.push(to);
                }
            }
        }
        k += 1;
    }
    (!seen[i]).then(|| [(0..n).filter(|&a| !seen[a]).collect(), found])
}
