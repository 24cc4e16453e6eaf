//! Where a minimisation moves: all configurations of a tree, or those that keep closures.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | f, d | forces; a direction of velocities | |
//! | f + J*λ | the part of f along the closures: J M⁻¹ (f + J*λ) = 0 | `closure`, `momenta.rs` |
//! | M d = f + J*λ, J d = 0 | solution on the closures; of f = M d: the part of d along them | the same |

use phipsi_closure::{ClosedMomenta, ClosureError, Conditions};
use phipsi_model::Model;
use phipsi_motion::midpoint_momentum::MomentumSweep;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{ArticulatedSweep, DynamicsError, Layout};

pub(crate) struct Surface<'a> {
    model: &'a Model,
    layout: &'a Layout<f64>,
    sweep: ArticulatedSweep<f64>,
    workspace: SolveWorkspace<f64>,
    momentum: MomentumSweep<f64>,
    /// Closures, with their vectors.
    closed: Option<(ClosedMomenta<f64>, [Vec<f64>; 2])>,
    mu: Vec<f64>,
    unused: Vec<f64>,
}

impl<'a> Surface<'a> {
    /// `layout`: of the model without its closures. `q` is put on the closures.
    pub(crate) fn new(
        model: &'a Model,
        layout: &'a Layout<f64>,
        q: &mut [f64],
    ) -> Result<Self, ClosureError> {
        let zeros = || vec![0.0; model.nv()];
        let mut closed = None;
        if !(model.closures().is_empty() && model.couplings().is_empty()) {
            let mut momenta = ClosedMomenta::new(model)?;
            momenta.dynamics().project_position(q, &Conditions::default())?;
            momenta.place(q)?;
            closed = Some((momenta, [zeros(), zeros()]));
        }
        Ok(Surface {
            model,
            layout,
            sweep: ArticulatedSweep::new(layout, q)?,
            workspace: SolveWorkspace::new(layout),
            momentum: MomentumSweep::new(layout),
            closed,
            mu: zeros(),
            unused: zeros(),
        })
    }
    /// Factors at a configuration.
    pub(crate) fn place(&mut self, q: &[f64]) -> Result<(), DynamicsError> {
        match &mut self.closed {
            Some((momenta, _)) => momenta.place(q),
            None => self.sweep.update(self.layout, q),
        }
    }
    /// f ← f + J*λ, at a configuration.
    pub(crate) fn along(&mut self, q: &[f64], f: &mut [f64]) -> Result<(), DynamicsError> {
        if let Some((momenta, [x, part])) = &mut self.closed {
            momenta.place(q)?;
            momenta.solve(f, None, x, part)?;
            f.copy_from_slice(part);
        }
        Ok(())
    }
    /// f ← M⁻¹ (f + J*λ), where the factors are.
    pub(crate) fn solve(&mut self, f: &mut [f64]) {
        match &mut self.closed {
            // Lengths are the model's, and nothing else fails.
            Some((momenta, [x, part])) => {
                if momenta.solve(f, None, x, part).is_ok() {
                    f.copy_from_slice(x);
                }
            }
            None => self.sweep.solve_in_place(self.layout, f, &mut self.workspace),
        }
    }
    /// d ← its part along the closures, at the configuration of the factors; returns d·M d.
    pub(crate) fn tangent(&mut self, q: &[f64], d: &mut [f64]) -> f64 {
        self.momentum.run(self.layout, q, d, &mut self.mu, &mut self.unused);
        if let Some((momenta, [x, part])) = &mut self.closed
            && momenta.solve(&self.mu, None, x, part).is_ok()
        {
            d.copy_from_slice(x);
            self.mu.copy_from_slice(part);
        }
        d.iter().zip(&self.mu).map(|(d, mu)| d * mu).sum()
    }
    /// q ∘ step, put on the closures; false where that does not go. The factors are lost.
    pub(crate) fn retract(&mut self, q: &[f64], step: &[f64], out: &mut [f64]) -> bool {
        self.model.integrate_into(q, step, out);
        match &mut self.closed {
            Some((momenta, _)) => momenta.dynamics().project_position(out, &Conditions::default()).is_ok(),
            None => true,
        }
    }
}
