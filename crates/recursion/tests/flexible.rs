//! Trees with flexible bodies against moving mass points and Boltzmann–Hamel equations, in double-double numbers and in f64.

use crate::common::{seeds, wide};
use phipsi_model::{FlexibleBody, Random};
use phipsi_recursion as fast;
use phipsi_recursion::{About, Kinematics, Layout};
use phipsi_reference::flexible as slow;
use phipsi_reference::generate_flexible::{Bodies, FlexibleCase, flexible_case, perturbed};
use phipsi_reference::sensitivity::{STEP, widened};
use phipsi_spatial::{Dd, Real, Scalar, Wrench};

/// Roundings per step of a sweep, as in the tests of rigid trees.
const FACTOR: f64 = 4.0;

/// Generated trees for each test.
const TREES: u64 = 120;

/// Steps of a sweep: bodies, degrees of freedom, and the sums over pairs of modes in each flexible body.
fn steps(case: &FlexibleCase) -> f64 {
    let pairs: usize = case.model.bodies().iter().map(|b| b.modes() * b.modes()).sum();
    (case.model.len() + case.model.nv() + pairs) as f64
}

fn wide_wrenches(case: &FlexibleCase) -> Vec<Wrench<Dd>> {
    case.wrenches.iter().map(|w| Wrench::new(wide(w.moment), wide(w.force))).collect()
}

/// The reference's result and κ times each component: the largest change over a few perturbations of all inputs, and at least
/// the largest component, for what cancels rounds by its terms.
fn sensitivity(case: &FlexibleCase, seed: u64, slow: &dyn Fn(&FlexibleCase) -> Vec<Dd>) -> (Vec<Dd>, f64) {
    let exact = slow(case);
    let mut size = exact.iter().fold(1e-3, |m: f64, x| m.max(x.hi.abs()));
    let mut random = Random::new(seed);
    for _ in 0..3 {
        let changed = slow(&perturbed(case, &mut random, STEP));
        for (x, y) in exact.iter().zip(&changed) {
            size = size.max((*y - *x).hi.abs() / STEP);
        }
    }
    (exact, size)
}

fn compare<T: Real>(what: &str, seed: u64, got: &[T], want: &[Dd], unit: f64) -> f64 {
    assert_eq!(got.len(), want.len(), "{what}, PHIPSI_SEED={seed}");
    let mut worst = 0.0f64;
    for (i, (x, y)) in got.iter().zip(want).enumerate() {
        let high = x.to_f64();
        let low = (*x - T::splat(high)).to_f64();
        let error = (Dd::from_f64(high) - *y + Dd::from_f64(low)).hi.abs();
        let ratio = error / unit;
        assert!(
            ratio <= FACTOR,
            "{what}[{i}], PHIPSI_SEED={seed}: {high} instead of {}, {ratio:.1} n·ε·κ",
            y.hi
        );
        worst = worst.max(ratio);
    }
    worst
}

type Fast<T> = dyn Fn(&Layout<T>, &FlexibleCase) -> Vec<T>;

/// Both number types against the reference on every tree. `loss`: what elimination may lose beyond κ.
fn agree(
    what: &str,
    bodies: Bodies,
    (in_f64, in_dd): (&Fast<f64>, &Fast<Dd>),
    slow: &dyn Fn(&FlexibleCase) -> Vec<Dd>,
    loss: &dyn Fn(&FlexibleCase) -> f64,
) {
    let (mut worst, mut worst_wide) = (0.0f64, 0.0f64);
    for seed in seeds(TREES) {
        let case = flexible_case(seed, bodies);
        let (want, size) = sensitivity(&case, seed, slow);
        let unit = steps(&case) * size * loss(&case);
        let got = in_f64(&Layout::new(&case.model), &case);
        worst = worst.max(compare(what, seed, &got, &want, unit * f64::EPSILON));
        let got = in_dd(&Layout::new(&case.model), &case);
        worst_wide = worst_wide.max(compare(what, seed, &got, &want, unit * Dd::EPSILON));
    }
    println!("{what}: at most {worst:.2} n·ε·κ, in double-double numbers {worst_wide:.2}; allowed {FACTOR}");
}

