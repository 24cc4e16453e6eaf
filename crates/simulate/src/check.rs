//! What a file contains, what of it is used, and everything that is wrong with it.

use crate::error::SimulateError;
use crate::folder::results::Plan;
use crate::scene;
use crate::simulation::Simulation;
use phipsi_formats::pdb::read_pdb_file;
use phipsi_formats::system::{System, SystemOptions, read_system_file};
use phipsi_formats::urdf::{UrdfOptions, read_urdf_file};
use phipsi_formats::{Loaded, Note, Problem, Report};
use phipsi_model::Model;
use phipsi_motion::System as _;
use phipsi_recursion::singular_hinges;
use serde_json::{Value, json};
use std::fmt;
use std::io::Read;
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
    /// True for a file that is used, but is no model by itself: a PDB, a System.
    pub is_part: bool,
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
    /// Loops; `None` for a tree.
    pub loops: Option<Loops>,
    /// Method and what is left out, for a scene.
    pub plan: Option<Plan>,
}

/// The closures of a model.
#[derive(Clone, Debug)]
pub struct Loops {
    /// Names of closures, and of joints that follow others, with the rows of each.
    pub closures: Vec<(String, usize)>,
    /// Independent rows at the start of a scene.
    pub rank: Option<usize>,
    /// Names of the joints whose motion is given.
    pub prescribed: Vec<String>,
}

impl Loops {
    fn of_model(model: &Model) -> Option<Self> {
        let closures = model.closures().iter().map(|c| (c.name.clone(), c.kind.rows()));
        let couplings = model.couplings().iter().map(|c| (c.joint.clone(), 1));
        let closures: Vec<_> = closures.chain(couplings).collect();
        (!closures.is_empty()).then_some(Loops { closures, rank: None, prescribed: Vec::new() })
    }
    fn of_scene(simulation: &mut Simulation) -> Option<Self> {
        let (dynamics, start) = (&mut simulation.dynamics, &simulation.start);
        if !dynamics.is_constrained() {
            return None;
        }
        let rank = dynamics.rank(start.t, &start.q, &start.v).ok();
        let model = dynamics.model();
        let active = dynamics.active().into_iter().enumerate().filter(|(_, active)| *active);
        let prescribed =
            active.map(|(i, _)| model.joints()[model.joint_of_velocity(i).0].name.clone()).collect();
        Some(Loops { closures: dynamics.loops(), rank, prescribed })
    }
    fn rows(&self) -> usize {
        self.closures.iter().map(|(_, rows)| rows).sum()
    }
}

impl Contents {
    fn new(model: &Model, loops: Option<Loops>, plan: Option<Plan>) -> Self {
        Contents {
            name: model.name().into(),
            bodies: model.len(),
            nq: model.nq(),
            nv: model.nv(),
            joint_names: model.moving_joints().map(|k| model.joints()[k].name.clone()).collect(),
            total_mass: model.total_mass(),
            loops,
            plan,
        }
    }
}

/// Checks a URDF model (`.urdf`, `.xml`), a scene (`.toml`), or a part of a molecule (`.pdb`; `.xml`: an OpenMM System).
pub fn check_file(path: &Path) -> Checked {
    let file = path.display().to_string();
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        Some("toml") => check_scene(path, file),
        Some("pdb" | "ent") => check_part(file, read_pdb_file(path), |_| None),
        Some("xml") if is_system(path) => {
            check_part(file, read_system_file(path, &SystemOptions::default()), describe_system)
        }
        Some("urdf" | "xml") => check_urdf(path, file),
        _ => {
            let mut report = Report::new(&file);
            let required =
                "a URDF model (.urdf), a scene (.toml), a PDB file (.pdb) or an OpenMM System (.xml)";
            report.errors.push(Problem::new(
                None,
                "file",
                "an unknown kind of file",
                required,
                "rename the file",
            ));
            Checked { file, reports: vec![report], contents: None, is_part: false }
        }
    }
}

