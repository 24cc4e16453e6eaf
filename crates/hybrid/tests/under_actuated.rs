//! The operators between active and passive degrees of freedom against partitions of the dense mass matrix.

use nalgebra::DMatrix;
use phipsi_hybrid::{HybridError, UnderActuated, placements};
use phipsi_model::Random;
use phipsi_recursion::{Layout, hybrid_dynamics};
use phipsi_reference::generate::{Case, Limits, case_within};
use phipsi_reference::sensitivity::widened;
use phipsi_spatial::{Dd, Real, Scalar, Vec3};
use phipsi_topology::Operator;

fn case(seed: u64) -> Case {
    case_within(seed, Limits { degrees_of_freedom: 2 + (seed % 9) as usize, decades: 0.5 })
}

/// `PHIPSI_SEED`, or the first `count`.
fn seeds(count: u64) -> Vec<u64> {
    match std::env::var("PHIPSI_SEED") {
        Ok(seed) => vec![seed.parse().expect("PHIPSI_SEED is a whole number")],
        Err(_) => (0..count).collect(),
    }
}

fn pattern(seed: u64, nv: usize) -> Vec<bool> {
    let mut random = Random::new(seed);
    (0..nv).map(|_| random.uniform() < 0.5).collect()
}

fn part(m: &DMatrix<Dd>, active: &[bool], rows: bool, columns: bool) -> DMatrix<Dd> {
    let pick = |want: bool| (0..active.len()).filter(|&i| active[i] == want).collect::<Vec<_>>();
    let (rows, columns) = (pick(rows), pick(columns));
    DMatrix::from_fn(rows.len(), columns.len(), |i, j| m[(rows[i], columns[j])])
}

fn size(m: &DMatrix<Dd>) -> f64 {
    m.iter().fold(0.0, |s, x| s.max(x.abs().hi))
}

/// A⁻¹ of a symmetric positive matrix, by the reference's elimination.
fn inverse(m: &DMatrix<Dd>) -> DMatrix<Dd> {
    let n = m.nrows();
    let factors = phipsi_reference::dense::Factors::new(m, (0..n).collect(), 0.0).unwrap();
    let mut out = DMatrix::from_element(n, n, Dd::from_f64(0.0));
    for j in 0..n {
        let mut unit = vec![Dd::from_f64(0.0); n];
        unit[j] = Dd::from_f64(1.0);
        factors.solve(&unit).into_iter().enumerate().for_each(|(i, x)| out[(i, j)] = x);
    }
    out
}

/// In double-double numbers: what is left of 31 digits after the condition of the passive mass matrix.
#[test]
fn operators_are_partitions_of_the_mass_matrix() {
    for seed in seeds(200) {
        let case = case(seed);
        let q = widened(&case.q);
        let active = pattern(seed, case.model.nv());
        let system = UnderActuated::new(&case.model, &q, &active).unwrap();
        let m = phipsi_reference::mass_matrix(&case.model, &q);
        let [aa, ap, pa, pp] = [(true, true), (true, false), (false, true), (false, false)]
            .map(|(rows, columns)| part(&m, &active, rows, columns));
        let pp_inverse = inverse(&pp);
        let lost = 1.0 + size(&pp) * size(&pp_inverse);
        let check = |what: &str, got: &Operator<Dd>, want: &DMatrix<Dd>, scale: f64| {
            let error = size(&(got.dense().unwrap() - want));
            let allowed = 1e2 * Dd::EPSILON * lost * lost * scale;
            assert!(error <= allowed, "{what}, PHIPSI_SEED={seed}: {error:e} of {scale:e}");
        };
        let coupling = &ap * &pp_inverse;
        check("S_pp", &system.S_pp, &pp_inverse, size(&pp_inverse));
        check("S_ap", &system.S_ap, &coupling, size(&coupling).max(size(&m) * size(&pp_inverse)));
        check("S_aa", &system.S_aa, &(&aa - &coupling * &pa), size(&m) * (1.0 + size(&coupling)));
    }
}

