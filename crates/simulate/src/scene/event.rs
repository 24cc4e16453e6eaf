//! `[[event]]`: functions of time, joints and outputs whose passage through zero is recorded or ends the run.

use super::tree::{Table, shorten};
use crate::output::{EnergyKind, Output, Quantity};
use phipsi_formats::Report;
use phipsi_formats::expression::Expression;
use phipsi_model::Model;
use phipsi_motion::{Action, Direction, Energies, Event, Situation};
use std::f64::consts::PI;

/// What a name in an expression stands for.
#[derive(Clone)]
enum Source {
    Time,
    Coordinate(usize),
    Velocity(usize),
    Output(Quantity),
    Energy(EnergyKind),
}

impl Source {
    fn needs_poses(&self) -> bool {
        match self {
            Source::Output(quantity) => {
                !matches!(quantity, Quantity::Coordinates(_) | Quantity::Velocities(_))
            }
            _ => false,
        }
    }
    fn value(&self, at: &Situation<'_>, energies: Energies) -> f64 {
        match self {
            Source::Energy(kind) => kind.of(energies),
            Source::Time => at.t,
            Source::Coordinate(i) => at.q[*i],
            Source::Velocity(i) => at.v[*i],
            Source::Output(quantity) => {
                quantity.of_motion(at.layout, at.kinematics, at.q, at.v).unwrap_or(f64::NAN)
            }
        }
    }
}

/// All events of a scene.
pub(crate) fn read(
    scene: &mut Table<'_>,
    model: &Model,
    outputs: &[Output],
    report: &mut Report,
) -> Vec<Event> {
    let mut names: Vec<(String, Source)> = vec![("t".into(), Source::Time)];
    for k in model.moving_joints().filter(|&k| model.joints()[k].kind.nv() == 1) {
        let name = &model.joints()[k].name;
        names.push((format!("q.{name}"), Source::Coordinate(model.q_offset(k))));
        names.push((format!("v.{name}"), Source::Velocity(model.v_offset(k))));
    }
    names.extend(outputs.iter().map(|o| {
        let source = match &o.quantity {
            Quantity::Energy(kind) => Source::Energy(*kind),
            other => Source::Output(other.clone()),
        };
        (o.name.clone(), source)
    }));
    let variables: Vec<&str> = names.iter().map(|(name, _)| name.as_str()).collect();
    let mut events: Vec<Event> = Vec::new();
    for (i, mut table) in scene.tables("event", report).into_iter().enumerate() {
        let name = table.text("name", report).map_or_else(|| format!("event {i}"), str::to_string);
        table.place = format!("event `{name}`");
        let text = table.required_text("when", report);
        let direction = table.word("direction", &["rising", "falling", "either"], report);
        let action = table.word("action", &["record", "stop"], report);
        let node = table.get("when");
        if events.iter().any(|e| e.name == name) {
            table.error(None, report, "a second event of this name", "names of their own", "rename one");
        }
        let expression = text.and_then(|text| match Expression::parse(text, &variables, &[("pi", PI)]) {
            Ok(e) if e.as_constant().is_none() => Some(e),
            Ok(_) => {
                let found = format!("when = {:?}, which never changes", shorten(text));
                table.error(node, report, found, "an expression of the motion", "see below for its names");
                None
            }
            Err(e) => {
                let found = format!("when = {:?}: {e}", shorten(text));
                let remedy = "use t, q.JOINT, v.JOINT (joints with one axis) and the names of outputs";
                table.error(node, report, found, "an expression that passes through zero", remedy);
                None
            }
        });
        table.finish(report);
        let Some(expression) = expression else { continue };
        let used: Vec<Source> = names
            .iter()
            .map(|(name, source)| if expression.depends_on(name) { source.clone() } else { Source::Time })
            .collect();
        let needs_poses = used.iter().any(Source::needs_poses);
        let needs_energies = used.iter().any(|source| matches!(source, Source::Energy(_)));
        let mut values = vec![0.0; used.len()];
        let mut function = move |at: &Situation<'_>, energies: Energies| {
            values.iter_mut().zip(&used).for_each(|(value, source)| *value = source.value(at, energies));
            expression.value(&values)
        };
        let direction = match direction {
            Some("rising") => Direction::Rising,
            Some("falling") => Direction::Falling,
            _ => Direction::Either,
        };
        let action = if action == Some("stop") { Action::Stop } else { Action::Record };
        let event = match needs_energies {
            true => Event::of_energies(name, direction, action, function),
            false => Event::new(name, direction, action, move |at| function(at, Energies::default())),
        };
        events.push(if needs_poses { event.with_kinematics() } else { event });
    }
    events
}
