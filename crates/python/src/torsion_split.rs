//! Forces of a torsion model in two parts, for multiple time steps of a run.

use crate::engine::Engine;
use crate::errors::{Field, argument_error};
use crate::molecule::Loaded;
use crate::torsion_model::{Moving, TorsionModel};
use phipsi::molecule::MolecularForces;
use phipsi::molecule::torsion_model::TorsionModel as Torsion;
use pyo3::prelude::*;
use std::sync::Arc;

/// Most short steps in one.
const MOST: u64 = 1000;

impl TorsionModel {
    /// The argument `inner_steps`.
    ///
    /// # Errors
    /// `ArgumentError` where it is 0 or too large, and for several steps with forces of the user's.
    pub fn inner_steps(&self, py: Python<'_>, n: u64) -> PyResult<usize> {
        let wrong = |message: &str, required: &str, remedy: &'static str| {
            let found = Field::Index(usize::try_from(n).unwrap_or(usize::MAX));
            Err(argument_error(py, "inner_steps", found, required.into(), message, Some(remedy)))
        };
        if !(1..=MOST).contains(&n) {
            let message = format!("`inner_steps` is {n}, but a whole number from 1 to {MOST} is required");
            return wrong(&message, "a whole number from 1 to 1000", "take a shorter dt_fs");
        }
        if n > 1 && !self.is_native(py) {
            let message =
                format!("`inner_steps` is {n}, but forces of a function have no parts that differ in speed");
            return wrong(&message, "1 with `forces` of one's own", "leave it out");
        }
        Ok(n as usize)
    }
}

impl Moving {
    /// Pairs apart from bonds, angles and torsions, which take so many steps in one; until [`Moving::join`].
    pub fn split(&mut self, torsion: &Arc<Torsion>, loaded: &Loaded, inner_steps: usize) {
        let [fast, slow] = loaded.field.clone().split().map(Engine::Native);
        self.forces = MolecularForces::new(torsion.clone(), fast).with_slow(slow);
        (self.method.substeps, self.stale) = (inner_steps, true);
    }
    /// All forces together again.
    pub fn join(&mut self, torsion: &Arc<Torsion>, loaded: &Loaded) {
        self.forces = MolecularForces::new(torsion.clone(), Engine::Native(loaded.field.clone()));
        (self.method.substeps, self.stale) = (1, true);
    }
}