/// The kernel, its velocity terms and gravity taken off, is the product of (4.22).
#[test]
fn the_kernel_is_the_product() {
    for seed in seeds(200) {
        let case = case(seed);
        let active = pattern(seed, case.model.nv());
        let (q, a, tau) = (widened(&case.q), widened(&case.a), widened(&case.tau));
        let layout = Layout::<Dd>::new(&case.model).with_gravity(Vec3::zero());
        let rest = vec![Dd::from_f64(0.0); case.model.nv()];
        let (got_a, got_tau) = hybrid_dynamics(&layout, &q, &rest, &active, &a, &tau, None).unwrap();
        let system = UnderActuated::new(&case.model, &q, &active).unwrap();
        let chosen = |x: &[Dd], want: bool| -> Vec<Dd> {
            x.iter().zip(&active).filter(|(_, is)| **is == want).map(|(x, _)| *x).collect()
        };
        let (a_active, tau_passive) = (chosen(&a, true), chosen(&tau, false));
        let sum = |x: Vec<Dd>, y: Vec<Dd>, sign: f64| -> Vec<Dd> {
            x.iter().zip(&y).map(|(x, y)| *x + *y * Dd::from_f64(sign)).collect()
        };
        let forces =
            sum(system.S_aa.apply(&a_active).unwrap(), system.S_ap.apply(&tau_passive).unwrap(), 1.0);
        let pushed = system.S_ap.adjoint().apply(&a_active).unwrap();
        let accelerations = sum(system.S_pp.apply(&tau_passive).unwrap(), pushed, -1.0);
        let m = phipsi_reference::mass_matrix(&case.model, &q);
        let pp = part(&m, &active, false, false);
        let lost = 1.0 + size(&m) * size(&inverse(&pp));
        for (what, got, want) in
            [("T_a", chosen(&got_tau, true), forces), ("θ̈_p", chosen(&got_a, false), accelerations)]
        {
            let scale = want.iter().fold(1.0f64, |s, x| s.max(x.abs().hi));
            for (x, y) in got.iter().zip(&want) {
                let error = (*x - *y).abs().hi;
                let allowed = 1e2 * Dd::EPSILON * lost * lost * scale;
                assert!(error <= allowed, "{what}, PHIPSI_SEED={seed}: {error:e} of {scale:e}");
            }
        }
    }
}

/// Along the generalised Jacobian's motion the passive momenta stay zero, and points move as it says.
#[test]
fn generalized_jacobians_keep_passive_momenta() {
    for seed in seeds(100) {
        let case = case(seed);
        let q = widened(&case.q);
        let active = pattern(seed, case.model.nv());
        let system = UnderActuated::new(&case.model, &q, &active).unwrap();
        let count = active.iter().filter(|a| **a).count();
        let rates: Vec<Dd> = widened(&case.v)[..count].to_vec();
        let follow = system.S_ap.adjoint().apply(&rates).unwrap();
        let (mut a, mut p) = (rates.iter(), follow.iter());
        let v: Vec<Dd> =
            active.iter().map(|&is| if is { *a.next().unwrap() } else { -*p.next().unwrap() }).collect();
        let momenta = phipsi_reference::multiply_by_mass_matrix(&case.model, &q, &v);
        let m = phipsi_reference::mass_matrix(&case.model, &q);
        let lost = (1.0 + size(&m) * size(&inverse(&part(&m, &active, false, false)))).powi(2);
        let speed = v.iter().fold(0.0f64, |s, x| s.max(x.abs().hi));
        for (x, _) in momenta.iter().zip(&active).filter(|(_, is)| !**is) {
            let allowed = 1e2 * Dd::EPSILON * lost * size(&m) * speed;
            assert!(x.abs().hi <= allowed, "momentum, PHIPSI_SEED={seed}: {:e}", x.hi);
        }
        let point = Vec3(case.point.0.map(Dd::from_f64));
        let got = system.generalized_jacobian(&[(case.body, point)]).unwrap().apply(&rates).unwrap();
        let full = system.operators.pick_off(&[(case.body, point)]).unwrap().adjoint()
            * system.operators.phi.adjoint()
            * system.operators.H.adjoint();
        let want = full.apply(&v).unwrap();
        let reach = size(&full.dense().unwrap());
        for (x, y) in got.iter().zip(&want) {
            assert!((*x - *y).abs().hi <= 1e2 * Dd::EPSILON * lost * reach * speed, "PHIPSI_SEED={seed}");
        }
    }
}

#[test]
fn placements_are_ordered_and_complete() {
    let case = case_within(11, Limits { degrees_of_freedom: 6, decades: 0.0 });
    let nv = case.model.nv();
    let all: Vec<usize> = (0..nv).collect();
    let found = placements(&case.model, &case.q, &all, 2, (case.body, case.point)).unwrap();
    assert_eq!(found.len(), nv * (nv - 1) / 2);
    assert!(found.windows(2).all(|w| w[0].measures.manipulability >= w[1].measures.manipulability));
    let full = placements(&case.model, &case.q, &all, nv, (case.body, case.point)).unwrap();
    let jacobian =
        phipsi_recursion::jacobian(&Layout::new(&case.model), &case.q, Some(case.body), Some(case.point))
            .unwrap();
    // With every axis driven the generalised Jacobian is the Jacobian: equal singular values in any axes.
    let mut want = DMatrix::from_row_slice(6, nv, &jacobian.concat()).singular_values().as_slice().to_vec();
    want.sort_by(|a, b| b.total_cmp(a));
    let scale = want[0].max(1.0);
    assert!(full[0].measures.reach.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-12 * scale));
    assert!(full[0].measures.coupling.is_empty());
    let none = placements(&case.model, &case.q, &all, 0, (case.body, case.point)).unwrap_err();
    assert!(matches!(none, HybridError::Count { actuators: 0, .. }));
    let short = UnderActuated::<f64>::new(&case.model, &case.q, &[]).unwrap_err();
    assert!(short.to_string().contains("active"));
}
