//! The book and the README: every link leads somewhere, every command does what it
//! should.
//!
//! A block of `console` is run, line by line, in a copy of the project's models, where
//! `host-gen` and `cargo run --release --` are the program as built. One of
//! `console,background` is begun and ends with its page. One of `console,hardware` needs a
//! board, one of `console,install` the network, and of `cargo xtask` only the command's
//! being there is tried: these run in the whole test or not at all.
#![forbid(unsafe_code)]

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, Result, bail, ensure};
use clap::Parser;
use pulldown_cmark::{CodeBlockKind, Event, Options, Tag, TagEnd, TextMergeStream};

/// Follows the documentation's links and runs its commands. From the project's folder,
/// after `cargo doc` and `mdbook build docs`.
#[derive(Parser)]
struct Cli {
    /// Where the book is.
    #[arg(long, default_value = "target/book")]
    book: PathBuf,
    /// The program.
    #[arg(long, default_value = "target/release/host-gen")]
    host_gen: PathBuf,
    /// The program behind `cargo xtask`.
    #[arg(long, default_value = "target/debug/xtask")]
    xtask: PathBuf,
}

fn main() -> Result<()> {
    run(&Cli::parse())
}

fn run(cli: &Cli) -> Result<()> {
    let program = fs::canonicalize(&cli.host_gen).context("host-gen is not built")?;
    let xtask = fs::canonicalize(&cli.xtask).context("xtask is not built")?;
    let mut pages = vec![PathBuf::from("README.md")];
    for entry in fs::read_dir("docs")? {
        pages.push(entry?.path());
    }
    pages.retain(|page| page.extension().is_some_and(|extension| extension == "md"));
    pages.sort();
    let summary = fs::read_to_string("docs/SUMMARY.md")?;
    let (mut links, mut commands, mut not_run) = (0, 0, 0);
    for page in &pages {
        let text = fs::read_to_string(page)?;
        let name = page.file_name().context("a page has a name")?;
        let name = name.to_string_lossy();
        ensure!(
            page.starts_with("docs") == summary.contains(&format!("({name})"))
                || name == "SUMMARY.md",
            "{name} is not in docs/SUMMARY.md"
        );
        let read = Read::new(&text);
        for link in &read.links {
            follow(page, link, &cli.book).with_context(|| format!("{}: {link}", page.display()))?;
            links += 1;
        }
        let mut session = Session::new(&program, &xtask)?;
        for (kind, block) in &read.blocks {
            match kind.as_str() {
                "console" => {
                    for line in block.lines().filter(|line| !line.is_empty()) {
                        println!("{}: {line}", page.display());
                        session
                            .run(line)
                            .with_context(|| format!("{}: {line}", page.display()))?;
                        commands += 1;
                    }
                }
                "console,background" => {
                    println!("{}: {} &", page.display(), block.trim());
                    session
                        .begin(block.trim())
                        .with_context(|| format!("{}: {block}", page.display()))?;
                    commands += 1;
                }
                "console,hardware" | "console,install" => not_run += block.lines().count(),
                "toml" | "text" | "rust,no_run" => {}
                other => bail!("{}: a block of \"{other}\"", page.display()),
            }
        }
    }
    println!(
        "{links} links lead somewhere; {commands} commands ran, {not_run} need a board or the network"
    );
    Ok(())
}

/// What is in a page.
#[derive(Default)]
struct Read {
    links: Vec<String>,
    blocks: Vec<(String, String)>,
}

impl Read {
    fn new(text: &str) -> Self {
        let mut read = Self::default();
        let mut block: Option<String> = None;
        for event in TextMergeStream::new(pulldown_cmark::Parser::new_ext(text, Options::all())) {
            match event {
                Event::Start(Tag::Link { dest_url, .. }) => read.links.push(dest_url.to_string()),
                Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(kind))) => {
                    block = Some(kind.to_string());
                }
                Event::Text(text) if block.is_some() => {
                    let kind = block.clone().unwrap_or_default();
                    read.blocks.push((kind, text.to_string()));
                }
                Event::End(TagEnd::CodeBlock) => block = None,
                _ => {}
            }
        }
        read
    }
}

