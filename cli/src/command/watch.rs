//! `host-gen watch`: the page of `host-gen report`, kept up to date in a browser.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use axum::Router;
use axum::extract::{Query, State};
use axum::http::HeaderName;
use axum::http::header::CONTENT_TYPE;
use axum::response::Html;
use axum::routing::get;
use clap::Args;
use host_gen::machine::Machine;
use host_gen::report::page::page_of;
use host_gen::report::{Report, Review};
use notify::{RecursiveMode, Watcher as _};
use serde::Deserialize;
use tokio::net::TcpListener;
use tokio::sync::watch;

use crate::failure::{Failure, in_study};
use crate::floor::FloorChoice;
use crate::search::Searcher;

#[derive(Args)]
pub struct WatchArguments {
    /// Machine file; files that it is based on are watched too.
    model: PathBuf,
    /// HOST:PORT of the page; with port 0, a free port is taken.
    #[arg(long, default_value = "127.0.0.1:7780")]
    listen: String,
    /// The floor [default: the floor.spectrum of the file, or else vc-c]. A file that describes it is
    /// watched too.
    #[command(flatten)]
    floor: FloorChoice,
}

/// The content of the page, and a number that grows with every change.
#[derive(Clone)]
struct Shown {
    number: u64,
    /// The last valid review, as JSON.
    review: String,
    error: Option<String>,
}

/// One save often causes several events; this long after the last one, it is complete.
const PAUSE: Duration = Duration::from_millis(20);

/// Time between two checks of the search.
const LOOK: Duration = Duration::from_millis(200);

/// The search starts when the file has not changed for this time: while a file is edited,
/// it is saved often, and the browser must draw first.
const REST: Duration = Duration::from_secs(1);

pub fn watch(arguments: &WatchArguments, searcher: &Searcher) -> Result<(), Failure> {
    let (send, shown) = watch::channel(Shown {
        number: 0,
        review: String::new(),
        error: None,
    });
    let mut follower = Follower {
        arguments,
        searcher,
        send,
        read: String::new(),
        pending: Pending::None,
    };
    // A file that is invalid at the start is an error, as in every command.
    let machine = Machine::load(&arguments.model)?;
    arguments.floor.floor()?;
    let (tell, changes) = channel();
    let mut watcher = notify::recommended_watcher(move |event: notify::Result<notify::Event>| {
        // Reading a file is an event too. When the program ends, the receiver is gone.
        if event.is_ok_and(|event| !event.kind.is_access()) {
            tell.send(()).unwrap_or_default();
        }
    })
    .map_err(|error| follower.failed(error))?;
    // Editors replace the file by a new one, so folders are watched.
    let mut folders = BTreeSet::new();
    let of_floor = arguments.floor.file();
    for file in machine.files().map(|(file, _)| file).chain(of_floor) {
        let folder = file.parent().filter(|folder| *folder != Path::new(""));
        folders.insert(folder.unwrap_or(Path::new(".")).to_owned());
    }
    for folder in &folders {
        let watched = watcher.watch(folder, RecursiveMode::NonRecursive);
        watched.map_err(|error| follower.failed(error))?;
    }
    follower.follow()?;
    serve(&arguments.listen, shown)?;
    follower.run(&changes)
}

/// Keeps the page up to date with the file.
struct Follower<'a> {
    arguments: &'a WatchArguments,
    searcher: &'a Searcher,
    send: watch::Sender<Shown>,
    /// The texts that were read last.
    read: String,
    pending: Pending,
}

/// State of the full report, which takes some time.
enum Pending {
    /// Finished or failed.
    None,
    /// It starts at this time.
    Due(Instant),
    /// In progress.
    RunningReport(RunningReport),
}

/// A process that makes the full report, and the file with its output. A process can be
/// stopped.
struct RunningReport {
    process: Child,
    json: File,
}

impl Drop for RunningReport {
    fn drop(&mut self) {
        // It may have ended already.
        self.process.kill().unwrap_or_default();
        self.process.wait().map(|_| ()).unwrap_or_default();
    }
}

