//! Printed text that is compared with written text: words exactly, numbers with a tolerance.
//!
//! The last digits of a number may differ between processors. So numbers that are near enough
//! are made equal first; then the texts are compared as text, and a difference that is shown is
//! one that matters.

/// How far a number with decimals may be from the written one: the larger of both. Whole numbers
/// are counts, and are compared exactly.
#[derive(Clone, Copy)]
pub struct Tolerance {
    /// Of the written number.
    pub relative: f64,
    /// In the number's own unit.
    pub absolute: f64,
}

/// For what the program computes.
pub const NEAR: Tolerance = Tolerance {
    relative: 1e-3,
    absolute: 0.0,
};

/// `found`, in which each line that has the words and, within the tolerance, the numbers of a
/// line of `written` is replaced by the latter. The lines are looked for in their order.
pub fn settle(found: &str, written: &str, tolerance: Tolerance) -> String {
    let mut lines: Vec<&str> = found.lines().collect();
    let mut from = 0;
    for line in written.lines() {
        let alike = |found: &&str| alike(found, line, tolerance);
        if let Some(after) = lines[from..].iter().position(alike) {
            lines[from + after] = line;
            from += after + 1;
        }
    }
    let mut text = lines.join("\n");
    if found.ends_with('\n') {
        text.push('\n');
    }
    text
}

/// Whether two lines have the same words and near numbers.
fn alike(found: &str, written: &str, tolerance: Tolerance) -> bool {
    let (found, written) = (parts(found), parts(written));
    found.len() == written.len()
        && found
            .iter()
            .zip(&written)
            .all(|(found, written)| match (found, written) {
                (Part::Number(found), Part::Number(written)) => near(found, written, tolerance),
                (Part::Word(found), Part::Word(written)) => found == written,
                _ => false,
            })
}

#[derive(Debug, PartialEq)]
enum Part<'a> {
    /// With the sign that Rust reads.
    Number(String),
    Word(&'a str),
}

/// The words and numbers of a line. White space separates them and does not count, because
/// columns move with the width of a number.
fn parts(line: &str) -> Vec<Part<'_>> {
    let mut parts = Vec::new();
    for word in line.split_whitespace() {
        let mut rest = word;
        while !rest.is_empty() {
            let (before, number, after) = next_number(rest);
            if !before.is_empty() {
                parts.push(Part::Word(before));
            }
            if !number.is_empty() {
                parts.push(Part::Number(number.replace('−', "-")));
            }
            rest = after;
        }
    }
    parts
}

/// What is before the first number of a word, the number, and what is after it. Digits within
/// a name, as in `block15` or a checksum, are no number.
fn next_number(word: &str) -> (&str, &str, &str) {
    let mut previous = None;
    for (at, c) in word.char_indices() {
        let in_name = previous.is_some_and(|c: char| c.is_alphanumeric() || c == '_' || c == '.');
        let length = number_length(&word[at..]);
        if !in_name && length > 0 {
            let (number, after) = word[at..].split_at(length);
            if !after.starts_with(|c: char| c.is_alphanumeric() || c == '_') {
                return (&word[..at], number, after);
            }
        }
        previous = Some(c);
    }
    (word, "", "")
}

/// The length of the number at the start of `text`, in bytes; 0 if there is none. A number has
/// digits and may have a sign, decimals and an exponent.
fn number_length(text: &str) -> usize {
    let digits = |from: usize| {
        let rest = &text[from..];
        rest.find(|c: char| !c.is_ascii_digit())
            .unwrap_or(rest.len())
    };
    let sign = |from: usize| {
        let first = text[from..].chars().next();
        first
            .filter(|c| "+-−".contains(*c))
            .map_or(0, char::len_utf8)
    };
    let start = sign(0);
    let whole = digits(start);
    if whole == 0 {
        return 0;
    }
    let mut end = start + whole;
    if text[end..].starts_with('.') && digits(end + 1) > 0 {
        end += 1 + digits(end + 1);
    }
    if text[end..].starts_with(['e', 'E']) {
        let exponent = end + 1 + sign(end + 1);
        if digits(exponent) > 0 {
            end = exponent + digits(exponent);
        }
    }
    end
}

/// Whether a number is near the written one.
fn near(found: &str, written: &str, tolerance: Tolerance) -> bool {
    match (found.parse::<f64>(), written.parse::<f64>()) {
        (Ok(a), Ok(b)) if written.contains('.') => {
            (a - b).abs() <= (tolerance.relative * b.abs()).max(tolerance.absolute)
        }
        _ => found == written,
    }
}

#[cfg(test)]
mod tests {
    use super::{NEAR, Tolerance, settle};

    /// Near numbers are taken as written, whatever their column, sign and exponent.
    #[test]
    fn near_numbers_are_settled() {
        for (found, written) in [
            ("mass  10.000 kg", "mass 9.9999 kg"),
            ("a (12.345), −58.80 dB", "a (12.346), −58.81 dB"),
            ("-0.000", "0.000"),
            ("1.2345e-6 m, ±30.00°", "1.2346e-6 m, ±30.01°"),
            ("block15 at 1.000.", "block15 at 1.001."),
        ] {
            assert_eq!(settle(found, written, NEAR), written);
        }
        let far = Tolerance {
            relative: 0.05,
            absolute: 0.25,
        };
        assert_eq!(
            settle("0.3 of 99.0 dB", "0.1 of 95.0 dB", far),
            "0.1 of 95.0 dB"
        );
    }

    #[test]
    fn words_counts_and_far_numbers_are_not() {
        for (found, written) in [
            ("mass 10.00 kg", "mass 10.02 kg"),
            ("0.71 Hz", "0.72 Hz"),
            ("mass 10.00 kg", "mass 10.00 g"),
            ("10001 steps", "10000 steps"),
            ("block15.0", "block15.1"),
            ("-58.80", "58.80"),
            ("1.2345e-6", "1.2345e-5"),
            ("a 1.00", "a"),
        ] {
            assert_eq!(settle(found, written, NEAR), found);
        }
    }

    /// Lines are looked for in their order, past those that are not written.
    #[test]
    fn lines_in_their_order() {
        let found = "head\nsum 1.001\nmore\nsum 2.001\n";
        assert_eq!(
            settle(found, "...\nsum 2.000\n", NEAR),
            "head\nsum 1.001\nmore\nsum 2.000\n"
        );
        assert_eq!(
            settle(found, "sum 2.000\nsum 1.000\n", NEAR),
            "head\nsum 1.001\nmore\nsum 2.000\n"
        );
    }
}
