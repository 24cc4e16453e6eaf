//! What a file contains, what of it is used, and everything that is wrong with it.

use crate::error::SimulateError;
use crate::folder::results::Plan;
use crate::scene;
use phipsi_formats::urdf::{UrdfOptions, read_urdf_file};
use phipsi_formats::{Note, Problem, Report};
use phipsi_model::Model;
use phipsi_recursion::singular_hinges;
use serde_json::{Value, json};
use std::fmt;
use std::path::Path;

/// The result of a check.
#[derive(Clone, Debug)]
pub struct Checked {
    /// The file.
    pub file: String,
    /// Reports on it and on the files that it names.
    pub reports: Vec<Report>,
    /// What it holds, where it can be used.
    pub contents: Option<Contents>,
}

/// A model in numbers, and what a scene does with it.
#[derive(Clone, Debug)]
pub struct Contents {
    /// Name.
    pub name: String,
    /// Number of bodies.
    pub bodies: usize,
    /// Number of position coordinates.
    pub nq: usize,
    /// Number of degrees of freedom.
    pub nv: usize,
    /// Names of the moving joints in the order of v.
    pub joint_names: Vec<String>,
    /// Mass of all bodies, kg.
    pub total_mass: f64,
    /// Method and what is left out, for a scene.
    pub plan: Option<Plan>,
}

impl Contents {
    fn new(model: &Model, plan: Option<Plan>) -> Self {
        Contents {
            name: model.name().into(),
            bodies: model.len(),
            nq: model.nq(),
            nv: model.nv(),
            joint_names: model.moving_joints().map(|k| model.joints()[k].name.clone()).collect(),
            total_mass: model.total_mass(),
            plan,
        }
    }
}

/// Checks a URDF model (`.urdf`, `.xml`) or a scene (`.toml`).
pub fn check_file(path: &Path) -> Checked {
    let file = path.display().to_string();
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        Some("toml") => check_scene(path, file),
        Some("urdf" | "xml") => check_urdf(path, file),
        _ => {
            let mut report = Report::new(&file);
            let required = "a URDF model (.urdf, .xml) or a scene (.toml)";
            report.errors.push(Problem::new(
                None,
                "file",
                "an unknown kind of file",
                required,
                "rename the file",
            ));
            Checked { file, reports: vec![report], contents: None }
        }
    }
}

fn check_scene(path: &Path, file: String) -> Checked {
    match scene::load(path, &[]) {
        Ok(scene) => {
            let plan = Plan::new(&scene.simulation);
            let contents = Some(Contents::new(scene.simulation.model(), Some(plan)));
            Checked { file, reports: scene.reports, contents }
        }
        Err(SimulateError::Scene(reports)) => Checked { file, reports, contents: None },
        Err(e) => {
            let mut report = Report::new(&file);
            report.errors.push(Problem::new(
                None,
                "scene",
                e.to_string(),
                "a scene that can run",
                "correct it",
            ));
            Checked { file, reports: vec![report], contents: None }
        }
    }
}

fn check_urdf(path: &Path, file: String) -> Checked {
    let loaded = read_urdf_file(path, &UrdfOptions::default());
    let mut report = loaded.report;
    let contents = loaded.value.map(|model| {
        for v in singular_hinges(&model) {
            report.errors.push(Problem::new(None, v.subject.to_string(), v.found, v.required, v.remedy));
        }
        if let Some(c) = model.refused_closure() {
            let what = format!(
                "mimic of joint `{}`: a closure, whose dynamics does not run yet; `mimic = \"free\"` drops it",
                c.source
            );
            report.ignored.push(Note::new(None, format!("joint `{}`", c.joint), what));
        }
        Contents::new(&model, None)
    });
    let contents = if report.errors.is_empty() { contents } else { None };
    Checked { file, reports: vec![report], contents }
}

impl Checked {
    /// True if the file can be used; where `strict`, without warnings.
    pub fn is_ok(&self, strict: bool) -> bool {
        self.contents.is_some() && self.reports.iter().all(|r| r.is_ok(strict))
    }
    /// The check as JSON.
    pub fn to_json(&self) -> Value {
        let problems = |list: &[Problem]| -> Vec<Value> {
            list.iter()
                .map(|p| {
                    json!({"line": p.line, "place": p.place, "found": p.found, "required": p.required,
                           "remedy": p.remedy})
                })
                .collect()
        };
        let notes = |list: &[Note]| -> Vec<Value> {
            list.iter().map(|n| json!({"line": n.line, "place": n.place, "what": n.what})).collect()
        };
        let reports: Vec<Value> = self
            .reports
            .iter()
            .map(|r| {
                json!({"file": r.source, "errors": problems(&r.errors), "warnings": problems(&r.warnings),
                       "used": notes(&r.used), "approximated": notes(&r.approximated), "ignored": notes(&r.ignored)})
            })
            .collect();
        let contents = self.contents.as_ref().map(|c| {
            json!({"name": c.name, "bodies": c.bodies, "nq": c.nq, "nv": c.nv, "joint_names": c.joint_names,
                   "total_mass": c.total_mass, "plan": c.plan})
        });
        json!({"file": self.file, "usable": self.contents.is_some(), "contents": contents, "reports": reports})
    }
}

impl fmt::Display for Checked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for report in &self.reports {
            write!(f, "{report}")?;
        }
        let Some(c) = &self.contents else { return Ok(()) };
        writeln!(
            f,
            "model `{}`: {} bodies, {} degrees of freedom, {} kg",
            c.name, c.bodies, c.nv, c.total_mass
        )?;
        writeln!(f, "joints: {}", c.joint_names.join(", "))?;
        if let Some(plan) = &c.plan {
            writeln!(f, "method: {} ({})", plan.describe(), plan.why)?;
            writeln!(f, "left out:")?;
            for line in &plan.left_out {
                writeln!(f, "  {line}")?;
            }
        }
        Ok(())
    }
}
