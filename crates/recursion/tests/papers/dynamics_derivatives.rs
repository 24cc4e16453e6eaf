//! Paper 2, section 4.5: what follows from the sensitivities for the equations of motion, against dual numbers.

use crate::papers::row::{Equations, Row, eq};
use crate::papers::scene::{Scene, numbers};
use crate::row;
use nalgebra::DMatrix;
use phipsi_reference as slow;
use phipsi_spatial::Real;

/// Velocity, acceleration, joint forces of the case.
fn motion<T: Real>(s: &Scene<T>) -> [Vec<T>; 3] {
    [numbers(&s.case.v), numbers(&s.case.a), numbers(&s.case.tau)]
}

/// 𝓜 times the square of what the rates are: terms of this size cancel where a force does not depend on a coordinate.
fn forces<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    let [v, a, _] = motion(s);
    let speed = v.iter().chain(&a).fold(T::one(), |m, x| m.larger(x.abs()));
    s.mass_matrix().dense().unwrap() * (speed * speed)
}

/// The same as accelerations: what 𝓜⁻¹ makes of them.
fn accelerations<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    let most = s.mass_inverse_of_reference().iter().fold(T::zero(), |m, x| m.larger(x.abs()));
    forces(s) * most
}

fn of_inverse_dynamics<T: Real>(s: &Scene<T>) -> Equations<T> {
    let [v, a, _] = motion(s);
    let ours = s.inverse_dynamics_derivatives(&v, &a).unwrap();
    let want = slow::inverse_dynamics_derivatives(&s.case.model, &s.q, &v, &a, None);
    eq(ours.d_dq, want.d_dq)
        .of(forces(s))
        .and(ours.d_dv, want.d_dv)
        .of(forces(s))
        .and(ours.d_last, want.d_last)
}

fn of_forward_dynamics<T: Real>(s: &Scene<T>) -> Equations<T> {
    let [v, _, tau] = motion(s);
    let ours = s.forward_dynamics_derivatives(&v, &tau).unwrap();
    let want = slow::forward_dynamics_derivatives(&s.case.model, &s.q, &v, &tau, None).unwrap();
    eq(ours.d_dq, want.d_dq)
        .of(accelerations(s))
        .and(ours.d_dv, want.d_dv)
        .of(accelerations(s))
        .and(ours.d_last, want.d_last)
}

fn of_linearization<T: Real>(s: &Scene<T>) -> Equations<T> {
    let [v, _, tau] = motion(s);
    let ours = s.linearize(&v, &tau).unwrap();
    let (a, b) = slow::linearize(&s.case.model, &s.q, &v, &tau, None).unwrap();
    eq(ours.A, a).of(accelerations(s)).and(ours.B, b)
}

/// The rows.
pub fn rows() -> Vec<Row> {
    vec![
        row!(
            "2 §4.5, ∂T",
            "∂T/∂θ = H ∂f + N_f, ∂f = φ(M ∂α + V~ M ∂V + (MV)¯ ∂V + E_φ f̄ H*); ∂T/∂v; ∂T/∂v̇ = 𝓜",
            "",
            "`Operators::inverse_dynamics_derivatives`",
            Trees,
            |s| of_inverse_dynamics(s)
        ),
        row!(
            "2 §4.5, ∂v̇",
            "∂v̇ = −𝓜⁻¹ ∂T by θ and v; ∂v̇/∂T = 𝓜⁻¹",
            "",
            "`Operators::forward_dynamics_derivatives`",
            Trees,
            |s| of_forward_dynamics(s)
        ),
        row!(
            "2 §4.5, δẋ",
            "δẋ = A δx + B δT, x = (δθ, δv): A = I₁(I₂* − ad I₁*) + I₂(∂v̇/∂θ I₁* + ∂v̇/∂v I₂*), B = I₂ 𝓜⁻¹",
            "",
            "`Operators::linearize`",
            Trees,
            |s| of_linearization(s)
        ),
    ]
}
