//! Projection of velocities and positions onto the closures, and assembly from a rough guess.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | δ(r) | the increment of least kinetic energy with Jδ = r: the sweeps without forces and biases, g = r | Gauss' principle |
//! | Φ | residual of the positions, angles times the scene's length L | |
//! | μ | damping: rows may be missed by s at the cost ½ s²/μ | Levenberg |
//!
//! All three are the factorisation of forward dynamics with other right-hand sides. Degrees of freedom that are prescribed stay
//! as they are.

use crate::closed_dynamics::{ClosedDynamics, Conditions, largest};
use crate::compiled::Number;
use crate::error::{ClosureError, check_length};
use crate::factors::Regard;
use crate::frames::weight;
use crate::solution::Load;
use phipsi_spatial::Vec3;

/// Iterations of a projection; it converges quadratically, or not.
const MOST_PROJECTIONS: usize = 12;

/// Trials of an assembly, accepted or not.
const MOST_TRIALS: usize = 200;

/// What a projection of velocities did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VelocityProjection {
    /// Largest residual before and after, rad/s or m/s.
    pub residual: [f64; 2],
    /// Kinetic energy of the increment, J: what consistent velocities lose.
    pub energy_removed: f64,
    /// Independent rows.
    pub rank: usize,
}

/// What a projection of positions or an assembly did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionProjection {
    /// Largest residual before and after, rad or m.
    pub residual: [f64; 2],
    /// Iterations.
    pub iterations: usize,
}

