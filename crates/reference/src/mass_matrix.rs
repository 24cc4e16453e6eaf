//! The mass matrix Σ m Jᵀ J + Jᵀ I J over the bodies, J the Jacobian of each centre of mass.

use crate::bodies::world_inertias;
use crate::jacobian::{axes, supports};
use crate::kinematics::kinematics;
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::Real;

/// M(q), nv×nv.
pub fn mass_matrix<T: Real>(model: &Model, q: &[T]) -> DMatrix<T> {
    let zero = vec![T::zero(); model.nv()];
    let motions = kinematics(model, q, &zero, &zero);
    let axes = axes(model, &motions);
    let mut matrix = DMatrix::from_element(model.nv(), model.nv(), T::zero());
    for ((body, inertia), support) in world_inertias(model, &motions).iter().enumerate().zip(supports(model))
    {
        if model.bodies()[body].inertia.is_zero() {
            continue;
        }
        for &j in &support {
            let momentum = axes[j].velocity_at(inertia.center).scale(inertia.mass);
            let spin = inertia.tensor * axes[j].angular;
            for &i in &support {
                matrix[(i, j)] +=
                    axes[i].velocity_at(inertia.center).dot(momentum) + axes[i].angular.dot(spin);
            }
        }
    }
    matrix
}
