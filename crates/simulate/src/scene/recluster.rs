//! `[[molecule.recluster]]`: times at which kinds of bonds freeze and thaw.

use super::molecule::kinds;
use super::settings::{IntegratorSettings, is_multiple, pieces};
use super::tree::{Node, Table};
use crate::recluster::{Change, Schedule};
use phipsi_formats::{Note, Problem, Report};
use phipsi_molecule::{Atoms, BondKind, Clustering, Clusters, ForceField, MoleculeErrors, TorsionModel};
use phipsi_motion::Scheme;
use phipsi_spatial::Vec3;

/// The changes as they are written, in the order of time.
pub(super) fn read(molecule: &mut Table<'_>, start: &Clustering, report: &mut Report) -> Vec<Change> {
    let mut rigid = start.rigid.clone();
    let mut changes: Vec<Change> = Vec::new();
    for (i, mut table) in molecule.tables("recluster", report).into_iter().enumerate() {
        table.place = format!("molecule.recluster {i}");
        table.required("time_ps", report, "the time of the change, ps");
        let time = table.positive("time_ps", false, report);
        let freeze = kinds(&mut table, "freeze", report);
        let thaw = kinds(&mut table, "thaw", report);
        let thaw_temperature = table.positive("thaw_temperature_K", true, report);
        let node = table.get("thaw");
        if !(table.has("freeze") || table.has("thaw")) {
            table.error(
                None,
                report,
                "neither `freeze` nor `thaw`",
                "kinds of bonds",
                "name what freezes or thaws",
            );
        }
        if let Some(kelvin) = thaw_temperature
            && thaw.is_empty()
        {
            let found = format!("thaw_temperature_K = {kelvin} without `thaw`");
            let own = table.get("thaw_temperature_K");
            table.error(own, report, found, "the temperature of what thaws", "remove it, or add `thaw`");
        }
        if let (Some(time), Some(before)) = (time, changes.last().map(|c| c.time))
            && time <= before
        {
            let own = table.get("time_ps");
            let found = format!("time_ps = {time} after a change at {before} ps");
            table.error(own, report, found, "times that increase", "put the changes in the order of time");
        }
        for kind in freeze.iter().filter(|kind| rigid.contains(kind)) {
            let own = table.get("freeze");
            let found = format!("{:?} freezes", kind.word());
            table.error(own, report, found, "a kind of bonds that turns until then", "remove it");
        }
        for kind in thaw.iter().filter(|kind| !rigid.contains(kind)) {
            let found = format!("{:?} thaws", kind.word());
            let remedy = "remove it, or name it under `rigid` of [molecule]";
            table.error(node, report, found, "a kind of bonds that is rigid until then", remedy);
        }
        rigid.extend(&freeze);
        rigid.retain(|kind| !thaw.contains(kind));
        table.finish(report);
        changes.push(Change {
            time: time.unwrap_or(f64::INFINITY),
            freeze,
            thaw,
            thaw_temperature,
            degrees_of_freedom: 0,
        });
    }
    changes
}

/// The schedule of a molecule whose widest model is `torsion`: what each change makes of it. `None` where there are no changes.
pub(super) fn schedule(
    (atoms, positions): (&Atoms, &[Vec3<f64>]),
    (torsion, field): (&TorsionModel, &ForceField),
    (clustering, changes): (Clustering, Vec<Change>),
    report: &mut Report,
) -> Result<Option<Schedule>, MoleculeErrors> {
    if changes.is_empty() {
        return Ok(None);
    }
    let mut wrong = |i: usize, found: String, required: &str, remedy: &str| {
        let place = format!("molecule.recluster {i}");
        report.errors.push(Problem::new(None, place, found, required, remedy));
    };
    let bends = |clusters: &Clusters| -> Vec<(BondKind, [usize; 3])> {
        clusters.hinges.iter().filter_map(|h| Some((h.kind, h.open_angle()?))).collect()
    };
    let angles = bends(torsion.clusters());
    let mut schedule = Schedule { clustering, angles, degrees_of_freedom: 0, changes, field: field.clone() };
    let mut before = None;
    let mut notes = Vec::new();
    for n in 0..=schedule.changes.len() {
        let clusters = Clusters::new(atoms, positions, &schedule.clustering_after(n))?;
        if let Some((_, angle)) = bends(&clusters).iter().find(|bend| !schedule.angles.contains(bend)) {
            let found = format!(
                "the angle {}, which opens where others freeze",
                angle.map(|a| atoms.label(a)).join("-")
            );
            let remedy = "freeze fewer kinds, or make the change in Python: TorsionModel.recluster";
            wrong(n.saturating_sub(1), found, "angles that are open in the widest clusters", remedy);
        }
        let (count, hinges) = (clusters.clusters.len(), clusters.hinges.len());
        let model = TorsionModel::new(atoms, positions, clusters)?;
        let freedom = model.degrees_of_freedom();
        match n.checked_sub(1) {
            None => schedule.degrees_of_freedom = freedom,
            Some(i) => {
                schedule.changes[i].degrees_of_freedom = freedom;
                if before == Some((count, hinges, freedom)) {
                    let found = format!("a change that leaves {hinges} hinges as they are");
                    wrong(
                        i,
                        found,
                        "kinds of bonds that the molecule has",
                        "remove the change, or its kinds",
                    );
                }
                let time = schedule.changes[i].time;
                notes.push(format!(
                    "from {time} ps on {count} rigid clusters, {hinges} hinges, {freedom} degrees of freedom"
                ));
            }
        }
        before = Some((count, hinges, freedom));
    }
    report.used.extend(notes.into_iter().map(|what| Note::new(None, "molecule", what)));
    Ok(Some(schedule))
}

/// Whether the changes fit into the run: whole numbers of steps before its end, with nothing that belongs to one model only.
pub(super) fn check(
    scene: &mut Table<'_>,
    schedule: &Schedule,
    settings: &IntegratorSettings,
    report: &mut Report,
) {
    let mut wrong = |node: Option<&Node>, place: String, found: String, required: String, remedy: &str| {
        report.errors.push(Problem::new(node.and_then(|n| n.line), place, found, required, remedy));
    };
    let place = |i: usize| format!("molecule.recluster {i}");
    match settings.choice.method {
        Scheme::Midpoint { step } => {
            let step = settings.ensemble.stride() as f64 * step;
            for (i, change) in schedule.changes.iter().enumerate() {
                let time = change.time;
                let (several, one) = pieces(&settings.ensemble);
                if !is_multiple(time, step) {
                    let found = format!("time_ps = {time} with {one} of {step} ps");
                    let required = format!("a whole number of {several}");
                    wrong(
                        None,
                        place(i),
                        found,
                        required,
                        "take a multiple of the step, or of the trajectory",
                    );
                }
                if time >= settings.t_end {
                    let found = format!("time_ps = {time} with t_end = {}", settings.t_end);
                    wrong(None, place(i), found, "a time before the end".into(), "remove it, or run longer");
                }
            }
        }
        Scheme::Explicit(_) => {
            let found = "changes of clusters with a method other than \"midpoint\"".into();
            wrong(None, place(0), found, "method = \"midpoint\"".into(), "remove `method`");
        }
    }
    for key in ["force", "motion", "event", "joint_stops", "friction"] {
        if let Some(node) = scene.get(key) {
            let found = "changes of clusters, and joints that are named here".into();
            let required = "joints that stay the same during the run".into();
            let remedy = "remove it, or [[molecule.recluster]]";
            wrong(Some(node), key.into(), found, required, remedy);
        }
    }
}
