//! Derivatives against dual numbers through the reference and through the kernels themselves, and what they must fulfil.

use crate::common::{FACTOR, agree_on, compare, growth, scaled_condition, seeds, steps, wide_wrenches};
use phipsi_model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random};
use phipsi_recursion as fast;
use phipsi_recursion::{
    ForwardDynamicsDerivatives, Layout, bias_forces, forward_dynamics, forward_dynamics_derivatives,
    gravity_forces, inverse_dynamics, inverse_dynamics_derivatives, mass_matrix, mass_matrix_inverse,
};
use phipsi_reference as slow;
use phipsi_reference::Dual;
use phipsi_reference::generate::{Case, Limits, case, case_within};
use phipsi_reference::inverse_dynamics_derivatives::{Derivatives, fixed_wrenches, seeded, tangent};
use phipsi_reference::sensitivity::{sensitivity, widened};
use phipsi_spatial::{Dd, Motion, Real, Scalar, Vec3, Wrench};

/// Trees whose derivatives are compared: each costs 2 nv dual evaluations of the reference for every perturbation.
const TREES: u64 = 500;

/// Perturbations that κ is estimated from; the floors below make up for few of them.
const SAMPLES: usize = 3;

const CASES: u64 = 300;

/// See [`floor`].
const PART: f64 = 0.1;

/// The allowed rounding of a case, relative to a sum of |terms|.
fn unit(case: &Case) -> f64 {
    FACTOR * steps(case) * f64::EPSILON
}

fn rows(d: &Derivatives<Dd>) -> Vec<Dd> {
    [&d.d_dq, &d.d_dv, &d.d_last].iter().flat_map(|m| m.transpose().as_slice().to_vec()).collect()
}

fn slow_inverse(case: &Case) -> Vec<Dd> {
    let (q, v, a) = (widened(&case.q), widened(&case.v), widened(&case.a));
    rows(&slow::inverse_dynamics_derivatives(&case.model, &q, &v, &a, Some(&wide_wrenches(case))))
}

fn slow_forward(case: &Case) -> Vec<Dd> {
    let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
    let all = slow::forward_dynamics_derivatives(&case.model, &q, &v, &tau, Some(&wide_wrenches(case)));
    rows(&all.expect("generated trees are regular"))
}

fn joined<T>((a, b, c): (Vec<T>, Vec<T>, Vec<T>)) -> Vec<T> {
    a.into_iter().chain(b).chain(c).collect()
}

/// Roots of the diagonals of M and M⁻¹: units of forces and of accelerations.
fn units(case: &Case) -> (Vec<f64>, Vec<f64>) {
    let q = widened(&case.q);
    let m = slow::mass_matrix(&case.model, &q);
    let inverse = slow::mass_matrix_inverse(&case.model, &q).expect("generated trees are regular");
    let root = |i: usize, m: &nalgebra::DMatrix<Dd>| m[(i, i)].hi.sqrt();
    (
        (0..case.model.nv()).map(|i| root(i, &m)).collect(),
        (0..case.model.nv()).map(|i| root(i, &inverse)).collect(),
    )
}

/// Entries that cancel answer to no input, but their terms round. In units in which M has ones on its diagonal, terms of all
/// entries are products of motions of size one with the squares of the rates of the mechanism: `part` of the largest entry,
/// and for the reference, which rounds too, `rest`, stand for them.
fn floor(size: &mut [f64], rows: &[f64], columns: &[f64], part: f64, rest: f64) {
    let n = rows.len();
    let of = |ij: usize| rows[ij / n] * columns[ij % n];
    let largest = size.iter().enumerate().fold(0.0f64, |m, (ij, x)| m.max(x / of(ij)));
    for (ij, x) in size.iter_mut().enumerate() {
        *x = x.max(of(ij) * (part * largest + rest));
    }
}

/// Sum of the rates of the joints.
fn speed(case: &Case) -> f64 {
    case.v.iter().map(|v| v.abs()).sum()
}

