//! Identities that need no other program: inverses, symmetry, power and momentum balances, equal mechanisms.

use crate::common::{FACTOR, growth, seeds, steps};
use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder, Placement};
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{
    About, ArticulatedSweep, ForwardDynamicsDerivatives, InverseDynamicsDerivatives, Kinematics, Layout,
    MassMatrix, MassMatrixInverse, bias_forces, forward_dynamics, forward_info, inverse_dynamics,
    kinetic_energy, mass_matrix, mass_matrix_inverse, momentum, multiply_by_mass_matrix, potential_energy,
};
use phipsi_reference::generate::{Case, case, rebuilt};
use phipsi_reference::sensitivity::widened;
use phipsi_spatial::{Dd, Vec3, Wrench};

const CASES: u64 = 300;

/// The allowed rounding of a case, relative to a sum of |terms|.
fn unit(case: &Case) -> f64 {
    FACTOR * steps(case) * f64::EPSILON
}

fn absolute(x: &[f64]) -> Vec<f64> {
    x.iter().map(|x| x.abs()).collect()
}

fn multiply(matrix: &[f64], x: &[f64]) -> Vec<f64> {
    matrix.chunks_exact(x.len()).map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum()).collect()
}

fn assert_within(what: &str, seed: u64, got: &[f64], want: &[f64], budget: &[f64]) {
    for (i, ((g, w), b)) in got.iter().zip(want).zip(budget).enumerate() {
        assert!((g - w).abs() <= *b, "{what}[{i}], PHIPSI_SEED={seed}: {g} instead of {w}, allowed {b:e}");
    }
    assert_eq!(got.len(), want.len(), "{what}, PHIPSI_SEED={seed}");
}

/// M M⁻¹ = 1, within the rounding of Σ |M| |M⁻¹| and what the filter loses.
#[test]
fn mass_matrix_times_its_inverse_is_one() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let (m, inverse) =
            (mass_matrix(&layout, &case.q).unwrap(), mass_matrix_inverse(&layout, &case.q).unwrap());
        let nv = case.model.nv();
        let allowed = unit(&case) * growth(&case);
        for j in 0..nv {
            let column: Vec<f64> = (0..nv).map(|i| inverse[i * nv + j]).collect();
            let product = multiply(&m, &column);
            let mut one = vec![0.0; nv];
            one[j] = 1.0;
            let terms = multiply(&absolute(&m), &absolute(&column));
            let budget: Vec<f64> = terms.iter().map(|t| allowed * (t + 1.0)).collect();
            assert_within("M M⁻¹", seed, &product, &one, &budget);
        }
    }
}

/// M^½ M^*½ = M and M^(−½) M^(−*½) = M⁻¹ column by column, so that unit deviates get exactly these covariances.
#[test]
fn square_roots_have_the_covariances_of_the_mass_matrix() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let nv = case.model.nv();
        let sweep = ArticulatedSweep::new(&layout, &case.q).unwrap();
        let mut workspace = SolveWorkspace::new(&layout);
        let (mut covariance, mut inverse_covariance) = (vec![0.0; nv * nv], vec![0.0; nv * nv]);
        for j in 0..nv {
            let mut unit_vector = vec![0.0; nv];
            unit_vector[j] = 1.0;
            let mut momenta = unit_vector.clone();
            sweep.multiply_by_square_root(&layout, &mut momenta, &mut workspace);
            let mut velocities = unit_vector;
            sweep.multiply_by_inverse_square_root(&layout, &mut velocities, &mut workspace);
            for i in 0..nv * nv {
                covariance[i] += momenta[i / nv] * momenta[i % nv];
                inverse_covariance[i] += velocities[i / nv] * velocities[i % nv];
            }
        }
        // Entries of a covariance round in proportion to the deviations of their two components.
        let budget = |c: &[f64], allowed: f64| -> Vec<f64> {
            (0..nv * nv).map(|i| allowed * (c[(i / nv) * (nv + 1)] * c[(i % nv) * (nv + 1)]).sqrt()).collect()
        };
        let (m, inverse) =
            (mass_matrix(&layout, &case.q).unwrap(), mass_matrix_inverse(&layout, &case.q).unwrap());
        let allowed = unit(&case) * growth(&case);
        assert_within("covariance of momenta", seed, &covariance, &m, &budget(&m, allowed));
        let inverse_budget = budget(&inverse, allowed);
        assert_within("covariance of velocities", seed, &inverse_covariance, &inverse, &inverse_budget);
    }
}

