//! The table of equations in `docs/theory.md` against the sources, and the one form of citation.
//!
//! A search for `Eq. (20)` must find every place. So the table names the symbol of each equation,
//! the symbol's doc comment cites it, and no text cites an equation in another form.

use std::path::{Path, PathBuf};
use std::{fs, iter};

/// The heading above the table.
const HEADING: &str = "## Where each equation is";

/// Number of equations of the paper.
const EQUATIONS: u32 = 22;

/// A row of the table.
struct Row<'a> {
    equation: u32,
    file: &'a str,
    symbol: &'a str,
}

/// The text between the first `before` and the next `after`.
fn between<'a>(text: &'a str, before: &str, after: &str) -> Option<&'a str> {
    let (_, rest) = text.split_once(before)?;
    rest.split_once(after).map(|(inside, _)| inside)
}

/// A row `| Eq. (N) | what | FILE | SYMBOL |`, with file and symbol in backticks.
fn row(line: &str) -> Option<Row<'_>> {
    let [_, equation, _, file, symbol, _] = line.split('|').collect::<Vec<_>>().try_into().ok()?;
    let number = equation.trim().strip_prefix("Eq. (")?.strip_suffix(')')?;
    Some(Row {
        equation: number.parse().ok()?,
        file: between(file, "`", "`")?,
        symbol: between(symbol, "`", "`")?,
    })
}

/// Whether a line defines the item `name`.
fn defines(line: &str, name: &str) -> bool {
    let mut rest = line.trim_start();
    for visibility in ["pub ", "pub(crate) ", "pub(super) "] {
        rest = rest.strip_prefix(visibility).unwrap_or(rest);
    }
    let keywords = ["const fn ", "fn ", "struct ", "enum ", "const "];
    keywords
        .iter()
        .find_map(|keyword| rest.strip_prefix(keyword)?.strip_prefix(name))
        .is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
}

/// Whether a line opens an `impl` block of the type `name`.
fn implements(line: &str, name: &str) -> bool {
    line.starts_with("impl")
        && line.split([' ', '<', '{']).any(|word| word == name)
        && !line.contains(&format!("{name} for "))
}

/// The doc comments directly above each definition of `symbol`, which is an item at the top of
/// the file, or `Type::item` in an `impl` of the type. The source is formatted by rustfmt.
fn docs_of(source: &str, symbol: &str) -> Vec<String> {
    let lines: Vec<&str> = source.lines().collect();
    let (owner, name) = match symbol.split_once("::") {
        Some((owner, name)) => (Some(owner), name),
        None => (None, symbol),
    };
    let mut inside = false;
    let mut docs = Vec::new();
    for (i, line) in lines.iter().enumerate() {
        let in_scope = match owner {
            Some(owner) => {
                if !line.starts_with(' ') && !line.is_empty() {
                    inside = implements(line, owner);
                }
                // Items of the block itself, not what is in their bodies.
                inside && line.starts_with("    ") && !line.starts_with("     ")
            }
            None => !line.starts_with(' '),
        };
        if in_scope && defines(line, name) {
            let mut above: Vec<&str> = lines[..i]
                .iter()
                .rev()
                .map(|line| line.trim_start())
                .skip_while(|line| line.starts_with("#["))
                .map_while(|line| line.strip_prefix("///"))
                .collect();
            above.reverse();
            docs.push(above.join("\n"));
        }
    }
    docs
}

/// What is wrong with the table in `theory`. `source` gives the text of a file, if it exists.
fn faults(theory: &str, source: impl Fn(&str) -> Option<String>) -> Vec<String> {
    let Some((_, section)) = theory.split_once(HEADING) else {
        return vec![format!("no heading \"{HEADING}\"")];
    };
    let table = section.split("\n## ").next().unwrap_or_default();
    let lines = table.lines().filter(|line| line.starts_with('|'));
    let mut found = Vec::new();
    let mut listed = Vec::new();
    // Without the header and the line below it.
    for line in lines.skip(2) {
        let Some(Row {
            equation,
            file,
            symbol,
        }) = row(line)
        else {
            found.push(format!("not a row of the table: {line}"));
            continue;
        };
        listed.push(equation);
        let Some(source) = source(file) else {
            found.push(format!("Eq. ({equation}): there is no file {file}"));
            continue;
        };
        let docs = docs_of(&source, symbol);
        if docs.is_empty() {
            found.push(format!("Eq. ({equation}): {file} does not define {symbol}"));
        } else if !docs
            .iter()
            .any(|doc| doc.contains(&format!("Eq. ({equation})")))
        {
            found.push(format!(
                "Eq. ({equation}): the doc comment of {symbol} in {file} does not cite it"
            ));
        }
    }
    let missing = (1..=EQUATIONS).filter(|equation| !listed.contains(equation));
    found.extend(missing.map(|equation| format!("Eq. ({equation}) has no row")));
    let unknown = listed.iter().filter(|n| !(1..=EQUATIONS).contains(n));
    found.extend(unknown.map(|equation| format!("Eq. ({equation}) is not in the paper")));
    found
}

