//! B*ΩB of random mechanisms against J M⁻¹ J* of dense matrices in double-double numbers, and by what it is for.

use phipsi_closure::{ClosedDynamics, ClosureCompliance, Conditions};
use phipsi_model::Model;
use phipsi_reference::closed_dynamics::closure_jacobian;
use phipsi_reference::dense::{Factors, tips_first};
use phipsi_reference::generate::Case;
use phipsi_reference::loops::{ClosedCase, closed_again, closed_case};
use phipsi_reference::sensitivity::{sensitivity, widened};
use phipsi_spatial::{Dd, Vec3};

const CASES: u64 = 300;
const SAMPLES: usize = 6;

/// Roundings per step of a sweep, beyond the n of n·ε·κ, as for the sweeps of trees.
const FACTOR: f64 = 4.0;

fn seeds() -> Vec<u64> {
    match std::env::var("PHIPSI_SEED") {
        Ok(seed) => vec![seed.parse().expect("PHIPSI_SEED is a whole number")],
        Err(_) => (0..CASES).collect(),
    }
}

/// J M⁻¹ J*, by rows.
fn dense(model: &Model, q: &[f64]) -> Vec<Dd> {
    let q = widened(q);
    let factors = Factors::new(&phipsi_reference::mass_matrix(model, &q), tips_first(model), 0.0)
        .expect("generated trees are regular");
    let j = closure_jacobian(model, &q);
    let (m, n) = (j.nrows(), j.ncols());
    let row = |i: usize| -> Vec<Dd> { (0..n).map(|k| j[(i, k)]).collect() };
    let images: Vec<Vec<Dd>> = (0..m).map(|i| factors.solve(&row(i))).collect();
    let dot = |a: &[Dd], b: &[Dd]| a.iter().zip(b).fold(Dd::from_f64(0.0), |s, (a, b)| s + *a * *b);
    (0..m).flat_map(|i| (0..m).map(|k| dot(&row(i), &images[k])).collect::<Vec<_>>()).collect()
}

/// The largest compliance of an end of a closure by itself: what both ends move together is rounded before it goes.
fn of_ends(model: &Model, q: &[f64]) -> f64 {
    let q = widened(q);
    let factors = Factors::new(&phipsi_reference::mass_matrix(model, &q), tips_first(model), 0.0)
        .expect("generated trees are regular");
    let mut most = 0.0f64;
    for closure in model.closures() {
        for (body, pose) in [(&closure.body_a, closure.pose_a), (&closure.body_b, closure.pose_b)] {
            let Some(k) = model.find_body(body).expect("a body") else { continue };
            let point = Vec3(pose.translation.map(Dd::from_f64));
            let j = phipsi_reference::jacobian(model, &q, Some(k), Some(point));
            for i in 0..6 {
                let row: Vec<Dd> = (0..model.nv()).map(|k| j[(i, k)]).collect();
                let image = factors.solve(&row);
                let square = row.iter().zip(&image).fold(Dd::from_f64(0.0), |s, (a, b)| s + *a * *b);
                most = most.max(square.hi);
            }
        }
    }
    most
}

/// max over degrees of freedom of M_ii / D_i: what the factors of M may lose.
fn growth(case: &Case) -> f64 {
    let q = widened(&case.q);
    let m = phipsi_reference::mass_matrix(&case.model, &q);
    let d =
        phipsi_reference::articulated_joint_inertias(&case.model, &q).expect("generated trees are regular");
    d.iter().enumerate().map(|(i, d)| (m[(i, i)] / *d).hi).fold(1.0, f64::max)
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0f64, |m, x| m.max(x.abs()))
}

