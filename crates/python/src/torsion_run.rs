//! `TorsionModel.run`: dynamics in torsions, and its result.

use crate::batch::array;
use crate::errors::{Field, argument_error, choice_error, dynamics_error};
use crate::torsion_model::{Moving, TorsionModel, check_temperature};
use numpy::PyArrayDyn;
use phipsi::formats::dcd::{DcdError, DcdTiming, DcdWriter};
use phipsi::molecule::{MolecularError, temperature};
use phipsi::motion::MidpointError;
use phipsi::simulate::Row;
use phipsi::simulate::drift::drift;
use phipsi::spatial::Vec3;
use pyo3::exceptions::{PyOSError, PyRuntimeWarning};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Recorded instants where `every` is not given.
const RECORDS: u64 = 1000;

/// Most numbers that a result may hold: 16 GiB.
const LARGEST: f64 = 2.0 * (1u64 << 30) as f64;

/// Wall time between two looks at signals.
const PATIENCE: Duration = Duration::from_millis(50);

/// Dynamics at n recorded instants.
///
/// ``time_ps``: (n,). ``positions``: (n, n_atoms, 3), nm. ``potential_energy``, ``kinetic_energy``, ``conserved``: (n,), kJ/mol;
/// in the ensemble "nve" the conserved quantity is the energy. ``temperature_K``: (n,), of the kinetic energy in all degrees of
/// freedom. ``drift``: slope of the conserved quantity, kJ/mol/ps, of the whole system; None for fewer than three instants.
/// ``acceptance``: of Monte Carlo steps, None without. ``steps``: steps made.
#[pyclass(frozen, get_all, module = "phipsi.molecule")]
pub struct Run {
    /// Times of the recorded instants, ps; (n,).
    pub time_ps: Py<PyArrayDyn<f64>>,
    /// Positions of the atoms, nm; (n, n_atoms, 3).
    pub positions: Py<PyArrayDyn<f64>>,
    /// Potential energy, kJ/mol; (n,).
    pub potential_energy: Py<PyArrayDyn<f64>>,
    /// Kinetic energy, kJ/mol; (n,).
    pub kinetic_energy: Py<PyArrayDyn<f64>>,
    /// The conserved quantity, kJ/mol; (n,).
    pub conserved: Py<PyArrayDyn<f64>>,
    /// Temperature of the kinetic energy in all degrees of freedom, K; (n,).
    #[pyo3(name = "temperature_K")]
    pub temperature: Py<PyArrayDyn<f64>>,
    /// Slope of the conserved quantity, kJ/mol/ps.
    pub drift: Option<f64>,
    /// Fraction of accepted Monte Carlo steps.
    pub acceptance: Option<f64>,
    /// Steps made.
    pub steps: u64,
}

#[pymethods]
impl Run {
    fn __repr__(&self) -> String {
        let drift = self.drift.map_or("None".into(), |d| format!("{d:.1e}"));
        format!("<phipsi.molecule.Run: {} steps, drift {drift} kJ/mol/ps>", self.steps)
    }
}

/// Why a run stopped.
enum Stop {
    Step(MidpointError<MolecularError>),
    Dynamics(phipsi::recursion::DynamicsError),
    File(DcdError),
}

/// What has been recorded.
struct Records {
    rows: Vec<Row>,
    positions: Vec<f64>,
    atoms: Vec<Vec3<f64>>,
    file: Option<DcdWriter>,
}

