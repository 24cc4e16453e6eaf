//! Random trees of rigid and flexible bodies, each addressed by one seed.
//!
//! A flexible body is made of mass points whose masses, places and shapes are short binary fractions, so that its integrals, sums
//! of products of three, are exact numbers: points and integrals describe the same body to the last digit. Some bodies have more
//! than points can have (rotary inertia, displacement of second order): these are known by their integrals alone.

use crate::generate::{Limits, inertia, joint_kind, placement};
use phipsi_model::{
    Body, FlexibleBody, Inertia, Joint, JointKind, MassPoint, Model, ModelBuilder, Node, Placement, Random,
    ShapeIntegrals, Stiffening,
};
use phipsi_spatial::{Vec3, Wrench};

/// What kinds of flexible bodies a tree may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bodies {
    /// Mass points only.
    Points,
    /// Also bodies with rotary inertia and displacements of second order.
    General,
}

/// A tree with flexible bodies, a state, accelerations, forces and wrenches.
#[derive(Clone, Debug, PartialEq)]
pub struct FlexibleCase {
    /// The model.
    pub model: Model,
    /// Mass points of every body, empty for rigid bodies and for those that are known by integrals alone.
    pub points: Vec<Vec<MassPoint>>,
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
    drafts: Vec<Draft>,
}

#[derive(Clone, Debug, PartialEq)]
struct Draft {
    parent: Option<usize>,
    node: Option<String>,
    kind: JointKind,
    placement: Placement,
    body: Kind,
}

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Rigid(Inertia),
    Points(Vec<MassPoint>, FlexibleBody),
    General(FlexibleBody),
}

const LIMITS: Limits = Limits { degrees_of_freedom: 40, decades: 0.5 };

/// The case of a seed: two to six bodies.
pub fn flexible_case(seed: u64, bodies: Bodies) -> FlexibleCase {
    let mut random = Random::new(seed ^ 0x666c_6578);
    let count = 2 + random.below(5);
    let mut drafts: Vec<Draft> = Vec::new();
    let flexible_first = random.below(count);
    for k in 0..count {
        let parent = match k {
            0 => None,
            _ if random.below(8) == 0 => None,
            _ if random.below(2) == 0 => Some(k - 1),
            _ => Some(random.below(k)),
        };
        let body = if k == flexible_first || random.below(2) == 0 {
            let (points, flexible) = flexible_body(&mut random);
            if bodies == Bodies::General && random.below(3) > 0 {
                Kind::General(enriched(&mut random, flexible))
            } else {
                Kind::Points(points, flexible)
            }
        } else {
            Kind::Rigid(inertia(&mut random, LIMITS))
        };
        let node = parent.and_then(|p: usize| match &drafts[p].body {
            Kind::Rigid(_) => None,
            Kind::Points(_, body) | Kind::General(body) => {
                // Sometimes at the frame itself.
                (random.below(6) > 0).then(|| body.nodes[random.below(body.nodes.len())].name.clone())
            }
        });
        let kind = joint_kind(&mut random, parent.is_none());
        let placement = placement(&mut random, LIMITS);
        drafts.push(Draft { parent, node, kind, placement, body });
    }
    let gravity = random.vector().map(|x| 9.81 * x);
    let (model, points) = build(&drafts, gravity);
    let mut q = crate::generate::configuration(&mut random, &model);
    // Of unit length, for derivatives along increments, which normalise.
    model.normalize(&mut q);
    q.extend((0..model.modes()).map(|_| 0.5 * random.signed()));
    let mut numbers = |n: usize| (0..n).map(|_| random.signed()).collect::<Vec<f64>>();
    let (v, a, tau) = (numbers(model.nv()), numbers(model.nv()), numbers(model.nv()));
    let six = numbers(6 * model.len());
    let wrenches = six.chunks_exact(6).map(|w| Wrench::from_array(std::array::from_fn(|i| w[i]))).collect();
    FlexibleCase { model, points, q, v, a, tau, wrenches, drafts }
}

