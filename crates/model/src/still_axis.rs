//! Bodies on a line: free bodies that do not turn about an axis of symmetry.
//!
//! | symbol | meaning |
//! |---|---|
//! | a | the axis: a unit vector of the body frame, through its origin |
//! | J | the inertia about a, which such a body has in its `inertia` and which nothing feels |
//!
//! A free body of point masses on a line has five degrees of freedom: a position and a direction. Two angles for the direction
//! are singular somewhere, and its inertia about the line is zero. As a free body with J > 0 that is symmetric about a and has
//! nothing hanging on it, it has a·n = J a·ω with d(a·n)/dt = a·torque, which is zero for forces on points of the line: what
//! begins with a·ω = 0 keeps it, and moves as the five degrees of freedom do, whatever J is. a·n does not couple to the other
//! momenta, so that dropping it is the projection in the metric of the kinetic energy.

use crate::joint::rotation_from_z;
use crate::model::{Body, Model};
use crate::violation::{Subject, Violation};
use phipsi_spatial::Vec3;

/// An angular velocity that stays zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StillAxis {
    /// The body.
    pub body: usize,
    /// The first of the three components of its angular velocity in v, and of its angular momentum in p.
    pub dof: usize,
    /// The axis, a unit vector of the body frame.
    pub axis: Vec3<f64>,
}

impl StillAxis {
    /// Removes the component along the axis from velocities v or momenta p (nv).
    pub fn remove(&self, vector: &mut [f64]) {
        if let Some(three) = vector.get_mut(self.dof..self.dof + 3) {
            let along: f64 = three.iter().zip(&self.axis.0).map(|(x, a)| x * a).sum();
            three.iter_mut().zip(&self.axis.0).for_each(|(x, a)| *x -= along * a);
        }
    }
}

impl Body {
    /// The same body, which does not turn about an axis through its origin (any length but zero): see [`Model::still_axes`].
    pub fn with_still_axis(mut self, axis: [f64; 3]) -> Self {
        self.still_axis = Some(axis);
        self
    }
}

impl Model {
    /// The axes about which free bodies do not turn. Their velocities are part of v, and zero: degrees of freedom are nv less
    /// the number of these axes. Methods that draw or set momenta leave them zero; products with M know nothing of them.
    pub fn still_axes(&self) -> impl Iterator<Item = StillAxis> {
        self.bodies.iter().enumerate().filter_map(|(body, b)| {
            let axis = Vec3(b.still_axis?);
            let axis = axis.scale(1.0 / axis.norm());
            Some(StillAxis { body, dof: self.v_offset(body), axis })
        })
    }
}

/// A body with a still axis: free, without children, symmetric about a line through its origin.
pub(crate) fn check_still_axis(body: &Body, is_alone: bool, found: &mut Vec<Violation>) {
    let Some(axis) = body.still_axis else { return };
    let mut wrong = |what: String, required: &str, remedy: &str| {
        found.push(Violation::error(Subject::Body(body.name.clone()), what, required, remedy));
    };
    let length = Vec3(axis).norm();
    if !(length.is_finite() && length > 0.0) {
        let remedy = "give the direction of the line on which its masses lie";
        return wrong(format!("still axis {axis:?}"), "a finite vector that is not zero", remedy);
    }
    if !is_alone || body.flexible.is_some() {
        let what = "a still axis of a body that is not by itself";
        let required = "a rigid body with a floating joint on the world and without children";
        return wrong(what.into(), required, "remove the still axis");
    }
    let a = Vec3(axis).scale(1.0 / length);
    let inertia = body.inertia.to_rigid::<f64>();
    let moment = inertia.inertia * a;
    let (along, trace) = (a.dot(moment), inertia.inertia.xx + inertia.inertia.yy + inertia.inertia.zz);
    // About the origin, of a unit vector across the axis: half of what is left of the trace, whichever it is.
    let across = 0.5 * (trace - along);
    let b = rotation_from_z(a).column(0);
    let off = (moment - a.scale(along)).norm() + (inertia.inertia * b - b.scale(across)).norm();
    let beside = inertia.first_moment.cross(a).norm();
    // Products of nine terms each, and the rotation of the inertial frame.
    let rounding = 256.0 * f64::EPSILON;
    let is_symmetric = off <= rounding * trace && beside <= rounding * inertia.first_moment.norm();
    if !(is_symmetric && along > 0.0) {
        let what = format!("a still axis {axis:?} about which its inertia is not symmetric");
        let required = "equal moments across the axis, a moment above zero about it, the origin on it";
        wrong(what, required, "put the origin on the line, or remove the still axis");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Inertia, Joint, JointKind, ModelBuilder};

    /// A rod along z with its center at z = 2.
    fn rod() -> Body {
        Body::new("rod", Inertia::from_principal(2.0, [0.0, 0.0, 2.0], [0.5, 0.5, 0.1]))
    }

    #[test]
    fn a_still_axis_is_one_of_symmetry() {
        let build = |body: Body, kind: JointKind| {
            ModelBuilder::new("m").body(body).joint(Joint::new("j", kind), "world", "rod").build()
        };
        let model = build(rod().with_still_axis([0.0, 0.0, -3.0]), JointKind::Free).unwrap();
        let axes: Vec<StillAxis> = model.still_axes().collect();
        assert_eq!(axes, [StillAxis { body: 0, dof: 0, axis: Vec3([0.0, 0.0, -1.0]) }]);
        let mut v = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        axes[0].remove(&mut v);
        assert_eq!(v, [1.0, 2.0, 0.0, 4.0, 5.0, 6.0]);
        let refused = |body: Body, kind: JointKind, part: &str| {
            let text = build(body, kind).unwrap_err().to_string();
            assert!(text.contains(part), "{text}");
        };
        refused(rod().with_still_axis([1.0, 0.0, 0.0]), JointKind::Free, "symmetric");
        refused(rod().with_still_axis([0.0; 3]), JointKind::Free, "not zero");
        refused(rod().with_still_axis([f64::NAN, 0.0, 0.0]), JointKind::Free, "finite");
        refused(rod().with_still_axis([0.0, 0.0, 1.0]), JointKind::Spherical, "floating");
    }
}
