//! What goes by the Jacobian: inertias of tips, generalised inverses, inverse kinematics; and the linearised dynamics.

use crate::common::{
    FACTOR, agree_on, by_vectors, gram, growth, scaled_condition, seeds, steps, wide, wide_wrenches,
};
use phipsi_model::{Body, Inertia, Joint, JointKind, Limits, Model, ModelBuilder, Placement, Random};
use phipsi_recursion::{
    InverseKinematicsOptions, Layout, PseudoInverseOptions, Tip, body_pose, inverse_kinematics, jacobian,
    jacobian_gram, jacobian_pseudo_inverse, linearize, operational_space_inertia, upsilon,
};
use phipsi_reference as slow;
use phipsi_reference::generate::{Case, case};
use phipsi_reference::sensitivity::{sensitivity, widened};
use phipsi_spatial::{Dd, Real, Transform, Vec3};

const TREES: u64 = 300;

/// Perturbations that κ is estimated from.
const SAMPLES: usize = 3;

fn tips(case: &Case) -> [Tip<f64>; 3] {
    // The body twice, at its origin and at a point, and the last body: common ancestors of every kind.
    let other = (case.body * 7 + 3) % case.model.len();
    [
        Tip { body: Some(case.body), point: Some(case.point) },
        Tip { body: Some(other), point: None },
        Tip { body: None, point: None },
    ]
}

fn wide_tips(case: &Case) -> Vec<(Option<usize>, Option<Vec3<Dd>>)> {
    tips(case).iter().map(|t| (t.body, t.point.map(wide))).collect()
}

/// J J* by the recursion for Q against the product, two tips and the world.
#[test]
fn gram_of_the_jacobian() {
    agree_on(
        TREES,
        SAMPLES,
        "jacobian_gram",
        |layout, case| jacobian_gram(layout, &case.q, &tips(case)),
        |case| {
            let j = slow::jacobian_pseudo_inverse::stacked(&case.model, &widened(&case.q), &wide_tips(case));
            slow::jacobian_pseudo_inverse::gram(&j)
        },
        |_, _, size| {
            let n = size.len().isqrt();
            let mut diagonal: Vec<f64> = (0..n).map(|i| size[i * n + i]).collect();
            by_vectors(&mut diagonal);
            gram(|i| diagonal[i], size);
        },
    );
}

/// Λ of a body against dense inverses, wherever the body can move in all directions.
#[test]
fn operational_space_inertias() {
    let mut tried = 0;
    for seed in seeds(TREES) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let (got, info) =
            operational_space_inertia(&layout, &case.q, Some(case.body), Some(case.point)).unwrap();
        let of = |case: &Case| {
            let (q, point) = (widened(&case.q), Some(wide(case.point)));
            slow::operational_space_inertia(&case.model, &q, Some(case.body), point)
        };
        if info.rank < 6 || info.condition > 1e6 {
            continue;
        }
        tried += 1;
        let (want, mut size) =
            sensitivity(&case, SAMPLES, seed, |case| of(case).expect("a body that moves in all directions"));
        let mut diagonal: Vec<f64> = (0..6).map(|i| size[7 * i]).collect();
        by_vectors(&mut diagonal);
        gram(|i| diagonal[i], &mut size);
        // Directions that hardly move lose the square of the condition number at most.
        let loss = growth(&case) * info.condition;
        for (i, (g, w)) in got.iter().flatten().zip(&want).enumerate() {
            let allowed = FACTOR * steps(&case) * f64::EPSILON * size[i] * loss;
            let error = (Dd::from_f64(*g) - *w).abs().to_f64();
            assert!(error <= allowed, "PHIPSI_SEED={seed}, [{i}]: {g} instead of {}, {allowed:e}", w.hi);
        }
    }
    assert!(tried > 50 || std::env::var("PHIPSI_SEED").is_ok(), "{tried}");
}

