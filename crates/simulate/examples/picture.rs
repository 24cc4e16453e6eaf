//! A static picture of a run: several moments of its motion in one SVG file.
//!
//! `cargo run --example picture -p phipsi-simulate -- runs/satellite_arm-001 picture.svg`

use phipsi_simulate::SimulateError;
use phipsi_simulate::folder::RunFolder;
use phipsi_simulate::folder::table::{Columns, read_rows};
use phipsi_simulate::page::{View, snapshot_svg};
use phipsi_simulate::run_page::drawing;
use std::path::Path;

fn main() -> Result<(), SimulateError> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, picture] = &arguments[..] else {
        eprintln!("usage: picture RUN_FOLDER PICTURE.svg");
        std::process::exit(2);
    };
    let run = RunFolder::open(Path::new(folder), None)?;
    let simulation = &run.scene().simulation;
    let rows = read_rows(&run.path().join("trajectory.csv"), &Columns::new(simulation), u64::MAX)?;
    let drawing = drawing(simulation, &rows);
    let last = drawing.times.len().saturating_sub(1);
    // The satellite slews during the first half of its run; a molecule wanders all the time.
    let parts = match simulation.molecule {
        Some(_) => [0.0, 0.05, 0.1, 0.15, 0.2],
        None => [0.0, 0.15, 0.25, 0.35, 1.0],
    };
    let frames = parts.map(|part| (part * last as f64) as usize);
    let width = if simulation.molecule.is_some() { 420.0 } else { 800.0 };
    let view = View { azimuth: -0.9, elevation: 0.35, width, height: 420.0, boxes: true };
    let picture = Path::new(picture);
    std::fs::write(picture, snapshot_svg(&drawing, &frames, &view))
        .map_err(|e| SimulateError::file(picture, e))
}