/// The composite bodies' matrix and the product by inverse dynamics are two sweeps; columns of one are rows of the other.
#[test]
fn mass_matrix_is_symmetric() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let m = mass_matrix(&layout, &case.q).unwrap();
        let nv = case.model.nv();
        for i in 0..nv {
            let mut unit_vector = vec![0.0; nv];
            unit_vector[i] = 1.0;
            let column = multiply_by_mass_matrix(&layout, &case.q, &unit_vector).unwrap();
            let budget: Vec<f64> =
                (0..nv).map(|j| unit(&case) * (m[i * nv + i] * m[j * nv + j]).sqrt()).collect();
            assert_within("column of M", seed, &column, &m[i * nv..(i + 1) * nv], &budget);
        }
    }
}

/// FD(ID(a)) = a: the forces round by ε Σ |terms|, which M⁻¹ turns into accelerations.
#[test]
fn forward_dynamics_inverts_inverse_dynamics() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let (q, v, a, wrenches) = (&case.q, &case.v, &case.a, Some(&case.wrenches[..]));
        let layout = Layout::<f64>::new(&case.model);
        let tau = inverse_dynamics(&layout, q, v, a, wrenches).unwrap();
        let back = forward_dynamics(&layout, q, v, &tau, wrenches).unwrap();
        let (m, inverse) = (mass_matrix(&layout, q).unwrap(), mass_matrix_inverse(&layout, q).unwrap());
        let bias = inverse_dynamics(&layout, q, v, &vec![0.0; a.len()], wrenches).unwrap();
        let mut terms = multiply(&absolute(&m), &absolute(a));
        terms.iter_mut().zip(&bias).zip(&tau).for_each(|((t, b), f)| *t += b.abs() + f.abs());
        let reach = multiply(&absolute(&inverse), &terms);
        let budget: Vec<f64> = reach.iter().map(|r| unit(&case) * growth(&case) * r).collect();
        assert_within("FD(ID(a))", seed, &back, a, &budget);
    }
}

/// What `forward_info` says about a result: a small backward error, and the hinge that the dense pivots name.
#[test]
fn forward_info_tells_the_backward_error_and_the_worst_hinge() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let (q, v, tau, wrenches) = (&case.q, &case.v, &case.tau, Some(&case.wrenches[..]));
        let layout = Layout::<f64>::new(&case.model);
        let a = forward_dynamics(&layout, q, v, tau, wrenches).unwrap();
        let info = forward_info(&layout, q, v, tau, wrenches, &a).unwrap();
        let growth = growth(&case);
        assert!(
            info.backward_error <= unit(&case) * growth,
            "PHIPSI_SEED={seed}: {:e}, growth {growth:e}",
            info.backward_error
        );
        let ratio = info.worst_hinge.expect("a model that moves").ratio;
        assert!(
            (ratio * growth - 1.0).abs() <= unit(&case) * growth,
            "PHIPSI_SEED={seed}: worst hinge {ratio:e}, M/D {growth:e}"
        );
    }
}

/// A case in double-double numbers with unit quaternions, and its accelerations there.
struct Motion {
    layout: Layout<Dd>,
    q: Vec<Dd>,
    v: Vec<Dd>,
    a: Vec<Dd>,
    tau: Vec<Dd>,
    wrenches: Vec<Wrench<Dd>>,
}

/// Steps of central differences: they lose (step · rates)², below 1e-16 of terms whose rates are below 1e4.
const STEP: f64 = 1e-12;

