//! The class `TorsionModel`: rigid clusters and torsions of a `System`, with a state that is minimised and run.

use crate::batch::array;
use crate::clustering::{clustering, molecule_error, report};
use crate::engine::{Callback, Engine, TERM};
use crate::errors::{Field, argument_error, dynamics_error, exception, potential_error};
use crate::model::Model;
use crate::molecule::{Loaded, System, TOTAL, rows, vectors};
use crate::simulator::check_single;
use numpy::PyArrayDyn;
use phipsi::molecule::torsion_model::TorsionModel as Torsion;
use phipsi::molecule::{
    Bath, Clusters, Deviates, Ensemble, MolecularError, MolecularForces, draw_momenta, satisfied_constraints,
};
use phipsi::motion::{Midpoint, MidpointError};
use phipsi::recursion::articulated_sweep::SolveWorkspace;
use phipsi::spatial::Vec3;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// What moves.
pub struct Moving {
    /// The forces on the clusters.
    pub forces: MolecularForces<Engine>,
    /// Configuration and momenta.
    pub method: Midpoint,
    /// Momenta were drawn or set; otherwise a run draws them.
    pub has_velocities: bool,
    /// The forces that the method keeps are not those of the model alone: a run with Fixman's potential could not end.
    pub stale: bool,
    /// The heat bath of the last run, which one with the same arguments goes on with.
    pub bath: Option<OwnBath>,
}

/// A bath and the ensemble, temperature (K) and seed that it was made for.
pub struct OwnBath {
    /// What was asked for.
    pub asked: (Ensemble, f64, u64),
    /// The bath.
    pub bath: Bath,
}

/// A molecule as rigid clusters that turn about bonds, and its present state.
///
/// The clusters keep the bond lengths and angles of the given positions. ``model`` is an ordinary Model in nm, ps and Da: every
/// method of it applies. The model keeps its state: ``minimize`` and ``run`` go on from where the last call ended.
///
/// Parameters
/// ----------
/// s : a System.
/// positions : (n_atoms, 3), nm; None: those of the file.
/// clusters : "torsion" or None: every bond outside rings with more than one atom on either side is a hinge; "torsion+angle": the
///     bond angle before each hinge is open too; "cartesian": every atom by itself; or lists of atoms, one for each cluster.
/// rigid : kinds of bonds that stay rigid ("omega", "planar", "methyl", "backbone_phi", "backbone_psi", "chi"), and lists of
///     atoms that move as one body. Atoms are indices or names such as "ALA2:CA".
/// hinges : the bonds that are hinges, pairs of atoms, in place of all rotatable ones.
/// rings : "rigid" or None; "flexible": rings that are not aromatic turn about their bonds and are closed at one of them; or lists
///     of atoms whose rings do.
/// angles : bond angles that are open, triples of atoms h, i, j: the hinge i-j bends against h-i.
/// forces : what gives energy and forces in place of the System's terms: a function forces(positions) -> (energy, forces) of
///     (n_atoms, 3), nm, in kJ/mol and kJ/mol/nm, or an openmm.Context of the same particles. Called once a step. What it raises
///     comes out as it is; the model then has its last good state.
/// free : atoms that move as points of three degrees of freedom, tied to others by forces only; "water": those of all molecules of
///     water, which are rigid otherwise. Constraints of the System at such atoms are refused.
///
/// Raises
/// ------
/// ArgumentError; ModelError for hinges in rings and for atoms that are all in one place; NumericalError where the energy has no value.
///
/// Example
/// -------
/// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
/// >>> t = phipsi.molecule.TorsionModel(s, rigid=["omega"])
/// >>> t
/// <phipsi.molecule.TorsionModel: 22 atoms in 6 clusters, 11 degrees of freedom>
/// >>> t.model.nv
/// 11
/// >>> u = phipsi.molecule.TorsionModel(s, forces=lambda x: (0.0, np.zeros_like(x)))
/// >>> u.energy()
/// {'forces': 0.0, 'total': 0.0}
#[pyclass(frozen, module = "phipsi.molecule")]
pub struct TorsionModel {
    pub(crate) loaded: Arc<Loaded>,
    pub(crate) torsion: Arc<Torsion>,
    system: Py<System>,
    pub model: Py<Model>,
    /// In a box: what it holds may be aligned, and Python's objects are not.
    moving: Box<Mutex<Moving>>,
    callback: Callback,
    /// Calls that wait for the state: a mutex alone would let a run take it again and again.
    waiting: AtomicUsize,
    busy: AtomicBool,
}

