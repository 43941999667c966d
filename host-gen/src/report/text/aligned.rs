//! Tables in text, as wide as their content.

use std::fmt::{self, Formatter};

use anstyle::{AnsiColor, Style};
use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, ContentArrangement, Table};

/// Style of a heading.
pub const TITLE: Style = Style::new().bold();

/// Style of a warning.
pub const WARNING: Style = AnsiColor::Yellow.on_default().bold();

/// Writes rows of cells: the first `names` columns aligned left, all others right, with
/// `indent` spaces before each row.
pub fn write_table(
    f: &mut Formatter<'_>,
    indent: usize,
    names: usize,
    rows: impl IntoIterator<Item = Vec<String>>,
) -> fmt::Result {
    let mut table = Table::new();
    table
        .load_style(NOTHING)
        .set_content_arrangement(ContentArrangement::Disabled)
        .add_rows(rows);
    for (i, column) in table.column_iter_mut().enumerate() {
        column.set_padding((if i == 0 { 0 } else { 2 }, 0));
        if i >= names {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    for line in table.lines() {
        writeln!(f, "{:indent$}{}", "", line.trim_end())?;
    }
    Ok(())
}

/// The cells of a row.
pub fn cells<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_owned).to_vec()
}

/// Columns after which a list goes on in the next line.
const WIDTH: usize = 100;

/// Writes words after a heading, in lines of at most [`WIDTH`] columns as far as words are
/// shorter; `indent` spaces before the first line, and two more before the others.
pub fn write_words(
    f: &mut Formatter<'_>,
    indent: usize,
    heading: &str,
    words: &[String],
) -> fmt::Result {
    let mut line = format!("{:indent$}{heading}", "");
    for word in words {
        if line.chars().count() + 1 + word.chars().count() > WIDTH {
            writeln!(f, "{line}")?;
            line = format!("{:indent$} ", "");
        }
        line.push(' ');
        line.push_str(word);
    }
    writeln!(f, "{line}")
}
