//! The command `phipsi report`: one JSON value, exit status, interruption.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn benchmark(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/benchmarks").join(name)
}

fn phipsi(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_phipsi"));
    command.arg("report").current_dir(folder).stdin(Stdio::null());
    command
}

#[test]
fn a_report_prints_one_value_and_never_overwrites() {
    let scratch = tempfile::tempdir().unwrap();
    let make = || {
        let scene = benchmark("pendulum.toml");
        phipsi(scratch.path())
            .arg(scene)
            .args(["--out", "made", "--json", "--budget", "5", "--set", "integrator.t_end=2"])
            .output()
            .unwrap()
    };
    let output = make();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(value["finished"], true);
    assert_eq!(value["reference"]["converged"], true);
    assert!(value["reference"]["agreement_q"].as_f64().unwrap() < 1e-11);
    let advice = value["recommendations"].as_array().unwrap();
    let for_six = advice.iter().find(|a| a["error"] == 1e-6).unwrap();
    let command = for_six["command"].as_str().unwrap();
    assert!(command.starts_with("phipsi run ") && command.contains("integrator.method="), "{command}");
    assert!(for_six["error_q"].as_f64().unwrap() <= 1e-6);
    let again = make();
    assert_eq!(again.status.code(), Some(1));
    let refused: serde_json::Value = serde_json::from_slice(&again.stdout).unwrap();
    assert!(refused["error"].as_str().unwrap().contains("not empty"), "{refused}");
    let wrong = phipsi(scratch.path()).arg("scene.toml").args(["--budget", "0"]).output().unwrap();
    assert_eq!(wrong.status.code(), Some(2));
}

#[test]
#[cfg(unix)]
fn an_interrupted_report_keeps_its_runs() {
    let scratch = tempfile::tempdir().unwrap();
    let child = phipsi(scratch.path())
        .arg(benchmark("pendulum.toml"))
        .args(["--out", "made", "--budget", "600", "--set", "integrator.t_end=2000"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let csv = scratch.path().join("made/runs.csv");
    let deadline = Instant::now() + Duration::from_secs(120);
    let rows = || std::fs::read_to_string(&csv).map_or(0, |text| text.lines().count());
    while rows() < 3 {
        assert!(Instant::now() < deadline, "no runs");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{errors}");
    assert!(errors.contains("the runs so far are in made"), "{errors}");
    let page = std::fs::read_to_string(scratch.path().join("made/index.html")).unwrap();
    assert!(page.contains("has not ended"));
    let text = std::fs::read(scratch.path().join("made/report.json")).unwrap();
    let value: serde_json::Value = serde_json::from_slice(&text).unwrap();
    assert_eq!(value["finished"], false);
    assert_eq!(value["runs"].as_array().unwrap().len() + 1, rows());
}