impl Motion {
    fn of(case: &Case) -> Self {
        let layout = Layout::<Dd>::new(&case.model);
        let (mut q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
        case.model.normalize(&mut q);
        let wrenches = crate::common::wide_wrenches(case);
        let a = forward_dynamics(&layout, &q, &v, &tau, Some(&wrenches)).unwrap();
        Motion { layout, q, v, a, tau, wrenches }
    }

    /// The state a step later (or earlier), to second order.
    fn after(&self, case: &Case, step: f64) -> (Vec<Dd>, Vec<Dd>) {
        let (h, half) = (Dd::from_f64(step), Dd::from_f64(0.5 * step * step));
        let x: Vec<Dd> = self.v.iter().zip(&self.a).map(|(v, a)| *v * h + *a * half).collect();
        let v = self.v.iter().zip(&self.a).map(|(v, a)| *v + *a * h).collect();
        (case.model.integrate(&self.q, &x), v)
    }

    /// The time derivative of a function of the state.
    fn rate<const N: usize>(&self, case: &Case, f: impl Fn(&[Dd], &[Dd]) -> [Dd; N]) -> [Dd; N] {
        let ((q1, v1), (q0, v0)) = (self.after(case, STEP), self.after(case, -STEP));
        let (after, before) = (f(&q1, &v1), f(&q0, &v0));
        std::array::from_fn(|i| (after[i] - before[i]) / Dd::from_f64(2.0 * STEP))
    }
}

/// dE/dt = τ·v + Σ w·V.
#[test]
fn energy_grows_by_the_power_of_the_forces() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let m = Motion::of(&case);
        let [rate] = m.rate(&case, |q, v| {
            [kinetic_energy(&m.layout, q, v).unwrap() + potential_energy(&m.layout, q).unwrap()]
        });
        let mut k = Kinematics::new(&m.layout);
        k.set_position(&m.layout, &m.q).unwrap();
        k.set_velocity(&m.layout, &m.v).unwrap();
        let (mut power, mut terms) = (Dd::from_f64(0.0), kinetic_energy(&m.layout, &m.q, &m.v).unwrap().hi);
        terms += potential_energy(&m.layout, &m.q).unwrap().hi.abs();
        for (tau, v) in m.tau.iter().zip(&m.v) {
            power += *tau * *v;
            terms += (*tau * *v).hi.abs();
        }
        for (body, w) in m.wrenches.iter().enumerate() {
            let p = k.velocity_in_body(&m.layout, Some(body)).dot(*w);
            power += p;
            terms += p.hi.abs();
        }
        // Rates of the terms: accelerations over velocities, and the velocities.
        let speed = 1.0 + m.v.iter().chain(&m.a).map(|x| x.hi.abs()).sum::<f64>();
        let allowed = (f64::EPSILON + (STEP * speed).powi(2)) * steps(&case) * terms * speed;
        let error = (rate - power).hi.abs();
        assert!(error <= allowed, "PHIPSI_SEED={seed}: dE/dt {rate:?}, power {power:?}, allowed {allowed:e}");
    }
}

/// Models whose every root is free.
fn floating(seed: u64) -> Option<Case> {
    let case = case(seed);
    let roots = (0..case.model.len()).filter(|&k| case.model.tree().parent(k).is_none());
    let mut roots = roots.map(|k| case.model.joints()[k].kind == JointKind::Free);
    roots.all(|free| free).then_some(case)
}

/// The rate of momentum about a world point is what acts from outside: weights, wrenches, and the forces of free roots.
#[test]
fn momentum_grows_by_what_acts_from_outside() {
    let mut tried = 0;
    for seed in seeds(CASES) {
        let Some(case) = floating(seed) else { continue };
        tried += 1;
        let m = Motion::of(&case);
        let rate =
            m.rate(&case, |q, v| momentum(&m.layout, q, v, About::Point(Vec3::zero())).unwrap().to_array());
        let mut k = Kinematics::new(&m.layout);
        k.set_position(&m.layout, &m.q).unwrap();
        let (mut sum, mut terms) = (Wrench::<Dd>::zero(), 0.0);
        let mut add = |w: Wrench<Dd>| {
            sum += w;
            terms += w.to_array().iter().map(|x| x.hi.abs()).sum::<f64>();
        };
        let g = Vec3::<Dd>::splat(case.model.gravity());
        for (body, w) in m.wrenches.iter().enumerate() {
            let pose = k.pose(&m.layout, Some(body));
            add(pose.wrench_to_parent(*w));
            let inertia = &case.model.bodies()[body].inertia;
            let weight = g.scale(Dd::from_f64(inertia.mass));
            let center = pose.point(Vec3::splat(inertia.frame.translation));
            add(Wrench::new(center.cross(weight), weight));
            if case.model.tree().parent(body).is_none() {
                let tau = &m.tau[case.model.v_range(body)];
                let w = Wrench::from_array([tau[0], tau[1], tau[2], tau[3], tau[4], tau[5]]);
                add(pose.wrench_to_parent(w));
            }
        }
        let size = momentum(&m.layout, &m.q, &m.v, About::Point(Vec3::zero())).unwrap().to_array();
        terms += size.iter().map(|x| x.hi.abs()).sum::<f64>();
        let speed = 1.0 + m.v.iter().chain(&m.a).map(|x| x.hi.abs()).sum::<f64>();
        let allowed = (f64::EPSILON + (STEP * speed).powi(2)) * steps(&case) * terms * speed;
        for (i, (r, w)) in rate.iter().zip(sum.to_array()).enumerate() {
            assert!(
                (*r - w).hi.abs() <= allowed,
                "PHIPSI_SEED={seed}, component {i}: {r:?} instead of {w:?}, allowed {allowed:e}"
            );
        }
    }
    assert!(tried > 0 || std::env::var("PHIPSI_SEED").is_ok());
}

