//! A machine file's error as a terminal shows it: the line, and a caret under the entry.

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};
use host_gen::files::without_byte_order_mark;
use host_gen::machine::MachineError;

/// The error with its line, and the others of the same machine, for a terminal. Where there is no
/// terminal, the error's own text says the same in a line for each.
pub fn render(error: &MachineError, colour: bool) -> String {
    let all = error.all().map(|error| render_one(error, colour));
    all.collect::<Vec<_>>().join("\n\n")
}

fn render_one(error: &MachineError, colour: bool) -> String {
    let title = match error.entry() {
        "" => error.message().to_owned(),
        entry => format!("{entry}: {}", error.message()),
    };
    let file = error.file().map(|file| file.display().to_string());
    let mut group = Group::with_title(Level::ERROR.primary_title(title));
    if let (Some(text), Some(span)) = (error.text(), error.span()) {
        // A byte order mark would be a column of the first line.
        let shown = without_byte_order_mark(text);
        let mark = text.len() - shown.len();
        let span = span.start.saturating_sub(mark)..span.end.saturating_sub(mark);
        group = group.element(
            Snippet::source(shown)
                .path(file)
                .annotation(AnnotationKind::Primary.span(span)),
        );
    } else if let Some(file) = file {
        group = group.element(Origin::path(file));
    }
    if let Some(fix) = error.fix() {
        group = group.element(Level::HELP.message(fix));
    }
    let renderer = if colour {
        Renderer::styled()
    } else {
        Renderer::plain()
    };
    renderer.render(&[group])
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use host_gen::machine::Machine;

    use super::render;

    const FRAME: &str = include_str!("../../models/metrology-frame.toml");

    /// What is shown of the metrology frame's file with `old` replaced: the place, and
    /// the text over the carets.
    fn shown(old: &str, new: &str) -> String {
        assert_eq!(FRAME.matches(old).count(), 1, "{old}");
        of_text(&FRAME.replace(old, new))
    }

    fn of_text(text: &str) -> String {
        let error = Machine::parse(Path::new("m.toml"), text).unwrap_err();
        render(&error, false)
    }

    /// The text over the carets, and the column of the first.
    fn marked(shown: &str) -> (String, usize) {
        let lines: Vec<&str> = shown.lines().collect();
        let carets = lines.iter().position(|line| line.contains('^'));
        let carets = carets.expect("a line of carets");
        let before = |line: &str| line.find('|').expect("a margin") + 2;
        let under: Vec<char> = lines[carets][before(lines[carets])..].chars().collect();
        let over = lines[carets - 1];
        let over = over[before(over)..].chars();
        let text = over.zip(under.iter()).filter(|(_, under)| **under == '^');
        let first = under.iter().position(|c| *c == '^').unwrap_or_default();
        (text.map(|(c, _)| c).collect(), first + 1)
    }

    /// Line and column as the arrow says them.
    fn place(shown: &str) -> &str {
        let line = shown.lines().find(|line| line.contains("--> "));
        line.and_then(|line| line.split("--> ").nth(1)).unwrap()
    }

    #[test]
    fn a_value_out_of_range() {
        let shown = shown("mass = 742.0", "mass = -742.0");
        assert_eq!(
            shown,
            "\
error: bodies.frame.mass: mass must be above 0 kg, not -742
  --> m.toml:37:1
   |
37 | mass = -742.0
   | ^^^^^^^^^^^^^"
        );
    }

    #[test]
    fn a_wrong_type_an_unknown_key_and_no_toml() {
        let typed = shown("mass = 742.0", "mass = \"heavy\"");
        assert_eq!(marked(&typed).0, "mass = \"heavy\"", "{typed}");
        let unknown = shown("mass = 742.0", "mas = 742.0");
        assert_eq!(marked(&unknown).0, "mas = 742.0", "{unknown}");
        assert!(
            unknown.contains("= help: did you mean `mass`? Otherwise use one of `mass`"),
            "{unknown}"
        );
        let syntax = shown("mass = 742.0", "mass = = 742.0");
        assert_eq!(place(&syntax), "m.toml:37:8", "{syntax}");
        assert_eq!(marked(&syntax).0, "=", "{syntax}");
    }

    /// An element of a long array that spans many lines, a table by its name.
    #[test]
    fn only_one_line_is_marked() {
        let node = shown("n3 = [0.0, 0.5, 0.0]", "n3 = [0.0, nan, 0.0]");
        assert_eq!(marked(&node).0, "n3 = [0.0, nan, 0.0]", "{node}");
        let many = shown("    \"leg4.e1\", ", "    \"leg4.e7\", ");
        assert_eq!(marked(&many).0, "deformations", "{many}");
        let table = shown("cog = [0.0, 0.0, 0.0]\n", "");
        assert_eq!(marked(&table).0, "frame", "{table}");
    }

    /// Windows' line ends, a byte order mark, tabs and letters of several bytes before the
    /// entry do not shift the carets.
    #[test]
    fn odd_texts_are_marked_right() {
        let edited = FRAME.replace("mass = 742.0", "mass = -742.0");
        let plain = of_text(&edited);
        assert_eq!(of_text(&edited.replace('\n', "\r\n")), plain);
        assert_eq!(of_text(&format!("\u{feff}{edited}")), plain);
        // Named at its head: before it is nothing but the mark.
        let format = format!("\u{feff}{}", &FRAME[FRAME.find("format = 1").unwrap()..]);
        let format = of_text(&format.replace("format = 1", "format = 2"));
        assert_eq!(place(&format), "m.toml:1:1", "{format}");
        assert_eq!(marked(&format).0, "format = 2", "{format}");

        let tabs = shown("mass = 742.0", "\t\tmass = -742.0");
        assert_eq!(place(&tabs), "m.toml:37:3", "{tabs}");
        assert_eq!(marked(&tabs).0, "mass = -742.0", "{tabs}");
        let wide = shown(
            "leg4 = { nodes",
            "leg4 = { \"späße\" = 1, \"weiße\" = 2, nodes",
        );
        assert_eq!(marked(&wide).0, "\"späße\" = 1", "{wide}");
    }

    #[test]
    fn long_lines_are_cut() {
        let long = format!("mass = -742.0 # {}", "x".repeat(5000));
        let long = shown("mass = 742.0", &long);
        assert!(
            long.lines().all(|line| line.chars().count() < 200),
            "{long}"
        );
        assert_eq!(marked(&long).0, "mass = -742.0", "{long}");
    }

    #[test]
    fn the_end_of_the_file() {
        let text = format!("{}\n[half", FRAME.trim_end());
        let shown = of_text(&text);
        let line = text.lines().count();
        assert!(
            place(&shown).starts_with(&format!("m.toml:{line}:")),
            "{shown}"
        );
        assert!(marked(&shown).1 >= 1, "{shown}");
        let empty = of_text("");
        assert!(empty.contains("missing keys `format`, `name`"), "{empty}");
    }

    /// Not in the file that was asked for, but in the one that it is based on.
    #[test]
    fn the_file_that_has_the_entry() {
        let folder = tempfile::tempdir().unwrap();
        let base = folder.path().join("base.toml");
        let variant = folder.path().join("variant.toml");
        std::fs::write(&base, FRAME.replace("mass = 742.0", "mass = -742.0")).unwrap();
        std::fs::write(
            &variant,
            "based_on = \"base.toml\"\n[control]\ndamping = 0.5\n",
        )
        .unwrap();
        let shown = render(&Machine::load(&variant).unwrap_err(), false);
        assert_eq!(place(&shown), format!("{}:37:1", base.display()), "{shown}");
        assert_eq!(marked(&shown).0, "mass = -742.0", "{shown}");
    }

    #[test]
    fn a_file_that_is_not_there() {
        let error = Machine::load(Path::new("none.toml")).unwrap_err();
        let shown = render(&error, false);
        assert!(shown.starts_with("error: cannot be read: "), "{shown}");
        assert_eq!(place(&shown), "none.toml", "{shown}");
    }

    #[test]
    fn colour_only_if_wanted() {
        let error = Machine::parse(Path::new("m.toml"), "format = 2").unwrap_err();
        assert!(!render(&error, false).contains('\u{1b}'));
        assert!(render(&error, true).contains('\u{1b}'));
    }
}
