//! Scenes of molecules: what they mean, and what is said of wrong ones.

use phipsi_formats::{Problem, Report};
use phipsi_simulate::scene::{Scene, parse};
use phipsi_simulate::{Recording, Row, SimulateError, Summary, run};
use std::path::{Path, PathBuf};

pub const SCENE: &str = r#"
[molecule]
pdb = "ala_dipeptide.pdb"
system = "ala_dipeptide.xml"
temperature_K = 300
seed = 1
[integrator]
t_end = 0.4
step_fs = 4
[record]
every = 0.02
"#;

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples")
}

pub fn scene(text: &str) -> Result<Scene, SimulateError> {
    parse(text.into(), "test", "test.toml", &examples(), &[])
}

pub fn reports(text: &str) -> Vec<Report> {
    match scene(text) {
        Ok(_) => panic!("accepted: {text}"),
        Err(SimulateError::Scene(reports)) => reports,
        Err(e) => panic!("{e}"),
    }
}

fn error(old: &str, new: &str) -> Problem {
    assert!(SCENE.contains(old));
    let found: Vec<Problem> = reports(&SCENE.replace(old, new)).into_iter().flat_map(|r| r.errors).collect();
    assert_eq!(found.len(), 1, "{found:?}");
    found[0].clone()
}

pub fn rows(text: &str) -> (Vec<Row>, Summary) {
    let mut scene = scene(text).unwrap();
    let mut recording = Recording::default();
    let summary = run(&mut scene.simulation, &mut recording).unwrap();
    (recording.rows, summary)
}

#[test]
fn torsion_dynamics_of_alanine_dipeptide() {
    let loaded = scene(SCENE).unwrap();
    assert_eq!(loaded.simulation.model().nv(), 13);
    let molecule = loaded.simulation.molecule.as_ref().unwrap();
    assert_eq!(molecule.torsion.clusters().clusters.len(), 8);
    let names: Vec<&str> = molecule.backbone.iter().map(|(n, _)| n.as_str()).collect();
    assert_eq!(names, ["ALA2 backbone_phi", "ALA2 backbone_psi"]);
    let (rows, summary) = rows(SCENE);
    assert_eq!(rows.len(), 21);
    assert_eq!((summary.steps, summary.evaluations), (100, 101));
    for row in &rows {
        // The same numbers, summed in another order.
        let terms: f64 = row.terms.iter().sum();
        let size: f64 = row.terms.iter().map(|e| e.abs()).sum();
        assert!((terms - row.energy[1]).abs() <= 8.0 * f64::EPSILON * size);
        assert_eq!(row.energy[2], 0.0);
        // Bonds and angles are rigid: these terms stay what they were, to the rounding of the positions.
        for i in [0, 3] {
            assert!((row.terms[i] - rows[0].terms[i]).abs() < 1e-9, "{:?}", row.terms);
        }
    }
    // The noise of this method at 4 fs is hundredths of kJ/mol; a wrong force would cost whole ones.
    let energy = |r: &Row| r.energy[0] + r.energy[1];
    assert!(rows.iter().all(|r| (energy(r) - energy(&rows[0])).abs() < 0.1));
    let [_, linear] = summary.momentum_error.unwrap();
    assert!(linear < 1e-12, "{linear}");
}

#[test]
fn a_seed_makes_the_same_run_and_another_one_another() {
    assert_eq!(rows(SCENE).0, rows(SCENE).0);
    assert_ne!(rows(SCENE).0[0].v, rows(&SCENE.replace("seed = 1", "seed = 2")).0[0].v);
}

