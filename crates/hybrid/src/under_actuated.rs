//! The operators between active and passive degrees of freedom.

use crate::HybridError;
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_recursion::{DynamicsError, Operators};
use phipsi_spatial::{Real, Vec3};
use phipsi_topology::{Innovations, Operator, Space};

/// S_aa, S_ap, S_pp of a model at a configuration, and what they are made of.
#[derive(Clone, Debug)]
pub struct UnderActuated<T> {
    /// (I − H_pψK_p)* D_p⁻¹ (I − H_pψK_p), the inverse of the passive mass matrix.
    pub S_pp: Operator<T>,
    /// H_a [ψK_p + P ψ* H_p* D_p⁻¹ (I − H_pψK_p)]; −S_ap* is what the passive axes do as the active ones move.
    pub S_ap: Operator<T>,
    /// H_a (ψMψ* − P Ω_p P) H_a*: the inertia that the actuators feel.
    pub S_aa: Operator<T>,
    /// H_a.
    pub H_a: Operator<T>,
    /// H_p.
    pub H_p: Operator<T>,
    /// The Riccati equation about the passive axes.
    pub innovations: Innovations<T>,
    /// All operators of the model.
    pub operators: Operators<T>,
    active: Vec<bool>,
}

/// Takes the chosen components of every joint: rows of the identity.
fn selection<T: Real>(joint: &Space, chosen: &[bool]) -> Operator<T> {
    let picked = |k: usize| joint.range(k).filter(|&i| chosen[i]).collect::<Vec<usize>>();
    let rows = Space::new((0..joint.blocks()).map(|k| picked(k).len()));
    let block = |k: usize| {
        let (start, picked) = (joint.range(k).start, picked(k));
        DMatrix::from_fn(picked.len(), joint.size(k), |i, j| {
            if picked[i] == start + j { T::one() } else { T::zero() }
        })
    };
    let blocks = (0..joint.blocks()).map(block).collect();
    Operator::diagonal("I", &rows, joint, blocks)
        .unwrap_or_else(|error| unreachable!("rows are picked from these joints: {error}"))
}

impl<T: Real> UnderActuated<T> {
    /// The operators at a configuration. `q`: nq; `active`: nv. Cost O(n), also of every application. A model with closures
    /// gives those of its tree.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`]; [`DynamicsError::SingularHinge`] if a D is not positive definite.
    pub fn new(model: &Model, q: &[T], active: &[bool]) -> Result<Self, HybridError> {
        if active.len() != model.nv() {
            let (expected, found) = (model.nv(), active.len());
            return Err(DynamicsError::Shape { argument: "active", expected, found }.into());
        }
        let operators = Operators::new(model, q)?;
        let Operators { H, M, E_phi, .. } = &operators;
        let passive: Vec<bool> = active.iter().map(|a| !a).collect();
        let joint = operators.joint_space();
        let named = |name: &str, chosen: &[bool]| (&selection(joint, chosen) * H).named(name);
        let (H_a, H_p) = (named("H_a", active)?, named("H_p", &passive)?);
        let innovations = Innovations::new(&H_p, E_phi, M)?;
        let Innovations { psi, articulated: P, shifted_gain: K, inverse_pivots, .. } = &innovations;
        let L = innovations.inverse_factor();
        let S_pp = innovations.inverse();
        let outward = &(P * &psi.adjoint()) * &(&(&H_p.adjoint() * inverse_pivots) * &L);
        let S_ap = &H_a * &(&(psi * K) + &outward);
        let right = &H_p * psi;
        let omega = &(&right.adjoint() * inverse_pivots) * &right;
        let between = &(&(psi * M) * &psi.adjoint()) - &(&(P * &omega) * P);
        let S_aa = &(&H_a * &between) * &H_a.adjoint();
        Ok(UnderActuated { S_pp, S_ap, S_aa, H_a, H_p, innovations, operators, active: active.to_vec() })
    }
    /// Which degrees of freedom are active.
    pub fn active(&self) -> &[bool] {
        &self.active
    }
    /// The generalised Jacobian B* φ* (H_a* − H_p* S_ap*) of points fixed in bodies: their velocities, body axes, angular
    /// first, from the active rates alone, while the passive axes follow the dynamics (paper 2 §4.7; with a passive free
    /// base, the space Jacobian at zero momentum). Points: body of the model, and m in its frame.
    ///
    /// # Errors
    /// [`phipsi_topology::OperatorError::Node`] if there is no such body.
    pub fn generalized_jacobian(&self, points: &[(usize, Vec3<T>)]) -> Result<Operator<T>, HybridError> {
        let B = self.operators.pick_off(points)?;
        let axes = &self.H_a.adjoint() - &(&self.H_p.adjoint() * &self.S_ap.adjoint());
        Ok(&(&B.adjoint() * &self.operators.phi.adjoint()) * &axes)
    }
    /// The disturbance Jacobian B* φ* H_p* S_pp: what forces at the passive axes do to the points' accelerations while the
    /// active axes are held.
    ///
    /// # Errors
    /// As [`UnderActuated::generalized_jacobian`].
    pub fn disturbance_jacobian(&self, points: &[(usize, Vec3<T>)]) -> Result<Operator<T>, HybridError> {
        let B = self.operators.pick_off(points)?;
        let right = &self.H_p.adjoint() * &self.S_pp;
        Ok(&(&B.adjoint() * &self.operators.phi.adjoint()) * &right)
    }
}
