//! One step of a Rosenbrock method on increments about the step's start, for stiff scenes.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | y = (ξ, v, a) | increment from q_n, velocity, auxiliary quantities; ξ = 0 at the start | 2 nv + na |
//! | J | ∂ẏ/∂y at the start: [−½ ad_v, 1, 0; A_q, A_v, A_a; G_q, G_v, G_a] | |
//! | W | I/(hγ) − J | |
//! | B | (I/(hγ) + ½ ad_v)⁻¹, joint by joint: u_ξ = B (b_ξ + u_v) | nv×nv |
//! | S | I/(hγ) − A_v − hγ A_a G_v − (A_q + hγ A_a G_q) B: what is left for u_v | nv×nv |
//!
//! Source: notes on integrators, 7; Hairer, Wanner, *Solving ODEs II*, IV.7. One factorisation of S serves all stages. A_q and A_v are the
//! derivatives of forward dynamics along increments and by speeds; ½ ad_v is the derivative of ξ̇ = B_ξ v, without which a free base
//! would lose the order.

use crate::explicit::{NotFinite, StageError, evaluate};
use crate::increment::bracket;
use crate::lu::Lu;
use crate::rosenbrock_tableau::RosenbrockTableau;
use crate::system::{Linearization, System};
use phipsi_model::Model;

/// Stages of a step, and the state it started from.
#[derive(Clone, Debug)]
pub struct RosenbrockStep {
    /// The method.
    pub tableau: RosenbrockTableau,
    nv: usize,
    /// ẏ at the start and at the end.
    rate: Vec<f64>,
    end_rate: Vec<f64>,
    /// Stages.
    u: Vec<Vec<f64>>,
    y: Vec<f64>,
    end: Vec<f64>,
    b: Vec<f64>,
    q_stage: Vec<f64>,
    pub(crate) t: f64,
    pub(crate) h: f64,
    q: Vec<f64>,
    start: Vec<f64>,
    evaluations: u64,
    /// J at the start, and ∂ẏ/∂t; false until they are.
    linearized: bool,
    jacobian: Linearization,
    time_rate: Vec<f64>,
    /// B, joint by joint, and A_q + hγ A_a G_q.
    inverse: Vec<f64>,
    a_q: Vec<f64>,
    factor: Lu,
}

