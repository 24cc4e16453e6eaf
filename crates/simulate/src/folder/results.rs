//! `run.json`: what a run was made from, what it does, and what it came to.

use super::inputs::Input;
use super::summary::short;
use crate::drift::drift;
use crate::event_record::EventRecord;
use crate::level::instruction_level;
use crate::recluster::ChangeRecord;
use crate::record::Row;
use crate::run::Summary;
use crate::scene::Scene;
use crate::simulation::{Simulation, method_name};
use phipsi_motion::Scheme;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Most events that are listed.
const MOST_EVENTS: usize = 1000;

/// How far a run has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// It runs, or was killed: its checkpoint continues it.
    Running,
    /// It was interrupted: its checkpoint continues it.
    Interrupted,
    /// It has ended.
    Finished,
    /// It stopped at an error.
    Failed,
}

/// The contents of `run.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunFile {
    /// How far it has come.
    pub status: Status,
    /// Why it stopped, if at an error.
    pub error: Option<String>,
    /// Name of the scene's file.
    pub scene: String,
    /// Title of the scene.
    pub title: String,
    /// Version of phipsi that began it.
    pub version: String,
    /// Instruction level on which it began.
    pub instruction_level: String,
    /// Seed of random numbers; `None`: none are used.
    pub seed: Option<u64>,
    /// Inputs; the scene first.
    pub inputs: Vec<Input>,
    /// Overrides of the command line.
    pub overrides: Vec<String>,
    /// Wall time between checkpoints, s.
    pub checkpoint_s: f64,
    /// Method and what is left out.
    pub plan: Plan,
    /// What was replaced by something simpler.
    pub approximated: Vec<String>,
    /// What is probably wrong with the inputs, and limits that were passed.
    pub warnings: Vec<String>,
    /// What it came to; `None` before its end.
    pub results: Option<Results>,
}

/// Method and what is left out.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Plan {
    /// Integration method.
    pub method: String,
    /// Why this one.
    pub why: String,
    /// Relative tolerance of an adaptive method.
    pub rtol: Option<f64>,
    /// Absolute tolerance of an adaptive method.
    pub atol: Option<f64>,
    /// Step of a fixed one, s.
    pub step: Option<f64>,
    /// End.
    pub t_end: f64,
    /// Unit of time: "s", or "ps" for a molecule.
    pub time_unit: String,
    /// The form of forward dynamics, of a method that has accelerations.
    #[serde(default)]
    pub form: Option<String>,
    /// Why this one.
    #[serde(default)]
    pub form_why: Option<String>,
    /// The ensemble of a molecule.
    #[serde(default)]
    pub ensemble: Option<String>,
    /// The distribution of a molecule's configurations.
    #[serde(default)]
    pub distribution: Option<String>,
    /// Degrees of freedom of a molecule that carry its temperature.
    #[serde(default)]
    pub degrees_of_freedom: Option<usize>,
    /// Steps with bonds, angles and torsions in a step with pairs, of a molecule.
    #[serde(default)]
    pub inner_steps: Option<usize>,
    /// Freeze and thaw of a molecule: when, what, and the degrees of freedom from then on.
    #[serde(default)]
    pub changes: Vec<String>,
    /// What the scene does not need.
    pub left_out: Vec<String>,
}

/// What a run came to. `None` in an optional field: the scene has no such thing, or it is not known.
#[allow(non_snake_case)] // kelvin
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Results {
    /// Names of the moving joints in the order of v.
    pub joint_names: Vec<String>,
    /// Time, q and v at the end.
    #[serde(rename = "final")]
    pub end: End,
    /// Outputs at the end.
    pub outputs: Map<String, Value>,
    /// Accepted steps.
    pub steps: u64,
    /// Rejected steps.
    pub rejected: u64,
    /// Evaluations of the equations of motion.
    pub evaluations: u64,
    /// Wall time, s.
    pub wall_s: f64,
    /// Estimated error at the end.
    pub error_estimate: Option<Estimate>,
    /// Relative imbalance of energy.
    pub energy_error: f64,
    /// Relative imbalances of momentum.
    pub momentum_error: Option<MomentumError>,
    /// Straight line through the energy, for a symplectic method.
    pub drift: Option<EnergyDrift>,
    /// Mean temperature of a molecule, K: 2⟨kinetic energy⟩/(degrees of freedom · k).
    pub temperature_K: Option<f64>,
    /// Word of a molecule's ensemble: nve, langevin, nose_hoover, hmc.
    #[serde(default)]
    pub ensemble: Option<String>,
    /// Word of the distribution that is sampled: rigid, stiff limit.
    #[serde(default)]
    pub distribution: Option<String>,
    /// Fraction of accepted Monte Carlo trajectories.
    #[serde(default)]
    pub acceptance: Option<f64>,
    /// Refused trajectories or drifts of a bath.
    #[serde(default)]
    pub refused: Option<u64>,
    /// Largest residuals of closures.
    pub closure_residual: Option<ClosureResidual>,
    /// Kinetic energy that projections onto the closures took, J.
    #[serde(default)]
    pub energy_removed: Option<f64>,
    /// Largest relative error of outputs with known values.
    pub reference_error: Option<f64>,
    /// Freeze and thaw of a molecule, with the kinetic energies of each change.
    #[serde(default)]
    pub changes: Vec<ChangeRecord>,
    /// Events, impacts, stick and slip in the order of time: the first ones, at most 1000.
    #[serde(default)]
    pub events: Vec<EventRecord>,
    /// All of them.
    #[serde(default)]
    pub event_count: usize,
    /// The event that ended the run.
    #[serde(default)]
    pub ended_by: Option<String>,
}

