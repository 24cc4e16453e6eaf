//! Freeze and thaw in scenes: what is kept, what is recorded, what a checkpoint continues, what is refused.

use crate::molecule::{Interrupted, SCENE, reports, rows, scene, with_ensemble};
use phipsi_formats::Problem;
use phipsi_molecule::temperature;
use phipsi_simulate::folder::results::Plan;
use phipsi_simulate::{ChangeRecord, Recording, Row, RunState, Simulation, resume, run};

const CHANGES: &str = r#"
[[molecule.recluster]]
time_ps = 0.1
freeze = ["omega", "methyl"]
[[molecule.recluster]]
time_ps = 0.2
thaw = ["methyl"]
thaw_temperature_K = 300
"#;

fn with(scene: &str, changes: &str) -> String {
    format!("{scene}{changes}")
}

/// Places in q and v of the hinges of kinds of bonds.
fn hinges(simulation: &Simulation, kinds: &[&str]) -> Vec<(usize, usize)> {
    let torsion = &simulation.molecule.as_ref().unwrap().torsion;
    let all = torsion.clusters().hinges.iter().enumerate();
    let dofs = all.filter(|(_, h)| kinds.contains(&h.kind.word())).map(|(i, _)| torsion.hinge_dof(i));
    let model = torsion.model();
    dofs.map(|dof| (model.q_offset(model.joint_of_velocity(dof).0), dof)).collect()
}

fn conserved(r: &Row) -> f64 {
    r.energy[0] + r.energy[1] - r.energy[2]
}

/// after = before − removed + drawn, to the rounding of sums over 22 atoms and two sweeps.
fn balanced(change: &ChangeRecord) {
    let l = &change.ledger;
    let off = l.before - l.removed + l.drawn - l.after;
    assert!(off.abs() < 64.0 * 22.0 * f64::EPSILON * (l.before + l.after), "{change:?}");
}

#[test]
fn what_is_frozen_rests_and_what_is_thawed_moves() {
    let text = with(SCENE, CHANGES);
    let loaded = scene(&text).unwrap();
    let plan = Plan::new(&loaded.simulation);
    assert_eq!(plan.degrees_of_freedom, Some(13));
    assert_eq!(
        plan.changes,
        [
            "t = 0.1 ps: freeze omega, methyl; 8 degrees of freedom",
            "t = 0.2 ps: thaw methyl at 300 K; 11 degrees of freedom"
        ]
    );
    let notes: Vec<&str> = loaded.reports[0].used.iter().map(|n| n.what.as_str()).collect();
    assert!(notes.iter().any(|n| n.contains("from 0.1 ps on") && n.contains("8 degrees")), "{notes:?}");
    let (omega, methyl) = (hinges(&loaded.simulation, &["omega"]), hinges(&loaded.simulation, &["methyl"]));
    assert_eq!((omega.len(), methyl.len()), (2, 3));
    let (with_changes, summary) = rows(&text);
    let without = rows(SCENE).0;
    // Rows at 0, 0.02, …: the sixth is that of 0.1 ps, before the change.
    assert_eq!(with_changes[..6], without[..6]);
    assert_eq!((summary.steps, summary.changes.len(), with_changes.len()), (100, 2, 21));
    for (change, row) in summary.changes.iter().zip([5, 10]) {
        balanced(change);
        assert!((change.t - with_changes[row].t).abs() < 1e-12);
        // The row is measured in the scene's coordinates: kinetic energies of the same velocities.
        let off = change.ledger.before - with_changes[row].energy[0];
        assert!(off.abs() < 1e-10 * change.ledger.before, "{off:e}");
        assert_eq!(change.fixman, 0.0);
    }
    let [first, second] = [&summary.changes[0].ledger, &summary.changes[1].ledger];
    assert!(first.removed > 0.1 && first.drawn == 0.0 && second.drawn > 0.1, "{first:?} {second:?}");
    assert!(second.removed < 1e-10 * second.before);
    assert_eq!((first.degrees_of_freedom, second.degrees_of_freedom), ([13, 8], [8, 11]));
    // Frozen angles stay to the rounding of positions over arms of a tenth of a nanometre; others move by degrees.
    let still = |rows: &[Row], &(q, v): &(usize, usize)| {
        rows.iter().all(|r| (r.q[q] - rows[0].q[q]).abs() < 1e-9 && r.v[v].abs() < 1e-8)
    };
    let moves =
        |rows: &[Row], &(q, _): &(usize, usize)| rows.iter().any(|r| (r.q[q] - rows[0].q[q]).abs() > 1e-3);
    assert!(omega.iter().all(|h| still(&with_changes[6..], h) && moves(&with_changes[..6], h)));
    assert!(methyl.iter().all(|h| still(&with_changes[6..11], h) && moves(&with_changes[11..], h)));
    // The balance goes on through the changes, and so do both momenta.
    let noise =
        with_changes.iter().map(|r| (conserved(r) - conserved(&with_changes[0])).abs()).fold(0.0, f64::max);
    assert!(noise < 0.1, "{noise}");
    assert!(summary.momentum_error.unwrap()[1] < 1e-11, "{:?}", summary.momentum_error);
    assert!(
        (with_changes[20].energy[2] - summary.changes.iter().map(ChangeRecord::given).sum::<f64>()).abs()
            < 1e-12
    );
    // Positions of the atoms go on: a step of the fastest atoms is hundredths of a nanometre in 0.02 ps.
    let molecule = loaded.simulation.molecule.as_ref().unwrap();
    for pair in with_changes.windows(2) {
        let [a, b] = [&pair[0], &pair[1]].map(|r| molecule.positions(&r.q).unwrap());
        let far = a
            .iter()
            .zip(&b)
            .map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>())
            .fold(0.0, f64::max);
        assert!(far.sqrt() < 0.15, "{}", far.sqrt());
    }
    // The mean temperature counts the degrees of freedom of each time.
    let counted = |t: f64| molecule.degrees_of_freedom_at(t);
    assert_eq!([0.0, 0.1, 0.12, 0.2, 0.22, 0.4].map(counted), [13, 13, 8, 8, 11, 11]);
}

