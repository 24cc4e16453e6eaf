//! Paper 2, section 4.5: derivatives of all operators, against operators on dual numbers.

use crate::papers::operators::at_point;
use crate::papers::row::{Equations, Row, eq, t};
use crate::papers::scene::Scene;
use crate::{mul, row};
use nalgebra::DMatrix;
use phipsi_model::JointKind;
use phipsi_recursion::Operators;
use phipsi_recursion::operators::Sensitivity;
use phipsi_reference::Dual;
use phipsi_reference::inverse_dynamics_derivatives::{seeded, tangent};
use phipsi_spatial::{Real, Vec3};
use phipsi_topology::Operator;

/// One coordinate of the scene.
fn coordinate<T: Real>(s: &Scene<T>) -> usize {
    (s.seed as usize).wrapping_mul(7) % s.nv()
}

fn moved<T: Real>(s: &Scene<T>, i: usize) -> Vec<Dual<T>> {
    let unit: Vec<T> = (0..s.nv()).map(|j| if j == i { T::one() } else { T::zero() }).collect();
    seeded(&s.q, &tangent(&s.case.model, &s.q, &unit))
}

/// A sensitivity against the operator on dual numbers.
fn sensitivity<T: Real>(
    s: &Scene<T>,
    rate: impl Fn(&Sensitivity<T>) -> Operator<T>,
    own: impl Fn(&Operators<Dual<T>>) -> Operator<Dual<T>>,
) -> Equations<T> {
    let i = coordinate(s);
    let dual = own(&Operators::new(&s.case.model, &moved(s, i)).unwrap()).dense().unwrap();
    eq(rate(&s.sensitivity(i).unwrap()), dual.map(|x| x.rate)).of(dual.map(|x| x.value))
}

fn of_mass<T: Real>(s: &Scene<T>) -> Equations<T> {
    let i = coordinate(s);
    let q = moved(s, i);
    let mass = phipsi_reference::mass_matrix(&s.case.model, &q);
    let rates = s.sensitivity(i).unwrap();
    let (mass_rate, minv) = (mass.map(|x| x.rate), s.mass_inverse_of_reference());
    eq(rates.mass_matrix, mass_rate.clone())
        .of(s.mass_matrix())
        .and(rates.mass_matrix_inverse, -(&minv * mass_rate * &minv))
        .of(s.mass_matrix_inverse())
}

/// ∂ ln det 𝓜 = tr(D⁻¹ Ḋ), all of them in one sweep, and 2 tr(Υ Ė_φ P⁺ E_φ*) where the joint's axes are fixed in the body.
fn of_log_determinant<T: Real>(s: &Scene<T>) -> Equations<T> {
    let i = coordinate(s);
    let trace = |a: &DMatrix<T>| (0..a.nrows()).fold(T::zero(), |sum, k| sum + a[(k, k)]);
    let mass = phipsi_reference::mass_matrix(&s.case.model, &moved(s, i)).map(|x| x.rate);
    let product = s.mass_inverse_of_reference() * mass;
    let want = trace(&product);
    let rates = s.sensitivity(i).unwrap();
    let pivots = mul!(s.D_inverse, rates.D).dense().unwrap();
    // Every degree of freedom has a term of the size of 𝓜⁻¹ 𝓜.
    let terms = DMatrix::from_element(1, 1, T::splat(s.nv() as f64));
    let all = phipsi_reference::log_determinant_gradient(&s.case.model, &s.q).unwrap();
    let out =
        eq(trace(&pivots), want).of(terms.clone()).and(s.log_determinant_gradient(), all).of(terms.clone());
    let (joint, _) = s.case.model.joint_of_velocity(i);
    if matches!(s.case.model.joints()[joint].kind, JointKind::Universal { .. }) {
        return out;
    }
    let sandwich = mul!(s.upsilon, rates.E_phi, s.tau_bar, s.P, t(&s.E_phi)).dense().unwrap();
    out.and(trace(&sandwich) * T::splat(2.0), want).of(terms)
}

