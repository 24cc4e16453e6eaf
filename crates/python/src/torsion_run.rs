//! `TorsionModel.run`: dynamics in torsions, and its result.

use crate::batch::array;
use crate::clustering::molecule_error;
use crate::engine::Engine;
use crate::errors::{Field, argument_error, choice_error, dynamics_error};
use crate::pickle::{Reduced, item, reduced};
use crate::torsion_model::{Moving, OwnBath, TorsionModel, check_temperature};
use numpy::PyArrayDyn;
use phipsi::formats::dcd::DcdTiming;
use phipsi::formats::trajectory::{TrajectoryError, TrajectoryWriter};
use phipsi::molecule::{
    BOLTZMANN, Bath, Distribution, Ensemble, FixmanPotential, MolecularError, MoleculeError, MoleculeErrors,
    Trials, WithFixman, ensemble, temperature,
};
use phipsi::motion::MidpointError;
use phipsi::simulate::Row;
use phipsi::simulate::drift::drift;
use phipsi::spatial::Vec3;
use pyo3::exceptions::{PyOSError, PyRuntimeWarning};
use pyo3::prelude::*;
use pyo3::types::PyDict;
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
/// ``ensemble``; ``distribution``: "rigid", or "stiff limit" with Fixman's potential. ``degrees_of_freedom``: those that carry
/// ``temperature_K``. ``time_ps``: (n,). ``positions``: (n, n_atoms, 3), nm. ``potential_energy`` of the force field,
/// ``fixman_energy``, ``kinetic_energy``, ``conserved``: (n,), kJ/mol; the conserved quantity is the sum of the three, less the
/// heat that a bath has given: the extended energy of Nosé–Hoover chains. ``temperature_K``: (n,), of the kinetic energy.
/// ``drift``: slope of the conserved quantity, kJ/mol/ps, of the whole system; None for fewer than three instants.
/// ``acceptance``: fraction of accepted Monte Carlo trajectories, None without. ``refused``: trajectories that could not be
/// completed, or Langevin drifts that did not converge. ``steps``: steps made.
#[pyclass(frozen, get_all, module = "phipsi.molecule")]
pub struct Run {
    /// The ensemble.
    pub ensemble: &'static str,
    /// The distribution of configurations that is sampled.
    pub distribution: &'static str,
    /// Degrees of freedom that carry the temperature.
    pub degrees_of_freedom: usize,
    /// Times of the recorded instants, ps; (n,).
    pub time_ps: Py<PyArrayDyn<f64>>,
    /// Positions of the atoms, nm; (n, n_atoms, 3).
    pub positions: Py<PyArrayDyn<f64>>,
    /// Potential energy, kJ/mol; (n,).
    pub potential_energy: Py<PyArrayDyn<f64>>,
    /// Fixman's potential, kJ/mol; (n,), zeros without.
    pub fixman_energy: Py<PyArrayDyn<f64>>,
    /// Kinetic energy, kJ/mol; (n,).
    pub kinetic_energy: Py<PyArrayDyn<f64>>,
    /// The conserved quantity, kJ/mol; (n,).
    pub conserved: Py<PyArrayDyn<f64>>,
    /// Temperature of the kinetic energy in all degrees of freedom, K; (n,).
    #[pyo3(name = "temperature_K")]
    pub temperature: Py<PyArrayDyn<f64>>,
    /// Slope of the conserved quantity, kJ/mol/ps.
    pub drift: Option<f64>,
    /// Fraction of accepted Monte Carlo trajectories.
    pub acceptance: Option<f64>,
    /// Refused trajectories or drifts.
    pub refused: u64,
    /// Steps made.
    pub steps: u64,
}

// Defaults of `run`, which Python shows only as numbers.
const _: () = assert!(ensemble::FRICTION == 1.0 && ensemble::RELAXATION == 0.1);

