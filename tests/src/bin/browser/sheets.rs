//! What a printed page has on which sheet: the tagged PDF of Chromium, whose objects other than
//! streams are plain text.

use std::collections::HashMap;

/// The objects of a PDF, by number.
pub struct Sheets<'a>(HashMap<u32, &'a str>);

/// The number after `key` in an object.
fn number(object: &str, key: &str) -> Option<u32> {
    let (_, rest) = object.split_once(key)?;
    rest.split(|c: char| !c.is_ascii_digit())
        .next()?
        .parse()
        .ok()
}

impl<'a> Sheets<'a> {
    /// Reads a PDF given as text, in which bytes that are no text may be anything.
    pub fn new(pdf: &'a str) -> Self {
        let parts: Vec<&str> = pdf.split(" 0 obj\n").collect();
        let objects = parts.windows(2).filter_map(|parts| {
            let number = parts[0].rsplit('\n').next()?.parse().ok()?;
            Some((number, parts[1].split("\nendobj").next()?))
        });
        Self(objects.collect())
    }

    /// Number of sheets.
    pub fn count(&self) -> usize {
        let objects = self.0.values();
        objects.filter(|o| o.starts_with("<</Type /Page\n")).count()
    }

    /// The elements that are headings.
    pub fn headings(&self) -> Vec<u32> {
        let objects = self.0.values();
        objects.filter_map(|o| number(o, "\n/SE ")).collect()
    }

    /// Whether the first thing after `heading`, or after the paragraph under it, begins on another
    /// sheet than the heading.
    pub fn is_alone(&self, heading: u32) -> bool {
        let sheet = self.sheet(heading);
        let elsewhere = |next: Option<u32>| {
            let next = next.and_then(|next| self.sheet(next));
            next.is_some() && next != sheet
        };
        let next = self.next(heading);
        let paragraph = next.filter(|next| self.0[next].contains("\n/S /P\n"));
        elsewhere(next) || elsewhere(paragraph.and_then(|paragraph| self.next(paragraph)))
    }

    /// Elements in `element`: of the references in its list those that name no sheet.
    fn children(&self, element: u32) -> Vec<u32> {
        let Some((_, list)) = self.0.get(&element).and_then(|o| o.split_once("\n/K ")) else {
            return Vec::new();
        };
        let list = match list.strip_prefix('[') {
            Some(list) => list.split(']').next().unwrap_or(list),
            None => list.split('\n').next().unwrap_or(list),
        };
        let words: Vec<&str> = list.split([' ', '\n', '>']).collect();
        let references = words.iter().enumerate().filter(|(i, word)| {
            **word == "R" && *i >= 2 && (*i == 2 || !words[i - 3].ends_with("/Pg"))
        });
        references
            .filter_map(|(i, _)| words[i - 2].parse().ok())
            .collect()
    }

    /// The sheet on which `element` begins. What it draws itself, as lines between rows, comes after
    /// the text in it.
    fn sheet(&self, element: u32) -> Option<u32> {
        let within = self.children(element).into_iter();
        let mut sheets = within.filter_map(|e| self.sheet(e));
        sheets
            .next()
            .or_else(|| number(self.0.get(&element)?, "\n/Pg "))
    }

    /// The first element with anything on a sheet that comes after the end of `element`.
    fn next(&self, element: u32) -> Option<u32> {
        let parent = number(self.0.get(&element)?, "\n/P ")?;
        let siblings = self.children(parent).into_iter();
        let mut later = siblings.skip_while(|e| *e != element).skip(1);
        later
            .find(|e| self.sheet(*e).is_some())
            .or_else(|| self.next(parent))
    }
}