/// What the reference rounds in units of the rounding ε of the kernel: double-double ε of terms with the squares of all speeds.
fn reference(case: &Case, epsilon: f64) -> f64 {
    16.0 * Dd::EPSILON / epsilon * (1.0 + speed(case).powi(2))
}

/// [`floor`] for each of the three derivatives of inverse dynamics.
fn inverse_floors(case: &Case, size: &mut [f64], part: f64, epsilon: f64) {
    let (force, _) = units(case);
    let rest = reference(case, epsilon);
    // An axis turns itself by nothing: ω × s vanishes, but in the axes of the ground its products round. In a matrix that vanishes
    // altogether no entry shows their size, which is that of the rates.
    let turning = [0.0, part * speed(case), 0.0];
    for (matrix, turning) in size.chunks_exact_mut(force.len() * force.len()).zip(turning) {
        floor(matrix, &force, &force, part, rest + turning);
    }
}

/// −M⁻¹ ∂T: the forces' derivatives round by their own κ, which M⁻¹ carries to the accelerations, also where it cancels what
/// a joint with all six degrees of freedom keeps from its parent.
fn through_inverse(case: &Case, samples: usize, size: &mut [f64]) {
    let nv = case.model.nv();
    let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
    let a = slow::forward_dynamics(&case.model, &q, &v, &tau, Some(&wide_wrenches(case)));
    let a = a.expect("generated trees are regular").iter().map(|x| x.hi).collect();
    let moving = Case { a, ..case.clone() };
    let (_, mut forces) = sensitivity(&moving, samples, 0, slow_inverse);
    inverse_floors(&moving, &mut forces, PART, f64::EPSILON);
    let inverse = slow::mass_matrix_inverse(&case.model, &q).expect("generated trees are regular");
    for (matrix, forces) in size.chunks_exact_mut(nv * nv).zip(forces.chunks_exact(nv * nv)) {
        for (ij, x) in matrix.iter_mut().enumerate() {
            let terms = (0..nv).map(|k| inverse[(ij / nv, k)].hi.abs() * forces[k * nv + ij % nv]);
            *x = x.max(terms.sum());
        }
    }
}

/// The same for forward dynamics: rows are accelerations.
fn forward_floors(case: &Case, samples: usize, size: &mut [f64], part: f64, epsilon: f64) {
    let (force, acceleration) = units(case);
    let n = force.len() * force.len();
    let rest = reference(case, epsilon);
    through_inverse(case, samples, &mut size[..2 * n]);
    floor(&mut size[..n], &acceleration, &force, part, rest);
    floor(&mut size[n..2 * n], &acceleration, &force, part, rest);
    floor(&mut size[2 * n..], &acceleration, &acceleration, part, rest);
}

#[test]
fn derivatives_of_inverse_dynamics() {
    agree_on(
        TREES,
        SAMPLES,
        "inverse_dynamics_derivatives",
        |layout, case| {
            let wrenches = Some(&case.wrenches[..]);
            inverse_dynamics_derivatives(layout, &case.q, &case.v, &case.a, wrenches).map(joined)
        },
        slow_inverse,
        |case, _, size| inverse_floors(case, size, PART, f64::EPSILON),
    );
}

#[test]
fn derivatives_of_forward_dynamics() {
    agree_on(
        TREES,
        SAMPLES,
        "forward_dynamics_derivatives",
        |layout, case| {
            let wrenches = Some(&case.wrenches[..]);
            forward_dynamics_derivatives(layout, &case.q, &case.v, &case.tau, wrenches).map(joined)
        },
        slow_forward,
        |case, samples, size| {
            forward_floors(case, samples, size, PART, f64::EPSILON);
            let growth = growth(case);
            size.iter_mut().for_each(|x| *x *= growth);
        },
    );
}

#[test]
fn innovations_operator() {
    agree_on(
        TREES,
        SAMPLES,
        "innovations_operator",
        |layout, case| fast::innovations_operator(layout, &case.q),
        |case| {
            let operator = slow::innovations_operator(&case.model, &widened(&case.q));
            operator.expect("generated trees are regular").transpose().as_slice().into()
        },
        |case, _, size| {
            let (force, _) = units(case);
            let inverse: Vec<f64> = force.iter().map(|x| x.recip()).collect();
            floor(size, &force, &inverse, PART, reference(case, f64::EPSILON));
            let growth = growth(case);
            size.iter_mut().for_each(|x| *x *= growth);
        },
    );
}

