//! The page of a run, from its rows and steps.

use crate::folder::results::{RunFile, Status};
use crate::folder::summary::summary;
use crate::folder::table::Columns;
use crate::page::{Chart, Drawing, DrawnBody, PageData, Series, equivalent_box, render};
use crate::record::{Row, StepRecord, spread};
use crate::scene::Scene;
use crate::simulation::Simulation;
use phipsi_recursion::Kinematics;
use phipsi_spatial::{Quaternion, Vec3};

/// Most frames of the drawing.
const MOST_FRAMES: usize = 600;

/// Most curves of a chart: those with the largest range are shown.
const MOST_CURVES: usize = 40;

/// Most bodies of a drawing.
const MOST_BODIES: usize = 2000;

/// `index.html`.
pub fn page(scene: &Scene, file: &RunFile, columns: &Columns, rows: &[Row], steps: &[StepRecord]) -> String {
    let mut warnings = file.warnings.clone();
    if file.status != Status::Finished {
        warnings.insert(0, "the run has not ended: resume it to see the rest".into());
    }
    let shown =
        summary(file).into_iter().filter(|(name, _)| !["scene", "warnings", "left out"].contains(name));
    let model = scene.simulation.model();
    if model.len() > MOST_BODIES {
        warnings.push(format!("no drawing: {} bodies, and at most {MOST_BODIES} are drawn", model.len()));
    }
    let data = PageData {
        title: &file.title,
        summary: shown.map(|(name, lines)| (name.to_string(), lines.join("\n"))).collect(),
        warnings,
        left_out: file.plan.left_out.clone(),
        details: details(file),
        charts: charts(&scene.simulation, columns, rows, steps),
        drawing: (model.len() <= MOST_BODIES).then(|| drawing(&scene.simulation, rows)),
    };
    render(&data)
}

fn details(file: &RunFile) -> Vec<(String, String)> {
    let mut command = format!("phipsi run {}", file.inputs.first().map_or("", |i| &i.file));
    for o in &file.overrides {
        command += &format!(" --set '{o}'");
    }
    let mut rows = vec![("reproduce".to_string(), command)];
    rows.extend(file.inputs.iter().map(|i| (i.file.clone(), format!("blake3 {}", i.blake3))));
    rows.push(("phipsi".into(), file.version.clone()));
    rows.push(("instruction level".into(), file.instruction_level.clone()));
    rows
}

fn charts(simulation: &Simulation, columns: &Columns, rows: &[Row], steps: &[StepRecord]) -> Vec<Chart> {
    let model = simulation.model();
    let (time, energy) = (simulation.time_unit(), simulation.energy_unit());
    let chart = |title: &str, y_label: &str, log_y: bool, series: Vec<Series>| Chart {
        title: title.into(),
        x_label: format!("time, {time}"),
        y_label: y_label.into(),
        log_y,
        log_x: false,
        series,
    };
    let of = |name: &str, value: &dyn Fn(&Row) -> f64| Series {
        name: name.into(),
        points: rows.iter().map(|r| (r.t, value(r))).collect(),
    };
    let mut charts = Vec::new();
    if let Some(molecule) = &simulation.molecule
        && !molecule.backbone.is_empty()
    {
        let all = molecule.backbone_series(rows).into_iter();
        let series = all.take(MOST_CURVES).map(|(name, points)| Series { name, points }).collect();
        charts.push(chart("Backbone angles", "°", false, series));
    }
    let length = if simulation.molecule.is_some() { "nm" } else { "m" };
    for (angle, q_label) in [(true, "rad"), (false, length)] {
        let v_label = format!("{q_label}/{time}");
        let (mut positions, mut velocities) = (Vec::new(), Vec::new());
        for k in model.moving_joints() {
            let kind = &model.joints()[k].kind;
            for (i, at) in model.v_range(k).enumerate().filter(|(i, _)| kind.is_rotation(*i) == angle) {
                velocities.push(of(&columns.v[at], &|r| r.v[at]));
                // One-axis joints have a coordinate for it; orientations have quaternions instead.
                if kind.nv() == 1 {
                    let q = model.q_offset(k) + i;
                    positions.push(of(&columns.q[q], &|r| r.q[q]));
                }
            }
        }
        for (title, label, series) in
            [("Joint positions", q_label, positions), ("Velocities", v_label.as_str(), velocities)]
        {
            let all = series.len();
            let series = most_moved(series);
            let title = match all == series.len() {
                true => title.to_string(),
                false => format!("{title}: the {} of {all} that move most", series.len()),
            };
            if !series.is_empty() {
                charts.push(chart(&title, label, false, series));
            }
        }
    }
    charts.push(chart(
        "Energy",
        energy,
        false,
        vec![
            of("kinetic", &|r| r.energy[0]),
            of("potential", &|r| r.energy[1]),
            of("work", &|r| r.energy[2]),
            of("total less work", &|r| r.energy[0] + r.energy[1] - r.energy[2]),
        ],
    ));
    let imbalance = |name: &str, i: usize| Series {
        name: name.into(),
        points: steps.iter().map(|s| (s.t, s.imbalance[i])).collect(),
    };
    if !columns.terms.is_empty() {
        let terms = columns.terms.iter().enumerate();
        let series = terms.map(|(i, name)| of(name, &|r| r.terms[i])).collect();
        charts.push(chart("Energy of each term", energy, false, series));
    }
    charts.push(chart("Energy imbalance", energy, true, vec![imbalance("|E − E₀ − W|", 0)]));
    if columns.momentum {
        let units = match simulation.molecule {
            Some(_) => ["Da nm²/ps", "Da nm/ps"],
            None => ["kg m²/s", "kg m/s"],
        };
        let angular = imbalance(&format!("angular, {}", units[0]), 1);
        let series = vec![angular, imbalance(&format!("linear, {}", units[1]), 2)];
        charts.push(chart("Momentum imbalance", &units.join(", "), true, series));
    }
    for (i, name) in columns.outputs.iter().enumerate() {
        charts.push(chart(&format!("Output {name}"), "", false, vec![of(name, &|r| r.outputs[i])]));
    }
    charts
}