#[test]
fn kinds_of_bonds_stay_rigid_and_minimising_lowers_the_energy() {
    let rigid = SCENE.replace("seed = 1", "rigid = [\"omega\", \"planar\", \"methyl\"]");
    assert_eq!(scene(&rigid).unwrap().simulation.model().nv(), 8);
    let minimized = SCENE.replace("seed = 1", "minimize = true").replace("temperature_K = 300\n", "");
    let loaded = scene(&minimized).unwrap();
    assert!(loaded.reports[0].used.iter().any(|n| n.what.contains("minimised in")));
    let (start, (rest, _)) = (rows(SCENE).0, rows(&minimized));
    assert!(rest[0].energy[1] <= start[0].energy[1]);
    assert!(rest.iter().all(|r| r.energy[0] < 1e-4), "it stays at the minimum");
}

/// The ring of proline as a loop: closed to rounding, with the degrees of freedom and the distribution said.
#[test]
fn a_flexible_ring_stays_closed() {
    let text = SCENE.replace("ala_dipeptide", "proline").replace("step_fs = 4", "step_fs = 2");
    let flexible = text.replace("seed = 1", "seed = 1\nrings = \"flexible\"");
    let loaded = scene(&flexible).unwrap();
    assert!(loaded.reports[0].used.iter().any(|n| n.what.contains("flexible rings closed at")));
    let rigid = scene(&text).unwrap().simulation.degrees_of_freedom();
    assert_eq!(loaded.simulation.degrees_of_freedom(), rigid + 2);
    let distribution = loaded.simulation.molecule.as_ref().map(|m| m.distribution.describe_for(&m.torsion));
    assert!(distribution.unwrap().contains("det(G M^-1 G^T)"));
    let (rows, summary) = rows(&flexible);
    let closures = summary.closures.unwrap();
    assert!(closures.position < 1e-12 && closures.velocity < 1e-10, "{closures:?}");
    let energy = |r: &Row| r.energy[0] + r.energy[1];
    assert!(rows.iter().all(|r| (energy(r) - energy(&rows[0])).abs() < 0.1));
    // Minimised with the flexible ring; Langevin dynamics with Fixman's potential, Nosé–Hoover chains.
    for (ensemble, keys) in
        [("langevin", "minimize = true\nfixman = true"), ("nose_hoover", "minimize = true")]
    {
        let bath = flexible.replace("seed = 1", &format!("seed = 1\n{keys}"));
        let bath = bath.replace("step_fs = 2", &format!("step_fs = 2\nensemble = \"{ensemble}\""));
        assert!(self::rows(&bath).1.closures.unwrap().position < 1e-12, "{ensemble}");
    }
    let refused = |text: &str| {
        let errors: Vec<Problem> = reports(text).into_iter().flat_map(|r| r.errors).collect();
        format!("{:?}", errors[0])
    };
    assert!(refused(&text.replace("seed = 1", "rings = \"floppy\"")).contains("flexible"));
}

#[test]
fn clusters_of_all_kinds() {
    let dof = |line: &str| scene(&SCENE.replace("seed = 1", line)).unwrap().simulation.model().nv();
    assert_eq!(dof("clusters = \"torsion\""), 13);
    assert_eq!(dof("clusters = \"cartesian\""), 66);
    let angles = dof("clusters = \"torsion+angle\"");
    assert!((18..=20).contains(&angles), "{angles}");
    assert_eq!(dof("angles = [[4, 6, 8]]"), 14);
    // A hydrogen of a methyl group; its carbon, with which the hydrogens lose what held them, and a hinge its body.
    assert_eq!(dof("free = [1]"), 13 + 3);
    assert_eq!(dof("free = [0]"), 13 + 4 * 3 - 1);
    // There is none.
    assert_eq!(dof("free = \"water\""), 13);
    assert!(error("seed = 1", "clusters = \"torsions\"").remedy.contains("torsion"));
    assert!(error("seed = 1", "angles = [[4, 6]]").required.contains("[[h, i, j]"));
    assert!(error("seed = 1", "free = \"solvent\"").required.contains("\"water\", or a list"));
    assert!(error("seed = 1", "free = [22]").found.contains("atom 22"));
    let text = SCENE.replace("seed = 1", "clusters = \"torsion+angle\"\nfixman = true");
    let distribution =
        scene(&text).unwrap().simulation.molecule.map(|m| m.distribution.describe_for(&m.torsion));
    assert!(distribution.unwrap().contains("sin theta"));
}

