//! `[molecule]`: a PDB file and an OpenMM System as a torsion model with its force field.

use super::SceneFile;
use super::mechanism::Mechanism;
use super::recluster;
use super::tree::{Node, Table, Value, suggestion};
use crate::molecule::Molecule;
use phipsi_formats::system::SystemOptions;
use phipsi_formats::{Note, Problem, Report};
use phipsi_model::State;
use phipsi_molecule::{
    Angles, BondKind, Clustering, Clusters, Deviates, Distribution, ForceField, Hinges, MinimizeOptions,
    MolecularForces, MoleculeError, MoleculeErrors, Rings, TorsionModel, draw_velocities, read_molecule,
    satisfied_constraints, strain,
};
use phipsi_motion::Force;
use phipsi_recursion::ArticulatedSweep;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_spatial::Vec3;
use std::path::Path;
use std::sync::Arc;

/// Largest generalised force after minimisation, kJ/mol/rad or kJ/mol/nm, where a scene does not say.
const MINIMIZED: f64 = 0.01;

/// What a molecule has besides its model.
pub(crate) struct MoleculeScene {
    pub(crate) molecule: Molecule,
    pub(crate) forces: Vec<Box<dyn Force>>,
    pub(crate) start: State,
}

/// Reads the molecule.
pub(crate) fn read(
    scene: &mut Table<'_>,
    folder: &Path,
    inner_steps: usize,
    report: &mut Report,
) -> Result<Mechanism, Vec<Report>> {
    let Some(mut table) = scene.table("molecule", report) else { return Err(Vec::new()) };
    let pdb = table.required_text("pdb", report).map(|p| folder.join(p));
    let system = table.required_text("system", report).map(|p| folder.join(p));
    let ignore = texts(&mut table, "ignore", report);
    let (mut clustering, cartesian) = clustering(&mut table, report);
    let free = word_or_indices(&mut table, "free", "water", report);
    let changes = recluster::read(&mut table, &clustering, report);
    let temperature = table.positive("temperature_K", true, report);
    let seed = seed(&mut table, report);
    let minimize = minimize(&mut table, report);
    let fixman = table.flag("fixman", report).unwrap_or(false);
    if fixman && temperature.is_none_or(|t| t == 0.0) {
        let node = table.get("fixman");
        let found = "fixman = true without a temperature above zero";
        let remedy = "set `temperature_K`";
        table.error(node, report, found, "the temperature of Fixman's potential", remedy);
    }
    table.finish(report);
    let (Some(pdb), Some(system)) = (pdb, system) else { return Err(Vec::new()) };
    let loaded = read_molecule(&pdb, &system, &SystemOptions { ignore });
    let reports = loaded.reports.to_vec();
    let Some(read) = loaded.value else { return Err(reports) };
    clustering.free = match free {
        _ if cartesian => (0..read.atoms.len()).collect(),
        Some(Some(atoms)) => atoms,
        Some(None) => read.atoms.water(),
        None => Vec::new(),
    };
    if !report.errors.is_empty() {
        return Err(reports);
    }
    let refuse = |report: &mut Report, errors: MoleculeErrors| {
        report
            .errors
            .extend(errors.0.into_iter().map(|e| Problem::new(None, e.place, e.found, e.required, e.remedy)));
    };
    let mut widest = clustering.clone();
    widest.rigid.retain(|kind| changes.iter().all(|change| !change.thaw.contains(kind)));
    let build = |clustering: &Clustering, positions: &[Vec3<f64>]| {
        let clusters = Clusters::new(&read.atoms, positions, clustering)?;
        let kept = satisfied_constraints(&read.atoms, &clusters, &read.system)?;
        Ok((TorsionModel::new(&read.atoms, positions, clusters)?, kept))
    };
    let (torsion, kept) = match build(&clustering, &read.positions) {
        Ok(built) => built,
        Err(errors) => {
            refuse(report, errors);
            return Err(reports);
        }
    };
    let field = match ForceField::new(&read.system) {
        Ok(field) => field,
        Err(e) => {
            report.errors.push(Problem::new(
                None,
                format!("force `{}`", e.force),
                e.found,
                e.required,
                "correct the System",
            ));
            return Err(reports);
        }
    };
    note_clusters(&torsion, kept, report);
    let rest = |torsion: &TorsionModel| {
        let model = torsion.model();
        State { q: model.neutral(), v: vec![0.0; model.nv()], t: 0.0 }
    };
    let mut start = rest(&torsion);
    let mut torsion = Arc::new(torsion);
    let mut forces = MolecularForces::new(torsion.clone(), field.clone());
    if !look_at_start(&mut forces, &mut start, minimize, report) {
        return Err(reports);
    }
    if widest.rigid.len() < clustering.rigid.len() {
        // What turns later is recorded too: the scene's model has it, at the positions of the start.
        let placed = torsion.positions(&start.q).map_err(|e| {
            let remedy = "correct the positions";
            MoleculeErrors(vec![MoleculeError::new("start", e.to_string(), "positions of all atoms", remedy)])
        });
        torsion = match placed.and_then(|positions| build(&widest, &positions)) {
            Ok((torsion, _)) => Arc::new(torsion),
            Err(errors) => {
                refuse(report, errors);
                return Err(reports);
            }
        };
        start = rest(&torsion);
    }
    let model = torsion.model().clone();
    let mut molecule = Molecule::new(torsion.clone(), seed);
    (molecule.temperature, molecule.distribution) = (temperature, Distribution::with_fixman(fixman));
    molecule.inner_steps = inner_steps;
    let made = molecule.forces_on(&torsion, field.clone(), &start.q).and_then(|own| {
        let told = own.left_out.iter().filter(|l| l.entries[0] > 0);
        report.used.extend(told.map(|l| Note::new(None, "left out", l.to_string())));
        let parts = (&*torsion, &field);
        let of_atoms = (&read.atoms, &read.positions[..]);
        Ok((own.forces, recluster::schedule(of_atoms, parts, (clustering, changes), report)?))
    });
    let own = match made {
        Ok((forces, schedule)) => {
            molecule.schedule = schedule.map(Arc::new);
            forces
        }
        Err(errors) => {
            refuse(report, errors);
            return Err(reports);
        }
    };
    if let Some(temperature) = temperature {
        match ArticulatedSweep::new(torsion.layout(), &start.q) {
            Ok(factors) => {
                let mut workspace = SolveWorkspace::new(torsion.layout());
                let mut deviates = Deviates::new(seed);
                let layout = torsion.layout();
                draw_velocities(layout, &factors, temperature, &mut deviates, &mut workspace, &mut start.v);
                if let Err(errors) = torsion.close_velocities(&start.q, &mut start.v) {
                    refuse(report, errors);
                    return Err(reports);
                }
            }
            Err(e) => {
                let remedy = "keep the named hinge rigid";
                report.errors.push(Problem::new(
                    None,
                    "molecule",
                    e.to_string(),
                    "a regular mass matrix",
                    remedy,
                ));
                return Err(reports);
            }
        }
    }
    let files = vec![
        SceneFile { key: "molecule.pdb".into(), path: pdb },
        SceneFile { key: "molecule.system".into(), path: system },
    ];
    let molecule = Some(MoleculeScene { molecule, forces: own, start });
    Ok(Mechanism { model, files, reports, friction_speed: None, moving: Vec::new(), molecule })
}