/// Λ Λ⁻¹ Λ = Λ and Λ⁻¹ Λ Λ⁻¹ = Λ⁻¹ with Λ⁻¹ from Υ, for bodies that move in any number of directions; thirty digits.
#[test]
fn operational_space_inertia_is_the_pseudo_inverse_of_upsilon() {
    let (mut worst, mut ranks) = (0.0f64, [0; 7]);
    for seed in seeds(TREES) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let q = widened(&case.q);
        let (inertia, info) = operational_space_inertia(&layout, &q, Some(case.body), None).unwrap();
        ranks[info.rank] += 1;
        let turned = {
            let r = body_pose(&layout, &q, Some(case.body)).unwrap().rotation;
            let block = upsilon(&layout, &q).unwrap()[case.body];
            let world = |m: [[Dd; 6]; 6]| -> [[Dd; 6]; 6] {
                let half: [[Dd; 6]; 6] = std::array::from_fn(|i| {
                    std::array::from_fn(|j| {
                        (0..3).fold(Dd::from_f64(0.0), |s, k| s + r.0[i % 3][k] * m[i / 3 * 3 + k][j])
                    })
                });
                std::array::from_fn(|i| {
                    std::array::from_fn(|j| {
                        (0..3).fold(Dd::from_f64(0.0), |s, k| s + half[i][j / 3 * 3 + k] * r.0[j % 3][k])
                    })
                })
            };
            world(block)
        };
        let product = |a: &[[Dd; 6]; 6], b: &[[Dd; 6]; 6]| -> [[Dd; 6]; 6] {
            std::array::from_fn(|i| {
                std::array::from_fn(|j| (0..6).fold(Dd::from_f64(0.0), |s, k| s + a[i][k] * b[k][j]))
            })
        };
        let size = |a: &[[Dd; 6]; 6]| a.iter().flatten().fold(0.0f64, |m, x| m.max(x.hi.abs()));
        for (what, a, b) in [("Λ Υ Λ", &inertia, &turned), ("Υ Λ Υ", &turned, &inertia)] {
            let back = product(&product(a, b), a);
            let terms = size(a) * size(a) * size(b) + size(a) + 1e-300;
            let mut error = 0.0f64;
            for (x, y) in back.iter().flatten().zip(a.iter().flatten()) {
                error = error.max((*x - *y).abs().to_f64() / terms);
            }
            worst = worst.max(error);
            assert!(error <= 1e-26, "{what}, PHIPSI_SEED={seed}: {error:e}, {info:?}");
        }
    }
    println!("largest {worst:e}; bodies of each rank: {ranks:?}");
    assert!(ranks.iter().all(|n| *n > 0) || std::env::var("PHIPSI_SEED").is_ok(), "{ranks:?}");
}

/// J⁺ x against normal equations in double-double numbers, where J has full rank.
#[test]
fn pseudo_inverses_of_the_jacobian() {
    let mut tried = [0; 2];
    for seed in seeds(TREES) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let both = tips(&case);
        let count = if seed % 2 == 0 { 1 } else { 2 };
        let mut random = Random::new(seed);
        let x: Vec<f64> = (0..6 * count).map(|_| random.signed()).collect();
        let options = PseudoInverseOptions::default();
        let (got, sigma, rank) =
            jacobian_pseudo_inverse(&layout, &case.q, &both[..count], &x, options).unwrap();
        let condition = sigma[0] / sigma[sigma.len() - 1];
        if rank < sigma.len() || condition > 1e6 {
            continue;
        }
        tried[usize::from(case.model.nv() < 6 * count)] += 1;
        let j = slow::jacobian_pseudo_inverse::stacked(
            &case.model,
            &widened(&case.q),
            &wide_tips(&case)[..count],
        );
        let want = slow::jacobian_pseudo_inverse(&j, &widened(&x)).unwrap();
        // Perturbation of J by n·ε of its norm: least squares lose the square where x is out of reach.
        let reach = x.iter().map(|x| x * x).sum::<f64>().sqrt() / sigma[sigma.len() - 1];
        let out_of_reach = if case.model.nv() < 6 * count { condition } else { 1.0 };
        let allowed = FACTOR * steps(&case) * f64::EPSILON * condition * out_of_reach * reach;
        for (g, w) in got.iter().zip(&want) {
            let error = (Dd::from_f64(*g) - *w).abs().to_f64();
            assert!(error <= allowed, "PHIPSI_SEED={seed}: {g} instead of {}, allowed {allowed:e}", w.hi);
        }
    }
    assert!(tried.iter().all(|n| *n > 20) || std::env::var("PHIPSI_SEED").is_ok(), "{tried:?}");
}