#[test]
fn wrong_molecules_say_what_is_required() {
    assert!(error("ala_dipeptide.pdb", "nothing.pdb").found.contains("No such file"));
    assert!(error("pdb = \"ala_dipeptide.pdb\"\n", "").found.contains("no `pdb`"));
    let e = error("seed = 1", "rigid = [\"methil\"]");
    assert_eq!((e.line, e.remedy.as_str()), (Some(6), "did you mean `methyl`?"));
    assert_eq!(error("seed = 1", "sead = 1").remedy, "did you mean `seed`?");
    assert!(error("seed = 1", "seed = -1").required.contains("at least 0"));
    assert!(error("seed = 1", "hinges = [[0, 1, 2]]").required.contains("[[i, j]"));
    assert!(error("step_fs = 4\n", "").remedy.contains("step_fs"));
    assert!(error("t_end = 0.4", "t_end = 0.401").required.contains("whole number of steps"));
    // A molecule of another System: the first atom that does not fit is named.
    let mut other =
        reports(&SCENE.replace("ala_dipeptide.pdb", "../validation/data/molecules/butane/butane.pdb"));
    let problem = other.iter_mut().flat_map(|r| r.errors.drain(..)).next().unwrap();
    assert!(problem.found.contains("14 atoms") && problem.found.contains("22"), "{problem:?}");
}

/// The example's System with something put into it.
fn with_system(old: &str, new: &str) -> Result<Scene, SimulateError> {
    let text = std::fs::read_to_string(examples().join("ala_dipeptide.xml")).unwrap();
    assert!(text.contains(old), "{old}");
    let folder = tempfile::tempdir().unwrap();
    let system = folder.path().join("changed.xml");
    std::fs::write(&system, text.replacen(old, new, 1)).unwrap();
    scene(&SCENE.replace("\"ala_dipeptide.xml\"", &format!("{:?}", system.display().to_string())))
}

#[test]
fn constraints_within_clusters_are_satisfied_and_others_refused() {
    // ACE's methyl: carbon 1 (CH3) with hydrogen 0. The distance is the positions', not this one.
    let inside = with_system(
        "<Constraints/>",
        "<Constraints><Constraint d=\".109\" p1=\"0\" p2=\"1\"/></Constraints>",
    );
    let notes = inside.unwrap().reports[0].used.iter().map(|n| n.what.clone()).collect::<Vec<_>>();
    assert!(notes.iter().any(|n| n.contains("1 constraints of the System are satisfied")), "{notes:?}");
    let across =
        with_system("<Constraints/>", "<Constraints><Constraint d=\".3\" p1=\"0\" p2=\"8\"/></Constraints>");
    let Err(SimulateError::Scene(reports)) = across else { panic!("accepted") };
    let e = &reports[0].errors[0];
    assert!(
        e.place.contains("ACE1") && e.place.contains("ALA2") && e.remedy.contains("constraints=None"),
        "{e:?}"
    );
}

#[test]
fn strained_starts_are_announced_before_the_first_step() {
    let strained = with_system("</System>", "</System>").unwrap();
    assert!(strained.reports[0].warnings.is_empty());
    // A Lennard-Jones radius ten times too large.
    let text = std::fs::read_to_string(examples().join("ala_dipeptide.xml")).unwrap();
    let at = text.find("sig=\"").unwrap();
    let end = at + 5 + text[at + 5..].find('"').unwrap();
    let sigma = &text[at..=end];
    let loaded = with_system(sigma, "sig=\"3\"").unwrap();
    let warnings = &loaded.reports[0].warnings;
    assert!(
        warnings.iter().any(|w| w.found.contains("force of") && w.remedy.contains("minimize")),
        "{warnings:?}"
    );
}

