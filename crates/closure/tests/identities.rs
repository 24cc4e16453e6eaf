//! Identities of the projection I − b̂b̂* and of the projections onto the closures, in double and in double-double numbers.

use phipsi_closure::{ClosedDynamics, ClosedMomenta, ClosureError, Conditions, Number, Projection};
use phipsi_model::Random;
use phipsi_recursion::{Layout, solve_mass_matrix};
use phipsi_reference::generate::Case;
use phipsi_reference::loops::{ClosedCase, closed_case};
use phipsi_reference::sensitivity::widened;
use phipsi_spatial::{Dd, Real, Scalar};

const CASES: u64 = 200;

fn seeds() -> Vec<u64> {
    match std::env::var("PHIPSI_SEED") {
        Ok(seed) => vec![seed.parse().expect("PHIPSI_SEED is a whole number")],
        Err(_) => (0..CASES).collect(),
    }
}

fn largest<T: Real>(x: impl IntoIterator<Item = T>) -> f64 {
    x.into_iter().fold(0.0f64, |most, x| most.max(x.abs().to_f64()))
}

/// max over degrees of freedom of M_ii / D_i: what the factors of M may lose.
fn growth(case: &Case) -> f64 {
    let q = widened(&case.q);
    let m = phipsi_reference::mass_matrix(&case.model, &q);
    let d =
        phipsi_reference::articulated_joint_inertias(&case.model, &q).expect("generated trees are regular");
    d.iter().enumerate().map(|(i, d)| (m[(i, i)] / *d).hi).fold(1.0, f64::max)
}

/// Errors of: symmetry, idempotence, trace = n − rank, J l^−* (I − b̂b̂*) = 0 (relative to J l^−*).
fn errors<T: Number>(closed: &ClosedCase) -> ([f64; 4], usize) {
    let case = &closed.case;
    let q: Vec<T> = case.q.iter().map(|x| T::splat(*x)).collect();
    let mut projection = Projection::<T>::new(&case.model, &q).unwrap();
    let (n, rank, rows) = (projection.len(), projection.rank(), closed.gamma.len());
    let mut columns = Vec::new();
    for i in 0..n {
        let mut x = vec![T::zero(); n];
        x[i] = T::one();
        projection.apply(&mut x).unwrap();
        columns.push(x);
    }
    let mut worst = [0.0f64; 4];
    let mut trace = T::zero();
    for i in 0..n {
        trace += columns[i][i];
        let mut again = columns[i].clone();
        projection.apply(&mut again).unwrap();
        worst[1] = worst[1].max(largest((0..n).map(|j| again[j] - columns[i][j])));
        worst[0] = worst[0].max(largest((0..n).map(|j| columns[i][j] - columns[j][i])));
    }
    worst[2] = (trace - T::splat(n as f64 - rank as f64)).abs().to_f64();
    // Accelerations under unit forces keep the closures; M⁻¹ alone does not.
    let tree = case.model.clone().without_closures();
    let layout = phipsi_recursion::Layout::<T>::new(&tree);
    let sweep = phipsi_recursion::ArticulatedSweep::<T>::new(&layout, &q).unwrap();
    let mut work = phipsi_recursion::articulated_sweep::SolveWorkspace::new(&layout);
    let mut rates = vec![T::zero(); rows];
    for i in 0..n {
        let mut x = vec![T::zero(); n];
        x[i] = T::one();
        let mut free = x.clone();
        projection.solve(&mut x).unwrap();
        projection.closure_rates(&x, &mut rates).unwrap();
        let kept = largest(rates.iter().copied());
        sweep.solve_in_place(&layout, &mut free, &mut work);
        projection.closure_rates(&free, &mut rates).unwrap();
        let size = largest(rates.iter().copied()).max(largest(free.iter().copied()));
        worst[3] = worst[3].max(kept / size);
    }
    (worst, rank)
}

