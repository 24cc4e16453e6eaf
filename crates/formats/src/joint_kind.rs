//! The joint types by their words, for every file format that has joints.

use crate::suggest::{nearest, quote};
use phipsi_model::JointKind;
use std::fmt;

/// URDF's joint types.
const URDF_TYPES: [&str; 6] = ["revolute", "continuous", "prismatic", "fixed", "floating", "planar"];

/// Joint types that URDF has no word for.
const MORE_TYPES: [&str; 5] = ["helical", "cylindrical", "universal", "spherical", "translation"];

/// Words of other programs for the same joints.
const SYNONYMS: [(&str, &str); 14] = [
    ("ball", "spherical"),
    ("ball_joint", "spherical"),
    ("free", "floating"),
    ("freejoint", "floating"),
    ("gearbox", "revolute"),
    ("hinge", "revolute"),
    ("rigid", "fixed"),
    ("rotational", "revolute"),
    ("screw", "helical"),
    ("slide", "prismatic"),
    ("slider", "prismatic"),
    ("revolute2", "universal"),
    ("translational", "prismatic"),
    ("weld", "fixed"),
];

/// Why words and numbers make no joint type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JointKindError {
    /// What was found.
    pub found: String,
    /// What is required.
    pub required: String,
    /// What to do.
    pub remedy: String,
}

impl fmt::Display for JointKindError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; required: {}; {}", self.found, self.required, self.remedy)
    }
}

impl std::error::Error for JointKindError {}

/// The joint type of a word, as URDF and scenes give it, with its axes in the joint frame.
///
/// | word | joint | axes |
/// |---|---|---|
/// | `revolute`, `continuous`, `prismatic`, `cylindrical` | the same | `axis` |
/// | `planar` | the same | `axis`, the normal of the plane |
/// | `helical` | the same | `axis`, with the required `pitch`, m/rad |
/// | `universal` | the same | `axis` and the required `axis2`, which turns with the first |
/// | `fixed`, `spherical`, `translation` | the same | |
/// | `floating` | [`JointKind::Free`] | |
///
/// A missing `axis` is (1, 0, 0), as URDF says. Numbers that the joint has no use for are not looked at: its
/// [`axes`](JointKind::axes) show which were used. Whether they are axes is left to
/// [`ModelBuilder::check`](phipsi_model::ModelBuilder::check).
///
/// # Errors
/// An unknown word, with the nearest known one; a helical joint without pitch; a universal joint without second axis.
///
/// # Example
/// ```
/// use phipsi_formats::joint_kind;
/// let screw = joint_kind("helical", Some([0.0, 0.0, 1.0]), None, Some(1e-3))?;
/// assert_eq!(screw.nv(), 1);
/// assert_eq!(joint_kind("hinge", None, None, None).unwrap_err().remedy, "did you mean `revolute`?");
/// # Ok::<(), phipsi_formats::JointKindError>(())
/// ```
pub fn joint_kind(
    word: &str,
    axis: Option<[f64; 3]>,
    axis2: Option<[f64; 3]>,
    pitch: Option<f64>,
) -> Result<JointKind, JointKindError> {
    let missing = |found: &str, required: &str, remedy: &str| JointKindError {
        found: found.into(),
        required: required.into(),
        remedy: remedy.into(),
    };
    let axis = axis.unwrap_or([1.0, 0.0, 0.0]);
    Ok(match word {
        "revolute" => JointKind::Revolute { axis },
        "continuous" => JointKind::Continuous { axis },
        "prismatic" => JointKind::Prismatic { axis },
        "fixed" => JointKind::Fixed,
        "floating" => JointKind::Free,
        "planar" => JointKind::Planar { normal: axis },
        "helical" => match pitch {
            Some(pitch) => JointKind::Helical { axis, pitch },
            None => {
                let remedy = "give the axis its pitch, the displacement per angle";
                return Err(missing("a helical joint without pitch", "a pitch in m/rad", remedy));
            }
        },
        "cylindrical" => JointKind::Cylindrical { axis },
        "universal" => match axis2 {
            Some(second) => JointKind::Universal { axes: [axis, second] },
            None => {
                let remedy = "give axis2, the axis that turns with the first";
                return Err(missing("a universal joint without axis2", "two axes", remedy));
            }
        },
        "spherical" => JointKind::Spherical,
        "translation" => JointKind::Translation,
        _ => return Err(unknown(word)),
    })
}

/// True for the joint types that are not URDF's own.
pub fn is_extension(kind: &JointKind) -> bool {
    MORE_TYPES.contains(&kind.word())
}

fn unknown(word: &str) -> JointKindError {
    let types = || URDF_TYPES.into_iter().chain(MORE_TYPES);
    let lower = word.trim().to_ascii_lowercase();
    let synonym = SYNONYMS.iter().find(|(other, _)| *other == lower).map(|(_, ours)| *ours);
    let remedy = match synonym.or_else(|| nearest(word.trim(), types())) {
        Some(guess) => format!("did you mean `{guess}`?"),
        None => format!("use one of {}", types().collect::<Vec<_>>().join(", ")),
    };
    JointKindError { found: format!("joint type {}", quote(word)), required: "a joint type".into(), remedy }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_gives_the_joint_that_has_this_word() {
        for word in URDF_TYPES.into_iter().chain(MORE_TYPES) {
            let kind = joint_kind(word, None, Some([0.0, 1.0, 0.0]), Some(0.5)).unwrap();
            assert_eq!(kind.word(), word);
            assert_eq!(is_extension(&kind), !URDF_TYPES.contains(&word));
        }
    }

    #[test]
    fn an_unknown_word_gets_the_nearest_or_all() {
        for (word, guess) in
            [("Revolute", "revolute"), ("revolut", "revolute"), ("ball", "spherical"), (" fixed", "fixed")]
        {
            assert_eq!(
                joint_kind(word, None, None, None).unwrap_err().remedy,
                format!("did you mean `{guess}`?")
            );
        }
        assert!(
            joint_kind("gimbal", None, None, None).unwrap_err().remedy.starts_with("use one of revolute,")
        );
        assert!(joint_kind("", None, None, None).is_err());
    }
}