/// A strained start is told, and minimisation made where it was asked for; false where there is no start.
fn look_at_start(
    forces: &mut MolecularForces<ForceField>,
    start: &mut State,
    minimize: Option<f64>,
    report: &mut Report,
) -> bool {
    let failed = |report: &mut Report, e: &dyn std::fmt::Display| {
        let remedy = "move the atoms apart, or correct the files";
        report.errors.push(Problem::new(
            None,
            "force field",
            e.to_string(),
            "finite forces at the start",
            remedy,
        ));
        false
    };
    let found = match strain(forces, &start.q) {
        Ok(found) => found,
        Err(e) => return failed(report, &e),
    };
    if let Some(strain) = &found {
        let place = format!("atom {}", strain.atom);
        let required = "a start near equilibrium";
        let remedy =
            if minimize.is_some() { "it is minimised first" } else { "set `minimize = true` in [molecule]" };
        report.warnings.push(Problem::new(None, place, strain.to_string(), required, remedy));
    }
    let Some(largest_force) = minimize else { return true };
    let options = MinimizeOptions { largest_force, ..MinimizeOptions::default() };
    match phipsi_molecule::minimize(forces, &start.q, &options) {
        Ok((minimum, _)) => {
            let what = format!(
                "minimised in {} evaluations to {:.6} kJ/mol, largest generalised force {:.1e} (joint {})",
                minimum.evaluations, minimum.energy, minimum.largest_force, minimum.joint
            );
            report.used.push(Note::new(None, "start", what));
            if !minimum.converged {
                let found = format!("a largest generalised force of {:.1e}", minimum.largest_force);
                let required = format!("at most {largest_force:e} kJ/mol (per rad or nm)");
                let remedy = "raise the value of `minimize`, or start from other positions";
                report.warnings.push(Problem::new(None, "minimisation", found, required, remedy));
            }
            start.q = minimum.q;
            true
        }
        Err(e) => failed(report, &e),
    }
}

