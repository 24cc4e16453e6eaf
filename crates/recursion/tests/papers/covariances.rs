//! Paper 1, section 10, Lemmas 7 to 11.

use crate::papers::random_field::sizes;
use crate::papers::row::{Equations, Row, eq, t};
use crate::papers::scene::{Scene, zeros};
use crate::{mul, row};
use nalgebra::DMatrix;
use phipsi_spatial::Real;
use phipsi_topology::Operator;

/// A N A*.
pub fn of<T: Real>(a: &Operator<T>, n: &Operator<T>) -> Operator<T> {
    mul!(a, n, t(a))
}

pub fn gain_of_z<T: Real>(s: &Scene<T>) -> Operator<T> {
    mul!(s.psi, s.K)
}

/// α = A T.
pub fn gain_of_alpha<T: Real>(s: &Scene<T>) -> Operator<T> {
    mul!(t(&s.psi), t(&s.H), s.D_inverse, s.innovations_operator())
}

/// Υ + Υ ψ~ + ψ~* Υ.
pub fn chain_omega<T: Real>(s: &Scene<T>) -> Operator<T> {
    let psi = s.psi_tilde();
    &s.upsilon + mul!(s.upsilon, psi) + mul!(t(&psi), s.upsilon)
}

/// H* D⁻¹ H.
fn source<T: Real>(s: &Scene<T>) -> Operator<T> {
    mul!(t(&s.H), s.D_inverse, s.H)
}

/// I − P ψ* H* D⁻¹ H.
fn smoothing<T: Real>(s: &Scene<T>) -> Operator<T> {
    s.identity() - mul!(s.P, t(&s.psi), source(s))
}

fn omega_of_reference<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    let right = mul!(s.H, s.phi).dense().unwrap();
    right.transpose() * s.mass_inverse_of_reference() * right
}

/// Ω(i,j) = ψ*(a,i) Υ(a) ψ(a,j), a the lowest common ancestor.
pub fn tree_omega<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    let psi = &s.blocks.psi;
    s.spatial(|i, j| {
        s.common(i, j)
            .map(|a| s.transition(psi, a, i).transpose() * &s.blocks.upsilon[a] * s.transition(psi, a, j))
    })
}

/// (I − 𝒢 H) S (I − 𝒢 H)*, dense.
fn error_covariance<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    let S = s.state_covariance().dense().unwrap();
    let right = s.H.dense().unwrap() * &S;
    &S - right.transpose() * s.mass_inverse_of_reference() * right
}

pub fn chain_error_covariance<T: Real>(s: &Scene<T>) -> Operator<T> {
    let rest = s.identity() - mul!(s.P, s.upsilon);
    &s.P - mul!(s.P, s.upsilon, s.P) + mul!(rest, s.psi_tilde(), s.P) + mul!(s.P, t(&s.psi_tilde()), t(&rest))
}

/// HPΥ = H: Υ's definition squeezed between joints.
fn identity_of_upsilon<T: Real>(s: &Scene<T>) -> Equations<T> {
    eq(mul!(s.H, s.P, s.upsilon), &s.H)
        .of(mul!(s.H, s.P, s.upsilon))
        .and(mul!(s.H, s.P, t(&s.tau_bar)), zeros(s.nv(), 6 * s.n()))
        .of(mul!(s.H, s.P))
        .and(mul!(s.H, s.P, s.omega()), mul!(s.H, s.psi))
}

/// Υ is the inverse of the inertia that a force on a body meets: the diagonal blocks of φ* H* 𝓜⁻¹ H φ.
fn seen_from_bodies<T: Real>(s: &Scene<T>) -> Equations<T> {
    eq(&s.upsilon, s.diagonal_of(&omega_of_reference(s)))
}

