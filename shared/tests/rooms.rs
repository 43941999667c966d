//! The rooms of a crate: every module imports only from modules that stand before it in
//! `lib.rs`.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

#[test]
fn rooms_import_only_from_rooms_before_them() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let climbs = climbs(&src);
    assert!(climbs.is_empty(), "\n{}", climbs.join("\n"));
}

/// The documentation lists the rooms in the same order.
#[test]
fn the_table_of_rooms_is_in_their_order() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs");
    let source = read(&path);
    let documented: Vec<_> = source
        .lines()
        .filter_map(|line| line.strip_prefix("//! | ")?.split('`').nth(1))
        .collect();
    assert_eq!(documented, rooms(&tokens(&source)));
}

/// Every way to name a later room is found, and nothing else.
#[test]
fn the_checker_finds_what_climbs() {
    let src =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(concat!("rooms-", env!("CARGO_PKG_NAME")));
    drop(fs::remove_dir_all(&src));
    let files = [
        (
            "lib.rs",
            "pub mod first;\nmod second;\n#[cfg(unix)]\npub(crate) mod third;\n\
             pub use third::{Shown, Other as Renamed};\npub const LEGS: usize = 6;\n",
        ),
        (
            "first.rs",
            "// use crate::third::Comment;\n\
             /* crate::third /* nested */ crate::third */\n\
             use crate::LEGS;\n\
             use crate::second::A;\n\
             const TEXT: &str = \"crate::third\\\"crate::third\";\n\
             const RAW: &str = r#\"crate::third\"crate::third\"#;\n\
             fn quoted<'a>(x: &'a u8) -> char { let _ = '\\''; '\"' }\n\
             fn call() { super::third::call(crate::Shown, 'x', crate::first::here()) }\n\
             use crate::Renamed;\n\
             pub use crate::*;\n",
        ),
        (
            "second/mod.rs",
            "use crate::{LEGS, first::{A, B},\n    third::{C, D as E}};\n\
             use super::first;\n\
             mod tests {\n    use super::third::InThisRoom;\n\
             use super::super::{first, third::F};\n}\n\
             use self::third::InThisRoom;\n",
        ),
        (
            "second/deep.rs",
            "use super::third::InThisRoom;\n\
             use super::super::third::G;\n\
             use super::{third, super::third::H};\n\
             use crate::{first, second};\n",
        ),
        (
            "third.rs",
            "use crate::{first::A, second::B, third::C};\nuse super::{LEGS, first};\n",
        ),
    ];
    for (name, text) in files {
        let path = src.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    let expected = [
        "first.rs:4: first imports from second",
        "first.rs:8: first imports from third",
        "first.rs:8: first imports from third",
        "first.rs:9: first imports from third",
        "first.rs:10: first imports from the whole crate",
        "second/deep.rs:2: second imports from third",
        "second/deep.rs:3: second imports from third",
        "second/mod.rs:2: second imports from third",
        "second/mod.rs:6: second imports from third",
    ];
    let found = climbs(&src);
    let found: Vec<_> = found
        .iter()
        .map(|climb| climb.split(", ").next().unwrap())
        .collect();
    assert_eq!(found, expected);
}

/// Every import of the crate in `src` that names a room after its own in `lib.rs`, with
/// file, line and both rooms.
fn climbs(src: &Path) -> Vec<String> {
    let lib = tokens(&read(&src.join("lib.rs")));
    let rooms = rooms(&lib);
    let exported = exported(&lib, &rooms);
    let place = |name: &str| rooms.iter().position(|room| room == name);
    let mut climbs = Vec::new();
    for file in files(src) {
        let inside = file.strip_prefix(src).unwrap().with_extension("");
        let parts: Vec<_> = inside.iter().map(|part| part.to_str().unwrap()).collect();
        let Some(own) = place(parts[0]) else { continue };
        let depth = parts.len() - usize::from(parts.ends_with(&["mod"]));
        for (line, name) in root_names(&tokens(&read(&file)), depth) {
            let other = match name.as_str() {
                "*" | "self" => "the whole crate",
                name => exported.get(name).map_or(name, |room| room.as_str()),
            };
            if place(other).is_none_or(|other| other <= own) && other != "the whole crate" {
                continue;
            }
            climbs.push(format!(
                "{}:{line}: {} imports from {other}, which is not before it in lib.rs",
                file.strip_prefix(src).unwrap().display(),
                rooms[own],
            ));
        }
    }
    climbs
}

/// The modules that a `lib.rs` declares, in its order.
fn rooms(lib: &[Token]) -> Vec<String> {
    let declarations = lib.windows(3).filter(|t| t[0].is("mod") && t[2].is(";"));
    declarations.map(|t| t[1].text.clone()).collect()
}

/// The names that a `lib.rs` exports again, each with its room.
fn exported(lib: &[Token], rooms: &[String]) -> HashMap<String, String> {
    let mut exported = HashMap::new();
    let uses = lib.split(|t| t.is(";")).filter_map(|statement| {
        let start = statement.iter().position(|t| t.is("use"))?;
        statement.get(start + 1..)
    });
    for statement in uses {
        let room = statement.iter().find(|t| rooms.contains(&t.text));
        for name in statement {
            if let Some(room) = room {
                exported.insert(name.text.clone(), room.text.clone());
            }
        }
    }
    exported
}

/// The names of the crate's root that a file uses, by `crate::` or by enough `super::`, with
/// their lines. The file's module is `depth` modules below the root.
fn root_names(tokens: &[Token], depth: usize) -> Vec<(usize, String)> {
    let mut names = Vec::new();
    // For each open brace, whether it opens a module.
    let mut braces = Vec::new();
    for (i, token) in tokens.iter().enumerate() {
        let before = |n: usize, text| i >= n && tokens[i - n].is(text);
        match token.text.as_str() {
            "{" => braces.push(before(2, "mod")),
            "}" => drop(braces.pop()),
            "crate" | "super" | "self" if !before(1, "::") => {
                let level = depth + braces.iter().filter(|opens| **opens).count();
                if tokens.get(i + 1).is_some_and(|next| next.is("::")) {
                    follow(tokens, i, level, &mut names);
                }
            }
            _ => {}
        }
    }
    names
}

/// Follows a path, or a tree of a `use`, from `tokens[i]` on, `level` modules below the root.
/// Returns the index after the part that it has followed.
fn follow(
    tokens: &[Token],
    mut i: usize,
    mut level: usize,
    names: &mut Vec<(usize, String)>,
) -> usize {
    while let Some(token) = tokens.get(i) {
        i += 1;
        let ends = !tokens.get(i).is_some_and(|next| next.is("::"));
        match token.text.as_str() {
            "{" => {
                while tokens.get(i).is_some_and(|token| !token.is("}")) {
                    i = follow(tokens, i, level, names);
                    let mut open = 0;
                    while let Some(token) = tokens.get(i) {
                        match token.text.as_str() {
                            "," if open == 0 => break,
                            "}" if open == 0 => break,
                            "{" => open += 1,
                            "}" => open -= 1,
                            _ => {}
                        }
                        i += 1;
                    }
                    i += usize::from(tokens.get(i).is_some_and(|token| token.is(",")));
                }
                return i + 1;
            }
            "crate" => level = 0,
            "super" => level = level.saturating_sub(1),
            "self" if !ends => {}
            name => {
                if level == 0 {
                    names.push((token.line, name.to_owned()));
                }
                return i;
            }
        }
        if ends {
            return i;
        }
        i += 1;
    }
    i
}

/// A word, `::`, or any other single character of a source.
struct Token {
    text: String,
    line: usize,
}

impl Token {
    fn is(&self, text: &str) -> bool {
        self.text == text
    }
}

/// The tokens of a source without comments, strings and character literals.
fn tokens(source: &str) -> Vec<Token> {
    let chars: Vec<char> = source.chars().collect();
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    let is_word = |c: char| c == '_' || c.is_alphanumeric();
    let mut tokens = Vec::new();
    let (mut i, mut line) = (0, 1);
    while i < chars.len() {
        let start = i;
        match at(i) {
            '/' if at(i + 1) == '/' => {
                while i < chars.len() && at(i) != '\n' {
                    i += 1;
                }
            }
            '/' if at(i + 1) == '*' => {
                let mut open = 0;
                while i < chars.len() {
                    match (at(i), at(i + 1)) {
                        ('/', '*') => (open, i) = (open + 1, i + 2),
                        ('*', '/') => (open, i) = (open - 1, i + 2),
                        _ => i += 1,
                    }
                    if open == 0 {
                        break;
                    }
                }
            }
            '"' => {
                i += 1;
                while i < chars.len() && at(i) != '"' {
                    i += 1 + usize::from(at(i) == '\\');
                }
                i += 1;
            }
            // A character, or else the quote of a lifetime.
            '\'' if at(i + 1) == '\\' => {
                i += 3;
                while i < chars.len() && at(i) != '\'' {
                    i += 1;
                }
                i += 1;
            }
            '\'' if at(i + 2) == '\'' => i += 3,
            c if is_word(c) => {
                while is_word(at(i)) {
                    i += 1;
                }
                let word: String = chars[start..i].iter().collect();
                let hashes = chars[i..].iter().take_while(|c| **c == '#').count();
                if matches!(word.as_str(), "r" | "br" | "cr") && at(i + hashes) == '"' {
                    let end: Vec<char> = format!("\"{}", "#".repeat(hashes)).chars().collect();
                    i += hashes + 1;
                    while i < chars.len() && !chars[i..].starts_with(&end) {
                        i += 1;
                    }
                    i += end.len();
                } else {
                    tokens.push(Token { text: word, line });
                }
            }
            ':' if at(i + 1) == ':' => {
                i += 2;
                tokens.push(Token {
                    text: "::".to_owned(),
                    line,
                });
            }
            c => {
                i += 1;
                if !c.is_whitespace() {
                    tokens.push(Token {
                        text: c.to_string(),
                        line,
                    });
                }
            }
        }
        line += chars[start..i.min(chars.len())]
            .iter()
            .filter(|c| **c == '\n')
            .count();
    }
    tokens
}

/// Every Rust file under `folder`, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(self::files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}