#[test]
fn the_projection_is_one() {
    let (mut worst, mut wide_worst, mut ranks) = ([0.0f64; 4], [0.0f64; 4], 0);
    for seed in seeds() {
        let closed = closed_case(seed);
        let n = closed.case.model.nv();
        let mut dynamics = ClosedDynamics::<f64>::new(&closed.case.model).unwrap();
        let mut a = vec![0.0; n];
        let (q, v) = (&closed.case.q, vec![0.0; n]);
        let sigma =
            dynamics.run(q, &v, &v, &Conditions::default(), &mut a).unwrap().info().smallest_pivot.min(1.0);
        // Rounding of the factors of M, and of b̂ by the weakest pivot.
        let unit = (closed.case.model.len() + n + closed.gamma.len()) as f64 * growth(&closed.case) / sigma;
        let (found, rank) = errors::<f64>(&closed);
        let (wide, wide_rank) = errors::<Dd>(&closed);
        assert_eq!(rank, wide_rank, "PHIPSI_SEED={seed}");
        ranks += rank;
        for i in 0..4 {
            worst[i] = worst[i].max(found[i] / (unit * f64::EPSILON));
            wide_worst[i] = wide_worst[i].max(wide[i] / (unit * Dd::EPSILON));
            assert!(found[i] <= unit * f64::EPSILON, "PHIPSI_SEED={seed}, identity {i}: {:e}", found[i]);
            // Closures hold to 1e-16: the rows left out as implied by others are so to 1e-16 only.
            let rounded = if i == 3 { 1e-14 } else { 0.0 };
            let allowed = unit * (16.0 * Dd::EPSILON + rounded);
            assert!(wide[i] <= allowed, "PHIPSI_SEED={seed}, identity {i} wide: {:e}", wide[i]);
        }
    }
    println!("symmetry, idempotence, trace, closures: {worst:?}, {wide_worst:?} in units of n·ε·growth/σ");
    assert!(ranks > 0);
}

/// Random velocities become the nearest consistent ones in the kinetic metric, as the dense solution says.
#[test]
fn velocities_are_projected_as_by_the_dense_metric() {
    let mut worst = 0.0f64;
    for seed in seeds() {
        let closed = closed_case(seed);
        let (case, n) = (&closed.case, closed.case.model.nv());
        let mut random = Random::new(seed);
        let v: Vec<f64> = (0..n).map(|_| random.signed()).collect();
        let wide_q = widened(&case.q);
        let (wide, zero) = (widened(&v), vec![Dd::from_f64(0.0); n]);
        let rates = phipsi_reference::closed_dynamics::closure_rates(&case.model, &wide_q, &wide, &zero);
        let mut dynamics = ClosedDynamics::<f64>::new(&case.model).unwrap();
        let given = phipsi_reference::closed_dynamics::Given {
            wrenches: None,
            gamma: rates.iter().map(|r| -r[0]).collect(),
            active: vec![false; n],
            acceleration: zero.clone(),
            length: dynamics.length(),
            tolerance: phipsi_reference::loops::TOLERANCE,
        };
        let still = case.model.clone().with_gravity([0.0; 3]);
        let change = phipsi_reference::closed_dynamics(&still, &wide_q, &zero, &zero, &given).unwrap();
        let mut got = v.clone();
        let done = dynamics.project_velocity(&case.q, &mut got, &Conditions::default()).unwrap();
        let m = phipsi_reference::mass_matrix(&case.model, &wide_q);
        let energy = |x: &[Dd]| {
            let mut sum = Dd::from_f64(0.0);
            (0..n).for_each(|i| (0..n).for_each(|j| sum += x[i] * m[(i, j)] * x[j]));
            0.5 * sum.hi
        };
        let mut a = vec![0.0; n];
        let still = vec![0.0; n];
        let info = dynamics.run(&case.q, &still, &still, &Conditions::default(), &mut a).unwrap().info();
        let unit = (case.model.len() + n + closed.gamma.len()) as f64 * growth(case)
            / info.smallest_pivot.min(1.0)
            * f64::EPSILON;
        let size = largest(v.iter().copied()).max(largest(change.acceleration.iter().copied()));
        let error = largest((0..n).map(|i| wide[i] + change.acceleration[i] - Dd::from_f64(got[i]))) / size;
        worst = worst.max(error / unit);
        assert!(error <= unit, "PHIPSI_SEED={seed}: {error:e}");
        let lost = energy(&change.acceleration);
        // Energy is quadratic: of the whole motion, not of what it loses.
        let allowed = 4.0 * unit * (energy(&wide) + lost);
        assert!((done.energy_removed - lost).abs() <= allowed, "PHIPSI_SEED={seed}: {done:?} {lost}");
    }
    println!("velocities: {worst:.2} n·ε·growth/σ");
}

