//! The class `System`: molecules from files, energies and forces of their force field.

use crate::batch::{Argument, Batch, array};
use crate::errors::{
    Failure, Field, argument_error, check_file, choice_error, exception, load_error, potential_error,
};
use crate::report::Report;
use crate::source::{Source, TopologyAtom};
use numpy::PyArrayDyn;
use phipsi::formats::prmtop::{PrmtopOptions, read_inpcrd_file, read_prmtop_file};
use phipsi::formats::system::SystemOptions;
use phipsi::molecule::{ForceField, LoadedMolecule, Molecule, Potential, join_amber, read_molecule};
use phipsi::spatial::Vec3;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Arc;

/// Work that one task of a thread takes, in pairs of atoms.
const GRAIN: usize = 1 << 16;

/// A molecule and its force field, both immutable.
pub struct Loaded {
    /// Atoms, positions, tables.
    pub molecule: Molecule,
    /// The terms; cloned by every task, as each has its scratch.
    pub field: ForceField,
    /// Keys of the terms' energies.
    keys: Vec<String>,
}

/// Atoms with the force field of an OpenMM System: energies and forces, in double precision.
///
/// Made by ``System.from_files`` or ``System.from_openmm``. Units are OpenMM's: nm, kJ/mol, kJ/mol/nm, Da. Positions are
/// (…, n_atoms, 3); leading batch axes are always allowed. ``positions=None`` means those of the file.
///
/// Example
/// -------
/// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
/// >>> s
/// <phipsi.molecule.System: 22 atoms, 4 terms>
/// >>> s.forces().shape
/// (22, 3)
#[pyclass(frozen, module = "phipsi.molecule")]
pub struct System {
    loaded: Arc<Loaded>,
    report: Py<Report>,
    source: Source,
    strict: bool,
}

impl System {
    /// What a call works on.
    pub fn loaded(&self) -> Arc<Loaded> {
        self.loaded.clone()
    }

    fn new(py: Python<'_>, loaded: LoadedMolecule, source: Source, strict: bool) -> PyResult<Self> {
        let (molecule, reports) = match loaded.into_result(strict) {
            Ok(loaded) => loaded,
            Err(reports) => return Err(load_error(py, Report::joined(&reports[..]))),
        };
        let report = Report::joined(&reports);
        let field = match ForceField::new(&molecule.system) {
            Ok(field) => field,
            Err(e) => {
                let fields = vec![("report", Some(Field::Report(report)))];
                return Err(exception(py, "ModelError", &e.to_string(), fields));
            }
        };
        // The sum has the key "total"; a force may have this name too.
        let key = |name: &String| if name == TOTAL { format!("{TOTAL}#2") } else { name.clone() };
        let keys = field.terms().iter().map(key).collect();
        let loaded = Arc::new(Loaded { molecule, field, keys });
        Ok(System { loaded, report: Py::new(py, report)?, source, strict })
    }
}

impl System {
    /// Loads a source.
    fn made(py: Python<'_>, source: Source, strict: bool) -> PyResult<Self> {
        let Some(loaded) = py.detach(|| source.load()) else {
            return Err(exception(py, "ArgumentError", "these tables are not those of a System", vec![]));
        };
        Self::new(py, loaded, source, strict)
    }
}

/// Names and texts of files that could be read.
fn texts(loaded: &LoadedMolecule, files: [&PathBuf; 2]) -> Vec<(String, String)> {
    let text = |path: &PathBuf| {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        (path.display().to_string(), text)
    };
    if loaded.value.is_some() { files.map(text).into() } else { Vec::new() }
}

/// Key of the sum of all energies.
pub const TOTAL: &str = "total";

