//! The book and the README: every link leads somewhere, every command does what it
//! should, and prints what stands there.
//!
//! A block of `console` is run, line by line, in a copy of the project's models, where
//! `host-gen` and `cargo run --release --` are the program as built. A block of `text`
//! straight after it is what it prints; there, `...` on a line of its own stands for any
//! lines, and `[..]` in a line for anything. Words are compared exactly, numbers with
//! decimals with a tolerance (`near.rs`). One of `console,background` is begun and ends
//! with its page; a `sil` there runs as fast as it can. One of `console,hardware` needs a
//! board, one of `console,install` the network, and of `cargo xtask` only the command's
//! being there is tried: these run in the whole test or not at all.
//!
//! `docs/faults.md` is compared with what `host-gen campaign` prints, with a larger
//! tolerance for its times and decibels.
#![forbid(unsafe_code)]

#[path = "../../near.rs"]
mod near;
mod page;

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, Result, anyhow, bail, ensure};
use clap::Parser;
use near::{NEAR, Tolerance};
use page::Page;
use serde_json::Value;
use snapbox::{Assert, IntoData as _};

/// Follows the documentation's links and runs its commands. From the project's folder,
/// after `cargo doc`.
#[derive(Parser)]
struct Cli {
    /// The book as mdBook built it: its headings are to have the ids that links use.
    #[arg(long)]
    book: Option<PathBuf>,
    /// The program.
    #[arg(long, default_value = "target/release/host-gen")]
    host_gen: PathBuf,
    /// The program behind `cargo xtask`.
    #[arg(long, default_value = "target/release/xtask")]
    xtask: PathBuf,
    /// A Python with NumPy and SciPy: runs the notebook, which is not run without.
    #[arg(long)]
    python: Option<PathBuf>,
    /// Only these pages, for example docs/tutorial.md; without any, README.md and the book.
    pages: Vec<PathBuf>,
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
    pages.retain(|page| cli.pages.is_empty() || cli.pages.contains(page));
    pages.sort();
    let missing = cli.pages.iter().find(|page| !pages.contains(page));
    ensure!(missing.is_none(), "{missing:?} is no page");
    let summary = fs::read_to_string("docs/SUMMARY.md")?;
    let (mut links, mut commands, mut outputs, mut not_run) = (0, 0, 0, 0);
    for page in &pages {
        let text = fs::read_to_string(page)?;
        let name = page.file_name().context("a page has a name")?;
        let name = name.to_string_lossy();
        ensure!(
            page.starts_with("docs") == summary.contains(&format!("({name})"))
                || name == "SUMMARY.md",
            "{name} is not in docs/SUMMARY.md"
        );
        let read = Page::new(&text);
        for link in &read.links {
            follow(page, link).with_context(|| format!("{}: {link}", page.display()))?;
            links += 1;
        }
        if let Some(book) = &cli.book
            && page.starts_with("docs")
            && name != "SUMMARY.md"
        {
            in_the_book(&read, &book.join(&*name).with_extension("html"))?;
        }
        let mut session = Session::new(&program, &xtask)?;
        let mut printed = None;
        for block in &read.blocks {
            let before = printed.take().filter(|_| block.follows);
            match block.kind.as_str() {
                "console" => {
                    let mut all = String::new();
                    for line in block.text.lines().filter(|line| !line.is_empty()) {
                        let here = format!("{}: {line}", page.display());
                        println!("{here}");
                        all += &session.run(line).context(here)?;
                        commands += 1;
                    }
                    printed = Some(all);
                }
                "console,background" => {
                    println!("{}: {} &", page.display(), block.text.trim());
                    session
                        .begin(block.text.trim())
                        .with_context(|| format!("{}: {}", page.display(), block.text))?;
                    commands += 1;
                }
                "text" => {
                    if let Some(found) = before {
                        let outcome = alike(&found, &block.text, NEAR);
                        outcome
                            .with_context(|| format!("{}: not what it prints", page.display()))?;
                        outputs += 1;
                    }
                }
                "console,hardware" | "console,install" => not_run += block.text.lines().count(),
                "toml" | "rust,no_run" => {}
                other => bail!("{}: a block of \"{other}\"", page.display()),
            }
        }
    }
    println!(
        "{links} links lead somewhere; {commands} commands ran, {outputs} print what is written, {not_run} need a board or the network"
    );
    if pages.iter().any(|page| page == Path::new(FAULTS)) {
        println!("{FAULTS}: {CAMPAIGN}");
        let found = Session::new(&program, &xtask)?.run(CAMPAIGN)?;
        alike(&found, &fs::read_to_string(FAULTS)?, MOVED).context(FAULTS)?;
    }
    if let Some(python) = &cli.python {
        println!("{NOTEBOOK}");
        notebook(python, &Session::new(&program, &xtask)?).context(NOTEBOOK)?;
    }
    Ok(())
}

