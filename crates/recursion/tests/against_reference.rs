//! Every kernel against its dense twin on a thousand generated trees, each number within n·ε·κ.

use crate::common::{
    SAMPLES, TREES, agree, agree_in, by_vectors, gram, growth, rounding, scaled_condition, seeds, wide,
    wide_wrenches,
};
use phipsi_recursion as fast;
use phipsi_recursion::{About, ArticulatedSweep, Kinematics};
use phipsi_reference as slow;
use phipsi_reference::bodies::world_inertias;
use phipsi_reference::generate::{Case, case_with_limbs};
use phipsi_reference::sensitivity::widened;
use phipsi_spatial::lanes::Level;
use phipsi_spatial::{Dd, Scalar, Transform, Vec3};

/// κ alone.
fn kappa(_: &Case, _: &mut [f64]) {}

fn pose_entries<T: Scalar>(x: &Transform<T>) -> impl Iterator<Item = T> {
    x.rotation.0.into_iter().flatten().chain(x.translation.0)
}

fn motions(case: &Case, v: &[f64], a: &[f64]) -> Vec<slow::BodyMotion<Dd>> {
    slow::kinematics(&case.model, &widened(&case.q), &widened(v), &widened(a))
}

fn rest(case: &Case) -> Vec<f64> {
    vec![0.0; case.model.nv()]
}

#[test]
fn poses() {
    agree(
        "pose",
        |layout, case| {
            let mut k = Kinematics::new(layout);
            k.set_position(layout, &case.q)?;
            let mut all = Vec::new();
            for body in 0..case.model.len() {
                all.extend(pose_entries(&k.pose(layout, Some(body))));
                all.extend(pose_entries(&fast::body_pose(layout, &case.q, Some(body))?));
            }
            Ok(all)
        },
        |case| {
            let motions = motions(case, &rest(case), &rest(case));
            motions.iter().flat_map(|m| pose_entries(&m.pose).chain(pose_entries(&m.pose))).collect()
        },
        kappa,
    );
}

#[test]
fn velocities() {
    agree(
        "velocity",
        |layout, case| {
            let mut k = Kinematics::new(layout);
            k.set_position(layout, &case.q)?;
            k.set_velocity(layout, &case.v)?;
            let mut all = Vec::new();
            for body in 0..case.model.len() {
                all.extend(k.velocity(layout, Some(body)).to_array());
                all.extend(fast::body_velocity(layout, &case.q, &case.v, Some(body))?.to_array());
            }
            Ok(all)
        },
        |case| {
            let motions = motions(case, &case.v, &rest(case));
            motions.iter().flat_map(|m| [m.velocity.to_array(), m.velocity.to_array()].concat()).collect()
        },
        kappa,
    );
}

/// Accelerations, and those at v̇ = 0: J̇ v.
#[test]
fn accelerations() {
    agree(
        "acceleration",
        |layout, case| {
            let mut k = Kinematics::new(layout);
            k.set_position(layout, &case.q)?;
            k.set_velocity(layout, &case.v)?;
            let mut all = Vec::new();
            for a in [&case.a, &rest(case)] {
                k.set_acceleration(layout, &case.v, a)?;
                all.extend((0..case.model.len()).flat_map(|b| k.acceleration(layout, Some(b)).to_array()));
            }
            Ok(all)
        },
        |case| {
            let both = [motions(case, &case.v, &case.a), motions(case, &case.v, &rest(case))];
            both.iter().flatten().flat_map(|m| m.acceleration.to_array()).collect()
        },
        |case, size| {
            // The reference's ω̇ is a difference of terms of size ω².
            let speed: f64 = case.v.iter().map(|v| v.abs()).sum();
            size.iter_mut().for_each(|x| *x += 16.0 * f64::EPSILON * speed * speed);
        },
    );
}

#[test]
fn jacobians() {
    agree(
        "jacobian",
        |layout, case| Ok(fast::jacobian(layout, &case.q, Some(case.body), Some(case.point))?.concat()),
        |case| {
            let point = Some(wide(case.point));
            slow::jacobian(&case.model, &widened(&case.q), Some(case.body), point)
                .transpose()
                .as_slice()
                .into()
        },
        kappa,
    );
}

