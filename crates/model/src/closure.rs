//! Closures: what joins two bodies besides the joints of the tree.

use crate::Placement;
use crate::builder::{LARGEST, is_sane};
use crate::violation::{Subject, Violation};
use std::collections::HashMap;

/// What a closure keeps between two frames, A and B: the complement of a joint's freedoms. Axes are those of the frames.
///
/// | kind | what stays free | rows, in the axes of A, angular ones first |
/// |---|---|---|
/// | weld | nothing | rotation x y z; offset x y z |
/// | revolute | rotation about the common z axis | rotation x y; offset x y z |
/// | spherical | rotation about the common origin | offset x y z |
/// | universal | rotations about x of A and y of B, which stay at right angles | cosine of the angle between them; offset x y z |
/// | cylindrical | rotation about and translation along the common z axis | rotation x y; offset x y |
/// | prismatic | translation along the common z axis | rotation x y z; offset x y |
/// | planar | motion in the common x-y plane | rotation x y; offset z |
/// | distance | all but the distance of the origins | distance |
/// | point on plane | all but leaving the x-y plane of A by the origin of B | offset z |
///
/// *Rotation* is the rotation vector that takes the axes of A to those of B; where only x and y are listed, the part of it
/// that turns one z axis onto the other. *Offset* is the origin of B from that of A.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum ClosureKind {
    /// The two frames coincide.
    Weld,
    /// A hinge about the z axes.
    Revolute,
    /// The two origins coincide.
    Spherical,
    /// A universal joint: x axis of A and y axis of B cross at right angles.
    Universal,
    /// The z axes are one line.
    Cylindrical,
    /// A slider along the z axes.
    Prismatic,
    /// The x-y planes coincide.
    Planar,
    /// The origins keep a distance, as the ends of a massless rod.
    Distance {
        /// The distance, m; greater than zero.
        length: f64,
    },
    /// The origin of B stays in the x-y plane of A.
    PointOnPlane,
}

impl ClosureKind {
    /// Number of rows: what it takes from the freedoms of the two bodies against each other.
    pub fn rows(&self) -> usize {
        match self {
            ClosureKind::Weld => 6,
            ClosureKind::Revolute | ClosureKind::Prismatic => 5,
            ClosureKind::Universal | ClosureKind::Cylindrical => 4,
            ClosureKind::Spherical | ClosureKind::Planar => 3,
            ClosureKind::Distance { .. } | ClosureKind::PointOnPlane => 1,
        }
    }
    /// Number of its first rows that are angles.
    pub fn angular_rows(&self) -> usize {
        match self {
            ClosureKind::Weld | ClosureKind::Prismatic => 3,
            ClosureKind::Revolute | ClosureKind::Cylindrical | ClosureKind::Planar => 2,
            ClosureKind::Universal => 1,
            ClosureKind::Spherical | ClosureKind::Distance { .. } | ClosureKind::PointOnPlane => 0,
        }
    }
    /// What the i-th row keeps, in words.
    pub fn direction(&self, i: usize) -> &'static str {
        const ROTATIONS: [&str; 3] = ["rotation about x", "rotation about y", "rotation about z"];
        const OFFSETS: [&str; 3] = ["translation along x", "translation along y", "translation along z"];
        let angular = self.angular_rows();
        match self {
            ClosureKind::Distance { .. } => "distance",
            ClosureKind::Planar | ClosureKind::PointOnPlane if i >= angular => OFFSETS[2],
            ClosureKind::Universal if i == 0 => "angle between the axes",
            _ if i < angular => ROTATIONS[i],
            _ => OFFSETS[(i - angular).min(2)],
        }
    }
    /// The word for it in scene files, in Python and in reports.
    pub fn word(&self) -> &'static str {
        match self {
            ClosureKind::Weld => "weld",
            ClosureKind::Revolute => "revolute",
            ClosureKind::Spherical => "spherical",
            ClosureKind::Universal => "universal",
            ClosureKind::Cylindrical => "cylindrical",
            ClosureKind::Prismatic => "prismatic",
            ClosureKind::Planar => "planar",
            ClosureKind::Distance { .. } => "distance",
            ClosureKind::PointOnPlane => "point_on_plane",
        }
    }
    /// The words there are, in the order of the kinds.
    pub const WORDS: [&'static str; 9] = [
        "weld",
        "revolute",
        "spherical",
        "universal",
        "cylindrical",
        "prismatic",
        "planar",
        "distance",
        "point_on_plane",
    ];
    /// The kind of that word; `length` is the distance of `distance` and unused by others.
    pub fn from_word(word: &str, length: f64) -> Option<Self> {
        Some(match word {
            "weld" => ClosureKind::Weld,
            "revolute" => ClosureKind::Revolute,
            "spherical" => ClosureKind::Spherical,
            "universal" => ClosureKind::Universal,
            "cylindrical" => ClosureKind::Cylindrical,
            "prismatic" => ClosureKind::Prismatic,
            "planar" => ClosureKind::Planar,
            "distance" => ClosureKind::Distance { length },
            "point_on_plane" => ClosureKind::PointOnPlane,
            _ => return None,
        })
    }
}