#[pymethods]
impl Run {
    /// The result again, in another process.
    #[staticmethod]
    fn _restore(state: &Bound<'_, PyDict>) -> PyResult<Run> {
        let word: String = item(state, "ensemble")?;
        let ensemble = Ensemble::WORDS.into_iter().find(|w| *w == word).unwrap_or_default();
        let word: String = item(state, "distribution")?;
        let fixman = word == Distribution::with_fixman(true).word();
        Ok(Run {
            ensemble,
            distribution: Distribution::with_fixman(fixman).word(),
            degrees_of_freedom: item(state, "degrees_of_freedom")?,
            time_ps: item(state, "time_ps")?,
            positions: item(state, "positions")?,
            potential_energy: item(state, "potential_energy")?,
            fixman_energy: item(state, "fixman_energy")?,
            kinetic_energy: item(state, "kinetic_energy")?,
            conserved: item(state, "conserved")?,
            temperature: item(state, "temperature_K")?,
            drift: item(state, "drift")?,
            acceptance: item(state, "acceptance")?,
            refused: item(state, "refused")?,
            steps: item(state, "steps")?,
        })
    }
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        reduced(
            slf.as_any(),
            &[
                "ensemble",
                "distribution",
                "degrees_of_freedom",
                "time_ps",
                "positions",
                "potential_energy",
                "fixman_energy",
                "kinetic_energy",
                "conserved",
                "temperature_K",
                "drift",
                "acceptance",
                "refused",
                "steps",
            ],
        )
    }
    fn __repr__(&self) -> String {
        let drift = self.drift.map_or("None".into(), |d| format!("{d:.1e}"));
        let Run { ensemble, distribution, degrees_of_freedom, steps, .. } = self;
        format!(
            "<phipsi.molecule.Run: {ensemble}, {distribution} distribution, {degrees_of_freedom} degrees of freedom, {steps} \
             steps, drift {drift} kJ/mol/ps>"
        )
    }
}

/// Why a run stopped.
enum Stop {
    Step(MidpointError<MolecularError>),
    Dynamics(phipsi::recursion::DynamicsError),
    Bath(MoleculeError),
    File(TrajectoryError),
    /// The user's forces raised an exception.
    Raised(PyErr),
}

/// What a run is to do.
struct Order {
    steps: u64,
    every: u64,
    h: f64,
    ensemble: Ensemble,
    kelvin: f64,
    seed: u64,
}

/// What has been recorded.
struct Records {
    rows: Vec<Row>,
    fixman: Option<FixmanPotential>,
    fixman_energies: Vec<f64>,
    positions: Vec<f64>,
    atoms: Vec<Vec3<f64>>,
    file: Option<TrajectoryWriter>,
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
        let mut own = 0.0;
        if let Some(fixman) = &mut self.fixman {
            let mut forces = vec![0.0; state.p.len()];
            own = fixman.evaluate(&state.q, &mut forces).map_err(Stop::Dynamics)?;
        }
        self.fixman_energies.push(own);
        let energy = [kinetic, state.potential, moving.bath.as_ref().map_or(0.0, |b| b.bath.heat())];
        let (q, v, outputs, terms) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        self.rows.push(Row { t, q, v, energy, momentum: [0.0; 6], outputs, terms });
        Ok(())
    }
    fn result(
        self,
        py: Python<'_>,
        model: &TorsionModel,
        order: &Order,
        steps: u64,
        before: Trials,
    ) -> PyResult<Run> {
        let (freedom, trials) = py.detach(|| {
            let moving = model.lock();
            let bath = moving.bath.as_ref().map(|b| &b.bath);
            let freedom = bath.map_or(model.torsion.degrees_of_freedom(), |b| b.degrees_of_freedom());
            (freedom, bath.map_or(before, |b| *b.trials()))
        });
        let (n, atoms) = (self.rows.len(), self.atoms.len());
        let made = trials.made - before.made;
        let potential = self.rows.iter().zip(&self.fixman_energies).map(|(r, own)| r.energy[1] - own);
        let column = |of: &dyn Fn(&Row) -> f64| -> PyResult<Py<PyArrayDyn<f64>>> {
            Ok(array(py, self.rows.iter().map(of).collect(), vec![n])?.unbind())
        };
        Ok(Run {
            ensemble: order.ensemble.word(),
            distribution: Distribution::with_fixman(self.fixman.is_some()).word(),
            degrees_of_freedom: freedom,
            time_ps: column(&|r| r.t)?,
            potential_energy: array(py, potential.collect(), vec![n])?.unbind(),
            fixman_energy: array(py, self.fixman_energies.clone(), vec![n])?.unbind(),
            kinetic_energy: column(&|r| r.energy[0])?,
            conserved: column(&|r| r.energy[0] + r.energy[1] - r.energy[2])?,
            temperature: column(&|r| temperature(r.energy[0], freedom))?,
            drift: drift(&self.rows).map(|d| d.slope),
            acceptance: (made > 0).then(|| (trials.accepted - before.accepted) as f64 / made as f64),
            refused: trials.refused - before.refused,
            steps,
            positions: array(py, self.positions, vec![n, atoms, 3])?.unbind(),
        })
    }
}