/// The rows.
pub fn rows() -> Vec<Row> {
    vec![
        row!(
            "1 §10, 𝓜",
            "𝓜 = E(T T*) = H S H*",
            "W has the covariance M, not 𝓜",
            "`Operators::mass_matrix`",
            Trees,
            |s| eq(mul!(s.H, s.state_covariance(), t(&s.H)), s.mass_of_reference())
        ),
        row!(
            "1 Lemma 7",
            "E(ε ε*) = (I − 𝓛) 𝓜 (I − 𝓛)* = D",
            "",
            "`Operators::innovations_operator`, `D`",
            Trees,
            |s| eq(of(&s.innovations_operator(), &s.mass_matrix()), &s.D).of(s.mass_matrix())
        ),
        row!(
            "1 Lemma 8",
            "E[(X − z)(X − z)*] = ψ M ψ* = P + ψ~P + P ψ~*",
            "",
            "`Operators::filtered_error_covariance`",
            Trees,
            |s| eq(
                s.filtered_error_covariance(),
                &s.P + mul!(s.psi_tilde(), s.P) + mul!(s.P, t(&s.psi_tilde()))
            )
        ),
        row!(
            "1 Lemma 8, proof",
            "X − z = ψ W, M = P − E_ψ P E_ψ*",
            "",
            "`Operators::psi`",
            Trees,
            |s| eq(&s.phi - mul!(s.psi, s.K, s.H, s.phi), &s.psi)
                .of(&s.phi)
                .and(&s.P - mul!(s.E_psi, s.P, t(&s.E_psi)), &s.M)
                .of(&s.P)
        ),
        row!(
            "1 Lemma 9 (10.1)",
            "Ω = Υ + Υ ψ~ + ψ~* Υ",
            "",
            "`Operators::omega`, `upsilon`",
            Chains,
            |s| eq(chain_omega(s), s.omega())
        ),
        row!(
            "1 Lemma 9, trees",
            "Ω(i,j) = ψ*(a,i) Υ(a) ψ(a,j), a the lowest common ancestor; 0 if there is none",
            "(10.1) holds on chains only",
            "`Operators::omega`, `upsilon`",
            Trees,
            |s| eq(s.omega(), tree_omega(s))
        ),
        row!(
            "1 (10.1), Ω",
            "E(α α*) = Ω = ψ* H* D⁻¹ H ψ = φ* H* 𝓜⁻¹ H φ",
            "",
            "`Operators::omega`",
            Trees,
            |s| eq(s.omega(), omega_of_reference(s))
        ),
        row!(
            "1 (10.2)",
            "Υ(k) = ψ*(p,k) Υ(p) ψ(p,k) + H*(k) D⁻¹(k) H(k)",
            "",
            "`Operators::upsilon`, `Operator::outward_composite`",
            Trees,
            |s| eq(&s.upsilon, s.spatial_diagonal(&s.blocks.upsilon))
        ),
        row!("1 (10.3)", "H* D⁻¹ H = Υ − E_ψ* Υ E_ψ", "", "`Operators::upsilon`", Chains, |s| eq(
            &s.upsilon - mul!(t(&s.E_psi), s.upsilon, s.E_psi),
            source(s)
        )
        .of(&s.upsilon)),
        row!(
            "1 (10.3), trees",
            "H* D⁻¹ H = Υ − diag(E_ψ* Υ E_ψ)",
            "E_ψ* Υ E_ψ has blocks between siblings",
            "`Operators::upsilon`",
            Trees,
            |s| eq(
                &s.upsilon.dense().unwrap()
                    - s.diagonal_of(&mul!(t(&s.E_psi), s.upsilon, s.E_psi).dense().unwrap()),
                source(s)
            )
            .of(&s.upsilon)
        ),
        row!(
            "1 Lemma 9, HPΥ",
            "H P Υ = H, H P τ̄* = 0, H P Ω = H ψ",
            "",
            "`Operators::upsilon`",
            Trees,
            |s| identity_of_upsilon(s)
        ),
        row!("1 Lemma 9, proof", "α = ψ* H* D⁻¹ ε", "", "`Operators::smooth`", Trees, |s| eq(
            gain_of_alpha(s),
            mul!(t(&s.phi), t(&s.H)).dense().unwrap() * s.mass_inverse_of_reference()
        )),
        row!(
            "1 §10, task space",
            "Υ(k) is the inverse of the inertia seen at body k: a diagonal block of φ* H* 𝓜⁻¹ H φ",
            "",
            "`Operators::upsilon`",
            Trees,
            |s| seen_from_bodies(s)
        ),
        row!(
            "1 Lemma 10",
            "X − f = (I − P ψ* H* D⁻¹ H)(X − z)",
            "",
            "`Operators::smooth`",
            Trees,
            |s| eq(mul!(smoothing(s), s.psi), &s.phi - mul!(s.batch_gain(), s.H, s.phi)).of(&s.phi)
        ),
        row!(
            "1 (10.4)",
            "𝒫 = (I − Pψ*H*D⁻¹H) E[(X − z)(X − z)*] (I − Pψ*H*D⁻¹H)*",
            "",
            "`Operators::smoothed_error_covariance`",
            Trees,
            |s| eq(of(&smoothing(s), &s.filtered_error_covariance()), error_covariance(s))
                .of(s.state_covariance())
        ),
        row!(
            "1 Lemma 10, proof",
            "X − f = X − z − P α, ε = H (X − z)",
            "",
            "`Operators::filter`",
            Trees,
            |s| eq(
                &s.psi - mul!(s.P, t(&s.psi), source(s), s.psi),
                &s.phi - mul!(s.batch_gain(), s.H, s.phi)
            )
            .of(&s.phi)
            .and(mul!(s.H, s.psi), mul!(s.innovations_operator(), s.H, s.phi))
            .of(mul!(s.H, s.phi))
        ),
        row!(
            "1 Lemma 11 (10.5)",
            "𝒫 = (P − PΥP) + (I − PΥ) ψ~P + P ψ~* (I − ΥP)",
            "",
            "`Operators::smoothed_error_covariance`",
            Chains,
            |s| eq(chain_error_covariance(s), error_covariance(s)).of(s.state_covariance())
        ),
        row!(
            "1 Lemma 11, trees",
            "𝒫 = ψ M ψ* − P Ω P",
            "(10.5) holds on chains only",
            "`Operators::smoothed_error_covariance`",
            Trees,
            |s| eq(s.filtered_error_covariance() - mul!(s.P, s.omega(), s.P), error_covariance(s))
                .of(s.state_covariance())
        ),
        row!(
            "1 (10.6)",
            "H 𝒫 = 0, 𝒫 H* = 0",
            "",
            "`Operators::smoothed_error_covariance`",
            Trees,
            |s| {
                let P = s.filtered_error_covariance() - mul!(s.P, s.omega(), s.P);
                eq(mul!(s.H, P), zeros(s.nv(), 6 * s.n()))
                    .of(mul!(s.H, s.P))
                    .and(mul!(P, t(&s.H)), zeros(6 * s.n(), s.nv()))
                    .of(mul!(s.P, t(&s.H)))
            }
        ),
        row!(
            "1 §10, H f = H X",
            "H f = H X = T: no error is left at the joints",
            "",
            "`Operators::batch_gain`",
            Trees,
            |s| eq(mul!(s.H, s.batch_gain()), s.joint_identity())
                .of(sizes(&s.mass_of_reference()) * sizes(&s.mass_inverse_of_reference()))
        ),
        row!(
            "1 Lemma 11, proof",
            "H E[(X − z)(X − z)*] = H ψ P, H E[(X − z)(X − z)*] H* = D",
            "printed H e H = D, H e = H ψ P",
            "`Operators::filtered_error_covariance`",
            Trees,
            |s| eq(mul!(s.H, s.filtered_error_covariance()), mul!(s.H, s.psi, s.P))
                .and(mul!(s.H, s.filtered_error_covariance(), t(&s.H)), &s.D)
        ),
    ]
}
