//! Method of `TorsionModel`: freeze and thaw.

use crate::clustering::{clustering, molecule_error};
use crate::errors::exception;
use crate::torsion_model::{Start, TorsionModel, check_temperature};
use phipsi::molecule::{Clusters, Deviates, recluster, satisfied_constraints};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

#[pymethods]
impl TorsionModel {
    /// The molecule with other clusters, in its present state: freeze and thaw.
    ///
    /// Positions stay. Velocities are projected in the metric of the kinetic energy, which keeps the linear and angular momentum of
    /// every molecule: what is frozen loses its energy as in an inelastic lock, what is thawed begins at rest, or with speeds drawn
    /// at ``thaw_temperature_K``. Where a change freezes and thaws, freeze first and thaw in a second call.
    ///
    /// Parameters
    /// ----------
    /// clusters, rigid, hinges, rings, angles, forces, free : as for ``TorsionModel``.
    /// thaw_temperature_K : None, or a temperature of what is thawed.
    /// seed : of its speeds.
    ///
    /// Returns
    /// -------
    /// (TorsionModel, dict): kinetic energies ``before``, ``removed``, ``drawn`` and ``after``, kJ/mol, with after = before -
    /// removed + drawn; ``degrees_of_freedom``: (before, after).
    ///
    /// Raises
    /// ------
    /// ArgumentError; ModelError; NumericalError where the energy has no value.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    /// >>> t = phipsi.molecule.TorsionModel(s)
    /// >>> t.draw_velocities(300, seed=1)
    /// >>> frozen, ledger = t.recluster(rigid=["omega", "methyl"])
    /// >>> ledger["degrees_of_freedom"], ledger["removed"] > 0
    /// ((13, 8), True)
    /// >>> bool(np.allclose(frozen.positions, t.positions))
    /// True
    #[pyo3(signature = (clusters = None, rigid = None, hinges = None, rings = None, angles = None, forces = None, free = None, *, thaw_temperature_K = None, seed = 0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn recluster<'py>(
        &self,
        py: Python<'py>,
        clusters: Option<&Bound<'py, PyAny>>,
        rigid: Option<&Bound<'py, PyAny>>,
        hinges: Option<&Bound<'py, PyAny>>,
        rings: Option<&Bound<'py, PyAny>>,
        angles: Option<&Bound<'py, PyAny>>,
        forces: Option<&Bound<'py, PyAny>>,
        free: Option<&Bound<'py, PyAny>>,
        thaw_temperature_K: Option<f64>,
        seed: u64,
    ) -> PyResult<(TorsionModel, Bound<'py, PyDict>)> {
        let _busy = self.claim(py)?;
        if let Some(kelvin) = thaw_temperature_K {
            check_temperature(py, kelvin)?;
        }
        if self.is_native(py) != forces.is_none() {
            let message = "`forces` must be given to the model with other clusters as it was to this one";
            return Err(exception(py, "ArgumentError", message, vec![]));
        }
        let word = PyString::new(py, "torsion").into_any();
        let clustering =
            clustering(&self.loaded, clusters.unwrap_or(&word), rigid, hinges, (rings, angles), free)?;
        let (q, v) = self.q_and_v(py)?;
        let changed = py.detach(|| {
            let (t, has_velocities) = {
                let moving = self.lock();
                (moving.method.state().t, moving.has_velocities)
            };
            let mut deviates = Deviates::new(seed);
            let thaw = thaw_temperature_K.map(|kelvin| (kelvin, &mut deviates));
            let changed = recluster(&self.torsion, &q, &v, &clustering, thaw)?;
            let system = &self.loaded.molecule.system;
            let found: &Clusters = changed.torsion.clusters();
            let kept = satisfied_constraints(changed.torsion.atoms(), found, system)?;
            Ok((changed, kept, t, has_velocities))
        });
        let (changed, kept, t, has_velocities) = changed.map_err(|e| molecule_error(py, &e))?;
        let ledger = PyDict::new(py);
        let sums = &changed.ledger;
        for (key, energy) in
            [("before", sums.before), ("removed", sums.removed), ("drawn", sums.drawn), ("after", sums.after)]
        {
            ledger.set_item(key, energy)?;
        }
        let [before, after] = sums.degrees_of_freedom;
        ledger.set_item("degrees_of_freedom", (before, after))?;
        let start = Start { t, v: changed.v, has_velocities };
        let system = self.system_of(py);
        let model = Self::made(py, system.bind(py), (changed.torsion, kept), forces, start)?;
        Ok((model, ledger))
    }
}