#[pymethods]
impl TorsionModel {
    /// Dynamics in torsions from the present state: the symplectic, time-reversible midpoint method with a fixed step, at constant
    /// energy or in a heat bath.
    ///
    /// Velocities are drawn at ``temperature_K`` where the model has none: when it is new, minimised or placed anew. A run in
    /// two calls with the same arguments is the same as in one. A start with an atom that is pushed hard, see ``strain``, gives
    /// a RuntimeWarning.
    ///
    /// What is sampled: without ``fixman`` the rigid model's distribution sqrt(det M) exp(-U/kT), with it exp(-U/kT), that of
    /// the molecule with stiff bonds and angles. "hmc" is exact at any step, "langevin" and "nose_hoover" up to the second order
    /// of the step. "nose_hoover" removes the momentum of the whole system and has three degrees of freedom less.
    ///
    /// Parameters
    /// ----------
    /// steps : how many.
    /// dt_fs : step, fs; 4 is cautious for all torsions, heavier rotors bear more.
    /// ensemble : "nve", constant energy; "langevin", friction and noise in the metric of the mass matrix (OBABO);
    ///     "nose_hoover", chains of three thermostats; "hmc", hybrid Monte Carlo.
    /// temperature_K : of the bath, and of the velocities that are drawn.
    /// friction_per_ps : of "langevin".
    /// seed : of all random numbers.
    /// fixman : adds Fixman's potential 1/2 kT ln det M at ``temperature_K`` to forces and energy.
    /// trajectory : a file for the positions at the recorded instants, XTC if its name ends in .xtc and else DCD; one of this name
    ///     is replaced.
    /// every : steps from one recorded instant to the next; None: such that about a thousand are recorded. Of "hmc" whole
    ///     trajectories: rounded up.
    /// relaxation_ps : of "nose_hoover".
    /// trajectory_steps : steps of a trajectory of "hmc"; None: 50 fs.
    /// inner_steps : steps with bonds, angles and torsions in one of dt_fs, which pairs (1-4 pairs included) take; more than 1: multiple
    ///     time steps, of second order and reversible, with one evaluation of pairs for each dt_fs. Collisions, which are pairs, set
    ///     the step of torsions: the noise of the energy of alanine dipeptide was at most 2.4 times smaller, that of met-enkephalin hardly.
    ///
    /// Returns
    /// -------
    /// Run with ensemble, distribution, degrees_of_freedom, time_ps, positions, potential_energy, fixman_energy, kinetic_energy,
    /// conserved, temperature_K, drift, acceptance, refused; the start is the first instant.
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
    /// >>> r = t.run(100, dt_fs=10, ensemble="hmc", temperature_K=300, seed=1, fixman=True)
    /// >>> r.distribution, r.degrees_of_freedom, r.acceptance > 0.8
    /// ('stiff limit', 13, True)
    #[pyo3(signature = (steps, dt_fs, ensemble = "nve", temperature_K = 300.0, friction_per_ps = 1.0, seed = 0,
        fixman = false, trajectory = None, *, every = None, relaxation_ps = 0.1, trajectory_steps = None, inner_steps = 1))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn run(
        &self,
        py: Python<'_>,
        steps: u64,
        dt_fs: f64,
        ensemble: &str,
        temperature_K: f64,
        friction_per_ps: f64,
        seed: u64,
        fixman: bool,
        trajectory: Option<PathBuf>,
        every: Option<u64>,
        relaxation_ps: f64,
        trajectory_steps: Option<u64>,
        inner_steps: u64,
    ) -> PyResult<Run> {
        positive(py, "dt_fs", dt_fs)?;
        let inner_steps = self.inner_steps(py, inner_steps)?;
        let h = dt_fs * 1e-3;
        let ensemble = match ensemble {
            "nve" => Ensemble::ConstantEnergy,
            "langevin" => {
                not_negative(py, "friction_per_ps", friction_per_ps)?;
                Ensemble::Langevin { friction: friction_per_ps }
            }
            "nose_hoover" => {
                positive(py, "relaxation_ps", relaxation_ps)?;
                Ensemble::NoseHoover { relaxation: relaxation_ps }
            }
            "hmc" => {
                let steps = trajectory_steps.unwrap_or((ensemble::TRAJECTORY / h).round().max(1.0) as u64);
                at_least_one(py, "trajectory_steps", steps)?;
                Ensemble::HybridMonteCarlo { steps }
            }
            _ => return Err(choice_error(py, "ensemble", ensemble, &Ensemble::WORDS)),
        };
        if ensemble == Ensemble::ConstantEnergy && !fixman {
            check_temperature(py, temperature_K)?;
        } else {
            positive(py, "temperature_K", temperature_K)?;
        }
        let every = every.unwrap_or(steps.div_ceil(RECORDS).max(1));
        at_least_one(py, "every", every)?;
        let every = every.div_ceil(ensemble.stride()).saturating_mul(ensemble.stride());
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
        let file = trajectory.map(|path| create(&path, atoms, every, h)).transpose()?;
        let capacity = (steps / every + 1) as usize;
        let potential = fixman
            .then(|| FixmanPotential::of(&self.torsion, BOLTZMANN * temperature_K))
            .transpose()
            .map_err(|error| molecule_error(py, &MoleculeErrors(vec![error])))?;
        let mut records = Records {
            rows: Vec::with_capacity(capacity),
            fixman: potential,
            fixman_energies: Vec::with_capacity(capacity),
            positions: Vec::with_capacity(3 * atoms * capacity),
            atoms: vec![Vec3::zero(); atoms],
            file,
        };
        let order = Order { steps, every, h, ensemble, kelvin: temperature_K, seed };
        let (mut done, mut before) = (0, Trials::default());
        let is_split = inner_steps > 1;
        if is_split {
            py.detach(|| self.lock().split(&self.torsion, &self.loaded, inner_steps));
        }
        let stopped = self.advance(py, &order, &mut records, &mut done, &mut before);
        if fixman || is_split {
            // What the model keeps is without Fixman's potential and in one part; at a state that had forces there are some.
            let refreshed = py.detach(|| {
                let mut moving = self.lock();
                if is_split {
                    moving.join(&self.torsion, &self.loaded);
                }
                let Moving { forces, method, stale, .. } = &mut *moving;
                let refreshed = method.refresh(forces);
                *stale = refreshed.is_err();
                refreshed
            });
            // After an exception of the user's forces the next run tries again.
            if let (Err(e), Ok(None)) = (refreshed, &stopped) {
                return Err(self.step_error(py, &e));
            }
            self.raised();
        }
        let Some(stop) = stopped? else { return records.result(py, self, &order, done, before) };
        let is_raised = matches!(stop, Stop::Raised(_));
        let error = match stop {
            Stop::Raised(e) => e,
            Stop::Step(e) => self.step_error(py, &e),
            Stop::Dynamics(e) => dynamics_error(py, &e, None),
            Stop::Bath(e) => {
                let required = e.required.clone();
                argument_error(
                    py,
                    "ensemble",
                    Field::Text(e.found.clone()),
                    required.into(),
                    &e.to_string(),
                    None,
                )
            }
            Stop::File(e) => return Err(PyOSError::new_err(e.to_string())),
        };
        if is_raised || error.get_type(py).name()? == "NumericalError" {
            let so_far = records.result(py, self, &order, done, before)?;
            let time = py.detach(|| self.lock().method.state().t);
            let value = error.value(py);
            let told = value.setattr("time", time).and_then(|()| value.setattr("trajectory", so_far));
            // An exception of the user's may have no place for them.
            if !is_raised {
                told?;
            }
        }
        Err(error)
    }
}