/// κ alone.
fn kappa(_: &FlexibleCase) -> f64 {
    1.0
}

/// max M_ii M⁻¹_ii: what the pivots of an elimination lose, here and in the reference.
fn scaled_condition(case: &FlexibleCase) -> f64 {
    let q = widened(&case.q);
    let m = slow::mass_matrix(&case.model, &case.points, &q);
    let n = case.model.nv();
    let factors = phipsi_reference::dense::Factors::new(&m, (0..n).rev().collect(), 0.0)
        .expect("generated trees are regular");
    (0..n)
        .map(|i| {
            let mut unit = vec![Dd::from_f64(0.0); n];
            unit[i] = Dd::from_f64(1.0);
            (m[(i, i)] * factors.solve(&unit)[i]).hi
        })
        .fold(1.0, f64::max)
}

macro_rules! both {
    ($layout:ident, $case:ident, $convert:ident, $wrenches:ident => $run:expr) => {
        (
            &|$layout: &Layout<f64>, $case: &FlexibleCase| {
                let $convert = |x: &[f64]| x.to_vec();
                let $wrenches = $case.wrenches.clone();
                let _ = &$wrenches;
                $run
            },
            &|$layout: &Layout<Dd>, $case: &FlexibleCase| {
                let $convert = |x: &[f64]| widened(x);
                let $wrenches = wide_wrenches($case);
                let _ = &$wrenches;
                $run
            },
        )
    };
}

fn inverse_twin(case: &FlexibleCase) -> Vec<Dd> {
    let (q, v, a) = (widened(&case.q), widened(&case.v), widened(&case.a));
    slow::inverse_dynamics(&case.model, &case.points, (&q, &v, &a), Some(&wide_wrenches(case)))
}

fn forward_twin(case: &FlexibleCase) -> Vec<Dd> {
    let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
    slow::forward_dynamics(&case.model, &case.points, (&q, &v, &tau), Some(&wide_wrenches(case)))
        .expect("generated trees are regular")
}

fn inverse_on(bodies: Bodies) {
    agree(
        "inverse_dynamics",
        bodies,
        both!(layout, case, w, f => {
            fast::inverse_dynamics(layout, &w(&case.q), &w(&case.v), &w(&case.a), Some(&f)).unwrap()
        }),
        &inverse_twin,
        &kappa,
    );
}

fn forward_on(bodies: Bodies) {
    agree(
        "forward_dynamics",
        bodies,
        both!(layout, case, w, f => {
            fast::forward_dynamics(layout, &w(&case.q), &w(&case.v), &w(&case.tau), Some(&f)).unwrap()
        }),
        &forward_twin,
        &scaled_condition,
    );
}

/// Shape integrals and the mass points that they were made of are the same body.
#[test]
fn flexible_inverse_dynamics() {
    inverse_on(Bodies::Points);
}

#[test]
fn flexible_forward_dynamics() {
    forward_on(Bodies::Points);
}

/// With rotary inertia and displacement of second order: forces of inertia are those of the kinetic energy.
#[test]
fn flexible_inverse_dynamics_of_a_lagrangian() {
    inverse_on(Bodies::General);
}

#[test]
fn flexible_forward_dynamics_of_a_lagrangian() {
    forward_on(Bodies::General);
}

#[test]
fn flexible_mass_matrix() {
    agree(
        "mass_matrix",
        Bodies::General,
        both!(layout, case, w, _f => fast::mass_matrix(layout, &w(&case.q)).unwrap()),
        &|case| slow::mass_matrix(&case.model, &case.points, &widened(&case.q)).as_slice().into(),
        &kappa,
    );
}

