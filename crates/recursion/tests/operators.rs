//! The papers' operators of generated trees, in double-double numbers, against the dense twins of `phipsi-reference`, which
//! know no operators. The identities between them are in `papers.rs`.

use crate::common::seeds;
use nalgebra::DMatrix;
use phipsi_recursion::operators::Sensitivity;
use phipsi_recursion::{DynamicsError, Layout, Operators, forward_dynamics, mass_matrix};
use phipsi_reference::generate::{Case, Limits, case_within};
use phipsi_reference::sensitivity::widened;
use phipsi_spatial::{Dd, Real, Scalar, Vec3};
use phipsi_topology::Operator;

const CASES: u64 = 150;

/// Trees of up to fifteen degrees of freedom: dense matrices of double-double numbers are slow.
fn case(seed: u64) -> Case {
    case_within(seed, Limits { degrees_of_freedom: 1 + (seed % 13) as usize, decades: 0.5 })
}

fn largest(x: &[Dd]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs().hi))
}

/// Two results in double-double numbers, to what is left of their 31 digits after the condition of M.
fn assert_same(what: &str, seed: u64, got: &[Dd], want: &[Dd], lost: f64) {
    assert_eq!(got.len(), want.len(), "{what}, PHIPSI_SEED={seed}");
    let scale = largest(want).max(largest(got));
    for (i, (x, y)) in got.iter().zip(want).enumerate() {
        let error = (*x - *y).abs().hi;
        assert!(
            error <= 1e3 * Dd::EPSILON * lost * scale,
            "{what}[{i}], PHIPSI_SEED={seed}: {} instead of {}, error {error:e}",
            x.hi,
            y.hi
        );
    }
}

/// Rows first.
fn rows(a: &DMatrix<Dd>) -> Vec<Dd> {
    a.transpose().as_slice().to_vec()
}

fn dense(a: &Operator<Dd>) -> Vec<Dd> {
    rows(&a.dense().unwrap())
}

/// Terms of M⁻¹ cancel by the condition of M after scaling.
fn lost(case: &Case) -> f64 {
    crate::common::scaled_condition(case) * crate::common::growth(case)
}

#[test]
fn operators_give_the_matrices_of_the_reference() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let model = &case.model;
        let q = widened(&case.q);
        let ops = Operators::new(model, &q).unwrap();
        let lost = lost(&case);
        let mass = ops.mass_matrix();
        assert_same(
            "H φ M φ* H*",
            seed,
            &dense(&mass),
            &rows(&phipsi_reference::mass_matrix(model, &q)),
            1.0,
        );
        let inverse = phipsi_reference::mass_matrix_inverse(model, &q).unwrap();
        assert_same("L* D⁻¹ L", seed, &dense(&ops.mass_matrix_inverse()), &rows(&inverse), lost);
        assert_same("inverse()", seed, &dense(&mass.inverse().unwrap()), &rows(&inverse), lost);
        // B* φ* H* at a point, body axes; the reference's Jacobian is in world axes.
        let point = Vec3(case.point.0.map(Dd::from_f64));
        let b = ops.pick_off(&[(case.body, point)]).unwrap();
        let jacobian = &(&b.adjoint() * &ops.phi.adjoint()) * &ops.H.adjoint();
        let want = phipsi_reference::jacobian(model, &q, Some(case.body), Some(point));
        let zero = vec![Dd::from_f64(0.0); model.nv()];
        let pose = phipsi_reference::kinematics(model, &q, &zero, &zero)[case.body].pose;
        let got = jacobian.dense().unwrap();
        let turned = DMatrix::from_fn(6, model.nv(), |i, j| {
            let at = 3 * (i / 3);
            let column = Vec3([got[(at, j)], got[(at + 1, j)], got[(at + 2, j)]]);
            (pose.rotation * column).0[i - at]
        });
        assert_same("B* φ* H*", seed, &rows(&turned), &rows(&want), 1.0);
    }
}

