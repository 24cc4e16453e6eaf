//! One step of an explicit Runge–Kutta–Munthe-Kaas method on increments about the step's start.
//!
//! | symbol | meaning |
//! |---|---|
//! | y = (ξ, v, aux) | increment from q_n, velocity, auxiliary quantities; ξ = 0 at the start |
//! | ẏ | (B_ξ v, v̇(q_n ∘ τ(ξ), v), rates of aux) |
//! | k_i | ẏ at stage i; the end point is the last one and carries v̇ over to the next step, where ξ̇ = v |

use crate::increment::increment_rate;
use crate::system::System;
use crate::tableau::{DOP853_DENSE, Dense, ErrorWeights, Tableau, tsit5_weights};

/// Stages of a step, and the state it started from.
#[derive(Clone, Debug)]
pub struct ExplicitStep {
    /// The method.
    pub tableau: Tableau,
    /// Number of degrees of freedom.
    nv: usize,
    /// ẏ of every stage.
    k: Vec<Vec<f64>>,
    /// y at a stage or at a sample.
    y: Vec<f64>,
    /// y at the end of the step.
    end: Vec<f64>,
    q_stage: Vec<f64>,
    /// Coefficients of DOP853's dense output, once asked for.
    dense: Option<Vec<Vec<f64>>>,
    /// Start: time, size, q, v, aux.
    pub(crate) t: f64,
    pub(crate) h: f64,
    q: Vec<f64>,
    start: Vec<f64>,
    evaluations: u64,
}

/// A quantity that is not finite.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NotFinite {
    /// Acceleration at this degree of freedom.
    Acceleration(usize),
    /// Velocity at this degree of freedom.
    Velocity(usize),
    /// Rate of this auxiliary quantity.
    Auxiliary(usize),
}

/// Why a derivative was not had.
#[derive(Clone, Debug, PartialEq)]
pub enum StageError<E> {
    /// The system said so.
    System(E),
    /// It gave something that is not finite.
    NotFinite(NotFinite),
}

/// ẏ at y = (ξ, v, aux) about q; `q_stage` is scratch.
pub(crate) fn evaluate<S: System>(
    system: &mut S,
    t: f64,
    q: &[f64],
    y: &[f64],
    q_stage: &mut [f64],
    out: &mut [f64],
) -> Result<(), StageError<S::Error>> {
    let nv = system.model().nv();
    let (xi, rest) = y.split_at(nv);
    let (v, aux) = rest.split_at(nv);
    if let Some(i) = v.iter().position(|x| !x.is_finite()) {
        return Err(StageError::NotFinite(NotFinite::Velocity(i)));
    }
    system.model().integrate_into(q, xi, q_stage);
    let (xi_dot, rest) = out.split_at_mut(nv);
    let (v_dot, aux_dot) = rest.split_at_mut(nv);
    increment_rate(system.model(), xi, v, xi_dot);
    aux_dot.fill(0.0);
    system.derivative(t, q_stage, v, aux, v_dot, aux_dot).map_err(StageError::System)?;
    if let Some(i) = v_dot.iter().position(|x| !x.is_finite()) {
        return Err(StageError::NotFinite(NotFinite::Acceleration(i)));
    }
    match aux_dot.iter().position(|x| !x.is_finite()) {
        Some(i) => Err(StageError::NotFinite(NotFinite::Auxiliary(i))),
        None => Ok(()),
    }
}