/// The scene with an ensemble.
pub fn with_ensemble(ensemble: &str) -> String {
    SCENE.replace("step_fs = 4", &format!("step_fs = 4\nensemble = {ensemble}"))
}

#[test]
fn ensembles_conserve_their_quantities_and_say_what_they_sample() {
    for (ensemble, freedom, noise) in [
        ("\"langevin\"\nfriction_per_ps = 5", 13, 0.2),
        ("\"nose_hoover\"\nrelaxation_ps = 0.05", 10, 0.2),
        ("\"hmc\"\ntrajectory_steps = 5", 13, f64::INFINITY),
    ] {
        for fixman in [false, true] {
            let mut text = with_ensemble(ensemble);
            if fixman {
                text = text.replace("seed = 1", "seed = 1\nfixman = true");
            }
            let loaded = scene(&text).unwrap();
            let plan = phipsi_simulate::folder::results::Plan::new(&loaded.simulation);
            let [ensemble, distribution] = plan.describe_ensemble().unwrap();
            assert!(ensemble.contains(&format!("{freedom} degrees of freedom")), "{ensemble}");
            assert!(distribution.starts_with(if fixman { "stiff limit" } else { "rigid" }), "{distribution}");
            let (rows, summary) = rows(&text);
            assert_eq!(rows.len(), 21);
            assert_eq!(summary.steps, 100);
            assert_eq!(summary.momentum_error, None);
            assert_eq!(rows[0].terms.len(), if fixman { 5 } else { 4 });
            let energy = |r: &Row| r.energy[0] + r.energy[1] - r.energy[2];
            assert!(rows.iter().all(|r| (energy(r) - energy(&rows[0])).abs() < noise), "{ensemble}");
            assert!(rows.iter().any(|r| (r.energy[2] - rows[0].energy[2]).abs() > 1.0), "{ensemble}");
            let made = summary.trials.unwrap().made;
            assert_eq!(made, if ensemble.contains("Monte Carlo") { 20 } else { 0 });
        }
    }
}

/// Keeps a copy of the run's state after so many steps, as a checkpoint would.
pub struct Interrupted {
    pub recording: Recording,
    pub after: usize,
    pub state: Option<Vec<u8>>,
}

impl phipsi_simulate::Observer for Interrupted {
    fn row(&mut self, row: &Row) -> Result<(), SimulateError> {
        self.recording.row(row)
    }
    fn step(
        &mut self,
        step: &phipsi_simulate::StepRecord,
        progress: &phipsi_simulate::Progress<'_>,
    ) -> Result<(), SimulateError> {
        self.recording.step(step, progress)?;
        if self.recording.steps.len() == self.after {
            self.state = Some(serde_json::to_vec(&progress.state()).unwrap());
        }
        Ok(())
    }
    fn step_ends(&mut self) -> Result<Vec<f64>, SimulateError> {
        self.recording.step_ends()
    }
    fn spread_rows(&mut self, most: usize) -> Result<Vec<phipsi_model::State>, SimulateError> {
        self.recording.spread_rows(most)
    }
}

#[test]
fn runs_in_a_bath_continue_bit_for_bit_from_a_checkpoint() {
    for (ensemble, after) in
        [("\"langevin\"", 37), ("\"nose_hoover\"", 37), ("\"hmc\"\ntrajectory_steps = 5", 8)]
    {
        let text = with_ensemble(ensemble).replace("seed = 1", "seed = 1\nfixman = true");
        let mut whole = Interrupted { recording: Recording::default(), after, state: None };
        run(&mut scene(&text).unwrap().simulation, &mut whole).unwrap();
        let state: phipsi_simulate::RunState = serde_json::from_slice(&whole.state.unwrap()).unwrap();
        let done = state.rows as usize;
        assert!(done > 2 && state.bath.is_some());
        let mut rest = Recording::default();
        phipsi_simulate::resume(&mut scene(&text).unwrap().simulation, state, &mut rest).unwrap();
        assert_eq!(rest.rows[..], whole.recording.rows[done..], "{ensemble}");
    }
}

