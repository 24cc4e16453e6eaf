//! The user's own controller: a function of (t, q, v) that gives generalised forces.

use crate::force::{Force, ForceError, Loads, Situation};

type Law = dyn FnMut(f64, &[f64], &[f64], &mut [f64]) -> Result<(), String> + Send;

/// A control law τ(t, q, v) of the user.
pub struct Control {
    name: String,
    law: Box<Law>,
    tau: Vec<f64>,
}

impl Control {
    /// From a function that writes nv generalised forces. It must depend on its arguments only: trial steps call it out of order.
    pub fn new(
        name: impl Into<String>,
        nv: usize,
        law: impl FnMut(f64, &[f64], &[f64], &mut [f64]) -> Result<(), String> + Send + 'static,
    ) -> Self {
        Control { name: name.into(), law: Box::new(law), tau: vec![0.0; nv] }
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
        (self.law)(at.t, at.q, at.v, &mut self.tau).map_err(|message| ForceError {
            force: self.name.clone(),
            t: at.t,
            message,
        })?;
        loads.tau.iter_mut().zip(&self.tau).for_each(|(sum, x)| *sum += x);
        Ok(())
    }
}