/// A universal joint is two hinges with a massless body between.
#[test]
fn a_universal_joint_is_two_hinges() {
    let axes = [[0.3, -1.0, 0.2], [1.0, 0.4, -0.7]];
    let at = Placement::from_xyz_rpy([0.1, -0.4, 0.3], [0.7, -1.1, 0.4]);
    let brick = || Inertia::from_principal(2.0, [0.3, -0.1, 0.4], [0.3, 0.4, 0.5]);
    let tip = Placement::from_xyz_rpy([0.5, 0.2, -0.3], [0.1, 0.2, 0.3]);
    let builder = || {
        ModelBuilder::new("joints").body(Body::new("outer", brick())).body(Body::new("tip", brick())).joint(
            Joint::new("wrist", JointKind::Spherical).at(tip),
            "outer",
            "tip",
        )
    };
    let one = builder().joint(Joint::new("cross", JointKind::Universal { axes }).at(at), "world", "outer");
    let two = builder()
        .body(Body::new("between", Inertia::ZERO))
        .joint(Joint::new("first", JointKind::Revolute { axis: axes[0] }).at(at), "world", "between")
        .joint(Joint::new("second", JointKind::Revolute { axis: axes[1] }), "between", "outer");
    let (one, two) = (one.build().unwrap(), two.build().unwrap());
    for seed in seeds(20) {
        let state = one.random_state(seed);
        let tau = one.random_state(seed + 1).v;
        let accelerations =
            |model| forward_dynamics(&Layout::<f64>::new(model), &state.q, &state.v, &tau, None).unwrap();
        let (a, b) = (accelerations(&one), accelerations(&two));
        let scale = a.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        // Five degrees of freedom on three bodies; M/D of the wrist below 10.
        let budget = vec![FACTOR * 8.0 * 10.0 * f64::EPSILON * scale; a.len()];
        assert_within("accelerations", seed, &b, &a, &budget);
    }
}

/// A scene moved far from the world's origin has the same accelerations and matrices, bit by bit.
#[test]
fn the_place_of_a_scene_does_not_matter() {
    for seed in seeds(CASES) {
        let near = case(seed);
        let far = rebuilt(
            &near.model,
            |_, body| body.inertia,
            |k, joint| {
                let mut placement = joint.placement;
                if near.model.tree().parent(k).is_none() {
                    placement.translation = [1e8, -3e8, 2e7];
                }
                (joint.kind, placement)
            },
            near.model.gravity(),
        );
        let layouts = [Layout::<f64>::new(&near.model), Layout::<f64>::new(&far)];
        let fixed = (0..near.model.len()).any(|k| {
            near.model.tree().parent(k).is_none() && near.model.joints()[k].kind == JointKind::Fixed
        });
        // Placements of joints on a fixed root are sums with its own: they round.
        if fixed {
            continue;
        }
        let (q, v, tau, w) = (&near.q, &near.v, &near.tau, Some(&near.wrenches[..]));
        let [a, b] = layouts.each_ref().map(|l| forward_dynamics(l, q, v, tau, w).unwrap());
        assert_eq!(a, b, "PHIPSI_SEED={seed}: accelerations");
        let [a, b] = layouts.each_ref().map(|l| mass_matrix(l, q).unwrap());
        assert_eq!(a, b, "PHIPSI_SEED={seed}: mass matrix");
        let [a, b] = layouts.each_ref().map(|l| bias_forces(l, q, v).unwrap());
        assert_eq!(a, b, "PHIPSI_SEED={seed}: bias forces");
    }
}

