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

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::Random;
    use phipsi_reference::generate::Case;
    use phipsi_reference::loops::{TOLERANCE, closed_again, closed_case};
    use phipsi_reference::sensitivity::{sensitivity, widened};
    use phipsi_reference::{along_closures, mass_matrix, solve_mass_matrix, tangent_part};
    use phipsi_spatial::Dd;

    fn largest<'a>(x: impl IntoIterator<Item = &'a f64>) -> f64 {
        x.into_iter().fold(0.0, |most, x| most.max(x.abs()))
    }

    /// On generated mechanisms with loops of any rank, against the dense equations in double-double numbers.
    #[test]
    fn forces_and_directions_are_those_of_the_dense_equations() {
        let mut closed_ones = 0;
        for seed in 0..40 {
            let generated = closed_case(seed);
            let (case, drafts) = (&generated.case, &generated.drafts);
            let n = case.model.nv();
            // x and f + J*λ of the forces τ, and the part of v along the closures.
            let dense = |case: &Case| -> Vec<Dd> {
                let again = closed_again(case, drafts).case;
                let (q, f, d) = (widened(&again.q), widened(&case.tau), widened(&case.a));
                let [x, p] = along_closures(&again.model, &q, &f, TOLERANCE).unwrap();
                let along = tangent_part(&again.model, &q, &d, TOLERANCE).unwrap();
                [x, p, along].concat()
            };
            let (exact, size) = sensitivity(case, 3, seed, dense);
            // Closures that hold to rounding of their frames: exact again at the case's own numbers.
            let q = widened(&case.q);
            let [x, p] = along_closures(&case.model, &q, &widened(&case.tau), TOLERANCE).unwrap();
            let along = tangent_part(&case.model, &q, &widened(&case.a), TOLERANCE).unwrap();
            let model = &case.model;
            let layout = Layout::new(&model.clone().without_closures());
            let mut start = case.q.clone();
            let mut surface = Surface::new(model, &layout, &mut start).unwrap();
            surface.place(&case.q).unwrap();
            let (mut f, mut solved, mut d) = (case.tau.clone(), case.tau.clone(), case.a.clone());
            surface.along(&case.q, &mut f).unwrap();
            surface.solve(&mut solved);
            let square = surface.tangent(&case.q, &mut d);
            let rows: usize =
                model.closures().iter().map(|c| c.kind.rows()).sum::<usize>() + model.couplings().len();
            closed_ones += usize::from(rows > 0);
            // n·ε·κ, κ of each of the three vectors as a whole; a factor for the products of a solution and its refinement.
            let unit = 64.0 * (model.len() + n + rows) as f64 * f64::EPSILON;
            // What loops take away from the open tree's is as uncertain as that.
            let free = solve_mass_matrix(model, &case.q, &case.tau).unwrap();
            let open = [largest(&free), largest(&case.tau), largest(&case.a)];
            let kappa = |k: usize| {
                let own = exact[k * n..(k + 1) * n].iter().map(|x| &x.hi);
                largest(&size[k * n..(k + 1) * n]).max(largest(own)).max(open[k])
            };
            for (k, (own, want)) in [(&solved, &x), (&f, &p), (&d, &along)].into_iter().enumerate() {
                let off = own.iter().zip(want).map(|(a, b)| (a - b.hi).abs()).fold(0.0, f64::max);
                assert!(off <= unit * kappa(k), "seed {seed}, vector {k}: {off:e} {:e}", unit * kappa(k));
            }
            let m = mass_matrix(model, &case.q);
            let moved: f64 = (0..n).map(|i| (0..n).map(|j| d[i] * m[(i, j)] * d[j]).sum::<f64>()).sum();
            let terms: f64 =
                (0..n).map(|i| (0..n).map(|j| (d[i] * m[(i, j)] * d[j]).abs()).sum::<f64>()).sum();
            let whole = kappa(2) * largest(m.iter()) * kappa(2);
            assert!((square - moved).abs() <= unit * (terms + whole), "seed {seed}: {square} {moved}");
        }
        assert!(closed_ones > 20, "{closed_ones}");
    }

    /// A step along the closures is put on them within second order.
    #[test]
    fn steps_end_on_the_closures() {
        let mut compared = 0;
        for seed in 0..60 {
            let generated = closed_case(seed);
            let (model, n) = (&generated.case.model, generated.case.model.nv());
            let layout = Layout::new(&model.clone().without_closures());
            let mut q = generated.case.q.clone();
            let mut surface = Surface::new(model, &layout, &mut q).unwrap();
            let mut random = Random::new(seed);
            let mut d: Vec<f64> = (0..n).map(|_| random.signed()).collect();
            surface.place(&q).unwrap();
            surface.tangent(&q, &mut d);
            let size = largest(&d);
            if model.closures().is_empty() || size < 1e-6 {
                continue;
            }
            d.iter_mut().for_each(|x| *x *= 1e-3 / size);
            let mut off = |factor: f64| {
                let step: Vec<f64> = d.iter().map(|x| factor * x).collect();
                let mut out = q.clone();
                assert!(surface.retract(&q, &step, &mut out), "seed {seed}");
                largest(&model.difference(&model.integrate(&q, &step), &out))
            };
            let (whole, half) = (off(1.0), off(0.5));
            // What is left of 1e-3 in second order: by a factor of 4, or at rounding of the projection.
            assert!(half <= 0.35 * whole + 1e-10, "seed {seed}: {whole:e} {half:e}");
            compared += usize::from(whole > 1e-9);
        }
        assert!(compared > 3, "{compared}");
    }
}