/// A state.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct End {
    /// Time, s.
    pub t: f64,
    /// Position coordinates.
    pub q: Vec<f64>,
    /// Velocities.
    pub v: Vec<f64>,
}

/// An estimated error.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Estimate {
    /// Of q, rad or m.
    pub q: Option<f64>,
    /// Of v.
    pub v: Option<f64>,
    /// Time up to which it was small, where q and v are null.
    pub horizon: Option<f64>,
    /// How it was obtained.
    pub how: String,
    /// Evaluations it took.
    pub evaluations: u64,
}

/// Straight line through the total energy, less work, at the recorded instants; kJ/mol and ps for molecules, else J and s.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EnergyDrift {
    /// Energy per time, of the whole system.
    pub slope: f64,
    /// Its standard error.
    pub error: f64,
    /// Root mean square about the line.
    pub noise: f64,
    /// Degrees of freedom.
    pub degrees_of_freedom: usize,
}

/// Largest residuals of closures at the ends of steps.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ClosureResidual {
    /// Of positions, m or rad.
    pub position: f64,
    /// Of velocities, m/s or rad/s.
    pub velocity: f64,
}

/// Relative imbalances of momentum.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MomentumError {
    /// Of linear momentum.
    pub linear: f64,
    /// Of angular momentum.
    pub angular: f64,
}

impl RunFile {
    /// Of a run that begins.
    pub fn begin(scene: &Scene, inputs: Vec<Input>, scene_path: &Path) -> Self {
        let simulation = &scene.simulation;
        let warnings = scene.reports.iter().flat_map(|r| {
            r.warnings.iter().map(|p| {
                let line = p.line.map_or(String::new(), |line| format!(":{line}"));
                format!("{}{line}: {}: {}; {}", r.source, p.place, p.found, p.remedy)
            })
        });
        let approximated = scene
            .reports
            .iter()
            .flat_map(|r| r.approximated.iter().map(|n| format!("{}: {}", n.place, n.what)));
        RunFile {
            status: Status::Running,
            error: None,
            scene: scene_path.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned()),
            title: simulation.name.clone(),
            version: env!("CARGO_PKG_VERSION").into(),
            instruction_level: instruction_level(),
            seed: simulation.molecule.as_ref().map(|m| m.seed),
            inputs,
            overrides: scene.overrides.clone(),
            checkpoint_s: scene.checkpoint_s,
            plan: Plan::new(simulation),
            approximated: approximated.collect(),
            warnings: warnings.collect(),
            results: None,
        }
    }
    /// Puts in what a run came to.
    pub fn complete(&mut self, simulation: &Simulation, summary: &Summary, rows: &[Row]) {
        self.status = if summary.finished { Status::Finished } else { Status::Interrupted };
        self.error = None;
        self.warnings.retain(|w| !summary.limits.iter().any(|l| *w == l.describe()));
        self.warnings.extend(summary.limits.iter().map(|l| l.describe()));
        self.results = Some(Results::new(simulation, summary, rows));
    }
    /// The value that `run --json` prints.
    pub fn to_json(&self, folder: &Path) -> Value {
        let mut value = json!({ "scene": self.scene });
        if let (Value::Object(all), Some(results)) = (&mut value, &self.results) {
            if let Ok(Value::Object(own)) = serde_json::to_value(results) {
                all.extend(own);
            }
            all.insert("left_out".into(), json!(self.plan.left_out));
            all.insert("approximated".into(), json!(self.approximated));
            all.insert("warnings".into(), json!(self.warnings));
            all.insert("finished".into(), json!(self.status == Status::Finished));
            all.insert("run_folder".into(), json!(folder.display().to_string()));
        }
        value
    }
}

