//! One face for the steps of explicit and Rosenbrock methods.

use crate::explicit::{ExplicitStep, StageError};
use crate::integrate::Method;
use crate::rosenbrock::RosenbrockStep;
use crate::rosenbrock_tableau::{RODAS4, RODAS5P};
use crate::system::System;
use crate::tableau::{DOP853, RK4, TSIT5};

/// A step of a method with its scratch.
#[derive(Clone, Debug)]
pub(crate) enum OneStep {
    Explicit(Box<ExplicitStep>),
    Rosenbrock(Box<RosenbrockStep>),
}

/// The same call of either.
macro_rules! either {
    ($self:expr, $step:ident => $call:expr) => {
        match $self {
            OneStep::Explicit($step) => $call,
            OneStep::Rosenbrock($step) => $call,
        }
    };
}

impl OneStep {
    pub(crate) fn new(method: Method, nq: usize, nv: usize, auxiliary: usize) -> Self {
        let explicit = |tableau| OneStep::Explicit(Box::new(ExplicitStep::new(tableau, nq, nv, auxiliary)));
        let rosenbrock =
            |tableau| OneStep::Rosenbrock(Box::new(RosenbrockStep::new(tableau, nq, nv, auxiliary)));
        match method {
            Method::Dop853 => explicit(DOP853),
            Method::Tsit5 => explicit(TSIT5),
            Method::Rk4 { .. } => explicit(RK4),
            Method::Rodas4 => rosenbrock(RODAS4),
            Method::Rodas5p => rosenbrock(RODAS5P),
        }
    }
    /// Exponents (of the present and the last error) of the step size controller.
    pub(crate) fn controller(&self) -> (f64, f64) {
        match self {
            OneStep::Explicit(s) => s.tableau.controller,
            // The embedded formula has one order less, so the local error grows with the power `order`.
            OneStep::Rosenbrock(s) => (1.0 / f64::from(s.tableau.order), 0.0),
        }
    }
    pub(crate) fn order(&self) -> u32 {
        either!(self, s => s.tableau.order)
    }
    /// Start and size of the attempted step.
    pub(crate) fn span(&self) -> (f64, f64) {
        either!(self, s => (s.t, s.h))
    }
    pub(crate) fn evaluations(&self) -> u64 {
        either!(self, s => s.evaluations())
    }
    pub(crate) fn count(&mut self, evaluations: u64) {
        either!(self, s => s.count(evaluations));
    }
    pub(crate) fn begin<S: System>(
        &mut self,
        system: &mut S,
        t: f64,
        start: (&[f64], &[f64], &[f64]),
    ) -> Result<(), StageError<S::Error>> {
        either!(self, s => s.begin(system, t, start))
    }
    pub(crate) fn carried(&self) -> (&[f64], &[f64]) {
        either!(self, s => s.carried())
    }
    pub(crate) fn resume(
        &mut self,
        start: (&[f64], &[f64], &[f64]),
        rates: (&[f64], &[f64]),
        evaluations: u64,
    ) {
        either!(self, s => s.resume(start, rates, evaluations));
    }
    pub(crate) fn attempt<S: System>(
        &mut self,
        system: &mut S,
        t: f64,
        h: f64,
        latest: f64,
    ) -> Result<(), StageError<S::Error>> {
        either!(self, s => s.attempt(system, t, h, latest))
    }
    pub(crate) fn end_increment(&self) -> &[f64] {
        either!(self, s => s.end_increment())
    }
    pub(crate) fn end_velocity(&self) -> &[f64] {
        either!(self, s => s.end_velocity())
    }
    pub(crate) fn error(&self, atol: f64, rtol: f64, largest: &[f64]) -> f64 {
        either!(self, s => s.error(atol, rtol, largest))
    }
    pub(crate) fn accept<S: System>(&mut self, system: &S, next_q: &mut [f64], next: &mut Vec<f64>) {
        either!(self, s => s.accept(system, next_q, next));
    }
    pub(crate) fn end_rates(&self) -> (&[f64], &[f64]) {
        either!(self, s => s.end_rates())
    }
    pub(crate) fn sample<S: System>(
        &mut self,
        system: &mut S,
        theta: f64,
        latest: f64,
        q: &mut [f64],
        v: &mut [f64],
        aux: &mut [f64],
    ) -> Result<(), StageError<S::Error>> {
        match self {
            OneStep::Explicit(s) => s.sample(system, theta, latest, q, v, aux),
            OneStep::Rosenbrock(s) => {
                s.sample(system, theta, q, v, aux);
                Ok(())
            }
        }
    }
    /// Without evaluations.
    pub(crate) fn sample_roughly<S: System>(
        &mut self,
        system: &S,
        theta: f64,
        q: &mut [f64],
        v: &mut [f64],
        aux: &mut [f64],
    ) {
        match self {
            OneStep::Explicit(s) => s.sample_roughly(system, theta, q, v, aux),
            OneStep::Rosenbrock(s) => s.sample(system, theta, q, v, aux),
        }
    }
}