/// From a hundredth of a radian beside, positions come back onto the closures.
#[test]
fn positions_are_projected() {
    let (mut refused, mut iterations, mut tried) = (0, 0, 0);
    for seed in seeds() {
        let closed = closed_case(seed);
        let case = &closed.case;
        let mut random = Random::new(seed);
        let step: Vec<f64> = (0..case.model.nv()).map(|_| 1e-2 * random.signed()).collect();
        let mut q = case.q.clone();
        case.model.normalize(&mut q);
        let mut q = case.model.integrate(&q, &step);
        let mut dynamics = ClosedDynamics::<f64>::new(&case.model).unwrap();
        tried += 1;
        match dynamics.project_position(&mut q, &Conditions::default()) {
            Ok(done) => {
                iterations = iterations.max(done.iterations);
                let rows = dynamics.rows();
                let (mut residual, none) = (vec![0.0; rows], &mut []);
                dynamics.residual(&q, None, &Conditions::default(), &mut residual, none).unwrap();
                assert_eq!(largest(residual), done.residual[1], "PHIPSI_SEED={seed}");
                let allowed = 1e-12 * dynamics.length().max(1.0);
                assert!(done.residual[1] < allowed, "PHIPSI_SEED={seed}: {done:?}");
            }
            Err(ClosureError::NotClosed { .. }) => refused += 1,
            Err(error) => panic!("PHIPSI_SEED={seed}: {error}"),
        }
    }
    println!("{refused} of {tried} not closed; at most {iterations} iterations");
    // Nearly singular ones may leave; none does so without saying it.
    assert!(refused * 50 <= tried, "{refused} of {tried}");
}

/// ln |det| by Gaussian elimination with partial pivoting.
fn log_determinant(mut a: Vec<Vec<f64>>) -> f64 {
    let n = a.len();
    let mut log = 0.0;
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| a[*i][k].abs().total_cmp(&a[*j][k].abs())).expect("a row");
        a.swap(k, pivot);
        log += a[k][k].abs().ln();
        let top = a[k].clone();
        for row in &mut a[k + 1..] {
            let factor = row[k] / top[k];
            (k..n).for_each(|j| row[j] -= factor * top[j]);
        }
    }
    log
}