impl Loaded {
    /// Positions of the argument `name`, or those of the file.
    ///
    /// # Errors
    /// Those of [`Argument::read`].
    pub fn positions(
        &self,
        py: Python<'_>,
        object: Option<&Bound<'_, PyAny>>,
        name: &'static str,
    ) -> PyResult<Argument> {
        let atoms = &self.molecule.atoms;
        match object {
            Some(object) => {
                let describe = |i: usize| format!("atom {}, {}", atoms.label(i / 3), ["x", "y", "z"][i % 3]);
                let meaning = "x, y, z of every atom, nm";
                Argument::read(object, name, &[atoms.len(), 3], meaning, &describe)
            }
            None => {
                let file = rows(py, &self.molecule.positions)?.into_any();
                Argument::read(&file, name, &[atoms.len(), 3], "", &|_| String::new())
            }
        }
    }
    /// Evaluates all terms, or one, at every state; `keep` takes `size` numbers of each out of energies and forces.
    fn evaluate<'py, T>(
        &self,
        py: Python<'py>,
        positions: Option<&Bound<'_, PyAny>>,
        term: Option<usize>,
        size: usize,
        keep: impl Fn(&[f64], &[Vec3<f64>], &mut [f64]) + Sync + Send,
        convert: impl FnOnce(&Batch, Vec<f64>) -> PyResult<T>,
    ) -> PyResult<T> {
        let (n, terms) = (self.molecule.atoms.len(), self.keys.len());
        let mut positions = self.positions(py, positions, "positions")?;
        let batch = Batch::of(py, [&mut positions])?;
        let workspace =
            || (self.field.clone(), vec![Vec3::zero(); n], vec![0.0; terms], vec![Vec3::zero(); n]);
        let out = batch.each_of(py, (GRAIN / (n * n)).clamp(1, 256), size, workspace, |work, i, out| {
            let (field, x, energies, forces) = work;
            vectors(positions.at(i), x);
            match term {
                None => field.evaluate(x, energies, forces)?,
                Some(term) => {
                    forces.fill(Vec3::zero());
                    energies[term] = field.evaluate_term(term, x, forces)?;
                }
            }
            keep(energies, forces, out);
            Ok(())
        });
        match out {
            Ok(out) => convert(&batch, out),
            Err((state, Failure::Potential(e))) => {
                Err(potential_error(py, &e, &self.molecule.describe(&e), batch.place(state)))
            }
            Err((state, other)) => {
                let message = format!("the sum of the energies is not finite: {other:?}");
                let fields = vec![
                    ("quantity", Some("energy".into())),
                    ("required", Some("finite numbers".into())),
                    ("remedy", Some("separate atoms that nearly coincide".into())),
                    ("state", batch.place(state).map(Field::Tuple)),
                ];
                Err(exception(py, "NumericalError", &message, fields))
            }
        }
    }
}

/// Numbers as vectors.
pub fn vectors(numbers: &[f64], out: &mut [Vec3<f64>]) {
    for (out, x) in out.iter_mut().zip(numbers.chunks_exact(3)) {
        out.0.copy_from_slice(x);
    }
}

/// Vectors as an array (n, 3).
///
/// # Errors
/// Those of NumPy.
pub fn rows<'py>(py: Python<'py>, vectors: &[Vec3<f64>]) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    array(py, vectors.iter().flat_map(|v| v.0).collect(), vec![vectors.len(), 3])
}