/// A closure between a frame A on one body and a frame B on another.
#[derive(Clone, Debug, PartialEq)]
pub struct Closure {
    /// The user's name.
    pub name: String,
    /// What it keeps.
    pub kind: ClosureKind,
    /// The body of frame A, or `world`.
    pub body_a: String,
    /// Frame A in that body's frame.
    pub pose_a: Placement,
    /// The body of frame B, or `world`.
    pub body_b: String,
    /// Frame B in that body's frame.
    pub pose_b: Placement,
}

impl Closure {
    /// Everything wrong with the numbers of a closure and with the bodies it names, `world` among them.
    pub(crate) fn check<V>(&self, bodies: &HashMap<&str, V>, found: &mut Vec<Violation>) {
        let mut error = |what: String, required: &str, remedy: &str| {
            found.push(Violation::error(Subject::Closure(self.name.clone()), what, required, remedy));
        };
        for name in [&self.body_a, &self.body_b] {
            if !bodies.contains_key(name.as_str()) && name != "world" {
                let what = format!("body `{name}` does not exist");
                error(what, "the name of a body or `world`", "correct the name");
            }
        }
        if self.body_a == self.body_b {
            let what = format!("both frames are on `{}`", self.body_a);
            error(what, "two different bodies", "name another body");
        }
        for (what, pose) in [("pose_a", self.pose_a), ("pose_b", self.pose_b)] {
            let mut numbers = pose.translation.iter().chain(&pose.rotation);
            if !numbers.all(|x| is_sane(*x)) {
                let required = format!("finite numbers of magnitude at most {LARGEST:e}");
                error(format!("{what} {pose:?}"), &required, "correct the number");
            }
            if pose.rotation == [0.0; 4] {
                error(format!("the quaternion of {what} is zero"), "a rotation", "use (0, 0, 0, 1)");
            }
        }
        if let ClosureKind::Distance { length } = self.kind
            && !(is_sane(length) && length > 0.0)
        {
            let remedy = "give the length of the rod, or use a spherical closure";
            error(format!("distance {length:?}"), "a number greater than zero", remedy);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Body, Inertia, Joint, JointKind, ModelBuilder};

    fn closure(body_a: &str, body_b: &str, kind: ClosureKind) -> Closure {
        let (pose_a, pose_b) = (Placement::IDENTITY, Placement::IDENTITY);
        Closure { name: "c".into(), kind, body_a: body_a.into(), pose_a, body_b: body_b.into(), pose_b }
    }

    fn pendulum() -> ModelBuilder {
        let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 0.1, 0.1]);
        let hinge = Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] });
        ModelBuilder::new("pendulum").body(Body::new("rod", rod)).joint(hinge, "world", "rod")
    }

    #[test]
    fn words_and_kinds_are_the_same() {
        for word in ClosureKind::WORDS {
            let kind = ClosureKind::from_word(word, 1.0).unwrap();
            assert_eq!(kind.word(), word);
            assert!(kind.angular_rows() <= kind.rows());
            let mut directions: Vec<_> = (0..kind.rows()).map(|i| kind.direction(i)).collect();
            directions.dedup();
            assert_eq!(directions.len(), kind.rows());
        }
        assert_eq!(ClosureKind::from_word("glue", 1.0), None);
    }

    #[test]
    fn wrong_closures_are_refused() {
        let bad = ClosureKind::Distance { length: 0.0 };
        for (closure, what) in [
            (closure("rod", "stick", ClosureKind::Weld), "`stick` does not exist"),
            (closure("rod", "rod", ClosureKind::Weld), "both frames are on `rod`"),
            (closure("rod", "world", bad), "distance 0.0"),
        ] {
            let errors = pendulum().closure(closure).build().unwrap_err();
            assert_eq!(errors.0.len(), 1, "{errors}");
            assert!(errors.0[0].found.contains(what), "{errors}");
        }
        let twice = closure("world", "rod", ClosureKind::Spherical);
        let errors = pendulum().closure(twice.clone()).closure(twice.clone()).build().unwrap_err();
        assert!(errors.0[0].found.contains("name given twice"), "{errors}");
        let model = pendulum().build().unwrap().with_closure(twice.clone()).unwrap();
        assert_eq!(model.closures(), std::slice::from_ref(&twice));
        assert!(model.clone().with_closure(twice).is_err());
        assert!(model.without_closures().closures().is_empty());
    }
}
