//! What happened in a run, by the user's names.

use phipsi_motion::{Dynamics, Happening, Occurrence, System as _};
use serde::{Deserialize, Serialize};

/// An event of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EventRecord {
    /// When.
    pub t: f64,
    /// `event`, `impact`, `rest`, `leave`, `stick` or `slip`.
    pub kind: String,
    /// The event's or the joint's name.
    pub name: String,
    /// What it was, for people.
    pub what: String,
    /// Of an impact: speed of the joint before and after, rad/s or m/s.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub speed: Option<[f64; 2]>,
    /// Of an impact: energy that the stop took, J.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub energy: Option<f64>,
    /// Of a rest: infinitely many impacts were left before it, smaller than the tolerance tells from rest.
    #[serde(skip_serializing_if = "std::ops::Not::not", default)]
    pub endless: bool,
}

impl EventRecord {
    /// With the names of a mechanism.
    pub fn new(occurrence: &Occurrence, dynamics: &Dynamics) -> Self {
        let model = dynamics.model();
        let joint = |dof: usize| {
            let (k, component) = model.joint_of_velocity(dof);
            let joint = &model.joints()[k];
            match joint.kind.nv() {
                1 => joint.name.clone(),
                _ => format!("{}.{component}", joint.name),
            }
        };
        let side = |upper: bool| if upper { "upper" } else { "lower" };
        let (mut speeds, mut taken, mut is_endless) = (None, None, false);
        let (kind, name, what) = match occurrence.what {
            Happening::Event { index } => {
                let name = dynamics.user_events().get(index).map_or(String::new(), |e| e.name.clone());
                ("event", name.clone(), format!("event `{name}`"))
            }
            Happening::Impact { dof, upper, speed, energy } => {
                (speeds, taken) = (Some(speed), Some(energy));
                let what = format!(
                    "joint `{}` struck its {} stop: speed {:.6e}, then {:.6e}; it took {energy:.3e} J",
                    joint(dof),
                    side(upper),
                    speed[0],
                    speed[1]
                );
                ("impact", joint(dof), what)
            }
            Happening::Rest { dof, upper, endless } => {
                is_endless = endless;
                let why = match endless {
                    true => {
                        ": infinitely many impacts were left, too small for the tolerance; one took what was left"
                    }
                    false => "",
                };
                ("rest", joint(dof), format!("joint `{}` rests on its {} stop{why}", joint(dof), side(upper)))
            }
            Happening::Leave { dof } => {
                ("leave", joint(dof), format!("joint `{}` left its stop", joint(dof)))
            }
            Happening::Stick { dof } => {
                ("stick", joint(dof), format!("friction holds joint `{}`", joint(dof)))
            }
            Happening::Slip { dof, forward } => {
                let way = if forward { "forward" } else { "backward" };
                ("slip", joint(dof), format!("joint `{}` slides {way}", joint(dof)))
            }
        };
        EventRecord {
            t: occurrence.t,
            kind: kind.into(),
            name,
            what,
            speed: speeds,
            energy: taken,
            endless: is_endless,
        }
    }
}
