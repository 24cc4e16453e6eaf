//! The linearised dynamics as operator expressions on (δq, δv).
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | I₁, I₂ | put a joint vector into the upper and the lower half of (δq, δv) | |
//! | h, h~ | H* v, each joint's own velocity, and its cross product on motions | paper 2 (3.7) |
//! | ad | (H H*)⁻¹ H h~ H*: h~ maps the span of a joint's axes into itself where its increments are a group's | |
//! | A | I₁ (−ad) I₁* + I₁ I₂* + I₂ ∂θ̈/∂q I₁* + I₂ ∂θ̈/∂v I₂* | paper 2 §4.5 |
//! | B | I₂ 𝓜⁻¹ | |
//!
//! The two angles of a universal joint are added, not composed: its ad is zero.

use super::{Operators, cross_motion};
use crate::error::DynamicsError;
use nalgebra::DMatrix;
use phipsi_spatial::{Motion, Real};
use phipsi_topology::{Operator, OperatorError, Space};

/// A and B with δẋ = A δx + B δτ, x = (δq, δv), as expressions that are never a matrix.
#[derive(Clone, Debug)]
pub struct LinearizedDynamics<T> {
    /// 2nv × 2nv.
    pub A: Operator<T>,
    /// 2nv × nv.
    pub B: Operator<T>,
}

impl<T: Real> Operators<T> {
    /// The dynamics linearised about (q, v) under the joint forces `tau`: [`crate::linearize()`] gives the same as matrices.
    /// `v`, `tau`: nv. δq in the increments of `Model::integrate`. Cost O(n) to make and O(n) an application.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    ///
    /// # Example
    /// ```
    /// # use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
    /// # let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
    /// # let model = ModelBuilder::new("pendulum").body(Body::new("rod", rod))
    /// #     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
    /// #     .gravity([0.0, 0.0, -9.81]).build()?;
    /// let ops = phipsi_recursion::Operators::new(&model, &[std::f64::consts::FRAC_PI_2])?;
    /// let linear = ops.linearize(&[0.0], &[0.0])?;
    /// let rate = linear.A.apply(&[1.0, 0.0])?; // δθ = 1: δθ̈ = −(3/2) g/l
    /// assert!(rate[0] == 0.0 && (rate[1] + 1.5 * 9.81).abs() < 1e-13);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn linearize(&self, v: &[T], tau: &[T]) -> Result<LinearizedDynamics<T>, DynamicsError> {
        let by = self.forward_dynamics_derivatives(v, tau)?;
        let made = || -> Result<_, OperatorError> {
            let (joint, n) = (self.joint_space(), self.bodies.len());
            let twice = Space::new((0..2 * n).map(|k| joint.size(k % n.max(1))));
            let one = |k: usize| DMatrix::identity(joint.size(k), joint.size(k));
            let half = |name, nodes: std::ops::Range<usize>| {
                Operator::pick_off(name, &twice, nodes.collect(), (0..n).map(one).collect())
            };
            let (I_1, I_2) = (half("I₁", 0..n)?, half("I₂", n..2 * n)?);
            let axes = self.H.adjoint();
            let h = axes.apply(v)?;
            let own = |k: usize| match self.turning[k] {
                true => Motion::zero(),
                false => Motion::from_array(std::array::from_fn(|i| h[6 * k + i])),
            };
            let state = self.state_space();
            let h_cross = self.diagonal("h~", state, state, |k| cross_motion(own(k)));
            let gram = (&self.H * &axes).inverse()?;
            let ad = &gram * &(&(&self.H * &h_cross) * &axes);
            let lower = &(&I_2 * &by.d_dq) * &I_1.adjoint();
            let upper = &I_1 * &(&I_2.adjoint() - &(&ad * &I_1.adjoint()));
            let A = &(&upper + &lower) + &(&(&I_2 * &by.d_dv) * &I_2.adjoint());
            Ok(LinearizedDynamics { A, B: &I_2 * &by.d_last })
        };
        Ok(made().unwrap_or_else(|error| unreachable!("axes of a joint are independent: {error}")))
    }
}
