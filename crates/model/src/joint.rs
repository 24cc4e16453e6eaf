//! Joint types, their placements and limits.

use phipsi_spatial::{Mat3, Quaternion, Real, Transform, Vec3};

/// A pose given by the user: translation in metres and a quaternion (x, y, z, w), child to parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Origin of the child frame, m.
    pub translation: [f64; 3],
    /// Orientation (x, y, z, w); any length but zero.
    pub rotation: [f64; 4],
}

impl Placement {
    /// No displacement.
    pub const IDENTITY: Placement = Placement { translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] };

    /// From URDF's `xyz` (m) and `rpy` (rad, about fixed x, y, z).
    pub fn from_xyz_rpy(xyz: [f64; 3], rpy: [f64; 3]) -> Self {
        Placement { translation: xyz, rotation: Quaternion::from_roll_pitch_yaw(rpy[0], rpy[1], rpy[2]).0 }
    }
    /// The same pose in a scalar of any width; the rotation is orthonormal to that scalar's rounding.
    pub fn to_transform<T: Real>(&self) -> Transform<T> {
        let rotation = Quaternion(self.rotation.map(T::splat)).to_rotation();
        Transform::new(rotation, Vec3::splat(self.translation))
    }
}

/// The type of a joint with its axes in the joint frame, which is the child frame at q = 0.
///
/// | joint | q | v (body axes, angular first) |
/// |---|---|---|
/// | revolute, continuous, prismatic, helical | angle or displacement (a continuous angle is not wrapped) | its rate |
/// | cylindrical | angle, displacement | rates |
/// | universal | two angles | rates |
/// | planar | x, y, angle in the plane's axes | ω_z, v_x, v_y in child axes |
/// | translation | x, y, z | rates |
/// | spherical | quaternion x y z w | ω |
/// | free | position, quaternion | ω, v of the origin |
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum JointKind {
    /// No motion.
    Fixed,
    /// Rotation about an axis, with limits.
    Revolute {
        /// Axis; any length but zero.
        axis: [f64; 3],
    },
    /// Rotation about an axis without limits.
    Continuous {
        /// Axis; any length but zero.
        axis: [f64; 3],
    },
    /// Translation along an axis.
    Prismatic {
        /// Axis; any length but zero.
        axis: [f64; 3],
    },
    /// Rotation about and translation along an axis, coupled.
    Helical {
        /// Axis; any length but zero.
        axis: [f64; 3],
        /// Displacement per angle, m/rad.
        pitch: f64,
    },
    /// Independent rotation about and translation along an axis.
    Cylindrical {
        /// Axis; any length but zero.
        axis: [f64; 3],
    },
    /// Two hinges in series: about `axes[0]`, then about `axes[1]` of the turned frame.
    Universal {
        /// The two axes; any lengths but zero, not parallel.
        axes: [[f64; 3]; 2],
    },
    /// Motion in a plane: see [`JointKind::plane_axes`] for the plane's own axes.
    Planar {
        /// Normal of the plane; any length but zero.
        normal: [f64; 3],
    },
    /// Translation in three directions.
    Translation,
    /// Rotation about a point.
    Spherical,
    /// All six degrees of freedom.
    Free,
}