/// A common velocity of everything changes no acceleration, bit by bit, but ω × v of the free roots themselves.
#[test]
fn a_common_velocity_does_not_matter() {
    let mut tried = 0;
    for seed in seeds(CASES) {
        let Some(case) = floating(seed) else { continue };
        tried += 1;
        let layout = Layout::<f64>::new(&case.model);
        let common = Vec3([7.6e3, -2.1e3, 4.4e2]);
        let mut fast = case.v.clone();
        let mut root = vec![false; fast.len()];
        for k in (0..case.model.len()).filter(|&k| case.model.tree().parent(k).is_none()) {
            let pose = phipsi_recursion::body_pose(&layout, &case.q, Some(k)).unwrap();
            let u = pose.rotation.transpose_mul(common);
            let first = case.model.v_offset(k) + 3;
            (0..3).for_each(|i| fast[first + i] += u.0[i]);
            (0..3).for_each(|i| root[first + i] = true);
        }
        let accelerate =
            |v: &[f64]| forward_dynamics(&layout, &case.q, v, &case.tau, Some(&case.wrenches)).unwrap();
        let (slow, fast) = (accelerate(&case.v), accelerate(&fast));
        for (i, (a, b)) in slow.iter().zip(&fast).enumerate() {
            assert!(
                root[i] || a == b,
                "PHIPSI_SEED={seed}, degree of freedom {i}: {a} at rest, {b} in motion"
            );
        }
    }
    assert!(tried > 0 || std::env::var("PHIPSI_SEED").is_ok());
}

/// One LDL* step on paper: a point mass on a slider and a hinge, M = [[m, 0], [0, m l²]].
#[test]
fn a_hand_calculation() {
    let (m, l) = (2.0, 0.5);
    let model = ModelBuilder::new("crane")
        .body(Body::new("trolley", Inertia::ZERO))
        .body(Body::new("load", Inertia::from_principal(m, [0.0, 0.0, -l], [0.0; 3])))
        .joint(Joint::new("rail", JointKind::Prismatic { axis: [1.0, 0.0, 0.0] }), "world", "trolley")
        .joint(Joint::new("rope", JointKind::Revolute { axis: [1.0, 0.0, 0.0] }), "trolley", "load")
        .gravity([0.0, 0.0, -9.81])
        .build()
        .unwrap();
    let layout = Layout::<f64>::new(&model);
    let angle = 0.3f64;
    assert_eq!(mass_matrix(&layout, &[0.7, angle]).unwrap(), [m, 0.0, 0.0, m * l * l]);
    let a = forward_dynamics(&layout, &[0.7, angle], &[0.0, 0.0], &[3.0, 0.0], None).unwrap();
    assert!((a[0] - 1.5).abs() <= 4.0 * f64::EPSILON);
    assert!((a[1] + 9.81 / l * angle.sin()).abs() <= 20.0 * f64::EPSILON);
}

/// Every number of a result is written, whatever was there.
#[test]
fn matrices_are_written_whole() {
    for seed in seeds(CASES) {
        let case = case(seed);
        let (layout, nv) = (Layout::<f64>::new(&case.model), case.model.nv());
        let (q, v, x) = (&case.q[..], &case.v[..], &case.tau[..]);
        let filled = |y: f64| {
            let mut out = vec![vec![y; nv * nv]; 8];
            let [a, b, c, d, e, f, g, h] = &mut out[..] else { unreachable!("eight matrices") };
            MassMatrix::new(&layout).run(&layout, q, a).unwrap();
            MassMatrixInverse::new(&layout).run(&layout, q, b).unwrap();
            InverseDynamicsDerivatives::new(&layout).run(&layout, q, v, x, None, c, d, e).unwrap();
            ForwardDynamicsDerivatives::new(&layout).run(&layout, q, v, x, None, f, g, h).unwrap();
            out
        };
        assert_eq!(filled(f64::NAN), filled(0.0), "PHIPSI_SEED={seed}");
    }
}
