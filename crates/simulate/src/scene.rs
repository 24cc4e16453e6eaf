//! Scene files: what is simulated, from where, how, and what is recorded.
//!
//! A scene is TOML; angles in rad, everything in SI. Unknown keys are refused with a suggestion, and every problem is
//! reported with its line.
//!
//! | table | keys |
//! |---|---|
//! | `[model]` | `urdf` (relative to the scene), `base` = "fixed" or "free", `gravity`, `mimic` = "closure" or "free", `friction_speed` |
//! | `[molecule]` | instead of a model: `pdb`, `system` (OpenMM's XML), `rigid` = kinds of bonds, `hinges`, `groups`, `temperature_K`, `seed`, `fixman`, `minimize`, `ignore`; times in ps, `step_fs`; in `[integrator]` `inner_steps` and `ensemble` with `friction_per_ps`, `relaxation_ps` or `trajectory_steps` |
//! | `[[molecule.recluster]]` | `time_ps`, `freeze`, `thaw` = kinds of bonds, `thaw_temperature_K`: freeze and thaw during the run |
//! | `[[body]]` | `name`, `inertial` = { `origin`, `mass`, `inertia` = { `ixx` … } }: the URDF's words; or `flexible`, see below |
//! | `[[joint]]` | `name`, `type`, `parent`, `child`, `origin` = { `xyz`, `rpy` }, `axis`, `axis2`, `pitch`, `limit`, `dynamics`, `mimic`, `node` of a flexible parent |
//! | `[[closure]]` | `name`, `kind`, `body_a`, `pose_a` = { `xyz`, `rpy` }, `body_b`, `pose_b`, `length` of a distance, `motion` = { `x`, … `rz`, `distance` }: functions of time |
//! | `[initial]` | `q.JOINT`, `v.JOINT`: a number, or a list for joints with several coordinates; `q.BODY.mode1` for modes; others are neutral; `assemble` = true closes the loops |
//! | `[[motion]]` | `joint`, `component`, and one of `position`, `velocity`, `acceleration`: a function of time that the joint follows |
//! | `[[force]]` | `kind` with its parameters, see below; `name` |
//! | `[joint_stops]` | `restitution`: a number, or { JOINT = number }: limits act as stops |
//! | `[friction]` | `breakaway_ratio`: a number of 1 or more, or { JOINT = number }: breakaway over sliding force of dry friction |
//! | `[[event]]` | `when` = an expression of t, `q.JOINT`, `v.JOINT` and outputs; `direction` = "rising", "falling" or "either"; `action` = "record" or "stop"; `name` |
//! | `[integrator]` | `t_end`; `method` = "auto", "dop853", "tsit5", "rodas4", "rodas5p" with `rtol`, `atol`, `max_step`, or "rk4", "midpoint" with `step`; `estimate`; `form` of forward dynamics |
//! | `[record]` | `every`, s; `checkpoint_s`, wall time between checkpoints (2; 0: after every step) |
//! | `[outputs]` | NAME = { … }, see below |
//! | `[reference]` | `source`, NAME = known value of an output at the end |
//!
//! Forces: `torque` (`joint`, `component`, `value`), `servo` (`joint`, `target`, `stiffness`, `damping`, `integral`, `limit`),
//! `spring` and `damper` at a joint (`joint`, `stiffness`, `damping`, `rest`) or between points (`body_a`, `point_a`,
//! `body_b`, `point_b`, `stiffness`, `damping`, `rest_length`), `wrench` (`body`, `point`, `axes` = "body" or "world",
//! `moment`, `force`), `thruster` (`body`, `point`, `direction`, `thrust`, `on` = spans of time, `specific_impulse`),
//! `central_gravity` (`mu`, `center`). `value`, `thrust`, `target` and the components of `moment` and `force` are functions of time: a number, an
//! expression in t such as "0.3*sin(2*pi*t)", or a table [[time, value], …].
//!
//! Beams: `length`, `mass_per_length`, `bending_stiffness` = [along y, along z], `torsional_stiffness`, `polar_inertia`,
//! `axial_stiffness`, `bending` = [modes along y, along z], `torsion`, `axial`, `modes` = "interface", "clamped_free" or "pinned",
//! `stiffened`, `damping` (C = damping K, s), `nodes` = [{ `name`, `x` }] besides `tip`, `held_at`.
//!
//! Finite elements: `mass`, `stiffness` (files in Matrix Market's format, free elements), `nodes` (a file: label, x, y, z), `inboard`
//! = labels that the joint holds, `interface` = labels where others attach, `modes` = how many with clamped interfaces (6) or
//! `shapes` = a file with a column for every mode; `damping`.
//!
//! Shape integrals: `integrals` = { `modes`, `mass`, `first_moment`, `second_moment`, `displacement`, `moment` = [{ `mode`, `matrix` }],
//! `product` = [{ `modes`, `matrix` }], `rotary`, `rotary_coupling`, `rotary_modal`, `stiffening_displacement` = [{ `modes`, `vector` }],
//! `stiffening_moment` = [{ `modes`, `matrix` }] }, `modal_stiffness`, `modal_damping`, `nodes` = [{ `name`, `position`, `displacement`,
//! `rotation`, `quadratic` = [{ `modes`, `vector` }] }], `held_at`.
//!
//! Outputs: `joint` (with `component`, `of` = "q" or "v"), `body` with `mode` and `of`, `joints` (a sum, with `factors`), `body` with `point`, `axis` and
//! `of` = "position" or "velocity", `body_a` … `point_b` (a distance), `energy` = "kinetic", "potential" or "total".