/// From a machine file to plots in Python.
const NOTEBOOK: &str = "docs/notebook.ipynb";

/// Runs the cells with code one after the other, and follows the links in the others.
fn notebook(python: &Path, session: &Session) -> Result<()> {
    let notebook: Value = serde_json::from_str(&fs::read_to_string(NOTEBOOK)?)?;
    let (mut code, mut words) = (String::new(), String::new());
    for cell in notebook["cells"].as_array().context("it has no cells")? {
        let lines = cell["source"].as_array().context("a cell has no lines")?;
        let to = match cell["cell_type"].as_str() {
            Some("code") => &mut code,
            _ => &mut words,
        };
        to.extend(lines.iter().filter_map(Value::as_str));
        to.push_str("\n\n");
    }
    for link in &Page::new(&words).links {
        follow(Path::new(NOTEBOOK), link).with_context(|| link.clone())?;
    }
    // A path is from here, a name on the path.
    let python = match python.components().count() {
        1 => python.to_owned(),
        _ => std::path::absolute(python)?,
    };
    let status = Command::new(python)
        .args(["-c", &code])
        .env("HOST_GEN", &session.program)
        // If there is Matplotlib, it opens no window.
        .env("MPLBACKEND", "Agg")
        .current_dir(session.folder.path())
        .status()?;
    ensure!(status.success(), "{status}");
    Ok(())
}

/// Its text is what this prints.
const FAULTS: &str = "docs/faults.md";
const CAMPAIGN: &str = "host-gen campaign models/metrology-frame.toml";

/// How far its times, ms, and levels, dB, may be off: a fault near its limit is found some
/// samples sooner or later on another processor.
const MOVED: Tolerance = Tolerance {
    relative: 0.05,
    absolute: 0.25,
};

/// Whether a command printed what is written.
fn alike(found: &str, written: &str, tolerance: Tolerance) -> Result<()> {
    let found = near::settle(found, written, tolerance);
    let outcome = Assert::new().try_eq(None, found.into_data(), written.into_data());
    outcome.map_err(|differences| anyhow!("{differences}"))
}

/// A file beside the page, a heading in it, or an item of the code's documentation,
/// which stands beside the book.
fn follow(page: &Path, link: &str) -> Result<()> {
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
    let text = fs::read_to_string(&target).with_context(|| target.display().to_string())?;
    let there = if target
        .extension()
        .is_some_and(|extension| extension == "md")
    {
        Page::new(&text).ids.iter().any(|id| id == anchor)
    } else {
        text.contains(&format!("id=\"{anchor}\""))
    };
    ensure!(there, "no {anchor} in {}", target.display());
    Ok(())
}

/// mdBook gave the headings the ids that links are held against here.
fn in_the_book(page: &Page, html: &Path) -> Result<()> {
    let text = fs::read_to_string(html).with_context(|| html.display().to_string())?;
    for id in &page.ids {
        let there = text.contains(&format!("id=\"{id}\""));
        ensure!(there, "no {id} in {}", html.display());
    }
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
                if line.starts_with("host-gen sil ") {
                    // Nobody is watching.
                    command.arg("--fast");
                }
                command
            }
            (Some("cargo"), Some("xtask")) => {
                let mut command = Command::new(&self.xtask);
                command.args(words.skip(1).take(1)).arg("--help");
                command
            }
            _ => bail!("neither host-gen nor cargo xtask"),
        };
        command.stdin(Stdio::null());
        Ok(command)
    }

    /// What a command prints.
    fn run(&self, line: &str) -> Result<String> {
        let output = self.command(line)?.stderr(Stdio::inherit()).output()?;
        ensure!(output.status.success(), "{}", output.status);
        Ok(String::from_utf8(output.stdout)?)
    }

    /// Begins a command that goes on, and waits for the address that it prints. `watch` has
    /// searched then, so that the commands after it do not search for the same beside it.
    fn begin(&mut self, line: &str) -> Result<()> {
        let mut child = self.command(line)?.stdout(Stdio::piped()).spawn()?;
        let output = child.stdout.take().context("no output")?;
        self.background.push(child);
        let mut lines = BufReader::new(output).lines();
        let mut waits_for = |what: &str| -> Result<()> {
            let mut said = lines.by_ref().map_while(Result::ok);
            let last = said.find(|line| line.contains(what) || line.contains("failed"));
            ensure!(
                last.as_ref().is_some_and(|line| line.contains(what)),
                "it does not say {what}, but {last:?}"
            );
            Ok(())
        };
        waits_for("127.0.0.1:")?;
        if line.contains(" watch ") {
            waits_for("up to date")?;
        }
        // What else it says is read, so that it does not wait for that.
        std::thread::spawn(move || lines.for_each(drop));
        Ok(())
    }
}