/// A run that begins rigid and thaws is recorded in the coordinates of what thaws.
#[test]
fn what_is_rigid_at_the_start_can_thaw() {
    let start = SCENE.replace("seed = 1", "seed = 1\nrigid = [\"omega\", \"methyl\"]\nminimize = true");
    let changes = "[[molecule.recluster]]\ntime_ps = 0.2\nthaw = [\"methyl\", \"omega\"]\nfreeze = [\"backbone_phi\"]\n";
    let text = with(&start, changes);
    let loaded = scene(&text).unwrap();
    assert_eq!((loaded.simulation.model().nv(), loaded.simulation.degrees_of_freedom()), (13, 8));
    let all = hinges(&loaded.simulation, &["omega", "methyl"]);
    let (rows, summary) = rows(&text);
    for &(q, v) in &all {
        assert!(rows[..11].iter().all(|r| r.q[q].abs() < 1e-9 && r.v[v].abs() < 1e-8));
    }
    // No temperature of what thaws at constant energy: it begins at rest, and nothing is drawn.
    let change = &summary.changes[0];
    balanced(change);
    assert_eq!((change.ledger.drawn.abs() < 1e-10, change.ledger.degrees_of_freedom), (true, [8, 12]));
    assert!(rows.iter().all(|r| (conserved(r) - conserved(&rows[0])).abs() < 0.1));
    // As many kT/2 as there are degrees of freedom, on average; velocities of one draw are within four deviations.
    let kelvin = temperature(rows[0].energy[0], 8);
    assert!((kelvin - 300.0).abs() < 4.0 * 300.0 * (2.0f64 / 8.0).sqrt(), "{kelvin}");
}

#[test]
fn checkpoints_before_at_and_after_changes_continue_bit_for_bit() {
    for (ensemble, afters) in [
        ("\"nve\"", [10, 25, 37, 60]),
        ("\"langevin\"", [10, 25, 37, 60]),
        ("\"nose_hoover\"", [10, 25, 37, 60]),
        ("\"hmc\"\ntrajectory_steps = 5", [2, 5, 8, 12]),
    ] {
        let scene_text = with_ensemble(ensemble).replace("seed = 1", "seed = 1\nfixman = true");
        let text = with(&scene_text, CHANGES);
        for after in afters {
            let mut whole = Interrupted { recording: Recording::default(), after, state: None };
            let summary = run(&mut scene(&text).unwrap().simulation, &mut whole).unwrap();
            let state: RunState = serde_json::from_slice(&whole.state.unwrap()).unwrap();
            let done = state.rows as usize;
            let mut rest = Recording::default();
            let again = resume(&mut scene(&text).unwrap().simulation, state, &mut rest).unwrap();
            assert_eq!(rest.rows[..], whole.recording.rows[done..], "{ensemble} {after}");
            assert_eq!(
                (again.changes, again.q, again.energy_error),
                (summary.changes, summary.q, summary.energy_error)
            );
        }
    }
}