/// Penrose's four conditions with all columns of J⁺, for any rank, in double-double numbers.
#[test]
fn pseudo_inverses_fulfil_penrose() {
    let mut deficient = 0;
    for seed in seeds(100) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let (q, nv) = (widened(&case.q), case.model.nv());
        let point = Some(wide(case.point));
        let tip = [Tip { body: Some(case.body), point }];
        let j = jacobian(&layout, &q, Some(case.body), point).unwrap();
        let mut inverse = vec![[Dd::from_f64(0.0); 6]; nv];
        let mut condition = 1.0;
        for c in 0..6 {
            let mut unit = [Dd::from_f64(0.0); 6];
            unit[c] = Dd::from_f64(1.0);
            let (column, sigma, rank) =
                jacobian_pseudo_inverse(&layout, &q, &tip, &unit, PseudoInverseOptions::default()).unwrap();
            column.iter().enumerate().for_each(|(i, x)| inverse[i][c] = *x);
            condition = if rank > 0 { (sigma[0] / sigma[rank - 1]).hi } else { 1.0 };
            deficient += usize::from(rank < sigma.len());
        }
        let zero = Dd::from_f64(0.0);
        // J J⁺ and J⁺ J are symmetric and leave J and J⁺ as they are.
        let range: Vec<Vec<Dd>> = (0..6)
            .map(|r| (0..6).map(|c| (0..nv).fold(zero, |s, k| s + j[r][k] * inverse[k][c])).collect())
            .collect();
        let allowed = 1e-27 * condition;
        for r in 0..6 {
            for c in 0..6 {
                assert!((range[r][c] - range[c][r]).hi.abs() <= allowed, "J J⁺, PHIPSI_SEED={seed}");
            }
            let length = j[r].iter().fold(1e-3, |m: f64, x| m.max(x.hi.abs()));
            for k in 0..nv {
                let back = (0..6).fold(zero, |s, c| s + range[r][c] * j[c][k]);
                let largest = (0..6).fold(length, |m, c| m.max(j[c][k].hi.abs()));
                assert!((back - j[r][k]).hi.abs() <= allowed * largest, "J J⁺ J, PHIPSI_SEED={seed}");
            }
        }
        for a in 0..nv {
            for b in 0..nv {
                let product = |a: usize, b: usize| (0..6).fold(zero, |s, r| s + inverse[a][r] * j[r][b]);
                assert!((product(a, b) - product(b, a)).hi.abs() <= allowed, "J⁺ J, PHIPSI_SEED={seed}");
            }
        }
    }
    assert!(deficient > 100 || std::env::var("PHIPSI_SEED").is_ok(), "{deficient}");
}

/// Damped rates are those of the regularised normal equations and stay below |x|/2λ.
#[test]
fn damping_limits_the_rates() {
    for seed in seeds(100) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let x = [1.0; 6];
        let tip = [Tip { body: Some(case.body), point: None }];
        for damping in [1e-3, 1.0] {
            let options = PseudoInverseOptions { damping, ..Default::default() };
            let (rates, ..) = jacobian_pseudo_inverse(&layout, &case.q, &tip, &x, options).unwrap();
            let size = rates.iter().map(|x| x * x).sum::<f64>().sqrt();
            assert!(size <= 6f64.sqrt() / (2.0 * damping) * (1.0 + 1e-12), "PHIPSI_SEED={seed}: {size}");
        }
    }
}

/// A and B against nested dual numbers through `difference`, `integrate` and forward dynamics.
#[test]
fn linearized_dynamics() {
    let rows = |(a, b): (nalgebra::DMatrix<Dd>, nalgebra::DMatrix<Dd>)| -> Vec<Dd> {
        [a, b].iter().flat_map(|m| m.transpose().as_slice().to_vec()).collect()
    };
    for seed in seeds(100) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let (mut q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
        case.model.normalize(&mut q);
        let wrenches = wide_wrenches(&case);
        let (a, b) = linearize(&layout, &q, &v, &tau, Some(&wrenches)).unwrap();
        let want = rows(slow::linearize(&case.model, &q, &v, &tau, Some(&wrenches)).unwrap());
        let largest = want.iter().fold(1.0f64, |m, x| m.max(x.hi.abs()));
        let speed = 1.0 + v.iter().map(|x| x.hi.abs()).sum::<f64>();
        let allowed = 1e-28 * largest * speed * speed * growth(&case) * scaled_condition(&case);
        for (i, (g, w)) in a.iter().chain(&b).zip(&want).enumerate() {
            assert!((*g - *w).hi.abs() <= allowed, "PHIPSI_SEED={seed}, [{i}]: {} {}", g.hi, w.hi);
        }
    }
}

