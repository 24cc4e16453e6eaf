//! Random mechanisms with loops, each addressed by one seed: a random tree, and closures that its random state closes.

use crate::closed_dynamics::{ClosedSolution, Given, angular_rows, closed_dynamics, closure_rates};
use crate::generate::{Case, Limits, case_within};
use crate::kinematics::kinematics;
use crate::sensitivity::widened;
use phipsi_model::{Closure, ClosureKind, Coupling, JointKind, Model, ModelBuilder, Placement, Random};
use phipsi_spatial::quaternion::pose;
use phipsi_spatial::{Dd, Quaternion, Real, Transform, Vec3, Wrench};

/// How two bodies are joined: everything but where frame B is, which the state tells.
#[derive(Clone, Debug)]
struct Draft {
    kind: ClosureKind,
    bodies: [Option<usize>; 2],
    pose_a: Placement,
    /// Angles and lengths of the freedoms that the closure leaves.
    freedoms: [f64; 6],
}

/// What a closed case is made of, besides its tree.
#[derive(Clone, Debug)]
pub struct Drafts {
    closures: Vec<Draft>,
    /// Joint, source, multiplier.
    couplings: Vec<(usize, usize, f64)>,
    /// Accelerations from which those of moving closures come, nv; empty if they rest.
    moving: Vec<f64>,
    /// Which degrees of freedom are prescribed.
    pub active: Vec<bool>,
}

/// A mechanism with loops in a state in which they are closed, at velocities that keep them so.
#[derive(Clone, Debug)]
pub struct ClosedCase {
    /// Model, state and forces.
    pub case: Case,
    /// γ̈ of every row, consistent where rows are redundant.
    pub gamma: Vec<f64>,
    /// Which degrees of freedom are prescribed.
    pub active: Vec<bool>,
    /// Accelerations that the closures allow.
    pub allowed: Vec<f64>,
    /// How it was made.
    pub drafts: Drafts,
}

/// Pivots below this are zero: frames are rounded to 1e-16.
pub const TOLERANCE: f64 = 1e-10;

/// The case of a seed.
pub fn closed_case(seed: u64) -> ClosedCase {
    let mut random = Random::new(seed ^ 0x6c6f_6f70_7321);
    let decades = [0.0, 0.5, 1.0][random.below(3)];
    let limits = Limits { degrees_of_freedom: 3 + random.below(8), decades };
    let tree = case_within(seed, limits);
    let drafts = drafts(&mut random, &tree);
    closed(&tree, drafts)
}

/// Which degrees of freedom are prescribed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Active {
    /// None of them.
    None,
    /// At least one, and not all.
    Some,
    /// All.
    All,
}

/// What a mechanism is to be.
#[derive(Clone, Copy, Debug)]
pub struct Combination {
    /// On a free joint, or not.
    pub free: bool,
    /// With closures or couplings, or without.
    pub loops: bool,
    /// What is prescribed.
    pub active: Active,
}

/// A case of up to eight bodies of that combination.
pub fn closed_case_of(seed: u64, wanted: Combination) -> ClosedCase {
    let mut random = Random::new(seed ^ 0x6772_6170_6873);
    loop {
        let limits = Limits { degrees_of_freedom: 8 + random.below(4), decades: 0.5 };
        let tree = case_within(random.below(1 << 30) as u64, limits);
        let bases =
            tree.model.joints().iter().enumerate().filter(|(k, _)| tree.model.tree().parent(*k).is_none());
        let floating: Vec<bool> = bases.map(|(_, joint)| joint.kind == JointKind::Free).collect();
        if tree.model.len() > 8 || floating != [wanted.free] || tree.model.nv() < 2 {
            continue;
        }
        let mut drafts = drafts(&mut random, &tree);
        if !wanted.loops {
            (drafts.closures, drafts.couplings) = (Vec::new(), Vec::new());
        } else if drafts.closures.is_empty() {
            continue;
        }
        let nv = tree.model.nv();
        drafts.active = match wanted.active {
            Active::None => vec![false; nv],
            Active::All => vec![true; nv],
            Active::Some => (0..nv).map(|_| random.below(2) == 0).collect(),
        };
        if wanted.active == Active::Some && drafts.active.iter().all(|a| *a == drafts.active[0]) {
            continue;
        }
        return closed(&tree, drafts);
    }
}