#[test]
fn wrong_ensembles_say_what_is_required() {
    let reported = |text: String| {
        let found: Vec<Problem> = reports(&text).into_iter().flat_map(|r| r.errors).collect();
        assert_eq!(found.len(), 1, "{found:?}");
        found[0].clone()
    };
    let e = reported(with_ensemble("\"langevine\""));
    assert!(e.remedy.contains("langevin"), "{e:?}");
    let e = reported(with_ensemble("\"langevin\"").replace("temperature_K = 300\n", ""));
    assert!(e.remedy.contains("temperature_K"), "{e:?}");
    let e = reported(SCENE.replace("temperature_K = 300", "fixman = true"));
    assert!(e.remedy.contains("temperature_K"), "{e:?}");
    let e = reported(with_ensemble("\"nve\"\nfriction_per_ps = 1"));
    assert!(e.remedy.contains("langevin"), "{e:?}");
    let e = reported(with_ensemble("\"hmc\"\ntrajectory_steps = 0"));
    assert!(e.required.contains("at least 1"), "{e:?}");
    // 0.4 ps are no whole number of trajectories of 7 steps of 4 fs; nor is every = 0.02 then.
    let found: Vec<Problem> =
        reports(&with_ensemble("\"hmc\"\ntrajectory_steps = 7")).into_iter().flat_map(|r| r.errors).collect();
    assert!(found.iter().any(|e| e.required.contains("whole number of trajectories")), "{found:?}");
}

/// One inner step is the plain step; several of them have fewer evaluations of pairs and little noise, and continue bit for bit.
#[test]
fn several_inner_steps() {
    let inner = |n: &str| SCENE.replace("step_fs = 4", &format!("step_fs = 4\ninner_steps = {n}"));
    assert_eq!(rows(&inner("1")).0, rows(SCENE).0);
    let loaded = scene(&inner("2")).unwrap();
    let names: Vec<&str> = loaded.simulation.dynamics.forces().iter().map(|f| f.name()).collect();
    assert_eq!(names, ["force field", "pairs"]);
    let plan = phipsi_simulate::folder::results::Plan::new(&loaded.simulation);
    assert_eq!(plan.inner_steps, Some(2));
    assert!(plan.describe().contains("with 2 of bonds, angles and torsions in it"), "{}", plan.describe());
    for text in [inner("2"), inner("2").replace("step_fs", "ensemble = \"langevin\"\nstep_fs")] {
        let mut whole = Interrupted { recording: Recording::default(), after: 37, state: None };
        let summary = run(&mut scene(&text).unwrap().simulation, &mut whole).unwrap();
        assert_eq!((summary.steps, summary.evaluations), (100, 201));
        let conserved = |r: &Row| r.energy[0] + r.energy[1] - r.energy[2];
        let rows = &whole.recording.rows;
        assert!(rows.iter().all(|r| (conserved(r) - conserved(&rows[0])).abs() < 0.2));
        assert_eq!(rows[0].terms.len(), 4);
        let state: phipsi_simulate::RunState = serde_json::from_slice(&whole.state.unwrap()).unwrap();
        let done = state.rows as usize;
        let mut rest = Recording::default();
        phipsi_simulate::resume(&mut scene(&text).unwrap().simulation, state, &mut rest).unwrap();
        assert_eq!(rest.rows[..], rows[done..]);
    }
    assert!(error("step_fs = 4", "step_fs = 4\ninner_steps = 0").required.contains("at least 1"));
    assert!(error("step_fs = 4", "step_fs = 4\ninner_steps = 1001").required.contains("1000"));
    assert!(error("step_fs = 4", "inner_steps = 2\nmethod = \"dop853\"").required.contains("midpoint"));
}
