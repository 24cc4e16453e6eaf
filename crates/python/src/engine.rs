//! What gives the energy and the forces of a torsion model: the force field of its System, or a function in Python.

use crate::batch::Argument;
use crate::errors::argument_error;
use crate::molecule::{Loaded, rows, vectors};
use crate::simulate::Raised;
use phipsi::molecule::{ForceField, Potential, PotentialError};
use phipsi::spatial::Vec3;
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::ThreadId;

/// The potential of a torsion model.
pub enum Engine {
    /// The System's own terms.
    Native(ForceField),
    /// A function of the user's.
    Python(PythonForces),
}

impl Engine {
    /// The argument `forces`: none, a function positions -> (energy, forces), or a Context of OpenMM.
    ///
    /// # Errors
    /// `ArgumentError` for what cannot be called; what `phipsi.molecule` raises about a Context.
    pub fn new(
        py: Python<'_>,
        loaded: &Arc<Loaded>,
        forces: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(Engine, Callback)> {
        let callback = Callback::default();
        let Some(forces) = forces else { return Ok((Engine::Native(loaded.field.clone()), callback)) };
        let n = loaded.molecule.atoms.len();
        let function = match forces.is_callable() {
            true => forces.clone(),
            false => py.import("phipsi._openmm")?.getattr("engine_of")?.call1((forces, n))?,
        };
        if !function.is_callable() {
            let found = forces.get_type().to_string();
            let required = "a function forces(positions) -> (energy, forces), or an openmm.Context";
            let message = format!("`forces` is {found}, but {required} is required");
            return Err(argument_error(py, "forces", found.into(), required.into(), &message, None));
        }
        let (loaded, function) = (loaded.clone(), function.unbind());
        let engine = PythonForces { loaded, function, terms: [TERM.into()], callback: callback.clone() };
        Ok((Engine::Python(engine), callback))
    }
}

impl Potential for Engine {
    fn terms(&self) -> &[String] {
        match self {
            Engine::Native(field) => field.terms(),
            Engine::Python(function) => &function.terms,
        }
    }
    fn evaluate(
        &mut self,
        positions: &[Vec3<f64>],
        energies: &mut [f64],
        forces: &mut [Vec3<f64>],
    ) -> Result<(), PotentialError> {
        match self {
            Engine::Native(field) => field.evaluate(positions, energies, forces),
            Engine::Python(function) => function.evaluate(positions, energies, forces),
        }
    }
}

/// Name of the energy that a function gives.
pub const TERM: &str = "forces";

/// What a call of the function left: its exception, and the thread that is in it.
#[derive(Clone, Default)]
pub struct Callback {
    /// The exception.
    pub raised: Raised,
    thread: Arc<Mutex<Option<ThreadId>>>,
}

impl Callback {
    /// True if this thread is inside a call of the function, which holds the state.
    pub fn is_inside(&self) -> bool {
        *self.thread.lock().unwrap_or_else(PoisonError::into_inner) == Some(std::thread::current().id())
    }
    fn set_inside(&self, inside: bool) {
        let thread = inside.then(|| std::thread::current().id());
        *self.thread.lock().unwrap_or_else(PoisonError::into_inner) = thread;
    }
}

/// A function positions (n_atoms, 3) -> (energy, forces (n_atoms, 3)) in nm, kJ/mol, kJ/mol/nm.
///
/// What it raises is kept in its [`Callback`] and ends the call that needed the forces.
pub struct PythonForces {
    loaded: Arc<Loaded>,
    function: Py<PyAny>,
    terms: [String; 1],
    callback: Callback,
}

impl PythonForces {
    fn evaluate(
        &self,
        positions: &[Vec3<f64>],
        energies: &mut [f64],
        forces: &mut [Vec3<f64>],
    ) -> Result<(), PotentialError> {
        let error = |message: &str| PotentialError {
            term: self.terms[0].clone(),
            atoms: Vec::new(),
            message: message.into(),
        };
        if self.callback.raised.is_set() {
            return Err(error("its exception ends the run"));
        }
        self.callback.set_inside(true);
        // Of what the function returned, numbers that are not finite are a potential without a value: Monte Carlo refuses them.
        let called = Python::attach(|py| -> PyResult<Result<(f64, Argument), String>> {
            let result = self.function.bind(py).call1((rows(py, positions)?,))?;
            match self.read(py, &result) {
                Err(e) if e.get_type(py).name()? == "NumericalError" => Ok(Err(e.value(py).to_string())),
                other => other.map(Ok),
            }
        });
        self.callback.set_inside(false);
        match called {
            Ok(Ok((energy, numbers))) => {
                energies[0] = energy;
                vectors(numbers.at(0), forces);
                Ok(())
            }
            Ok(Err(message)) => Err(error(&message)),
            Err(e) => {
                self.callback.raised.set(e);
                Err(error("it raised an exception"))
            }
        }
    }
    /// What the function returned.
    fn read(&self, py: Python<'_>, result: &Bound<'_, PyAny>) -> PyResult<(f64, Argument)> {
        let Ok((energy, forces)) = result.extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>() else {
            let found = result.get_type().to_string();
            let required = "a pair (energy, forces)";
            let message = format!("the function `forces` returned {found}, but {required} is required");
            return Err(argument_error(py, "forces", found.into(), required.into(), &message, None));
        };
        let energy =
            Argument::read(&energy, "energy of the function forces", &[], "kJ/mol", &|_| "energy".into())?;
        let forces = self.loaded.positions(py, Some(&forces), "forces of the function forces")?;
        crate::simulator::check_single(py, &energy)?;
        crate::simulator::check_single(py, &forces)?;
        Ok((energy.at(0)[0], forces))
    }
}