fn drafts(random: &mut Random, tree: &Case) -> Drafts {
    let n = tree.model.len();
    let mut closures: Vec<Draft> = Vec::new();
    for _ in 0..1 + random.below(4) {
        if !closures.is_empty() && random.below(5) == 0 {
            // The same once more: every row twice.
            let again = closures[random.below(closures.len())].clone();
            closures.push(again);
            continue;
        }
        let a = if random.below(3) == 0 { None } else { Some(random.below(n)) };
        let b = Some(random.below(n));
        if a == b {
            continue;
        }
        let length = 0.3 + random.uniform();
        let word = ClosureKind::WORDS[random.below(9)];
        let kind = ClosureKind::from_word(word, length).expect("a word");
        let pose_a = Placement { translation: random.vector(), rotation: random.quaternion() };
        let bodies = if random.below(2) == 0 { [a, b] } else { [b, a] };
        closures.push(Draft { kind, bodies, pose_a, freedoms: [0; 6].map(|_| random.signed()) });
    }
    let single: Vec<usize> =
        tree.model.moving_joints().filter(|&k| tree.model.joints()[k].kind.nv() == 1).collect();
    let mut couplings = Vec::new();
    if single.len() > 1 && random.below(3) == 0 {
        let (i, j) = (random.below(single.len()), random.below(single.len()));
        if i != j {
            couplings.push((single[i], single[j], 2.0 * random.signed()));
        }
    }
    let nv = tree.model.nv();
    let moving = if random.below(2) == 0 { Vec::new() } else { (0..nv).map(|_| random.signed()).collect() };
    let active = match random.below(4) {
        0 => (0..nv).map(|_| random.below(2) == 0).collect(),
        1 if random.below(4) == 0 => vec![true; nv],
        _ => vec![false; nv],
    };
    Drafts { closures, couplings, moving, active }
}

/// Frame B in frame A: the freedoms that a kind leaves.
fn left_free(draft: &Draft) -> Transform<Dd> {
    let [a, b, c, x, y, z] = draft.freedoms.map(Dd::from_f64);
    let about = |axis: usize, angle: Dd| Quaternion::exp(Vec3::unit(axis).scale(angle));
    let any = Quaternion::exp(Vec3([a, b, c]));
    let still = Quaternion::identity();
    let o = Dd::from_f64(0.0);
    let (rotation, offset) = match draft.kind {
        ClosureKind::Weld => (still, Vec3::zero()),
        ClosureKind::Revolute => (about(2, a), Vec3::zero()),
        ClosureKind::Universal => (about(0, a).compose(about(1, b)), Vec3::zero()),
        ClosureKind::Cylindrical => (about(2, a), Vec3([o, o, z])),
        ClosureKind::Prismatic => (still, Vec3([o, o, z])),
        ClosureKind::Planar => (about(2, a), Vec3([x, y, o])),
        ClosureKind::PointOnPlane => (any, Vec3([x, y, o])),
        ClosureKind::Distance { length } => {
            let line = Vec3([x, y, Dd::from_f64(1.5)]);
            (any, line.scale(Dd::from_f64(length) / line.norm()))
        }
        _ => (any, Vec3::zero()),
    };
    pose(rotation, offset)
}