#[test]
fn flexible_energies_and_momentum() {
    agree(
        "energies and momentum",
        Bodies::General,
        both!(layout, case, w, _f => {
            let (q, v) = (w(&case.q), w(&case.v));
            let mut all = vec![
                fast::kinetic_energy(layout, &q, &v).unwrap(),
                fast::potential_energy(layout, &q).unwrap(),
            ];
            let origin = phipsi_spatial::Vec3::zero();
            all.extend(fast::momentum(layout, &q, &v, About::Point(origin)).unwrap().to_array());
            all.extend(fast::momentum(layout, &q, &v, About::CenterOfMass).unwrap().to_array());
            all.extend(fast::center_of_mass(layout, &q).unwrap().0);
            all
        }),
        &|case| {
            let (q, v) = (widened(&case.q), widened(&case.v));
            let (kinetic, potential, h, (mass, moment)) = slow::totals(&case.model, &case.points, (&q, &v));
            let center = moment.scale(mass.recip());
            let mut all = vec![kinetic, potential];
            all.extend(h.to_array());
            all.extend(Wrench::new(h.moment - center.cross(h.force), h.force).to_array());
            all.extend(center.0);
            all
        },
        &kappa,
    );
}

#[test]
fn flexible_motions() {
    agree(
        "poses, velocities, accelerations",
        Bodies::General,
        both!(layout, case, w, _f => {
            let (q, v, a) = (w(&case.q), w(&case.v), w(&case.a));
            let mut kinematics = Kinematics::new(layout);
            kinematics.set_position(layout, &q).unwrap();
            kinematics.set_velocity(layout, &v).unwrap();
            kinematics.set_acceleration(layout, &v, &a).unwrap();
            let mut all = Vec::new();
            for k in 0..case.model.len() {
                let pose = kinematics.pose(layout, Some(k));
                all.extend(pose.rotation.0.concat());
                all.extend(pose.translation.0);
                all.extend(kinematics.velocity(layout, Some(k)).to_array());
                all.extend(kinematics.acceleration(layout, Some(k)).to_array());
            }
            all
        }),
        &|case| {
            let (q, v, a) = (widened(&case.q), widened(&case.v), widened(&case.a));
            let motions = phipsi_reference::kinematics(&case.model, &q, &v, &a);
            let of = |m: &phipsi_reference::BodyMotion<Dd>| {
                let mut all = m.pose.rotation.0.concat();
                all.extend(m.pose.translation.0);
                all.extend(m.velocity.to_array());
                all.extend(m.acceleration.to_array());
                all
            };
            motions.iter().flat_map(of).collect()
        },
        &kappa,
    );
}

#[test]
fn flexible_log_determinant() {
    for seed in seeds(TREES) {
        let case = flexible_case(seed, Bodies::General);
        let (layout, q) = (Layout::<Dd>::new(&case.model), widened(&case.q));
        let got = fast::flexible::log_determinant(&layout, &q).unwrap();
        let want = slow::log_determinant(&case.model, &case.points, &q).unwrap();
        // Logarithms are f64: each pivot's rounds once, and its size counts.
        let unit = f64::EPSILON * case.model.nv() as f64 * (1.0 + want.abs());
        assert!((got - want).abs() <= FACTOR * unit, "PHIPSI_SEED={seed}: {got} {want}");
    }
}

#[test]
fn flexible_log_determinant_gradient() {
    for seed in seeds(20) {
        let case = flexible_case(seed, Bodies::General);
        let (layout, q) = (Layout::<Dd>::new(&case.model), widened(&case.q));
        let got = fast::flexible::log_determinant_gradient(&layout, &q).unwrap();
        let loss = scaled_condition(&case);
        let mut unit_q = q.clone();
        case.model.normalize(&mut unit_q);
        for (i, got) in got.iter().enumerate() {
            let moved = slow::unit_rates(&case.model, &unit_q, i);
            let want = slow::log_determinant_rate(&case.model, &case.points, &moved).unwrap();
            // tr(M⁻¹ dM): nv terms of size loss, each rounding as its factors do.
            let unit = Dd::EPSILON * steps(&case) * case.model.nv() as f64 * loss * loss;
            let error = (*got - want).hi.abs();
            assert!(
                error <= FACTOR * unit * (1.0 + want.hi.abs()),
                "PHIPSI_SEED={seed}, {i}: {error:e} {}",
                want.hi
            );
        }
    }
}

