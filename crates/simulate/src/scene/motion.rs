//! `[[motion]]`: joints that follow functions of time.

use super::mechanism::joint_dof;
use super::signal;
use super::tree::Table;
use phipsi_formats::Report;
use phipsi_model::Model;
use phipsi_motion::PrescribedJoint;

const KEYS: [&str; 3] = ["position", "velocity", "acceleration"];

/// All prescribed joints of a scene.
pub(crate) fn read(
    scene: &mut Table<'_>,
    model: &Model,
    t_end: f64,
    report: &mut Report,
) -> Vec<PrescribedJoint> {
    let mut all: Vec<PrescribedJoint> = Vec::new();
    for mut table in scene.tables("motion", report) {
        if let Some(name) = table.text("joint", report) {
            table.place = format!("motion of joint `{name}`");
        }
        let joint = joint_dof(&mut table, "joint", model, report);
        let given: Vec<&'static str> = KEYS.into_iter().filter(|key| table.has(key)).collect();
        let course = match given[..] {
            ["position"] => signal::position(&mut table, "position", t_end, report),
            ["velocity"] => signal::velocity(&mut table, "velocity", t_end, report),
            ["acceleration"] => signal::acceleration(&mut table, "acceleration", t_end, report),
            _ => {
                let found = if given.is_empty() { "no function of time".into() } else { given.join(" and ") };
                let remedy = "give one of them; a constant position locks the joint";
                table.error(None, report, found, "one of position, velocity, acceleration", remedy);
                None
            }
        };
        if let (Some(joint), Some(course)) = (joint, course) {
            if joint.coordinate.is_none() && given == ["position"] {
                let node = table.get("joint");
                let required = "a degree of freedom with a coordinate of its own";
                let found = "the position of a degree of freedom without a coordinate";
                table.error(node, report, found, required, "give its velocity or acceleration");
            } else if all.iter().any(|p| p.dof == joint.dof) {
                let node = table.get("joint");
                table.error(node, report, "a second motion of it", "one motion", "remove one of them");
            } else {
                all.push(PrescribedJoint { dof: joint.dof, coordinate: joint.coordinate, course });
            }
        }
        table.finish(report);
    }
    all
}
