//! The legend below a chart, in lines of names that do not overlap.

use super::{COLORS, LETTER, WIDTH, stroke};
use crate::page::escape;
use std::fmt::Write;

const LINE: f64 = 17.0;
const SWATCH: f64 = 20.0;
/// More names than these are left to hovering.
const MOST_NAMES: usize = 60;
const LONGEST_NAME: usize = 44;

/// Names with their places: x, line.
pub struct Legend {
    entries: Vec<(f64, usize, String)>,
    left_out: usize,
    /// Height of all lines.
    pub height: f64,
}

impl Legend {
    /// Places the names. Where colours repeat, each name begins with the number at its curve's end.
    pub fn new<'a>(names: impl ExactSizeIterator<Item = &'a str>) -> Legend {
        let count = names.len();
        let numbered = count > COLORS.len();
        let (mut x, mut line) = (0.0, 0);
        let mut entries = Vec::new();
        for (i, name) in names.enumerate().take(MOST_NAMES) {
            let short = shortened(name, LONGEST_NAME);
            let text = if numbered { format!("{} {short}", i + 1) } else { short };
            let width = SWATCH + width(&text) + 12.0;
            if x > 0.0 && x + width > WIDTH {
                (x, line) = (0.0, line + 1);
            }
            entries.push((x, line, text));
            x += width;
        }
        let left_out = count.saturating_sub(MOST_NAMES);
        let lines = if entries.is_empty() { 0 } else { line + 1 + usize::from(left_out > 0) };
        Legend { entries, left_out, height: lines as f64 * LINE + 6.0 }
    }

    /// Writes it with its first line at height `top`.
    pub fn write(&self, top: f64, out: &mut String) {
        let mut next = top;
        for (i, (x, line, text)) in self.entries.iter().enumerate() {
            let y = top + *line as f64 * LINE;
            let (middle, after, at) = (y - 4.0, x + SWATCH - 5.0, x + SWATCH);
            let _ = write!(
                out,
                r#"<path {} stroke-width="2.5" d="M{x:.1} {middle:.1}H{after:.1}"/><text x="{at:.1}" y="{y:.1}">{}</text>"#,
                stroke(i),
                escape(text)
            );
            next = y + LINE;
        }
        if self.left_out > 0 {
            let more = self.left_out;
            let _ = write!(
                out,
                r#"<text x="0" y="{next:.1}">and {more} more: point at a curve to see its name</text>"#
            );
        }
    }
}

/// Width of a text, guessed from above: letters outside Latin, Greek and Cyrillic count double.
fn width(text: &str) -> f64 {
    text.chars().map(|c| if c > '\u{24ff}' { 2.0 * LETTER } else { LETTER }).sum()
}

/// A text cut in its middle to at most `most` characters; names often differ at their ends.
pub fn shortened(text: &str, most: usize) -> String {
    let letters: Vec<char> = text.chars().collect();
    if letters.len() <= most {
        return text.into();
    }
    let (head, tail) = ((most - 1) / 2, most / 2);
    letters[..head].iter().chain(&['…']).chain(&letters[letters.len() - tail..]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_one_line_do_not_overlap_and_stay_inside() {
        let names: Vec<String> = (0..80).map(|i| "joint".repeat(1 + i % 13) + &i.to_string()).collect();
        let legend = Legend::new(names.iter().map(String::as_str));
        assert_eq!((legend.entries.len(), legend.left_out), (60, 20));
        for pair in legend.entries.windows(2) {
            let ((x, line, text), (next, next_line, _)) = (&pair[0], &pair[1]);
            assert!(next_line > line || *next >= x + SWATCH + width(text), "{text}");
            assert!(x + SWATCH + width(text) <= WIDTH, "{text}");
        }
    }

    #[test]
    fn long_names_keep_both_ends() {
        assert_eq!(shortened("left_front_wheel", 9), "left…heel");
        assert_eq!(shortened("müßig", 5), "müßig");
    }
}
