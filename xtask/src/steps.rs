//! Steps of the test beside each other, each with its time.

use std::fs::{self, File};
use std::io::Write as _;
use std::process::Command;
use std::thread;
use std::time::Instant;

use crate::{Outcome, run};

/// Where the steps' output is kept.
const LOGS: &str = "target/xtask";

/// Commands that prove one thing together, one after the other.
pub struct Step {
    pub name: &'static str,
    pub commands: Vec<Command>,
}

impl Step {
    pub fn new(name: &'static str, commands: impl IntoIterator<Item = Command>) -> Self {
        Self {
            name,
            commands: commands.into_iter().collect(),
        }
    }

    /// Prints what the commands print once they have ended, so that steps beside each
    /// other do not mix; gives the seconds that they took.
    fn run(self) -> Outcome<f64> {
        let Self { name, commands } = self;
        let start = Instant::now();
        let path = format!("{LOGS}/{}.txt", name.replace(' ', "-"));
        let failed = |error: std::io::Error| format!("{path}: {error}");
        let log = File::create(&path).map_err(failed)?;
        let logged = |mut command: Command| {
            let (out, err) = (log.try_clone(), log.try_clone());
            command
                .stdout(out.map_err(failed)?)
                .stderr(err.map_err(failed)?);
            run(&mut command)
        };
        let outcome = commands.into_iter().try_for_each(logged);
        let seconds = start.elapsed().as_secs_f64();
        let said = fs::read(&path).map_err(failed)?;
        let said = String::from_utf8_lossy(&said);
        let mut out = std::io::stdout().lock();
        let printed = writeln!(out, "\n==== {name}, {seconds:.0} s\n{said}");
        drop(out);
        printed.map_err(failed)?;
        outcome.map_err(|problem| format!("{name}: {problem}\n{}", tail(&said)))?;
        Ok(seconds)
    }
}

/// The last lines that a step printed: an error comes last, however much other steps print.
fn tail(said: &str) -> String {
    let lines: Vec<&str> = said.lines().collect();
    lines[lines.len().saturating_sub(40)..].join("\n")
}

/// What every step took, s.
#[derive(Default)]
pub struct Times(Vec<(&'static str, f64)>);

impl Times {
    /// Runs lanes beside each other, the steps of a lane one after the other. A lane ends
    /// with its first failure.
    pub fn run<const N: usize>(&mut self, lanes: [Vec<Step>; N]) -> Outcome<()> {
        fs::create_dir_all(LOGS).map_err(|error| format!("{LOGS}: {error}"))?;
        let lane = |steps: Vec<Step>| -> Outcome<Vec<(&'static str, f64)>> {
            let step = |step: Step| Ok((step.name, step.run()?));
            steps.into_iter().map(step).collect()
        };
        let outcomes = thread::scope(|scope| {
            let lanes = lanes.map(|steps| scope.spawn(move || lane(steps)));
            lanes.map(|lane| {
                lane.join()
                    .unwrap_or_else(|_| Err("a step panicked".to_owned()))
            })
        });
        for outcome in outcomes {
            self.0.extend(outcome?);
        }
        Ok(())
    }

    /// Prints them, steps beside each other each with its own.
    pub fn print(&self) {
        println!("\n{:<40} {:>6}", "step", "s");
        for (name, seconds) in &self.0 {
            println!("{name:<40} {seconds:>6.0}");
        }
    }
}
