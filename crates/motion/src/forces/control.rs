//! The user's own controller: a function of (t, q, v) that gives generalised forces.

use crate::force::{Force, ForceError, Loads, Situation};
use std::sync::Arc;

type OwnLaw = dyn FnMut(f64, &[f64], &[f64], &mut [f64]) -> Result<(), String> + Send;
type SharedLaw = dyn Fn(f64, &[f64], &[f64], &mut [f64]) -> Result<(), String> + Send + Sync;

enum Law {
    Own(Box<OwnLaw>),
    Shared(Arc<SharedLaw>),
}

/// A control law τ(t, q, v) of the user.
pub struct Control {
    name: String,
    law: Law,
    tau: Vec<f64>,
}

impl Control {
    /// From a function that writes nv generalised forces. It must depend on its arguments only: trial steps call it out of order.
    pub fn new(
        name: impl Into<String>,
        nv: usize,
        law: impl FnMut(f64, &[f64], &[f64], &mut [f64]) -> Result<(), String> + Send + 'static,
    ) -> Self {
        Control { name: name.into(), law: Law::Own(Box::new(law)), tau: vec![0.0; nv] }
    }
    /// The same from a function that two threads may call at once, so that the error of a run can be estimated beside it.
    pub fn shared(
        name: impl Into<String>,
        nv: usize,
        law: impl Fn(f64, &[f64], &[f64], &mut [f64]) -> Result<(), String> + Send + Sync + 'static,
    ) -> Self {
        Control { name: name.into(), law: Law::Shared(Arc::new(law)), tau: vec![0.0; nv] }
    }
}

impl Force for Control {
    fn name(&self) -> &str {
        &self.name
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        self.tau.iter_mut().for_each(|x| *x = 0.0);
        let result = match &mut self.law {
            Law::Own(law) => law(at.t, at.q, at.v, &mut self.tau),
            Law::Shared(law) => law(at.t, at.q, at.v, &mut self.tau),
        };
        result.map_err(|message| ForceError { force: self.name.clone(), t: at.t, message })?;
        loads.tau.iter_mut().zip(&self.tau).for_each(|(sum, x)| *sum += x);
        Ok(())
    }
    fn another(&self) -> Option<Box<dyn Force>> {
        let Law::Shared(law) = &self.law else { return None };
        let (name, law, tau) = (self.name.clone(), Law::Shared(law.clone()), self.tau.clone());
        Some(Box::new(Control { name, law, tau }))
    }
}
