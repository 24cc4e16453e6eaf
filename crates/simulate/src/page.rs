//! The page of a run: one HTML file that opens from disk, without network, and prints.

mod drawing;
mod equivalent_box;
mod snapshot;

pub use crate::chart::{Chart, Series};
pub use drawing::{Drawing, DrawnBody, IDENTITY_POSE};
pub use equivalent_box::equivalent_box;
pub use snapshot::{View, snapshot_svg};

use std::fmt::Write;

/// What a page shows. All texts are plain; the page escapes them.
#[derive(Clone, Debug, Default)]
pub struct PageData<'a> {
    /// Name of the scene.
    pub title: &'a str,
    /// Names and values of the summary table. The value of a row named `reproduce` is shown as a command.
    pub summary: Vec<(String, String)>,
    /// Shown before everything else.
    pub warnings: Vec<String>,
    /// What the plan left out, and why.
    pub left_out: Vec<String>,
    /// Names and values of the fold-out: hashes, versions. A row named `reproduce` goes to the command, too.
    pub details: Vec<(String, String)>,
    /// Charts, in their order.
    pub charts: Vec<Chart>,
    /// The drawing of the mechanism.
    pub drawing: Option<Drawing>,
}

const HTML: &str = include_str!("page/page.html");
const CSS: &str = include_str!("page/page.css");
const SCRIPTS: [&str; 3] =
    [include_str!("page/motion.js"), include_str!("page/view.js"), include_str!("page/controls.js")];
/// Row of the summary or the details that is a command.
const COMMAND: &str = "reproduce";

/// The page as HTML.
pub fn render(data: &PageData<'_>) -> String {
    let is_command = |row: &&(String, String)| row.0 == COMMAND;
    let commands = data.summary.iter().chain(&data.details).filter(is_command);
    let command: String = commands
        .map(|(_, c)| format!("<h2>Reproduce</h2><pre class=\"command\"><code>{}</code></pre>", escape(c)))
        .collect();
    let details = table(&data.details);
    let details = match details.as_str() {
        "" => String::new(),
        rows => format!("<details><summary>Inputs and versions</summary>{rows}</details>"),
    };
    let charts = data.charts.iter().enumerate().fold(String::new(), |mut out, (i, chart)| {
        let _ = write!(out, "<figure>{}</figure>", chart.to_svg(&format!("chart{i}")));
        out
    });
    let script: String = match data.drawing {
        Some(_) => format!("<script>\"use strict\";\n{}</script>", SCRIPTS.concat()),
        None => String::new(),
    };
    fill(
        HTML,
        &[
            ("title", &escape(data.title)),
            ("css", CSS),
            ("warnings", &list("Warnings", "warnings", &data.warnings)),
            ("summary", &table(&data.summary)),
            ("drawing", &data.drawing.as_ref().map(|d| d.to_html(data.title)).unwrap_or_default()),
            ("charts", &charts),
            ("left_out", &list("Left out", "left-out", &data.left_out)),
            ("command", &command),
            ("details", &details),
            ("script", &script),
        ],
    )
}

/// A template with each `{{name}}` replaced; replacements are not looked into.
fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut out = String::with_capacity(template.len() + values.iter().map(|v| v.1.len()).sum::<usize>());
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        let (name, after) = after.split_once("}}").unwrap_or((after, ""));
        out.push_str(before);
        out.push_str(values.iter().find(|v| v.0 == name).map_or("", |v| v.1));
        rest = after;
    }
    out.push_str(rest);
    out
}

fn table(rows: &[(String, String)]) -> String {
    let rows: String = rows
        .iter()
        .filter(|row| row.0 != COMMAND)
        .map(|(name, value)| {
            format!("<tr><th scope=\"row\">{}</th><td>{}</td></tr>", escape(name), escape(value))
        })
        .collect();
    if rows.is_empty() { rows } else { format!("<table><tbody>{rows}</tbody></table>") }
}

fn list(title: &str, class: &str, items: &[String]) -> String {
    if items.is_empty() {
        return String::new();
    }
    let items: String = items.iter().map(|i| format!("<li>{}</li>", escape(i))).collect();
    format!("<section class=\"{class}\" aria-label=\"{title}\"><h2>{title}</h2><ul>{items}</ul></section>")
}

/// A text for HTML and XML, inside elements and quoted attributes.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(c),
            // XML knows no control characters, escaped or not.
            c if c.is_control() || c == '\u{fffe}' || c == '\u{ffff}' => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const NASTY: &str = "</script><b>\"a\" & 'ü' {{css}} \u{0}\u{2028}-->";

    fn nasty_page() -> String {
        let rows = || vec![(NASTY.to_string(), NASTY.to_string())];
        let series = Series { name: NASTY.into(), points: vec![(0.0, 1.0), (1.0, 2.0)] };
        let chart = Chart {
            title: NASTY.into(),
            x_label: NASTY.into(),
            y_label: NASTY.into(),
            log_y: false,
            log_x: false,
            series: vec![series.clone(), series],
        };
        let body = DrawnBody { name: NASTY.into(), joint: NASTY.into(), ..DrawnBody::default() };
        render(&PageData {
            title: NASTY,
            summary: rows(),
            warnings: vec![NASTY.into()],
            left_out: vec![NASTY.into()],
            details: [rows(), vec![("reproduce".into(), NASTY.into())]].concat(),
            charts: vec![chart],
            drawing: Some(Drawing {
                bodies: vec![body],
                times: vec![0.0],
                poses: IDENTITY_POSE.to_vec(),
                unit: NASTY.into(),
            }),
        })
    }

    #[test]
    fn names_cannot_leave_their_place() {
        let page = nasty_page();
        assert!(!page.contains("<b>") && !page.contains('\u{0}'));
        // Two scripts, the data and the program, and nothing else closes them.
        assert_eq!((page.matches("<script").count(), page.matches("</script>").count()), (2, 2));
        assert_eq!(page.matches("<style>").count(), 1, "a placeholder in a text stays a text");
        assert!(page.contains("&#39;ü&#39; {{css}} \u{fffd}"));
    }

    #[test]
    fn every_placeholder_has_its_part() {
        let page = nasty_page();
        for part in [
            "<title>",
            "class=\"warnings\"",
            "<table>",
            "<canvas",
            "<svg",
            "left-out",
            "command",
            "<details>",
        ] {
            assert!(page.contains(part), "{part}");
        }
        let names: Vec<&str> = HTML.split("{{").skip(1).map(|p| p.split("}}").next().unwrap()).collect();
        let marked: Vec<(&str, &str)> = names.iter().map(|n| (*n, "*")).collect();
        assert_eq!(fill(HTML, &marked).matches('*').count(), names.len());
        assert!(!fill(HTML, &[]).contains("{{"));
    }

    #[test]
    fn nothing_is_fetched() {
        let page = nasty_page();
        // The one address is the name of the SVG language.
        let addresses = page.replace("http://www.w3.org/2000/svg", "");
        assert!(
            !addresses.contains("http://") && !addresses.contains("https://") && !addresses.contains("src=")
        );
        assert!(page.contains("default-src 'none'"));
    }

    #[test]
    fn an_empty_page_is_a_page() {
        let page = render(&PageData { title: "", ..PageData::default() });
        assert!(page.starts_with("<!doctype html>") && page.trim_end().ends_with("</html>"));
        assert!(!page.contains("<canvas") && !page.contains("<table"));
    }
}