/// Time and velocities that a model begins with.
pub struct Start {
    /// ps.
    pub t: f64,
    /// nv.
    pub v: Vec<f64>,
    /// Otherwise a run draws them.
    pub has_velocities: bool,
}

/// Keeps a second thread from running the same molecule.
pub struct Busy<'a>(&'a AtomicBool);

impl Drop for Busy<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Release);
    }
}

impl TorsionModel {
    /// The System.
    pub fn system_of(&self, py: Python<'_>) -> Py<System> {
        self.system.clone_ref(py)
    }
    /// True if forces are those of the System's own terms.
    pub fn is_native(&self, py: Python<'_>) -> bool {
        py.detach(|| matches!(self.lock().forces.potential(), Engine::Native(_)))
    }
    /// The state; to be called with the interpreter released.
    pub fn lock(&self) -> MutexGuard<'_, Moving> {
        self.waiting.fetch_add(1, Ordering::AcqRel);
        let moving = self.moving.lock().unwrap_or_else(PoisonError::into_inner);
        self.waiting.fetch_sub(1, Ordering::AcqRel);
        moving
    }
    /// The state, after all calls that wait for it; to be called with the interpreter released.
    pub fn lock_last(&self) -> MutexGuard<'_, Moving> {
        while self.waiting.load(Ordering::Acquire) > 0 {
            std::thread::sleep(Duration::from_micros(20));
        }
        self.lock()
    }
    /// Claims the state for a call that changes it.
    ///
    /// # Errors
    /// `Error` where another thread has it.
    pub fn claim(&self, py: Python<'_>) -> PyResult<Busy<'_>> {
        if self.busy.swap(true, Ordering::Acquire) {
            let message = "this torsion model is running in another thread; make one for each thread";
            return Err(exception(py, "Error", message, vec![]));
        }
        Ok(Busy(&self.busy))
    }
    /// The exception of the user's forces, if a call ended by it.
    pub fn raised(&self) -> Option<PyErr> {
        self.callback.raised.take()
    }
    /// Refuses to wait for the state inside the function that is called while it changes.
    fn refuse_inside(&self, py: Python<'_>) -> PyResult<()> {
        if !self.callback.is_inside() {
            return Ok(());
        }
        let message = "the function `forces` asks the torsion model that calls it, whose state is not there meanwhile; it must \
                       depend on its argument only";
        Err(exception(py, "Error", message, vec![]))
    }
    /// An error of forces on the clusters.
    pub fn molecular_error(&self, py: Python<'_>, error: &MolecularError) -> PyErr {
        if let Some(raised) = self.raised() {
            return raised;
        }
        match error {
            MolecularError::Potential(e) => potential_error(py, e, &self.loaded.molecule.describe(e), None),
            MolecularError::Dynamics(e) => dynamics_error(py, e, None),
            other => exception(py, "NumericalError", &other.to_string(), vec![]),
        }
    }
    /// An error of a step.
    pub fn step_error(&self, py: Python<'_>, error: &MidpointError<MolecularError>) -> PyErr {
        let (time, joint) = match error {
            MidpointError::Force { cause, .. } => return self.molecular_error(py, cause),
            MidpointError::Dynamics { cause, .. } => return dynamics_error(py, cause, None),
            MidpointError::NotFinite { t, joint } => (*t, joint.clone()),
            MidpointError::NotConverged { t, joint, .. } => (*t, Some(joint.clone())),
            other => return exception(py, "NumericalError", &other.to_string(), vec![]),
        };
        let fields = vec![
            ("quantity", Some("step".into())),
            ("joint", joint.map(Field::Text)),
            ("time", Some(Field::Number(time))),
            ("required", Some("a step that succeeds".into())),
            ("remedy", Some("take a smaller dt_fs, or minimize first".into())),
        ];
        exception(py, "NumericalError", &error.to_string(), fields)
    }
    pub fn place(&self, py: Python<'_>, q: &[f64], v: &[f64], has_velocities: bool) -> PyResult<()> {
        let placed = py.detach(|| {
            let mut moving = self.lock();
            let Moving { forces, method, .. } = &mut *moving;
            let next = Midpoint::new(self.torsion.model(), forces, method.state().t, q, v)?;
            (moving.method, moving.has_velocities, moving.bath) = (next, has_velocities, None);
            moving.stale = false;
            Ok(())
        });
        placed.map_err(|e| self.step_error(py, &e))
    }
    /// A model at its neutral configuration. `kept`: constraints that its clusters satisfy.
    pub fn made(
        py: Python<'_>,
        s: &Bound<'_, System>,
        (torsion, kept): (Torsion, usize),
        forces: Option<&Bound<'_, PyAny>>,
        start: Start,
    ) -> PyResult<Self> {
        let loaded = s.get().loaded();
        let torsion = Arc::new(torsion);
        let model = Py::new(py, Model::made(py, torsion.model().clone(), report(&torsion, kept))?)?;
        let (engine, callback) = Engine::new(py, &loaded, forces)?;
        let mut forces = MolecularForces::new(torsion.clone(), engine);
        let method = py.detach(|| {
            let q = torsion.model().neutral::<f64>();
            Midpoint::new(torsion.model(), &mut forces, start.t, &q, &start.v)
        });
        let describe = |e: MidpointError<MolecularError>| match e {
            MidpointError::Force { cause: MolecularError::Potential(e), .. } => {
                potential_error(py, &e, &loaded.molecule.describe(&e), None)
            }
            MidpointError::Dynamics { cause, .. } => dynamics_error(py, &cause, None),
            other => exception(py, "NumericalError", &other.to_string(), vec![]),
        };
        let method = method.map_err(|e| callback.raised.take().unwrap_or_else(|| describe(e)))?;
        let has_velocities = start.has_velocities;
        let moving =
            Box::new(Mutex::new(Moving { forces, method, has_velocities, stale: false, bath: None }));
        let (system, waiting, busy) = (s.clone().unbind(), AtomicUsize::new(0), AtomicBool::new(false));
        Ok(TorsionModel { loaded, torsion, system, model, moving, callback, waiting, busy })
    }
    pub fn q_and_v(&self, py: Python<'_>) -> PyResult<(Vec<f64>, Vec<f64>)> {
        self.refuse_inside(py)?;
        let state = py.detach(|| {
            let mut moving = self.lock();
            let v = moving.method.velocity()?.to_vec();
            Ok((moving.method.state().q.clone(), v))
        });
        state.map_err(|e| dynamics_error(py, &e, None))
    }
}