#[test]
fn inverse_dynamics() {
    agree(
        "inverse_dynamics",
        |layout, case| {
            let mut all = fast::inverse_dynamics(layout, &case.q, &case.v, &case.a, Some(&case.wrenches))?;
            all.extend(fast::bias_forces(layout, &case.q, &case.v)?);
            all.extend(fast::gravity_forces(layout, &case.q)?);
            Ok(all)
        },
        |case| {
            let (model, q, v, a) = (&case.model, widened(&case.q), widened(&case.v), widened(&case.a));
            let mut all = slow::inverse_dynamics(model, &q, &v, &a, Some(&wide_wrenches(case)));
            let rest = widened(&rest(case));
            all.extend(slow::inverse_dynamics(model, &q, &v, &rest, Some(&rounding(case))));
            all.extend(slow::inverse_dynamics(model, &q, &rest, &rest, Some(&rounding(case))));
            all
        },
        kappa,
    );
}

#[test]
fn mass_matrix() {
    agree(
        "mass_matrix",
        |layout, case| fast::mass_matrix(layout, &case.q),
        |case| slow::mass_matrix(&case.model, &widened(&case.q)).as_slice().into(),
        |case, size| {
            let m = slow::mass_matrix(&case.model, &widened(&case.q));
            gram(|i| m[(i, i)].hi, size);
        },
    );
}

#[test]
fn multiply_by_mass_matrix() {
    agree(
        "multiply_by_mass_matrix",
        |layout, case| fast::multiply_by_mass_matrix(layout, &case.q, &case.a),
        |case| slow::multiply_by_mass_matrix(&case.model, &widened(&case.q), &widened(&case.a)),
        kappa,
    );
}

/// What the filter loses where heavy bodies hang on light ones: see [`growth`].
fn filtered(case: &Case, size: &mut [f64]) {
    let growth = growth(case);
    size.iter_mut().for_each(|x| *x *= growth);
}

#[test]
fn forward_dynamics() {
    agree(
        "forward_dynamics",
        |layout, case| fast::forward_dynamics(layout, &case.q, &case.v, &case.tau, Some(&case.wrenches)),
        |case| {
            let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
            slow::forward_dynamics(&case.model, &q, &v, &tau, Some(&wide_wrenches(case)))
                .expect("generated trees are regular")
        },
        filtered,
    );
}

/// Trees with limbs that are alike, which are swept in lanes where the processor has some. Other widths of lanes go number by number.
#[test]
fn forward_dynamics_with_limbs() {
    let in_lanes = std::cell::Cell::new(0);
    agree_in(
        case_with_limbs,
        TREES / 2,
        SAMPLES,
        "forward_dynamics_with_limbs",
        |layout, case| {
            in_lanes.set(in_lanes.get() + usize::from(layout.limb_count() > 0));
            fast::forward_dynamics(layout, &case.q, &case.v, &case.tau, Some(&case.wrenches))
        },
        |case| {
            let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
            slow::forward_dynamics(&case.model, &q, &v, &tau, Some(&wide_wrenches(case)))
                .expect("generated trees are regular")
        },
        |case, _, size| filtered(case, size),
    );
    let expected = if Level::best() >= Level::Avx2 { seeds(TREES / 2).len() } else { 0 };
    assert_eq!(in_lanes.get(), expected, "models with limbs in lanes");
}

#[test]
fn solve_mass_matrix() {
    agree(
        "solve_mass_matrix",
        |layout, case| fast::solve_mass_matrix(layout, &case.q, &case.tau),
        |case| {
            slow::solve_mass_matrix(&case.model, &widened(&case.q), &widened(&case.tau))
                .expect("generated trees are regular")
        },
        filtered,
    );
}

#[test]
fn mass_matrix_inverse() {
    let slow = |case: &Case| {
        slow::mass_matrix_inverse(&case.model, &widened(&case.q)).expect("generated trees are regular")
    };
    agree(
        "mass_matrix_inverse",
        |layout, case| fast::mass_matrix_inverse(layout, &case.q),
        |case| slow(case).as_slice().into(),
        |case, size| {
            let inverse = slow(case);
            gram(|i| inverse[(i, i)].hi, size);
            filtered(case, size);
        },
    );
}