/// The best of ten starts from elsewhere than the configuration that made the pose.
fn solve(case: &Case, target: &Transform<f64>) -> (Vec<f64>, phipsi_recursion::InverseKinematicsInfo) {
    let layout = Layout::<f64>::new(&case.model);
    let start = case.model.random_state(case.body as u64 + 1000).q;
    let options = InverseKinematicsOptions { restarts: 30, ..Default::default() };
    inverse_kinematics(&case.model, &layout, case.body, target, &start, options).unwrap()
}

/// Poses that a configuration has are found again, whatever the joints.
#[test]
fn poses_of_configurations_are_reached() {
    let (mut tried, mut missed, mut steps) = (0, Vec::new(), 0);
    for seed in seeds(TREES) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        // In one turn: a helical joint may else be many away.
        let q = case.model.random_state(seed).q;
        let target = body_pose(&layout, &q, Some(case.body)).unwrap();
        let (found, info) = solve(&case, &target);
        tried += 1;
        steps += info.iterations;
        if !info.reached {
            missed.push(seed);
            continue;
        }
        let [rotation, position] =
            slow::pose_error(&case.model, &widened(&found), case.body, &wide_pose(&target));
        let allowed = 2e-10 + 100.0 * f64::EPSILON;
        assert!(rotation.norm().hi <= allowed, "PHIPSI_SEED={seed}");
        assert!(position.norm().hi <= allowed * info.length, "PHIPSI_SEED={seed}");
    }
    println!("missed {missed:?} of {tried}, {steps} steps");
    // A local minimum from every start is no error; it is rare.
    assert!(missed.len() * 50 <= tried, "{missed:?} of {tried}");
}

fn wide_pose(x: &Transform<f64>) -> Transform<Dd> {
    let rotation = phipsi_spatial::Mat3(x.rotation.0.map(|row| row.map(Dd::from_f64)));
    Transform::new(rotation, wide(x.translation))
}

/// Out of reach: the result is a stationary point of the error, by dual numbers through the reference.
#[test]
fn unreachable_poses_give_the_closest() {
    let mut unreached = 0;
    for seed in seeds(100) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let q = case.model.random_state(seed).q;
        let mut target = body_pose(&layout, &q, Some(case.body)).unwrap();
        let mut random = Random::new(seed);
        target.translation += Vec3(random.vector()).scale(3.0);
        target.rotation = target.rotation * phipsi_spatial::Quaternion(random.quaternion()).to_rotation();
        let options = InverseKinematicsOptions { restarts: 3, ..Default::default() };
        let (found, info) =
            inverse_kinematics(&case.model, &layout, case.body, &target, &q, options).unwrap();
        let [rotation, position] =
            slow::pose_error(&case.model, &widened(&found), case.body, &wide_pose(&target));
        assert!((rotation.norm().hi - info.rotation_error).abs() <= 1e-12, "PHIPSI_SEED={seed}");
        assert!(
            (position.norm().hi - info.position_error).abs() <= 1e-12 * (1.0 + info.length),
            "PHIPSI_SEED={seed}"
        );
        if info.reached {
            continue;
        }
        unreached += 1;
        // Half a turn away the error has an edge, on which it may end.
        if info.rotation_error > 3.1 {
            continue;
        }
        let gradient = slow::pose_error_gradient(
            &case.model,
            &widened(&found),
            case.body,
            &wide_pose(&target),
            Dd::from_f64(info.length),
        );
        let slope = gradient.iter().map(|g| g.hi * g.hi).sum::<f64>().sqrt();
        let error = (info.length * info.rotation_error).hypot(info.position_error);
        let relative = if slope == 0.0 { 0.0 } else { slope / (error * info.singular_values[0]) };
        assert!((relative - info.gradient).abs() <= 1e-10, "PHIPSI_SEED={seed}: {relative:e} {info:?}");
        assert!(relative < 1e-7, "PHIPSI_SEED={seed}: {relative:e} {info:?}");
    }
    assert!(unreached > 30 || std::env::var("PHIPSI_SEED").is_ok(), "{unreached}");
}