fn positive(py: Python<'_>, argument: &str, x: f64) -> PyResult<()> {
    if x > 0.0 && x.is_finite() {
        return Ok(());
    }
    let message = format!("`{argument}` is {x}, but a positive finite number is required");
    Err(argument_error(py, argument, Field::Number(x), "a positive finite number".into(), &message, None))
}

fn not_negative(py: Python<'_>, argument: &str, x: f64) -> PyResult<()> {
    if x >= 0.0 && x.is_finite() {
        return Ok(());
    }
    let message = format!("`{argument}` is {x}, but a finite number of at least 0 is required");
    let required = "a finite number, at least 0".into();
    Err(argument_error(py, argument, Field::Number(x), required, &message, None))
}

fn at_least_one(py: Python<'_>, argument: &str, n: u64) -> PyResult<()> {
    if n > 0 {
        return Ok(());
    }
    let message = format!("`{argument}` is 0, but at least 1 is required");
    Err(argument_error(py, argument, Field::Index(0), "at least 1".into(), &message, None))
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
    /// `before`: trajectories before the run.
    fn advance(
        &self,
        py: Python<'_>,
        order: &Order,
        records: &mut Records,
        done: &mut u64,
        before: &mut Trials,
    ) -> PyResult<Option<Stop>> {
        let Order { steps, every, h, .. } = *order;
        let begun = py.detach(|| {
            let mut moving = self.lock();
            moving.begin(&self.torsion, order, records.fixman.as_mut())?;
            *before = moving.bath.as_ref().map_or(*before, |b| *b.bath.trials());
            let start = moving.method.state().t;
            records.take(self, &mut moving, start).map(|()| start)
        });
        let start = match begun {
            Ok(start) => start,
            Err(stop) => return Ok(Some(self.raised().map_or(stop, Stop::Raised))),
        };
        while *done < steps {
            py.check_signals()?;
            let advanced = py.detach(|| {
                let (mut moving, looked) = (self.lock_last(), Instant::now());
                while *done < steps && looked.elapsed() < PATIENCE {
                    let Moving { forces, method, bath, .. } = &mut *moving;
                    // Monte Carlo and Langevin dynamics go on where there are no forces: not after an exception.
                    let saved = matches!(forces.potential(), Engine::Python(_))
                        .then(|| (method.state().clone(), bath.as_ref().map(|b| b.bath.state())));
                    let mut system = WithFixman { inner: forces, fixman: records.fixman.as_mut() };
                    let advanced = match bath {
                        Some(b) => b.bath.advance(method, &mut system, h, steps - *done),
                        None => method.step(&mut system, h).map(|_| 1),
                    };
                    if let (Some(raised), Some((state, of_bath))) = (self.raised(), saved) {
                        method.reset(&state).map_err(Stop::Dynamics)?;
                        if let (Some(b), Some(state)) = (bath, of_bath) {
                            b.bath.restore(&state);
                        }
                        return Err(Stop::Raised(raised));
                    }
                    *done += advanced.map_err(Stop::Step)?;
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

impl Moving {
    /// Velocities where there are none, the bath, and Fixman's forces.
    fn begin(
        &mut self,
        torsion: &phipsi::molecule::TorsionModel,
        order: &Order,
        fixman: Option<&mut FixmanPotential>,
    ) -> Result<(), Stop> {
        let Order { ensemble, kelvin, seed, .. } = *order;
        if !self.has_velocities {
            self.draw(torsion, kelvin, seed).map_err(Stop::Dynamics)?;
        }
        let asked = (ensemble, kelvin, seed);
        if ensemble == Ensemble::ConstantEnergy {
            self.bath = None;
        } else if self.bath.as_ref().is_none_or(|b| b.asked != asked) {
            let bath = Bath::new(&mut self.method, ensemble, BOLTZMANN * kelvin, seed).map_err(Stop::Bath)?;
            self.bath = Some(OwnBath { asked, bath });
        }
        if fixman.is_some() || self.stale {
            let mut system = WithFixman { inner: &mut self.forces, fixman };
            self.method.refresh(&mut system).map_err(Stop::Step)?;
            self.stale = false;
        }
        Ok(())
    }
}

fn create(path: &Path, atoms: usize, every: u64, h: f64) -> PyResult<TrajectoryWriter> {
    let interval = i32::try_from(every).unwrap_or(i32::MAX);
    let timing = DcdTiming { first_step: 0, interval, dt_ps: h };
    TrajectoryWriter::create(path, atoms, timing).map_err(|e| PyOSError::new_err(e.to_string()))
}