/// The conserved quantity goes on in every bath, and what thaws has the bath's temperature without being asked.
#[test]
fn baths_go_on_with_other_clusters() {
    let changes = CHANGES.replace("thaw_temperature_K = 300\n", "");
    for ensemble in ["\"langevin\"", "\"nose_hoover\"", "\"hmc\"\ntrajectory_steps = 5"] {
        let scene_text = with_ensemble(ensemble).replace("seed = 1", "seed = 1\nfixman = true");
        let text = with(&scene_text, &changes);
        let (rows, summary) = rows(&text);
        assert!(summary.changes[1].ledger.drawn > 0.0);
        assert!(summary.changes.iter().all(|c| c.fixman != 0.0));
        summary.changes.iter().for_each(balanced);
        // Monte Carlo refuses what steps err by more.
        let limit = if ensemble.contains("hmc") { f64::INFINITY } else { 0.2 };
        let noise = rows.iter().map(|r| (conserved(r) - conserved(&rows[0])).abs()).fold(0.0, f64::max);
        assert!(noise < limit, "{ensemble}: {noise}");
        assert_eq!(summary.steps, 100);
        assert_eq!(summary.trials.unwrap().made, if ensemble.contains("hmc") { 20 } else { 0 });
    }
    // A flexible ring beside them stays closed.
    let ring = SCENE.replace("ala_dipeptide", "proline").replace("step_fs = 4", "step_fs = 2");
    let changes = "[[molecule.recluster]]\ntime_ps = 0.1\nfreeze = [\"methyl\"]\n";
    let (rows, _) = rows(&with(&ring, changes));
    assert!(rows.iter().all(|r| (conserved(r) - conserved(&rows[0])).abs() < 0.1));
}

/// Rings of five with their open angles, and open angles of chains, beside what freezes and thaws: recorded in the coordinates of all.
#[test]
fn flexible_rings_and_open_angles_go_on_with_other_clusters() {
    let fine = SCENE.replace("step_fs = 4", "step_fs = 1");
    let ring = fine.replace("ala_dipeptide", "proline").replace("seed = 1", "seed = 1\nrings = \"flexible\"");
    let angles = fine.replace("seed = 1", "seed = 1\nclusters = \"torsion+angle\"");
    for (text, freedom, has_rings) in
        [(&ring, [[13, 9], [9, 11]], true), (&angles, [[20, 10], [10, 16]], false)]
    {
        for fixman in ["", "fixman = true\n"] {
            let text = with(&text.replace("seed = 1\n", &format!("seed = 1\n{fixman}")), CHANGES);
            let (rows, summary) = rows(&text);
            let [first, second] = [0, 1].map(|i| &summary.changes[i].ledger);
            assert_eq!([first.degrees_of_freedom, second.degrees_of_freedom], freedom);
            assert!(first.removed > 0.1 && second.drawn > 0.1 && second.removed < 1e-10 * second.before);
            summary.changes.iter().for_each(balanced);
            // Bends of hydrogens at a step of 1 fs; a change of the energy by what was removed would be tens of this.
            let noise = rows.iter().map(|r| (conserved(r) - conserved(&rows[0])).abs()).fold(0.0, f64::max);
            assert!(noise < 0.1, "{noise}");
            assert!(summary.momentum_error.unwrap()[1] < 1e-11, "{:?}", summary.momentum_error);
            assert_eq!(summary.closures.is_some(), has_rings);
            if let Some(closures) = summary.closures {
                assert!(closures.position < 1e-12 && closures.velocity < 1e-10, "{closures:?}");
            }
        }
    }
}