#[pymethods]
impl System {
    /// Reads a PDB file and the System of the same atoms, as OpenMM's XmlSerializer writes it.
    ///
    /// Parameters
    /// ----------
    /// pdb : names, elements and positions.
    /// system_xml : masses and forces. Of a periodic box NonbondedForce's CutoffPeriodic is read; Ewald sums, other forces in a box
    ///     and virtual sites are refused.
    /// strict : True refuses warnings too.
    /// ignore : names or classes of forces that are left out.
    ///
    /// Raises
    /// ------
    /// OSError if a file cannot be opened; ModelError, with the report, if one cannot be used or they are not of the same
    /// atoms.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    /// >>> s.terms
    /// ['HarmonicBondForce', 'PeriodicTorsionForce', 'NonbondedForce', 'HarmonicAngleForce']
    #[staticmethod]
    #[pyo3(signature = (pdb, system_xml, strict = false, ignore = None))]
    fn from_files(
        py: Python<'_>,
        pdb: PathBuf,
        system_xml: PathBuf,
        strict: bool,
        ignore: Option<Vec<String>>,
    ) -> PyResult<Self> {
        check_file(&pdb)?;
        check_file(&system_xml)?;
        let options = SystemOptions { ignore: ignore.unwrap_or_default() };
        let (loaded, texts) = py.detach(|| {
            let loaded = read_molecule(&pdb, &system_xml, &options);
            let texts = texts(&loaded, [&pdb, &system_xml]);
            (loaded, texts)
        });
        let source = Source { kind: "files".into(), texts, ignore: options.ignore, ..Source::default() };
        Self::new(py, loaded, source, strict)
    }
    /// Takes over a topology, a System and positions of OpenMM.
    ///
    /// Parameters
    /// ----------
    /// topology : openmm.app.Topology. system : openmm.System. positions : with a unit, or in nm.
    /// strict, ignore : as in ``from_files``.
    ///
    /// Raises
    /// ------
    /// ModelError, with the report, if the System cannot be used; ImportError without OpenMM.
    ///
    /// Example
    /// -------
    /// >>> from openmm import XmlSerializer, app
    /// >>> pdb = app.PDBFile("ala_dipeptide.pdb")
    /// >>> system = XmlSerializer.deserialize(open("ala_dipeptide.xml").read())
    /// >>> phipsi.molecule.System.from_openmm(pdb.topology, system, pdb.positions)
    /// <phipsi.molecule.System: 22 atoms, 4 terms>
    #[staticmethod]
    #[pyo3(signature = (topology, system, positions, strict = false, ignore = None))]
    fn from_openmm(
        py: Python<'_>,
        topology: &Bound<'_, PyAny>,
        system: &Bound<'_, PyAny>,
        positions: &Bound<'_, PyAny>,
        strict: bool,
        ignore: Option<Vec<String>>,
    ) -> PyResult<Self> {
        let tables = py.import("phipsi._openmm")?.getattr("tables")?.call1((topology, system, positions))?;
        let (text, atoms, bonds, positions): (String, Vec<TopologyAtom>, Vec<[usize; 2]>, Bound<'_, PyAny>) =
            tables.extract()?;
        let meaning = "x, y, z of every atom of the topology, nm";
        let describe = |i: usize| format!("atom {}", i / 3);
        let positions = Argument::read(&positions, "positions", &[atoms.len(), 3], meaning, &describe)?;
        crate::simulator::check_single(py, &positions)?;
        let source = Source {
            kind: "openmm".into(),
            texts: vec![("System".into(), text)],
            atoms,
            bonds,
            positions: positions.at(0).to_vec(),
            ignore: ignore.unwrap_or_default(),
            ..Source::default()
        };
        Self::made(py, source, strict)
    }
    /// Reads a topology and coordinates of AMBER: a prmtop file, and an inpcrd or rst7 file in text.
    ///
    /// The forces are named as those that OpenMM makes of the file; without cutoff and constraints. Files have eight digits.
    ///
    /// Parameters
    /// ----------
    /// prmtop, inpcrd : the files. Terms of its own of a pair of types, virtual sites, 12-6-4 and CHARMM's terms are refused.
    /// implicit_solvent : None or "obc2": GBSAOBCForce with the radii of the file and a surface energy.
    /// solvent_dielectric, solute_dielectric : of the implicit solvent.
    /// strict : True refuses warnings too.
    ///
    /// Raises
    /// ------
    /// OSError if a file cannot be opened; ModelError, with the report, if one cannot be used; ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_prmtop("ala_dipeptide.prmtop", "ala_dipeptide.inpcrd")
    /// >>> s
    /// <phipsi.molecule.System: 22 atoms, 4 terms>
    #[staticmethod]
    #[pyo3(signature = (prmtop, inpcrd, implicit_solvent = None, solvent_dielectric = 78.5, solute_dielectric = 1.0,
        strict = false))]
    fn from_prmtop(
        py: Python<'_>,
        prmtop: PathBuf,
        inpcrd: PathBuf,
        implicit_solvent: Option<&str>,
        solvent_dielectric: f64,
        solute_dielectric: f64,
        strict: bool,
    ) -> PyResult<Self> {
        check_file(&prmtop)?;
        check_file(&inpcrd)?;
        let obc2 = match implicit_solvent {
            None => None,
            Some("obc2") => Some([solvent_dielectric, solute_dielectric]),
            Some(other) => return Err(choice_error(py, "implicit_solvent", other, &["obc2"])),
        };
        for (name, x) in
            [("solvent_dielectric", solvent_dielectric), ("solute_dielectric", solute_dielectric)]
        {
            if !(x > 0.0 && x.is_finite()) {
                let required = "a positive finite number";
                let message = format!("`{name}` is {x}, but {required} is required");
                return Err(argument_error(py, name, Field::Number(x), required.into(), &message, None));
            }
        }
        let (loaded, texts) = py.detach(|| {
            let read = read_prmtop_file(&prmtop, &PrmtopOptions { obc2 });
            let loaded = join_amber(read, |n| read_inpcrd_file(&inpcrd, n));
            let texts = texts(&loaded, [&prmtop, &inpcrd]);
            (loaded, texts)
        });
        let numbers = obc2.map(Vec::from).unwrap_or_default();
        let source = Source { kind: "amber".into(), texts, numbers, ..Source::default() };
        Self::new(py, loaded, source, strict)
    }
    /// Atoms and bonds without a force field.
    #[staticmethod]
    fn _from_atoms(
        py: Python<'_>,
        masses: Vec<f64>,
        atoms: Vec<TopologyAtom>,
        bonds: Vec<[usize; 2]>,
        positions: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let describe = |i: usize| format!("atom {}", i / 3);
        let positions = Argument::read(
            positions,
            "positions",
            &[atoms.len(), 3],
            "x, y, z of every atom, nm",
            &describe,
        )?;
        crate::simulator::check_single(py, &positions)?;
        let positions = positions.at(0).to_vec();
        let source =
            Source { kind: "atoms".into(), numbers: masses, atoms, bonds, positions, ..Source::default() };
        Self::made(py, source, false)
    }
    /// The System again, in another process.
    #[staticmethod]
    #[allow(clippy::too_many_arguments)]
    fn _restore(
        py: Python<'_>,
        kind: String,
        texts: Vec<(String, String)>,
        numbers: Vec<f64>,
        atoms: Vec<TopologyAtom>,
        bonds: Vec<[usize; 2]>,
        positions: Vec<f64>,
        ignore: Vec<String>,
        strict: bool,
    ) -> PyResult<Self> {
        Self::made(py, Source { kind, texts, numbers, atoms, bonds, positions, ignore }, strict)
    }
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let Source { kind, texts, numbers, atoms, bonds, positions, ignore } = self.source.clone();
        let arguments =
            (kind, texts, numbers, atoms, bonds, positions, ignore, self.strict).into_pyobject(py)?;
        Ok((py.get_type::<System>().getattr("_restore")?, arguments.into_any()))
    }
    /// What the readers used, approximated and ignored of both files: a Report.
    #[getter]
    fn report(&self, py: Python<'_>) -> Py<Report> {
        self.report.clone_ref(py)
    }
    /// Number of atoms.
    #[getter]
    fn n_atoms(&self) -> usize {
        self.loaded.molecule.atoms.len()
    }
    /// Names of the atoms with their residue, such as "ALA2:CA"; with the chain before it where there are several.
    #[getter]
    fn atom_names(&self) -> Vec<String> {
        let atoms = &self.loaded.molecule.atoms;
        (0..atoms.len()).map(|i| atoms.label(i)).collect()
    }
    /// Atomic numbers; 0 of a particle that is no atom.
    #[getter]
    fn atomic_numbers(&self) -> Vec<usize> {
        self.loaded.molecule.atoms.elements.iter().map(|z| usize::from(*z)).collect()
    }
    /// Masses, Da: (n_atoms,).
    #[getter]
    fn masses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let masses = self.loaded.molecule.atoms.masses.clone();
        let n = masses.len();
        array(py, masses, vec![n])
    }
    /// Positions of the file, nm: (n_atoms, 3).
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        rows(py, &self.loaded.molecule.positions)
    }
    /// Covalent bonds, pairs of atoms: those of springs and constraints of the System and of the file.
    #[getter]
    fn bonds(&self) -> Vec<(usize, usize)> {
        self.loaded.molecule.atoms.bonds.iter().map(|[i, j]| (*i, *j)).collect()
    }
    /// Names of the terms of the energy: the forces' names, their classes where they have none; a second one of the same
    /// name ends in #2.
    #[getter]
    fn terms(&self) -> Vec<String> {
        self.loaded.keys.clone()
    }
    /// Energy of every term and their sum.
    ///
    /// Parameters
    /// ----------
    /// positions : (…, n_atoms, 3), nm; None: those of the file.
    ///
    /// Returns
    /// -------
    /// {term: energy, …, "total": energy}, kJ/mol: floats, or arrays of the batch axes.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError, with ``term`` and ``atoms``, where an energy or a force is not finite.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    /// >>> e = s.energy()
    /// >>> bool(np.isclose(e["total"], sum(e[name] for name in s.terms)))
    /// True
    /// >>> s.energy(np.stack([s.positions, 1.01 * s.positions]))["HarmonicBondForce"].shape
    /// (2,)
    #[pyo3(signature = (positions = None))]
    pub fn energy<'py>(
        &self,
        py: Python<'py>,
        positions: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let keys = &self.loaded.keys;
        let size = keys.len() + 1;
        let keep = |energies: &[f64], _: &[Vec3<f64>], out: &mut [f64]| {
            out[..energies.len()].copy_from_slice(energies);
            out[energies.len()] = energies.iter().sum();
        };
        self.loaded.evaluate(py, positions, None, size, keep, |batch, out| {
            let energies = PyDict::new(py);
            for (k, key) in keys.iter().map(String::as_str).chain([TOTAL]).enumerate() {
                let column = out.iter().skip(k).step_by(size).copied().collect();
                energies.set_item(key, batch.array(py, column, &[])?)?;
            }
            Ok(energies)
        })
    }
    /// Forces on the atoms, −∂E/∂x of the total energy or of one term.
    ///
    /// Parameters
    /// ----------
    /// positions : (…, n_atoms, 3), nm; None: those of the file.
    /// term : the name of a term, see ``terms``; None: all.
    ///
    /// Returns
    /// -------
    /// (…, n_atoms, 3), kJ/mol/nm.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError, with ``term`` and ``atoms``, where an energy or a force is not finite.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    /// >>> f = s.forces(s.positions)
    /// >>> bool(np.abs(f.sum(axis=0)).max() < 1e-9 * np.abs(f).max())
    /// True
    #[pyo3(signature = (positions = None, term = None))]
    fn forces<'py>(
        &self,
        py: Python<'py>,
        positions: Option<&Bound<'py, PyAny>>,
        term: Option<&str>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let n = self.loaded.molecule.atoms.len();
        let keys = &self.loaded.keys;
        let term = match term {
            None => None,
            Some(name) => match keys.iter().position(|key| key == name) {
                Some(term) => Some(term),
                None => {
                    let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
                    return Err(choice_error(py, "term", name, &keys));
                }
            },
        };
        let keep = |_: &[f64], forces: &[Vec3<f64>], out: &mut [f64]| {
            for (out, force) in out.chunks_exact_mut(3).zip(forces) {
                out.copy_from_slice(&force.0);
            }
        };
        self.loaded.evaluate(py, positions, term, 3 * n, keep, |batch, out| batch.array(py, out, &[n, 3]))
    }
    /// Total energy and forces on the atoms in one evaluation: ((…), (…, n_atoms, 3)).
    #[pyo3(signature = (positions = None))]
    fn _energy_and_forces<'py>(
        &self,
        py: Python<'py>,
        positions: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let n = self.loaded.molecule.atoms.len();
        let size = 3 * n + 1;
        let keep = |energies: &[f64], forces: &[Vec3<f64>], out: &mut [f64]| {
            out[0] = energies.iter().sum();
            for (out, force) in out[1..].chunks_exact_mut(3).zip(forces) {
                out.copy_from_slice(&force.0);
            }
        };
        self.loaded.evaluate(py, positions, None, size, keep, |batch, out| {
            let energies = out.iter().step_by(size).copied().collect();
            let forces = out.chunks_exact(size).flat_map(|state| state[1..].iter().copied()).collect();
            Ok((batch.array(py, energies, &[])?, batch.array(py, forces, &[n, 3])?))
        })
    }
    fn __repr__(&self) -> String {
        let (n, terms) = (self.loaded.molecule.atoms.len(), self.loaded.keys.len());
        format!("<phipsi.molecule.System: {n} atoms, {terms} terms>")
    }
}