#[test]
fn derivatives_as_expressions_are_those_of_the_reference() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let model = &case.model;
        // The increments of q are those of a unit quaternion.
        let mut q = widened(&case.q);
        model.normalize(&mut q);
        let (v, a, tau) = (widened(&case.v), widened(&case.a), widened(&case.tau));
        let ops = Operators::new(model, &q).unwrap();
        let lost = lost(&case);
        let forces = ops.inverse_dynamics(&v, &a).unwrap();
        // The expressions use componentwise rates: a common velocity costs digits that the sums of sizes tell.
        let speed = 1.0 + largest(&v) + largest(&a);
        let reach = ops.phi.dense().unwrap().iter().fold(1.0f64, |m, x| m.max(x.abs().hi));
        let terms = lost * reach * reach * speed * speed;
        let want = phipsi_reference::inverse_dynamics(model, &q, &v, &a, None);
        assert_same("inverse dynamics", seed, &forces, &want, terms);
        let want = phipsi_reference::forward_dynamics(model, &q, &v, &tau, None).unwrap();
        assert_same("forward dynamics", seed, &ops.forward_dynamics(&v, &tau).unwrap(), &want, terms);
        let mass = phipsi_reference::mass_matrix(model, &q);
        // The derivative by v of a single hinge vanishes: what stays is rounding of M times the speed.
        let floor = largest(&rows(&mass)) * largest(&v);
        let with = |mut x: Vec<Dd>, floor: f64| {
            x.push(Dd::from_f64(floor));
            x
        };
        let got = ops.inverse_dynamics_derivatives(&v, &a).unwrap();
        let want = phipsi_reference::inverse_dynamics_derivatives(model, &q, &v, &a, None);
        for (what, got, want) in [
            ("∂ID/∂q", &got.d_dq, &want.d_dq),
            ("∂ID/∂v", &got.d_dv, &want.d_dv),
            ("∂ID/∂a", &got.d_last, &want.d_last),
        ] {
            let (got, want) = (with(dense(got), floor), with(rows(want), floor));
            assert_same(what, seed, &got, &want, terms);
        }
        let growth = largest(&dense(&ops.mass_matrix_inverse()));
        let got = ops.forward_dynamics_derivatives(&v, &tau).unwrap();
        let want = phipsi_reference::forward_dynamics_derivatives(model, &q, &v, &tau, None).unwrap();
        for (what, got, want) in [
            ("∂FD/∂q", &got.d_dq, &want.d_dq),
            ("∂FD/∂v", &got.d_dv, &want.d_dv),
            ("∂FD/∂τ", &got.d_last, &want.d_last),
        ] {
            let (got, want) = (with(dense(got), floor * growth), with(rows(want), floor * growth));
            assert_same(what, seed, &got, &want, terms * lost);
        }
    }
}

/// Every operator of a model, in one order.
fn all(ops: &Operators<Dd>) -> Vec<(&'static str, Operator<Dd>)> {
    let own = |a: &Operator<Dd>| a.clone();
    vec![
        ("E_φ", own(&ops.E_phi)),
        ("φ", own(&ops.phi)),
        ("H", own(&ops.H)),
        ("P", own(&ops.P)),
        ("D", own(&ops.D)),
        ("D⁻¹", own(&ops.D_inverse)),
        ("G", own(&ops.G)),
        ("K", own(&ops.K)),
        ("τ̄", own(&ops.tau_bar)),
        ("E_ψ", own(&ops.E_psi)),
        ("ψ", own(&ops.psi)),
        ("R", own(&ops.R)),
        ("Υ", own(&ops.upsilon)),
        ("S", ops.state_covariance()),
        ("𝓜", ops.mass_matrix()),
        ("𝓜⁻¹", ops.mass_matrix_inverse()),
        ("Ω", ops.omega()),
    ]
}

fn all_rates(rates: &Sensitivity<Dd>) -> Vec<&Operator<Dd>> {
    let Sensitivity { E_phi, phi, H, P, D, D_inverse, G, K, tau_bar, E_psi, psi, R, .. } = rates;
    let Sensitivity { upsilon, state_covariance, mass_matrix, mass_matrix_inverse, omega, .. } = rates;
    let first = vec![E_phi, phi, H, P, D, D_inverse, G, K, tau_bar, E_psi, psi, R];
    [first, vec![upsilon, state_covariance, mass_matrix, mass_matrix_inverse, omega]].concat()
}