/// Without the white space and the marks of comments between one word and the next, also across
/// lines.
fn next_word(text: &str) -> &str {
    text.trim_start_matches(|c: char| c.is_whitespace() || c == '/' || c == '!')
}

/// After a number in parentheses.
fn after_number(text: &str) -> Option<&str> {
    let rest = text.strip_prefix('(')?;
    let digits = rest.find(|c: char| !c.is_ascii_digit())?;
    (digits > 0).then(|| rest[digits..].strip_prefix(')'))?
}

/// Whether `text` begins with a citation in another form than `Eq. (20)`, or with one and then a
/// number that has no `Eq.` of its own.
fn other_form(text: &str) -> bool {
    if let Some(rest) = text.strip_prefix("Eq. ").and_then(after_number) {
        let rest = next_word(rest);
        let mut rest = next_word(rest.strip_prefix(',').unwrap_or(rest));
        for word in ["and ", "or ", "to ", "-", "–"] {
            rest = rest.strip_prefix(word).map_or(rest, next_word);
        }
        return after_number(rest).is_some();
    }
    // The longest first.
    let words = [
        "Equations",
        "equations",
        "Equation",
        "equation",
        "Eqns",
        "Eqn",
        "Eqs",
        "Eq",
        "eqs.",
        "eq.",
    ];
    let Some(rest) = words.iter().find_map(|word| text.strip_prefix(word)) else {
        return false;
    };
    let rest = next_word(rest.strip_prefix('.').unwrap_or(rest));
    let bare = rest.starts_with(|c: char| c.is_ascii_digit());
    after_number(rest).is_some() || bare && !text[1..].starts_with("quation")
}

/// The lines, from 1, on which a citation in another form begins.
fn other_forms(text: &str) -> Vec<usize> {
    let starts = text.match_indices(['E', 'e']).map(|(at, _)| at);
    starts
        .filter(|&at| {
            let before = text[..at].chars().next_back();
            let inside = before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == '.');
            !inside && other_form(&text[at..])
        })
        .map(|at| text[..at].matches('\n').count() + 1)
        .collect()
}

/// The folder of the project.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// All sources, documents and machine files in a folder, without hidden folders and what was
/// built.
fn texts(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() {
            if name != "target" && name != "node_modules" && !name.starts_with('.') {
                files.extend(texts(&path));
            }
        } else if [".rs", ".md", ".toml"]
            .iter()
            .any(|end| name.ends_with(end))
        {
            files.push(path);
        }
    }
    files
}

#[test]
fn each_symbol_of_the_table_cites_its_equation() {
    let theory = fs::read_to_string(root().join("docs/theory.md")).unwrap();
    let faults = faults(&theory, |file| fs::read_to_string(root().join(file)).ok());
    assert!(faults.is_empty(), "docs/theory.md:\n{}", faults.join("\n"));
}

#[test]
fn citations_have_one_form() {
    let mut found = Vec::new();
    let files = texts(&root());
    for path in &files {
        let text = fs::read_to_string(path).unwrap();
        let lines = other_forms(&text);
        found.extend(
            lines
                .iter()
                .map(|line| format!("{}:{line}", path.display())),
        );
    }
    // Not a test of an empty folder.
    assert!(files.iter().any(|path| path.ends_with("docs/theory.md")));
    assert!(
        files
            .iter()
            .any(|path| path.ends_with("shared/src/step.rs"))
    );
    assert!(
        found.is_empty(),
        "cite equations as `Eq. (20)`, each with its own `Eq.`:\n{}",
        found.join("\n")
    );
}