impl ExplicitStep {
    /// Scratch for a method on a configuration space.
    pub fn new(tableau: Tableau, nq: usize, nv: usize, auxiliary: usize) -> Self {
        let size = 2 * nv + auxiliary;
        let stages = tableau.stages + 1 + if matches!(tableau.dense, Dense::Dop853) { 3 } else { 0 };
        ExplicitStep {
            tableau,
            nv,
            k: vec![vec![0.0; size]; stages],
            y: vec![0.0; size],
            end: vec![0.0; size],
            q_stage: vec![0.0; nq],
            dense: None,
            t: 0.0,
            h: 0.0,
            q: vec![0.0; nq],
            start: vec![0.0; size],
            evaluations: 0,
        }
    }
    /// Evaluations of the system so far.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }
    /// Counts evaluations that were made elsewhere.
    pub fn count(&mut self, evaluations: u64) {
        self.evaluations += evaluations;
    }
    /// Starts anew from a state and evaluates its derivative.
    pub fn begin<S: System>(
        &mut self,
        system: &mut S,
        t: f64,
        (q, v, aux): (&[f64], &[f64], &[f64]),
    ) -> Result<(), StageError<S::Error>> {
        self.q.copy_from_slice(q);
        self.start[..self.nv].fill(0.0);
        self.start[self.nv..2 * self.nv].copy_from_slice(v);
        self.start[2 * self.nv..].copy_from_slice(aux);
        self.y.copy_from_slice(&self.start);
        self.derivative(system, 0, t)
    }
    /// The derivative at the start: (accelerations, rates of aux).
    pub fn carried(&self) -> (&[f64], &[f64]) {
        let (nv, k) = (self.nv, &self.k[0]);
        (&k[nv..2 * nv], &k[2 * nv..])
    }
    /// Puts back a start with the derivative carried to it.
    pub fn resume(
        &mut self,
        (q, v, aux): (&[f64], &[f64], &[f64]),
        (v_dot, aux_dot): (&[f64], &[f64]),
        evaluations: u64,
    ) {
        let nv = self.nv;
        self.q.copy_from_slice(q);
        self.start[..nv].fill(0.0);
        self.start[nv..2 * nv].copy_from_slice(v);
        self.start[2 * nv..].copy_from_slice(aux);
        self.k[0][..nv].copy_from_slice(v);
        self.k[0][nv..2 * nv].copy_from_slice(v_dot);
        self.k[0][2 * nv..].copy_from_slice(aux_dot);
        self.evaluations = evaluations;
    }