/// The pucker of proline freezes and thaws: with four of its bonds the ring is rigid, and the fifth, a backbone φ, is locked meanwhile.
#[test]
fn a_ring_freezes_and_thaws_as_a_whole() {
    let text = SCENE.replace("ala_dipeptide", "proline").replace("step_fs = 4", "step_fs = 1");
    let text = with(
        &text.replace("seed = 1", "seed = 1\nrings = \"flexible\""),
        &CHANGES.replace("freeze = [\"omega\", \"methyl\"]", "freeze = [\"chi\"]").replace("methyl", "chi"),
    );
    let loaded = scene(&text).unwrap();
    let pucker = hinges(&loaded.simulation, &["chi", "backbone_phi"]);
    // One of the five bonds is the closure.
    assert_eq!(pucker.len(), 4);
    let (rows, summary) = rows(&text);
    let freedom = [0, 1].map(|i| summary.changes[i].ledger.degrees_of_freedom);
    assert_eq!(freedom, [[13, 11], [11, 13]]);
    summary.changes.iter().for_each(balanced);
    for &(q, v) in &pucker {
        // At rest to the rounding of positions, solved with the condition of the ring; moving before and after.
        assert!(rows[6..11].iter().all(|r| (r.q[q] - rows[6].q[q]).abs() < 1e-9 && r.v[v].abs() < 1e-8));
        let moves = |rows: &[Row]| rows.iter().any(|r| (r.q[q] - rows[0].q[q]).abs() > 1e-3);
        assert!(moves(&rows[..6]) && moves(&rows[11..]));
    }
    let noise = rows.iter().map(|r| (conserved(r) - conserved(&rows[0])).abs()).fold(0.0, f64::max);
    assert!(noise < 0.1, "{noise}");
    assert!(summary.momentum_error.unwrap()[1] < 1e-11, "{:?}", summary.momentum_error);
    let closures = summary.closures.unwrap();
    assert!(closures.position < 1e-12 && closures.velocity < 1e-10, "{closures:?}");
}

/// Diketopiperazine, C₄H₆N₂O₂, as a chair: files of a PDB and a System with its bonds alone.
fn diketopiperazine(folder: &std::path::Path) -> String {
    let (mut pdb, mut bonds, mut particles) = (String::new(), String::new(), String::new());
    let mut atoms: Vec<(&str, usize, [f64; 3])> = Vec::new();
    let mut bond = |i: usize, j: usize, length: f64| {
        bonds += &format!("<Bond d=\"{length}\" k=\"3e5\" p1=\"{i}\" p2=\"{j}\"/>\n");
    };
    let mut ring = Vec::new();
    for corner in 0..6 {
        let (sin, cos) = (std::f64::consts::PI * f64::from(corner) / 3.0).sin_cos();
        let up = if corner % 2 == 0 { 1.0 } else { -1.0 };
        let at = |r: f64, z: f64| [r * cos, r * sin, up * z];
        let residue = 1 + corner as usize / 3;
        let first = atoms.len();
        ring.push(first);
        let names: &[&str] = [&["N", "H"][..], &["CA", "HA2", "HA3"], &["C", "O"]][corner as usize % 3];
        for (k, name) in names.iter().enumerate() {
            // Across from the middle of the ring; of two hydrogens one along its axis.
            let place = [at(0.145, 0.02), at(0.24, 0.02 - 0.03), at(0.16, 0.125)][k];
            atoms.push((name, residue, place));
            if k > 0 {
                bond(first, first + k, if *name == "O" { 0.123 } else { 0.1 });
            }
        }
    }
    for k in 0..6 {
        bond(ring[k], ring[(k + 1) % 6], 0.145);
    }
    for (i, (name, residue, x)) in atoms.iter().enumerate() {
        let [x, y, z] = x.map(|x| 10.0 * x);
        let element = &name[..1];
        pdb += &format!(
            "ATOM  {:5}  {name:<3} GLY A{residue:4}    {x:8.3}{y:8.3}{z:8.3}  1.00  0.00          {element:>2}\n",
            i + 1
        );
        let mass = [("H", 1.008), ("C", 12.01), ("N", 14.01), ("O", 16.0)].iter().find(|m| m.0 == element);
        particles += &format!("<Particle mass=\"{}\"/>\n", mass.unwrap().1);
    }
    let system = format!(
        "<?xml version=\"1.0\" ?>\n<System openmmVersion=\"8.6.1\" type=\"System\" version=\"1\">\n<Particles>\n{particles}\
         </Particles>\n<Constraints/>\n<Forces>\n<Force forceGroup=\"0\" name=\"HarmonicBondForce\" \
         type=\"HarmonicBondForce\" usesPeriodic=\"0\" version=\"2\">\n<Bonds>\n{bonds}</Bonds>\n</Force>\n</Forces>\n</System>\n"
    );
    let files = [("ring.pdb", pdb + "END\n"), ("ring.xml", system)];
    let mut text = SCENE.replace("step_fs = 4", "step_fs = 1").replace("seed = 1", "rings = \"flexible\"");
    for ((name, content), old) in files.into_iter().zip(["ala_dipeptide.pdb", "ala_dipeptide.xml"]) {
        std::fs::write(folder.join(name), content).unwrap();
        text = text.replace(old, &folder.join(name).display().to_string());
    }
    text
}