/// The derivative kernels in the scalar T on one case, within n·ε·κ of T; `loss` multiplies κ of forward dynamics.
fn check<T: Real>(seed: u64, case: &Case, loss: f64, part: f64) {
    let convert = |x: &[f64]| x.iter().map(|&x| T::splat(x)).collect::<Vec<T>>();
    let (q, v, a, tau) = (convert(&case.q), convert(&case.v), convert(&case.a), convert(&case.tau));
    let wrenches: Vec<Wrench<T>> =
        case.wrenches.iter().map(|w| Wrench::from_array(w.to_array().map(T::splat))).collect();
    let layout = Layout::<T>::new(&case.model);
    let unit = steps(case) * T::EPSILON;
    let (want, mut size) = sensitivity(case, SAMPLES, seed, slow_inverse);
    inverse_floors(case, &mut size, part, T::EPSILON);
    let got = joined(inverse_dynamics_derivatives(&layout, &q, &v, &a, Some(&wrenches)).unwrap());
    compare("inverse_dynamics_derivatives", seed, &got, &want, &size, unit);
    let (want, mut size) = sensitivity(case, SAMPLES, seed, slow_forward);
    forward_floors(case, SAMPLES, &mut size, part, T::EPSILON);
    size.iter_mut().for_each(|x| *x *= loss);
    let got = joined(forward_dynamics_derivatives(&layout, &q, &v, &tau, Some(&wrenches)).unwrap());
    compare("forward_dynamics_derivatives", seed, &got, &want, &size, unit);
}

/// Thirty digits of the largest entry: the reference rounds as much as the kernel here.
#[test]
fn double_double_derivatives_keep_thirty_digits() {
    for seed in seeds(60) {
        let case = case(seed);
        check::<Dd>(seed, &case, scaled_condition(&case), 1.0);
    }
}

#[test]
fn single_precision_derivatives_run() {
    for seed in seeds(60) {
        let limits = Limits { degrees_of_freedom: 1 + (seed % 12) as usize, decades: 0.5 };
        let mut case = case_within(seed, limits);
        for x in [&mut case.q, &mut case.v, &mut case.a, &mut case.tau] {
            x.iter_mut().for_each(|x| *x = f64::from(*x as f32));
        }
        for w in &mut case.wrenches {
            *w = Wrench::from_array(w.to_array().map(|x| f64::from(x as f32)));
        }
        check::<f32>(seed, &case, growth(&case), PART);
    }
}

