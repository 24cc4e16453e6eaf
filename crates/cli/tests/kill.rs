//! Real kills: a run that is killed again and again and resumed ends with the same bytes as one that is not.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A double pendulum under a servo with an integral part, a table and damping: everything that a checkpoint must hold.
const SCENE: &str = r#"
[[body]]
name = "upper"
inertial = { mass = 1.0, origin = { xyz = [0, 0, -0.5] }, inertia = { ixx = 0.083, iyy = 0.083 } }
[[body]]
name = "lower"
inertial = { mass = 1.0, origin = { xyz = [0, 0, -0.5] }, inertia = { ixx = 0.083, iyy = 0.083 } }
[[joint]]
name = "shoulder"
type = "revolute"
parent = "world"
child = "upper"
axis = [0, 1, 0]
limit = { lower = -1, upper = 1 }
[[joint]]
name = "elbow"
type = "continuous"
parent = "upper"
child = "lower"
origin = { xyz = [0, 0, -1] }
axis = [0, 1, 0]
dynamics = { damping = 0.05, friction = 0.01 }
[initial]
q.shoulder = 2.0
q.elbow = 0.5
[[force]]
kind = "servo"
joint = "shoulder"
target = "0.5*sin(3*t)"
stiffness = 5
integral = 0.5
[[force]]
kind = "torque"
joint = "elbow"
value = [[0, 0], [3, 1], [7, -1], [40, 0]]
[integrator]
t_end = 60
rtol = 1e-12
[record]
every = 0.01
checkpoint_s = 0.02
"#;

fn phipsi(arguments: &[&str], folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_phipsi"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    command
}

fn read(folder: &Path, file: &str) -> Vec<u8> {
    std::fs::read(folder.join(file)).unwrap()
}

/// Waits until a run has written a file; the first checkpoint comes after a small part of the run.
fn wait_for(file: &Path) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while !file.exists() {
        assert!(Instant::now() < deadline, "{} never appeared", file.display());
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// The results without what differs between equal runs: wall time and the folder's name.
fn results(folder: &Path) -> serde_json::Value {
    let mut value: serde_json::Value = serde_json::from_slice(&read(folder, "run.json")).unwrap();
    value["results"].as_object_mut().unwrap().remove("wall_s");
    value
}

fn uninterrupted(folder: &Path) -> (PathBuf, Duration) {
    let begun = Instant::now();
    let output = phipsi(&["run", "scene.toml", "--out", "whole", "--json"], folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    (folder.join("whole"), begun.elapsed())
}

#[test]
fn a_run_killed_at_any_moment_resumes_bit_for_bit() {
    killed_and_resumed(SCENE, &["trajectory.csv", "trajectory.npz"]);
}

/// A molecule by the symplectic method, with the positions of its atoms.
#[test]
fn a_molecule_killed_at_any_moment_resumes_bit_for_bit() {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let path = |name: &str| serde_json::Value::from(examples.join(name).to_str().unwrap()).to_string();
    let scene = format!(
        "[molecule]\npdb = {}\nsystem = {}\ntemperature_K = 300\nseed = 3\n[integrator]\nt_end = 60\nstep_fs = 6\n\
         [record]\nevery = 0.03\ncheckpoint_s = 0.02\n",
        path("ala_dipeptide.pdb"),
        path("ala_dipeptide.xml")
    );
    killed_and_resumed(&scene, &["trajectory.csv", "trajectory.npz", "trajectory.dcd"]);
}

fn killed_and_resumed(scene: &str, files: &[&str]) {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    let (whole, took) = uninterrupted(folder);
    let mut kills = 0;
    let mut begin = true;
    let mut seen = Vec::new();
    // Each attempt lives for another part of the whole run's time; at last one is left to end.
    for attempt in 0.. {
        let arguments: &[&str] = if begin {
            &["run", "scene.toml", "--out", "pieces", "--quiet"]
        } else {
            &["run", "--resume", "pieces", "--quiet"]
        };
        let mut child =
            phipsi(arguments, folder).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let life = took.mul_f64(0.07 + 0.037 * f64::from(attempt));
        let deadline = Instant::now() + life;
        let ended = loop {
            if let Some(status) = child.try_wait().unwrap() {
                assert!(status.success(), "attempt {attempt}");
                break true;
            }
            if Instant::now() >= deadline {
                child.kill().unwrap();
                child.wait().unwrap();
                kills += 1;
                break false;
            }
            std::thread::sleep(Duration::from_millis(1));
        };
        // A kill before run.json exists leaves an empty folder: begin again.
        begin = !folder.join("pieces/run.json").exists();
        if begin {
            let _ = std::fs::remove_dir_all(folder.join("pieces"));
        }
        // Whatever whole rows have been seen stay as they are.
        if let Ok(now) = std::fs::read(folder.join("pieces/trajectory.csv")) {
            let rows = now.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
            assert!(now.len() >= seen.len() && now[..seen.len()] == seen[..], "attempt {attempt} lost rows");
            seen = now[..rows].to_vec();
        }
        if ended {
            break;
        }
        assert!(attempt < 60, "no attempt ended");
    }
    assert!(kills >= 3, "only {kills} kills: the run is too short to show anything");
    let pieces = folder.join("pieces");
    for file in files {
        assert!(read(&whole, file) == read(&pieces, file), "{file} differs");
    }
    assert_eq!(results(&whole), results(&pieces));
}

#[test]
#[cfg(unix)]
fn an_interrupted_run_says_how_to_go_on_and_goes_on() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    std::fs::write(folder.join("scene.toml"), SCENE).unwrap();
    let (whole, _) = uninterrupted(folder);
    let child = phipsi(&["run", "scene.toml", "--out", "half"], folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    wait_for(&folder.join("half/checkpoint/state.json"));
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let output = child.wait_with_output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{errors}");
    assert!(errors.contains("continue with: phipsi run --resume half"), "{errors}");
    // Another scene is refused, the same one goes on.
    std::fs::write(folder.join("other.toml"), SCENE.replace("q.elbow = 0.5", "q.elbow = 0.6")).unwrap();
    let other = phipsi(&["run", "other.toml", "--resume", "half"], folder).output().unwrap();
    assert_eq!(other.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&other.stderr).contains("another scene"));
    let resumed = phipsi(&["run", "scene.toml", "--resume", "half", "--json"], folder).output().unwrap();
    assert!(resumed.status.success(), "{}", String::from_utf8_lossy(&resumed.stderr));
    assert_eq!(read(&whole, "trajectory.csv"), read(&folder.join("half"), "trajectory.csv"));
    assert_eq!(results(&whole), results(&folder.join("half")));
    // Once more: nothing is left to do.
    let again = phipsi(&["run", "--resume", "half"], folder).output().unwrap();
    assert!(again.status.success());
    assert!(String::from_utf8_lossy(&again.stdout).contains("already ended"));
}

#[test]
fn another_instruction_level_is_told() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    std::fs::write(folder.join("scene.toml"), SCENE).unwrap();
    let mut child = phipsi(&["run", "scene.toml", "--out", "moved"], folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let state = folder.join("moved/checkpoint/state.json");
    wait_for(&state);
    child.kill().unwrap();
    child.wait().unwrap();
    let text = std::fs::read_to_string(&state).unwrap();
    let (before, rest) = text.split_once("\"level\":\"").unwrap();
    let rest = rest.split_once('"').unwrap().1;
    std::fs::write(&state, format!("{before}\"level\":\"vax vms\"{rest}")).unwrap();
    let output = phipsi(&["run", "--resume", "moved"], folder).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && errors.contains("`vax vms`"), "{errors}");
}

