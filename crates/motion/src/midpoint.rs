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
//!
//! With loops (RATTLE): multipliers at q, B*_{−x} y₋ = p̂ + J(q)* λ, put the end of the drift on the closures, Φ(q⁺) = 0, and
//! the momenta at its end are projected onto the cotangent space there, J M⁻¹ p = 0. Still symplectic on the closures,
//! reversible, of second order. The iteration is M d = r + J* λ, J d = Φ(q⁺)/h with the factors at q: d depends on v alone, so
//! that the same mixing serves.
//!
//! Multiple time steps are in `midpoint/multiple_steps.rs`.
//!
//! Momenta about still axes ([`Model::still_axes`]) are zero. The discrete Lagrangian does not change when such a body is turned
//! about its axis, so that the drift keeps them; their rounding is taken away after each step.

use crate::conservative::{Conservative, Part, evaluate};
use crate::midpoint_error::MidpointError;
use crate::midpoint_maps::{differential_adjoint, increment_adjoint, map_momenta};
use crate::midpoint_mixing::Mixing;
use crate::midpoint_momentum::MomentumSweep;
use crate::system::Projected;
use phipsi_closure::{ClosedMomenta, Conditions};
use phipsi_model::{Model, StillAxis};
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{ArticulatedSweep, DynamicsError, Layout};

mod multiple_steps;
mod retrace;