/// M⁻¹ M = 1, and M x by inverse dynamics without weight and strain.
#[test]
fn flexible_solutions_invert_the_mass_matrix() {
    for seed in seeds(TREES) {
        let case = flexible_case(seed, Bodies::General);
        let (layout, q, n) = (Layout::<Dd>::new(&case.model), widened(&case.q), case.model.nv());
        let m = fast::mass_matrix(&layout, &q).unwrap();
        let inverse = fast::mass_matrix_inverse(&layout, &q).unwrap();
        let x = widened(&case.a);
        let product = fast::multiply_by_mass_matrix(&layout, &q, &x).unwrap();
        let back = fast::solve_mass_matrix(&layout, &q, &product).unwrap();
        let largest = |x: &[Dd]| x.iter().fold(1.0f64, |a, x| a.max(x.hi.abs()));
        let unit = Dd::EPSILON * steps(&case) * largest(&m) * largest(&inverse);
        for i in 0..n {
            let row: Dd = (0..n).fold(Dd::from_f64(0.0), |sum, j| sum + m[i * n + j] * x[j]);
            assert!((row - product[i]).hi.abs() <= FACTOR * unit, "PHIPSI_SEED={seed}: M x");
            assert!((back[i] - x[i]).hi.abs() <= FACTOR * unit, "PHIPSI_SEED={seed}: M⁻¹ M x");
            for j in 0..n {
                let entry = (0..n).fold(Dd::from_f64(0.0), |sum, k| sum + m[i * n + k] * inverse[k * n + j]);
                let want = if i == j { 1.0 } else { 0.0 };
                assert!((entry.hi - want).abs() <= FACTOR * unit, "PHIPSI_SEED={seed}: M M⁻¹ ({i}, {j})");
            }
        }
    }
}

/// Derivatives by dual numbers against central differences of the kernels in double-double numbers.
#[test]
fn flexible_derivatives() {
    let step = 1e-10;
    for seed in seeds(25) {
        let case = flexible_case(seed, Bodies::General);
        let (layout, n) = (Layout::<Dd>::new(&case.model), case.model.nv());
        let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
        let wrenches = wide_wrenches(&case);
        let accelerations = |q: &[Dd], v: &[Dd], tau: &[Dd]| {
            fast::forward_dynamics(&layout, q, v, tau, Some(&wrenches)).unwrap()
        };
        let forces =
            |q: &[Dd], v: &[Dd], a: &[Dd]| fast::inverse_dynamics(&layout, q, v, a, Some(&wrenches)).unwrap();
        let (fq, fv, ft) =
            fast::forward_dynamics_derivatives(&layout, &q, &v, &tau, Some(&wrenches)).unwrap();
        let (iq, iv, ia) =
            fast::inverse_dynamics_derivatives(&layout, &q, &v, &tau, Some(&wrenches)).unwrap();
        for j in 0..n {
            let along = |sign: f64| {
                let mut x = vec![Dd::from_f64(0.0); n];
                x[j] = Dd::from_f64(sign * step);
                x
            };
            let moved = |sign: f64| case.model.integrate(&q, &along(sign));
            let plus =
                |x: &[Dd], sign: f64| -> Vec<Dd> { x.iter().zip(along(sign)).map(|(x, d)| *x + d).collect() };
            let pairs = [
                (
                    "forward q",
                    &fq,
                    accelerations(&moved(1.0), &v, &tau),
                    accelerations(&moved(-1.0), &v, &tau),
                ),
                (
                    "forward v",
                    &fv,
                    accelerations(&q, &plus(&v, 1.0), &tau),
                    accelerations(&q, &plus(&v, -1.0), &tau),
                ),
                (
                    "forward tau",
                    &ft,
                    accelerations(&q, &v, &plus(&tau, 1.0)),
                    accelerations(&q, &v, &plus(&tau, -1.0)),
                ),
                ("inverse q", &iq, forces(&moved(1.0), &v, &tau), forces(&moved(-1.0), &v, &tau)),
                ("inverse v", &iv, forces(&q, &plus(&v, 1.0), &tau), forces(&q, &plus(&v, -1.0), &tau)),
                ("inverse a", &ia, forces(&q, &v, &plus(&tau, 1.0)), forces(&q, &v, &plus(&tau, -1.0))),
            ];
            for (what, matrix, after, before) in pairs {
                let size =
                    (0..n).fold(1.0f64, |m, i| m.max(matrix[i * n + j].hi.abs()).max(after[i].hi.abs()));
                for i in 0..n {
                    let difference = (after[i] - before[i]).hi / (2.0 * step);
                    let got = matrix[i * n + j].hi;
                    // h² of third derivatives, which are at most some powers of the first ones, above ε²/h.
                    let budget = 1e-14 * size * size;
                    assert!(
                        (difference - got).abs() <= budget,
                        "{what}, PHIPSI_SEED={seed} ({i}, {j}): {got} {difference}"
                    );
                }
            }
        }
    }
}