/// A ring of six that has its three open angles at two kinds of bonds: without these it would open another one, which is in no coordinate of
/// the record.
#[test]
fn a_change_that_would_open_another_angle_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let text = diketopiperazine(folder.path());
    let loaded = scene(&text).unwrap();
    let clusters = loaded.simulation.molecule.as_ref().unwrap().torsion.clusters().clone();
    let bends = clusters.hinges.iter().filter(|h| h.bend.is_some());
    let mut kinds: Vec<&str> = bends.map(|h| h.kind.word()).collect();
    assert_eq!((clusters.closures.len(), kinds.len()), (1, 3), "{kinds:?}");
    kinds.sort_unstable();
    kinds.dedup();
    assert_eq!(kinds.len(), 2, "{kinds:?}");
    let change = format!("[[molecule.recluster]]\ntime_ps = 0.1\nfreeze = {kinds:?}\n");
    let errors: Vec<Problem> = reports(&with(&text, &change)).into_iter().flat_map(|r| r.errors).collect();
    let [error] = &errors[..] else { panic!("{errors:?}") };
    assert_eq!(error.place, "molecule.recluster 0");
    assert!(error.found.contains("GLY") && error.found.contains("opens where others freeze"), "{error:?}");
    assert!(error.required.contains("widest clusters") && error.remedy.contains("freeze fewer kinds"));
    // Fewer kinds go on.
    let change = change.replace(&format!("{:?}, ", kinds[0]), "");
    scene(&with(&text, &change)).unwrap();
}

#[test]
fn wrong_changes_say_what_is_required() {
    let error = |changes: &str, scene: &str| {
        let errors: Vec<Problem> =
            reports(&with(scene, changes)).into_iter().flat_map(|r| r.errors).collect();
        assert_eq!(errors.len(), 1, "{errors:?}");
        errors[0].clone()
    };
    let one = |line: &str| error(&format!("[[molecule.recluster]]\n{line}\n"), SCENE);
    assert!(one("freeze = [\"omega\"]").found.contains("no `time_ps`"));
    assert!(one("time_ps = 0.1").found.contains("neither"));
    assert_eq!(one("time_ps = 0.1\nfreeze = [\"omga\"]").remedy, "did you mean `omega`?");
    assert!(one("time_ps = 0.1\nthaw = [\"omega\"]").required.contains("rigid until then"));
    assert!(one("time_ps = 0.1\nfreeze = [\"chi\"]").found.contains("leaves 7 hinges"));
    assert!(one("time_ps = 0.4\nfreeze = [\"omega\"]").required.contains("before the end"));
    assert!(one("time_ps = 0.101\nfreeze = [\"omega\"]").required.contains("whole number of steps"));
    assert!(
        one("time_ps = 0.1\nfreeze = [\"omega\"]\nthaw_temperature_K = 3").found.contains("without `thaw`")
    );
    assert!(one("time_ps = 0.1\nfreeze = [\"omega\"]\nfreese = 3").remedy.contains("freeze"));
    let again = CHANGES.replace("time_ps = 0.2", "time_ps = 0.1");
    assert!(error(&again, SCENE).required.contains("increase"));
    let rigid = SCENE.replace("seed = 1", "rigid = [\"omega\"]");
    assert!(error(CHANGES, &rigid).required.contains("turns until then"));
    let explicit = SCENE.replace("step_fs = 4", "method = \"dop853\"");
    assert!(error(CHANGES, &explicit).required.contains("midpoint"));
    let force = format!("{CHANGES}[[force]]\nkind = \"torque\"\njoint = \"ALA2:N-CA\"\nvalue = 1\n");
    let e = reports(&with(SCENE, &force)).into_iter().flat_map(|r| r.errors).next().unwrap();
    assert!(e.remedy.contains("recluster"), "{e:?}");
}
