//! Random models and states, each addressed by one seed.
//!
//! Trees with branches at several levels, all joint kinds, fused and massless bodies, fixed, free and several roots, axes
//! and placements both special and general, masses and lengths over decades.

use phipsi_model::builder::STANDARD_GRAVITY;
use phipsi_model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random};
use phipsi_spatial::{Vec3, Wrench};

/// What a generated model may contain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest number of degrees of freedom, but for those of the last joint.
    pub degrees_of_freedom: usize,
    /// Masses are spread over 10^±decades, lengths over the square root of that.
    pub decades: f64,
}

impl Limits {
    /// Up to 40 degrees of freedom, most models smaller; masses equal in size or over up to four decades.
    fn of_seed(random: &mut Random) -> Self {
        let u = random.uniform();
        let decades = [0.0, 0.5, 1.0, 2.0][random.below(4)];
        Limits { degrees_of_freedom: 1 + (39.0 * u * u) as usize, decades }
    }
}

/// A model with a state, accelerations, forces, one external wrench per body and a point in one body.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// The model.
    pub model: Model,
    /// Position coordinates, nq.
    pub q: Vec<f64>,
    /// Velocities, nv.
    pub v: Vec<f64>,
    /// Accelerations, nv.
    pub a: Vec<f64>,
    /// Generalised forces, nv.
    pub tau: Vec<f64>,
    /// One per body.
    pub wrenches: Vec<Wrench<f64>>,
    /// Further wrenches, one per body, that every result with forces takes in: zero, but for perturbed cases.
    pub rounding: Vec<Wrench<f64>>,
    /// A body.
    pub body: usize,
    /// A point in its frame, m.
    pub point: Vec3<f64>,
}

/// The case of a seed.
pub fn case(seed: u64) -> Case {
    let limits = Limits::of_seed(&mut Random::new(seed ^ 0x6c69_6d69_7473));
    case_within(seed, limits)
}

/// The case of a seed, with limits of the caller's.
pub fn case_within(seed: u64, limits: Limits) -> Case {
    let mut random = Random::new(seed);
    let model = model(&mut random, limits);
    case_of(&mut random, model)
}

/// A state of a model, and the rest.
fn case_of(random: &mut Random, model: Model) -> Case {
    let q = configuration(random, &model);
    let mut numbers = |n: usize| {
        let scale = 10f64.powi(random.below(4) as i32 - 2);
        (0..n).map(|_| scale * random.signed()).collect::<Vec<f64>>()
    };
    let (v, a, tau) = (numbers(model.nv()), numbers(model.nv()), numbers(model.nv()));
    let w = numbers(6 * model.len());
    let wrenches =
        w.chunks_exact(6).map(|w| Wrench::from_array([w[0], w[1], w[2], w[3], w[4], w[5]])).collect();
    let (body, point) = (random.below(model.len()), Vec3(random.vector()));
    let rounding = vec![Wrench::zero(); model.len()];
    Case { model, q, v, a, tau, wrenches, rounding, body, point }
}

/// A case whose model has three to six limbs of one shape: hinges, perhaps sliders, each limb with its own axes, placements and masses; on one
/// body or on several.
pub fn case_with_limbs(seed: u64) -> Case {
    let mut random = Random::new(seed ^ 0x006c_696d_6273);
    let decades = [0.0, 0.5, 1.0][random.below(3)];
    let limits = Limits { degrees_of_freedom: 1 + random.below(8), decades };
    let trunk = model(&mut random, limits);
    let model = with_limbs(&mut random, &trunk, limits);
    case_of(&mut random, model)
}