/// The kernels of inverse and forward dynamics themselves on dual numbers, along one direction of everything.
#[test]
fn kernels_on_dual_numbers_agree_with_the_derivatives() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let (layout, nv) = (Layout::<f64>::new(&case.model), case.model.nv());
        let dual = Layout::<Dual<f64>>::new(&case.model);
        let mut random = Random::new(seed);
        let mut direction = || (0..nv).map(|_| random.signed()).collect::<Vec<f64>>();
        let (x, y, z) = (direction(), direction(), direction());
        let q = seeded(&case.q, &tangent(&case.model, &case.q, &x));
        let (v, wrenches) = (seeded(&case.v, &y), fixed_wrenches(&case.wrenches));
        let along = |(d_dq, d_dv, d_last): &(Vec<f64>, Vec<f64>, Vec<f64>)| {
            let (mut sum, mut terms) = (vec![0.0; nv], vec![0.0; nv]);
            for (matrix, x) in [(d_dq, &x), (d_dv, &y), (d_last, &z)] {
                for i in 0..nv {
                    for (entry, x) in matrix[i * nv..(i + 1) * nv].iter().zip(x) {
                        sum[i] += entry * x;
                        terms[i] += (entry * x).abs();
                    }
                }
            }
            (sum, terms)
        };
        let (force, acceleration) = units(&case);
        let mass: f64 = case.model.bodies().iter().map(|b| b.inertia.mass).sum();
        let weight = mass.sqrt() * Vec3(case.model.gravity()).norm();
        let compare = |what: &str,
                       got: &[Dual<f64>],
                       loss: f64,
                       (sum, terms): (Vec<f64>, Vec<f64>),
                       force: &[f64]| {
            // Weights round too, also where their changes cancel.
            let largest = terms.iter().zip(force).fold(weight, |m, (x, f)| m.max(x / f));
            for i in 0..nv {
                let error = (got[i].rate - sum[i]).abs();
                let allowed = unit(&case) * loss * force[i] * largest;
                assert!(error <= allowed, "{what}[{i}], PHIPSI_SEED={seed}: {error:e}, allowed {allowed:e}");
            }
        };
        let got = inverse_dynamics(&dual, &q, &v, &seeded(&case.a, &z), Some(&wrenches)).unwrap();
        let all =
            inverse_dynamics_derivatives(&layout, &case.q, &case.v, &case.a, Some(&case.wrenches)).unwrap();
        compare("inverse dynamics", &got, 1.0, along(&all), &force);
        let got = forward_dynamics(&dual, &q, &v, &seeded(&case.tau, &z), Some(&wrenches)).unwrap();
        let all =
            forward_dynamics_derivatives(&layout, &case.q, &case.v, &case.tau, Some(&case.wrenches)).unwrap();
        compare("forward dynamics", &got, growth(&case), along(&all), &acceleration);
    }
}

/// ∂T/∂v̇ = M and ∂θ̈/∂T = M⁻¹, by other sweeps; the accelerations that come along are those of forward dynamics,
/// by the same recursion in other axes.
#[test]
fn derivatives_by_the_last_argument_are_the_mass_matrix_and_its_inverse() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let (layout, nv) = (Layout::<f64>::new(&case.model), case.model.nv());
        let (_, _, d_da) = inverse_dynamics_derivatives(&layout, &case.q, &case.v, &case.a, None).unwrap();
        let m = mass_matrix(&layout, &case.q).unwrap();
        let inverse = mass_matrix_inverse(&layout, &case.q).unwrap();
        let zero = vec![0.0; nv * nv];
        let (mut d_dq, mut d_dv, mut d_dtau) = (zero.clone(), zero.clone(), zero);
        let mut work = ForwardDynamicsDerivatives::new(&layout);
        let (q, v, tau) = (&case.q, &case.v, &case.tau);
        work.run(&layout, q, v, tau, None, &mut d_dq, &mut d_dv, &mut d_dtau).unwrap();
        let loss = growth(&case);
        for (what, got, want, loss) in [("M", &d_da, &m, 1.0), ("M⁻¹", &d_dtau, &inverse, loss)] {
            for i in 0..nv {
                for j in 0..nv {
                    let error = (got[i * nv + j] - want[i * nv + j]).abs();
                    let scale = (want[i * nv + i] * want[j * nv + j]).sqrt();
                    let allowed = unit(&case) * loss * scale;
                    assert!(error <= allowed, "{what}[{i}, {j}], PHIPSI_SEED={seed}: {error:e}");
                    assert_eq!(got[i * nv + j], got[j * nv + i], "{what}, PHIPSI_SEED={seed}");
                }
            }
        }
        // Forces and what balances them round; by them the accelerations answer to M⁻¹.
        let bias = bias_forces(&layout, q, v).unwrap();
        let mass: f64 = case.model.bodies().iter().map(|b| b.inertia.mass).sum();
        let root = |i: usize| inverse[i * nv + i].sqrt();
        let terms = (0..nv).map(|i| root(i) * (tau[i].abs() + bias[i].abs())).sum::<f64>()
            + mass.sqrt() * Vec3(case.model.gravity()).norm();
        let accelerations = forward_dynamics(&layout, q, v, tau, None).unwrap();
        for (i, (got, want)) in work.acceleration().iter().zip(&accelerations).enumerate() {
            let (error, allowed) = ((got - want).abs(), unit(&case) * loss * root(i) * terms);
            assert!(error <= allowed, "θ̈[{i}], PHIPSI_SEED={seed}: {error:e}, allowed {allowed:e}");
        }
    }
}