impl Records {
    fn take(&mut self, model: &TorsionModel, moving: &mut Moving, t: f64) -> Result<(), Stop> {
        let kinetic = moving.method.kinetic_energy().map_err(Stop::Dynamics)?;
        let state = moving.method.state();
        let mut poses = model.torsion.poses();
        model.torsion.positions_into(&state.q, &mut poses, &mut self.atoms).map_err(Stop::Dynamics)?;
        if let Some(file) = &mut self.file {
            let positions: Vec<[f64; 3]> = self.atoms.iter().map(|x| x.0).collect();
            file.write(&positions).map_err(Stop::File)?;
        }
        self.positions.extend(self.atoms.iter().flat_map(|x| x.0));
        let energy = [kinetic, state.potential, 0.0];
        let (q, v, outputs, terms) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        self.rows.push(Row { t, q, v, energy, momentum: [0.0; 6], outputs, terms });
        Ok(())
    }
    fn result(self, py: Python<'_>, model: &TorsionModel, steps: u64) -> PyResult<Run> {
        let (n, atoms, freedom) = (self.rows.len(), self.atoms.len(), model.torsion.degrees_of_freedom());
        let column = |of: &dyn Fn(&Row) -> f64| -> PyResult<Py<PyArrayDyn<f64>>> {
            Ok(array(py, self.rows.iter().map(of).collect(), vec![n])?.unbind())
        };
        Ok(Run {
            time_ps: column(&|r| r.t)?,
            potential_energy: column(&|r| r.energy[1])?,
            kinetic_energy: column(&|r| r.energy[0])?,
            conserved: column(&|r| r.energy[0] + r.energy[1])?,
            temperature: column(&|r| temperature(r.energy[0], freedom))?,
            drift: drift(&self.rows).map(|d| d.slope),
            acceptance: None,
            steps,
            positions: array(py, self.positions, vec![n, atoms, 3])?.unbind(),
        })
    }
}

#[pymethods]
impl TorsionModel {
    /// Dynamics in torsions from the present state: the symplectic, time-reversible midpoint method with a fixed step.
    ///
    /// Velocities are drawn at ``temperature_K`` where the model has none: when it is new, minimised or placed anew. A run in
    /// two calls is the same as in one. A start with an atom that is pushed hard, see ``strain``, gives a RuntimeWarning.
    ///
    /// Parameters
    /// ----------
    /// steps : how many.
    /// dt_fs : step, fs; 4 is cautious for all torsions, heavier rotors bear more.
    /// ensemble : "nve", constant energy.
    /// temperature_K, seed : of the velocities that are drawn.
    /// every : steps from one recorded instant to the next; None: such that about a thousand are recorded.
    /// trajectory : a DCD file for the positions at the recorded instants; one of this name is replaced.
    ///
    /// Returns
    /// -------
    /// Run with time_ps, positions, potential_energy, kinetic_energy, conserved, temperature_K, drift; the start is the first
    /// instant.
    ///
    /// Raises
    /// ------
    /// ArgumentError; OSError for the trajectory; NumericalError, with ``time`` and the Run so far as ``trajectory``, where no
    /// step can be made: the model then has the last good state.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    /// >>> t = phipsi.molecule.TorsionModel(s)
    /// >>> r = t.run(100, dt_fs=2, temperature_K=300, seed=1, every=10, trajectory="run.dcd")
    /// >>> r.positions.shape, bool(np.ptp(r.conserved) < 0.5)
    /// ((11, 22, 3), True)
    #[pyo3(signature = (steps, dt_fs, ensemble = "nve", temperature_K = 300.0, seed = 0, every = None, trajectory = None))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn run(
        &self,
        py: Python<'_>,
        steps: u64,
        dt_fs: f64,
        ensemble: &str,
        temperature_K: f64,
        seed: u64,
        every: Option<u64>,
        trajectory: Option<PathBuf>,
    ) -> PyResult<Run> {
        if ensemble != "nve" {
            return Err(choice_error(py, "ensemble", ensemble, &["nve"]));
        }
        if !(dt_fs > 0.0 && dt_fs.is_finite()) {
            let message = format!("`dt_fs` is {dt_fs}, but a positive finite number is required");
            let required = "a positive finite number".into();
            return Err(argument_error(py, "dt_fs", Field::Number(dt_fs), required, &message, None));
        }
        check_temperature(py, temperature_K)?;
        let every = every.unwrap_or(steps.div_ceil(RECORDS).max(1));
        if every == 0 {
            let message = "`every` is 0, but at least 1 is required";
            return Err(argument_error(py, "every", Field::Index(0), "at least 1".into(), message, None));
        }
        let atoms = self.torsion.atoms().len();
        let numbers = (steps / every + 1) as f64 * (3 * atoms + 12) as f64;
        if numbers > LARGEST {
            let message = format!("`every` is {every}: the result would hold {numbers:e} numbers");
            let required = format!("at most {LARGEST:e} numbers");
            let (found, remedy) = (Field::Number(every as f64), Some("give a larger one"));
            return Err(argument_error(py, "every", found, required.into(), &message, remedy));
        }
        let _busy = self.claim(py)?;
        self.warn(py)?;
        let h = dt_fs * 1e-3;
        let file = trajectory.map(|path| create(&path, atoms, every, h)).transpose()?;
        let capacity = (steps / every + 1) as usize;
        let mut records = Records {
            rows: Vec::with_capacity(capacity),
            positions: Vec::with_capacity(3 * atoms * capacity),
            atoms: vec![Vec3::zero(); atoms],
            file,
        };
        let mut done = 0;
        let stopped = self.advance(py, steps, every, h, (temperature_K, seed), &mut records, &mut done)?;
        let Some(stop) = stopped else { return records.result(py, self, done) };
        let error = match &stop {
            Stop::Step(e) => self.step_error(py, e),
            Stop::Dynamics(e) => dynamics_error(py, e, None),
            Stop::File(e) => return Err(PyOSError::new_err(e.to_string())),
        };
        if error.get_type(py).name()? == "NumericalError" {
            let so_far = records.result(py, self, done)?;
            let time = py.detach(|| self.lock().method.state().t);
            error.value(py).setattr("time", time)?;
            error.value(py).setattr("trajectory", so_far)?;
        }
        Err(error)
    }
}