mod behavior;
mod closure;
mod event;
mod flexible;
mod force;
mod mechanism;
mod molecule;
mod motion;
mod output;
mod recluster;
mod settings;
mod signal;
mod start;
mod tree;

pub use closure::DIRECTIONS;
pub use signal::{CourseError, course};

use crate::error::SimulateError;
use crate::simulation::{Choice, Simulation};
use phipsi_formats::{Note, Problem, Report};
use phipsi_model::State;
use phipsi_motion::{MotionError, Prescription, Scheme};
use phipsi_recursion::{DynamicsError, singular_hinges};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tree::Table;

/// Largest scene file that is read, bytes.
const LARGEST_FILE: u64 = 64 << 20;

/// A scene that can be run.
pub struct Scene {
    /// What runs.
    pub simulation: Simulation,
    /// The scene's text as read.
    pub text: String,
    /// Overrides of the command line.
    pub overrides: Vec<String>,
    /// Files that it names.
    pub files: Vec<SceneFile>,
    /// Wall time between checkpoints, s.
    pub checkpoint_s: f64,
    /// Keys of `[integrator]` that the scene and its overrides have.
    pub integrator_keys: Vec<String>,
    /// Report on the scene, then on each file.
    pub reports: Vec<Report>,
}

/// A file that a scene names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneFile {
    /// The key that names it: `model.urdf`.
    pub key: String,
    /// Where it was found.
    pub path: PathBuf,
}

/// Reads a scene file; `overrides` are `key=value`.
///
/// # Errors
/// [`SimulateError::Scene`] with the reports on everything that was read.
pub fn load(path: &Path, overrides: &[String]) -> Result<Scene, SimulateError> {
    let source = path.display().to_string();
    let failed = |found: String, required: &str, remedy: &str| {
        let mut report = Report::new(&source);
        report.errors.push(Problem::new(None, "file", found, required, remedy));
        SimulateError::Scene(vec![report])
    };
    let bytes = match std::fs::metadata(path) {
        Ok(m) if m.len() > LARGEST_FILE => {
            return Err(failed(
                format!("{} bytes", m.len()),
                "at most 64 MiB",
                "see whether this is a scene",
            ));
        }
        _ => std::fs::read(path)
            .map_err(|e| failed(e.to_string(), "a readable file", "check the path and its permissions"))?,
    };
    let text = String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        failed(format!("byte {at} is not UTF-8"), "text in UTF-8", "convert the file to UTF-8")
    })?;
    let name = path.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned());
    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    parse(text, &name, &source, &folder, overrides)
}

