//! Scenes made from models run as they are.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(name)
}

fn phipsi(arguments: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_phipsi")).args(arguments).output().unwrap()
}

#[test]
fn a_scene_of_a_robot_and_one_of_a_molecule_run() {
    let scratch = tempfile::tempdir().unwrap();
    let kinds: [&[&str]; 2] = [&["satellite_arm.urdf"], &["ala_dipeptide.pdb", "ala_dipeptide.xml"]];
    for (i, inputs) in kinds.iter().enumerate() {
        let scene = scratch.path().join(format!("scene {i}.toml"));
        let files: Vec<PathBuf> = inputs.iter().map(|name| example(name)).collect();
        let mut arguments = vec![Path::new("convert")];
        arguments.extend(files.iter().map(PathBuf::as_path));
        arguments.push(&scene);
        let made = phipsi(&arguments);
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        let again = phipsi(&arguments);
        assert_eq!(again.status.code(), Some(1), "an existing scene is never overwritten");
        let out = scratch.path().join(format!("run {i}"));
        let run = phipsi(&[Path::new("run"), &scene, Path::new("--out"), &out]);
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    }
}

#[test]
fn trajectories_are_converted() {
    use phipsi::formats::xtc::XtcWriter;
    let scratch = tempfile::tempdir().unwrap();
    let [xtc, dcd, pdb] = ["a.xtc", "b.dcd", "c.pdb"].map(|name| scratch.path().join(name));
    let positions: Vec<[f64; 3]> = (0..22).map(|i| [0.1 * f64::from(i), 0.2, -0.3]).collect();
    let mut writer = XtcWriter::create(&xtc, 22).unwrap();
    (0..3).for_each(|k| writer.write(10 * k, 0.02 * f64::from(k), &positions).unwrap());
    let made = phipsi(&[Path::new("convert"), &xtc, &dcd, Path::new("--json")]);
    let said: serde_json::Value = serde_json::from_slice(&made.stdout).unwrap();
    assert_eq!((said["frames"].as_u64(), said["atoms"].as_u64()), (Some(3), Some(22)));
    let refused = phipsi(&[Path::new("convert"), &dcd, &pdb]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("a PDB file with the names"));
    let made = phipsi(&[Path::new("convert"), &dcd, &example("ala_dipeptide.pdb"), &pdb]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let text = std::fs::read_to_string(&pdb).unwrap();
    assert_eq!((text.matches("MODEL ").count(), text.matches(" CA  ALA").count()), (3, 3));
}
