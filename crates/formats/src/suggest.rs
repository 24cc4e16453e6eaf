//! The nearest known word to an unknown one, and short quotations of input.

/// Names longer than this are no misspelling; the distance costs the product of both lengths.
const LONGEST: usize = 64;

/// The known word nearest to `word` by Damerau–Levenshtein distance, if at most a third of its letters differ.
///
/// Case is ignored. The first of equally near words is returned.
///
/// ```
/// assert_eq!(phipsi_formats::nearest("vissual", ["inertial", "visual"]), Some("visual"));
/// assert_eq!(phipsi_formats::nearest("wheel", ["inertial", "visual"]), None);
/// ```
pub fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if word.len() > LONGEST {
        return None;
    }
    let lower = word.to_lowercase();
    let letters = lower.chars().count();
    let allowed = 1.max(letters / 3);
    known
        .into_iter()
        // The distance is at least the difference of the lengths.
        .filter(|k| k.len() <= LONGEST && k.chars().count().abs_diff(letters) <= allowed)
        .map(|k| (strsim::damerau_levenshtein(&lower, &k.to_lowercase()), k))
        .filter(|&(distance, _)| distance <= allowed)
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, k)| k)
}

/// What to do about an unknown word: the nearest known one, or else all of them.
pub(crate) fn remedy(word: &str, known: &[&str], otherwise: &str) -> String {
    match nearest(word, known.iter().copied()) {
        Some(k) => format!("did you mean `{k}`?"),
        None if known.is_empty() => otherwise.into(),
        None => format!("{otherwise}; known: {}", known.join(", ")),
    }
}

/// Text of the input in quotation marks, at most 60 characters of it, control characters escaped.
pub(crate) fn quote(text: &str) -> String {
    format!("\"{}\"", shown(text))
}

/// At most 60 characters of the input, control characters escaped.
pub(crate) fn shown(text: &str) -> String {
    shortened(text, 60)
}

/// At most so many characters, control characters escaped.
pub(crate) fn shortened(text: &str, most: usize) -> String {
    let mut out = String::new();
    for (i, c) in text.chars().enumerate() {
        if i == most {
            out.push('…');
            break;
        }
        if c.is_control() { out.extend(c.escape_default()) } else { out.push(c) }
    }
    out
}