/// 𝓜x = p, Jx = 0, p − f normal to all such x; and det 𝓜 det(J𝓜⁻¹J*) = |det| of the matrix with blocks 𝓜, J*, J, 0.
#[test]
fn momenta_are_those_of_dense_matrices() {
    let mut regular = 0;
    for seed in seeds() {
        let closed = closed_case(seed);
        let (model, q, n) = (&closed.case.model, &closed.case.q, closed.case.model.nv());
        let mut dynamics = ClosedDynamics::<f64>::new(model).unwrap();
        let (rows, length) = (dynamics.rows(), dynamics.length());
        let (mut position, mut rates) = (vec![0.0; rows], vec![0.0; rows]);
        let mut jacobian = vec![vec![0.0; n]; rows];
        let m = phipsi_reference::mass_matrix(model, &widened(q));
        for i in 0..n {
            let mut v = vec![0.0; n];
            v[i] = 1.0;
            dynamics.residual(q, Some(&v), &Conditions::default(), &mut position, &mut rates).unwrap();
            rates.iter().enumerate().for_each(|(r, x)| jacobian[r][i] = *x);
        }
        for (i, closure) in model.closures().iter().enumerate() {
            let first = dynamics.closure(i).1.start;
            for row in &mut jacobian[first..first + closure.kind.angular_rows()] {
                row.iter_mut().for_each(|x| *x *= length);
            }
        }
        for (i, coupling) in model.couplings().iter().enumerate() {
            let joint = model.find_joint(&coupling.joint).unwrap();
            if model.joints()[joint].kind.is_rotation(0) {
                let row = dynamics.closure(model.closures().len() + i).1.start;
                jacobian[row].iter_mut().for_each(|x| *x *= length);
            }
        }
        let mut a = vec![0.0; n];
        let still = vec![0.0; n];
        let info = dynamics.run(q, &still, &still, &Conditions::default(), &mut a).unwrap().info();
        let unit = (model.len() + n + rows) as f64 * growth(&closed.case) / info.smallest_pivot.min(1.0);
        // As the kernels': 4 n·ε·κ.
        let allowed = 4.0 * unit * f64::EPSILON;

        let mut momenta = ClosedMomenta::<f64>::new(model).unwrap();
        momenta.place(q).unwrap();
        assert_eq!(momenta.rank(), info.rank, "PHIPSI_SEED={seed}");
        let mut random = Random::new(seed);
        let f: Vec<f64> = (0..n).map(|_| random.signed()).collect();
        let (mut x, mut p) = (vec![0.0; n], vec![0.0; n]);
        momenta.solve(&f, None, &mut x, &mut p).unwrap();
        let product = |x: &[f64]| -> Vec<f64> {
            (0..n)
                .map(|i| (0..n).fold(Dd::from_f64(0.0), |s, j| s + m[(i, j)] * Dd::from_f64(x[j])).hi)
                .collect()
        };
        let size = largest(f.iter().copied()).max(largest(p.iter().copied()));
        let off = largest(product(&x).iter().zip(&p).map(|(a, b)| a - b));
        assert!(off <= allowed * size, "PHIPSI_SEED={seed}: 𝓜x − p = {off:e}");
        // x is what the forces do to the open tree less what the loops take back.
        let open_tree = Layout::new(&model.clone().without_closures());
        let free = largest(solve_mass_matrix(&open_tree, q, &f).unwrap());
        let scale = largest(jacobian.iter().flatten().copied()) * free.max(largest(x.iter().copied()));
        let open = largest(jacobian.iter().map(|row| row.iter().zip(&x).map(|(a, b)| a * b).sum::<f64>()));
        assert!(open <= allowed * scale, "PHIPSI_SEED={seed}: Jx = {open:e}");
        // A second tangent vector.
        let g: Vec<f64> = (0..n).map(|_| random.signed()).collect();
        let (mut y, mut unused) = (vec![0.0; n], vec![0.0; n]);
        momenta.solve(&g, None, &mut y, &mut unused).unwrap();
        let normal: f64 = (0..n).map(|i| (p[i] - f[i]) * y[i]).sum();
        let terms: f64 =
            (0..n).map(|i| ((p[i] - f[i]) * y[i]).abs()).sum::<f64>() + size * largest(y.clone()).max(free);
        assert!(normal.abs() <= allowed * terms, "PHIPSI_SEED={seed}: {normal:e}");

        match momenta.log_determinant() {
            None => assert!(info.rank < rows, "PHIPSI_SEED={seed}"),
            Some(log) => {
                regular += 1;
                let mut kkt = vec![vec![0.0; n + rows]; n + rows];
                for i in 0..n {
                    (0..n).for_each(|j| kkt[i][j] = m[(i, j)].hi);
                    for (r, row) in jacobian.iter().enumerate() {
                        (kkt[i][n + r], kkt[n + r][i]) = (row[i], row[i]);
                    }
                }
                let dense = log_determinant(kkt);
                // A logarithm errs by the relative errors of all pivots.
                assert!((log - dense).abs() <= allowed.max(1e-9), "PHIPSI_SEED={seed}: {log} {dense}");
            }
        }
    }
    assert!(regular > 20 || seeds().len() == 1, "{regular}");
}
