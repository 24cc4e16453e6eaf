//! Kick – variational midpoint drift – kick in (q, p): the method for conservative runs and molecules.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | p | generalised momenta M(q) v | notes on integrators, 1 |
//! | x, q_m | increment h v of the drift, q ∘ τ(x/2) | the same, 2 |
//! | μ, g | [`MomentumSweep`] at (q_m, v) | the same, 1 |
//! | y∓ | μ ∓ (h/2) L*_{∓x/2} g: momenta at both ends, moved to the middle | the same, 2 |
//! | r, d | B*_{−x} y₋ − p̂ and M(q)⁻¹ r | the same, 2 |
//!
//! The drift is the discrete Lagrangian h K(q ∘ τ(hv/2), v) between two kicks: symplectic, time-reversible, of second order,
//! with the momentum of a free tree exact, one force evaluation a step. v solves r(v) = 0 by d = M(q)⁻¹ r, contraction of
//! size h |v|, with Anderson mixing of depth two in the metric M(q).

use crate::midpoint_maps::{differential_adjoint, increment_adjoint, map_momenta};
use crate::midpoint_mixing::Mixing;
use crate::midpoint_momentum::MomentumSweep;
use phipsi_model::Model;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{ArticulatedSweep, DynamicsError, Layout};
use std::fmt;

/// A drift that has not converged by then does not: the contraction would have to be worse than 0.8.
const MOST_ITERATIONS: usize = 100;

/// Forces with a potential energy. Closures from (q, forces) to the energy are.
pub trait Conservative {
    /// Why there is no value.
    type Error;
    /// Writes the generalised forces −∂U/∂q along the joints' increments (nv) and returns the potential energy U.
    ///
    /// # Errors
    /// The step is not made.
    fn evaluate(&mut self, q: &[f64], forces: &mut [f64]) -> Result<f64, Self::Error>;
}

impl<E, F: FnMut(&[f64], &mut [f64]) -> Result<f64, E>> Conservative for F {
    type Error = E;
    fn evaluate(&mut self, q: &[f64], forces: &mut [f64]) -> Result<f64, E> {
        self(q, forces)
    }
}

/// Why a step could not be made; the state before it is intact.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum MidpointError<E> {
    /// The forces have no value.
    Force {
        /// Time at the end of the step.
        t: f64,
        /// Why.
        cause: E,
    },
    /// A recursion failed.
    Dynamics {
        /// Time.
        t: f64,
        /// Why.
        cause: DynamicsError,
    },
    /// Forces or potential energy are no finite numbers.
    NotFinite {
        /// Time at the end of the step.
        t: f64,
        /// The joint whose force it is; `None` for the potential energy.
        joint: Option<String>,
    },
    /// The implicit drift does not converge.
    NotConverged {
        /// Time at the start of the step.
        t: f64,
        /// Step size.
        h: f64,
        /// Iterations made.
        iterations: usize,
        /// Size of the last correction relative to the velocity.
        correction: f64,
        /// The joint whose velocity was corrected most.
        joint: String,
    },
}

impl<E: fmt::Display> fmt::Display for MidpointError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MidpointError::Force { t, cause } => write!(f, "forces at t = {t}: {cause}"),
            MidpointError::Dynamics { t, cause } => write!(f, "at t = {t}: {cause}"),
            MidpointError::NotFinite { t, joint: Some(joint) } => {
                write!(f, "at t = {t} the force on joint `{joint}` is not finite; take a smaller step")
            }
            MidpointError::NotFinite { t, joint: None } => {
                write!(f, "at t = {t} the potential energy is not finite; take a smaller step")
            }
            MidpointError::NotConverged { t, h, iterations, correction, joint } => write!(
                f,
                "at t = {t} a drift of {h} has not converged in {iterations} iterations (last correction \
                 {correction:.1e} of the velocity, most of it in joint `{joint}`); a drift must turn no joint far: \
                 take a smaller step, or lock the fastest joint"
            ),
        }
    }
}

impl<E: fmt::Display + fmt::Debug> std::error::Error for MidpointError<E> {}

/// Everything that continues bit for bit.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MidpointState {
    /// Time.
    pub t: f64,
    /// Configuration, nq.
    pub q: Vec<f64>,
    /// Generalised momenta, nv.
    pub p: Vec<f64>,
    /// Generalised forces at q, nv.
    pub forces: Vec<f64>,
    /// Potential energy at q.
    pub potential: f64,
    /// Velocity in the middle of the last drift, where the next one starts to iterate.
    pub guess: Vec<f64>,
    /// Steps made.
    pub steps: u64,
    /// Iterations of all drifts.
    pub iterations: u64,
}