impl<T: Number> ClosedDynamics<T> {
    /// Makes velocities consistent: v += δ(γ̇ − Jv), the smallest change in kinetic energy. `q`: nq, `v`: nv.
    ///
    /// # Cost
    /// As one forward dynamics.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`].
    pub fn project_velocity(
        &mut self,
        q: &[T],
        v: &mut [T],
        conditions: &Conditions<'_, T>,
    ) -> Result<VelocityProjection, ClosureError> {
        check_length("v", v, self.layout.nv())?;
        self.set_position(q, conditions)?;
        let before = self.set_rates(v, conditions);
        let active = conditions.prescribed.map(|p| p.active);
        self.check_passive(active)?;
        let trees = (&self.layout, &self.tree);
        self.factors.update(&self.structure, trees, &self.frames, active, Regard::Error)?;
        self.solution.clear();
        for l in &self.structure.loops {
            for (i, row) in l.rows.clone().enumerate() {
                self.solution.g[row] = (-(weight(&self.structure, l, i) * self.rates[row])).to_arithmetic();
            }
        }
        let mut twice = T::zero();
        self.increment();
        // δ*𝓜δ = δ*J*λ = r*λ.
        for l in &self.structure.loops {
            for (i, row) in l.rows.clone().enumerate() {
                let lambda = T::from_arithmetic(self.solution.lambda[row]);
                twice -= weight(&self.structure, l, i) * self.rates[row] * lambda;
            }
        }
        for (v, step) in v.iter_mut().zip(&self.step) {
            *v += *step;
        }
        let after = self.set_rates(v, conditions);
        let energy_removed = 0.5 * twice.to_f64();
        Ok(VelocityProjection { residual: [before, after], energy_removed, rank: self.factors.rank.rank })
    }
    /// δ of the right-hand side that is set.
    fn increment(&mut self) {
        let load = Load { tau: None, prescribed: None, ground: Vec3::zero() };
        self.solution.run(&self.structure, &self.tree, &self.frames, &self.factors, &load, &mut self.step);
    }
    /// Sets the right-hand side −Φ.
    fn oppose_residual(&mut self) {
        self.solution.clear();
        for l in &self.structure.loops {
            for (i, row) in l.rows.clone().enumerate() {
                let residual = weight(&self.structure, l, i) * self.frames.residual[row];
                self.solution.g[row] = (-residual).to_arithmetic();
            }
        }
    }
    /// |Φ|² and the largest |Φ| of all rows, or of those that the last factorisation found independent.
    fn openness(&self, independent: bool) -> (f64, f64) {
        let (mut square, mut most) = (0.0f64, 0.0f64);
        for l in &self.structure.loops {
            for (i, row) in l.rows.clone().enumerate().filter(|r| !(independent && self.factors.dropped[r.1]))
            {
                let x = (weight(&self.structure, l, i) * self.frames.residual[row]).abs().to_f64();
                square += x * x;
                // A residual that is no number is as open as can be.
                most = if x.is_finite() { most.max(x) } else { f64::INFINITY };
            }
        }
        (square, most)
    }
    /// What rounding leaves open: ε L per body of the longest path. Elastic bodies turn what is left open into strain.
    fn closed(&self) -> f64 {
        T::EPSILON * self.length() * self.depth().max(1) as f64
    }
    fn not_closed(&self, iterations: usize) -> ClosureError {
        let of = |row: usize| self.structure.loops.iter().find(|l| l.rows.contains(&row));
        let worst = (0..self.rows()).fold(0, |worst, row| {
            let larger = self.frames.residual[row].abs() > self.frames.residual[worst].abs();
            if larger { row } else { worst }
        });
        ClosureError::NotClosed {
            closure: of(worst).map(|l| l.name.clone()).unwrap_or_default(),
            residual: largest(&self.frames.residual),
            required: self.closed(),
            iterations,
        }
    }
    /// Makes positions consistent: q ← q ∘ δ(γ − Φ), again until Φ is rounding. For states near the closures, as after a step
    /// of an integrator; converges quadratically.
    ///
    /// # Errors
    /// [`ClosureError::NotClosed`] after 12 iterations: [`Self::assemble`] goes further; [`ClosureError::Dynamics`].
    pub fn project_position(
        &mut self,
        q: &mut [T],
        conditions: &Conditions<'_, T>,
    ) -> Result<PositionProjection, ClosureError> {
        self.set_position(q, conditions)?;
        let active = conditions.prescribed.map(|p| p.active);
        self.check_passive(active)?;
        let before = largest(&self.frames.residual);
        let mut last = f64::INFINITY;
        for iterations in 0..=MOST_PROJECTIONS {
            let (_, open) = self.openness(false);
            // Redundant rows keep what the model's numbers contradict each other by, however often the others are closed.
            let (_, solvable) = self.openness(iterations > 0);
            let still = iterations > 0 && (solvable <= self.closed() || solvable > 0.5 * last);
            if open <= self.closed() || (open < self.stalled(q) && still) {
                let residual = [before, largest(&self.frames.residual)];
                return Ok(PositionProjection { residual, iterations });
            }
            last = solvable;
            if iterations == MOST_PROJECTIONS {
                break;
            }
            let trees = (&self.layout, &self.tree);
            self.factors.update(&self.structure, trees, &self.frames, active, Regard::Projection)?;
            self.oppose_residual();
            self.increment();
            self.advance(q);
            self.set_position(q, conditions)?;
        }
        Err(self.not_closed(MOST_PROJECTIONS))
    }
    /// A residual from here on may be rounding of a long path, of the model's numbers, or of coordinates that have grown large, as
    /// angles of many turns.
    fn stalled(&self, q: &[T]) -> f64 {
        let relative = (512.0 * T::EPSILON).max(self.factors.data_error).max(8.0 * T::EPSILON * largest(q));
        relative * self.length().max(1.0) * self.depth().max(1) as f64
    }
    /// q ← q ∘ step.
    fn advance(&mut self, q: &mut [T]) {
        self.model.integrate_into(q, &self.step, &mut self.trial);
        q.copy_from_slice(&self.trial);
    }
    /// Closes the loops from a rough guess: Levenberg's iteration in the metric of the mass matrix, without any decision on rank.
    ///
    /// # Errors
    /// [`ClosureError::NotClosed`] if the residual no longer falls: the loops cannot be closed from here, and `q` is as near as
    /// it came; [`ClosureError::Dynamics`].
    pub fn assemble(
        &mut self,
        q: &mut [T],
        conditions: &Conditions<'_, T>,
    ) -> Result<PositionProjection, ClosureError> {
        self.set_position(q, conditions)?;
        let active = conditions.prescribed.map(|p| p.active);
        self.check_passive(active)?;
        let before = largest(&self.frames.residual);
        let (mut square, mut open) = self.openness(false);
        let mut last = f64::INFINITY;
        let mut mu = 1e-3f64;
        for trial in 0..MOST_TRIALS {
            if open <= self.closed() || (open < self.stalled(q) && open > 0.5 * last) {
                let residual = [before, largest(&self.frames.residual)];
                return Ok(PositionProjection { residual, iterations: trial });
            }
            if mu > 1e8 {
                return Err(self.not_closed(trial));
            }
            let slack = Regard::Slack(T::splat(mu.sqrt()));
            let trees = (&self.layout, &self.tree);
            self.factors.update(&self.structure, trees, &self.frames, active, slack)?;
            self.oppose_residual();
            self.increment();
            self.origin.copy_from_slice(q);
            self.advance(q);
            self.set_position(q, conditions)?;
            let (next, widest) = self.openness(false);
            // Near rounding a step may fall short by rounding.
            if next < square || widest <= self.closed() {
                (square, last, open) = (next, open, widest);
                mu = (mu / 10.0).max(1e-24);
            } else {
                q.copy_from_slice(&self.origin);
                self.set_position(q, conditions)?;
                if open < self.stalled(q) {
                    last = open;
                }
                mu *= 10.0;
            }
        }
        Err(self.not_closed(MOST_TRIALS))
    }
}
