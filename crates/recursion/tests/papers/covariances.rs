//! Paper 1, sections 10 and 11: covariances, and the inverse of the mass matrix in closed form.

use crate::papers::row::{Equations, Row, eq, t};
use crate::papers::scene::{Scene, inverse, zeros};
use crate::{mul, row};
use nalgebra::DMatrix;
use phipsi_spatial::Real;
use phipsi_topology::Operator;

/// A N A*.
fn of<T: Real>(a: &Operator<T>, n: &Operator<T>) -> Operator<T> {
    mul!(a, n, t(a))
}
fn gain_of_z<T: Real>(s: &Scene<T>) -> Operator<T> {
    mul!(s.psi, s.K)
}
/// α = A T.
fn gain_of_alpha<T: Real>(s: &Scene<T>) -> Operator<T> {
    mul!(t(&s.psi), t(&s.H), s.D_inverse, s.innovations_operator())
}
/// Υ + Υ ψ~ + ψ~* Υ.
fn chain_omega<T: Real>(s: &Scene<T>) -> Operator<T> {
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
fn tree_omega<T: Real>(s: &Scene<T>) -> DMatrix<T> {
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
fn chain_error_covariance<T: Real>(s: &Scene<T>) -> Operator<T> {
    let rest = s.identity() - mul!(s.P, s.upsilon);
    &s.P - mul!(s.P, s.upsilon, s.P) + mul!(rest, s.psi_tilde(), s.P) + mul!(s.P, t(&s.psi_tilde()), t(&rest))
}

/// The first form of Lemma 12; its second adds what ψ − ψ~ = I moves between the terms.
fn lemma_12<T: Real>(s: &Scene<T>, first: bool) -> Operator<T> {
    let between = if first { mul!(t(&s.E_psi), s.upsilon, s.K) } else { mul!(s.upsilon, s.K) };
    let left = mul!(t(&s.K), t(&s.psi), between - mul!(t(&s.H), s.D_inverse));
    let quadratic = mul!(t(&s.K), s.upsilon, s.K);
    let symmetric = &left + &t(&left);
    if first { &(&s.D_inverse + &quadratic) + &symmetric } else { &(&s.D_inverse - &quadratic) + &symmetric }
}

fn lemma_12_printed_in_section_10<T: Real>(s: &Scene<T>) -> Operator<T> {
    let left = mul!(t(&s.K), t(&s.psi), mul!(t(&s.E_psi), s.upsilon, s.K) - mul!(t(&s.H), s.D_inverse));
    let right = mul!(mul!(t(&s.K), s.upsilon, s.E_psi) - mul!(s.D_inverse, s.H), s.psi, s.G);
    &s.D_inverse + mul!(t(&s.K), s.upsilon, s.K) + left + right
}

/// U of Lemma 12, with Υ⁺ = E_φ* Υ E_φ.
fn lemma_12_U<T: Real>(s: &Scene<T>) -> Operator<T> {
    let plus = mul!(t(&s.E_phi), s.upsilon, s.E_phi);
    let left = mul!(s.P, t(&s.E_phi), t(&s.psi), mul!(t(&s.tau_bar), plus, s.P) - s.identity());
    let U = &s.P + mul!(s.P, plus, s.P) + &left + t(&left);
    mul!(s.D_inverse, s.H, U, t(&s.H), s.D_inverse)
}

fn lemma_12_tree<T: Real>(s: &Scene<T>) -> Equations<T> {
    let cross = mul!(s.D_inverse, s.H, s.psi, s.K);
    let expression = &s.D_inverse - &cross - t(&cross) + mul!(t(&s.K), s.omega(), s.K);
    let K = s.K.dense().unwrap();
    let by_branches = s.D_inverse.dense().unwrap() - cross.dense().unwrap() - t(&cross).dense().unwrap()
        + K.transpose() * tree_omega(s) * K;
    eq(expression, s.mass_inverse_of_reference()).and(by_branches, s.mass_inverse_of_reference())
}

/// λ(i) at its start: K* Υ φ − 𝓜⁻¹(i,i) H(i) = K* Υ ψ − D⁻¹ H.
fn lemma_13_start<T: Real>(s: &Scene<T>) -> Equations<T> {
    let minv = s.mass_inverse_of_reference();
    let (b, joint) = (&s.blocks, s.joint_space());
    let mut rows: (Vec<DMatrix<T>>, Vec<DMatrix<T>>) = (vec![], vec![]);
    let mut diagonal: (Vec<DMatrix<T>>, Vec<DMatrix<T>>) = (vec![], vec![]);
    for i in 0..s.n() {
        let own = minv
            .view((joint.range(i).start, joint.range(i).start), (joint.size(i), joint.size(i)))
            .into_owned();
        let (mut short, mut long) = (-(&b.D_inverse[i] * &b.H[i]), -(&own * &b.H[i]));
        let mut element = b.D_inverse[i].clone();
        if let Some(p) = s.parent(i) {
            let seen = b.K[i].transpose() * &b.upsilon[p];
            short += &seen * &b.psi[i];
            long += &seen * &b.shift[i];
            element += &seen * &b.K[i];
        }
        rows.0.push(short);
        rows.1.push(long);
        diagonal.0.push(element);
        diagonal.1.push(own);
    }
    let wide = |blocks: &[DMatrix<T>]| s.diagonal_matrix(joint, s.state_space(), blocks);
    let square = |blocks: &[DMatrix<T>]| s.diagonal_matrix(joint, joint, blocks);
    eq(wide(&rows.0), wide(&rows.1))
        .of(mul!(s.mass_matrix_inverse(), s.H))
        .and(square(&diagonal.0), square(&diagonal.1))
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
            "1 Lemma 11, proof",
            "H E[(X − z)(X − z)*] = H ψ P, H E[(X − z)(X − z)*] H* = D",
            "printed H e H = D, H e = H ψ P",
            "`Operators::filtered_error_covariance`",
            Trees,
            |s| eq(mul!(s.H, s.filtered_error_covariance()), mul!(s.H, s.psi, s.P))
                .and(mul!(s.H, s.filtered_error_covariance(), t(&s.H)), &s.D)
        ),
        row!("1 §10 table, W", "E[W W*] = M", "", "`RandomField::root`", Trees, |s| eq(
            mul!(s.random_field().root(), t(s.random_field().root())),
            &s.M
        )),
        row!(
            "1 §10 table, X",
            "E[X X*] = S = φ M φ* = R + φ~R + R φ~*",
            "",
            "`Operators::state_covariance`",
            Trees,
            |s| eq(
                of(&mul!(s.phi, s.random_field().root()), &s.identity()),
                &s.R + mul!(s.phi_tilde(), s.R) + mul!(s.R, t(&s.phi_tilde()))
            )
        ),
        row!(
            "1 §10 table, T",
            "E[T T*] = 𝓜 = H R H* + H φ~R H* + H R φ~* H*",
            "last H* missing",
            "`Operators::mass_matrix`",
            Trees,
            |s| {
                let left = mul!(s.H, s.phi_tilde(), s.R, t(&s.H));
                eq(mul!(s.H, s.R, t(&s.H)) + &left + t(&left), s.mass_of_reference())
            }
        ),
        row!(
            "1 §10 table, z",
            "E[z z*] = φ K D K* φ* = (R − P) + φ~(R − P) + (R − P) φ~*",
            "",
            "`Operators::filter`",
            Trees,
            |s| {
                let rest = &s.R - &s.P;
                eq(
                    &rest + mul!(s.phi_tilde(), rest) + mul!(rest, t(&s.phi_tilde())),
                    of(&gain_of_z(s), &s.mass_matrix()),
                )
                .of(s.state_covariance())
                .and(of(&mul!(s.phi, s.K), &s.D), of(&gain_of_z(s), &s.mass_matrix()))
                .of(s.state_covariance())
            }
        ),
        row!(
            "1 §10 table, X − z",
            "E[(X − z)(X − z)*] = ψ M ψ* = P + ψ~P + P ψ~*",
            "ψ M ψ: last star missing",
            "`Operators::filtered_error_covariance`",
            Trees,
            |s| eq(
                of(&(&s.phi - mul!(s.psi, s.K, s.H, s.phi)), &s.M),
                &s.P + mul!(s.psi_tilde(), s.P) + mul!(s.P, t(&s.psi_tilde()))
            )
            .of(s.state_covariance())
            .printed(mul!(s.psi, s.M, s.psi), s.filtered_error_covariance())
        ),
        row!("1 §10 table, ε", "E[ε ε*] = D", "", "`Filtered::epsilon`", Trees, |s| eq(
            of(&s.innovations_operator(), &s.mass_matrix()),
            &s.D
        )
        .of(s.mass_matrix())),
        row!("1 §10 table, ν", "E[ν ν*] = D⁻¹", "", "`Filtered::nu`", Trees, |s| eq(
            of(&mul!(s.D_inverse, s.innovations_operator()), &s.mass_matrix()),
            inverse(&s.D.dense().unwrap())
        )),
        row!(
            "1 §10 table, α",
            "E[α α*] = Ω = Υ + Υ ψ~ + ψ~* Υ",
            "last term ψ~* without Υ",
            "`Smoothed::alpha`",
            Chains,
            |s| eq(chain_omega(s), of(&gain_of_alpha(s), &s.mass_matrix()))
                .printed(&s.upsilon + mul!(s.upsilon, s.psi_tilde()) + t(&s.psi_tilde()), s.omega())
        ),
        row!(
            "1 §10 table, α, trees",
            "E[α α*] = Ω, by lowest common ancestors",
            "the form above holds on chains only",
            "`Smoothed::alpha`",
            Trees,
            |s| eq(of(&gain_of_alpha(s), &s.mass_matrix()), tree_omega(s))
        ),
        row!(
            "1 §10 table, θ̈",
            "E[θ̈ θ̈*] = 𝓜⁻¹ = D⁻¹ + K*ΥK + K*ψ*(E_ψ*ΥK − H*D⁻¹) + (K*ΥE_ψ − D⁻¹H) ψ K",
            "last factor ψ G, and θ~ for θ̈",
            "`Smoothed::acceleration`",
            Chains,
            |s| eq(lemma_12(s, true), s.mass_inverse_of_reference())
                .printed(lemma_12_printed_in_section_10(s), s.mass_matrix_inverse())
        ),
        row!(
            "1 §10 table, f",
            "E[f f*] = φ M φ* − ψ M ψ* + P Ω P",
            "",
            "`Smoothed::f`",
            Trees,
            |s| eq(
                s.state_covariance() - s.filtered_error_covariance() + mul!(s.P, s.omega(), s.P),
                of(&s.batch_gain(), &s.mass_matrix())
            )
            .of(s.state_covariance())
        ),
        row!(
            "1 §10 table, X − f",
            "E[(X − f)(X − f)*] = 𝒫 = ψ M ψ* − P Ω P = (P − PΥP) + (I − PΥ) ψ~P + P ψ~* (I − ΥP)",
            "",
            "`Operators::smoothed_error_covariance`",
            Chains,
            |s| eq(chain_error_covariance(s), s.filtered_error_covariance() - mul!(s.P, s.omega(), s.P))
                .of(s.state_covariance())
        ),
        row!(
            "1 §10 table, f − z",
            "E[(f − z)(f − z)*] = P Ω P",
            "",
            "`Smoothed::f`, `Filtered::z`",
            Trees,
            |s| eq(mul!(s.P, s.omega(), s.P), of(&(s.batch_gain() - gain_of_z(s)), &s.mass_matrix()))
                .of(s.state_covariance())
        ),
        row!(
            "1 §10 table, f − z, 2",
            "E[(f − z)(f − z)*] = P (Υ + Υ ψ~ + ψ~* Υ) P",
            "",
            "`Operators::upsilon`",
            Chains,
            |s| eq(mul!(s.P, chain_omega(s), s.P), mul!(s.P, s.omega(), s.P))
        ),
        row!(
            "1 §10 table, Ŵ",
            "E[Ŵ Ŵ*] = M Ω M",
            "printed as Q, which is the covariance of the error",
            "`Operators::omega`",
            Trees,
            |s| eq(mul!(s.M, s.omega(), s.M), of(&mul!(s.M, gain_of_alpha(s)), &s.mass_matrix())).printed(
                &s.M - mul!(s.M, s.omega(), s.M),
                of(&mul!(s.M, gain_of_alpha(s)), &s.mass_matrix())
            )
        ),
        row!(
            "1 §10 table, W − Ŵ",
            "E[(W − Ŵ)(W − Ŵ)*] = Q = M − M Ω M",
            "printed as E[Ŵ Ŵ*]",
            "`Operators::inertial_force_error_covariance`",
            Trees,
            |s| eq(&s.M - mul!(s.M, s.omega(), s.M), of(&(s.identity() - mul!(s.M, s.omega())), &s.M))
                .of(mul!(s.M, s.omega(), s.M))
        ),
        row!(
            "1 §10 table, W − Ŵ, 2",
            "Q = (M − MΥM) − M (Υ ψ~ + ψ~* Υ) M",
            "",
            "`Operators::upsilon`",
            Chains,
            |s| {
                let cross = mul!(s.upsilon, s.psi_tilde());
                eq(
                    &s.M - mul!(s.M, s.upsilon, s.M) - mul!(s.M, &cross + t(&cross), s.M),
                    s.inertial_force_error_covariance(),
                )
                .of(mul!(s.M, s.omega(), s.M))
            }
        ),
        row!(
            "1 Lemma 12",
            "𝓜⁻¹ = D⁻¹ + K*ΥK + K*ψ*(E_ψ*ΥK − H*D⁻¹) + (K*ΥE_ψ − D⁻¹H) ψ K",
            "",
            "`Operators::upsilon`",
            Chains,
            |s| eq(lemma_12(s, true), s.mass_inverse_of_reference())
        ),
        row!(
            "1 Lemma 12, 2",
            "𝓜⁻¹ = D⁻¹ − K*ΥK + K*ψ*(ΥK − H*D⁻¹) + (K*Υ − D⁻¹H) ψ K",
            "",
            "`Operators::upsilon`",
            Chains,
            |s| eq(lemma_12(s, false), s.mass_inverse_of_reference())
        ),
        row!(
            "1 Lemma 12, U",
            "𝓜⁻¹ = D⁻¹ H U H* D⁻¹, U = P + PΥ⁺P + P E_φ*ψ*(τ̄*Υ⁺P − I) + (PΥ⁺τ̄ − I) ψ E_φ P, Υ⁺ = E_φ* Υ E_φ",
            "",
            "`Operators::upsilon`",
            Chains,
            |s| eq(lemma_12_U(s), s.mass_inverse_of_reference())
        ),
        row!(
            "1 Lemma 12, trees",
            "𝓜⁻¹ = D⁻¹ − D⁻¹HψK − K*ψ*H*D⁻¹ + K* Ω K",
            "Lemma 12 holds on chains only",
            "`Operators::omega`",
            Trees,
            |s| lemma_12_tree(s)
        ),
        row!(
            "1 Lemma 13",
            "𝓜⁻¹ element by element in vertical sweeps, with side branches",
            "H(i)D⁻¹H*(i) for H*D⁻¹H; D⁻¹ of chains without branches",
            "`Operators::mass_matrix_inverse_by_sweeps`",
            Trees,
            |s| eq(s.mass_matrix_inverse_by_sweeps(), s.mass_inverse_of_reference())
        ),
        row!(
            "1 Lemma 13, start",
            "𝓜⁻¹(i,i) = D⁻¹ + K*ΥK, λ(i) = K*Υφ − 𝓜⁻¹(i,i) H(i) = K*Υψ − D⁻¹H",
            "H(i) 𝓜⁻¹(i,i)",
            "`Operators::mass_matrix_inverse_by_sweeps`",
            Trees,
            |s| lemma_13_start(s)
        ),
    ]
}