impl Follower<'_> {
    fn failed(&self, error: notify::Error) -> Failure {
        Failure::Io {
            path: self.arguments.model.display().to_string(),
            what: "watched",
            error: std::io::Error::other(error),
        }
    }

    fn run(&mut self, changes: &Receiver<()>) -> Result<(), Failure> {
        loop {
            match changes.recv_timeout(LOOK) {
                Ok(()) => {
                    while changes.recv_timeout(PAUSE).is_ok() {}
                    self.follow()?;
                }
                Err(RecvTimeoutError::Timeout) => self.look()?,
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
        }
    }

    /// Shows the report that needs no search, for the file as it is now.
    fn follow(&mut self) -> Result<(), Failure> {
        let model = &self.arguments.model;
        let machine = match Machine::load(model) {
            Ok(machine) => machine,
            Err(error) => return self.show_error(error.to_string()),
        };
        if let Err(error) = self.arguments.floor.floor() {
            return self.show_error(error.to_string());
        }
        let mut texts: String = machine.files().map(|(_, text)| text).collect();
        if let Some(file) = self.arguments.floor.file() {
            // It was just read.
            texts += &std::fs::read_to_string(file).unwrap_or_default();
        }
        if texts == self.read {
            return Ok(());
        }
        let review = Report::quick(&machine).and_then(|report| Review::new(vec![report]));
        match review {
            Ok(review) => self.show(review.json()),
            Err(error) => {
                let error = in_study(model)(error).to_string();
                return self.show_error(error);
            }
        }
        self.read = texts;
        self.pending = Pending::Due(Instant::now() + REST);
        self.say("page drawn; the search for the controller follows")
    }

    /// Starts the search when it is due, and shows its result.
    fn look(&mut self) -> Result<(), Failure> {
        match &mut self.pending {
            Pending::Due(then) if *then <= Instant::now() => self.begin(),
            Pending::RunningReport(running) => match running.process.try_wait() {
                Ok(None) => Ok(()),
                Ok(Some(status)) if status.success() => {
                    let mut json = String::new();
                    let read = running
                        .json
                        .rewind()
                        .and_then(|()| running.json.read_to_string(&mut json));
                    read.map_err(|error| self.io(error))?;
                    self.pending = Pending::None;
                    self.show(json);
                    self.say("up to date")
                }
                // The process has printed the reason to standard error.
                Ok(Some(_)) => {
                    self.show_error("the search for a controller failed: see the terminal".into())
                }
                Err(error) => Err(self.io(error)),
            },
            _ => Ok(()),
        }
    }

    fn begin(&mut self) -> Result<(), Failure> {
        let begun = || {
            let json = tempfile::tempfile()?;
            let process = Command::new(std::env::current_exe()?)
                .arg("report")
                .arg(&self.arguments.model)
                .args(["--format", "json"])
                .args(self.arguments.floor.arguments())
                .args(self.searcher.cache().is_none().then_some("--no-cache"))
                .stdin(Stdio::null())
                .stdout(json.try_clone()?)
                .spawn()?;
            Ok(RunningReport { process, json })
        };
        self.pending = Pending::RunningReport(begun().map_err(|error| self.io(error))?);
        Ok(())
    }

    fn io(&self, error: std::io::Error) -> Failure {
        Failure::Io {
            path: self.arguments.model.display().to_string(),
            what: "watched",
            error,
        }
    }

    fn show(&self, review: String) {
        self.send.send_modify(|shown| {
            shown.number += 1;
            shown.review = review;
            shown.error = None;
        });
    }

    /// Shows an error over the last valid page.
    fn show_error(&mut self, error: String) -> Result<(), Failure> {
        self.pending = Pending::None;
        self.read.clear();
        self.say(&error)?;
        self.send.send_modify(|shown| {
            shown.number += 1;
            shown.error = Some(error);
        });
        Ok(())
    }

    fn say(&self, text: &str) -> Result<(), Failure> {
        let mut out = std::io::stdout().lock();
        writeln!(out, "{}: {text}", self.arguments.model.display())
            .and_then(|()| out.flush())
            .map_err(|error| self.io(error))
    }
}

/// Serves the page from a thread of its own.
fn serve(listen: &str, shown: watch::Receiver<Shown>) -> Result<(), Failure> {
    let failed = |error| Failure::Io {
        path: listen.to_owned(),
        what: "listened on",
        error,
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_io()
        .build()
        .map_err(failed)?;
    let listener = runtime
        .block_on(TcpListener::bind(listen))
        .map_err(failed)?;
    println!("http://{}", listener.local_addr().map_err(failed)?);
    let router = Router::new()
        .route("/", get(current))
        .route("/next", get(next))
        .with_state(shown);
    std::thread::spawn(move || {
        let outcome = runtime.block_on(async { axum::serve(listener, router).await });
        if let Err(error) = outcome {
            eprintln!("error: the page is no longer served: {error}");
        }
    });
    Ok(())
}

async fn current(State(shown): State<watch::Receiver<Shown>>) -> Html<String> {
    let Shown { number, review, .. } = shown.borrow().clone();
    // The first answer also brings an error, if there is one.
    let follow = format!(
        "<script>(async () => {{
  for (let number = {number} - 1; ;) {{
    try {{
      const next = await (await fetch(`/next?after=${{number}}`)).json();
      update(next.number === {number} ? null : next.review, next.error);
      number = next.number;
    }} catch {{
      await new Promise((again) => setTimeout(again, 500));
    }}
  }}
}})();</script>"
    );
    Html(page_of(&review) + &follow)
}

#[derive(Deserialize)]
struct After {
    after: i64,
}

/// Answers as soon as the number of the content differs from `after`.
async fn next(
    State(mut shown): State<watch::Receiver<Shown>>,
    Query(After { after }): Query<After>,
) -> ([(HeaderName, &'static str); 1], String) {
    let another = |shown: &Shown| i64::try_from(shown.number) != Ok(after);
    let json = match shown.wait_for(another).await {
        Ok(shown) => {
            let error = serde_json::to_string(&shown.error).expect("strings serialise");
            let Shown { number, review, .. } = &*shown;
            format!("{{\"number\":{number},\"review\":{review},\"error\":{error}}}")
        }
        // The program ends.
        Err(_) => String::new(),
    };
    ([(CONTENT_TYPE, "application/json")], json)
}