impl Plan {
    /// Of a simulation.
    pub fn new(simulation: &Simulation) -> Self {
        let method = simulation.choice.method;
        let step = method.fixed_step();
        let (form, form_why) = simulation.form().map(|(form, why)| (form.into(), why)).unzip();
        let tolerance = |x: f64| if step.is_none() { Some(x) } else { None };
        Plan {
            method: method_name(method).into(),
            why: simulation.choice.why.clone(),
            rtol: tolerance(simulation.tolerances.rtol),
            atol: tolerance(simulation.tolerances.atol),
            step,
            t_end: simulation.t_end,
            time_unit: simulation.time_unit().into(),
            form,
            form_why,
            ensemble: simulation.molecule.as_ref().map(|m| m.ensemble.describe("ps")),
            distribution: simulation
                .molecule
                .as_ref()
                .map(|m| m.distribution.describe_for(&m.torsion).into()),
            degrees_of_freedom: simulation.molecule.as_ref().map(|_| simulation.degrees_of_freedom()),
            inner_steps: simulation.molecule.as_ref().map(|m| m.inner_steps).filter(|n| *n > 1),
            changes: simulation.molecule.as_ref().map_or(Vec::new(), |m| m.changes()),
            left_out: simulation.left_out(),
        }
    }
    /// The form of forward dynamics and why, in a line.
    pub fn describe_form(&self) -> Option<String> {
        Some(format!("{} ({})", self.form.as_ref()?, self.form_why.as_ref()?))
    }
    /// Ensemble, distribution and degrees of freedom, in lines.
    pub fn describe_ensemble(&self) -> Option<[String; 2]> {
        let (ensemble, n) = (self.ensemble.as_ref()?, self.degrees_of_freedom?);
        Some([format!("{ensemble}; {n} degrees of freedom"), self.distribution.clone()?])
    }
    /// Method and error control in a few words.
    pub fn describe(&self) -> String {
        match (self.step, self.rtol, self.atol) {
            (Some(step), ..) if self.time_unit == "ps" => {
                let inner = self
                    .inner_steps
                    .map_or(String::new(), |n| format!(" with {n} of bonds, angles and torsions in it"));
                format!("{}, step {} fs{inner}", self.method, short(1000.0 * step))
            }
            (Some(step), ..) => format!("{}, step {step} s", self.method),
            (_, Some(rtol), Some(atol)) if rtol != atol => {
                format!("{}, rtol {rtol:e}, atol {atol:e}", self.method)
            }
            (_, Some(rtol), _) => format!("{}, tolerance {rtol:e}", self.method),
            _ => self.method.clone(),
        }
    }
}

impl Results {
    /// Of a run.
    pub fn new(simulation: &Simulation, summary: &Summary, rows: &[Row]) -> Self {
        let model = simulation.model();
        Results {
            joint_names: model.moving_joints().map(|k| model.joints()[k].name.clone()).collect(),
            end: End { t: summary.t, q: summary.q.clone(), v: summary.v.clone() },
            outputs: summary.outputs.iter().map(|(name, x)| (name.clone(), json!(x))).collect(),
            steps: summary.steps,
            rejected: summary.rejected,
            evaluations: summary.evaluations,
            wall_s: summary.wall_s,
            error_estimate: summary.error_estimate.as_ref().map(|e| Estimate {
                q: e.q,
                v: e.v,
                horizon: e.horizon,
                how: e.how.clone(),
                evaluations: e.evaluations,
            }),
            energy_error: summary.energy_error,
            momentum_error: summary.momentum_error.map(|[angular, linear]| MomentumError { linear, angular }),
            drift: match simulation.choice.method {
                Scheme::Midpoint { .. } => drift(rows).map(|d| EnergyDrift {
                    slope: d.slope,
                    error: d.error,
                    noise: d.noise,
                    degrees_of_freedom: simulation.degrees_of_freedom(),
                }),
                Scheme::Explicit(_) => None,
            },
            temperature_K: simulation.molecule.as_ref().map(|molecule| {
                if molecule.schedule.is_some() {
                    let each = |r: &Row| {
                        phipsi_molecule::temperature(r.energy[0], molecule.degrees_of_freedom_at(r.t))
                    };
                    return rows.iter().map(|r| each(r) / rows.len() as f64).sum();
                }
                let kinetic: f64 = rows.iter().map(|r| r.energy[0] / rows.len() as f64).sum();
                phipsi_molecule::temperature(kinetic, simulation.degrees_of_freedom())
            }),
            ensemble: simulation.molecule.as_ref().map(|m| m.ensemble.word().into()),
            distribution: simulation.molecule.as_ref().map(|m| m.distribution.word().into()),
            acceptance: summary.trials.and_then(|t| t.acceptance()),
            refused: summary.trials.map(|t| t.refused),
            closure_residual: summary
                .closures
                .map(|c| ClosureResidual { position: c.position, velocity: c.velocity }),
            energy_removed: summary.closures.map(|c| c.energy_removed),
            reference_error: summary.reference_error,
            changes: summary.changes.clone(),
            events: summary.events.iter().take(MOST_EVENTS).cloned().collect(),
            event_count: summary.events.len(),
            ended_by: summary.events.last().filter(|_| summary.ended_by_event).map(|e| e.name.clone()),
        }
    }
}