fn note_clusters(torsion: &TorsionModel, kept: usize, report: &mut Report) {
    let clusters = torsion.clusters();
    let mut what = format!(
        "{} atoms in {} rigid clusters, {} hinges, {} degrees of freedom",
        torsion.atoms().len(),
        clusters.clusters.len(),
        clusters.hinges.len(),
        torsion.degrees_of_freedom()
    );
    if kept > 0 {
        what += &format!("; {kept} constraints of the System are satisfied by the clusters");
    }
    let rings = clusters.closures.iter().map(|c| torsion.atoms().bond_label(c.atoms)).collect::<Vec<_>>();
    if !rings.is_empty() {
        what += &format!("; flexible rings closed at {}", rings.join(", "));
    }
    let bends = clusters.bends();
    if bends > 0 {
        what += &format!("; {bends} open bond angles");
    }
    let lines = torsion.model().still_axes().count();
    if lines > 0 {
        let off = torsion.straightened();
        what += &format!("; {lines} linear molecules, their atoms put on lines by at most {off:.1e} nm");
    }
    report.used.push(Note::new(None, "molecule", what));
    for locked in &clusters.locked {
        let place = format!("hinge {}", torsion.atoms().bond_label(locked.atoms));
        report.approximated.push(Note::new(None, place, format!("locked: {}", locked.why)));
    }
}

/// `clusters`: a word, or lists of atoms; `rings`: a word, or lists of atoms; `angles`: triples of atoms; `rigid`: kinds of bonds;
/// `groups`: lists of atoms; `hinges`: a list of bonds. With it whether all atoms move by themselves.
fn clustering(table: &mut Table<'_>, report: &mut Report) -> (Clustering, bool) {
    let mut clustering = Clustering::default();
    let mut cartesian = false;
    match word_or_lists(table, "clusters", &["torsion", "torsion+angle", "cartesian"], report) {
        Some(Ok("torsion+angle")) => clustering.angles = Angles::AtHinges,
        Some(Ok("cartesian")) => cartesian = true,
        Some(Ok(_)) | None => {}
        Some(Err(lists)) => clustering.hinges = Hinges::Clusters(lists),
    }
    match word_or_lists(table, "rings", &["rigid", "flexible"], report) {
        Some(Ok("flexible")) => clustering.rings = Rings::Flexible,
        Some(Ok(_)) | None => {}
        Some(Err(lists)) => clustering.rings = Rings::Listed(lists),
    }
    if let Some(angles) = index_lists(table, "angles", report) {
        let triples: Option<Vec<[usize; 3]>> =
            angles.into_iter().map(|a| <[usize; 3]>::try_from(a).ok()).collect();
        match triples {
            Some(triples) => clustering.angles = Angles::Listed(triples),
            None => {
                let node = table.get("angles");
                let found = "`angles` with other lists than triples";
                table.error(node, report, found, "[[h, i, j], …]", "correct `angles`");
            }
        }
    }
    clustering.rigid = kinds(table, "rigid", report);
    if let Some(bonds) = index_lists(table, "hinges", report) {
        let pairs: Option<Vec<[usize; 2]>> =
            bonds.into_iter().map(|b| <[usize; 2]>::try_from(b).ok()).collect();
        match pairs {
            Some(pairs) => clustering.hinges = Hinges::Bonds(pairs),
            None => {
                let node = table.get("hinges");
                table.error(
                    node,
                    report,
                    "`hinges` with other lists than pairs",
                    "[[i, j], …]",
                    "correct `hinges`",
                );
            }
        }
    }
    if let Some(groups) = index_lists(table, "groups", report) {
        clustering.groups = groups;
    }
    (clustering, cartesian)
}

