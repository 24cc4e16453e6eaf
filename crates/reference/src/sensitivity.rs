//! How much a result answers to relative changes of its inputs: the κ in budgets n·ε·κ.

use crate::bodies::{WorldInertia, world_inertias};
use crate::generate::{Case, rebuilt};
use crate::kinematics::{BodyMotion, kinematics};
use phipsi_model::{Body, Inertia, Joint, JointKind, Model, Placement, Random};
use phipsi_spatial::{Dd, Vec3, Wrench};

/// Size of the perturbations. Results are computed in double-double numbers, so that their differences keep 15 digits
/// and only the second order, 1e-8 of the first, is lost.
pub const STEP: f64 = 1e-8;

/// For every component of `result`: the largest |change| over a few random perturbations of relative size ε = 1, and at
/// least the component's own size.
///
/// Perturbed are masses, moments, lengths, pitches, gravity, q, v, a, τ and wrenches by their own size, placements'
/// rotations and quaternions by one, angles by the larger of one and their size: the rounding of a rotation matrix. The
/// weight, centrifugal force and gyroscopic moment of each body change by a part of their own ([`Case::rounding`]): rounding
/// does not know that all bodies fall alike and that a centrifugal force passes through the centre of mass.
pub fn sensitivity(
    case: &Case,
    samples: usize,
    seed: u64,
    result: impl Fn(&Case) -> Vec<Dd>,
) -> (Vec<Dd>, Vec<f64>) {
    let exact = result(case);
    let mut size: Vec<f64> = exact.iter().map(|x| x.hi.abs()).collect();
    let mut random = Random::new(seed);
    for _ in 0..samples {
        let changed = result(&perturbed(case, &mut random, STEP));
        for ((size, x), y) in size.iter_mut().zip(&exact).zip(&changed) {
            *size = size.max((*y - *x).hi.abs() / STEP);
        }
    }
    (exact, size)
}

/// The case with all numbers changed by parts of at most `step`.
pub fn perturbed(case: &Case, random: &mut Random, step: f64) -> Case {
    let model = perturbed_model(&case.model, random, step);
    let mut change = |x: &f64| x * (1.0 + step * random.signed());
    let (v, a) = (case.v.iter().map(&mut change).collect(), case.a.iter().map(&mut change).collect());
    let tau = case.tau.iter().map(&mut change).collect();
    let wrenches = case
        .wrenches
        .iter()
        .map(|w| {
            let (moment, force) = (vector(w.moment.0, random, step), vector(w.force.0, random, step));
            Wrench::new(Vec3(moment), Vec3(force))
        })
        .collect();
    let rounding = forces_at_rest(case)
        .iter()
        .zip(case.model.bodies())
        .map(|([moment, force], body)| {
            let moment = Vec3(random.vector()).scale(step * moment);
            let force = Vec3(random.vector()).scale(step * force);
            Wrench::new(moment + Vec3(body.inertia.frame.translation).cross(force), force)
        })
        .collect();
    let q = perturbed_configuration(&case.model, &case.q, random, step);
    let point = Vec3(vector(case.point.0, random, step));
    Case { model, q, v, a, tau, wrenches, rounding, body: case.body, point }
}

/// For every body, the sizes of its gyroscopic moment and of its weight and centrifugal force at a = 0.
fn forces_at_rest(case: &Case) -> Vec<[f64; 2]> {
    let motions = kinematics(&case.model, &case.q, &case.v, &vec![0.0; case.model.nv()]);
    let g = Vec3(case.model.gravity()).norm();
    let inertias = world_inertias(&case.model, &motions);
    let of = |(motion, inertia): (&BodyMotion<f64>, &WorldInertia<f64>)| {
        let w = motion.velocity.angular;
        let moment = w.norm() * (inertia.tensor * w).norm();
        [moment, inertia.mass * (g + motion.acceleration_at(inertia.center).norm())]
    };
    motions.iter().zip(&inertias).map(of).collect()
}

fn perturbed_configuration(model: &Model, q: &[f64], random: &mut Random, step: f64) -> Vec<f64> {
    let mut out = q.to_vec();
    for (k, joint) in model.joints().iter().enumerate() {
        for (i, at) in model.q_range(k).enumerate() {
            let size = match joint.kind {
                JointKind::Spherical => 1.0,
                JointKind::Free if i >= 3 => 1.0,
                JointKind::Planar { .. } if i < 2 => q[at].abs(),
                JointKind::Planar { .. } => q[at].abs().max(1.0),
                JointKind::Free => q[at].abs(),
                kind if kind.is_rotation(i) => q[at].abs().max(1.0),
                _ => q[at].abs(),
            };
            out[at] += size * step * random.signed();
        }
    }
    out
}

/// The vector with a change of a part of its length in every component.
fn vector<const N: usize>(x: [f64; N], random: &mut Random, step: f64) -> [f64; N] {
    let size = x.iter().map(|x| x * x).sum::<f64>().sqrt();
    x.map(|x| x + size * step * random.signed())
}

fn placement(x: Placement, random: &mut Random, step: f64) -> Placement {
    Placement { translation: vector(x.translation, random, step), rotation: vector(x.rotation, random, step) }
}

/// The model with all numbers changed by parts of at most `step`; names, order and zeros stay.
pub fn perturbed_model(model: &Model, random: &mut Random, step: f64) -> Model {
    let gravity = vector(model.gravity(), random, step);
    let mut joint_random = Random::new(random.bits());
    let body = |_: usize, body: &Body| {
        let Inertia { mass, frame, tensor } = body.inertia;
        Inertia {
            mass: mass * (1.0 + step * random.signed()),
            frame: placement(frame, random, step),
            tensor: vector(tensor, random, step),
        }
    };
    let joint = |_: usize, joint: &Joint| {
        let random = &mut joint_random;
        // The direction of a single axis changes with the placement's rotation.
        let kind = match joint.kind {
            JointKind::Helical { axis, pitch } => {
                JointKind::Helical { axis, pitch: pitch * (1.0 + step * random.signed()) }
            }
            JointKind::Universal { axes } => {
                JointKind::Universal { axes: axes.map(|axis| vector(axis, random, step)) }
            }
            kind => kind,
        };
        (kind, placement(joint.placement, random, step))
    };
    rebuilt(model, body, joint, gravity)
}

/// The state of the case in double-double numbers.
pub fn widened(x: &[f64]) -> Vec<Dd> {
    x.iter().map(|&x| Dd::from_f64(x)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::case;

    #[test]
    fn a_perturbed_model_keeps_its_order() {
        for seed in 0..50 {
            let case = case(seed);
            let other = perturbed_model(&case.model, &mut Random::new(seed), STEP);
            assert_eq!(case.model.tree(), other.tree());
            let names = |m: &Model| m.joints().iter().map(|j| j.name.clone()).collect::<Vec<_>>();
            assert_eq!(names(&case.model), names(&other));
            assert_ne!(case.model, other);
        }
    }
}
