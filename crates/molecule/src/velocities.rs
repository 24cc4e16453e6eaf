//! Velocities and momenta of the Maxwell–Boltzmann distribution of internal coordinates.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | ξ | independent deviates of unit variance | |
//! | v | √kT (I − HψK)* D^(−½) ξ: covariance kT M⁻¹ | soa.md 3.8 |
//! | p | √kT (I + HφK) D^½ ξ: covariance kT M | notes on integrators, 3 |
//!
//! Equipartition holds for the modal velocities D^½ (I + HφK)* v, not for each hinge by itself.

use crate::atoms::BOLTZMANN;
use crate::deviates::Deviates;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{ArticulatedSweep, Layout};

/// Generalised velocities v ~ N(0, kT M⁻¹), from the factors of M(q), for any model. `kt`: kT in the units of the model's
/// energy, not negative (SI: J); `v`: nv (overwritten). Cost O(n), no allocation.
pub fn sample_velocities(
    layout: &Layout<f64>,
    factors: &ArticulatedSweep<f64>,
    kt: f64,
    deviates: &mut Deviates,
    workspace: &mut SolveWorkspace<f64>,
    v: &mut [f64],
) {
    scaled_deviates(kt, deviates, v);
    factors.multiply_by_inverse_square_root(layout, v, workspace);
}

/// Generalised velocities at a temperature, from the factors of M(q). `v`: nv (overwritten); `temperature`: K, not negative.
/// Cost O(n), no allocation.
pub fn draw_velocities(
    layout: &Layout<f64>,
    factors: &ArticulatedSweep<f64>,
    temperature: f64,
    deviates: &mut Deviates,
    workspace: &mut SolveWorkspace<f64>,
    v: &mut [f64],
) {
    sample_velocities(layout, factors, BOLTZMANN * temperature, deviates, workspace, v);
}

/// Generalised momenta at a temperature, from the factors of M(q); else as [`draw_velocities`].
pub fn draw_momenta(
    layout: &Layout<f64>,
    factors: &ArticulatedSweep<f64>,
    temperature: f64,
    deviates: &mut Deviates,
    workspace: &mut SolveWorkspace<f64>,
    p: &mut [f64],
) {
    scaled_deviates(BOLTZMANN * temperature, deviates, p);
    factors.multiply_by_square_root(layout, p, workspace);
}

fn scaled_deviates(kt: f64, deviates: &mut Deviates, out: &mut [f64]) {
    deviates.fill_normal(out);
    let scale = kt.sqrt();
    out.iter_mut().for_each(|x| *x *= scale);
}

/// 2 K/(n k): the temperature (K) of a kinetic energy (kJ/mol) in n degrees of freedom.
pub fn temperature(kinetic_energy: f64, degrees_of_freedom: usize) -> f64 {
    2.0 * kinetic_energy / (degrees_of_freedom as f64 * BOLTZMANN)
}