impl JointKind {
    /// Number of position coordinates.
    pub fn nq(&self) -> usize {
        match self {
            JointKind::Spherical => 4,
            JointKind::Free => 7,
            _ => self.nv(),
        }
    }
    /// Number of degrees of freedom.
    pub fn nv(&self) -> usize {
        match self {
            JointKind::Fixed => 0,
            JointKind::Revolute { .. }
            | JointKind::Continuous { .. }
            | JointKind::Prismatic { .. }
            | JointKind::Helical { .. } => 1,
            JointKind::Cylindrical { .. } | JointKind::Universal { .. } => 2,
            JointKind::Planar { .. } | JointKind::Translation | JointKind::Spherical => 3,
            JointKind::Free => 6,
        }
    }
    /// The word for it in scene files and reports; URDF's word where URDF has the joint.
    pub fn word(&self) -> &'static str {
        match self {
            JointKind::Fixed => "fixed",
            JointKind::Revolute { .. } => "revolute",
            JointKind::Continuous { .. } => "continuous",
            JointKind::Prismatic { .. } => "prismatic",
            JointKind::Helical { .. } => "helical",
            JointKind::Cylindrical { .. } => "cylindrical",
            JointKind::Universal { .. } => "universal",
            JointKind::Planar { .. } => "planar",
            JointKind::Translation => "translation",
            JointKind::Spherical => "spherical",
            JointKind::Free => "floating",
        }
    }
    /// The axes that the user gave.
    pub fn axes(&self) -> Vec<[f64; 3]> {
        match *self {
            JointKind::Revolute { axis }
            | JointKind::Continuous { axis }
            | JointKind::Prismatic { axis }
            | JointKind::Helical { axis, .. }
            | JointKind::Cylindrical { axis } => vec![axis],
            JointKind::Planar { normal } => vec![normal],
            JointKind::Universal { axes } => axes.to_vec(),
            _ => vec![],
        }
    }
    /// Unit of the i-th velocity component is an angle's rate (true) or a length's (false).
    pub fn is_rotation(&self, i: usize) -> bool {
        match self {
            JointKind::Prismatic { .. } | JointKind::Translation => false,
            JointKind::Cylindrical { .. } | JointKind::Planar { .. } => i == 0,
            JointKind::Free => i < 3,
            _ => true,
        }
    }
    /// Axes of the plane of a planar joint with this normal, as columns: the shortest rotation that takes z to the normal
    /// (for −z: half a turn about x). With the normal along z they are the joint frame's own axes.
    pub fn plane_axes<T: Real>(normal: Vec3<T>) -> Mat3<T> {
        rotation_from_z(normal)
    }
}

/// The shortest rotation that takes the z axis to the direction of a; half a turn about x for −z.
pub fn rotation_from_z<T: Real>(a: Vec3<T>) -> Mat3<T> {
    let a = a.scale(a.norm().recip());
    let [x, y, z] = a.0;
    let (zero, one) = (T::zero(), T::one());
    let square = x * x + y * y;
    if square == zero && z < zero {
        return Mat3([[one, zero, zero], [zero, -one, zero], [zero, zero, -one]]);
    }
    // 1/(1 + z), by (1 − z)/(x² + y²) where 1 + z cancels.
    let s = if z < zero { (one - z) / square } else { (one + z).recip() };
    Mat3([[one - x * x * s, -(x * y * s), x], [-(x * y * s), one - y * y * s, y], [-x, -y, z]])
}

/// Limits as the user gave them; `None` where there is none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// Lower and upper position, rad or m.
    pub position: Option<[f64; 2]>,
    /// Largest speed, rad/s or m/s.
    pub velocity: Option<f64>,
    /// Largest effort, N·m or N.
    pub effort: Option<f64>,
}

/// A joint: how one body moves against its parent.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// The user's name.
    pub name: String,
    /// Type and axes.
    pub kind: JointKind,
    /// Pose of the joint frame in the parent body's frame.
    pub placement: Placement,
    /// Limits; they do not act on the dynamics.
    pub limits: Limits,
    /// Viscous damping, N·m·s/rad or N·s/m, for every degree of freedom of the joint.
    pub damping: f64,
    /// Dry friction, N·m or N, for every degree of freedom of the joint.
    pub friction: f64,
}

impl Joint {
    /// A joint at the parent's origin, without limits, damping or friction.
    pub fn new(name: impl Into<String>, kind: JointKind) -> Self {
        Joint {
            name: name.into(),
            kind,
            placement: Placement::IDENTITY,
            limits: Limits::default(),
            damping: 0.0,
            friction: 0.0,
        }
    }
    /// With the joint frame at a pose in the parent body's frame.
    pub fn at(mut self, placement: Placement) -> Self {
        self.placement = placement;
        self
    }
}
