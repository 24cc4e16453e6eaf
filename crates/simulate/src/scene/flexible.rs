//! A flexible body of a scene: a beam along x of the body's frame, from its section; a finite element model in files; or shape
//! integrals.

mod elements;
mod integrals;

use super::SceneFile;
use super::tree::Table;
use phipsi_formats::Report;
use phipsi_model::{Beam, BeamModes, FlexibleBody, Section};
use std::path::Path;

/// More modes of one kind than any scene needs; with them integrals are still made in a moment.
const MOST_MODES: usize = 40;

/// Where files of a scene are, and those that were read.
pub(super) struct Files<'a> {
    pub(super) folder: &'a Path,
    pub(super) read: &'a mut Vec<SceneFile>,
    pub(super) reports: &'a mut Vec<Report>,
}

/// Reads `flexible = { … }` of the body of this name at this place in the list; `None` if there are errors.
pub(super) fn read_flexible(
    table: &mut Table<'_>,
    (name, index): (&str, usize),
    files: &mut Files<'_>,
    report: &mut Report,
) -> Option<FlexibleBody> {
    let before = report.errors.len();
    let body = if table.has("mass") || table.has("stiffness") {
        elements::read(table, (name, index), files, report)
    } else if table.has("integrals") {
        integrals::read(table, report)
    } else {
        beam(table, report)
    };
    let held_at = table.text("held_at", report);
    let body = body.filter(|_| report.errors.len() == before)?;
    Some(match held_at {
        Some(node) => body.held_at(node),
        None => body,
    })
}

fn beam(table: &mut Table<'_>, report: &mut Report) -> Option<FlexibleBody> {
    let before = report.errors.len();
    let mut positive = |key: &'static str, report: &mut Report| {
        table.required(key, report, "a number above 0");
        table.positive(key, false, report)
    };
    let length = positive("length", report);
    let mass_per_length = positive("mass_per_length", report);
    table.required("bending_stiffness", report, "two numbers: EI for displacement along y and along z, N·m²");
    let bending_stiffness = table.numbers::<2>("bending_stiffness", report);
    let optional = |table: &mut Table<'_>, key, report: &mut Report| {
        table.positive(key, true, report).unwrap_or_default()
    };
    let section = Section {
        mass_per_length: mass_per_length.unwrap_or(1.0),
        bending_stiffness: bending_stiffness.unwrap_or_default(),
        torsional_stiffness: optional(table, "torsional_stiffness", report),
        polar_inertia: optional(table, "polar_inertia", report),
        axial_stiffness: optional(table, "axial_stiffness", report),
    };
    let bending = table.numbers::<2>("bending", report).unwrap_or([2.0, 2.0]);
    let bending = bending.map(|x| count(x, "bending", MOST_MODES, table, report));
    let torsion =
        table.number("torsion", report).map_or(0, |x| count(x, "torsion", MOST_MODES, table, report));
    let axial = table.number("axial", report).map_or(0, |x| count(x, "axial", MOST_MODES, table, report));
    let family = match table.word("modes", &["interface", "clamped_free", "pinned"], report) {
        Some("clamped_free") => BeamModes::ClampedFree,
        Some("pinned") => BeamModes::Pinned,
        _ => BeamModes::Interface,
    };
    let stiffened = table.flag("stiffened", report).unwrap_or(false);
    let damping = optional(table, "damping", report);
    let mut beam = Beam::new(length.unwrap_or(1.0), section)
        .family(family)
        .bending(bending)
        .torsion(torsion)
        .axial(axial)
        .damped(damping);
    if stiffened {
        beam = beam.stiffened();
    }
    for mut node in table.tables("nodes", report) {
        let name = node.required_text("name", report);
        node.required("x", report, "the distance from the frame's origin, m");
        let x = node.number("x", report);
        if let (Some(name), Some(x)) = (name, x) {
            beam = beam.node(name, x);
        }
        node.finish(report);
    }
    (report.errors.len() == before).then(|| beam.build())
}

/// A whole number of modes.
fn count(x: f64, key: &str, most: usize, table: &Table<'_>, report: &mut Report) -> usize {
    if (0.0..=most as f64).contains(&x) && x.fract() == 0.0 {
        return x as usize;
    }
    let required = format!("whole numbers from 0 to {most}");
    table.error(None, report, format!("{key} = {x}"), required, format!("correct `{key}`"));
    0
}