/// Kinds of bonds.
pub(super) fn kinds(table: &mut Table<'_>, key: &'static str, report: &mut Report) -> Vec<BondKind> {
    let mut found = Vec::new();
    for word in texts(table, key, report) {
        match BondKind::from_word(&word) {
            Some(kind) => found.push(kind),
            None => {
                let node = table.get(key);
                let words: Vec<&str> = BondKind::ALL.iter().map(|k| k.word()).collect();
                let required = format!("kinds of bonds: {}", words.join(", "));
                let what = format!("{key} = [… {word:?} …]");
                table.error(node, report, what, required, suggestion(&word, &words));
            }
        }
    }
    found
}

/// One of some words, or lists of atom indices.
fn word_or_lists(
    table: &mut Table<'_>,
    key: &'static str,
    words: &[&'static str],
    report: &mut Report,
) -> Option<Result<&'static str, Vec<Vec<usize>>>> {
    let node = table.get(key)?;
    let Value::Text(text) = &node.value else { return index_lists(table, key, report).map(Err) };
    let known = words.iter().find(|word| *word == text);
    if known.is_none() {
        let required = format!("one of {}, or lists of atom indices", words.join(", "));
        table.error(Some(node), report, format!("{key} = {text:?}"), required, suggestion(text, words));
    }
    known.map(|word| Ok(*word))
}

/// A word, then `None`, or atom indices from 0.
fn word_or_indices(
    table: &mut Table<'_>,
    key: &'static str,
    word: &'static str,
    report: &mut Report,
) -> Option<Option<Vec<usize>>> {
    let node = table.get(key)?;
    let index = |n: &Node| match n.value {
        Value::Integer(i) => usize::try_from(i).ok(),
        _ => None,
    };
    let found = match &node.value {
        Value::Text(text) if text == word => Some(None),
        Value::List(items) => items.iter().map(index).collect::<Option<Vec<usize>>>().map(Some),
        _ => None,
    };
    if found.is_none() {
        let shown = format!("{key} = {}", node.value.describe());
        let required = format!("{word:?}, or a list of atom indices, from 0");
        table.error(Some(node), report, shown, required, format!("correct `{key}`"));
    }
    found
}

/// Lists of atom indices, from 0.
fn index_lists(table: &mut Table<'_>, key: &'static str, report: &mut Report) -> Option<Vec<Vec<usize>>> {
    let node = table.get(key)?;
    let index = |n: &Node| match n.value {
        Value::Integer(i) => usize::try_from(i).ok(),
        _ => None,
    };
    let inner = |n: &Node| match &n.value {
        Value::List(items) => items.iter().map(index).collect::<Option<Vec<usize>>>(),
        _ => None,
    };
    let lists = match &node.value {
        Value::List(items) => items.iter().map(inner).collect::<Option<Vec<_>>>(),
        _ => None,
    };
    if lists.is_none() {
        let found = format!("{key} = {}", node.value.describe());
        table.error(Some(node), report, found, "lists of atom indices, from 0", format!("correct `{key}`"));
    }
    lists
}

/// A list of texts; empty where the key is missing.
fn texts(table: &mut Table<'_>, key: &'static str, report: &mut Report) -> Vec<String> {
    let Some(node) = table.get(key) else { return Vec::new() };
    let text = |n: &Node| match &n.value {
        Value::Text(s) => Some(s.clone()),
        _ => None,
    };
    let list = match &node.value {
        Value::List(items) => items.iter().map(text).collect::<Option<Vec<String>>>(),
        _ => None,
    };
    list.unwrap_or_else(|| {
        let found = format!("{key} = {}", node.value.describe());
        table.error(Some(node), report, found, "texts in brackets", format!("correct `{key}`"));
        Vec::new()
    })
}

fn seed(table: &mut Table<'_>, report: &mut Report) -> u64 {
    let Some(node) = table.get("seed") else { return 0 };
    match node.value {
        Value::Integer(i) if i >= 0 => i as u64,
        _ => {
            let found = format!("seed = {}", node.value.describe());
            table.error(Some(node), report, found, "a whole number, at least 0", "correct `seed`");
            0
        }
    }
}

/// `minimize = true`, or the largest generalised force to reach.
fn minimize(table: &mut Table<'_>, report: &mut Report) -> Option<f64> {
    let node = table.get("minimize")?;
    match node.value {
        Value::Flag(on) => on.then_some(MINIMIZED),
        _ => table.positive("minimize", false, report),
    }
}
