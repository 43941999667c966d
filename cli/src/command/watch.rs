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
use host_gen::analysis::criterion::Criterion;
use host_gen::machine::Machine;
use host_gen::report::page::page_of;
use host_gen::report::{Report, Review};
use notify::{RecursiveMode, Watcher as _};
use serde::Deserialize;
use tokio::net::TcpListener;
use tokio::sync::watch;

use crate::arguments::criterion;
use crate::failure::{Failure, in_study};
use crate::search::Searcher;

#[derive(Args)]
pub struct WatchArguments {
    /// Machine file; what it is based on is watched too.
    model: PathBuf,
    /// HOST:PORT of the page; port 0 takes any that is free.
    #[arg(long, default_value = "127.0.0.1:7780")]
    listen: String,
    /// The floor is as strong as this criterion allows.
    #[arg(long, value_parser = criterion(), default_value = "vc-c")]
    criterion: Criterion,
}

/// What the browser has to show, and its number.
#[derive(Clone)]
struct Shown {
    number: u64,
    /// The last review without an error, as JSON.
    review: String,
    error: Option<String>,
}

/// A save is often several events; they are over after this.
const PAUSE: Duration = Duration::from_millis(20);

/// How often the search is looked after.
const LOOK: Duration = Duration::from_millis(200);

/// The search begins once the file has been as it is for so long: whoever edits
/// saves often, and the browser draws first.
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
    // A file that is wrong when this begins is an error as everywhere.
    let machine = Machine::load(&arguments.model)?;
    let (tell, changes) = channel();
    let mut watcher = notify::recommended_watcher(move |event: notify::Result<notify::Event>| {
        // Reading a file is an event too; and nobody listens once this ends.
        if event.is_ok_and(|event| !event.kind.is_access()) {
            tell.send(()).unwrap_or_default();
        }
    })
    .map_err(|error| follower.failed(error))?;
    // Editors put a new file in the old one's place, so folders are watched.
    let mut folders = BTreeSet::new();
    for (file, _) in machine.files() {
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

/// Keeps the page as the file is.
struct Follower<'a> {
    arguments: &'a WatchArguments,
    searcher: &'a Searcher,
    send: watch::Sender<Shown>,
    /// The texts that were read last.
    read: String,
    pending: Pending,
}

/// The whole report, which takes some time.
enum Pending {
    /// It is there, or cannot be.
    None,
    /// It begins then.
    Due(Instant),
    /// It is being made.
    RunningReport(RunningReport),
}

/// Another process, which can be stopped, and what it writes.
struct RunningReport {
    process: Child,
    json: File,
}

impl Drop for RunningReport {
    fn drop(&mut self) {
        // It may be at its end already.
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

    /// What can be said at once of the file as it is now.
    fn follow(&mut self) -> Result<(), Failure> {
        let model = &self.arguments.model;
        let machine = match Machine::load(model) {
            Ok(machine) => machine,
            Err(error) => return self.show_error(error.to_string()),
        };
        let texts: String = machine.files().map(|(_, text)| text).collect();
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
        self.say("drawn; the search for the controller follows")
    }

    /// Begins the search when it is due; shows what it has found.
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
                // It has said why on standard error.
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
            let criterion = self.arguments.criterion.key();
            let process = Command::new(std::env::current_exe()?)
                .arg("report")
                .arg(&self.arguments.model)
                .args(["--format", "json", "--criterion", criterion])
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
            what: "followed",
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

    /// Over the last review that had no error.
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
    // The error too, if there is one, comes with the first answer.
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

/// Answers once what is shown has another number than `after`.
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
