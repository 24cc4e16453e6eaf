//! XML with bounds: lines of everything, and refusal of what would take more than linear time.

use crate::report::Problem;
use crate::suggest::shortened;
use roxmltree::{Attribute, Document, Node, ParsingOptions};

/// Deepest nesting of elements; a robot file has about ten levels.
const DEEPEST: usize = 200;
/// Most attributes of one element: the parser compares each with all before it.
const MOST_ATTRIBUTES: usize = 200;
/// Most namespace declarations of a document: the parser copies those in scope for each element that adds one.
const MOST_NAMESPACES: usize = 1000;
/// Most nodes of a document, about 100 bytes each.
const MOST_NODES: u32 = 20_000_000;

/// Line numbers of byte positions, in logarithmic time.
pub(crate) struct Lines {
    starts: Vec<usize>,
}

impl Lines {
    pub(crate) fn new(text: &str) -> Self {
        let newlines = text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i + 1);
        Lines { starts: std::iter::once(0).chain(newlines).collect() }
    }
    /// The line, from 1, of a byte position.
    pub(crate) fn line(&self, byte: usize) -> u32 {
        u32::try_from(self.starts.partition_point(|&s| s <= byte)).unwrap_or(u32::MAX)
    }
    /// The line of an element's start tag.
    pub(crate) fn of(&self, node: Node<'_, '_>) -> Option<u32> {
        Some(self.line(node.range().start))
    }
    /// The line of an attribute's value.
    pub(crate) fn of_attribute(&self, attribute: &Attribute<'_, '_>) -> Option<u32> {
        Some(self.line(attribute.range_value().start))
    }
}

/// Parses a document.
///
/// # Errors
/// The first violation of XML's grammar or of this module's bounds, with its line.
pub(crate) fn parse(text: &str) -> Result<Document<'_>, Problem> {
    check_bounds(text)?;
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MOST_NODES, ..Default::default() };
    Document::parse_with_options(text, options).map_err(|error| {
        let position = match error {
            // These have no place of their own: it is the end.
            roxmltree::Error::UnexpectedEndOfStream | roxmltree::Error::UnclosedRootNode => {
                let last = text.trim_end().rsplit('\n').next().unwrap_or_default();
                let row = 1 + text.trim_end().bytes().filter(|b| *b == b'\n').count();
                roxmltree::TextPos::new(u32::try_from(row).unwrap_or(u32::MAX), last.chars().count() as u32 + 1)
            }
            _ => error.pos(),
        };
        let remedy = match &error {
            roxmltree::Error::UnknownNamespace(prefix, _) if prefix == "xacro" => {
                "expand the file with the program xacro first"
            }
            roxmltree::Error::UnknownNamespace(..) => "declare the prefix in <robot> by xmlns:PREFIX=\"…\"",
            roxmltree::Error::DtdDetected => "remove the DOCTYPE declaration",
            roxmltree::Error::NodesLimitReached => "split the file",
            _ => "correct the file at this place; if it is made by a program, see whether it was written to its end",
        };
        let place = format!("XML, column {}", position.col);
        // The message repeats names of the file, of any length.
        let found = shortened(&error.to_string(), 200);
        Problem::new(Some(position.row), place, found, "well-formed XML without a DTD", remedy)
    })
}

/// One pass over the tags: nesting, attributes, namespaces. What is not well formed is left to the parser.
fn check_bounds(text: &str) -> Result<(), Problem> {
    let bytes = text.as_bytes();
    let after = |from: usize, end: &str| text[from..].find(end).map_or(text.len(), |i| from + i + end.len());
    let problem = |at: usize, found: String, required: String| {
        let line = Lines::new(&text[..at]).starts.len();
        Problem::new(
            u32::try_from(line).ok(),
            "XML",
            found,
            required,
            "see whether a program wrote the file wrongly",
        )
    };
    let (mut depth, mut namespaces, mut i) = (0usize, 0usize, 0);
    while let Some(start) = text[i..].find('<').map(|k| i + k) {
        let rest = &bytes[start..];
        if rest.starts_with(b"<!--") {
            i = after(start + 4, "-->");
        } else if rest.starts_with(b"<![CDATA[") {
            i = after(start, "]]>");
        } else if rest.starts_with(b"<?") {
            i = after(start, "?>");
        } else {
            let (mut end, mut quote, mut attributes) = (start + 1, None, 0usize);
            while end < bytes.len() && (quote.is_some() || bytes[end] != b'>') {
                match (quote, bytes[end]) {
                    (None, b @ (b'"' | b'\'')) => quote = Some(b),
                    (Some(q), b) if q == b => {
                        quote = None;
                        attributes += 1;
                    }
                    _ => {}
                }
                end += 1;
            }
            if attributes > MOST_ATTRIBUTES {
                let found = format!("an element with {attributes} attributes");
                return Err(problem(start, found, format!("at most {MOST_ATTRIBUTES}")));
            }
            namespaces += text[start..end].matches("xmlns").count();
            if namespaces > MOST_NAMESPACES {
                let found = format!("{namespaces} namespace declarations");
                return Err(problem(start, found, format!("at most {MOST_NAMESPACES}")));
            }
            if rest.starts_with(b"</") {
                depth = depth.saturating_sub(1);
            } else if end < bytes.len() && bytes[end - 1] != b'/' && !rest.starts_with(b"<!") {
                depth += 1;
            }
            if depth > DEEPEST {
                let found = format!("elements nested {depth} deep");
                return Err(problem(start, found, format!("at most {DEEPEST} levels")));
            }
            i = end;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_those_of_the_parser() {
        let text = "<a>\n<b/>\n\n<c d='1'/></a>";
        let (lines, document) = (Lines::new(text), parse(text).unwrap());
        for node in document.descendants() {
            assert_eq!(lines.line(node.range().start), document.text_pos_at(node.range().start).row);
        }
    }

    #[test]
    fn bounds_count_tags_and_nothing_else() {
        let comment = format!(
            "<a><!-- {} --><![CDATA[{}]]><b c='{}'/></a>",
            "<x>".repeat(999),
            "<y>".repeat(999),
            ">'\"".len()
        );
        assert!(parse(&comment).is_ok());
        assert!(parse(&format!("<a>{}</a>", "<b/><c></c>".repeat(1000))).is_ok());
        let at_limit = format!("{}{}", "<a>".repeat(DEEPEST), "</a>".repeat(DEEPEST));
        assert!(parse(&at_limit).is_ok());
        let deep = format!("<r>\n{}{}</r>", "<a>".repeat(DEEPEST), "</a>".repeat(DEEPEST));
        assert_eq!(parse(&deep).unwrap_err().line, Some(2));
        let wide: String = (0..=MOST_ATTRIBUTES).map(|i| format!(" a{i}='1'")).collect();
        assert!(parse(&format!("<r{wide}/>")).unwrap_err().found.contains("attributes"));
    }

    #[test]
    fn a_hundred_thousand_levels_are_refused_at_once() {
        let deep = "<a>".repeat(100_000);
        assert!(parse(&deep).unwrap_err().found.contains("nested 201 deep"));
        let namespaces = "<b xmlns:q='u'/>".repeat(100_000);
        assert!(parse(&format!("<a>{namespaces}</a>")).unwrap_err().found.contains("namespace"));
        // A comment opened and never closed, many times over, must not be searched again and again.
        assert!(parse(&"<!--".repeat(200_000)).is_err());
    }
}