impl RosenbrockStep {
    /// Scratch for a method on a configuration space.
    pub fn new(tableau: RosenbrockTableau, nq: usize, nv: usize, auxiliary: usize) -> Self {
        let size = 2 * nv + auxiliary;
        let zero = || vec![0.0; size];
        RosenbrockStep {
            u: vec![zero(); tableau.c.len()],
            tableau,
            nv,
            rate: zero(),
            end_rate: zero(),
            y: zero(),
            end: zero(),
            b: zero(),
            q_stage: vec![0.0; nq],
            t: 0.0,
            h: 0.0,
            q: vec![0.0; nq],
            start: zero(),
            evaluations: 0,
            linearized: false,
            jacobian: Linearization::new(nv, auxiliary),
            time_rate: zero(),
            inverse: vec![0.0; nv * nv],
            a_q: vec![0.0; nv * nv],
            factor: Lu::new(nv),
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
    fn set_start(&mut self, q: &[f64], v: &[f64], aux: &[f64]) {
        let nv = self.nv;
        self.q.copy_from_slice(q);
        self.start[..nv].fill(0.0);
        self.start[nv..2 * nv].copy_from_slice(v);
        self.start[2 * nv..].copy_from_slice(aux);
        self.linearized = false;
    }
    /// Starts anew from a state and evaluates its derivative.
    pub fn begin<S: System>(
        &mut self,
        system: &mut S,
        t: f64,
        (q, v, aux): (&[f64], &[f64], &[f64]),
    ) -> Result<(), StageError<S::Error>> {
        self.set_start(q, v, aux);
        self.evaluations += 1;
        evaluate(system, t, &self.q, &self.start, &mut self.q_stage, &mut self.rate)
    }
    /// The derivative at the start: (accelerations, rates of aux).
    pub fn carried(&self) -> (&[f64], &[f64]) {
        let nv = self.nv;
        (&self.rate[nv..2 * nv], &self.rate[2 * nv..])
    }
    /// Puts back a start with the derivative carried to it.
    pub fn resume(
        &mut self,
        (q, v, aux): (&[f64], &[f64], &[f64]),
        (v_dot, aux_dot): (&[f64], &[f64]),
        evaluations: u64,
    ) {
        let nv = self.nv;
        self.set_start(q, v, aux);
        self.rate[..nv].copy_from_slice(v);
        self.rate[nv..2 * nv].copy_from_slice(v_dot);
        self.rate[2 * nv..].copy_from_slice(aux_dot);
        self.evaluations = evaluations;
    }

    /// J and ∂ẏ/∂t at the start; times are cut at `latest`.
    fn linearize<S: System>(
        &mut self,
        system: &mut S,
        t: f64,
        h: f64,
        latest: f64,
    ) -> Result<(), StageError<S::Error>> {
        let nv = self.nv;
        let (v, aux) = (&self.start[nv..2 * nv], &self.start[2 * nv..]);
        self.evaluations +=
            system.linearize(t, &self.q, v, aux, &mut self.jacobian).map_err(StageError::System)?;
        self.time_rate.fill(0.0);
        if !system.is_autonomous() {
            // One-sided of second order, inside the step: error (δ/h)² of the derivative's own change over the step.
            let delta = (1e-4 * h).min(0.25 * (latest - t)).max(8.0 * f64::EPSILON * t.abs());
            for (k, weight) in [(1.0, 4.0), (2.0, -1.0)] {
                self.evaluations += 1;
                let time = t + k * delta;
                evaluate(system, time, &self.q, &self.start, &mut self.q_stage, &mut self.b)?;
                for (sum, x) in self.time_rate.iter_mut().zip(&self.b) {
                    *sum += weight * x / (2.0 * delta);
                }
            }
            for (sum, x) in self.time_rate.iter_mut().zip(&self.rate) {
                *sum -= 3.0 * x / (2.0 * delta);
            }
        }
        self.linearized = true;
        Ok(())
    }

    /// B, A_q + hγ A_a G_q, and the factors of S.
    fn factorize(&mut self, model: &Model, h: f64) {
        let (nv, na) = (self.nv, self.jacobian.auxiliary);
        let step = h * self.tableau.gamma;
        let Linearization { a_q, a_v, a_aux, g_q, g_v, .. } = &self.jacobian;
        invert_turning(model, &self.start[nv..2 * nv], step, &mut self.inverse);
        self.a_q.copy_from_slice(a_q);
        let s = &mut self.factor.entries;
        for i in 0..nv {
            for j in 0..nv {
                s[(i, j)] = -a_v[i * nv + j];
            }
            s[(i, i)] += 1.0 / step;
            for m in 0..na {
                let a = step * a_aux[i * na + m];
                if a != 0.0 {
                    for j in 0..nv {
                        s[(i, j)] -= a * g_v[m * nv + j];
                        self.a_q[i * nv + j] += a * g_q[m * nv + j];
                    }
                }
            }
        }
        for k in model.moving_joints() {
            let range = model.v_range(k);
            for i in 0..nv {
                for j in range.clone() {
                    let sum: f64 =
                        range.clone().map(|m| self.a_q[i * nv + m] * self.inverse[m * nv + j]).sum();
                    s[(i, j)] -= sum;
                }
            }
        }
        self.factor.run();
    }

    /// u = W⁻¹ b.
    fn solve(&mut self, model: &Model, stage: usize) {
        let (nv, na) = (self.nv, self.jacobian.auxiliary);
        let step = self.h * self.tableau.gamma;
        let Linearization { a_aux, g_q, g_v, g_aux, .. } = &self.jacobian;
        let u = &mut self.u[stage];
        let (u_xi, rest) = u.split_at_mut(nv);
        let (u_v, u_aux) = rest.split_at_mut(nv);
        turn(model, &self.inverse, &self.b[..nv], u_xi);
        for i in 0..nv {
            let from_q: f64 = (0..nv).map(|j| self.a_q[i * nv + j] * u_xi[j]).sum();
            let from_aux: f64 = (0..na).map(|m| a_aux[i * na + m] * self.b[2 * nv + m]).sum();
            u_v[i] = self.b[nv + i] + from_q + step * from_aux;
        }
        self.factor.solve(u_v);
        // b_ξ is not needed any more.
        for i in 0..nv {
            self.b[i] += u_v[i];
        }
        turn(model, &self.inverse, &self.b[..nv], u_xi);
        for m in 0..na {
            let change: f64 = (0..nv).map(|j| g_q[m * nv + j] * u_xi[j] + g_v[m * nv + j] * u_v[j]).sum();
            self.b[2 * nv + m] += change;
            u_aux[m] = step * self.b[2 * nv + m];
        }
        // Work and impulse depend on what a force integrates, and nothing integrated depends on them: once is exact.
        for m in 0..na {
            let coupled: f64 = (0..na).map(|k| g_aux[m * na + k] * step * self.b[2 * nv + k]).sum();
            u_aux[m] += step * coupled;
        }
    }

    /// All stages of a step of size h and the derivative at its end. Stage times are cut at `latest`.
    pub fn attempt<S: System>(
        &mut self,
        system: &mut S,
        t: f64,
        h: f64,
        latest: f64,
    ) -> Result<(), StageError<S::Error>> {
        (self.t, self.h) = (t, h);
        if !self.linearized {
            self.linearize(system, t, h, latest)?;
        }
        self.factorize(system.model(), h);
        let stages = self.u.len();
        for stage in 0..stages {
            self.y.copy_from_slice(&self.start);
            if stage == 0 {
                self.b.copy_from_slice(&self.rate);
            } else {
                for (u, a) in self.u.iter().zip(self.tableau.a[stage - 1]) {
                    self.y.iter_mut().zip(u).for_each(|(y, u)| *y += a * u);
                }
                self.evaluations += 1;
                let time = (t + self.tableau.c[stage] * h).min(latest);
                evaluate(system, time, &self.q, &self.y, &mut self.q_stage, &mut self.b)?;
                for (u, c) in self.u.iter().zip(self.tableau.c_matrix[stage - 1]) {
                    self.b.iter_mut().zip(u).for_each(|(b, u)| *b += c / h * u);
                }
            }
            let weight = h * self.tableau.d[stage];
            self.b.iter_mut().zip(&self.time_rate).for_each(|(b, f)| *b += weight * f);
            self.solve(system.model(), stage);
            if let Some(i) = self.u[stage][..2 * self.nv].iter().position(|x| !x.is_finite()) {
                return Err(StageError::NotFinite(NotFinite::Velocity(i % self.nv)));
            }
        }
        self.end.copy_from_slice(&self.y);
        self.end.iter_mut().zip(&self.u[stages - 1]).for_each(|(y, u)| *y += u);
        self.evaluations += 1;
        let time = (t + h).min(latest);
        evaluate(system, time, &self.q, &self.end, &mut self.q_stage, &mut self.end_rate)
    }
    /// Increment at the end of the attempted step.
    pub fn end_increment(&self) -> &[f64] {
        &self.end[..self.nv]
    }
    /// Velocity at the end of the attempted step.
    pub fn end_velocity(&self) -> &[f64] {
        &self.end[self.nv..2 * self.nv]
    }
    /// Local error over its scale, as that of the explicit methods.
    pub fn error(&self, atol: f64, rtol: f64, largest: &[f64]) -> f64 {
        let nv = self.nv;
        let Some(last) = self.u.last().filter(|_| nv > 0) else { return 0.0 };
        let scale =
            |i: usize| if i < nv { atol } else { rtol * (1.0 + largest[i - nv].max(self.end[i].abs())) };
        let squares: f64 = (0..2 * nv).map(|i| (last[i] / scale(i)).powi(2)).sum();
        (squares / (2.0 * nv as f64)).sqrt()
    }
    /// Writes the end of the attempted step: q, and (ξ, v, aux).
    pub fn accept<S: System>(&mut self, system: &S, next_q: &mut [f64], next: &mut Vec<f64>) {
        system.model().integrate_into(&self.q, &self.end[..self.nv], next_q);
        next.clear();
        next.extend_from_slice(&self.end);
    }
    /// Rates at the end of the attempted step: accelerations, rates of aux.
    pub fn end_rates(&self) -> (&[f64], &[f64]) {
        let nv = self.nv;
        (&self.end_rate[nv..2 * nv], &self.end_rate[2 * nv..])
    }
    /// State at a fraction θ of the attempted step, not yet advanced: q, v, aux.
    pub fn sample<S: System>(
        &mut self,
        system: &S,
        theta: f64,
        q: &mut [f64],
        v: &mut [f64],
        aux: &mut [f64],
    ) {
        let nv = self.nv;
        for i in 0..self.y.len() {
            let bend = self.tableau.h.iter().rev().fold(0.0, |sum, weights| {
                sum * theta + self.u.iter().zip(*weights).map(|(u, w)| w * u[i]).sum::<f64>()
            });
            self.y[i] = (1.0 - theta) * self.start[i] + theta * (self.end[i] + (1.0 - theta) * bend);
        }
        system.model().integrate_into(&self.q, &self.y[..nv], q);
        v.copy_from_slice(&self.y[nv..2 * nv]);
        aux.copy_from_slice(&self.y[2 * nv..]);
    }
}

/// B = (I/step + ½ ad_v)⁻¹, joint by joint; entries between joints are not written.
fn invert_turning(model: &Model, v: &[f64], step: f64, out: &mut [f64]) {
    let nv = v.len();
    for k in model.moving_joints() {
        let range = model.v_range(k);
        let (first, n) = (range.start, range.len());
        let kind = &model.joints()[k].kind;
        let mut block = [[0.0; 12]; 6];
        for j in 0..n {
            let mut unit = [0.0; 6];
            unit[j] = 1.0;
            let column = bracket(kind, &v[range.clone()], &unit[..n]);
            for i in 0..n {
                block[i][j] = 0.5 * column[i] + if i == j { 1.0 / step } else { 0.0 };
            }
            block[j][6 + j] = 1.0;
        }
        // Gauss–Jordan: 1/step dominates, or the step turns the joint by more than a turn and is rejected.
        for p in 0..n {
            let row = (p..n).max_by(|a, b| block[*a][p].abs().total_cmp(&block[*b][p].abs())).unwrap_or(p);
            block.swap(p, row);
            let pivot = block[p][p];
            block[p].iter_mut().for_each(|x| *x /= pivot);
            for i in (0..n).filter(|i| *i != p) {
                let factor = block[i][p];
                let pivot_row = block[p];
                block[i].iter_mut().zip(pivot_row).for_each(|(x, y)| *x -= factor * y);
            }
        }
        for i in 0..n {
            for j in 0..n {
                out[(first + i) * nv + first + j] = block[i][6 + j];
            }
        }
    }
}

/// out = B x.
fn turn(model: &Model, inverse: &[f64], x: &[f64], out: &mut [f64]) {
    let nv = x.len();
    for k in model.moving_joints() {
        let range = model.v_range(k);
        for i in range.clone() {
            out[i] = range.clone().map(|j| inverse[i * nv + j] * x[j]).sum();
        }
    }
}