/// Forces that hold against gravity are derivatives of the potential energy, so their own derivatives are symmetric between
/// joints. Within a joint the body-axes velocities do not commute: ∂T_i/∂q_j − ∂T_j/∂q_i = T · [S_j, S_i].
#[test]
fn derivatives_of_gravity_forces_are_those_of_a_gradient() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let (layout, nv) = (Layout::<f64>::new(&case.model), case.model.nv());
        let rest = vec![0.0; nv];
        let (d_dq, d_dv, _) = inverse_dynamics_derivatives(&layout, &case.q, &rest, &rest, None).unwrap();
        let forces = gravity_forces(&layout, &case.q).unwrap();
        assert!(d_dv.iter().all(|x| *x == 0.0), "PHIPSI_SEED={seed}: at rest");
        let largest = d_dq.iter().chain(&forces).fold(0.0f64, |m, x| m.max(x.abs()));
        let joint: Vec<usize> = layout
            .bodies()
            .iter()
            .enumerate()
            .flat_map(|(k, b)| (0..b.hinge.nv()).map(move |i| (b.v + i, k)))
            .fold(vec![0; nv], |mut all, (i, k)| {
                all[i] = k;
                all
            });
        for i in 0..nv {
            for j in 0..nv {
                let mut want = 0.0;
                if joint[i] == joint[j] {
                    let body = &layout.bodies()[joint[i]];
                    let (a, b): (Motion<f64>, Motion<f64>) =
                        (body.hinge.axis(j - body.v), body.hinge.axis(i - body.v));
                    let bracket = a.cross_motion(b);
                    for (k, &component) in body.hinge.components().iter().enumerate() {
                        want += bracket.get(component) * forces[body.v + k];
                    }
                }
                let error = (d_dq[i * nv + j] - d_dq[j * nv + i] - want).abs();
                assert!(error <= unit(&case) * largest, "[{i}, {j}], PHIPSI_SEED={seed}: {error:e}");
            }
        }
    }
}

/// Without gravity and at v̇ = 0 forces are quadratic in v: (∂T/∂v) v = 2 T. And they change no energy: v·(∂(M v)/∂q v) = 2 v·T.
#[test]
fn velocity_forces_are_quadratic_and_do_no_work() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let (q, v, nv) = (&case.q, &case.v, case.model.nv());
        let layout = Layout::<f64>::new(&case.model).with_gravity(Vec3::zero());
        let rest = vec![0.0; nv];
        let (_, d_dv, _) = inverse_dynamics_derivatives(&layout, q, v, &rest, None).unwrap();
        let (d_mv, _, _) = inverse_dynamics_derivatives(&layout, q, &rest, v, None).unwrap();
        let forces = bias_forces(&layout, q, v).unwrap();
        let times_v = |row: &[f64]| {
            row.iter().zip(v).fold((0.0, 0.0), |(sum, terms), (d, v)| (sum + d * v, terms + (d * v).abs()))
        };
        let products: Vec<(f64, f64)> = d_dv.chunks_exact(nv).map(times_v).collect();
        let largest = products.iter().fold(0.0f64, |m, p| m.max(p.1));
        // As in `inverse_floors`, where all terms vanish.
        let unit_force = units(&case).0.iter().fold(0.0f64, |m, x| m.max(x * x));
        let vanishing = PART * unit_force * speed(&case).powi(2);
        let largest = largest.max(vanishing);
        let (mut power, mut size) = (0.0, vanishing * speed(&case));
        for (i, row) in d_mv.chunks_exact(nv).enumerate() {
            let error = (products[i].0 - 2.0 * forces[i]).abs();
            assert!(error <= unit(&case) * largest, "[{i}], PHIPSI_SEED={seed}: {error:e} of {largest:e}");
            let (sum, terms) = times_v(row);
            power += v[i] * (sum - 2.0 * forces[i]);
            size += v[i].abs() * (terms + products[i].1);
        }
        assert!(power.abs() <= unit(&case) * size, "power, PHIPSI_SEED={seed}: {power:e} of {size:e}");
    }
}