impl Moving {
    /// Momenta at a temperature.
    ///
    /// # Errors
    /// Those of the mass matrix.
    pub fn draw(
        &mut self,
        torsion: &Torsion,
        kelvin: f64,
        seed: u64,
    ) -> Result<(), phipsi::recursion::DynamicsError> {
        let layout = torsion.layout();
        let mut p = vec![0.0; torsion.model().nv()];
        let (mut deviates, mut workspace) = (Deviates::new(seed), SolveWorkspace::new(layout));
        draw_momenta(layout, self.method.factors()?, kelvin, &mut deviates, &mut workspace, &mut p);
        self.method.set_momenta(&p)?;
        self.has_velocities = true;
        Ok(())
    }
}

#[pymethods]
impl TorsionModel {
    #[new]
    #[pyo3(signature = (s, positions = None, clusters = None, rigid = None, hinges = None, rings = None, angles = None, forces = None, free = None))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        s: &Bound<'_, System>,
        positions: Option<&Bound<'_, PyAny>>,
        clusters: Option<&Bound<'_, PyAny>>,
        rigid: Option<&Bound<'_, PyAny>>,
        hinges: Option<&Bound<'_, PyAny>>,
        rings: Option<&Bound<'_, PyAny>>,
        angles: Option<&Bound<'_, PyAny>>,
        forces: Option<&Bound<'_, PyAny>>,
        free: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let loaded = s.get().loaded();
        let positions = loaded.positions(py, positions, "positions")?;
        check_single(py, &positions)?;
        let mut x = vec![Vec3::zero(); loaded.molecule.atoms.len()];
        vectors(positions.at(0), &mut x);
        let word = PyString::new(py, "torsion").into_any();
        let clustering =
            clustering(&loaded, clusters.unwrap_or(&word), rigid, hinges, (rings, angles), free)?;
        let built = py.detach(|| {
            let atoms = &loaded.molecule.atoms;
            let clusters = Clusters::new(atoms, &x, &clustering)?;
            let kept = satisfied_constraints(atoms, &clusters, &loaded.molecule.system)?;
            Ok((Torsion::new(atoms, &x, clusters)?, kept))
        });
        let (torsion, kept) = built.map_err(|e| molecule_error(py, &e))?;
        let start = Start { t: 0.0, v: vec![0.0; torsion.model().nv()], has_velocities: false };
        Self::made(py, s, (torsion, kept), forces, start)
    }
    /// The System.
    #[getter]
    fn system(&self, py: Python<'_>) -> Py<System> {
        self.system.clone_ref(py)
    }
    /// The clusters as bodies and the hinges as joints: a Model in nm, ps, Da, kJ/mol. Its report tells which hinges are locked.
    #[getter]
    fn model(&self, py: Python<'_>) -> Py<Model> {
        self.model.clone_ref(py)
    }
    /// Number of degrees of freedom: hinges and open angles, and 6 for every molecule (5 for a linear one, 3 for a single atom),
    /// less what closes flexible rings.
    #[getter]
    fn degrees_of_freedom(&self) -> usize {
        self.torsion.degrees_of_freedom()
    }
    /// Atoms of each cluster.
    #[getter]
    fn clusters(&self) -> Vec<Vec<usize>> {
        self.torsion.clusters().clusters.clone()
    }
    /// The hinges: (joint of ``model``, its two atoms, kind of the bond).
    #[getter]
    fn hinges(&self) -> Vec<(String, (usize, usize), &'static str)> {
        let hinges = self.torsion.clusters().hinges.iter().enumerate();
        let joint =
            |h: usize| self.torsion.layout().joint_of_velocity(self.torsion.hinge_dof(h)).0.to_string();
        hinges.map(|(h, hinge)| (joint(h), (hinge.atoms[0], hinge.atoms[1]), hinge.kind.word())).collect()
    }
    /// Present time, ps.
    #[getter]
    fn time_ps(&self, py: Python<'_>) -> PyResult<f64> {
        self.refuse_inside(py)?;
        Ok(py.detach(|| self.lock().method.state().t))
    }
    /// Present configuration (nq,), as in ``model``: hinge angles are increments from the given positions. Settable; the
    /// velocities are then forgotten, and the next run draws them.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.refuse_inside(py)?;
        let q = py.detach(|| self.lock().method.state().q.clone());
        let n = q.len();
        array(py, q, vec![n])
    }
    #[setter]
    fn set_q(&self, py: Python<'_>, q: &Bound<'_, PyAny>) -> PyResult<()> {
        let _busy = self.claim(py)?;
        let argument = self.model.get().compiled().q(q, "q")?;
        check_single(py, &argument)?;
        let mut q = argument.at(0).to_vec();
        self.torsion.model().normalize(&mut q);
        self.place(py, &q, &vec![0.0; self.torsion.model().nv()], false)
    }
    /// Present generalized velocities (nv,), as in ``model``: rad/ps and nm/ps. Settable.
    #[getter]
    fn v<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (_, v) = self.q_and_v(py)?;
        let n = v.len();
        array(py, v, vec![n])
    }
    #[setter]
    fn set_v(&self, py: Python<'_>, v: &Bound<'_, PyAny>) -> PyResult<()> {
        let _busy = self.claim(py)?;
        let v = self.model.get().compiled().v(v, "v")?;
        check_single(py, &v)?;
        let (q, _) = self.q_and_v(py)?;
        self.place(py, &q, v.at(0), true)
    }
    /// Present positions of the atoms, nm: (n_atoms, 3). Settable to positions of the same rigid clusters; the velocities are
    /// then forgotten, and the next run draws them.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.refuse_inside(py)?;
        let x = py.detach(|| {
            let q = self.lock().method.state().q.clone();
            self.torsion.positions(&q)
        });
        rows(py, &x.map_err(|e| dynamics_error(py, &e, None))?)
    }
    #[setter]
    fn set_positions(&self, py: Python<'_>, positions: &Bound<'_, PyAny>) -> PyResult<()> {
        let _busy = self.claim(py)?;
        let positions = self.loaded.positions(py, Some(positions), "positions")?;
        check_single(py, &positions)?;
        let q = self.configuration(py, positions.at(0))?;
        self.place(py, &q, &vec![0.0; self.torsion.model().nv()], false)
    }
    /// Present velocities of the atoms, nm/ps: (n_atoms, 3). Settable; of velocities that the clusters cannot have, those with
    /// the same generalized momenta are taken.
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (q, v) = self.q_and_v(py)?;
        let u = py.detach(|| {
            let (mut poses, mut x) = (self.torsion.poses(), vec![Vec3::zero(); self.torsion.atoms().len()]);
            self.torsion.positions_into(&q, &mut poses, &mut x)?;
            self.torsion.velocities_into(&poses, &v, &mut x)?;
            Ok(x)
        });
        rows(py, &u.map_err(|e: phipsi::recursion::DynamicsError| dynamics_error(py, &e, None))?)
    }
    #[setter]
    fn set_velocities(&self, py: Python<'_>, velocities: &Bound<'_, PyAny>) -> PyResult<()> {
        let _busy = self.claim(py)?;
        let velocities = self.loaded.positions(py, Some(velocities), "velocities")?;
        check_single(py, &velocities)?;
        let set = py.detach(|| {
            let (torsion, mut moving) = (&self.torsion, self.lock());
            let mut x = vec![Vec3::zero(); torsion.atoms().len()];
            let mut poses = torsion.poses();
            torsion.positions_into(&moving.method.state().q, &mut poses, &mut x)?;
            vectors(velocities.at(0), &mut x);
            x.iter_mut().zip(&torsion.atoms().masses).for_each(|(u, mass)| *u = u.scale(*mass));
            let mut p = vec![0.0; torsion.model().nv()];
            torsion.gather_into(&poses, &x, &mut torsion.gather_workspace(), &mut p)?;
            moving.method.set_momenta(&p)?;
            moving.has_velocities = true;
            Ok(())
        });
        set.map_err(|e: phipsi::recursion::DynamicsError| dynamics_error(py, &e, None))
    }
    /// Draws velocities from the Maxwell–Boltzmann distribution of the clusters.
    ///
    /// ``temperature_K``: at least 0. ``seed``: the same one gives the same velocities.
    ///
    /// Raises ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    /// >>> t = phipsi.molecule.TorsionModel(s)
    /// >>> t.draw_velocities(300, seed=1)
    /// >>> bool(t.model.kinetic_energy(t.q, t.v) > 0)
    /// True
    #[pyo3(signature = (temperature_K = 300.0, seed = 0))]
    #[allow(non_snake_case)]
    fn draw_velocities(&self, py: Python<'_>, temperature_K: f64, seed: u64) -> PyResult<()> {
        let _busy = self.claim(py)?;
        check_temperature(py, temperature_K)?;
        let drawn = py.detach(|| self.lock().draw(&self.torsion, temperature_K, seed));
        drawn.map_err(|e| dynamics_error(py, &e, None))
    }
    /// Energy of every term and their sum at the present positions, kJ/mol; as ``System.energy``, or that of ``forces``.
    ///
    /// Example
    /// -------
    /// >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    /// >>> t = phipsi.molecule.TorsionModel(s)
    /// >>> bool(np.isclose(t.energy()["total"], s.energy()["total"]))
    /// True
    fn energy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.refuse_inside(py)?;
        let native = py.detach(|| {
            let moving = self.lock();
            matches!(moving.forces.potential(), Engine::Native(_))
                .then_some(())
                .ok_or(moving.method.state().potential)
        });
        match native {
            Ok(()) => {
                let positions = self.positions(py)?.into_any();
                self.system.get().energy(py, Some(&positions))
            }
            Err(energy) => {
                let energies = PyDict::new(py);
                [TERM, TOTAL].iter().try_for_each(|key| energies.set_item(key, energy))?;
                Ok(energies)
            }
        }
    }
    fn __repr__(&self) -> String {
        let (n, clusters) = (self.torsion.atoms().len(), self.torsion.clusters().clusters.len());
        let freedom = self.torsion.degrees_of_freedom();
        format!(
            "<phipsi.molecule.TorsionModel: {n} atoms in {clusters} clusters, {freedom} degrees of freedom>"
        )
    }
}

/// # Errors
/// `ArgumentError`.
pub fn check_temperature(py: Python<'_>, kelvin: f64) -> PyResult<()> {
    if kelvin >= 0.0 && kelvin.is_finite() {
        return Ok(());
    }
    let message = format!("`temperature_K` is {kelvin}, but a finite number of at least 0 is required");
    let required = "a finite number, at least 0".into();
    Err(argument_error(py, "temperature_K", Field::Number(kelvin), required, &message, None))
}