#[test]
fn a_folder_in_use_and_a_full_one_are_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    std::fs::write(folder.join("scene.toml"), SCENE.replace("t_end = 60", "t_end = 6000")).unwrap();
    let mut child = phipsi(&["run", "scene.toml", "--out", "busy"], folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_for(&folder.join("busy/run.json"));
    let second = phipsi(&["run", "--resume", "busy"], folder).output().unwrap();
    let full = phipsi(&["run", "scene.toml", "--out", "busy"], folder).output().unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(second.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&second.stderr).contains("another phipsi process"));
    assert_eq!(full.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&full.stderr).contains("not empty"));
}

/// A force that grows beyond all bounds at t = 0.5 s: the run stops, says where, and keeps the last good state.
#[test]
fn a_run_that_fails_keeps_its_last_good_state() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let scene = "[[body]]\nname = \"rod\"\ninertial = { mass = 1, inertia = { ixx = 1, iyy = 1, izz = 1 } }\n[[joint]]\n\
                 name = \"hinge\"\ntype = \"continuous\"\nparent = \"world\"\nchild = \"rod\"\n[[force]]\nkind = \"torque\"\n\
                 joint = \"hinge\"\nvalue = \"1/(0.5-t)^2\"\n[integrator]\nt_end = 1\n";
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    let output = phipsi(&["run", "scene.toml", "--out", "failing"], folder).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(errors.contains("at t = 0.49999"), "{errors}");
    let run: serde_json::Value = serde_json::from_slice(&read(folder, "failing/run.json")).unwrap();
    assert_eq!(run["status"], "failed");
    let text = read(folder, "failing/checkpoint/state.json");
    let checkpoint: serde_json::Value = serde_json::from_slice(&text).unwrap();
    let t = checkpoint["state"]["stepper"]["Explicit"]["t"].as_f64().unwrap();
    assert!(t > 0.4999 && t < 0.5, "the checkpoint is at {t}");
    let rows = String::from_utf8(read(folder, "failing/trajectory.csv")).unwrap();
    assert_eq!(rows.lines().last().unwrap().split(',').next(), Some("0.495"));
}