/// The curves with the largest range, in their order.
fn most_moved(series: Vec<Series>) -> Vec<Series> {
    let range = |s: &Series| {
        let ends = s
            .points
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p.1), high.max(p.1)));
        ends.1 - ends.0
    };
    let mut ranges: Vec<f64> = series.iter().map(range).collect();
    ranges.sort_by(|a, b| b.total_cmp(a));
    let least = ranges.get(MOST_CURVES - 1).copied().unwrap_or(f64::NEG_INFINITY);
    series.into_iter().filter(|s| range(s) >= least).take(MOST_CURVES).collect()
}

/// The mechanism as lines, with the poses of all bodies at the recorded instants.
pub fn drawing(simulation: &Simulation, rows: &[Row]) -> Drawing {
    // The start belongs to the picture; `spread` is sure to take the end.
    let mut chosen: Vec<usize> = spread(rows.len(), MOST_FRAMES).collect();
    if let Some(first) = chosen.first_mut() {
        *first = 0;
    }
    let chosen: Vec<&Row> = chosen.into_iter().map(|i| &rows[i]).collect();
    if let Some(molecule) = &simulation.molecule {
        return molecule.drawing(&chosen);
    }
    let (model, layout) = (simulation.model(), simulation.dynamics.layout());
    let mut bodies: Vec<DrawnBody> = Vec::with_capacity(model.len());
    for (k, body) in model.bodies().iter().enumerate() {
        let center = body.inertia.frame.translation.map(|x| x as f32);
        let (box_half, box_pose) = match equivalent_box(&body.inertia) {
            Some((half, pose)) => (Some(half), pose),
            None => (None, crate::page::IDENTITY_POSE),
        };
        let lines = if body.inertia.mass > 0.0 { vec![[[0.0; 3], center]] } else { Vec::new() };
        bodies.push(DrawnBody {
            name: body.name.clone(),
            parent: model.tree().parent(k),
            joint: model.joints()[k].name.clone(),
            lines,
            center,
            mass: body.inertia.mass as f32,
            box_half,
            box_pose,
        });
    }
    let mut kinematics = Kinematics::new(layout);
    let mut drawing = Drawing { bodies, times: Vec::new(), poses: Vec::new(), unit: "m".into() };
    for row in chosen {
        // Rows are states of this model.
        if kinematics.set_position(layout, &row.q).is_err() {
            continue;
        }
        drawing.times.push(row.t);
        for k in 0..model.len() {
            let pose = kinematics.pose(layout, Some(k));
            let Vec3(p) = pose.translation;
            let Quaternion(r) = Quaternion::from_rotation(&pose.rotation);
            drawing.poses.extend(p.iter().chain(&r).map(|x| *x as f32));
        }
    }
    drawing
}
