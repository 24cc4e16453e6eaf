//! Arguments of `TorsionModel` that divide a molecule: clusters, hinges, rigid kinds and groups; what becomes of them.

use crate::errors::{Field, argument_error, choice_error, exception};
use crate::molecule::Loaded;
use crate::report::{Problem, Report};
use phipsi::formats::{self, Note};
use phipsi::molecule::torsion_model::TorsionModel as Torsion;
use phipsi::molecule::{Angles, BondKind, Clustering, Hinges, MoleculeErrors, Rings};
use pyo3::prelude::*;
use pyo3::types::PyString;

/// A `ModelError` with every problem of a molecule.
pub fn molecule_error(py: Python<'_>, errors: &MoleculeErrors) -> PyErr {
    let problem = |e: &phipsi::molecule::MoleculeError| Problem {
        source: None,
        line: None,
        place: e.place.clone(),
        found: e.found.clone(),
        required: e.required.clone(),
        remedy: e.remedy.clone(),
    };
    let problems = errors.0.iter().map(problem).collect();
    exception(py, "ModelError", &errors.to_string(), vec![("errors", Some(Field::Problems(problems)))])
}

/// An atom, by index or name.
fn atom(loaded: &Loaded, object: &Bound<'_, PyAny>, argument: &str) -> PyResult<usize> {
    let (py, atoms) = (object.py(), &loaded.molecule.atoms);
    let n = atoms.len();
    let found = match object.cast::<PyString>() {
        Ok(name) => {
            let name = name.to_string_lossy();
            (0..n).find(|&i| atoms.label(i) == name)
        }
        Err(_) => object.extract::<usize>().ok().filter(|i| *i < n),
    };
    found.ok_or_else(|| {
        let (shown, required) =
            (object.repr().map(|r| r.to_string()), format!("an index below {n} or a name of atom_names"));
        let shown = shown.unwrap_or_default();
        let message = format!("`{argument}` has the atom {shown}, but {required} is required");
        argument_error(py, argument, shown.into(), required.into(), &message, None)
    })
}

fn atoms(loaded: &Loaded, object: &Bound<'_, PyAny>, argument: &str) -> PyResult<Vec<usize>> {
    object.try_iter()?.map(|item| atom(loaded, &item?, argument)).collect()
}

fn atom_lists(loaded: &Loaded, object: &Bound<'_, PyAny>, argument: &str) -> PyResult<Vec<Vec<usize>>> {
    object.try_iter()?.map(|item| atoms(loaded, &item?, argument)).collect()
}