impl MidpointState {
    fn check(&self, model: &Model) -> Result<(), DynamicsError> {
        let (nq, nv) = (model.nq(), model.nv());
        for (argument, expected, found) in [
            ("q", nq, self.q.len()),
            ("p", nv, self.p.len()),
            ("forces", nv, self.forces.len()),
            ("guess", nv, self.guess.len()),
        ] {
            if expected != found {
                return Err(DynamicsError::Shape { argument, expected, found });
            }
        }
        Ok(())
    }
    /// Becomes another state of the same model, without an allocation.
    pub fn copy(&mut self, other: &Self) {
        let MidpointState { t, q, p, forces, potential, guess, steps, iterations } = other;
        for (to, from) in
            [(&mut self.q, q), (&mut self.p, p), (&mut self.forces, forces), (&mut self.guess, guess)]
        {
            to.clone_from(from);
        }
        (self.t, self.potential, self.steps, self.iterations) = (*t, *potential, *steps, *iterations);
    }
}

/// How a drift went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriftInfo {
    /// Iterations.
    pub iterations: usize,
    /// Last correction relative to the velocity.
    pub correction: f64,
}

/// The method on one model.
#[derive(Clone, Debug)]
pub struct Midpoint {
    model: Model,
    layout: Layout<f64>,
    state: MidpointState,
    /// Stops the iteration at corrections of this relative size; 0 iterates to rounding, which reversibility and exact
    /// momenta need.
    pub tolerance: f64,
    sweep: ArticulatedSweep<f64>,
    /// The factors are those of the present q.
    factored: bool,
    momentum: MomentumSweep<f64>,
    solve: SolveWorkspace<f64>,
    mixing: Mixing,
    v: Vec<f64>,
    velocity: Vec<f64>,
    x: Vec<f64>,
    mu: Vec<f64>,
    g: Vec<f64>,
    y: Vec<f64>,
    r: Vec<f64>,
    d: Vec<f64>,
    next_q: Vec<f64>,
    next_p: Vec<f64>,
    next_forces: Vec<f64>,
    middle: Vec<f64>,
}

