//! κ: how much a result answers to relative changes of its inputs.

use super::chain::State;
use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random};
use phipsi_spatial::Dd;

/// Size of the changes: small beside what makes a result nonlinear, large beside the rounding of the changed inputs. Results are
/// double-double numbers, so that their differences keep their digits.
pub(super) const STEP: f64 = 1e-12;

/// Largest |change| of the result over `samples` random changes, divided by their size and by the largest component; at least 1.
///
/// Masses, moments, components of lengths and of gravity, v and forces change by their own size, so that zeros stay: a needle keeps
/// its axis. Angles change by the larger of one and their size (the rounding of a rotation matrix). Without `with_model`, the model
/// stays as it is.
pub(super) fn kappa(
    (model, state): (&Model, &State),
    samples: u64,
    with_model: bool,
    exact: &[Dd],
    result: impl Fn(&Model, &State) -> Option<Vec<Dd>>,
) -> f64 {
    let size = largest(exact);
    let mut kappa = 1.0f64;
    for seed in 0..samples {
        let mut random = Random::new(seed);
        let changed = changed_state(model, state, &mut random);
        let other = if with_model { changed_model(model, &mut random) } else { None };
        if let Some(found) = result(other.as_ref().unwrap_or(model), &changed) {
            let moved = found.iter().zip(exact).fold(0.0f64, |m, (x, y)| m.max((*x - *y).hi.abs()));
            kappa = kappa.max(moved / (STEP * size));
        }
    }
    kappa
}

/// The largest magnitude.
pub(super) fn largest(x: &[Dd]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.hi.abs()))
}

fn changed_state(model: &Model, state: &State, random: &mut Random) -> State {
    let mut q = state.q.clone();
    for (k, joint) in model.joints().iter().enumerate() {
        for (i, at) in model.q_range(k).enumerate() {
            let size = match joint.kind {
                JointKind::Spherical => 1.0,
                JointKind::Free if i >= 3 => 1.0,
                JointKind::Free => q[at].abs(),
                kind if kind.is_rotation(i) => q[at].abs().max(1.0),
                _ => q[at].abs(),
            };
            q[at] += size * STEP * random.signed();
        }
    }
    let mut change = |x: &f64| x * (1.0 + STEP * random.signed());
    State {
        q,
        v: state.v.iter().map(&mut change).collect(),
        tau: state.tau.iter().map(&mut change).collect(),
    }
}

fn vector<const N: usize>(x: [f64; N], random: &mut Random) -> [f64; N] {
    x.map(|x| x * (1.0 + STEP * random.signed()))
}

/// Names, order and zeros stay. `None` if the change is no model.
fn changed_model(model: &Model, random: &mut Random) -> Option<Model> {
    let placed = |p: Placement, random: &mut Random| Placement {
        translation: vector(p.translation, random),
        rotation: p.rotation,
    };
    let mut builder = ModelBuilder::new(model.name()).gravity(vector(model.gravity(), random));
    for (k, (body, joint)) in model.bodies().iter().zip(model.joints()).enumerate() {
        let Inertia { mass, frame, tensor } = body.inertia;
        let inertia = Inertia {
            mass: mass * (1.0 + STEP * random.signed()),
            frame: placed(frame, random),
            tensor: vector(tensor, random),
        };
        let parent = model.tree().parent(k).map_or("world", |p| &model.bodies()[p].name);
        let joint = Joint::new(joint.name.as_str(), joint.kind).at(placed(joint.placement, random));
        builder =
            builder.body(Body::new(body.name.as_str(), inertia)).joint(joint, parent, body.name.as_str());
    }
    builder.build().ok()
}
