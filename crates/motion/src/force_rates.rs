//! Derivatives of forces along increments of q, by v and by what a force integrates.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | J_p | Jacobian of a point of a body, (ω, velocity of the point) = J_p v, world axes | 6×nv |
//! | σ, s | angular and linear part of a column of J_p | 3 |
//! | ω_b, u | of the joint of that column: ω of the body before it; velocity of the point relative to that body | 3 |
//! | ∂v_p/∂ξ | σ × u + ω_b × s: s turns with the bodies before it, and the point moves | 3×nv |
//!
//! Derivatives are those at wrenches that are constant in their bodies' axes, so that a wrench constant in the world has −δθ × F.

use crate::force::Situation;
use phipsi_model::JointKind;
use phipsi_recursion::{Jacobian, Layout};
use phipsi_spatial::Vec3;

/// Where forces add their derivatives: rows are generalised forces.
pub struct LoadRates<'a> {
    /// Along increments of q, nv×nv.
    pub d_dq: &'a mut [f64],
    /// By v, nv×nv.
    pub d_dv: &'a mut [f64],
    /// By the auxiliary quantities, nv×na.
    pub d_daux: &'a mut [f64],
    /// Number of degrees of freedom.
    pub nv: usize,
    /// Number of auxiliary quantities of all forces.
    pub auxiliary: usize,
    /// First auxiliary quantity of this force.
    pub slot: usize,
    /// Its auxiliary quantities.
    pub own: &'a [f64],
    /// Scratch.
    pub points: &'a mut [PointRates; 2],
}

/// A point of a body, its Jacobian, and the derivative of its velocity.
#[derive(Clone, Debug)]
pub struct PointRates {
    workspace: Jacobian<f64>,
    /// J_p by rows.
    pub jacobian: Vec<f64>,
    /// ∂v_p/∂ξ by rows, 3×nv.
    pub velocity_rate: Vec<f64>,
    nv: usize,
}

impl PointRates {
    /// Scratch for a layout.
    pub fn new(layout: &Layout<f64>) -> Self {
        let nv = layout.nv();
        let zero = |n: usize| vec![0.0; n];
        PointRates {
            workspace: Jacobian::new(layout),
            jacobian: zero(6 * nv),
            velocity_rate: zero(3 * nv),
            nv,
        }
    }
    /// σ of a column.
    pub fn angular(&self, j: usize) -> Vec3<f64> {
        Vec3([0, 1, 2].map(|r| self.jacobian[r * self.nv + j]))
    }
    /// s of a column.
    pub fn linear(&self, j: usize) -> Vec3<f64> {
        Vec3([3, 4, 5].map(|r| self.jacobian[r * self.nv + j]))
    }
    /// ∂v_p/∂ξ_j.
    pub fn rate(&self, j: usize) -> Vec3<f64> {
        Vec3([0, 1, 2].map(|r| self.velocity_rate[r * self.nv + j]))
    }
    /// For a point of a body; false where poses are missing.
    pub fn set(&mut self, at: &Situation<'_>, body: Option<usize>, point: Vec3<f64>) -> bool {
        let Some(kinematics) = at.kinematics else { return false };
        if self.workspace.run(at.layout, at.q, body, Some(point), &mut self.jacobian).is_err() {
            return false;
        }
        self.velocity_rate.fill(0.0);
        let place = at.pose(body).point(point);
        let own = kinematics.velocity(at.layout, body);
        let speed = own.linear + own.angular.cross(place - at.pose(body).translation);
        let mut k = body;
        while let Some(joint) = k {
            let before = at.model.tree().parent(joint);
            let base = kinematics.velocity(at.layout, before);
            let mut omega = base.angular;
            let mut relative = speed - base.linear - omega.cross(place - at.pose(before).translation);
            let universal = matches!(at.model.joints()[joint].kind, JointKind::Universal { .. });
            for j in at.model.v_range(joint) {
                let (sigma, s) = (self.angular(j), self.linear(j));
                let rate = sigma.cross(relative) + omega.cross(s);
                for r in 0..3 {
                    self.velocity_rate[r * self.nv + j] = rate.0[r];
                }
                // Its two hinges are joints of their own: the second one's axis does not turn the first.
                if universal {
                    omega += sigma.scale(at.v[j]);
                    relative -= s.scale(at.v[j]);
                }
            }
            k = before;
        }
        true
    }
}
