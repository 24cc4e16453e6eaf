//! Methods of `TorsionModel` between configurations and the positions of atoms.

use crate::batch::{Batch, array};
use crate::compiled::Names;
use crate::errors::{Field, argument_error, dynamics_error};
use crate::molecule::vectors;
use crate::simulator::check_single;
use crate::torsion_model::TorsionModel;
use numpy::PyArrayDyn;
use phipsi::spatial::Vec3;
use pyo3::prelude::*;

/// Positions that no configuration comes nearer than this (nm) are of other clusters; decimals of files are below.
const OFF: f64 = 1e-3;

#[pymethods]
impl TorsionModel {
    /// Positions of the atoms at configurations.
    ///
    /// ``q``: (…, nq). Returns (…, n_atoms, 3), nm.
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    /// >>> t = phipsi.molecule.TorsionModel(s)
    /// >>> q = t.model.neutral()
    /// >>> q[t.model.joint_q_offset("ALA2:N-CA")] = np.pi
    /// >>> t.atom_positions(q).shape, bool(np.allclose(t.atom_positions(t.model.neutral()), s.positions))
    /// ((22, 3), True)
    fn atom_positions<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.model.get().compiled();
        let mut q = compiled.q(q, "q")?;
        let (batch, n) = (Batch::of(py, [&mut q])?, self.torsion.atoms().len());
        let workspace = || (self.torsion.poses(), vec![Vec3::zero(); n]);
        let out = batch.each(py, 3 * n, workspace, |(poses, x), i, out| {
            self.torsion.positions_into(q.at(i), poses, x)?;
            out.chunks_exact_mut(3).zip(x).for_each(|(out, x)| out.copy_from_slice(&x.0));
            Ok(())
        });
        compiled.result(py, &batch, out, Names::Other("position"), &[n, 3])
    }
    /// The configuration (nq,) of positions (n_atoms, 3) of the same rigid clusters, nm.
    ///
    /// Raises ArgumentError, also where an atom would be off by more than 0.001 nm.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    /// >>> t = phipsi.molecule.TorsionModel(s)
    /// >>> bool(np.allclose(t.coordinates(s.positions + [1, 2, 3])[:3], t.model.neutral()[:3] + [1, 2, 3]))
    /// True
    fn coordinates<'py>(
        &self,
        py: Python<'py>,
        positions: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let positions = self.loaded.positions(py, Some(positions), "positions")?;
        check_single(py, &positions)?;
        let q = self.configuration(py, positions.at(0))?;
        let n = q.len();
        array(py, q, vec![n])
    }
}

impl TorsionModel {
    /// The configuration of positions.
    pub fn configuration(&self, py: Python<'_>, numbers: &[f64]) -> PyResult<Vec<f64>> {
        let mut x = vec![Vec3::zero(); self.torsion.atoms().len()];
        vectors(numbers, &mut x);
        let (q, off) = self.torsion.coordinates(&x).map_err(|e| dynamics_error(py, &e, None))?;
        if off <= OFF {
            return Ok(q);
        }
        let message = format!(
            "`positions` are not those of these rigid clusters: an atom would be off by {off:.2e} nm, and at most {OFF} nm \
             are allowed; make a new TorsionModel(s, positions) to take over their bond lengths and angles"
        );
        let required = format!("at most {OFF} nm from a configuration of the clusters");
        let remedy = Some("make a new TorsionModel(s, positions)");
        Err(argument_error(py, "positions", Field::Number(off), required.into(), &message, remedy))
    }
}
