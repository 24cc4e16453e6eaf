//! Numbers and tables for people, errors for people and for programs.

use crate::{Common, Ending};
use serde_json::{Value, json};

/// Lines of a table: left column padded, continued lines indented.
pub fn table(rows: &[(&str, Vec<String>)]) -> String {
    let width = rows.iter().map(|r| r.0.len()).max().unwrap_or(0);
    let mut text = String::new();
    for (name, lines) in rows {
        for (i, line) in lines.iter().enumerate() {
            let label = if i == 0 { name } else { "" };
            text += &format!("{label:width$}  {line}\n");
        }
    }
    text
}

/// Prints one JSON value.
pub fn print_json(value: &Value) {
    anstream::println!("{value}");
}

/// Says why a command failed.
pub fn fail(message: &str, common: &Common) -> Ending {
    if common.json {
        print_json(&json!({ "error": message }));
    }
    anstream::eprintln!(
        "{}",
        if message.starts_with("error") { message.into() } else { format!("error: {message}") }
    );
    Ending::Failed
}
