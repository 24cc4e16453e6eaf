//! Paper 1, section 11: the inverse of the mass matrix in closed form and by vertical sweeps.

use crate::papers::covariances::tree_omega;
use crate::papers::row::{Equations, Row, eq, t};
use crate::papers::scene::Scene;
use crate::{mul, row};
use nalgebra::DMatrix;
use phipsi_spatial::Real;
use phipsi_topology::Operator;

/// The first form of Lemma 12; its second adds what ψ − ψ~ = I moves between the terms.
pub fn lemma_12<T: Real>(s: &Scene<T>, first: bool) -> Operator<T> {
    let between = if first { mul!(t(&s.E_psi), s.upsilon, s.K) } else { mul!(s.upsilon, s.K) };
    let left = mul!(t(&s.K), t(&s.psi), between - mul!(t(&s.H), s.D_inverse));
    let quadratic = mul!(t(&s.K), s.upsilon, s.K);
    let symmetric = &left + &t(&left);
    if first { &(&s.D_inverse + &quadratic) + &symmetric } else { &(&s.D_inverse - &quadratic) + &symmetric }
}

pub fn lemma_12_printed_in_section_10<T: Real>(s: &Scene<T>) -> Operator<T> {
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

/// The rows.
pub fn rows() -> Vec<Row> {
    vec![
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
