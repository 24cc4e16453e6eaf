//! Energies and centre of mass as sums over the bodies that can move.

use crate::bodies::{moves, world_inertias};
use crate::kinematics::kinematics;
use phipsi_model::Model;
use phipsi_spatial::{Real, Vec3};

/// ½ Σ m |v_c|² + ω·I ω.
pub fn kinetic_energy<T: Real>(model: &Model, q: &[T], v: &[T]) -> T {
    let motions = kinematics(model, q, v, &vec![T::zero(); model.nv()]);
    let mut energy = T::zero();
    for (motion, inertia) in motions.iter().zip(world_inertias(model, &motions)) {
        let (velocity, w) = (motion.velocity_at(inertia.center), motion.velocity.angular);
        energy += (velocity.dot(velocity) * inertia.mass + w.dot(inertia.tensor * w)) * T::splat(0.5);
    }
    energy
}

/// Mass and Σ m c of the bodies that can move.
fn first_moment<T: Real>(model: &Model, q: &[T]) -> (T, Vec3<T>) {
    let zero = vec![T::zero(); model.nv()];
    let inertias = world_inertias(model, &kinematics(model, q, &zero, &zero));
    let moving = inertias.iter().zip(moves(model)).filter(|(_, moves)| *moves);
    moving.fold((T::zero(), Vec3::zero()), |(mass, moment), (inertia, _)| {
        (mass + inertia.mass, moment + inertia.center.scale(inertia.mass))
    })
}

/// Centre of mass of the bodies that can move, world axes.
pub fn center_of_mass<T: Real>(model: &Model, q: &[T]) -> Vec3<T> {
    let (mass, moment) = first_moment(model, q);
    Vec3(moment.0.map(|x| x / mass))
}

/// −Σ m g·c over the bodies that can move.
pub fn potential_energy<T: Real>(model: &Model, q: &[T]) -> T {
    -Vec3::splat(model.gravity()).dot(first_moment(model, q).1)
}