/// A file beside the page, a heading in it, or an item of the code's documentation,
/// which stands beside the book.
fn follow(page: &Path, link: &str, book: &Path) -> Result<()> {
    if link.starts_with("https://") {
        return Ok(());
    }
    let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
    let folder = page.parent().context("a page is in a folder")?;
    let target = match file.strip_prefix("../doc/") {
        Some(item) => Path::new("target/doc").join(item),
        None if file.is_empty() => page.to_owned(),
        None => folder.join(file),
    };
    ensure!(target.exists(), "there is no {}", target.display());
    if anchor.is_empty() {
        return Ok(());
    }
    // Headings have their ids in the book.
    let html = if file.ends_with(".md") || file.is_empty() {
        let name = target.file_stem().context("a page has a name")?;
        book.join(name).with_extension("html")
    } else {
        target
    };
    let text = fs::read_to_string(&html).with_context(|| html.display().to_string())?;
    ensure!(
        text.contains(&format!("id=\"{anchor}\"")),
        "no {anchor} in {}",
        html.display()
    );
    Ok(())
}

/// A folder with the models and the tables, and what runs there.
struct Session {
    folder: tempfile::TempDir,
    program: PathBuf,
    xtask: PathBuf,
    background: Vec<Child>,
}

impl Drop for Session {
    fn drop(&mut self) {
        for child in &mut self.background {
            child.kill().unwrap_or_default();
            child.wait().map(|_| ()).unwrap_or_default();
        }
    }
}

impl Session {
    fn new(program: &Path, xtask: &Path) -> Result<Self> {
        let folder = tempfile::tempdir()?;
        for part in ["models", "firmware/src/tables"] {
            let to = folder.path().join(part);
            fs::create_dir_all(&to)?;
            for entry in fs::read_dir(part)? {
                let from = entry?.path();
                let name = from.file_name().context("a file has a name")?;
                fs::copy(&from, to.join(name))?;
            }
        }
        Ok(Self {
            folder,
            program: program.to_owned(),
            xtask: xtask.to_owned(),
            background: Vec::new(),
        })
    }

    /// The words of a line; of a command that this does not run, its `--help`.
    fn command(&self, line: &str) -> Result<Command> {
        let line = line.split(" #").next().unwrap_or_default().trim();
        let line = line.replace("cargo run --release --", "host-gen");
        let mut words = line.split_whitespace();
        let mut command = match (words.next(), line.split_whitespace().nth(1)) {
            (Some("host-gen"), _) => {
                let mut command = Command::new(&self.program);
                command.args(words).current_dir(self.folder.path());
                command
            }
            (Some("cargo"), Some("xtask")) => {
                let mut command = Command::new(&self.xtask);
                command.args(words.skip(1).take(1)).arg("--help");
                command
            }
            _ => bail!("neither host-gen nor cargo xtask"),
        };
        command.stdin(Stdio::null()).stdout(Stdio::null());
        Ok(command)
    }

    fn run(&self, line: &str) -> Result<()> {
        let status = self.command(line)?.status()?;
        ensure!(status.success(), "{status}");
        Ok(())
    }

    /// Begins a command that goes on, and waits for the address that it prints.
    fn begin(&mut self, line: &str) -> Result<()> {
        let mut child = self.command(line)?.stdout(Stdio::piped()).spawn()?;
        let output = child.stdout.take().context("no output")?;
        self.background.push(child);
        let mut lines = BufReader::new(output).lines();
        let ready = lines.any(|line| line.is_ok_and(|line| line.contains("127.0.0.1:")));
        ensure!(ready, "it says no address");
        // What else it says is read, so that it does not wait for that.
        std::thread::spawn(move || lines.for_each(drop));
        Ok(())
    }
}