/// Reads a scene's text. `name` is that of the scene, `source` that of the file in reports; files that the scene names are
/// relative to `folder`.
///
/// # Errors
/// As [`load`].
pub fn parse(
    text: String,
    name: &str,
    source: &str,
    folder: &Path,
    overrides: &[String],
) -> Result<Scene, SimulateError> {
    let mut report = Report::new(source);
    let read = read(&text, name, folder, overrides, &mut report);
    let (simulation, files, (checkpoint_s, integrator_keys), mut reports) = match read {
        Ok((simulation, files, rest, reports)) if report.errors.is_empty() => {
            (simulation, files, rest, reports)
        }
        Ok((.., mut reports)) | Err(mut reports) => {
            reports.insert(0, report);
            return Err(SimulateError::Scene(reports));
        }
    };
    reports.insert(0, report);
    let overrides = overrides.to_vec();
    Ok(Scene { simulation, text, overrides, files, checkpoint_s, integrator_keys, reports })
}

type Read = (Simulation, Vec<SceneFile>, (f64, Vec<String>), Vec<Report>);

fn read(
    text: &str,
    name: &str,
    folder: &Path,
    overrides: &[String],
    report: &mut Report,
) -> Result<Read, Vec<Report>> {
    let Some(mut root) = tree::parse(text, report) else { return Err(Vec::new()) };
    for assignment in overrides {
        if let Err(problem) = tree::set(&mut root, assignment) {
            report.errors.push(problem);
        }
    }
    let Some(mut scene) = Table::new(&root, "scene", report) else { return Err(Vec::new()) };
    let title = scene.text("title", report).map(str::to_string);
    let is_molecule = scene.has("molecule");
    let end = settings::end(&root);
    let mechanism = match is_molecule {
        true => molecule::read(&mut scene, folder, settings::inner_steps(&root), report)?,
        false => mechanism::read(&mut scene, folder, end, report)?,
    };
    let mechanism::Mechanism { model, files, reports, friction_speed, moving, molecule } = mechanism;
    for violation in singular_hinges(&model) {
        let place = violation.subject.to_string();
        report.errors.push(Problem::new(None, place, violation.found, violation.required, violation.remedy));
    }
    let neutral = State { q: model.neutral(), v: vec![0.0; model.nv()], t: 0.0 };
    let given = molecule.as_ref().map_or(neutral, |m| m.start.clone());
    let start = settings::initial(&mut scene, &model, given, report);
    let mut forces = force::read(&mut scene, &model, end, report);
    let joints = motion::read(&mut scene, &model, end, report);
    let breaks: usize = forces.iter().map(|f| f.breaks().len()).sum();
    let behavior = behavior::read(&mut scene, &model, friction_speed, report);
    let settings = settings::integrator(&mut scene, breaks, is_molecule, report);
    let record = settings.as_ref().map(|s| settings::record(&mut scene, s, report));
    let outputs = output::read(&mut scene, &model, report);
    let events = event::read(&mut scene, &model, &outputs, report);
    let (known, known_source) = output::reference(&mut scene, &outputs, report);
    let molecule = molecule.map(|m| {
        forces.extend(m.forces);
        let mut molecule = m.molecule;
        molecule.ensemble = settings.as_ref().map_or(molecule.ensemble, |s| s.ensemble);
        if molecule.has_bath() && molecule.temperature.is_none_or(|t| t == 0.0) {
            let found =
                format!("ensemble = \"{}\" without a temperature above zero", molecule.ensemble.word());
            let required = "the temperature of the bath";
            let remedy = "set `temperature_K` in [molecule]";
            report.errors.push(Problem::new(None, "integrator", found, required, remedy));
        }
        if let (true, Some(schedule)) = (molecule.has_bath(), &mut molecule.schedule) {
            // What thaws in a bath has its temperature.
            for change in &mut Arc::make_mut(schedule).changes {
                change.thaw_temperature = change.thaw_temperature.or(molecule.temperature);
            }
        }
        if let (Some(schedule), Some(settings)) = (&molecule.schedule, &settings) {
            recluster::check(&mut scene, schedule, settings, report);
        }
        molecule
    });
    let present = [
        "model",
        "molecule",
        "body",
        "joint",
        "closure",
        "initial",
        "force",
        "motion",
        "joint_stops",
        "friction",
        "event",
        "integrator",
        "record",
        "outputs",
        "reference",
    ];
    present.iter().for_each(|key| _ = scene.get(key));
    scene.finish(report);
    let (Some(settings), Some((every, checkpoint_s))) = (settings, record) else { return Err(reports) };
    let prescription = Prescription { joints, closures: moving };
    let created = Simulation::prescribed(&model, forces, &prescription, settings.t_end, behavior);
    let mut simulation = match created {
        Ok(simulation) => simulation.with_events(events),
        Err(e) => {
            let (required, remedy) = match e {
                MotionError::Switch { .. } => (
                    "stops with room between them, and friction of 0 or more",
                    "correct the joint, or name those with stops in [joint_stops]",
                ),
                _ => (
                    "closures, and couplings of joints with one axis",
                    "remove the closure, or set mimic = \"free\" in [model]",
                ),
            };
            report.errors.push(Problem::new(None, "model", e.to_string(), required, remedy));
            return Err(reports);
        }
    };
    for line in &simulation.approximated {
        report.approximated.push(Note::new(None, "model", line.clone()));
    }
    let used = format!(
        "{} bodies, {} degrees of freedom, {} forces",
        model.len(),
        model.nv(),
        simulation.dynamics.forces().len()
    );
    report.used.insert(0, Note::new(None, "scene", used));
    simulation.name = title.unwrap_or_else(|| name.into());
    simulation.start = start.state.clone();
    simulation.molecule = molecule;
    simulation.choice = settings.choice;
    let is_constrained = simulation.dynamics.is_constrained();
    match simulation.choice.method {
        Scheme::Midpoint { .. } if simulation.has_bath() && !simulation.dynamics.user_events().is_empty() => {
            let found = "events with a heat bath, whose kicks leave no passage to look for";
            let remedy = "remove [[event]], or set ensemble = \"nve\"";
            report.errors.push(Problem::new(None, "integrator", found, "constant energy", remedy));
        }
        Scheme::Midpoint { .. } if simulation.dynamics.is_switching() => {
            let found = "method = \"midpoint\" with joint stops or dry friction";
            let (required, remedy) =
                ("an adaptive method or \"rk4\"", "use \"dop853\", \"tsit5\" or \"rodas5p\"");
            report.errors.push(Problem::new(None, "integrator", found, required, remedy));
        }
        Scheme::Midpoint { .. } if simulation.dynamics.is_prescribed() => {
            let found = "method = \"midpoint\" with prescribed motions";
            let (required, remedy) = ("an explicit method", "use \"dop853\", \"tsit5\" or \"rk4\"");
            report.errors.push(Problem::new(None, "integrator", found, required, remedy));
        }
        Scheme::Midpoint { .. } => simulation.dynamics.leave_out_integrals(),
        Scheme::Explicit(_) => {}
    }
    if let Err(e) = simulation.dynamics.set_form(settings.form) {
        let (of, required, remedy) = match e {
            MotionError::Dynamics(DynamicsError::Flexible { .. }) => {
                (" of flexible bodies", "the mixed form", "remove `form`")
            }
            _ => ("", "\"auto\", \"plain\" or \"square_root\"", "use one of these"),
        };
        let found = format!("form = \"{}\" with closures or prescribed motions{of}", settings.form.name());
        report.errors.push(Problem::new(None, "integrator", found, required, remedy));
    }
    if report.errors.is_empty() && is_constrained {
        start::settle(&mut simulation, &start, report);
    }
    simulation.tolerances = settings.tolerances;
    simulation.estimate = settings.estimate;
    if let Some(warning) = simulation.form_warning() {
        report.warnings.push(warning);
    }
    simulation.every = every;
    if settings.automatic {
        simulation.choice = Choice::settled(&mut simulation);
    }
    simulation.outputs = outputs;
    simulation.known = known;
    simulation.known_source = known_source;
    Ok((simulation, files, (checkpoint_s, settings.keys), reports))
}
