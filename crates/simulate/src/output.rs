//! Outputs of a scene: numbers that are computed from a state, by name.

use phipsi_model::Model;
use phipsi_motion::{Balance, Energies};
use phipsi_recursion::{Kinematics, Layout};
use phipsi_spatial::Vec3;

/// A point of a body (`None`: the world), m in the body's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyPoint {
    /// The body.
    pub body: Option<usize>,
    /// The point.
    pub point: Vec3<f64>,
}

/// Which energy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EnergyKind {
    /// Kinetic energy.
    Kinetic,
    /// Potential energy of gravity and conservative forces.
    Potential,
    /// Their sum.
    Total,
}

/// What an output measures.
#[derive(Clone, Debug, PartialEq)]
pub enum Quantity {
    /// Σ factor · q(index).
    Coordinates(Vec<(usize, f64)>),
    /// Σ factor · v(index).
    Velocities(Vec<(usize, f64)>),
    /// Coordinate (0: x, 1: y, 2: z) of a point, world axes, m.
    Position(BodyPoint, usize),
    /// Component of a point's velocity, world axes, m/s.
    Velocity(BodyPoint, usize),
    /// Distance of two points, m.
    Distance(BodyPoint, BodyPoint),
    /// An energy, J.
    Energy(EnergyKind),
}

/// A named number.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// The user's name.
    pub name: String,
    /// What it measures.
    pub quantity: Quantity,
}

/// A state with what has been computed at it.
pub struct Measured<'a> {
    /// The model.
    pub model: &'a Model,
    /// Its layout.
    pub layout: &'a Layout<f64>,
    /// Poses and velocities at the state.
    pub kinematics: &'a Kinematics<f64>,
    /// Position coordinates.
    pub q: &'a [f64],
    /// Velocities.
    pub v: &'a [f64],
    /// Energies and momenta at the state.
    pub balance: &'a Balance,
}

impl Quantity {
    /// Its value where it follows from the motion alone; `None` for energies, and for points without poses.
    pub fn of_motion(
        &self,
        layout: &Layout<f64>,
        kinematics: Option<&Kinematics<f64>>,
        q: &[f64],
        v: &[f64],
    ) -> Option<f64> {
        let sum = |terms: &[(usize, f64)], of: &[f64]| terms.iter().map(|&(i, factor)| factor * of[i]).sum();
        Some(match self {
            Quantity::Coordinates(terms) => sum(terms, q),
            Quantity::Velocities(terms) => sum(terms, v),
            Quantity::Position(p, axis) => kinematics?.pose(layout, p.body).point(p.point).0[*axis],
            Quantity::Velocity(p, axis) => {
                let own = kinematics?.velocity_in_body(layout, p.body);
                let rotation = kinematics?.pose(layout, p.body).rotation;
                (rotation * (own.linear + own.angular.cross(p.point))).0[*axis]
            }
            Quantity::Distance(a, b) => {
                let kinematics = kinematics?;
                let place = |p: &BodyPoint| kinematics.pose(layout, p.body).point(p.point);
                (place(a) - place(b)).norm()
            }
            Quantity::Energy(_) => return None,
        })
    }
}

impl EnergyKind {
    /// Its value where these are the energies.
    pub fn of(self, Energies { kinetic, potential }: Energies) -> f64 {
        match self {
            EnergyKind::Kinetic => kinetic,
            EnergyKind::Potential => potential,
            EnergyKind::Total => kinetic + potential,
        }
    }
}

impl Output {
    /// Its value at a state.
    pub fn value(&self, at: &Measured<'_>) -> f64 {
        let &Balance { kinetic, potential, .. } = at.balance;
        match &self.quantity {
            Quantity::Energy(kind) => kind.of(Energies { kinetic, potential }),
            other => other.of_motion(at.layout, Some(at.kinematics), at.q, at.v).unwrap_or(f64::NAN),
        }
    }
}

/// A known value of an output at the end of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownValue {
    /// The output's name.
    pub output: String,
    /// Its value.
    pub value: f64,
}

/// Largest |found − known| / |known| (absolute where the known value is 0); `None` without known values.
pub fn reference_error(known: &[KnownValue], found: impl Fn(&str) -> Option<f64>) -> Option<f64> {
    let errors = known.iter().filter_map(|k| {
        let error = (found(&k.output)? - k.value).abs();
        Some(if k.value == 0.0 { error } else { error / k.value.abs() })
    });
    // A NaN stays: it must not look like a small error.
    errors.reduce(|a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) })
}
