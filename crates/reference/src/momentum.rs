//! Momentum as a sum over the bodies.

use crate::bodies::world_inertias;
use crate::energy::center_of_mass;
use crate::jacobian::{axes, supports};
use crate::kinematics::kinematics;
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::{Real, Vec3, Wrench};

/// Angular momentum about a world point (`None`: the centre of mass of the bodies that can move), then linear; world axes.
pub fn momentum<T: Real>(model: &Model, q: &[T], v: &[T], about: Option<Vec3<T>>) -> Wrench<T> {
    let about = about.unwrap_or_else(|| center_of_mass(model, q));
    let motions = kinematics(model, q, v, &vec![T::zero(); model.nv()]);
    let mut total = Wrench::zero();
    for (motion, inertia) in motions.iter().zip(world_inertias(model, &motions)) {
        let p = motion.velocity_at(inertia.center).scale(inertia.mass);
        total += Wrench::new((inertia.center - about).cross(p) + inertia.tensor * motion.velocity.angular, p);
    }
    total
}

/// The matrix of [`momentum`] about the centre of mass: its value for every unit velocity. 6×nv.
pub fn centroidal_momentum_matrix<T: Real>(model: &Model, q: &[T]) -> DMatrix<T> {
    let zero = vec![T::zero(); model.nv()];
    let motions = kinematics(model, q, &zero, &zero);
    let (axes, about) = (axes(model, &motions), center_of_mass(model, q));
    let mut matrix = DMatrix::from_element(6, model.nv(), T::zero());
    for (inertia, support) in world_inertias(model, &motions).iter().zip(supports(model)) {
        for i in support {
            let p = axes[i].velocity_at(inertia.center).scale(inertia.mass);
            let moment = (inertia.center - about).cross(p) + inertia.tensor * axes[i].angular;
            let column = Wrench::new(moment, p).to_array();
            (0..6).for_each(|row| matrix[(row, i)] += column[row]);
        }
    }
    matrix
}
