//! Paper 1, the table of covariances at the end of section 10.

use crate::papers::covariances::{
    chain_error_covariance, chain_omega, gain_of_alpha, gain_of_z, of, tree_omega,
};
use crate::papers::inverse::{lemma_12, lemma_12_printed_in_section_10};
use crate::papers::row::{Row, eq, t};
use crate::papers::scene::inverse;
use crate::{mul, row};

/// The rows.
pub fn rows() -> Vec<Row> {
    vec![
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
    ]
}
