//! What is in a page of Markdown.

use std::collections::HashMap;

use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd, TextMergeStream};

/// A page's links, blocks of code and the ids of its headings.
#[derive(Default)]
pub struct Page {
    pub links: Vec<String>,
    pub blocks: Vec<Block>,
    /// Ids of headings, as mdBook makes them: what an anchor can lead to.
    pub ids: Vec<String>,
}

/// A block of code.
pub struct Block {
    /// What stands behind the fence: `console`, `text` and others.
    pub kind: String,
    pub text: String,
    /// Nothing but blank lines is between it and the block before.
    pub follows: bool,
}

impl Page {
    pub fn new(text: &str) -> Self {
        let mut page = Self::default();
        let mut kind: Option<String> = None;
        let mut heading: Option<(Option<String>, String)> = None;
        let mut follows = false;
        for event in TextMergeStream::new(Parser::new_ext(text, Options::all())) {
            match event {
                Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(fence))) => {
                    kind = Some(fence.to_string());
                }
                Event::Text(text) if kind.is_some() => {
                    page.blocks.push(Block {
                        kind: kind.clone().unwrap_or_default(),
                        text: text.to_string(),
                        follows,
                    });
                }
                Event::End(TagEnd::CodeBlock) => {
                    kind = None;
                    follows = true;
                    continue;
                }
                Event::Start(Tag::Link { dest_url, .. }) => page.links.push(dest_url.to_string()),
                Event::Start(Tag::Heading { id, .. }) => {
                    heading = Some((id.map(|id| id.to_string()), String::new()));
                }
                Event::Text(text) | Event::Code(text) if heading.is_some() => {
                    if let Some((_, words)) = &mut heading {
                        words.push_str(&text);
                    }
                }
                Event::End(TagEnd::Heading(_)) => {
                    if let Some((id, words)) = heading.take() {
                        page.ids.push(id.unwrap_or_else(|| slug(&words)));
                    }
                }
                _ => {}
            }
            follows = follows && kind.is_some();
        }
        number(&mut page.ids);
        page
    }
}

/// A heading's id: small letters, digits, `-` for spaces, nothing else.
fn slug(heading: &str) -> String {
    let kept = heading.trim().chars().filter_map(|c| match c {
        c if c.is_alphanumeric() || c == '_' || c == '-' => Some(c.to_ascii_lowercase()),
        c if c.is_whitespace() => Some('-'),
        _ => None,
    });
    kept.collect()
}

/// Later ones of the same name are numbered from 1.
fn number(ids: &mut [String]) {
    let mut seen: HashMap<String, usize> = HashMap::new();
    for id in ids {
        let count = seen.entry(id.clone()).or_default();
        if *count > 0 {
            *id = format!("{id}-{count}");
        }
        *count += 1;
    }
}
