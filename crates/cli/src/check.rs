//! `phipsi check`.

use crate::show::{fail, print_json};
use crate::{Common, Ending};
use phipsi::simulate::check::{Checked, check_file};
use serde_json::Value;
use std::path::PathBuf;

/// Checks files one after the other.
pub fn check(files: &[PathBuf], common: &Common) -> Ending {
    let checked: Vec<Checked> = files.iter().map(|f| check_file(f)).collect();
    if common.json {
        print_json(&Value::Array(checked.iter().map(Checked::to_json).collect()));
    } else {
        for (i, c) in checked.iter().enumerate() {
            if i > 0 {
                anstream::println!();
            }
            anstream::print!("{c}");
        }
    }
    let refused = checked.iter().filter(|c| !c.is_ok(common.strict)).count();
    match refused {
        0 => Ending::Fine,
        _ if common.json => Ending::Failed,
        n => fail(&format!("{n} of {} files cannot be used", files.len()), common),
    }
}
