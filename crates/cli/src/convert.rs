//! `phipsi convert`: a URDF file, or a PDB file with its System, to a scene that runs it; a trajectory to another format.

use crate::show::{fail, print_json};
use crate::{Common, Ending};
use phipsi::formats::trajectory;
use phipsi::simulate::convert::{molecule_to_scene, urdf_to_scene};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Writes a scene or a trajectory. `files`: the inputs, then the output.
pub fn convert(files: &[PathBuf], common: &Common) -> Ending {
    if files.last().is_some_and(|output| trajectory::is_trajectory(output)) {
        return match files {
            [input, output] => convert_trajectory(input, None, output, common),
            [input, names, output] => convert_trajectory(input, Some(names), output, common),
            _ => fail(
                "give a trajectory, a PDB file with the names where PDB is written, and the output",
                common,
            ),
        };
    }
    let (written, reports) = match files {
        [urdf, scene] => (scene, urdf_to_scene(urdf, scene).map(|report| vec![report])),
        [pdb, system, scene] => (scene, molecule_to_scene(pdb, system, scene).map(Vec::from)),
        _ => {
            return fail(
                "give a URDF file and the scene to write, or a PDB file, its System and the scene",
                common,
            );
        }
    };
    match reports {
        Ok(reports) => {
            if common.json {
                print_json(&json!({ "written": written.display().to_string() }));
            } else if !common.quiet {
                reports.iter().for_each(|report| anstream::print!("{report}"));
                anstream::println!("written: {}", written.display());
            }
            Ending::Fine
        }
        Err(e) => fail(&e.to_string(), common),
    }
}

fn convert_trajectory(input: &Path, names: Option<&Path>, output: &Path, common: &Common) -> Ending {
    match trajectory::convert(input, names, output) {
        Ok(done) => {
            if common.json {
                let written = output.display().to_string();
                print_json(&json!({ "written": written, "frames": done.frames, "atoms": done.atoms }));
            } else if !common.quiet {
                anstream::println!(
                    "written: {}, {} frames of {} atoms",
                    output.display(),
                    done.frames,
                    done.atoms
                );
            }
            Ending::Fine
        }
        Err(e) => fail(&e.to_string(), common),
    }
}
