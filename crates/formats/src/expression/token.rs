//! Words of expressions.

use super::parser::Problem;
use crate::suggest::quote;

/// Characters that end a name.
const SPECIAL: &str = "+-*/^(),;=";

/// A word of an expression.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Token<'a> {
    Number(f64),
    Name(&'a str),
    /// One of [`SPECIAL`].
    Sign(char),
    End,
}

impl Token<'_> {
    /// For messages.
    pub(super) fn describe(self) -> String {
        match self {
            Token::Number(x) => format!("the number {x}"),
            Token::Name(name) => format!("the name {}", quote(name)),
            Token::Sign(c) => format!("`{c}`"),
            Token::End => "the end".into(),
        }
    }
}

/// The token that begins at byte `from` after white space: its first byte, itself, and the byte after it.
///
/// # Errors
/// A number that cannot be read, and characters that no name should have.
pub(super) fn next(text: &str, from: usize) -> Result<(usize, Token<'_>, usize), Problem> {
    let rest = text[from..].trim_start();
    let start = text.len() - rest.len();
    let Some(first) = rest.chars().next() else { return Ok((start, Token::End, start)) };
    if SPECIAL.contains(first) {
        return Ok((start, Token::Sign(first), start + first.len_utf8()));
    }
    if first == '.' || first.is_ascii_digit() {
        let length = number_length(rest.as_bytes());
        let word = &rest[..length];
        return match word.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok((start, Token::Number(x), start + length)),
            Ok(_) => Err(Problem::new(
                start,
                format!("number {}", quote(word)),
                "a number up to 1.8e308",
                "give a smaller number",
            )),
            Err(_) => Err(Problem::new(
                start,
                format!("number {}", quote(word)),
                "a decimal number",
                "write it like 1.5 or 2e-3",
            )),
        };
    }
    let length = rest.find(|c: char| c.is_whitespace() || SPECIAL.contains(c)).unwrap_or(rest.len());
    let name = &rest[..length];
    if !name.contains(|c: char| c.is_alphanumeric() || c == '_') {
        let remedy = match name {
            "%" => "write x - y*floor(x/y) for the remainder",
            "<" | ">" | "<=" | ">=" | "==" | "!=" | "&&" | "||" | "?" => {
                "use step, delta, min, max and select for conditions"
            }
            _ => "remove it",
        };
        return Err(Problem::new(start, quote(name), "a name, a number or one of + - * / ^ ( ) , ;", remedy));
    }
    Ok((start, Token::Name(name), start + length))
}

/// Digits, at most one point, at most one exponent with its sign.
fn number_length(bytes: &[u8]) -> usize {
    let (mut point, mut exponent, mut i) = (false, false, 0);
    while let Some(b) = bytes.get(i) {
        match b {
            b'0'..=b'9' => {}
            b'.' if !point && !exponent => point = true,
            b'e' | b'E' if !exponent => {
                exponent = true;
                if matches!(bytes.get(i + 1), Some(b'+' | b'-')) {
                    i += 1;
                }
            }
            _ => break,
        }
        i += 1;
    }
    i
}
