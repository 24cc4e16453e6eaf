//! The README and the docs say what the command prints.

use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn text(file: &str) -> String {
    std::fs::read_to_string(root().join(file)).unwrap()
}

fn phipsi(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_phipsi")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Words without what differs between runs and machines: wall time, the folder, and the digits of errors and outputs.
fn lasting(output: &str) -> Vec<String> {
    let is_number = |w: &str| w.trim_matches([',', '(', ')']).parse::<f64>().is_ok();
    output
        .lines()
        .filter(|l| !l.starts_with("run folder"))
        .map(|line| {
            let words = line.split_whitespace().filter(|w| !is_number(w));
            words.collect::<Vec<_>>().join(" ")
        })
        .collect()
}

#[test]
fn the_readme_shows_the_output_of_its_commands() {
    let readme = text("README.md");
    let mut shown = readme.split("```text\nscene ").skip(1).map(|b| b.split("```").next().unwrap());
    for name in ["satellite_arm", "ala_dipeptide"] {
        assert!(readme.contains(&format!("cargo run --release -- run examples/{name}.toml")));
        let shown = format!("scene {}", shown.next().unwrap());
        let scratch = tempfile::tempdir().unwrap();
        let (scene, out) = (root().join(format!("examples/{name}.toml")), scratch.path().join("run"));
        let printed = phipsi(&["run", scene.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        assert_eq!(lasting(&shown), lasting(&printed));
        let page = std::fs::read_to_string(out.join("index.html")).unwrap();
        assert!(
            page.contains("<canvas") && !page.contains("src=\"http"),
            "a page that draws and loads nothing"
        );
    }
}

#[test]
fn the_page_of_conventions_is_what_the_command_prints() {
    let page = text("docs/src/conventions.md");
    let printed = phipsi(&["conventions"]);
    for line in printed.lines() {
        let (matter, choice) = line.split_once(": ").unwrap();
        assert!(page.contains(&format!("| {matter} | {choice} |")), "{matter}");
    }
}

#[test]
fn the_scene_of_the_docs_is_understood() {
    let page = text("docs/src/scenes.md");
    let blocks: Vec<&str> = page.split("```toml\n").skip(1).map(|b| b.split("```").next().unwrap()).collect();
    let scratch = tempfile::tempdir().unwrap();
    // Its model: three links, so that every name of the page exists.
    let inertial = "<inertial><origin xyz='0 0 0.2'/><mass value='1'/><inertia ixx='0.1' iyy='0.1' izz='0.1' ixy='0' \
                    ixz='0' iyz='0'/></inertial>";
    let joint = |name: &str, parent: &str, child: &str| {
        format!(
            "<joint name='{name}' type='continuous'><parent link='{parent}'/><child link='{child}'/><axis xyz='0 1 0'/>\
             </joint>"
        )
    };
    let urdf = format!(
        "<robot name='arm'><link name='base_link'>{inertial}</link><link name='upper'>{inertial}</link>\
         <link name='hand'>{inertial}</link>{}{}</robot>",
        joint("shoulder", "base_link", "upper"),
        joint("elbow", "upper", "hand")
    );
    std::fs::write(scratch.path().join("arm.urdf"), urdf).unwrap();
    let first = scratch.path().join("first.toml");
    std::fs::write(
        &first,
        blocks[0].replace("t_end = 20", "t_end = 0.1").replace("every = 0.05", "every = 0.01"),
    )
    .unwrap();
    let out = scratch.path().join("run");
    let printed = phipsi(&["run", first.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"]);
    let value: serde_json::Value = serde_json::from_str(&printed).unwrap();
    assert_eq!(value["outputs"].as_object().unwrap().len(), 5);
    assert!(value["reference_error"].as_f64().unwrap() > 0.0);
    let second = scratch.path().join("second.toml");
    std::fs::write(&second, format!("{}\n[integrator]\nt_end = 0.1\n", blocks[1])).unwrap();
    phipsi(&["check", second.to_str().unwrap()]);
}
