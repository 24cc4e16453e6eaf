//! Which hinges have no articulated inertia: a check made once per model, before anything runs.

use crate::composites::composite_inertias;
use crate::layout::{GROUND, Layout};
use phipsi_model::{Model, Subject, Violation};
use phipsi_spatial::{Dd, Scalar};

/// D below this part of the inertia it was formed from is rounding in f64: 4 ε.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Joints whose articulated inertia is zero at generic configurations: massless chains, or mass on the joint's axis only.
///
/// # Method
/// The articulated sweep at three random states, in double-double numbers, so that rounding does not pass for inertia; a
/// pivot is singular if it is below 4 ε times the scale of its own joint: the trace of the composite inertia about the
/// hinge, or the composite mass. A singular hinge is treated as locked, so that the next ones inboard are judged too.
/// Cost O(n).
pub fn singular_hinges(model: &Model) -> Vec<Violation> {
    let layout = Layout::<Dd>::new(model);
    if layout.is_flexible() {
        return flexible_hinges(model, &layout);
    }
    let mut singular: Option<Vec<bool>> = None;
    for seed in 0..3 {
        let q: Vec<Dd> = model.random_state(seed).q.iter().map(|&x| Dd::from_f64(x)).collect();
        let now = singular_at(&layout, &q);
        singular = Some(match singular {
            None => now,
            Some(before) => before.iter().zip(&now).map(|(a, b)| *a && *b).collect(),
        });
    }
    let mut found = Vec::new();
    for (i, bad) in singular.unwrap_or_default().iter().enumerate() {
        if *bad {
            let (name, component) = layout.joint_of_velocity(i);
            found.push(Violation::error(
                Subject::Joint(name.into()),
                format!("no articulated inertia about degree of freedom {component}"),
                "inertia outboard of every joint, away from its axis",
                "give the outboard link mass and inertia, or make the joint fixed",
            ));
        }
    }
    found
}

/// The same for a model with flexible bodies, one pivot for each degree of freedom; a pivot that fails ends the sweep, so that only
/// the first hinge without inertia is named.
fn flexible_hinges(model: &Model, layout: &Layout<Dd>) -> Vec<Violation> {
    let failures = [0, 1, 2].map(|seed| {
        let q: Vec<Dd> = model.random_state(seed).q.iter().map(|&x| Dd::from_f64(x)).collect();
        crate::flexible::first_singular(layout, &q, ROUNDING)
    });
    let [Some(first), Some(_), Some(_)] = failures else { return Vec::new() };
    let (name, component) = layout.joint_of_velocity(first);
    vec![Violation::error(
        Subject::Joint(name.into()),
        format!("no articulated inertia about degree of freedom {component}"),
        "inertia outboard of every joint, away from its axis, and modes that do not move with the joint",
        "give the outboard link mass and inertia, leave the mode out, or make the joint fixed",
    )]
}

fn singular_at(layout: &Layout<Dd>, q: &[Dd]) -> Vec<bool> {
    let (hinge, R) = composite_inertias(layout, q);
    let mut P: Vec<_> = layout.bodies.iter().map(|b| b.inertia.to_articulated()).collect();
    let mut singular = vec![false; layout.nv()];
    for (k, body) in layout.bodies.iter().enumerate().rev() {
        let r = &R[k];
        let rotation_scale = r.inertia.xx + r.inertia.yy + r.inertia.zz;
        for i in 0..body.hinge.nv() {
            let scale = if body.hinge.components()[i] < 3 { rotation_scale } else { r.mass };
            let axis = body.hinge.axis(i);
            let column = P[k].times(axis);
            let D = axis.dot(column);
            if D.is_positive() && D > scale * Dd::from_f64(ROUNDING) {
                P[k].add_outer(column, -D.recip());
            } else {
                singular[body.v + i] = true;
            }
        }
        if body.parent != GROUND {
            P[body.parent] = P[body.parent] + hinge[k].articulated_to_parent(&P[k]);
        }
    }
    singular
}
