//! Energy and momentum balances along a run (DESIGN: `energy_error`, `momentum_error`).

use crate::dynamics::Dynamics;
use crate::system::System;
use phipsi_recursion::layout::GROUND;
use phipsi_recursion::{About, DynamicsError, Kinematics, kinetic_energy, momentum, potential_energy};
use phipsi_spatial::{Vec3, Wrench};

/// Energies and momenta at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Balance {
    /// Kinetic energy, J.
    pub kinetic: f64,
    /// Potential energy of gravity and conservative forces, J.
    pub potential: f64,
    /// Work of all other forces since the start, J.
    pub work: f64,
    /// Angular momentum about the centre of mass, and linear; world axes.
    pub momentum: Wrench<f64>,
    /// Impulse of external forces since the start, likewise.
    pub impulse: Wrench<f64>,
    /// Σ |kinetic and potential energy of each body or force|, J.
    pub energy_scale: f64,
    /// Σ over bodies of |angular momentum about the system's centre of mass|, and of |m v|.
    pub momentum_scale: [f64; 2],
}

/// Measures of a state. Cost O(n).
///
/// # Errors
/// [`DynamicsError::Shape`].
pub fn balance(
    dynamics: &mut Dynamics,
    kinematics: &mut Kinematics<f64>,
    (t, q, v): (f64, &[f64], &[f64]),
    auxiliary: &[f64],
) -> Result<Balance, DynamicsError> {
    let potentials = dynamics.potentials(t, q, v)?;
    let (layout, gravity) = (dynamics.layout(), Vec3(dynamics.model().gravity()));
    kinematics.set_position(layout, q)?;
    kinematics.set_velocity(layout, v)?;
    let (mut kinetic, mut weight, mut energy_scale) = (0.0, 0.0, 0.0);
    let (mut mass, mut moment) = (0.0, Vec3::zero());
    for (k, carrier) in layout.carriers().iter().enumerate().filter(|(_, c)| c.body != GROUND) {
        let velocity = kinematics.velocity_in_body(layout, Some(k));
        let own = 0.5 * velocity.dot(carrier.inertia.momentum(velocity));
        let pose = kinematics.pose(layout, Some(k));
        let first =
            pose.rotation * carrier.inertia.first_moment + pose.translation.scale(carrier.inertia.mass);
        let height = -gravity.dot(first);
        kinetic += own;
        weight += height;
        energy_scale += own.abs() + height.abs();
        mass += carrier.inertia.mass;
        moment += first;
    }
    if layout.is_flexible() {
        // Bodies as they are undeformed tell the sizes; energies are the whole system's.
        let strain_and_weight = potential_energy(layout, q)?;
        (kinetic, weight) = (kinetic_energy(layout, q, v)?, strain_and_weight);
        energy_scale += kinetic + strain_and_weight.abs();
    }
    energy_scale += potentials.iter().map(|x| x.abs()).sum::<f64>();
    let mut momentum_scale = [0.0; 2];
    if dynamics.plan().momentum {
        let center = moment.scale(1.0 / mass);
        for (k, carrier) in layout.carriers().iter().enumerate().filter(|(_, c)| c.body != GROUND) {
            let own = carrier.inertia.momentum(kinematics.velocity_in_body(layout, Some(k)));
            let pose = kinematics.pose(layout, Some(k));
            let force = pose.rotation * own.force;
            let angular = pose.rotation * own.moment + (pose.translation - center).cross(force);
            momentum_scale[0] += angular.norm();
            momentum_scale[1] += force.norm();
        }
    }
    let total =
        if dynamics.plan().momentum { momentum(layout, q, v, About::CenterOfMass)? } else { Wrench::zero() };
    Ok(Balance {
        kinetic,
        potential: weight + potentials.iter().sum::<f64>(),
        work: dynamics.work(auxiliary),
        momentum: total,
        impulse: dynamics.impulse(auxiliary),
        energy_scale,
        momentum_scale,
    })
}

/// Largest imbalances of a run, absolute, with the scales that make them relative.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Conserved {
    start: Option<(f64, [f64; 6])>,
    /// Largest |E − E₀ − W|, J.
    pub energy: f64,
    /// Largest energy scale, J.
    pub energy_scale: f64,
    /// Largest |change − impulse| of angular and linear momentum.
    pub momentum: [f64; 2],
    /// Largest momentum scales.
    pub momentum_scale: [f64; 2],
}

impl Conserved {
    /// Takes a further instant into account; the first one is the start. Returns the imbalances now: energy, angular, linear.
    pub fn record(&mut self, b: &Balance) -> [f64; 3] {
        let momentum = (b.momentum - b.impulse).to_array();
        let energy = b.kinetic + b.potential - b.work;
        let (energy0, momentum0) = *self.start.get_or_insert((energy, momentum));
        let part = |first: usize| {
            let d = Vec3(std::array::from_fn(|i| momentum[first + i] - momentum0[first + i]));
            d.norm()
        };
        let now = [(energy - energy0).abs(), part(0), part(3)];
        self.energy = self.energy.max(now[0]);
        self.energy_scale = self.energy_scale.max(b.energy_scale);
        for i in 0..2 {
            self.momentum[i] = self.momentum[i].max(now[1 + i]);
            self.momentum_scale[i] = self.momentum_scale[i].max(b.momentum_scale[i]);
        }
        now
    }
    /// `energy_error`: relative imbalance; 0 where nothing moved.
    pub fn energy_error(&self) -> f64 {
        ratio(self.energy, self.energy_scale)
    }
    /// `momentum_error`: relative imbalances, angular and linear.
    pub fn momentum_error(&self) -> [f64; 2] {
        [0, 1].map(|i| ratio(self.momentum[i], self.momentum_scale[i]))
    }
}

fn ratio(error: f64, scale: f64) -> f64 {
    if error == 0.0 { 0.0 } else { error / scale }
}