/// The model with limbs that are alike.
fn with_limbs(random: &mut Random, trunk: &Model, limits: Limits) -> Model {
    let size = 2 + random.below(4);
    let parents: Vec<usize> =
        (1..size).map(|k| if random.uniform() < 0.7 { k - 1 } else { random.below(k) }).collect();
    let slides: Vec<bool> = (0..size).map(|_| random.uniform() < 0.15).collect();
    let (count, together) = (3 + random.below(4), random.uniform() < 0.6);
    let place = |random: &mut Random| match random.below(trunk.len() + 1) {
        k if k < trunk.len() => trunk.bodies()[k].name.clone(),
        _ => "world".into(),
    };
    let (mut builder, mut on) = (builder_of(trunk), place(random));
    for limb in 0..count {
        if !together {
            on = place(random);
        }
        for k in 0..size {
            let name = |k: usize| format!("limb{limb}_{k}");
            let axis = axis(random);
            let kind = if slides[k] { JointKind::Prismatic { axis } } else { JointKind::Revolute { axis } };
            let joint = Joint::new(format!("on_{}", name(k)), kind).at(placement(random, limits));
            let parent = if k == 0 { on.clone() } else { name(parents[k - 1]) };
            builder = builder.body(Body::new(name(k).as_str(), inertia(random, limits)));
            builder = builder.joint(joint, parent, name(k));
        }
    }
    builder.build().expect("limbs on a valid model")
}

/// A body before it has its mass.
struct Draft {
    parent: Option<usize>,
    kind: JointKind,
    placement: Placement,
    massless: bool,
}

/// A random model.
pub fn model(random: &mut Random, limits: Limits) -> Model {
    let drafts = drafts(random, limits);
    let gravity = match random.below(4) {
        0 => STANDARD_GRAVITY,
        1 => [0.0; 3],
        _ => random.vector().map(|x| 9.81 * x),
    };
    let mut builder = ModelBuilder::new("generated").gravity(gravity);
    let one_root = drafts.iter().filter(|d| d.parent.is_none()).count() == 1;
    for (k, draft) in drafts.iter().enumerate() {
        let name = format!("b{k}");
        let inertia = if draft.massless { Inertia::ZERO } else { inertia(random, limits) };
        builder = builder.body(Body::new(name.as_str(), inertia));
        // One root may hang on the world without a joint of the user's.
        let implied = k == 0 && one_root && draft.placement == Placement::IDENTITY;
        match draft.kind {
            JointKind::Free if implied => builder = builder.base(Base::Free),
            JointKind::Fixed if implied => builder = builder.base(Base::Fixed),
            kind => {
                let parent = draft.parent.map_or("world".into(), |p| format!("b{p}"));
                builder = builder.joint(Joint::new(format!("j{k}"), kind).at(draft.placement), parent, name);
            }
        }
    }
    builder.build().expect("generated models are valid")
}

/// Topology, joints and placements, and which bodies are massless.
fn drafts(random: &mut Random, limits: Limits) -> Vec<Draft> {
    let (forest, chain) = (random.uniform() < 0.25, random.uniform());
    let mut drafts: Vec<Draft> = Vec::new();
    let mut freedoms = 0;
    while freedoms < limits.degrees_of_freedom {
        let k = drafts.len();
        let parent = match k {
            0 => None,
            _ if forest && random.uniform() < 0.2 => None,
            _ if random.uniform() < chain => Some(k - 1),
            _ => Some(random.below(k)),
        };
        let kind = joint_kind(random, parent.is_none());
        freedoms += kind.nv();
        let placement = placement(random, limits);
        drafts.push(Draft { parent, kind, placement, massless: false });
    }
    // A massless body keeps its joint regular if a massive body hangs on it by another one-axis joint; both in general
    // position. A massless body that is fused changes nothing.
    for k in (0..drafts.len()).rev() {
        let wanted = random.uniform() < 0.3;
        let carried = (k + 1..drafts.len())
            .find(|&c| drafts[c].parent == Some(k) && !drafts[c].massless && drafts[c].kind.nv() == 1);
        let leaf = !drafts.iter().any(|d| d.parent == Some(k));
        match carried {
            Some(c) if wanted && drafts[k].kind.nv() == 1 => {
                for joint in [k, c] {
                    drafts[joint].kind = JointKind::Revolute { axis: direction(random) };
                    drafts[joint].placement = general_placement(random, limits);
                }
                drafts[k].massless = true;
            }
            _ => drafts[k].massless = wanted && leaf && drafts[k].kind == JointKind::Fixed,
        }
    }
    drafts
}