/// A planar arm of rods of one metre with limits on its elbow and wrist.
fn planar(limits: Option<[f64; 2]>) -> Model {
    let rod = || Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.01, 0.1, 0.1]);
    let mut builder = ModelBuilder::new("planar");
    for (k, parent) in ["world", "b0", "b1"].iter().enumerate() {
        let at = if k == 0 { [0.0; 3] } else { [1.0, 0.0, 0.0] };
        let mut joint = Joint::new(format!("j{k}"), JointKind::Revolute { axis: [0.0, 0.0, 1.0] })
            .at(Placement::from_xyz_rpy(at, [0.0; 3]));
        if k > 0 {
            joint.limits = Limits { position: limits, ..Limits::default() };
        }
        builder = builder.body(Body::new(format!("b{k}"), rod())).joint(joint, *parent, format!("b{k}"));
    }
    builder.build().unwrap()
}

fn at(x: f64, y: f64) -> Transform<f64> {
    Transform::new(phipsi_spatial::Mat3::identity(), Vec3([x, y, 0.0]))
}

/// Closed forms: the origin of the third link of a planar arm is at 2 cos(q₁/2) from the base.
#[test]
fn a_planar_arm_in_closed_form() {
    let model = planar(None);
    let layout = Layout::<f64>::new(&model);
    let options = InverseKinematicsOptions { orientation: false, restarts: 0, ..Default::default() };
    let run = |target: &Transform<f64>, q0: [f64; 3], options: InverseKinematicsOptions| {
        inverse_kinematics(&model, &layout, 2, target, &q0, options).unwrap()
    };
    let (q, info) = run(&at(0.0, 1.0), [0.3, 0.4, 0.7], options);
    assert!(info.reached && (q[1] - 2.0 * std::f64::consts::FRAC_PI_3).abs() < 1e-9, "{q:?} {info:?}");
    assert_eq!(q[2], 0.7, "the wrist does not carry its own origin, and stays");
    // Out of reach: stretched towards the target, where J is singular and least squares alone would creep.
    let (q, info) = run(&at(3.0, 4.0), [0.3, 0.4, 0.0], options);
    assert!(!info.reached && info.iterations < 40, "{info:?}");
    assert!((info.position_error - 3.0).abs() < 1e-12 && q[1].abs() < 1e-6, "{q:?} {info:?}");
    assert!((q[0] + 0.5 * q[1] - 4.0f64.atan2(3.0)).abs() < 1e-6, "{q:?}");
    assert!(info.singular_values[1] < 1e-5 * info.singular_values[0], "{info:?}");
    // A limit of 0.5 rad on the elbow keeps the hand 2 cos(½ · 0.5) away from the base.
    let model = planar(Some([-0.5, 0.5]));
    let layout = Layout::<f64>::new(&model);
    let (q, info) = inverse_kinematics(&model, &layout, 2, &at(0.0, 1.0), &[0.3, 0.4, 0.0], options).unwrap();
    let nearest = 2.0 * 0.25f64.cos() - 1.0;
    assert!(!info.reached && info.at_limits == 1 && (q[1].abs() - 0.5).abs() < 1e-15, "{q:?} {info:?}");
    assert!((info.position_error - nearest).abs() < 1e-12, "{info:?}");
    let free = InverseKinematicsOptions { limits: false, ..options };
    let (_, info) = inverse_kinematics(&model, &layout, 2, &at(0.0, 1.0), &[0.3, 0.4, 0.0], free).unwrap();
    assert!(info.reached);
}

