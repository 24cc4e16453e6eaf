//! A start on the closures and prescribed motions of a scene.

use super::settings::Start;
use crate::simulation::{LARGEST_OPENING, Simulation};
use phipsi_formats::{Note, Problem, Report};
use phipsi_model::State;
use phipsi_motion::{MotionError, System};

/// How far named values may be from what motions say: numbers are often given with eight digits or so.
const LARGEST_DIFFERENCE: f64 = 1e-6;

/// Puts the start of a simulation onto its closures: with `assemble` from far away, the joints that `[initial]` names first
/// held; otherwise the given numbers must close the loops up to rounding.
pub(crate) fn settle(simulation: &mut Simulation, start: &Start, report: &mut Report) {
    follow(simulation, start, report);
    let wrong =
        |found: String, required: &str, remedy: &str| Problem::new(None, "initial", found, required, remedy);
    if start.assemble {
        match assemble(simulation, start) {
            Ok((how, state)) => {
                simulation.start = state;
                report.used.push(Note::new(None, "initial", how));
            }
            Err(e) => {
                let remedy = "start nearer, name fewer joints, or correct the lengths of the mechanism";
                report.errors.push(wrong(e.to_string(), "loops that can be closed", remedy));
            }
        }
        return;
    }
    let State { q, v, t } = simulation.start.clone();
    match simulation.dynamics.closure_residual(t, &q, &v) {
        Ok(Some([position, velocity])) => {
            let remedy = "add `assemble = true` to [initial], or correct the numbers";
            let speed = v.iter().fold(1.0f64, |most, x| most.max(x.abs()));
            if position.is_nan() || position > LARGEST_OPENING {
                let found = format!("closures are open by {position:e} m or rad");
                let required = format!("at most {LARGEST_OPENING:e}");
                report.errors.push(wrong(found, &required, remedy));
            } else if velocity.is_nan() || velocity > LARGEST_OPENING * speed {
                let found = format!("velocities open the closures at {velocity:e} m/s or rad/s");
                let required = format!("at most {:e}", LARGEST_OPENING * speed);
                report.errors.push(wrong(found, &required, remedy));
            }
        }
        Ok(None) => {}
        Err(e) => report.errors.push(wrong(e.to_string(), "a state of the model", "correct the numbers")),
    }
}

/// Moves prescribed joints where they are at the start; what `[initial]` names must agree.
fn follow(simulation: &mut Simulation, start: &Start, report: &mut Report) {
    let State { q, v, t } = &mut simulation.start;
    simulation.dynamics.follow(*t, q, v);
    let model = simulation.dynamics.model();
    let moved = model.difference(&start.state.q, q);
    for (i, active) in simulation.dynamics.active().into_iter().enumerate().filter(|(_, active)| *active) {
        let differences = [moved[i], v[i] - start.state.v[i]];
        for ((difference, named), what) in differences.iter().zip(&start.named).zip(["q", "v"]) {
            if active && named[i] && difference.abs() > LARGEST_DIFFERENCE {
                let joint = &model.joints()[model.joint_of_velocity(i).0].name;
                let found =
                    format!("{what}.{joint} differs by {difference:e} from the [[motion]] of the joint");
                let required = "what the motion says at t = 0";
                let remedy = format!("remove {what}.{joint} from [initial]");
                report.errors.push(Problem::new(None, "initial", found, required, remedy));
            }
        }
    }
}

/// The assembled state and how it was found: named joints keep what they can.
fn assemble(simulation: &mut Simulation, start: &Start) -> Result<(String, State), MotionError> {
    let State { q, v, t } = simulation.start.clone();
    let free = vec![false; v.len()];
    let [named_q, named_v] = &start.named;
    let mut last = None;
    for (keep_q, keep_v) in [(true, true), (true, false), (false, true), (false, false)] {
        let kept = [if keep_q { &named_q[..] } else { &free }, if keep_v { &named_v[..] } else { &free }];
        let (mut q, mut v) = (q.clone(), v.clone());
        match simulation.dynamics.assemble(t, &mut q, &mut v, kept) {
            // Velocities that contradict each other leave a residual, and no error.
            Ok(done) if done.velocity <= 1e-9 * v.iter().fold(1.0f64, |most, x| most.max(x.abs())) => {
                let said = match (keep_q, keep_v) {
                    (true, true) => "named joints kept",
                    (true, false) => "named positions kept, named velocities changed",
                    (false, true) => "named velocities kept, named positions changed",
                    (false, false) => "named joints changed",
                };
                let how = format!("loops closed, open by {:.0e} m or rad; {said}", done.position);
                return Ok((how, State { q, v, t }));
            }
            Ok(_) => {}
            Err(e) => last = Some(e),
        }
    }
    Err(last.unwrap_or(MotionError::Prescription { what: "the velocities contradict the motions".into() }))
}