/// A body without modes is a rigid one, bit for bit.
#[test]
fn a_body_without_modes_is_rigid_to_the_bit() {
    use phipsi_model::{Body, Joint, ModelBuilder, ShapeIntegrals};
    for seed in seeds(50) {
        let case = phipsi_reference::generate::case(seed);
        let model = &case.model;
        let (mut rigid, mut flexible) = (
            ModelBuilder::new("a").gravity(model.gravity()),
            ModelBuilder::new("b").gravity(model.gravity()),
        );
        for (k, body) in model.bodies().iter().enumerate() {
            let inertia = body.inertia;
            let mass = inertia.mass.max(0.5);
            let mut integrals = ShapeIntegrals { mass, ..ShapeIntegrals::zero(0) };
            integrals.first_moment = inertia.frame.translation.map(|x| x * integrals.mass);
            let (c, m) = (inertia.frame.translation, integrals.mass);
            integrals.second_moment = [0, 1, 2]
                .map(|i| [0, 1, 2].map(|j| m * (c[i] * c[j] + if i == j { 1.0 + i as f64 } else { 0.0 })));
            let same = Body::new(body.name.as_str(), integrals.undeformed());
            let node = phipsi_model::Node::fixed("end", [0.0; 3], 0);
            let modal = Body::flexible(body.name.as_str(), FlexibleBody::new(integrals, vec![], vec![node]));
            let parent = model.tree().parent(k).map_or("world".into(), |p| model.bodies()[p].name.clone());
            let joint =
                Joint::new(format!("joint {k}"), model.joints()[k].kind).at(model.joints()[k].placement);
            rigid = rigid.body(same).joint(joint.clone(), parent.as_str(), body.name.as_str());
            flexible = flexible.body(modal);
            flexible = if parent == "world" {
                flexible.joint(joint, parent, body.name.as_str())
            } else {
                flexible.joint_at_node(joint, parent, "end", body.name.as_str())
            };
        }
        let (rigid, flexible) = (rigid.build().unwrap(), flexible.build().unwrap());
        let (a, b) = (Layout::<f64>::new(&rigid), Layout::<f64>::new(&flexible));
        assert_eq!(a, b, "PHIPSI_SEED={seed}");
        let run = |layout| {
            fast::forward_dynamics(layout, &case.q, &case.v, &case.tau, Some(&case.wrenches)).unwrap()
        };
        let bits = |x: Vec<f64>| x.into_iter().map(f64::to_bits).collect::<Vec<u64>>();
        assert_eq!(bits(run(&a)), bits(run(&b)), "PHIPSI_SEED={seed}");
    }
}