/// The division that the arguments ask for.
///
/// # Errors
/// `ArgumentError`.
pub fn clustering(
    loaded: &Loaded,
    clusters: &Bound<'_, PyAny>,
    rigid: Option<&Bound<'_, PyAny>>,
    hinges: Option<&Bound<'_, PyAny>>,
    (rings, angles): (Option<&Bound<'_, PyAny>>, Option<&Bound<'_, PyAny>>),
    free: Option<&Bound<'_, PyAny>>,
) -> PyResult<Clustering> {
    let py = clusters.py();
    let mut clustering = Clustering::default();
    match clusters.cast::<PyString>() {
        Ok(word) if word == "torsion" => {}
        Ok(word) if word == "torsion+angle" => clustering.angles = Angles::AtHinges,
        Ok(word) if word == "cartesian" => clustering = Clustering::cartesian(loaded.molecule.atoms.len()),
        Ok(word) => {
            let words = ["torsion", "torsion+angle", "cartesian"];
            return Err(choice_error(py, "clusters", &word.to_string_lossy(), &words));
        }
        Err(_) => clustering.hinges = Hinges::Clusters(atom_lists(loaded, clusters, "clusters")?),
    }
    if let Some(rings) = rings {
        clustering.rings = match rings.cast::<PyString>() {
            Ok(word) if word == "rigid" => Rings::Rigid,
            Ok(word) if word == "flexible" => Rings::Flexible,
            Ok(word) => {
                return Err(choice_error(py, "rings", &word.to_string_lossy(), &["rigid", "flexible"]));
            }
            Err(_) => Rings::Listed(atom_lists(loaded, rings, "rings")?),
        };
    }
    if let Some(angles) = angles {
        let triple = |angle: Vec<usize>| {
            <[usize; 3]>::try_from(angle).map_err(|angle| {
                let message =
                    format!("`angles` has a list of {} atoms, but triples are required", angle.len());
                argument_error(py, "angles", Field::Index(angle.len()), "triples".into(), &message, None)
            })
        };
        let angles = atom_lists(loaded, angles, "angles")?;
        clustering.angles = Angles::Listed(angles.into_iter().map(triple).collect::<PyResult<_>>()?);
    }
    if let Some(hinges) = hinges {
        if !matches!(clustering.hinges, Hinges::Rotatable) {
            let message = "`hinges` and `clusters` are both given, but each of them tells the other";
            let required = "one of the two".into();
            return Err(argument_error(py, "hinges", "both".into(), required, message, None));
        }
        let pair = |bond: Vec<usize>| {
            <[usize; 2]>::try_from(bond).map_err(|bond| {
                let message = format!("`hinges` has a list of {} atoms, but pairs are required", bond.len());
                argument_error(py, "hinges", Field::Index(bond.len()), "pairs".into(), &message, None)
            })
        };
        let bonds = atom_lists(loaded, hinges, "hinges")?;
        clustering.hinges = Hinges::Bonds(bonds.into_iter().map(pair).collect::<PyResult<_>>()?);
    }
    if let Some(free) = free {
        let points = match free.cast::<PyString>() {
            Ok(word) if word == "water" => loaded.molecule.atoms.water(),
            Ok(word) => return Err(choice_error(py, "free", &word.to_string_lossy(), &["water"])),
            Err(_) => atoms(loaded, free, "free")?,
        };
        clustering.free.extend(points);
    }
    let Some(rigid) = rigid else { return Ok(clustering) };
    let kind = |word: &str| {
        let words: Vec<&str> = BondKind::ALL.iter().map(|k| k.word()).collect();
        BondKind::from_word(word).ok_or_else(|| choice_error(py, "rigid", word, &words))
    };
    if let Ok(word) = rigid.cast::<PyString>() {
        clustering.rigid.push(kind(&word.to_string_lossy())?);
        return Ok(clustering);
    }
    for item in rigid.try_iter()? {
        let item = item?;
        match item.cast::<PyString>() {
            Ok(word) => clustering.rigid.push(kind(&word.to_string_lossy())?),
            Err(_) => clustering.groups.push(atoms(loaded, &item, "rigid")?),
        }
    }
    Ok(clustering)
}

/// What was made of the molecule.
pub fn report(torsion: &Torsion, kept: usize) -> Report {
    let mut report = formats::Report::new("torsion model");
    let clusters = torsion.clusters();
    let what = format!(
        "{} atoms in {} clusters, {} hinges, {} degrees of freedom",
        torsion.atoms().len(),
        clusters.clusters.len(),
        clusters.hinges.len(),
        torsion.degrees_of_freedom()
    );
    report.used.push(Note::new(None, "molecule", what));
    for ring in &clusters.closures {
        let place = format!("ring at {}", torsion.atoms().bond_label(ring.atoms));
        report.used.push(Note::new(None, place, "flexible, closed at this bond"));
    }
    if clusters.bends() > 0 {
        report.used.push(Note::new(None, "angles", format!("{} are open", clusters.bends())));
    }
    if kept > 0 {
        report.used.push(Note::new(None, "constraints", format!("{kept} are satisfied by the clusters")));
    }
    for locked in &clusters.locked {
        let place = format!("hinge {}", torsion.atoms().bond_label(locked.atoms));
        report.approximated.push(Note::new(None, place, format!("locked: {}", locked.why)));
    }
    Report::new(&report)
}