/// Sensitivities of all operators against differences along `Model::integrate`, in double-double numbers: a step of 1e-9
/// leaves an error of 1e-18 of the third derivative and 1e-22 of rounding.
#[test]
fn sensitivities_are_differences() {
    let step = Dd::from_f64(1e-9);
    for seed in seeds(60) {
        let case = case(seed);
        let model = &case.model;
        let mut q = widened(&case.q);
        model.normalize(&mut q);
        let ops = Operators::new(model, &q).unwrap();
        let nominal = all(&ops);
        for i in 0..model.nv() {
            let moved = |sign: f64| {
                let mut x = vec![Dd::from_f64(0.0); model.nv()];
                x[i] = step * Dd::from_f64(sign);
                all(&Operators::new(model, &model.integrate(&q, &x)).unwrap())
            };
            let (after, before) = (moved(1.0), moved(-1.0));
            let rates = ops.sensitivity(i).unwrap();
            for (k, rate) in all_rates(&rates).into_iter().enumerate() {
                let (name, value) = &nominal[k];
                let (plus, minus) = (after[k].1.dense().unwrap(), before[k].1.dense().unwrap());
                let want = (plus - minus) * (step + step).recip();
                let got = rate.dense().unwrap();
                let size = |a: &DMatrix<Dd>| largest(a.as_slice());
                let scale = size(&value.dense().unwrap()) + size(&want);
                let error = size(&(&got - &want));
                // Third derivatives of inverses grow with the cube of what the first derivative loses.
                let allowed = 1e-15 * scale * lost(&case);
                assert!(error <= allowed, "{name} by {i}, PHIPSI_SEED={seed}: error {error:e} of {scale:e}");
            }
        }
    }
}

/// In f64 the operators and the kernels are two evaluations of one result.
#[test]
fn operators_and_kernels_agree() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let ops = Operators::new(&case.model, &case.q).unwrap();
        let unit = crate::common::FACTOR * crate::common::steps(&case) * f64::EPSILON;
        let kernel = mass_matrix(&layout, &case.q).unwrap();
        let expression = ops.mass_matrix().dense().unwrap();
        let nv = case.model.nv();
        for (ij, &entry) in kernel.iter().enumerate() {
            let (i, j) = (ij / nv, ij % nv);
            // Entries of a Gram matrix round in proportion to the root of their diagonal entries.
            let size = (kernel[i * (nv + 1)] * kernel[j * (nv + 1)]).sqrt();
            let error = (expression[(i, j)] - entry).abs();
            assert!(error <= 4.0 * unit * size, "𝓜[{i},{j}], PHIPSI_SEED={seed}: {error:e} of {size:e}");
        }
        let kernel = forward_dynamics(&layout, &case.q, &case.v, &case.tau, None).unwrap();
        let expression = ops.forward_dynamics(&case.v, &case.tau).unwrap();
        let wide = Operators::new(&case.model, &widened(&case.q)).unwrap();
        let want = wide.forward_dynamics(&widened(&case.v), &widened(&case.tau)).unwrap();
        let scale = largest(&want);
        let reach = wide.phi.dense().unwrap().iter().fold(1.0f64, |m, x| m.max(x.abs().hi));
        let terms = crate::common::growth(&case) * crate::common::scaled_condition(&case) * reach * reach;
        for (what, got) in [("kernel", &kernel), ("expression", &expression)] {
            for (x, y) in got.iter().zip(&want) {
                let error = (x - y.hi).abs();
                assert!(
                    error <= unit * terms * (1.0 + scale),
                    "{what}, PHIPSI_SEED={seed}: {error:e} of {scale:e}"
                );
            }
        }
    }
}

#[test]
fn mistakes_are_named() {
    let case = case(4);
    let short = Operators::<f64>::new(&case.model, &[]).unwrap_err();
    assert!(matches!(short, DynamicsError::Shape { argument: "q", .. }));
    let ops = Operators::new(&case.model, &case.q).unwrap();
    assert!(ops.sensitivity(99).is_err());
    assert!(ops.pick_off(&[(99, Vec3::zero())]).is_err());
    assert!(ops.inverse_dynamics(&[], &case.a).is_err());
    assert!(ops.inverse_dynamics_derivatives(&case.v, &[]).is_err());
    assert!(ops.forward_dynamics_derivatives(&case.v, &[]).is_err());
}
