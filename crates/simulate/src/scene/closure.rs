//! `[[closure]]`: what joins two bodies besides the joints of the tree, fixed or moving.

use super::mechanism::pose;
use super::signal;
use super::tree::{Table, suggestion};
use phipsi_formats::Report;
use phipsi_model::{Closure, ClosureKind};
use phipsi_motion::{Course, MovingClosure};

/// The words of rows that can move, with those of [`ClosureKind::direction`].
pub const DIRECTIONS: [(&str, &str); 7] = [
    ("x", "translation along x"),
    ("y", "translation along y"),
    ("z", "translation along z"),
    ("rx", "rotation about x"),
    ("ry", "rotation about y"),
    ("rz", "rotation about z"),
    ("distance", "distance"),
];

/// A closure with the rows of it that move.
pub(crate) struct ReadClosure {
    pub(crate) closure: Closure,
    pub(crate) line: Option<u32>,
    pub(crate) moving: Vec<(usize, Course)>,
}

/// All closures of a scene.
pub(crate) fn read(scene: &mut Table<'_>, t_end: f64, report: &mut Report) -> Vec<ReadClosure> {
    let tables = scene.tables("closure", report);
    tables
        .into_iter()
        .filter_map(|mut table| {
            let read = one(&mut table, t_end, report);
            table.finish(report);
            read
        })
        .collect()
}

/// Rows that move, as the dynamics wants them; `first`: closures of the model before these.
pub(crate) fn moving(read: &[ReadClosure], first: usize) -> Vec<MovingClosure> {
    let of = |(i, c): (usize, &ReadClosure)| {
        let rows = c.moving.iter().cloned();
        rows.map(move |(row, course)| MovingClosure { closure: first + i, row, course }).collect::<Vec<_>>()
    };
    read.iter().enumerate().flat_map(of).collect()
}

fn one(table: &mut Table<'_>, t_end: f64, report: &mut Report) -> Option<ReadClosure> {
    let name = table.required_text("name", report);
    if let Some(name) = name {
        table.place = format!("closure `{name}`");
    }
    let words = ClosureKind::WORDS;
    table.required("kind", report, &format!("one of {}", words.join(", ")));
    let word = table.word("kind", &words, report);
    if word == Some("distance") {
        table.required("length", report, "a distance in m");
    }
    let length = if word == Some("distance") { table.positive("length", false, report) } else { Some(1.0) };
    let [body_a, body_b] = ["body_a", "body_b"].map(|key| table.required_text(key, report));
    let (pose_a, pose_b) = (pose(table, "pose_a", report), pose(table, "pose_b", report));
    let kind = ClosureKind::from_word(word?, length?)?;
    let mut moving = Vec::new();
    if let Some(motion) = table.table("motion", report) {
        for entry in motion.rest() {
            let row = DIRECTIONS
                .iter()
                .find(|(word, _)| *word == entry.key)
                .and_then(|(_, direction)| (0..kind.rows()).find(|&i| kind.direction(i) == *direction));
            let Some(row) = row else {
                let held = |(word, direction): &(&'static str, &str)| {
                    (0..kind.rows()).any(|i| kind.direction(i) == *direction).then_some(*word)
                };
                let words: Vec<&str> = DIRECTIONS.iter().filter_map(held).collect();
                let found = format!("motion along `{}`", entry.key);
                let required = format!("what the closure keeps: {}", words.join(", "));
                motion.error(Some(&entry.node), report, found, required, suggestion(&entry.key, &words));
                continue;
            };
            let course = signal::course_from_node(&motion, &entry.key, &entry.node, t_end, report);
            moving.extend(course.map(|course| (row, course)));
        }
    }
    let [name, body_a, body_b] = [name?, body_a?, body_b?].map(String::from);
    let closure = Closure { name, kind, body_a, pose_a, body_b, pose_b };
    Some(ReadClosure { closure, line: table.line, moving })
}
