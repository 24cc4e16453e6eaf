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
