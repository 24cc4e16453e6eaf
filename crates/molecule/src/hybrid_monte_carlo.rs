//! Hybrid Monte Carlo: exact sampling of the canonical distribution at any step.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | H | K + U, U_F included where it is | |
//! | T | n steps of [`phipsi_motion::Midpoint`], drifts solved to rounding | notes on integrators, 2 and 3 |
//! | min(1, e^(−ΔH/kT)) | probability of acceptance; ⟨e^(−ΔH/kT)⟩ = 1 | Duane et al. 1987 |
//!
//! T is volume-preserving and reversible, so that the test is exact. Momenta are drawn anew from kT M(q) before each
//! trajectory, and every drift starts to iterate from M⁻¹ p: T is a function of (q, p) alone. A step that cannot be made
//! (a drift that does not converge, forces without a value) refuses the trajectory; the step is never made smaller. Where
//! drifts take many iterations a step back has to return: near configurations with a singular M (three atoms of open angles on a
//! line) the way back may not be found, and a trajectory that is refused one way only would be a bias.

use crate::deviates::Deviates;
use crate::langevin::Exchange;
use phipsi_motion::{Conservative, Midpoint, MidpointError, MidpointState};

/// Iterations of a drift above which its contraction is worse than 0.03 (0.03¹⁰ = ε) and a step back is made: steps that led elsewhere
/// took more (`tests/straight.rs`).
const SLOW: usize = 10;

/// Largest error of a step back, relative to the largest coordinate and momentum: far above rounding and below a second
/// solution of the drift.
const RETURNED: f64 = 1e-9;

/// Trajectories so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Trials {
    /// Trajectories begun.
    pub made: u64,
    /// Accepted ones.
    pub accepted: u64,
    /// Refused ones: a step could not be made, or did not return. Of Langevin dynamics: drifts that did not converge.
    pub refused: u64,
    /// Σ e^(−ΔH/kT) of those that were not refused.
    pub weight: f64,
}

impl Trials {
    /// Fraction of accepted trajectories.
    pub fn acceptance(&self) -> Option<f64> {
        (self.made > 0).then(|| self.accepted as f64 / self.made as f64)
    }
    /// Mean e^(−ΔH/kT) of the trajectories that were not refused: 1 within its error.
    pub fn mean_weight(&self) -> Option<f64> {
        let made = self.made.saturating_sub(self.refused);
        (made > 0).then(|| self.weight / made as f64)
    }
}

/// Vectors of a trajectory.
#[derive(Clone, Debug)]
pub(crate) struct Trajectory {
    start: MidpointState,
    before: MidpointState,
    after: MidpointState,
}

impl Trajectory {
    pub(crate) fn new(method: &Midpoint) -> Self {
        let state = method.state();
        Trajectory { start: state.clone(), before: state.clone(), after: state.clone() }
    }
    /// One trajectory of n steps of size h. Returns the heat of the drawing of momenta. Time and steps count whether it is
    /// accepted or not.
    pub(crate) fn run<C: Conservative>(
        &mut self,
        (method, system): (&mut Midpoint, &mut C),
        (exchange, deviates): (&mut Exchange, &mut Deviates),
        trials: &mut Trials,
        kt: f64,
        (h, n): (f64, u64),
    ) -> Result<f64, MidpointError<C::Error>> {
        let t = method.state().t;
        let failed = |cause| MidpointError::Dynamics { t, cause };
        let (heat, kinetic) = exchange.run(method, deviates, kt, 0.0).map_err(failed)?;
        self.start.copy(method.state());
        let energy = kinetic + self.start.potential;
        let end = self.go(method, system, h, n);
        // Drawn whatever happened, so that the stream's place tells nothing of it.
        let level = deviates.uniform();
        trials.made += 1;
        let is_accepted = match end {
            Some(end) => {
                let weight = (-(end - energy) / kt).exp();
                trials.weight += weight;
                level <= weight
            }
            None => {
                trials.refused += 1;
                false
            }
        };
        if is_accepted {
            trials.accepted += 1;
        } else {
            let iterations = method.state().iterations;
            method.reset(&self.start).map_err(failed)?;
            method.count(t + n as f64 * h, self.start.steps + n, iterations);
            exchange.reverse(method).map_err(failed)?;
        }
        Ok(heat)
    }
    /// The energy at the end; `None` if the trajectory is refused.
    fn go<C: Conservative>(&mut self, method: &mut Midpoint, system: &mut C, h: f64, n: u64) -> Option<f64> {
        for _ in 0..n {
            method.begin_anew().ok()?;
            self.before.copy(method.state());
            let info = method.step(system, h).ok()?;
            if info.iterations > SLOW && !self.returns(method, system, h) {
                return None;
            }
        }
        let energy = method.kinetic_energy().ok()? + method.state().potential;
        energy.is_finite().then_some(energy)
    }
    /// True if a step back from the present state leads to the one before; the present state is kept.
    fn returns<C: Conservative>(&mut self, method: &mut Midpoint, system: &mut C, h: f64) -> bool {
        if !system.has_slow() {
            return method.retraces(h, &self.before, RETURNED);
        }
        self.after.copy(method.state());
        let back = method.begin_anew().is_ok() && method.step(system, -h).is_ok();
        let largest = |x: &[f64]| x.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let near = |a: &[f64], b: &[f64]| {
            let scale = 1.0 + largest(b);
            a.iter().zip(b).all(|(a, b)| (a - b).abs() <= RETURNED * scale)
        };
        let state = method.state();
        let returned = back && near(&state.q, &self.before.q) && near(&state.p, &self.before.p);
        method.reset(&self.after).is_ok() && returned
    }
}
