//! The loops of a model: their ends on the bodies of the layout, and where their branches meet.

use super::{End, Loop, LoopKind};
use crate::error::ClosureError;
use crate::rows::{MOST_ROWS, OWN, axes};
use crate::tree::Tree;
use phipsi_model::{ClosureKind, Model};
use phipsi_recursion::Layout;
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Real, Transform};

/// The loops of a model: closures, then couplings.
pub(super) fn loops<T: Real>(
    model: &Model,
    layout: &Layout<T>,
    tree: &Tree<T>,
) -> Result<Vec<Loop<T>>, ClosureError> {
    let mut loops = Vec::with_capacity(model.closures().len() + model.couplings().len());
    let mut first = 0;
    let end = |body: &str, pose: &phipsi_model::Placement| {
        // Names were checked when the model was built.
        let pose: Transform<T> = pose.to_transform();
        match model.find_body(body).ok().flatten() {
            Some(k) => {
                let carrier = &layout.carriers()[k];
                End { body: tree.carrier(carrier.body), pose: carrier.pose.compose(&pose) }
            }
            None => End { body: GROUND, pose },
        }
    };
    for closure in model.closures() {
        let kind = closure.kind;
        let rows = first..first + kind.rows();
        first = rows.end;
        let (a, b) = (end(&closure.body_a, &closure.pose_a), end(&closure.body_b, &closure.pose_b));
        loops.push(Loop {
            name: closure.name.clone(),
            kind: LoopKind::Frames { kind, a, b },
            rows,
            axes: axes(kind),
            angular: kind.angular_rows(),
            ancestor: GROUND,
            strands: [None; 2],
            attached: [None; 2],
        });
    }
    for coupling in model.couplings() {
        let mut at = [0; 2];
        for (i, name) in [&coupling.joint, &coupling.source].into_iter().enumerate() {
            at[i] = model.find_joint(name).unwrap_or(0);
            let freedoms = model.joints()[at[i]].kind.nv();
            if freedoms != 1 {
                let (joint, found) = (coupling.joint.clone(), name.clone());
                return Err(ClosureError::Coupling { joint, found, freedoms });
            }
        }
        let rotation = model.joints()[at[0]].kind.is_rotation(0);
        let kind = LoopKind::Gear {
            q: at.map(|k| model.q_offset(k)),
            v: at.map(|k| model.v_offset(k)),
            multiplier: T::splat(coupling.multiplier),
            offset: T::splat(coupling.offset),
            rotation,
        };
        let name = coupling.joint.clone();
        let (rows, angular) = (first..first + 1, usize::from(rotation));
        loops.push(Loop {
            name,
            kind,
            rows,
            axes: [OWN; MOST_ROWS],
            angular,
            ancestor: GROUND,
            strands: [None; 2],
            attached: [None; 2],
        });
        first += 1;
    }
    Ok(loops)
}

/// The largest length of the model: of placements, nodes and closures' frames; 1 m if all are zero.
pub(super) fn scene_length<T: Real>(model: &Model, tree: &Tree<T>) -> f64 {
    let norm = |x: [f64; 3]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let joints = tree.bodies.iter().map(|b| b.placement().translation.norm().to_f64());
    let flexible = model.bodies().iter().filter_map(|b| b.flexible.as_ref());
    let nodes = flexible.flat_map(|body| &body.nodes).map(|node| norm(node.position));
    let frames = model.closures().iter().flat_map(|c| {
        let rod = if let ClosureKind::Distance { length } = c.kind { length } else { 0.0 };
        [norm(c.pose_a.translation), norm(c.pose_b.translation), rod]
    });
    let length = joints.chain(nodes).chain(frames).fold(0.0f64, f64::max);
    if length > 0.0 { length } else { 1.0 }
}

pub(super) fn depths<T: Real>(tree: &Tree<T>) -> Vec<usize> {
    let mut depths: Vec<usize> = Vec::with_capacity(tree.len());
    for body in &tree.bodies {
        depths.push(if body.parent == GROUND { 1 } else { depths[body.parent] + 1 });
    }
    depths
}

/// The body in which the ways of two bodies to the ground meet; not modes, but the hinge frame below them: a loop that is closed
/// over a flexible body strains it.
pub(super) fn common_ancestor<T: Real>(tree: &Tree<T>, depths: &[usize], ends: [usize; 2]) -> usize {
    let depth = |k: usize| if k == GROUND { 0 } else { depths[k] };
    let [mut a, mut b] = ends;
    while a != b {
        if depth(a) >= depth(b) {
            a = tree.bodies[a].parent;
        } else {
            b = tree.bodies[b].parent;
        }
    }
    if tree.modes(a).is_some() { tree.bodies[a].parent } else { a }
}
