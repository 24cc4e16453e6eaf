//! The mechanism in motion, as plain data for the page's script.

use super::escape;
use serde_json::{Value, json};

/// No displacement, as x y z qx qy qz qw.
pub const IDENTITY_POSE: [f32; 7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// A mechanism or a molecule in motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    /// Bodies or clusters.
    pub bodies: Vec<DrawnBody>,
    /// Recorded times, ascending: s where `unit` is "m", ps where it is "nm".
    pub times: Vec<f64>,
    /// World poses: times × bodies × (x y z qx qy qz qw).
    pub poses: Vec<f32>,
    /// Unit of lengths, "m" or "nm".
    pub unit: String,
}

/// What is drawn of a body, in its own frame.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnBody {
    /// The user's name.
    pub name: String,
    /// Index of the body that carries it; a line joins their origins.
    pub parent: Option<usize>,
    /// Name of the joint that carries it.
    pub joint: String,
    /// Line segments that move with the body: to its centre of mass, bonds of a molecule.
    pub lines: Vec<[[f32; 3]; 2]>,
    /// Centre of mass.
    pub center: [f32; 3],
    /// Mass: the size of its dot.
    pub mass: f32,
    /// Half sizes of a box, from [`equivalent_box`](super::equivalent_box).
    pub box_half: Option<[f32; 3]>,
    /// Pose of the box in the body frame.
    pub box_pose: [f32; 7],
}

impl Default for DrawnBody {
    fn default() -> Self {
        DrawnBody {
            name: String::new(),
            parent: None,
            joint: String::new(),
            lines: Vec::new(),
            center: [0.0; 3],
            mass: 0.0,
            box_half: None,
            box_pose: IDENTITY_POSE,
        }
    }
}

/// Most frames that a page holds.
const MOST_FRAMES: usize = 600;
/// Most poses that a page holds: 37⅓ letters each, 3 MB in all.
const MOST_POSES: usize = 80_000;

impl Drawing {
    /// Number of whole frames.
    pub fn frames(&self) -> usize {
        self.times.len().min(self.poses.len() / (7 * self.bodies.len().max(1)))
    }
    /// Poses of one frame.
    pub(super) fn frame(&self, i: usize) -> &[f32] {
        let width = 7 * self.bodies.len();
        self.poses.get(i * width..(i + 1) * width).unwrap_or_default()
    }
    /// Parent of a body, if it exists.
    pub(super) fn parent(&self, body: usize) -> Option<usize> {
        self.bodies[body].parent.filter(|p| *p < self.bodies.len() && *p != body)
    }
    /// Which frames the page holds: all, or evenly chosen ones with the first and the last.
    fn kept(&self) -> Vec<usize> {
        let n = self.frames();
        let most = (MOST_POSES / self.bodies.len().max(1)).clamp(2, MOST_FRAMES);
        if n <= most { (0..n).collect() } else { (0..most).map(|i| i * (n - 1) / (most - 1)).collect() }
    }

    /// The canvas, its controls and its data.
    pub(super) fn to_html(&self, title: &str) -> String {
        let kept = self.kept();
        if kept.is_empty() || self.bodies.is_empty() {
            return "<section class=\"drawing\"><p>No frames were recorded for a drawing.</p></section>"
                .into();
        }
        let bodies = match self.bodies.len() {
            1 => "1 body".into(),
            n => format!("{n} bodies"),
        };
        let boxed = self.bodies.iter().any(|b| b.box_half.is_some());
        let thinned = match self.frames() {
            n if n > kept.len() => format!(" The drawing holds {} of {n} recorded frames.", kept.len()),
            _ => String::new(),
        };
        let values = [
            ("title", escape(title)),
            ("bodies", bodies),
            ("boxes", if boxed { " Boxes have the moments of inertia of their bodies." } else { "" }.into()),
            ("thinned", thinned),
            ("last", (kept.len() - 1).to_string()),
            // `<` could end the script element or begin a comment.
            ("data", self.to_json(&kept).to_string().replace('<', "\\u003c")),
        ];
        let values: Vec<(&str, &str)> = values.iter().map(|(name, value)| (*name, value.as_str())).collect();
        super::fill(include_str!("drawing.html"), &values)
    }

    fn to_json(&self, kept: &[usize]) -> Value {
        let body = |(k, body): (usize, &DrawnBody)| {
            json!({
                "name": body.name,
                "parent": self.parent(k),
                "joint": body.joint,
                "lines": body.lines.iter().flatten().flatten().collect::<Vec<_>>(),
                "center": body.center,
                "mass": body.mass,
                "half": body.box_half,
                "box": body.box_pose,
            })
        };
        let poses = kept.iter().flat_map(|f| self.frame(*f)).flat_map(|x| x.to_le_bytes());
        json!({
            "unit": self.unit,
            "time_unit": if self.unit == "nm" { "ps" } else { "s" },
            "bodies": self.bodies.iter().enumerate().map(body).collect::<Vec<_>>(),
            "times": kept.iter().map(|f| self.times[*f]).collect::<Vec<_>>(),
            "poses": base64(poses),
        })
    }
}

/// Bytes in the letters of base 64, with padding (RFC 4648, section 4).
fn base64(bytes: impl Iterator<Item = u8>) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let bytes: Vec<u8> = bytes.collect();
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let at = |i: usize| u32::from(group.get(i).copied().unwrap_or(0));
        let word = at(0) << 16 | at(1) << 8 | at(2);
        for i in 0..4 {
            let letter = LETTERS[(word >> (18 - 6 * i) & 63) as usize] as char;
            out.push(if i <= group.len() { letter } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawing(bodies: usize, frames: usize) -> Drawing {
        Drawing {
            bodies: vec![DrawnBody::default(); bodies],
            times: (0..frames).map(|i| i as f64).collect(),
            poses: IDENTITY_POSE.repeat(bodies * frames),
            unit: "m".into(),
        }
    }

    /// The examples of RFC 4648, section 10.
    #[test]
    fn base64_of_the_standard() {
        for (text, want) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(text.bytes()), want);
        }
    }

    #[test]
    fn long_runs_are_thinned_and_it_is_said() {
        let long = drawing(30, 10_000);
        let kept = long.kept();
        assert_eq!((kept.len(), kept[0], kept[599]), (600, 0, 9_999));
        let html = long.to_html("t");
        assert!(html.contains("holds 600 of 10000 recorded frames"));
        // 28 bytes a pose in base 64, 30 a time, 200 a body.
        assert!(html.len() < 600 * (30 * 38 + 30) + 30 * 200 + 5_000, "{}", html.len());
        let many = drawing(4_000, 100).to_html("t");
        assert!(many.contains("holds 20 of 100") && many.len() < 4_000_000, "{}", many.len());
        assert!(!drawing(2, 600).to_html("t").contains("recorded frames"));
    }

    #[test]
    fn wrong_shapes_and_numbers_are_no_panic() {
        assert!(drawing(0, 3).to_html("t").contains("No frames"));
        assert!(drawing(2, 0).to_html("t").contains("No frames"));
        let mut short = drawing(2, 3);
        short.poses.truncate(30);
        short.bodies[0].parent = Some(7);
        short.bodies[1] = DrawnBody { parent: Some(1), mass: f32::NAN, ..DrawnBody::default() };
        short.times[0] = f64::NAN;
        assert_eq!(short.frames(), 2);
        let json = short.to_json(&short.kept());
        assert_eq!((&json["bodies"][0]["parent"], &json["bodies"][1]["mass"]), (&Value::Null, &Value::Null));
    }
}