pub(crate) fn joint_kind(random: &mut Random, root: bool) -> JointKind {
    if root && random.uniform() < 0.3 {
        return JointKind::Free;
    }
    let axis = axis(random);
    match random.below(14) {
        0 | 1 => JointKind::Fixed,
        2 | 3 => JointKind::Revolute { axis },
        4 => JointKind::Continuous { axis },
        5 | 6 => JointKind::Prismatic { axis },
        7 => JointKind::Helical { axis, pitch: random.signed() },
        8 => JointKind::Cylindrical { axis },
        9 => JointKind::Universal { axes: [direction(random), direction(random)] },
        10 => JointKind::Planar { normal: axis },
        11 => JointKind::Translation,
        12 => JointKind::Spherical,
        _ => JointKind::Free,
    }
}

/// A vector that is not short.
fn direction(random: &mut Random) -> [f64; 3] {
    loop {
        let a = random.vector();
        if a.iter().map(|x| x * x).sum::<f64>() > 0.1 {
            return a;
        }
    }
}

/// A coordinate axis, with either sign, or any direction.
fn axis(random: &mut Random) -> [f64; 3] {
    match random.below(7) {
        i @ 0..3 => Vec3::unit(i).0,
        i @ 3..6 => (-Vec3::unit(i - 3)).0,
        _ => direction(random),
    }
}

fn length(random: &mut Random, limits: Limits) -> f64 {
    10f64.powf(0.5 * limits.decades * random.signed())
}

pub(crate) fn general_placement(random: &mut Random, limits: Limits) -> Placement {
    let scale = length(random, limits);
    Placement { translation: direction(random).map(|x| scale * x), rotation: random.quaternion() }
}

pub(crate) fn placement(random: &mut Random, limits: Limits) -> Placement {
    let general = general_placement(random, limits);
    match random.below(6) {
        0 => Placement::IDENTITY,
        1 => Placement { rotation: Placement::IDENTITY.rotation, ..general },
        2 => Placement { translation: [0.0; 3], ..general },
        _ => general,
    }
}

/// A brick somewhere near the body's origin.
pub(crate) fn inertia(random: &mut Random, limits: Limits) -> Inertia {
    let mass = 10f64.powf(limits.decades * random.signed());
    let size = length(random, limits);
    let [a, b, c] = [0; 3].map(|_| size * (0.2 + 0.8 * random.uniform()));
    let moments = [b * b + c * c, c * c + a * a, a * a + b * b].map(|s| mass * s / 12.0);
    let mut inertia = Inertia::from_principal(mass, random.vector().map(|x| size * x), moments);
    inertia.frame.rotation = random.quaternion();
    inertia
}

/// A random configuration: angles in one turn, large or zero; quaternions of any length.
pub fn configuration(random: &mut Random, model: &Model) -> Vec<f64> {
    let mut q = Vec::with_capacity(model.nq());
    for joint in model.joints() {
        let mut coordinate = |q: &mut Vec<f64>| {
            q.push(match random.below(8) {
                0 => 0.0,
                1 => 20.0 * random.signed(),
                _ => std::f64::consts::PI * random.signed(),
            });
        };
        match joint.kind {
            JointKind::Spherical => {}
            JointKind::Free => (0..3).for_each(|_| coordinate(&mut q)),
            _ => (0..joint.kind.nq()).for_each(|_| coordinate(&mut q)),
        }
        if matches!(joint.kind, JointKind::Spherical | JointKind::Free) {
            let scale = if random.below(4) == 0 { 1.0 + random.uniform() } else { 1.0 };
            q.extend(random.quaternion().map(|x| scale * x));
        }
    }
    q
}