impl Midpoint {
    /// At configuration q with velocities v.
    ///
    /// # Errors
    /// [`MidpointError`]: wrong lengths, closures, singular hinges, or forces without a value.
    pub fn new<C: Conservative>(
        model: &Model,
        system: &mut C,
        t: f64,
        q: &[f64],
        v: &[f64],
    ) -> Result<Self, MidpointError<C::Error>> {
        let failed = |cause| MidpointError::Dynamics { t, cause };
        let layout = Layout::new(model);
        let sweep = ArticulatedSweep::new(&layout, q).map_err(failed)?;
        let nv = model.nv();
        if v.len() != nv {
            return Err(failed(DynamicsError::Shape { argument: "v", expected: nv, found: v.len() }));
        }
        let mut forces = vec![0.0; nv];
        let potential = system.evaluate(q, &mut forces).map_err(|cause| MidpointError::Force { t, cause })?;
        let mut momentum = MomentumSweep::new(&layout);
        let (mut p, mut g) = (vec![0.0; nv], vec![0.0; nv]);
        momentum.run(&layout, q, v, &mut p, &mut g);
        let zeros = || vec![0.0; nv];
        Ok(Midpoint {
            state: MidpointState {
                t,
                q: q.to_vec(),
                p,
                forces,
                potential,
                guess: v.to_vec(),
                steps: 0,
                iterations: 0,
            },
            tolerance: 0.0,
            sweep,
            factored: true,
            momentum,
            solve: SolveWorkspace::new(&layout),
            mixing: Mixing::new(nv),
            v: zeros(),
            velocity: zeros(),
            x: zeros(),
            mu: zeros(),
            g,
            y: zeros(),
            r: zeros(),
            d: zeros(),
            next_q: q.to_vec(),
            next_p: zeros(),
            next_forces: zeros(),
            middle: q.to_vec(),
            model: model.clone(),
            layout,
        })
    }
    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }
    /// The compiled model.
    pub fn layout(&self) -> &Layout<f64> {
        &self.layout
    }
    /// The present state: what a checkpoint keeps.
    pub fn state(&self) -> &MidpointState {
        &self.state
    }
    /// Continues from a state of the same model.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`] if a length is not the model's.
    pub fn restore(&mut self, state: MidpointState) -> Result<(), DynamicsError> {
        state.check(&self.model)?;
        self.state = state;
        self.factored = false;
        Ok(())
    }
    /// Sets the momenta, at the present configuration. The next drift starts to iterate from M⁻¹ p, so that what follows
    /// depends on (q, p) alone.
    ///
    /// # Errors
    /// [`DynamicsError`].
    pub fn set_momenta(&mut self, p: &[f64]) -> Result<(), DynamicsError> {
        if p.len() != self.state.p.len() {
            let (expected, found) = (self.state.p.len(), p.len());
            return Err(DynamicsError::Shape { argument: "p", expected, found });
        }
        self.state.p.copy_from_slice(p);
        self.velocity()?;
        self.state.guess.copy_from_slice(&self.velocity);
        Ok(())
    }
    /// Sets the momenta together with M⁻¹ p, where it is known: no solution is needed. The next drift starts to iterate from it.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn set_momenta_and_velocity(&mut self, p: &[f64], v: &[f64]) -> Result<(), DynamicsError> {
        let expected = self.state.p.len();
        for (argument, found) in [("p", p.len()), ("v", v.len())] {
            if found != expected {
                return Err(DynamicsError::Shape { argument, expected, found });
            }
        }
        self.state.p.copy_from_slice(p);
        self.state.guess.copy_from_slice(v);
        Ok(())
    }
    /// Counts the time, steps and iterations of a rejected trajectory, whose state is not kept.
    pub fn count(&mut self, t: f64, steps: u64, iterations: u64) {
        (self.state.t, self.state.steps, self.state.iterations) = (t, steps, iterations);
    }
    /// Evaluates forces and potential energy anew at the present configuration: the system has changed.
    ///
    /// # Errors
    /// [`MidpointError`]; the state is that before.
    pub fn refresh<C: Conservative>(&mut self, system: &mut C) -> Result<(), MidpointError<C::Error>> {
        let (t, s) = (self.state.t, &mut self.state);
        let potential = evaluate(system, &self.layout, t, &s.q, &mut self.next_forces)?;
        std::mem::swap(&mut s.forces, &mut self.next_forces);
        s.potential = potential;
        Ok(())
    }
    /// Goes back to a state of this method: [`Midpoint::restore`] without an allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`] if a length is not the model's.
    pub fn reset(&mut self, state: &MidpointState) -> Result<(), DynamicsError> {
        state.check(&self.model)?;
        self.state.copy(state);
        self.factored = false;
        Ok(())
    }
    /// The factors of M(q) at the present configuration: solutions, ln det M, deviates.
    ///
    /// # Errors
    /// [`DynamicsError::SingularHinge`].
    pub fn factors(&mut self) -> Result<&ArticulatedSweep<f64>, DynamicsError> {
        if !self.factored {
            self.sweep.update(&self.layout, &self.state.q)?;
            self.factored = true;
        }
        Ok(&self.sweep)
    }
    /// The compiled model with [`Midpoint::factors`], for products with M(q) and its roots.
    ///
    /// # Errors
    /// [`DynamicsError::SingularHinge`].
    pub fn layout_and_factors(&mut self) -> Result<(&Layout<f64>, &ArticulatedSweep<f64>), DynamicsError> {
        self.factors()?;
        Ok((&self.layout, &self.sweep))
    }
    /// v = M(q)⁻¹ p.
    ///
    /// # Errors
    /// [`DynamicsError::SingularHinge`].
    pub fn velocity(&mut self) -> Result<&[f64], DynamicsError> {
        self.factors()?;
        self.velocity.copy_from_slice(&self.state.p);
        self.sweep.solve_in_place(&self.layout, &mut self.velocity, &mut self.solve);
        Ok(&self.velocity)
    }
    /// ½ p·M(q)⁻¹ p.
    ///
    /// # Errors
    /// [`DynamicsError::SingularHinge`].
    pub fn kinetic_energy(&mut self) -> Result<f64, DynamicsError> {
        self.velocity()?;
        Ok(0.5 * dot(&self.velocity, &self.state.p))
    }

    /// One step of size h: half a kick, a drift, the forces at its end, half a kick. h may be negative.
    ///
    /// # Errors
    /// [`MidpointError`]; the state is that before the step.
    pub fn step<C: Conservative>(
        &mut self,
        system: &mut C,
        h: f64,
    ) -> Result<DriftInfo, MidpointError<C::Error>> {
        for (p, (start, force)) in self.next_p.iter_mut().zip(self.state.p.iter().zip(&self.state.forces)) {
            *p = start + 0.5 * h * force;
        }
        let info = self.drift(h)?;
        let t = self.state.t + h;
        let potential = evaluate(system, &self.layout, t, &self.next_q, &mut self.next_forces)?;
        let s = &mut self.state;
        for i in 0..s.p.len() {
            s.p[i] = self.next_p[i] + 0.5 * h * self.next_forces[i];
        }
        std::mem::swap(&mut s.q, &mut self.next_q);
        std::mem::swap(&mut s.forces, &mut self.next_forces);
        s.guess.copy_from_slice(&self.v);
        s.potential = potential;
        s.t = t;
        s.steps += 1;
        s.iterations += info.iterations as u64;
        self.factored = false;
        Ok(info)
    }

    /// From (q of the state, `next_p`) to (`next_q`, `next_p`).
    fn drift<E>(&mut self, h: f64) -> Result<DriftInfo, MidpointError<E>> {
        let t = self.state.t;
        self.factors().map_err(|cause| MidpointError::Dynamics { t, cause })?;
        self.v.copy_from_slice(&self.state.guess);
        self.mixing.restart();
        let mut before = f64::INFINITY;
        let mut iterations = 0;
        loop {
            iterations += 1;
            self.middle(h);
            self.end(h, -1.0);
            for (r, p) in self.r.iter_mut().zip(&self.next_p) {
                *r -= p;
            }
            self.d.copy_from_slice(&self.r);
            self.sweep.solve_in_place(&self.layout, &mut self.d, &mut self.solve);
            self.mixing.advance(&mut self.v, &self.r, &self.d);
            let correction = (dot(&self.d, &self.r) / dot(&self.next_p, &self.v)).abs().sqrt();
            // 0/0: a tree at rest.
            let correction =
                if correction.is_nan() && dot(&self.r, &self.r) == 0.0 { 0.0 } else { correction };
            let rounding = correction < 1e4 * f64::EPSILON && correction > 0.5 * before;
            if correction <= self.tolerance.max(4.0 * f64::EPSILON) || rounding {
                self.middle(h);
                self.end(h, 1.0);
                std::mem::swap(&mut self.r, &mut self.next_p);
                self.model.integrate_into(&self.state.q, &self.x, &mut self.next_q);
                return Ok(DriftInfo { iterations, correction });
            }
            before = correction;
            if !correction.is_finite() || iterations == MOST_ITERATIONS {
                let size = |i: &usize| (self.r[*i] * self.d[*i]).abs();
                let worst = (0..self.d.len()).max_by(|a, b| size(a).total_cmp(&size(b)));
                let joint = worst.map_or("", |i| self.layout.joint_of_velocity(i).0).to_string();
                return Err(MidpointError::NotConverged { t, h, iterations, correction, joint });
            }
        }
    }

    /// x, μ and g at the present v.
    fn middle(&mut self, h: f64) {
        for (x, v) in self.x.iter_mut().zip(&self.v) {
            *x = 0.5 * h * v;
        }
        self.model.integrate_into(&self.state.q, &self.x, &mut self.middle);
        self.x.iter_mut().for_each(|x| *x *= 2.0);
        self.momentum.run(&self.layout, &self.middle, &self.v, &mut self.mu, &mut self.g);
    }

    /// B*_{sx} y_s into `r`, s = ∓1: the momentum at the start or the end of the drift.
    fn end(&mut self, h: f64, s: f64) {
        map_momenta(&self.layout, differential_adjoint, 0.5 * s, &self.x, &self.g, &mut self.r);
        for ((y, mu), g) in self.y.iter_mut().zip(&self.mu).zip(&self.r) {
            *y = mu + 0.5 * s * h * g;
        }
        map_momenta(&self.layout, increment_adjoint, s, &self.x, &self.y, &mut self.r);
    }
}

/// Forces and potential energy, if they are finite.
fn evaluate<C: Conservative>(
    system: &mut C,
    layout: &Layout<f64>,
    t: f64,
    q: &[f64],
    forces: &mut [f64],
) -> Result<f64, MidpointError<C::Error>> {
    let potential = system.evaluate(q, forces).map_err(|cause| MidpointError::Force { t, cause })?;
    if let Some(i) = forces.iter().position(|f| !f.is_finite()) {
        return Err(MidpointError::NotFinite { t, joint: Some(layout.joint_of_velocity(i).0.into()) });
    }
    if potential.is_finite() { Ok(potential) } else { Err(MidpointError::NotFinite { t, joint: None }) }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