/// ln det M = Σ ln D: a relative error of a D is an absolute one of the sum, whatever the sum is.
#[test]
fn articulated_sweep() {
    agree(
        "log_determinant",
        |layout, case| Ok(vec![ArticulatedSweep::new(layout, &case.q)?.log_determinant()]),
        |case| {
            let pivots = slow::articulated_joint_inertias(&case.model, &widened(&case.q))
                .expect("generated trees are regular");
            // ln of the product, so that the perturbations' differences keep their digits: ln(1 + x) = x to first order.
            let (mut sum, mut low) = (0.0, 0.0);
            for d in pivots {
                sum += d.hi.ln();
                low += d.lo / d.hi;
            }
            vec![Dd::from_f64(sum) + Dd::from_f64(low)]
        },
        |case, size| size[0] += scaled_condition(case),
    );
}

#[test]
fn energies() {
    agree(
        "energies and centre of mass",
        |layout, case| {
            let mut all = vec![
                fast::kinetic_energy(layout, &case.q, &case.v)?,
                fast::potential_energy(layout, &case.q)?,
            ];
            all.extend(fast::center_of_mass(layout, &case.q)?.0);
            Ok(all)
        },
        |case| {
            let (model, q, v) = (&case.model, widened(&case.q), widened(&case.v));
            let mut all = vec![slow::kinetic_energy(model, &q, &v), slow::potential_energy(model, &q)];
            all.extend(slow::center_of_mass(model, &q).0);
            all
        },
        kappa,
    );
}

/// Σ over bodies of |terms| of a momentum, gathered to the root and moved to `about`: a component that cancels answers to no
/// input, but its terms round.
fn momentum_terms(case: &Case, v: &[f64], about: Vec3<Dd>, size: &mut [f64]) {
    let motions = motions(case, v, &rest(case));
    let (mut angular, mut linear) = (0.0, 0.0);
    for (k, (motion, inertia)) in motions.iter().zip(world_inertias(&case.model, &motions)).enumerate() {
        let root = case.model.tree().path_to_root(k).last().map_or(about, |r| motions[r].pose.translation);
        let p = motion.velocity_at(inertia.center).scale(inertia.mass).norm().hi;
        linear += p;
        angular += ((inertia.center - root).norm().hi + (root - about).norm().hi) * p;
        angular += (inertia.tensor * motion.velocity.angular).norm().hi;
    }
    size[..3].iter_mut().for_each(|x| *x = x.max(angular));
    size[3..].iter_mut().for_each(|x| *x = x.max(linear));
}

#[test]
fn momentum() {
    agree(
        "momentum",
        |layout, case| {
            let momentum = |about| fast::momentum(layout, &case.q, &case.v, about);
            let (point, center) = (momentum(About::Point(case.point))?, momentum(About::CenterOfMass)?);
            Ok([point.to_array(), center.to_array()].concat())
        },
        |case| {
            let momentum =
                |about| slow::momentum(&case.model, &widened(&case.q), &widened(&case.v), about).to_array();
            [momentum(Some(wide(case.point))), momentum(None)].concat()
        },
        |case, size| {
            momentum_terms(case, &case.v, wide(case.point), &mut size[..6]);
            let center = slow::center_of_mass(&case.model, &widened(&case.q));
            momentum_terms(case, &case.v, center, &mut size[6..]);
        },
    );
}

#[test]
fn centroidal_momentum_matrix() {
    agree(
        "centroidal_momentum_matrix",
        |layout, case| Ok(fast::centroidal_momentum_matrix(layout, &case.q)?.concat()),
        |case| slow::centroidal_momentum_matrix(&case.model, &widened(&case.q)).transpose().as_slice().into(),
        |case, size| {
            let center = slow::center_of_mass(&case.model, &widened(&case.q));
            let nv = case.model.nv();
            for i in 0..nv {
                let mut unit = rest(case);
                unit[i] = 1.0;
                let mut column: Vec<f64> = (0..6).map(|row| size[row * nv + i]).collect();
                momentum_terms(case, &unit, center, &mut column);
                (0..6).for_each(|row| size[row * nv + i] = column[row]);
            }
        },
    );
}

#[test]
fn joint_reactions() {
    agree(
        "joint_reactions",
        |layout, case| {
            let wrenches = Some(&case.wrenches[..]);
            let all = fast::joint_reactions(&case.model, layout, &case.q, &case.v, &case.a, wrenches)?;
            Ok(all.iter().flat_map(|w| w.to_array()).collect())
        },
        |case| {
            let (q, v, a) = (widened(&case.q), widened(&case.v), widened(&case.a));
            let all = slow::joint_reactions(&case.model, &q, &v, &a, Some(&wide_wrenches(case)));
            all.iter().flat_map(|w| w.to_array()).collect()
        },
        |_, size| by_vectors(size),
    );
}