fn rod() -> Inertia {
    Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0])
}

/// A rod on a hinge: θ̈ = 3/2 g cos θ + 3 T for unit mass and length.
#[test]
fn derivatives_of_a_pendulum_in_closed_form() {
    let model = ModelBuilder::new("pendulum")
        .body(Body::new("rod", rod()))
        .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
        .gravity([0.0, 0.0, -9.81])
        .build()
        .unwrap();
    let layout = Layout::<f64>::new(&model);
    let near = |x: f64, y: f64| assert!((x - y).abs() <= 16.0 * f64::EPSILON * 9.81, "{x} {y}");
    for q in [-2.0f64, 0.0, 0.3, 1.9] {
        let (d_dq, d_dv, d_dtau) = forward_dynamics_derivatives(&layout, &[q], &[3.0], &[0.7], None).unwrap();
        near(d_dq[0], -1.5 * 9.81 * q.sin());
        near(d_dv[0], 0.0);
        near(d_dtau[0], 3.0);
        let (d_dq, d_dv, d_da) = inverse_dynamics_derivatives(&layout, &[q], &[3.0], &[0.7], None).unwrap();
        near(d_dq[0], 0.5 * 9.81 * q.sin());
        near(d_dv[0], 0.0);
        near(d_da[0], 1.0 / 3.0);
    }
}

/// An arm of three links on a free base.
fn flyer() -> Model {
    let mut builder = ModelBuilder::new("flyer").body(Body::new("base", rod())).base(Base::Free);
    for k in 0..3 {
        let (name, parent) =
            (format!("link{k}"), if k == 0 { "base".into() } else { format!("link{}", k - 1) });
        let axis = Vec3::<f64>::unit(k).0;
        let placement = Placement::from_xyz_rpy([0.4, 0.3, -0.2], [0.3, 0.5 * k as f64, -0.4]);
        builder = builder
            .body(Body::new(name.as_str(), Inertia::from_principal(0.7, [0.2, 0.1, 0.3], [0.02, 0.03, 0.04])))
            .joint(Joint::new(format!("j{k}"), JointKind::Revolute { axis }).at(placement), parent, name);
    }
    builder.build().unwrap()
}

/// The speed and the place of a flying mechanism cost no digits: an orbit's speed changes ∂θ̈/∂v in the base's own rows only, by
/// ∂c/∂v, and nothing else.
#[test]
fn a_common_velocity_does_not_matter_to_derivatives() {
    let model = flyer();
    let layout = Layout::<f64>::new(&model);
    let nv = model.nv();
    let state = model.random_state(3);
    let (q, mut v) = (state.q, state.v);
    let tau: Vec<f64> = (0..nv).map(|i| 0.3 * i as f64 - 1.0).collect();
    (3..6).for_each(|i| v[i] = 0.0);
    let slow = forward_dynamics_derivatives(&layout, &q, &v, &tau, None).unwrap();
    let (mut far, mut fast_v) = (q.clone(), v.clone());
    for (i, speed) in [7600.0, -4300.0, 2100.0].into_iter().enumerate() {
        far[i] += 1e8;
        fast_v[3 + i] = speed;
    }
    let fast = forward_dynamics_derivatives(&layout, &far, &fast_v, &tau, None).unwrap();
    assert_eq!(slow.0, fast.0);
    assert_eq!(slow.2, fast.2);
    let speed = Vec3([fast_v[3], fast_v[4], fast_v[5]]);
    for i in 0..nv {
        for j in 0..nv {
            let turned = if j < 3 { Vec3::unit(j).cross(speed) } else { Vec3::zero() };
            let want = slow.1[i * nv + j] - if (3..6).contains(&i) { turned.0[i - 3] } else { 0.0 };
            assert!((fast.1[i * nv + j] - want).abs() <= f64::EPSILON * want.abs(), "[{i}, {j}]");
        }
    }
}