/// A table and a source made up, with one fault of each kind.
#[test]
fn faults_of_a_table_are_found() {
    let source = "\
/// The law, Eq. (1).
#[derive(Clone)]
pub struct Law {
    /// Eq. (9).
    pub gain: f64,
}

/// Eq. (7) is far above.

pub const FAR: usize = 3;

impl Default for Law {
    /// Eq. (5).
    fn default() -> Self {
        Self::new()
    }
}

impl Law {
    /// Gains by Eq. (2)
    /// and Eq. (13).
    #[inline]
    pub(super) fn new() -> Self {
        let gains = || new();
        gains()
    }

    /// Eq. (6).
    pub fn newer() {}
}

impl Other {
    /// Eq. (8).
    fn other() {}
}

/// Calls Law::missing, Eq. (4).
pub(crate) fn user() {}
";
    let cells = |n: u32, file: &str, symbol: &str| {
        format!("| Eq. ({n}) | text | `{file}` | [`{symbol}`](../doc/page.html#new) |\n")
    };
    let wanted = [
        (1, "a.rs", "Law", ""),
        (2, "a.rs", "Law::new", ""),
        (13, "a.rs", "Law::new", ""),
        (5, "a.rs", "Law::default", ""),
        // Cited elsewhere only, or by the wrong item.
        (
            3,
            "a.rs",
            "Law",
            "the doc comment of Law in a.rs does not cite it",
        ),
        (
            9,
            "a.rs",
            "Law",
            "the doc comment of Law in a.rs does not cite it",
        ),
        (
            6,
            "a.rs",
            "Law::new",
            "the doc comment of Law::new in a.rs does not cite it",
        ),
        (
            7,
            "a.rs",
            "FAR",
            "the doc comment of FAR in a.rs does not cite it",
        ),
        // Used but not defined, defined for another type, or part of a name.
        (
            4,
            "a.rs",
            "Law::missing",
            "a.rs does not define Law::missing",
        ),
        (8, "a.rs", "Law::other", "a.rs does not define Law::other"),
        (10, "a.rs", "new", "a.rs does not define new"),
        (11, "a.rs", "La", "a.rs does not define La"),
        (12, "b.rs", "Law", "there is no file b.rs"),
    ];
    let mut theory =
        format!("# Theory\n\n{HEADING}\n\n| Eq. | what | file | symbol |\n|---|---|---|---|\n");
    theory.extend(
        wanted
            .iter()
            .map(|(n, file, symbol, _)| cells(*n, file, symbol)),
    );
    theory += &cells(23, "a.rs", "Law");
    theory += "| (14) | text | `a.rs` | `Law` |\n\n## After the table\n\n| Eq. (15) | x | `a.rs` | `Law` |\n";

    let mut expected: Vec<String> = wanted
        .iter()
        .filter(|(.., fault)| !fault.is_empty())
        .map(|(n, _, _, fault)| format!("Eq. ({n}): {fault}"))
        .collect();
    expected.push("Eq. (23): the doc comment of Law in a.rs does not cite it".to_owned());
    expected.push("not a row of the table: | (14) | text | `a.rs` | `Law` |".to_owned());
    expected.extend((14..=22).map(|n| format!("Eq. ({n}) has no row")));
    expected.push("Eq. (23) is not in the paper".to_owned());
    let found = faults(&theory, |file| (file == "a.rs").then(|| source.to_owned()));
    assert_eq!(found, expected);
    assert_eq!(faults("", |_| None), [format!("no heading \"{HEADING}\"")]);
}

/// `@` stands for `Eq`, so that this file passes its own test.
#[test]
fn other_forms_of_citation_are_found() {
    let lines = |text: &str| other_forms(&text.replace('@', "Eq"));
    for text in [
        "@s. (19) and (20)",
        "@. 12",
        "(@. 12)",
        "@ (3)",
        "@.(3)",
        "@.  (3)",
        "@s (3)",
        "@3",
        "@n. (3)",
        "@uation (3)",
        "@. (14), (21), (22)",
        "@. (19) and (20)",
        "@. (7) to (12)",
        "@. (7)–(12)",
        "@.\n    /// (20)",
        "@. (14),\n//! (21)",
    ] {
        assert_eq!(lines(text), [1], "{text}");
        let later = format!("some text\nand {text}");
        assert_eq!(lines(&later), [2], "{text}");
    }
    assert_eq!(lines("the equation@uation"), [0; 0]);
    assert_eq!(
        lines(&iter::repeat_n("@. 1\n", 3).collect::<String>()),
        [1, 2, 3]
    );
    for text in [
        "@. (20)",
        "@. (19), @. (20) and @. (21)",
        "@. (7) to @. (12)",
        "@. (12) (a sensor)",
        "@. (12), (2·ζ)",
        "#[derive(Partial@, @)]",
        "assert_eq!(1, 2)",
        "a.eq(1)",
        "the equation 1 + x = 0",
        "@. is short for equation. 3 follow",
    ] {
        assert_eq!(lines(text), [0; 0], "{text}");
    }
}