/// The same model, to be built upon.
fn builder_of(model: &Model) -> ModelBuilder {
    let builder = ModelBuilder::new(model.name());
    redone(builder, model, |_, body| body.inertia, |_, joint| (joint.kind, joint.placement), model.gravity())
}

/// The model with other bodies and joints; names, tree and gravity stay.
pub fn rebuilt(
    model: &Model,
    body: impl FnMut(usize, &Body) -> Inertia,
    joint: impl FnMut(usize, &Joint) -> (JointKind, Placement),
    gravity: [f64; 3],
) -> Model {
    let builder = redone(ModelBuilder::new(model.name()), model, body, joint, gravity);
    builder.build().expect("another valid model")
}

fn redone(
    builder: ModelBuilder,
    model: &Model,
    mut body: impl FnMut(usize, &Body) -> Inertia,
    mut joint: impl FnMut(usize, &Joint) -> (JointKind, Placement),
    gravity: [f64; 3],
) -> ModelBuilder {
    let mut builder = builder.gravity(gravity);
    for (k, (old, hinge)) in model.bodies().iter().zip(model.joints()).enumerate() {
        let parent = model.tree().parent(k).map_or("world".into(), |p| model.bodies()[p].name.clone());
        let (kind, placement) = joint(k, hinge);
        builder = builder.body(Body::new(old.name.as_str(), body(k, old))).joint(
            Joint::new(hinge.name.as_str(), kind).at(placement),
            parent,
            old.name.as_str(),
        );
    }
    builder
}

/// The model with some bodies without mass and some that are points.
pub fn starved(random: &mut Random, model: &Model) -> Model {
    let body = |_: usize, body: &Body| match random.below(4) {
        0 => Inertia::ZERO,
        1 => Inertia { tensor: [0.0; 6], ..body.inertia },
        _ => body.inertia,
    };
    rebuilt(model, body, |_, joint| (joint.kind, joint.placement), model.gravity())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// What the tests of the kernels rely on: a thousand seeds contain every kind and every shape, many times.
    #[test]
    fn a_thousand_seeds_contain_everything() {
        let mut count: BTreeMap<&str, usize> = BTreeMap::new();
        let mut seen = |what: &'static str, is: bool| *count.entry(what).or_default() += usize::from(is);
        for seed in 0..1000 {
            let model = case(seed).model;
            let tree = model.tree();
            let depths = tree.depths();
            let mut branching: Vec<usize> = tree
                .children()
                .iter()
                .enumerate()
                .filter(|(_, children)| children.len() > 1)
                .map(|(k, _)| depths[k])
                .collect();
            branching.sort_unstable();
            branching.dedup();
            seen("branches on two levels", branching.len() > 1);
            seen("several roots", tree.parents().iter().filter(|p| p.is_none()).count() > 1);
            seen("nv = 1", model.nv() == 1);
            seen("nv > 35", model.nv() > 35);
            for (k, joint) in model.joints().iter().enumerate() {
                seen(joint.kind.word(), true);
                let root = tree.parent(k).is_none();
                seen("fixed root", root && joint.kind == JointKind::Fixed);
                seen("free root", root && joint.kind == JointKind::Free);
                seen("free body inside", !root && joint.kind == JointKind::Free);
                let massless = model.bodies()[k].inertia.is_zero();
                seen("massless, moving", massless && joint.kind.nv() > 0);
                seen("massless, fused", massless && joint.kind.nv() == 0);
                seen("root without a joint", joint.name == model.bodies()[k].name);
            }
        }
        assert!(count.values().all(|&n| n > 20), "{count:?}");
        assert_eq!(count.len(), 11 + 10, "{count:?}");
    }

    #[test]
    fn a_seed_is_one_case() {
        assert_eq!(case(7), case(7));
        assert_ne!(case(7).q, case(8).q);
    }
}