fn check_scene(path: &Path, file: String) -> Checked {
    match scene::load(path, &[]) {
        Ok(mut scene) => {
            let plan = Plan::new(&scene.simulation);
            let loops = Loops::of_scene(&mut scene.simulation);
            let contents = Some(Contents::new(scene.simulation.model(), loops, Some(plan)));
            Checked { file, reports: scene.reports, contents, is_part: false }
        }
        Err(SimulateError::Scene(reports)) => Checked { file, reports, contents: None, is_part: false },
        Err(e) => {
            let mut report = Report::new(&file);
            report.errors.push(Problem::new(
                None,
                "scene",
                e.to_string(),
                "a scene that can run",
                "correct it",
            ));
            Checked { file, reports: vec![report], contents: None, is_part: false }
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
        Contents::new(&model, Loops::of_model(&model), None)
    });
    let contents = if report.errors.is_empty() { contents } else { None };
    Checked { file, reports: vec![report], contents, is_part: false }
}

/// A file that is a part of a molecule.
fn check_part<T>(file: String, loaded: Loaded<T>, describe: impl Fn(&T) -> Option<String>) -> Checked {
    let mut report = loaded.report;
    if let Some(what) = loaded.value.as_ref().and_then(describe) {
        report.used.insert(0, Note::new(None, "file", what));
    }
    Checked { file, reports: vec![report], contents: None, is_part: loaded.value.is_some() }
}

fn describe_system(system: &System) -> Option<String> {
    let forces: Vec<&str> = system.forces.iter().map(|f| f.name.as_str()).collect();
    let mass: f64 = system.masses.iter().sum();
    Some(format!("{mass:.3} Da, {} constraints; forces: {}", system.constraints.len(), forces.join(", ")))
}

/// True if the beginning of an XML file is that of an OpenMM System.
fn is_system(path: &Path) -> bool {
    let mut start = Vec::new();
    let read = std::fs::File::open(path).and_then(|f| f.take(4096).read_to_end(&mut start));
    read.is_ok() && String::from_utf8_lossy(&start).contains("<System")
}

impl Checked {
    /// True if the file can be used; where `strict`, without warnings.
    pub fn is_ok(&self, strict: bool) -> bool {
        (self.contents.is_some() || self.is_part) && self.reports.iter().all(|r| r.is_ok(strict))
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
            let loops = c.loops.as_ref().map(|l| {
                let closures: Vec<Value> =
                    l.closures.iter().map(|(name, rows)| json!({"name": name, "rows": rows})).collect();
                json!({"closures": closures, "rows": l.rows(), "rank": l.rank, "prescribed": l.prescribed})
            });
            json!({"name": c.name, "bodies": c.bodies, "nq": c.nq, "nv": c.nv, "joint_names": c.joint_names,
                   "total_mass": c.total_mass, "loops": loops, "plan": c.plan})
        });
        json!({"file": self.file, "usable": self.is_ok(false), "contents": contents, "reports": reports})
    }
}

impl fmt::Display for Checked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for report in &self.reports {
            write!(f, "{report}")?;
        }
        let Some(c) = &self.contents else { return Ok(()) };
        let unit = if c.plan.as_ref().is_some_and(|p| p.time_unit == "ps") { "Da" } else { "kg" };
        writeln!(
            f,
            "model `{}`: {} bodies, {} degrees of freedom, {} {}",
            c.name, c.bodies, c.nv, c.total_mass, unit
        )?;
        writeln!(f, "joints: {}", c.joint_names.join(", "))?;
        if let Some(loops) = &c.loops {
            if !loops.closures.is_empty() {
                let rows = |(name, rows): &(String, usize)| format!("{name} ({rows})");
                let names: Vec<String> = loops.closures.iter().map(rows).collect();
                let rank = loops.rank.map_or(String::new(), |r| format!(", {r} independent at the start"));
                writeln!(f, "closures (rows): {}; {} rows{rank}", names.join(", "), loops.rows())?;
            }
            if !loops.prescribed.is_empty() {
                writeln!(f, "prescribed: {}", loops.prescribed.join(", "))?;
            }
        }
        if let Some(plan) = &c.plan {
            writeln!(f, "method: {} ({})", plan.describe(), plan.why)?;
            if let Some(form) = plan.describe_form() {
                writeln!(f, "forward dynamics: {form}")?;
            }
            if let Some([ensemble, distribution]) = plan.describe_ensemble() {
                writeln!(f, "ensemble: {ensemble}")?;
                writeln!(f, "distribution: {distribution}")?;
            }
            if !plan.changes.is_empty() {
                writeln!(f, "freeze and thaw:")?;
                plan.changes.iter().try_for_each(|line| writeln!(f, "  {line}"))?;
            }
            writeln!(f, "left out:")?;
            for line in &plan.left_out {
                writeln!(f, "  {line}")?;
            }
        }
        Ok(())
    }
}
