//! ATOM and HETATM records.
//!
//! | columns | what |
//! |---|---|
//! | 7–11 | serial number |
//! | 13–16 | name; the element ends in column 14 |
//! | 17 | alternate location |
//! | 18–21 | name of the residue; the format has 18–20, CHARMM's names take one more |
//! | 22, 23–26, 27 | chain, number of the residue, insertion code |
//! | 31–38, 39–46, 47–54 | x, y, z in Å |
//! | 77–78 | element |

use super::{PdbAtom, element, number};
use crate::suggest::quote;

/// What is wrong with a record.
pub(super) struct Mistake {
    pub place: String,
    pub found: String,
    pub required: &'static str,
    pub remedy: &'static str,
}

/// An atom, the text of its serial number, and its alternate location; its residue's index is still to be set.
pub(super) fn parse(line: &str, number: u32) -> Result<(PdbAtom, String, char), Mistake> {
    let field = |from: usize, to: usize| line.get(from - 1..to.min(line.len())).unwrap_or_default().trim();
    let serial = field(7, 11);
    let place = format!("atom {} {} {}{}", field(13, 16), field(18, 21), field(22, 22), field(23, 27));
    let mistake = |found: String, required, remedy| Mistake { place: place.clone(), found, required, remedy };
    if !line.is_ascii() {
        let remedy = "replace it: the columns of an atom are counted in bytes";
        return Err(mistake("a character that is not ASCII".into(), "ASCII characters", remedy));
    }
    if line.len() < 54 {
        let found = format!("a record of {} columns", line.len());
        return Err(mistake(found, "at least 54 columns", "see whether the file was written to its end"));
    }
    let name = field(13, 16);
    if name.is_empty() {
        return Err(mistake("no name in columns 13-16".into(), "the name of the atom", "add it"));
    }
    let mut position = [0.0; 3];
    for (axis, x) in position.iter_mut().enumerate() {
        let text = field(31 + 8 * axis, 38 + 8 * axis);
        match text.parse::<f64>() {
            // Å to nm, rounded once.
            Ok(value) if value.is_finite() => *x = value / 10.0,
            _ => {
                let axis = ["x", "y", "z"][axis];
                let found = format!("{axis} is {}", quote(text));
                let required = "decimal numbers in columns 31-38, 39-46, 47-54";
                return Err(mistake(
                    found,
                    required,
                    "correct it; positions may not reach out of their columns",
                ));
            }
        }
    }
    let residue = field(23, 26);
    let Some(residue_number) = number::parse(residue, 4) else {
        let found = format!("residue number {}", quote(residue));
        return Err(mistake(found, "a whole number or hybrid-36 in columns 23-26", "correct it"));
    };
    // Some programs write asterisks beyond 99 999: there is no number then.
    let has_number = !serial.is_empty() && !serial.bytes().all(|b| b == b'*');
    let serial_number = number::parse(serial, 5);
    if has_number && serial_number.is_none() {
        let found = format!("serial number {}", quote(serial));
        return Err(mistake(found, "a whole number or hybrid-36 in columns 7-11", "correct it"));
    }
    let character = |column: usize| line.as_bytes().get(column - 1).map_or(' ', |b| *b as char);
    let atom = PdbAtom {
        name: name.into(),
        residue_name: field(18, 21).into(),
        chain: field(22, 22).into(),
        residue_number,
        insertion_code: character(27),
        residue: 0,
        element: element::symbol(field(77, 78)).unwrap_or_default().into(),
        position,
        serial: serial_number,
        hetero: line.starts_with("HETATM"),
        line: number,
    };
    Ok((atom, if has_number { serial.into() } else { String::new() }, character(17)))
}

/// The element that the columns of an atom's name mean: two letters that begin in column 13, one in column 14.
pub(super) fn element_of_name(line: &str) -> Option<String> {
    let columns = line.get(12..16)?;
    // Ions are called like their residue, wherever they stand: Cl.
    if columns.trim() == line.get(17..21)?.trim()
        && let Some(symbol) = element::symbol(columns.trim())
    {
        return Some(symbol.into());
    }
    let first = columns.get(..2)?.trim_matches(|c: char| c == ' ' || c.is_ascii_digit());
    // A name of four letters begins in column 13 also where its element has one: HG21, HN11.
    let is_long = !columns.contains(' ') && columns.starts_with(['H', 'C', 'N', 'O', 'D']);
    let symbol = match first.len() {
        0 => columns.trim().trim_start_matches(|c: char| c.is_ascii_digit()).get(..1)?,
        _ if is_long => &first[..1],
        _ => first,
    };
    element::symbol(symbol).or_else(|| element::symbol(symbol.get(..1)?)).map(String::from)
}
