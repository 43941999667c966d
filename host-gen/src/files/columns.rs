//! Tables of comma-separated values: lines, names of columns with units, numbers.

/// Why a text is not what it should be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct TextError {
    /// Number of the line at fault, from 1; none if it is the text as a whole.
    pub line: Option<usize>,
    /// The cause and the fix.
    pub message: String,
}

impl TextError {
    /// That of a line, from 1.
    pub(crate) fn at(line: usize, message: String) -> Self {
        let line = Some(line);
        Self { line, message }
    }

    /// That of the text as a whole.
    pub(crate) fn whole(message: impl Into<String>) -> Self {
        Self {
            line: None,
            message: message.into(),
        }
    }
}

/// Whether a line is more than a comment.
fn has_data(line: &str) -> bool {
    let line = line.trim();
    !line.is_empty() && !line.starts_with('#')
}

/// The number, from 1, of the first line of `text` with data at or behind a byte.
pub(crate) fn line_at(text: &str, byte: usize) -> usize {
    let (before, behind) = text.split_at_checked(byte).unwrap_or((text, ""));
    let lines = before.matches('\n').count() + 1;
    lines + behind.lines().take_while(|line| !has_data(line)).count()
}

/// What separates the columns: the first of these that a line has.
fn separator(line: &str) -> u8 {
    let found = [';', '\t', ',', ' ']
        .into_iter()
        .find(|c| line.contains(*c));
    found.map_or(b',', |c| c as u8)
}

/// Reads a table whose columns are separated by commas, semicolons, tabs or spaces, and whose first line
/// has names or numbers; `#` starts a comment line. `line` is called with the fields of each line and the
/// byte of `text` that it begins at.
///
/// # Errors
/// If `text` has no line, as "the … is empty" with `what` it is; or with what `line` says, at that line.
pub(crate) fn each_line(
    text: &str,
    what: &str,
    mut line: impl FnMut(&[&str], usize) -> Result<(), String>,
) -> Result<(), TextError> {
    let first = text.lines().find(|line| has_data(line));
    let first = first.ok_or_else(|| TextError::whole(format!("the {what} is empty")))?;
    // A space in a name separates nothing.
    let number = |line: &&str| {
        line.trim_start()
            .starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c))
    };
    let numbers = text.lines().find(number);
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .delimiter(separator(numbers.unwrap_or(first).trim()))
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .flexible(true)
        .from_reader(text.as_bytes());
    for record in reader.records() {
        let record = record.map_err(|error| TextError::whole(error.to_string()))?;
        let begin = record.position().map_or(0, |at| at.byte() as usize);
        let fields: Vec<&str> = record.iter().filter(|field| !field.is_empty()).collect();
        if !fields.is_empty() {
            let done = line(&fields, begin);
            done.map_err(|message| TextError::at(line_at(text, begin), message))?;
        }
    }
    Ok(())
}

/// The fields of a line with their columns.
///
/// # Errors
/// In words, if there are more or fewer fields than `columns`.
pub(crate) fn in_columns<'a, C>(
    columns: &'a [C],
    fields: &'a [&'a str],
) -> Result<impl Iterator<Item = (&'a C, &'a str)>, String> {
    if fields.len() != columns.len() {
        return Err(format!(
            "{} values, but there are {} columns; decimals have a point",
            fields.len(),
            columns.len()
        ));
    }
    Ok(columns.iter().zip(fields.iter().copied()))
}

/// The number that a field is.
pub(crate) fn number(field: &str) -> Result<f64, String> {
    match field.parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err(format!(
            "\"{field}\" is not a number; decimals have a point"
        )),
    }
}

/// The name of a column and its unit, which stands in brackets.
pub(crate) fn name_and_unit(head: &str) -> (String, Option<&str>) {
    let head = head.trim();
    let close = head.find(['[', '(']).zip(head.rfind([']', ')']));
    match close {
        Some((open, close)) if open < close => (
            head[..open].trim().to_lowercase(),
            Some(head[open + 1..close].trim()),
        ),
        _ => (head.to_lowercase(), None),
    }
}

/// Seconds in a unit of time.
pub(crate) fn seconds_in(unit: Option<&str>) -> Result<f64, String> {
    match unit {
        None | Some("s") => Ok(1.0),
        Some("ms") => Ok(1e-3),
        Some("µs" | "us") => Ok(1e-6),
        Some(unit) => Err(format!(
            "\"{unit}\" is no unit of time here; use s, ms or µs"
        )),
    }
}