fn judge(closed: &ClosedCase, seed: u64) -> f64 {
    let (model, rows) = (&closed.case.model, closed.gamma.len());
    let mut work = ClosureCompliance::<f64>::new(model).unwrap();
    assert_eq!(work.rows(), rows);
    let mut got = vec![f64::NAN; rows * rows];
    work.run(&closed.case.q, &mut got).unwrap();
    for i in 0..rows {
        for j in 0..rows {
            assert_eq!(got[i * rows + j], got[j * rows + i], "PHIPSI_SEED={seed}: {i}, {j}");
        }
    }
    let tree = Case { model: model.clone().without_closures(), ..closed.case.clone() };
    let all = |case: &Case| -> Vec<Dd> {
        let again = closed_again(case, &closed.drafts);
        dense(&again.case.model, &again.case.q)
    };
    let (want, size) = sensitivity(&tree, SAMPLES, seed, all);
    let unit = (model.len() + model.nv() + rows) as f64 * f64::EPSILON * growth(&tree);
    let error = largest(&got.iter().zip(&want).map(|(x, y)| (Dd::from_f64(*x) - *y).hi).collect::<Vec<_>>());
    let kappa = largest(&size).max(of_ends(model, &closed.case.q));
    let ratio = if error == 0.0 { 0.0 } else { error / (unit * kappa) };
    assert!(ratio <= FACTOR, "PHIPSI_SEED={seed}: {ratio} n·ε·κ");
    ratio
}

#[test]
fn compliances_of_random_mechanisms() {
    let mut worst = (0.0f64, 0);
    let (mut rows, mut couplings) = (0, 0);
    for seed in seeds() {
        let closed = closed_case(seed);
        let ratio = judge(&closed, seed);
        rows += closed.gamma.len();
        couplings += closed.case.model.couplings().len();
        if ratio > worst.0 {
            worst = (ratio, seed);
        }
    }
    println!("compliances: worst n·ε·κ {worst:?}; {rows} rows, {couplings} couplings");
    assert!(std::env::var("PHIPSI_SEED").is_ok() || couplings > 20);
}

/// At rest and without weight, forces of the closures that hold the rows' accelerations off the free ones: B*ΩB λ = J (θ̈ − θ̈_free).
#[test]
fn compliances_give_the_forces_of_closures() {
    for seed in 0..40 {
        let closed = closed_case(seed);
        let model = closed.case.model.clone().with_gravity([0.0; 3]);
        let (n, rows, q) = (model.nv(), closed.gamma.len(), &closed.case.q);
        let mut dynamics = ClosedDynamics::<f64>::new(&model).unwrap();
        let (rest, mut held, mut free) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let mut lambda = vec![0.0; rows];
        let none = Conditions::default();
        let mut solved = dynamics.run(q, &rest, &closed.case.tau, &none, &mut held).unwrap();
        let sigma = solved.info().smallest_pivot.min(1.0);
        solved.closure_forces(&mut lambda).unwrap();
        let open = model.clone().without_closures();
        let mut tree = ClosedDynamics::<f64>::new(&open).unwrap();
        tree.run(q, &rest, &closed.case.tau, &none, &mut free).unwrap();
        let mut work = ClosureCompliance::<f64>::new(&model).unwrap();
        let mut omega = vec![0.0; rows * rows];
        work.run(q, &mut omega).unwrap();
        let j = closure_jacobian(&model, &widened(q));
        let size = |x: &[f64]| x.iter().map(|x| x.abs()).sum::<f64>();
        let (mut worst, mut all) = (0.0f64, 0.0f64);
        for i in 0..rows {
            let terms: Vec<f64> = (0..rows).map(|k| omega[i * rows + k] * lambda[k]).collect();
            let change: Vec<f64> = (0..n).map(|k| j[(i, k)].hi * (held[k] - free[k])).collect();
            let given: Vec<f64> = (0..n).map(|k| j[(i, k)].hi * free[k]).collect();
            all = all.max(size(&terms) + size(&change) + size(&given));
            worst = worst.max((terms.iter().sum::<f64>() - change.iter().sum::<f64>()).abs());
        }
        // λ are good to ε/σ.
        let unit = (model.len() + n + rows) as f64 * f64::EPSILON * growth(&closed.case) / sigma;
        assert!(worst <= FACTOR * unit * all, "seed {seed}: {worst:e} of {all:e}");
    }
}