impl TorsionModel {
    /// Warns of a strained start, where velocities are still to be drawn.
    fn warn(&self, py: Python<'_>) -> PyResult<()> {
        if py.detach(|| self.lock().has_velocities) {
            return Ok(());
        }
        let Some(strain) = self.present_strain(py)? else { return Ok(()) };
        let message = std::ffi::CString::new(strain).unwrap_or_default();
        PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &message, 1)
    }
    /// All steps, from drawing velocities on; why the run stopped before its end, and by an exception what signals raised.
    #[allow(clippy::too_many_arguments)]
    fn advance(
        &self,
        py: Python<'_>,
        steps: u64,
        every: u64,
        h: f64,
        (kelvin, seed): (f64, u64),
        records: &mut Records,
        done: &mut u64,
    ) -> PyResult<Option<Stop>> {
        let begun = py.detach(|| {
            let mut moving = self.lock();
            if !moving.has_velocities {
                moving.draw(&self.torsion, kelvin, seed).map_err(Stop::Dynamics)?;
            }
            let start = moving.method.state().t;
            records.take(self, &mut moving, start).map(|()| start)
        });
        let start = match begun {
            Ok(start) => start,
            Err(stop) => return Ok(Some(stop)),
        };
        while *done < steps {
            py.check_signals()?;
            let advanced = py.detach(|| {
                let (mut moving, looked) = (self.lock_last(), Instant::now());
                while *done < steps && looked.elapsed() < PATIENCE {
                    let Moving { forces, method, .. } = &mut *moving;
                    method.step(forces, h).map_err(Stop::Step)?;
                    *done += 1;
                    if done.is_multiple_of(every) {
                        records.take(self, &mut moving, start + *done as f64 * h)?;
                    }
                }
                Ok(())
            });
            if let Err(stop) = advanced {
                return Ok(Some(stop));
            }
        }
        Ok(None)
    }
}

fn create(path: &Path, atoms: usize, every: u64, h: f64) -> PyResult<DcdWriter> {
    let interval = i32::try_from(every).unwrap_or(i32::MAX);
    let timing = DcdTiming { first_step: 0, interval, dt_ps: h };
    DcdWriter::create(path, atoms, timing).map_err(|e| PyOSError::new_err(e.to_string()))
}
