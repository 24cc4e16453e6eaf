//! The table of stiff and extreme scenes for people, for programs and for the documentation.

use super::Finding;
use serde_json::{Value, json};

/// The list that `phipsi stress --json` prints; `null` where a scene has no such number.
pub fn json(findings: &[Finding]) -> Value {
    let one = |f: &Finding| {
        json!({
            "name": f.name,
            "family": f.family,
            "what": f.what,
            "forward_error": f.forward_error(),
            "kappa": f.measured.kappa,
            "backward_error": f.backward_error(),
            "drift": f.measured.drift,
            "steps": f.measured.steps,
            "wall_s": f.measured.wall_s,
            "outcome": f.measured.outcome.to_string(),
            "message": f.measured.message,
        })
    };
    Value::Array(findings.iter().map(one).collect())
}

pub(super) fn number(x: Option<f64>) -> String {
    x.map_or("–".into(), |x| if x == 0.0 { "0".into() } else { format!("{x:.1e}") })
}

fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 1e-3 => format!("{:.3} µs", 1e6 * s),
        s if s < 1.0 => format!("{:.3} ms", 1e3 * s),
        s => format!("{s:.2} s"),
    }
}

const COLUMNS: [&str; 8] =
    ["scene", "outcome", "forward / εκ", "κ", "backward / ε", "drift", "steps", "time"];

fn cells(f: &Finding) -> [String; 8] {
    [
        f.name.clone(),
        f.measured.outcome.to_string(),
        number(f.forward_error()),
        number(f.measured.kappa),
        number(f.backward_error()),
        number(f.measured.drift),
        f.measured.steps.map_or("–".into(), |n| n.to_string()),
        duration(f.measured.wall_s),
    ]
}

/// For a terminal: a line for each scene, with what was refused, warned or wrong under its line.
pub fn table(findings: &[Finding]) -> String {
    let rows: Vec<_> = findings.iter().map(cells).collect();
    let width = |i: usize| {
        let cells = rows.iter().map(|r| r[i].chars().count());
        cells.chain([COLUMNS[i].chars().count()]).max().unwrap_or(0)
    };
    let widths: [usize; 8] = std::array::from_fn(width);
    let line = |cells: [&str; 8]| {
        let padded = cells.iter().zip(widths).map(|(c, w)| format!("{c:w$}"));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_string() + "\n"
    };
    let mut text = line(COLUMNS);
    for (f, row) in findings.iter().zip(&rows) {
        text += &line(std::array::from_fn(|i| row[i].as_str()));
        if f.measured.outcome != super::Outcome::Right {
            text += &format!("    {}\n", f.measured.message.replace('\n', " "));
        }
    }
    text + &format!("{}\n", summary(findings))
}

/// How many of each outcome.
fn summary(findings: &[Finding]) -> String {
    use super::Outcome::*;
    let count = |o| findings.iter().filter(|f| f.measured.outcome == o).count();
    format!(
        "{} right, {} refused, {} warned, {} wrong",
        count(Right),
        count(Refused),
        count(Warned),
        count(Wrong)
    )
}

/// The tables of the documentation's page, in Markdown.
pub fn page(findings: &[Finding]) -> String {
    let mut text = format!("{} scenes: {}.\n", findings.len(), summary(findings));
    let mut family = "";
    for f in findings {
        if f.family != family {
            family = f.family;
            text += &format!("\n## {}{}\n\n", family[..1].to_uppercase(), &family[1..]);
            text +=
                &format!("| {} | what is extreme | form or method; what was said |\n", COLUMNS.join(" | "));
            text += &format!("|{}\n", "---|".repeat(COLUMNS.len() + 2));
        }
        let message = f.measured.message.replace('|', "\\|").replace('\n', " ");
        text += &format!("| {} | {} | {message} |\n", cells(f).join(" | "), f.what);
    }
    text
}