fn build(drafts: &[Draft], gravity: [f64; 3]) -> (Model, Vec<Vec<MassPoint>>) {
    let mut builder = ModelBuilder::new("flexible").gravity(gravity);
    for (k, draft) in drafts.iter().enumerate() {
        let name = format!("b{k}");
        builder = builder.body(match &draft.body {
            Kind::Rigid(inertia) => Body::new(name.as_str(), *inertia),
            Kind::Points(_, body) | Kind::General(body) => Body::flexible(name.as_str(), body.clone()),
        });
        let parent = draft.parent.map_or("world".to_string(), |p| format!("b{p}"));
        let joint = Joint::new(format!("j{k}"), draft.kind).at(draft.placement);
        builder = match &draft.node {
            Some(node) => builder.joint_at_node(joint, parent, node.as_str(), name),
            None => builder.joint(joint, parent, name),
        };
    }
    let model = builder.build().expect("generated models are valid");
    // Depth-first order may differ from the drafts'.
    let points = model
        .bodies()
        .iter()
        .map(|body| match &drafts[body.name[1..].parse::<usize>().expect("a number")].body {
            Kind::Points(points, _) => points.clone(),
            _ => Vec::new(),
        })
        .collect();
    (model, points)
}

/// A multiple of 1/`parts` in [−1, 1].
fn fraction(random: &mut Random, parts: usize) -> f64 {
    (random.below(2 * parts + 1) as f64 - parts as f64) / parts as f64
}

fn fractions(random: &mut Random, parts: usize, scale: f64) -> [f64; 3] {
    [0; 3].map(|_| scale * fraction(random, parts))
}

/// A body of mass points with one to four modes.
fn flexible_body(random: &mut Random) -> (Vec<MassPoint>, FlexibleBody) {
    let n = 1 + random.below(4);
    let count = 5 + random.below(3);
    let points: Vec<MassPoint> = (0..count)
        .map(|_| MassPoint {
            mass: (1 + random.below(16)) as f64 / 8.0,
            position: fractions(random, 16, 1.0),
            displacement: (0..n).map(|_| fractions(random, 8, 0.5)).collect(),
        })
        .collect();
    let integrals = ShapeIntegrals::from_points(n, &points);
    let matrix = |random: &mut Random| {
        let root: Vec<f64> = (0..n * n).map(|_| fraction(random, 8)).collect();
        let entry = |x: usize| (0..n).map(|k| root[x / n * n + k] * root[x % n * n + k]).sum::<f64>();
        (0..n * n).map(entry).collect::<Vec<f64>>()
    };
    let nodes = (0..2 + random.below(2)).map(|i| node(random, &format!("n{i}"), n)).collect();
    let mut body = FlexibleBody::new(integrals, matrix(random).iter().map(|k| 64.0 * k).collect(), nodes)
        .damped(matrix(random));
    if random.below(3) == 0 {
        body = body.held_at("n0");
    }
    (points, body)
}

/// A symmetric array of vectors.
fn quadratic(random: &mut Random, n: usize, scale: f64) -> Vec<[f64; 3]> {
    let mut all = vec![[0.0; 3]; n * n];
    for l in 0..n {
        for m in 0..=l {
            all[l * n + m] = fractions(random, 8, scale);
            all[m * n + l] = all[l * n + m];
        }
    }
    all
}

fn node(random: &mut Random, name: &str, n: usize) -> Node {
    Node {
        name: name.into(),
        position: fractions(random, 16, 1.0),
        displacement: (0..n).map(|_| fractions(random, 8, 0.5)).collect(),
        rotation: (0..n).map(|_| fractions(random, 8, 0.5)).collect(),
        quadratic: (random.below(2) == 0).then(|| quadratic(random, n, 0.5)),
    }
}

/// The body with rotary inertia and, every other time, displacements of second order.
fn enriched(random: &mut Random, mut body: FlexibleBody) -> FlexibleBody {
    let n = body.modes();
    let integrals = &mut body.integrals;
    for _ in 0..2 {
        let moments = [0; 3].map(|_| (1 + random.below(8)) as f64 / 32.0);
        let turns: Vec<[f64; 3]> = (0..n).map(|_| fractions(random, 8, 0.5)).collect();
        for i in 0..3 {
            integrals.rotary[i][i] += moments[i];
            for l in 0..n {
                integrals.rotary_coupling[l][i] += moments[i] * turns[l][i];
                for m in 0..n {
                    integrals.rotary_modal[l * n + m] += moments[i] * (turns[l][i] * turns[m][i]);
                }
            }
        }
    }
    if random.below(2) == 0 {
        let moment: Vec<Vec<[f64; 3]>> = (0..3).map(|_| quadratic(random, n, 0.125)).collect();
        integrals.stiffening = Some(Stiffening {
            displacement: quadratic(random, n, 0.25),
            moment: (0..n * n).map(|x| [moment[0][x], moment[1][x], moment[2][x]]).collect(),
        });
    }
    body
}