/// The rows.
pub fn rows() -> Vec<Row> {
    vec![
        row!("2 §4.5, E_φ", "Ė_φ = φ(p,i) S~ in block (p,i)", "", "`Sensitivity::E_phi`", Trees, |s| {
            sensitivity(s, |r| r.E_phi.clone(), |o| o.E_phi.clone())
        }),
        row!("2 §4.5, φ", "φ̇ = φ Ė_φ φ", "", "`Sensitivity::phi`", Trees, |s| sensitivity(
            s,
            |r| r.phi.clone(),
            |o| o.phi.clone()
        )),
        row!(
            "2 §4.5, H",
            "Ḣ = 0, but for the first axis of a universal joint",
            "",
            "`Sensitivity::H`",
            Trees,
            |s| sensitivity(s, |r| r.H.clone(), |o| o.H.clone())
        ),
        row!(
            "2 §4.5, P",
            "Ṗ(p) = Σ (Ė P⁺ E* + E P⁺ Ė* + E Ṗ⁺ E*)",
            "",
            "`Sensitivity::P`",
            Trees,
            |s| sensitivity(s, |r| r.P.clone(), |o| o.P.clone())
        ),
        row!("2 §4.5, D", "Ḋ = Ḣ P H* + H Ṗ H* + H P Ḣ*", "", "`Sensitivity::D`", Trees, |s| {
            sensitivity(s, |r| r.D.clone(), |o| o.D.clone())
        }),
        row!(
            "2 §4.5, D⁻¹",
            "(D⁻¹)˙ = −D⁻¹ Ḋ D⁻¹",
            "",
            "`Sensitivity::D_inverse`",
            Trees,
            |s| sensitivity(s, |r| r.D_inverse.clone(), |o| o.D_inverse.clone())
        ),
        row!("2 §4.5, G", "Ġ = (U̇ − G Ḋ) D⁻¹, U = P H*", "", "`Sensitivity::G`", Trees, |s| {
            sensitivity(s, |r| r.G.clone(), |o| o.G.clone())
        }),
        row!("2 §4.5, K", "K̇ = Ė_φ G + E_φ Ġ", "", "`Sensitivity::K`", Trees, |s| sensitivity(
            s,
            |r| r.K.clone(),
            |o| o.K.clone()
        )),
        row!("2 §4.5, τ̄", "τ̄˙ = −Ġ H − G Ḣ", "", "`Sensitivity::tau_bar`", Trees, |s| {
            sensitivity(s, |r| r.tau_bar.clone(), |o| o.tau_bar.clone()).of(s.tau())
        }),
        row!("2 §4.5, E_ψ", "Ė_ψ = Ė_φ τ̄ + E_φ τ̄˙", "", "`Sensitivity::E_psi`", Trees, |s| {
            sensitivity(s, |r| r.E_psi.clone(), |o| o.E_psi.clone()).of(&s.E_phi)
        }),
        row!("2 §4.5, ψ", "ψ̇ = ψ Ė_ψ ψ", "", "`Sensitivity::psi`", Trees, |s| sensitivity(
            s,
            |r| r.psi.clone(),
            |o| o.psi.clone()
        )),
        row!(
            "2 §4.5, B",
            "Ḃ = 0: points are fixed in their bodies; J̇ = B* φ̇* H* + B* φ* Ḣ*",
            "",
            "`Sensitivity::phi`, `H`",
            Trees,
            |s| {
                let point = s.case.point.0;
                sensitivity(
                    s,
                    |r| {
                        mul!(t(&at_point(s, s.case.body)), t(&r.phi), t(&s.H))
                            + mul!(t(&at_point(s, s.case.body)), t(&s.phi), t(&r.H))
                    },
                    |o| {
                        let B = o
                            .pick_off(&[(s.case.body, Vec3(point.map(phipsi_spatial::Scalar::splat)))])
                            .unwrap();
                        mul!(t(&B), t(&o.phi), t(&o.H))
                    },
                )
            }
        ),
        row!(
            "2 §4.5, R",
            "Ṙ(p) = Σ (Ė R E* + E R Ė* + E Ṙ E*)",
            "",
            "`Sensitivity::R`",
            Trees,
            |s| sensitivity(s, |r| r.R.clone(), |o| o.R.clone())
        ),
        row!(
            "2 §4.5, Υ",
            "Υ̇(k) = ψ̇*Υψ + ψ*Υ̇ψ + ψ*Υψ̇ + (H*D⁻¹H)˙",
            "",
            "`Sensitivity::upsilon`",
            Trees,
            |s| sensitivity(s, |r| r.upsilon.clone(), |o| o.upsilon.clone())
        ),
        row!(
            "2 §4.5, S",
            "Ṡ = φ̇ M φ* + φ M φ̇*",
            "",
            "`Sensitivity::state_covariance`",
            Trees,
            |s| sensitivity(s, |r| r.state_covariance.clone(), |o| o.state_covariance())
        ),
        row!(
            "2 §4.5, Ω",
            "Ω̇ = ψ̇* H*D⁻¹H ψ + ψ* (H*D⁻¹H)˙ ψ + ψ* H*D⁻¹H ψ̇",
            "",
            "`Sensitivity::omega`",
            Trees,
            |s| sensitivity(s, |r| r.omega.clone(), |o| o.omega())
        ),
        row!(
            "2 §4.5, 𝓜",
            "𝓜˙ = H (φ̇ M φ* + φ M φ̇*) H* + Ḣ S H* + H S Ḣ*, (𝓜⁻¹)˙ = −𝓜⁻¹ 𝓜˙ 𝓜⁻¹",
            "",
            "`Sensitivity::mass_matrix`, `mass_matrix_inverse`",
            Trees,
            |s| of_mass(s)
        ),
        row!(
            "2 §4.5, ln det",
            "∂ ln det 𝓜 = tr(D⁻¹ Ḋ) = 2 tr(Υ Ė_φ P⁺ E_φ*), of a universal joint and 2 tr(Ḣ (I − P⁺ Y⁺) G)",
            "",
            "`Sensitivity::D`, `E_phi`, `Operators::log_determinant_gradient`",
            Trees,
            |s| of_log_determinant(s)
        ),
    ]
}
