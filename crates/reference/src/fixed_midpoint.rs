//! Kick – variational midpoint drift – kick, from its discrete Lagrangian; and where a function passes zero inside a step.
//!
//! | symbol | meaning |
//! |---|---|
//! | L(q₀, q₁) | h K(q₀ ∘ τ(x/2), x/h) with q₀ ∘ τ(x) = q₁ |
//! | p₀, p₁ | −∂L/∂q₀, ∂L/∂q₁ along the joints' increments: dual numbers |
//!
//! A step: p̂ = p + (h/2) Q(q₀), q₁ with p₀ = p̂, p₁ + (h/2) Q(q₁).

use crate::dual::Dual;
use crate::energy::kinetic_energy;
use crate::inverse_dynamics_derivatives::{fixed, seeded, tangent};
use crate::mass_matrix_inverse::solve_mass_matrix;
use phipsi_model::Model;
use phipsi_spatial::Real;

/// Iterations after which a drift does not converge.
const MOST_ITERATIONS: usize = 400;

/// Generalised forces at a configuration.
pub type Forces<'a, T> = &'a dyn Fn(&[T]) -> Vec<T>;

/// One step of size h from (q, p); `None` where the drift does not converge, or M is not positive definite.
pub fn midpoint_step<T: Real>(
    model: &Model,
    (q, p): (&[T], &[T]),
    h: T,
    forces: Forces<'_, T>,
) -> Option<(Vec<T>, Vec<T>)> {
    let half = h * T::splat(0.5);
    let kicked = kick(p, &forces(q), half);
    let mut v = solve_mass_matrix(model, q, &kicked).ok()?;
    let mut before = f64::INFINITY;
    for _ in 0..MOST_ITERATIONS {
        let x: Vec<T> = v.iter().map(|v| *v * h).collect();
        let end = model.integrate(q, &x);
        let start: Vec<T> = slopes(model, q, |q0| lagrangian(model, q0, &fixed(&end), h));
        let off: Vec<T> = kicked.iter().zip(&start).map(|(p, s)| *p + *s).collect();
        let change = solve_mass_matrix(model, q, &off).ok()?;
        let size = largest(&change) / largest(&v).max(f64::MIN_POSITIVE);
        // As small as it gets: what is left is rounding, of positions over a short step.
        let is_rounding = size >= before && size <= 1e8 * T::EPSILON;
        if largest(&change) == 0.0 || size <= 0.01 * T::EPSILON || is_rounding {
            let p = slopes(model, &end, |q1| lagrangian(model, &fixed(q), q1, h));
            return Some((end.clone(), kick(&p, &forces(&end), half)));
        }
        before = size;
        v.iter_mut().zip(&change).for_each(|(v, c)| *v += *c);
    }
    None
}

/// The part θ of a step of size h at which a function of the configuration passes zero, by halving: every value is a step of its own
/// from (q, p). `None` where it has the same sign at both ends, or a step does not converge.
pub fn passage<T: Real>(
    model: &Model,
    (q, p): (&[T], &[T]),
    h: T,
    forces: Forces<'_, T>,
    function: &dyn Fn(&[T]) -> T,
) -> Option<T> {
    let at = |theta: T| Some(function(&midpoint_step(model, (q, p), theta * h, forces)?.0));
    let (mut low, mut high) = (T::zero(), T::one());
    let below = function(q) < T::zero();
    if (at(high)? < T::zero()) == below {
        return None;
    }
    while (high - low).to_f64() > f64::EPSILON / 8.0 {
        let middle = (low + high) * T::splat(0.5);
        if (at(middle)? < T::zero()) == below { low = middle } else { high = middle }
    }
    Some(low)
}

fn kick<T: Real>(p: &[T], force: &[T], h: T) -> Vec<T> {
    p.iter().zip(force).map(|(p, f)| *p + *f * h).collect()
}

/// L(q₀, q₁).
fn lagrangian<T: Real>(model: &Model, q0: &[Dual<T>], q1: &[Dual<T>], h: T) -> Dual<T> {
    let x = model.difference(q0, q1);
    let (half, h) = (Dual::fixed(T::splat(0.5)), Dual::fixed(h));
    let middle = model.integrate(q0, &x.iter().map(|x| *x * half).collect::<Vec<_>>());
    kinetic_energy(model, &middle, &x.iter().map(|x| *x / h).collect::<Vec<_>>()) * h
}

/// The derivatives of a function of q along the joints' increments.
fn slopes<T: Real>(model: &Model, q: &[T], f: impl Fn(&[Dual<T>]) -> Dual<T>) -> Vec<T> {
    let component = |j: usize| {
        let unit: Vec<T> = (0..model.nv()).map(|i| if i == j { T::one() } else { T::zero() }).collect();
        f(&seeded(q, &tangent(model, q, &unit))).rate
    };
    (0..model.nv()).map(component).collect()
}

fn largest<T: Real>(x: &[T]) -> f64 {
    x.iter().fold(0.0, |most, x| most.max(x.to_f64().abs()))
}
