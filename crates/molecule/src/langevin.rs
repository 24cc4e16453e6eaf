//! Langevin dynamics in the metric of the mass matrix: friction and noise on the momenta at fixed configuration.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | O(t) | p ← c p + √(1 − c²) √kT M^½ ξ, c = e^(−γ t) | notes on integrators, 3 |
//! | M^½ ξ, M^(−*½) ξ | (I + HφK) D^½ ξ and (I − HψK)* D^(−½) ξ = M⁻¹ M^½ ξ: the noise of momenta and of velocities | soa.md 3.8 |
//! | OBABO | O(h/2), step of [`phipsi_motion::Midpoint`], O(h/2) | |
//!
//! A drift that does not converge is refused: the momenta are reversed, a map that leaves e^(−H/kT) invariant as the step
//! itself does, and the run goes on.
//!
//! On flexible rings momenta are projected onto the cotangent space of the closures afterwards, which projects the covariance
//! kT M of the noise too.
//!
//! O leaves e^(−K/kT) invariant exactly, whatever h; the step between conserves it to second order. K before and after are
//! known, so that the heat taken from the bath is too: E − heat changes by the error of the steps alone.

use crate::deviates::Deviates;
use phipsi_motion::Midpoint;
use phipsi_recursion::DynamicsError;
use phipsi_recursion::articulated_sweep::SolveWorkspace;

/// Vectors of an exchange of momenta with the bath.
#[derive(Clone, Debug)]
pub(crate) struct Exchange {
    workspace: SolveWorkspace<f64>,
    p: Vec<f64>,
    v: Vec<f64>,
    noise: [Vec<f64>; 2],
}

impl Exchange {
    pub(crate) fn new(method: &Midpoint) -> Self {
        let zeros = vec![0.0; method.model().nv()];
        let workspace = SolveWorkspace::new(method.layout());
        Exchange { workspace, p: zeros.clone(), v: zeros.clone(), noise: [zeros.clone(), zeros] }
    }
    /// O with a given c, at the method's configuration; c = 0 draws the momenta anew. Returns the kinetic energy gained, and
    /// the one that there is. Cost O(n), no allocation.
    pub(crate) fn run(
        &mut self,
        method: &mut Midpoint,
        deviates: &mut Deviates,
        kt: f64,
        c: f64,
    ) -> Result<(f64, f64), DynamicsError> {
        let Exchange { workspace, p, v, noise: [of_p, of_v] } = self;
        v.copy_from_slice(method.velocity()?);
        p.copy_from_slice(&method.state().p);
        let before = 0.5 * dot(p, v);
        let scale = ((1.0 - c * c) * kt).sqrt();
        deviates.fill_normal(of_p);
        of_p.iter_mut().for_each(|x| *x *= scale);
        of_v.copy_from_slice(of_p);
        let (layout, factors) = method.layout_and_factors()?;
        factors.multiply_by_square_root(layout, of_p, workspace);
        factors.multiply_by_inverse_square_root(layout, of_v, workspace);
        for i in 0..p.len() {
            p[i] = c * p[i] + of_p[i];
            v[i] = c * v[i] + of_v[i];
        }
        method.set_momenta_and_velocity(p, v)?;
        // As they were set: in the cotangent space of flexible rings, and zero about still axes.
        let set = method.state();
        let after = 0.5 * dot(&set.p, &set.guess);
        Ok((after - before, after))
    }
    /// Reverses the momenta that were set last, at the configuration that the method has gone back to.
    pub(crate) fn reverse(&mut self, method: &mut Midpoint) -> Result<(), DynamicsError> {
        self.p.iter_mut().chain(&mut self.v).for_each(|x| *x = -*x);
        method.set_momenta_and_velocity(&self.p, &self.v)
    }
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