    /// k[stage] = ẏ(t, self.y).
    fn derivative<S: System>(
        &mut self,
        system: &mut S,
        stage: usize,
        t: f64,
    ) -> Result<(), StageError<S::Error>> {
        self.evaluations += 1;
        evaluate(system, t, &self.q, &self.y, &mut self.q_stage, &mut self.k[stage])
    }
    /// y = start + h Σ a_j k_j.
    fn combine(&mut self, weights: &[f64], h: f64) {
        self.y.copy_from_slice(&self.start);
        for (k, &a) in self.k.iter().zip(weights).filter(|(_, a)| **a != 0.0) {
            let ah = a * h;
            self.y.iter_mut().zip(k).for_each(|(y, k)| *y += ah * k);
        }
    }
    /// All stages of a step of size h, the end point included. Stage times are cut at `latest`.
    pub fn attempt<S: System>(
        &mut self,
        system: &mut S,
        t: f64,
        h: f64,
        latest: f64,
    ) -> Result<(), StageError<S::Error>> {
        (self.t, self.h) = (t, h);
        self.dense = None;
        for stage in 1..=self.tableau.stages {
            self.combine(self.tableau.a[stage - 1], h);
            if stage == self.tableau.stages {
                self.end.copy_from_slice(&self.y);
            }
            self.derivative(system, stage, (t + self.tableau.c[stage] * h).min(latest))?;
        }
        Ok(())
    }
    /// Increment at the end of the attempted step.
    pub fn end_increment(&self) -> &[f64] {
        &self.end[..self.nv]
    }
    /// Velocity at the end of the attempted step.
    pub fn end_velocity(&self) -> &[f64] {
        &self.end[self.nv..2 * self.nv]
    }
    /// Local error over its scale, root mean square over increments and velocities; 0 for a fixed step.
    ///
    /// Scales: `atol` for increments (1 rad, 1 m), `rtol` (1 + `largest` speed) for each velocity; never relative to q.
    pub fn error(&self, atol: f64, rtol: f64, largest: &[f64]) -> f64 {
        let nv = self.nv;
        let scale =
            |i: usize| if i < nv { atol } else { rtol * (1.0 + largest[i - nv].max(self.end[i].abs())) };
        let squared = |weights: &[f64]| -> f64 {
            (0..2 * nv)
                .map(|i| {
                    let e: f64 = self.k.iter().zip(weights).map(|(k, w)| k[i] * w).sum();
                    (e / scale(i)).powi(2)
                })
                .sum()
        };
        let n = 2.0 * nv as f64;
        match self.tableau.error {
            _ if nv == 0 => 0.0,
            ErrorWeights::None => 0.0,
            ErrorWeights::Single(w) => self.h.abs() * (squared(w) / n).sqrt(),
            ErrorWeights::Hairer { fifth, third } => {
                let (e5, e3) = (squared(fifth), squared(third));
                if e5 == 0.0 { 0.0 } else { self.h.abs() * e5 / ((e5 + 0.01 * e3) * n).sqrt() }
            }
        }
    }
    /// Writes the end of the attempted step: q, and (ξ, v, aux).
    pub fn accept<S: System>(&mut self, system: &S, next_q: &mut [f64], next: &mut Vec<f64>) {
        system.model().integrate_into(&self.q, &self.end[..self.nv], next_q);
        next.clear();
        next.extend_from_slice(&self.end);
    }
    /// Rates at the end of the attempted step: accelerations, rates of aux.
    pub fn end_rates(&self) -> (&[f64], &[f64]) {
        let (nv, k) = (self.nv, &self.k[self.tableau.stages]);
        (&k[nv..2 * nv], &k[2 * nv..])
    }
    /// State at a fraction θ of the attempted step, not yet advanced: q, v, aux.
    pub fn sample<S: System>(
        &mut self,
        system: &mut S,
        theta: f64,
        latest: f64,
        q: &mut [f64],
        v: &mut [f64],
        aux: &mut [f64],
    ) -> Result<(), StageError<S::Error>> {
        if matches!(self.tableau.dense, Dense::Dop853) && self.dense.is_none() {
            self.prepare_dense(system, latest)?;
        }
        self.sample_roughly(system, theta, q, v, aux);
        Ok(())
    }
    /// The same without evaluations: of DOP853 to fifth order, where the stages of its dense output were not needed before.
    pub fn sample_roughly<S: System>(
        &mut self,
        system: &S,
        theta: f64,
        q: &mut [f64],
        v: &mut [f64],
        aux: &mut [f64],
    ) {
        match self.tableau.dense {
            Dense::Hermite => self.hermite(theta),
            Dense::Tsit5 => self.combine(&tsit5_weights(theta), self.h),
            Dense::Dop853 if self.dense.is_some() => self.polynomial(theta),
            Dense::Dop853 => self.quintic(theta),
        }
        let nv = self.nv;
        system.model().integrate_into(&self.q, &self.y[..nv], q);
        v.copy_from_slice(&self.y[nv..2 * nv]);
        aux.copy_from_slice(&self.y[2 * nv..]);
    }
    fn hermite(&mut self, theta: f64) {
        let (h, last) = (self.h, self.tableau.stages);
        let s = 1.0 - theta;
        for i in 0..self.y.len() {
            let delta = self.end[i] - self.start[i];
            let bend = s * (h * self.k[0][i] - delta) - theta * (h * self.k[last][i] - delta);
            self.y[i] = self.start[i] + theta * (delta + s * bend);
        }
    }
    /// Hermite's cubic and θ² (1 − θ)² (a + b θ) with the rates of DOP853's stages 7 and 10, at 1/4 and 3/5: stages from the sixth on are
    /// of order five. At 3/5 the rate of b's term is zero.
    fn quintic(&mut self, theta: f64) {
        self.hermite(theta);
        let (h, last, s) = (self.h, self.tableau.stages, 1.0 - theta);
        for i in 0..self.y.len() {
            let delta = self.end[i] - self.start[i];
            let (first, second) = (h * self.k[0][i] - delta, h * self.k[last][i] - delta);
            // What the cubic's rates lack there.
            let at_quarter = h * self.k[6][i] - delta - (3.0 * first - 5.0 * second) / 16.0;
            let at_three_fifths = h * self.k[9][i] - delta + (8.0 * first + 3.0 * second) / 25.0;
            let a = -125.0 / 12.0 * at_three_fifths;
            let b = 256.0 / 21.0 * (at_quarter - 3.0 / 16.0 * a);
            self.y[i] += (theta * s).powi(2) * (a + b * theta);
        }
    }
    fn prepare_dense<S: System>(&mut self, system: &mut S, latest: f64) -> Result<(), StageError<S::Error>> {
        let (t, h, last) = (self.t, self.h, self.tableau.stages);
        for stage in last + 1..=last + 3 {
            self.combine(self.tableau.a[stage - 1], h);
            self.derivative(system, stage, (t + self.tableau.c[stage] * h).min(latest))?;
        }
        let size = self.y.len();
        let mut f = vec![vec![0.0; size]; 7];
        for i in 0..size {
            let delta = self.end[i] - self.start[i];
            f[0][i] = delta;
            f[1][i] = h * self.k[0][i] - delta;
            f[2][i] = 2.0 * delta - h * (self.k[last][i] + self.k[0][i]);
            for (j, d) in DOP853_DENSE.iter().enumerate() {
                f[3 + j][i] = h * self.k.iter().zip(*d).map(|(k, d)| k[i] * d).sum::<f64>();
            }
        }
        self.dense = Some(f);
        Ok(())
    }
    fn polynomial(&mut self, theta: f64) {
        let Some(f) = &self.dense else { return };
        for i in 0..self.y.len() {
            let mut y = 0.0;
            for (j, f) in f.iter().enumerate().rev() {
                y = (y + f[i]) * if j % 2 == 0 { theta } else { 1.0 - theta };
            }
            self.y[i] = self.start[i] + y;
        }
    }
}
