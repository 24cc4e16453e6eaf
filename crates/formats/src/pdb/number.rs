//! Numbers of fixed width that go on with letters: hybrid-36.
//!
//! | width 5 | number |
//! |---|---|
//! | ` 9999`, `99999` | itself |
//! | `A0000` … `ZZZZZ` | 100 000 + value in base 36 above A0000 |
//! | `a0000` … `zzzzz` | goes on behind ZZZZZ |

/// The number of a text in a column of this width; `None` where it is none.
pub(super) fn parse(text: &str, width: u32) -> Option<i64> {
    let first = text.chars().next()?;
    if !first.is_ascii_alphabetic() {
        let digits = text.strip_prefix('-').unwrap_or(text);
        return digits.bytes().all(|b| b.is_ascii_digit()).then(|| text.parse().ok())?;
    }
    // One case throughout, and the whole width: anything else is no number.
    let fits =
        |c: char| c.is_ascii_digit() || (c.is_ascii_alphabetic() && c.is_uppercase() == first.is_uppercase());
    if text.len() != width as usize || !text.chars().all(fits) {
        return None;
    }
    let value = i64::from_str_radix(text, 36).ok()?;
    let block = 36i64.pow(width - 1);
    let behind = if first.is_uppercase() { -10 * block } else { 16 * block };
    Some(value + behind + 10i64.pow(width))
}

#[cfg(test)]
mod tests {
    use super::parse;

    #[test]
    fn letters_go_on_where_digits_end() {
        for (text, number) in [
            ("0", 0),
            ("-999", -999),
            ("99999", 99_999),
            ("A0000", 100_000),
            ("A0001", 100_001),
            ("A000Z", 100_035),
            ("ZZZZZ", 43_770_015),
            ("a0000", 43_770_016),
            ("zzzzz", 87_440_031),
        ] {
            assert_eq!(parse(text, 5), Some(number), "{text}");
        }
        assert_eq!(
            (parse("A000", 4), parse("ZZZZ", 4), parse("a000", 4)),
            (Some(10_000), Some(1_223_055), Some(1_223_056))
        );
        for text in ["", "-", "A000", "A000a", "1A000", "*****", "1 2", "+1", "A00é", "1.5"] {
            assert_eq!(parse(text, 5), None, "{text}");
        }
    }
}
