//! Methods of `TorsionModel`: minimisation, and what is wrong with positions.

use crate::errors::{Field, argument_error};
use crate::torsion_model::TorsionModel;
use phipsi::molecule::{MinimizeOptions, minimize, strain};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;

/// Where a minimisation ended.
///
/// ``energy``: kJ/mol. ``largest_force``: of all generalized forces, kJ/mol/rad or kJ/mol/nm, at ``joint``. ``evaluations``:
/// of the force field. ``converged``: the force is as small as was asked for. ``strain``: what was wrong with the start, None
/// unless an atom felt more than 1e5 kJ/mol/nm.
#[pyclass(frozen, get_all, module = "phipsi.molecule")]
pub struct Minimum {
    /// Energy of the minimum, kJ/mol.
    pub energy: f64,
    /// Largest generalized force, kJ/mol/rad or kJ/mol/nm.
    pub largest_force: f64,
    /// The joint with that force.
    pub joint: String,
    /// Evaluations of the force field.
    pub evaluations: usize,
    /// The force is as small as was asked for.
    pub converged: bool,
    /// What was wrong with the start.
    pub strain: Option<String>,
}

#[pymethods]
impl Minimum {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let Minimum { energy, largest_force, evaluations, .. } = self;
        let converged = self.converged.into_bound_py_any(py)?;
        Ok(format!(
            "Minimum(energy={energy:.6}, largest_force={largest_force:.1e}, evaluations={evaluations}, \
             converged={converged})"
        ))
    }
}

#[pymethods]
impl TorsionModel {
    /// What is wrong with the present positions: text where an atom feels more than 1e5 kJ/mol/nm, otherwise None.
    #[getter]
    fn strain(&self, py: Python<'_>) -> PyResult<Option<String>> {
        let _busy = self.claim(py)?;
        self.present_strain(py)
    }
    /// Minimises the energy over torsions, and over positions and orientations of molecules, from the present state.
    ///
    /// The velocities are then forgotten: the next run draws them.
    ///
    /// Parameters
    /// ----------
    /// largest_force : of all generalized forces at the end, kJ/mol/rad and kJ/mol/nm.
    /// evaluations : at most so many of the force field.
    ///
    /// Returns
    /// -------
    /// Minimum with energy, largest_force, joint, evaluations, converged, strain.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError where the energy has no value.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    /// >>> t = phipsi.molecule.TorsionModel(s)
    /// >>> m = t.minimize()
    /// >>> m.converged, bool(m.energy < s.energy()["total"])
    /// (True, True)
    #[pyo3(signature = (largest_force = 0.01, evaluations = 10000))]
    fn minimize(&self, py: Python<'_>, largest_force: f64, evaluations: usize) -> PyResult<Minimum> {
        let _busy = self.claim(py)?;
        if !(largest_force >= 0.0 && largest_force.is_finite()) {
            let message =
                format!("`largest_force` is {largest_force}, but a finite number of at least 0 is required");
            let (found, required) = (Field::Number(largest_force), "a finite number, at least 0".into());
            return Err(argument_error(py, "largest_force", found, required, &message, None));
        }
        let options = MinimizeOptions { largest_force, evaluations, ..MinimizeOptions::default() };
        let found = py.detach(|| {
            let mut moving = self.lock();
            let q = moving.method.state().q.clone();
            minimize(&mut moving.forces, &q, &options)
        });
        let (minimum, strain) = found.map_err(|e| self.molecular_error(py, &e))?;
        // A line search takes forces without a value for a step too far.
        if let Some(raised) = self.raised() {
            return Err(raised);
        }
        self.place(py, &minimum.q, &vec![0.0; self.torsion.model().nv()], false)?;
        Ok(Minimum {
            energy: minimum.energy,
            largest_force: minimum.largest_force,
            joint: minimum.joint,
            evaluations: minimum.evaluations,
            converged: minimum.converged,
            strain: strain.map(|s| s.to_string()),
        })
    }
}

impl TorsionModel {
    /// What is wrong with the present positions; the state has been claimed.
    pub fn present_strain(&self, py: Python<'_>) -> PyResult<Option<String>> {
        let found = py.detach(|| {
            let mut moving = self.lock();
            let q = moving.method.state().q.clone();
            strain(&mut moving.forces, &q)
        });
        Ok(found.map_err(|e| self.molecular_error(py, &e))?.map(|s| s.to_string()))
    }
}