/// A drift that has not converged by then does not: the contraction would have to be worse than 0.8.
const MOST_ITERATIONS: usize = 100;

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
    /// Potential energy at q, slow part included.
    pub potential: f64,
    /// Generalised forces of the slow part at q, nv; empty where there is none.
    #[cfg_attr(feature = "serde", serde(default))]
    pub slow: Vec<f64>,
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
            ("slow", if self.slow.is_empty() { 0 } else { nv }, self.slow.len()),
        ] {
            if expected != found {
                return Err(DynamicsError::Shape { argument, expected, found });
            }
        }
        Ok(())
    }
    /// Becomes another state of the same model, without an allocation.
    pub fn copy(&mut self, other: &Self) {
        let MidpointState { t, q, p, forces, potential, slow, guess, steps, iterations } = other;
        for (to, from) in [
            (&mut self.q, q),
            (&mut self.p, p),
            (&mut self.forces, forces),
            (&mut self.slow, slow),
            (&mut self.guess, guess),
        ] {
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
    /// Steps with the fast forces in a step, where the system has slow ones; 0 is 1.
    pub substeps: usize,
    sweep: ArticulatedSweep<f64>,
    /// The factors are those of the present q.
    factored: bool,
    /// Loops, if there are any, and whether their factors are those of the present q.
    closed: Option<Box<ClosedMomenta<f64>>>,
    placed: bool,
    /// Axes about which bodies do not turn.
    still: Vec<StillAxis>,
    /// The state before a step of several.
    saved: Option<Box<MidpointState>>,
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
    /// At configuration q with velocities v; with loops, at the nearest ones that keep the closures.
    ///
    /// # Errors
    /// [`MidpointError`]: wrong lengths, loops that do not close from here, singular hinges, or forces without a value.
    pub fn new<C: Conservative>(
        model: &Model,
        system: &mut C,
        t: f64,
        q: &[f64],
        v: &[f64],
    ) -> Result<Self, MidpointError<C::Error>> {
        let failed = |cause| MidpointError::Dynamics { t, cause };
        let layout = Layout::new(&model.clone().without_closures());
        let (nv, mut q) = (model.nv(), q.to_vec());
        let mut closed = None;
        if !(model.closures().is_empty() && model.couplings().is_empty()) {
            let of_loops = |cause| MidpointError::of_loops(t, cause);
            let mut momenta = ClosedMomenta::new(model).map_err(of_loops)?;
            momenta.dynamics().project_position(&mut q, &Conditions::default()).map_err(of_loops)?;
            closed = Some(Box::new(momenta));
        }
        let sweep = ArticulatedSweep::new(&layout, &q).map_err(failed)?;
        if v.len() != nv {
            return Err(failed(DynamicsError::Shape { argument: "v", expected: nv, found: v.len() }));
        }
        let mut forces = vec![0.0; nv];
        let potential =
            system.evaluate(&q, &mut forces).map_err(|cause| MidpointError::Force { t, cause })?;
        let mut momentum = MomentumSweep::new(&layout);
        let (mut p, mut g) = (vec![0.0; nv], vec![0.0; nv]);
        momentum.run(&layout, &q, v, &mut p, &mut g);
        let zeros = || vec![0.0; nv];
        let state = MidpointState {
            t,
            q: q.clone(),
            p: p.clone(),
            forces,
            potential,
            slow: Vec::new(),
            guess: v.to_vec(),
            steps: 0,
            iterations: 0,
        };
        let mut method = Midpoint {
            state,
            tolerance: 0.0,
            substeps: 1,
            sweep,
            factored: true,
            closed,
            placed: false,
            still: model.still_axes().collect(),
            saved: None,
            momentum,
            solve: SolveWorkspace::new(&layout),
            mixing: Mixing::new(nv),
            v: zeros(),
            velocity: v.to_vec(),
            x: zeros(),
            mu: zeros(),
            g,
            y: zeros(),
            r: zeros(),
            d: zeros(),
            next_q: q.clone(),
            next_p: zeros(),
            next_forces: zeros(),
            middle: q,
            model: model.clone(),
            layout,
        };
        if method.closed.is_some() || !method.still.is_empty() {
            method.set_momenta(&p).map_err(failed)?;
        }
        method.find_slow(system)?;
        Ok(method)
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
        self.moved();
        Ok(())
    }
    /// Sets the momenta, at the present configuration; with loops, their part in the cotangent space of the closures; those about
    /// still axes are zero. The next drift starts to iterate from M⁻¹ p, so that what follows depends on (q, p) alone.
    ///
    /// # Errors
    /// [`DynamicsError`].
    pub fn set_momenta(&mut self, p: &[f64]) -> Result<(), DynamicsError> {
        if p.len() != self.state.p.len() {
            let (expected, found) = (self.state.p.len(), p.len());
            return Err(DynamicsError::Shape { argument: "p", expected, found });
        }
        self.loops()?;
        self.y.copy_from_slice(p);
        self.still.iter().for_each(|axis| axis.remove(&mut self.y));
        if let Some(closed) = &mut self.closed {
            closed.solve(&self.y, None, &mut self.velocity, &mut self.state.p)?;
        } else {
            self.state.p.copy_from_slice(&self.y);
            self.velocity()?;
        }
        self.state.guess.copy_from_slice(&self.velocity);
        Ok(())
    }
    /// Sets the momenta together with M⁻¹ p, where it is known: without loops no solution is needed. The next drift starts to
    /// iterate from it.
    ///
    /// # Errors
    /// [`DynamicsError`].
    pub fn set_momenta_and_velocity(&mut self, p: &[f64], v: &[f64]) -> Result<(), DynamicsError> {
        let expected = self.state.p.len();
        for (argument, found) in [("p", p.len()), ("v", v.len())] {
            if found != expected {
                return Err(DynamicsError::Shape { argument, expected, found });
            }
        }
        if self.closed.is_some() {
            return self.set_momenta(p);
        }
        self.state.p.copy_from_slice(p);
        self.state.guess.copy_from_slice(v);
        for axis in &self.still {
            axis.remove(&mut self.state.p);
            axis.remove(&mut self.state.guess);
        }
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
        let potential = evaluate(system, Part::Fast, &self.layout, t, &s.q, &mut self.next_forces)?;
        let mut slow = Vec::new();
        let mut of_slow = 0.0;
        if system.has_slow() {
            slow = vec![0.0; s.p.len()];
            of_slow = evaluate(system, Part::Slow, &self.layout, t, &s.q, &mut slow)?;
        }
        std::mem::swap(&mut s.forces, &mut self.next_forces);
        (s.potential, s.slow) = (potential + of_slow, slow);
        Ok(())
    }
    /// Goes back to a state of this method: [`Midpoint::restore`] without an allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`] if a length is not the model's.
    pub fn reset(&mut self, state: &MidpointState) -> Result<(), DynamicsError> {
        state.check(&self.model)?;
        self.state.copy(state);
        self.moved();
        Ok(())
    }
    /// The state is another one.
    fn moved(&mut self) {
        (self.factored, self.placed) = (false, false);
    }
    /// Degrees of freedom: nv, less the independent rows of the closures at the present configuration and the still axes.
    ///
    /// # Errors
    /// [`DynamicsError::SingularHinge`].
    pub fn degrees_of_freedom(&mut self) -> Result<usize, DynamicsError> {
        Ok(self.model.nv() - self.still.len() - self.loops()?.map_or(0, |closed| closed.rank()))
    }
    /// What is open of the closures and of their rates; `None` for a tree.
    ///
    /// # Errors
    /// [`DynamicsError::SingularHinge`].
    pub fn residual(&mut self) -> Result<Option<Projected>, DynamicsError> {
        self.velocity()?;
        let Some(closed) = &mut self.closed else { return Ok(None) };
        let [position, velocity] = closed.residual(&self.state.q, &self.velocity)?;
        Ok(Some(Projected { position, velocity, energy_removed: 0.0 }))
    }
    /// The loops with factors at the present configuration; `None` for a tree.
    ///
    /// # Errors
    /// [`DynamicsError::SingularHinge`].
    pub fn loops(&mut self) -> Result<Option<&mut ClosedMomenta<f64>>, DynamicsError> {
        if let (Some(closed), false) = (&mut self.closed, self.placed) {
            closed.place(&self.state.q)?;
            self.placed = true;
        }
        Ok(self.closed.as_deref_mut())
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

    /// Half a kick, a drift, the forces at its end, half a kick.
    fn step_once<C: Conservative>(
        &mut self,
        system: &mut C,
        h: f64,
    ) -> Result<DriftInfo, MidpointError<C::Error>> {
        for (p, (start, force)) in self.next_p.iter_mut().zip(self.state.p.iter().zip(&self.state.forces)) {
            *p = start + 0.5 * h * force;
        }
        let info = self.drift(h)?;
        let t = self.state.t + h;
        let potential = evaluate(system, Part::Fast, &self.layout, t, &self.next_q, &mut self.next_forces)?;
        for (p, force) in self.next_p.iter_mut().zip(&self.next_forces) {
            *p += 0.5 * h * force;
        }
        if let Some(closed) = &mut self.closed {
            self.placed = false;
            let placed = closed.place(&self.next_q);
            placed
                .and_then(|()| closed.solve(&self.next_p, None, &mut self.velocity, &mut self.y))
                .map_err(|cause| MidpointError::Dynamics { t, cause })?;
            std::mem::swap(&mut self.next_p, &mut self.y);
        }
        self.still.iter().for_each(|axis| axis.remove(&mut self.next_p));
        let s = &mut self.state;
        std::mem::swap(&mut s.p, &mut self.next_p);
        std::mem::swap(&mut s.q, &mut self.next_q);
        std::mem::swap(&mut s.forces, &mut self.next_forces);
        s.guess.copy_from_slice(&self.v);
        s.potential = potential;
        s.t = t;
        s.steps += 1;
        s.iterations += info.iterations as u64;
        self.factored = false;
        self.placed = self.closed.is_some();
        Ok(info)
    }

    /// From (q of the state, `next_p`) to (`next_q`, `next_p`).
    fn drift<E>(&mut self, h: f64) -> Result<DriftInfo, MidpointError<E>> {
        let t = self.state.t;
        let failed = |cause| MidpointError::Dynamics { t, cause };
        let floor = self.begin_drift().map_err(failed)?;
        let (mut before, mut opened) = (f64::INFINITY, f64::INFINITY);
        let mut iterations = 0;
        loop {
            iterations += 1;
            self.middle(h);
            self.end(h, -1.0);
            for (r, p) in self.r.iter_mut().zip(&self.next_p) {
                *r -= p;
            }
            let is_closed = self.correct(h, &mut opened).map_err(failed)?;
            self.mixing.advance(&mut self.v, &self.r, &self.d);
            let (square, speed) = (dot(&self.d, &self.r), dot(&self.next_p, &self.v).abs());
            let size = square.abs().sqrt();
            // 0/0: a tree at rest.
            let still = speed == 0.0 && dot(&self.r, &self.r) == 0.0;
            let correction = if still { 0.0 } else { (square / speed).abs().sqrt() };
            let limit = (1e4 * f64::EPSILON * speed.sqrt()).max(floor);
            let rounding = size <= limit && size > 0.5 * before;
            if is_closed && (correction <= self.tolerance.max(4.0 * f64::EPSILON) || rounding) {
                self.middle(h);
                self.end(h, 1.0);
                std::mem::swap(&mut self.r, &mut self.next_p);
                self.model.integrate_into(&self.state.q, &self.x, &mut self.next_q);
                return Ok(DriftInfo { iterations, correction });
            }
            before = size;
            if !size.is_finite() || iterations == MOST_ITERATIONS {
                let size = |i: &usize| (self.r[*i] * self.d[*i]).abs();
                let worst = (0..self.d.len()).max_by(|a, b| size(a).total_cmp(&size(b)));
                let joint = worst.map_or("", |i| self.layout.joint_of_velocity(i).0).to_string();
                return Err(MidpointError::NotConverged { t, h, iterations, correction, joint });
            }
        }
    }

    /// Factors and first guess. Returns a correction, in the metric of M, that rounding of p̂ explains: where loops carry most
    /// of p̂ it is large beside the velocity.
    fn begin_drift(&mut self) -> Result<f64, DynamicsError> {
        self.v.copy_from_slice(&self.state.guess);
        self.mixing.restart();
        self.factors()?;
        if self.loops()?.is_none() {
            return Ok(0.0);
        }
        self.y.copy_from_slice(&self.next_p);
        self.sweep.solve_in_place(&self.layout, &mut self.y, &mut self.solve);
        Ok(1e3 * f64::EPSILON * dot(&self.y, &self.next_p).abs().sqrt())
    }

    /// From r at the present v, the correction d and its momentum r = M d; false while the end of the drift is off the closures.
    /// `opened`: the residual at the last iterate.
    fn correct(&mut self, h: f64, opened: &mut f64) -> Result<bool, DynamicsError> {
        let Some(closed) = &mut self.closed else {
            self.d.copy_from_slice(&self.r);
            self.sweep.solve_in_place(&self.layout, &mut self.d, &mut self.solve);
            return Ok(true);
        };
        self.model.integrate_into(&self.state.q, &self.x, &mut self.next_q);
        let open = closed.look(&self.next_q)?;
        // A residual that is rounding moves v by ε/h and more: from there on it is left alone.
        let is_closed = open.is_closed() || (open.may_be_rounding() && open.weighted > 0.5 * *opened);
        *opened = open.weighted;
        self.y.copy_from_slice(&self.r);
        closed.solve(&self.y, (!is_closed).then_some(1.0 / h), &mut self.d, &mut self.r)?;
        Ok(is_closed)
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

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