/// The case on a tree: its closures hold at the tree's q, and its v keeps them.
pub fn closed(tree: &Case, drafts: Drafts) -> ClosedCase {
    let q = widened(&tree.q);
    let model = closed_model(&tree.model, &q, &drafts);
    let (n, rows) = (model.nv(), angular_rows(&model).len());
    let zero = vec![Dd::from_f64(0.0); n];
    // What the loops hold still is zero, not the rounding of zero.
    let number = |x: &Dd| if x.to_f64().abs() < 1e-20 { 0.0 } else { x.to_f64() };
    let rounded = |x: Vec<Dd>| -> Vec<f64> { x.iter().map(number).collect() };
    // Velocities: the dense solution at rest without forces, driven by γ̈ = −J v.
    let v = widened(&tree.v);
    let still = model.clone().with_gravity([0.0; 3]);
    let rates = closure_rates(&model, &q, &v, &zero);
    let mut given = Given {
        wrenches: None,
        gamma: rates.iter().map(|r| -r[0]).collect(),
        active: vec![false; n],
        acceleration: zero.clone(),
        length: 1.0,
        tolerance: TOLERANCE,
    };
    let change = closed_dynamics(&still, &q, &zero, &zero, &given).expect("generated trees are regular");
    let v: Vec<f64> = rounded(v.iter().zip(&change.acceleration).map(|(v, d)| *v + *d).collect());
    // γ̈ of moving closures is that of some accelerations, so that redundant rows agree.
    let wide = widened(&v);
    let gamma: Vec<Dd> = match drafts.moving.is_empty() {
        true => vec![Dd::from_f64(0.0); rows],
        false => closure_rates(&model, &q, &wide, &widened(&drafts.moving)).iter().map(|r| r[1]).collect(),
    };
    given.gamma = gamma.clone();
    let tau = widened(&tree.tau);
    let allowed = closed_dynamics(&model, &q, &wide, &tau, &given).expect("generated trees are regular");
    let active = drafts.active.clone();
    let case = Case { model, v, ..tree.clone() };
    ClosedCase { case, gamma: rounded(gamma), active, allowed: rounded(allowed.acceleration), drafts }
}

/// The same closures on another tree and state: the frames B go where they hold there.
pub fn closed_again(tree: &Case, drafts: &Drafts) -> ClosedCase {
    let model = tree.model.clone().without_closures();
    closed(&Case { model, ..tree.clone() }, drafts.clone())
}

fn closed_model(tree: &Model, q: &[Dd], drafts: &Drafts) -> Model {
    let zero = vec![Dd::from_f64(0.0); tree.nv()];
    let motions = kinematics(tree, q, &zero, &zero);
    let place = |body: Option<usize>| body.map_or(Transform::identity(), |k| motions[k].pose);
    let name = |body: Option<usize>| body.map_or("world".into(), |k: usize| tree.bodies()[k].name.clone());
    let mut builder = ModelBuilder::new(tree.name()).gravity(tree.gravity());
    for (k, (body, joint)) in tree.bodies().iter().zip(tree.joints()).enumerate() {
        let parent = tree.tree().parent(k).map_or("world".into(), |p| tree.bodies()[p].name.clone());
        builder = builder.body(body.clone()).joint(joint.clone(), parent, body.name.clone());
    }
    for (i, draft) in drafts.closures.iter().enumerate() {
        let [a, b] = draft.bodies;
        let frame_a = place(a).compose(&draft.pose_a.to_transform());
        let frame_b = place(b).inverse().compose(&frame_a.compose(&left_free(draft)));
        let rotation = Quaternion::from_rotation(&frame_b.rotation).0.map(|x| x.to_f64());
        let pose_b = Placement { translation: frame_b.translation.0.map(|x| x.to_f64()), rotation };
        builder = builder.closure(Closure {
            name: format!("c{i}"),
            kind: draft.kind,
            body_a: name(a),
            pose_a: draft.pose_a,
            body_b: name(b),
            pose_b,
        });
    }
    for &(joint, source, multiplier) in &drafts.couplings {
        let at = |k: usize| q[tree.q_offset(k)];
        let offset = (at(joint) - Dd::from_f64(multiplier) * at(source)).to_f64();
        let name = |k: usize| tree.joints()[k].name.clone();
        builder = builder.coupling(Coupling { joint: name(joint), source: name(source), multiplier, offset });
    }
    builder.build().expect("generated closures are valid")
}

impl ClosedCase {
    /// The dense solution in double-double numbers; `wrenches`: those of the case and what stands for rounding.
    pub fn solve(&self, wrenches: &[Wrench<Dd>], length: f64) -> ClosedSolution<Dd> {
        let case = &self.case;
        let given = Given {
            wrenches: Some(wrenches),
            gamma: widened(&self.gamma),
            active: self.active.clone(),
            acceleration: widened(&self.allowed),
            length,
            tolerance: TOLERANCE,
        };
        let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
        closed_dynamics(&case.model, &q, &v, &tau, &given).expect("generated trees are regular")
    }
}
