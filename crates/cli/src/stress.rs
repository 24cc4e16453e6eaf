//! `phipsi stress`: the stiff and extreme scenes.

use crate::show::{fail, print_json};
use crate::{Common, Ending, interrupt};
use clap::Args;
use phipsi::simulate::stress::{Finding, Outcome, json, page, select, table};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Which scenes, and where the table goes.
#[derive(Args)]
pub struct Options {
    /// Only the scene or the family of that name
    #[arg(long, value_name = "NAME")]
    only: Option<String>,
    /// Leave out the scenes that take seconds
    #[arg(long)]
    quick: bool,
    /// Put the tables into a page of Markdown, between its marks `<!-- tables: begin -->` and `<!-- tables: end -->`
    #[arg(long, value_name = "FILE.md")]
    page: Option<PathBuf>,
}

/// Runs and prints them.
pub fn stress(options: &Options, common: &Common) -> Ending {
    interrupt::listen();
    let mut scenes = match select(options.only.as_deref()) {
        Ok(scenes) => scenes,
        Err(e) => return fail(&e, common),
    };
    scenes.retain(|s| !(options.quick && s.slow));
    let (begun, count) = (Instant::now(), scenes.len());
    let mut findings: Vec<Finding> = Vec::with_capacity(count);
    for scene in scenes {
        if interrupt::asked() {
            break;
        }
        if !common.quiet && begun.elapsed() > Duration::from_secs(1) {
            anstream::eprintln!("{} of {count}: {}", findings.len() + 1, scene.name);
        }
        findings.push(scene.run());
    }
    if common.json {
        print_json(&json(&findings));
    } else {
        anstream::print!("{}", table(&findings));
    }
    if findings.len() < count {
        return Ending::Interrupted;
    }
    if let Some(file) = &options.page
        && let Err(e) = write(file, &page(&findings))
    {
        return fail(&e, common);
    }
    let bad = |f: &Finding| match f.measured.outcome {
        Outcome::Wrong => true,
        Outcome::Warned => common.strict,
        Outcome::Right | Outcome::Refused => false,
    };
    if findings.iter().any(bad) { Ending::Failed } else { Ending::Fine }
}

fn write(file: &Path, tables: &str) -> Result<(), String> {
    let (begin, end) = ("<!-- tables: begin -->\n", "<!-- tables: end -->");
    let text = std::fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))?;
    let first = text.find(begin).map(|i| i + begin.len());
    let last = text.find(end);
    let (Some(first), Some(last)) = (first, last) else {
        return Err(format!(
            "{}: it has no marks `{}` and `{end}` for the tables",
            file.display(),
            begin.trim()
        ));
    };
    let whole = format!("{}\n{tables}\n{}", &text[..first], &text[last..]);
    std::fs::write(file, whole).map_err(|e| format!("{}: {e}", file.display()))
}
