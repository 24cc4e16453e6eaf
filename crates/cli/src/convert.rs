//! `phipsi convert`: a URDF file, or a PDB file with its System, to a scene that runs it.

use crate::show::{fail, print_json};
use crate::{Common, Ending};
use phipsi::simulate::convert::{molecule_to_scene, urdf_to_scene};
use serde_json::json;
use std::path::PathBuf;

/// Writes a scene. `files`: the inputs, then the scene.
pub fn convert(files: &[PathBuf], common: &Common) -> Ending {
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