/// The case with all numbers changed by parts of at most `step`.
pub fn perturbed(case: &FlexibleCase, random: &mut Random, step: f64) -> FlexibleCase {
    let mut drafts = case.drafts.clone();
    for draft in &mut drafts {
        draft.placement = Placement {
            translation: vector(draft.placement.translation, random, step),
            rotation: vector(draft.placement.rotation, random, step),
        };
        match &mut draft.body {
            Kind::Rigid(inertia) => {
                inertia.mass *= 1.0 + step * random.signed();
                inertia.frame.translation = vector(inertia.frame.translation, random, step);
                inertia.tensor = vector(inertia.tensor, random, step);
            }
            Kind::Points(points, body) => {
                for point in points.iter_mut() {
                    point.mass *= 1.0 + step * random.signed();
                    point.position = vector(point.position, random, step);
                    for psi in &mut point.displacement {
                        *psi = vector(*psi, random, step);
                    }
                }
                body.integrals = ShapeIntegrals::from_points(body.modes(), points);
                perturb_nodes(body, random, step);
            }
            Kind::General(body) => {
                // Scaled as a whole: its parts belong together.
                let scale = 1.0 + step * random.signed();
                let integrals = &mut body.integrals;
                integrals.mass *= scale;
                integrals.first_moment = vector(integrals.first_moment, random, step);
                for x in &mut integrals.displacement {
                    *x = vector(*x, random, step);
                }
                for x in &mut integrals.rotary_coupling {
                    *x = vector(*x, random, step);
                }
                perturb_nodes(body, random, step);
            }
        }
    }
    let gravity = vector(case.model.gravity(), random, step);
    let (model, points) = build(&drafts, gravity);
    let mut change = |x: &f64| x + step * x.abs().max(1e-3) * random.signed();
    let mut all = |x: &[f64]| x.iter().map(&mut change).collect::<Vec<f64>>();
    let (v, a, tau) = (all(&case.v), all(&case.a), all(&case.tau));
    let wrenches =
        case.wrenches.iter().map(|w| Wrench::from_array(vector(w.to_array(), random, step))).collect();
    // Angles and quaternions by the larger of one and their size: the rounding of a rotation.
    let q = case.q.iter().map(|x| x + step * x.abs().max(1.0) * random.signed()).collect();
    FlexibleCase { model, points, q, v, a, tau, wrenches, drafts }
}

fn perturb_nodes(body: &mut FlexibleBody, random: &mut Random, step: f64) {
    let n = body.modes();
    for node in &mut body.nodes {
        node.position = vector(node.position, random, step);
        for x in node.displacement.iter_mut().chain(&mut node.rotation) {
            *x = vector(*x, random, step);
        }
    }
    for l in 0..n {
        for m in 0..=l {
            let factor = 1.0 + step * random.signed();
            body.stiffness[l * n + m] *= factor;
            body.stiffness[m * n + l] = body.stiffness[l * n + m];
        }
    }
}

fn vector<const N: usize>(x: [f64; N], random: &mut Random, step: f64) -> [f64; N] {
    let size = x.iter().map(|x| x * x).sum::<f64>().sqrt();
    x.map(|x| x + size * step * random.signed())
}

/// A point of the world.
pub fn somewhere(seed: u64) -> Vec3<f64> {
    Vec3(Random::new(seed).vector())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the tests of the kernels rely on.
    #[test]
    fn two_hundred_seeds_contain_everything() {
        let mut seen = [0; 8];
        for seed in 0..200 {
            let case = flexible_case(seed, Bodies::General);
            let model = &case.model;
            for (k, joint) in model.joints().iter().enumerate() {
                let flexible = model.bodies()[k].flexible.as_ref();
                let on = model.attachment(k);
                let facts = [
                    flexible.is_some() && joint.kind == JointKind::Fixed,
                    flexible.is_some() && joint.kind == JointKind::Free,
                    flexible.is_some_and(|b| b.inboard.is_some()),
                    on.is_some_and(|node| node.quadratic.is_some()),
                    on.is_some() && flexible.is_some(),
                    flexible.is_some_and(|b| b.integrals.stiffening.is_some()),
                    on.is_some() && joint.kind == JointKind::Fixed,
                    matches!(joint.kind, JointKind::Universal { .. }) && on.is_some(),
                ];
                facts.iter().zip(&mut seen).for_each(|(fact, count)| *count += usize::from(*fact));
            }
        }
        assert!(seen.iter().all(|&count| count > 5), "{seen:?}");
    }
}
