//! `phipsi convert`: a URDF file to a scene that runs it.

use crate::show::{fail, print_json};
use crate::{Common, Ending};
use phipsi::simulate::convert::urdf_to_scene;
use serde_json::json;
use std::path::Path;

/// Writes a scene for a URDF file.
pub fn convert(input: &Path, output: &Path, common: &Common) -> Ending {
    match urdf_to_scene(input, output) {
        Ok(report) => {
            if common.json {
                print_json(&json!({ "written": output.display().to_string() }));
            } else if !common.quiet {
                anstream::print!("{report}");
                anstream::println!("written: {}", output.display());
            }
            Ending::Fine
        }
        Err(e) => fail(&e.to_string(), common),
    }
}
