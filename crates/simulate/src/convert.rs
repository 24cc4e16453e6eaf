//! From a URDF file, or a PDB file with its OpenMM System, to a scene that runs it.

use crate::error::SimulateError;
use phipsi_formats::Report;
use phipsi_formats::system::SystemOptions;
use phipsi_formats::urdf::{UrdfOptions, read_urdf_file};
use phipsi_molecule::read_molecule;
use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Component, Path, PathBuf};

/// Writes a scene that lets the model of a URDF file move for a second from its neutral state, every joint named.
///
/// # Errors
/// [`SimulateError::Scene`] if the URDF cannot be used, [`SimulateError::File`] if the scene exists or cannot be written.
pub fn urdf_to_scene(urdf: &Path, scene: &Path) -> Result<Report, SimulateError> {
    let loaded = read_urdf_file(urdf, &UrdfOptions::default());
    let Some(model) = loaded.value else { return Err(SimulateError::Scene(vec![loaded.report])) };
    let folder = scene.parent().unwrap_or(Path::new(""));
    // A JSON string is a TOML string.
    let text = |s: &str| serde_json::Value::from(s).to_string();
    let mut out = format!("title = {}\n\n[model]\n", text(model.name()));
    let file = relative(urdf, folder).to_string_lossy().replace('\\', "/");
    let _ = writeln!(out, "urdf = {}\nbase = \"fixed\"   # or \"free\"", text(&file));
    let _ = writeln!(out, "gravity = {:?}", model.gravity());
    let _ =
        writeln!(out, "\n[initial]   # rad, m; joints that are not named start at their neutral position");
    if !model.couplings().is_empty() {
        out += "assemble = true   # moves joints that others follow, where the positions do not agree\n";
    }
    for k in model.moving_joints().filter(|&k| model.joints()[k].kind.nv() == 1) {
        let name = text(&model.joints()[k].name);
        let start = model.joints()[k]
            .limits
            .position
            .map_or(0.0, |[lower, upper]| if lower <= upper { 0.0f64.clamp(lower, upper) } else { 0.0 });
        let _ = writeln!(out, "q.{name} = {start:?}");
    }
    out += "\n[integrator]\nt_end = 1.0\nrtol = 1e-9\n\n[record]\nevery = 0.01\n";
    write_new(scene, &out)?;
    Ok(loaded.report)
}

/// Writes a scene of torsion dynamics at constant energy for a PDB file and its System: 10 ps from velocities at 300 K.
///
/// # Errors
/// [`SimulateError::Scene`] if the two cannot be used together, [`SimulateError::File`] if the scene exists or cannot be
/// written.
pub fn molecule_to_scene(pdb: &Path, system: &Path, scene: &Path) -> Result<[Report; 2], SimulateError> {
    let loaded = read_molecule(pdb, system, &SystemOptions::default());
    if loaded.value.is_none() {
        return Err(SimulateError::Scene(loaded.reports.to_vec()));
    }
    let folder = scene.parent().unwrap_or(Path::new(""));
    let name = pdb.file_stem().map_or("molecule".into(), |s| s.to_string_lossy().into_owned());
    let text = |s: &str| serde_json::Value::from(s).to_string();
    let file = |path: &Path| text(&relative(path, folder).to_string_lossy().replace('\\', "/"));
    let out = format!(
        "title = {}\n\n[molecule]\npdb = {}\nsystem = {}\nminimize = true\ntemperature_K = 300\nseed = 1\n\n\
         [integrator]\nt_end = 10   # ps\nstep_fs = 4\n\n[record]\nevery = 0.1\n",
        text(&name),
        file(pdb),
        file(system)
    );
    write_new(scene, &out)?;
    Ok(loaded.reports)
}

/// Writes a file that does not exist yet.
fn write_new(path: &Path, text: &str) -> Result<(), SimulateError> {
    let failed = |e| SimulateError::file(path, e);
    let mut file = OpenOptions::new().write(true).create_new(true).open(path).map_err(failed)?;
    file.write_all(text.as_bytes()).map_err(failed)
}

/// A path as seen from a folder; absolute where there is no relative one.
fn relative(path: &Path, folder: &Path) -> PathBuf {
    let absolute = |p: &Path| std::path::absolute(p).unwrap_or_else(|_| p.to_path_buf());
    let (path, folder) = (absolute(path), absolute(folder));
    let (to, from): (Vec<Component<'_>>, Vec<_>) =
        (path.components().collect(), folder.components().collect());
    let common = to.iter().zip(&from).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return path;
    }
    let up = from[common..].iter().map(|_| Component::ParentDir);
    up.chain(to[common..].iter().copied()).collect()
}