/// Errors from step to step near a solution, measured by stopping after each: e' < C e².
#[test]
fn convergence_is_quadratic_near_a_solution() {
    let mut pairs = 0;
    for seed in seeds(60) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let mut q = widened(&case.model.random_state(seed).q);
        case.model.normalize(&mut q);
        let target = body_pose(&layout, &q, Some(case.body)).unwrap();
        let mut random = Random::new(seed);
        let x: Vec<Dd> = (0..case.model.nv()).map(|_| Dd::from_f64(1e-2 * random.signed())).collect();
        let start = case.model.integrate(&q, &x);
        let mut before = f64::INFINITY;
        for iterations in 0..6 {
            let options = InverseKinematicsOptions {
                iterations,
                restarts: 0,
                limits: false,
                tolerance: 1e-27,
                ..Default::default()
            };
            let (_, info) =
                inverse_kinematics(&case.model, &layout, case.body, &target, &start, options).unwrap();
            let error = info.rotation_error.max(info.position_error / info.length);
            if before < 1e-3 && before > 1e-11 {
                pairs += 1;
                // Singular values of a hundredth are passed as such: the constant of a quadratic is their inverse.
                let constant = 1e2 * (info.singular_values[0] / smallest(&info.singular_values)).powi(2);
                assert!(
                    error < constant * before * before,
                    "PHIPSI_SEED={seed}: {before:e} then {error:e} {info:?}"
                );
            }
            before = error;
        }
    }
    assert!(pairs > 30 || std::env::var("PHIPSI_SEED").is_ok(), "{pairs}");
}

/// The smallest singular value above rounding.
fn smallest(sigma: &[f64; 6]) -> f64 {
    sigma.iter().copied().filter(|s| *s > 1e-12 * sigma[0]).fold(f64::INFINITY, f64::min)
}

/// The same seed gives the same bits; another one may find another configuration.
#[test]
fn a_seed_is_one_result() {
    let case = case(11);
    let layout = Layout::<f64>::new(&case.model);
    let target = body_pose(&layout, &case.model.random_state(5).q, Some(case.body)).unwrap();
    assert_eq!(solve(&case, &target).0, solve(&case, &target).0);
}

/// Joints with limits of a little more than a turn: what a start within them cannot reach, a turn back can.
#[test]
fn limits_of_a_turn_are_no_obstacle() {
    let model = planar(Some([-3.2, 3.2]));
    let layout = Layout::<f64>::new(&model);
    let mut stopped = 0;
    for seed in 0..200 {
        let (q, start) = (model.random_state(seed).q, model.random_state(seed + 500).q);
        let target = body_pose(&layout, &q, Some(2)).unwrap();
        let options = InverseKinematicsOptions { seed, ..Default::default() };
        let (found, info) = inverse_kinematics(&model, &layout, 2, &target, &start, options).unwrap();
        assert!(info.reached, "seed {seed}: {info:?}");
        assert!(found[1..].iter().all(|x| x.abs() <= 3.2), "seed {seed}: {found:?}");
        stopped += usize::from(info.starts > 1);
    }
    assert!(stopped > 0, "no start was stopped by limits");
}

/// Wrong lengths are refused by name, what is not finite by value, and a singular hinge by its joint.
#[test]
fn hostile_arguments_are_refused() {
    let case = case(3);
    let layout = Layout::<f64>::new(&case.model);
    let (q, body) = (&case.q[..], Some(case.body));
    let short = operational_space_inertia(&layout, &q[1..], body, None).unwrap_err();
    assert!(short.to_string().starts_with("`q` has length"), "{short}");
    let options = PseudoInverseOptions::default();
    let tip = [Tip { body, point: None }];
    let short = jacobian_pseudo_inverse(&layout, q, &tip, &[0.0; 5], options).unwrap_err();
    assert!(short.to_string().starts_with("`x` has length 5"), "{short}");
    let short = jacobian_gram(&layout, &q[1..], &tip).unwrap_err();
    assert!(short.to_string().starts_with("`q` has length"), "{short}");
    let short = linearize(&layout, q, &case.v[1..], &case.tau, None).unwrap_err();
    assert!(short.to_string().starts_with("`v` has length"), "{short}");
    let mut hostile = case.q.clone();
    hostile[0] = f64::NAN;
    let target = Transform::identity();
    let options = InverseKinematicsOptions::default();
    let refused =
        inverse_kinematics(&case.model, &layout, case.body, &target, &hostile, options).unwrap_err();
    assert!(refused.to_string().contains("NaN"), "{refused}");
    // Numbers whose squares overflow end, too.
    let far = Transform::new(phipsi_spatial::Mat3::identity(), Vec3([1e200, 0.0, 0.0]));
    let (_, info) = inverse_kinematics(&case.model, &layout, case.body, &far, q, options).unwrap();
    assert!(!info.reached);
    let (inertia, info) = operational_space_inertia(&layout, q, None, None).unwrap();
    assert!(inertia.iter().flatten().all(|x| *x == 0.0) && info.rank == 0);
}
