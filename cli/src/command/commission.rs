//! `host-gen commission`.

use std::fs;
use std::io::{self, IsTerminal as _};
use std::path::{Path, PathBuf};

use clap::Args;
use dialoguer::Confirm;
use dialoguer::theme::ColorfulTheme;
use host_gen::board::link::{Address, Client, LinkError};
use host_gen::board::measure::{Measurement, MeasurementSettings, Pass, measure};
use host_gen::board::words::cause;
use host_gen::commission::{Acceptance, ClosedLoop, Commissioning, Gate, closed_at};
use host_gen::design::Study;
use host_gen::identify;
use host_gen::report::commission::page;
use shared::controller::ControllerReport;
use shared::levels::Levels;
use shared::link::Request;
use shared::supervisor::Mode;
use shared::table::ValidTable;

use super::fit::{fitted_path, fitted_text, read};
use crate::failure::{Failure, in_loop};
use crate::files::write_whole;
use crate::print;
use crate::search::{Bar, Searcher, study};
use crate::signals::Signals;

#[derive(Args)]
pub struct CommissionArguments {
    /// Machine file.
    model: PathBuf,
    /// Address of the board: HOST:PORT, or the path of a serial port.
    #[arg(long)]
    at: Address,
    /// Folder for the measurement and the record [default: NAME-commissioning].
    #[arg(long)]
    folder: Option<PathBuf>,
    /// Do not ask before the machine is moved.
    #[arg(long)]
    yes: bool,
    /// Largest force of the test signal with the loop open, N, as for `link frf` [default: from the
    /// model].
    #[arg(long, allow_negative_numbers = true)]
    amplitude: Option<f64>,
    /// Number of windows to average, at least 2.
    #[arg(long, default_value_t = MeasurementSettings::USUAL.averages)]
    averages: u32,
}

/// Gains at which the loop is closed, one after the other, relative to that of the table.
const GAINS: [f32; 3] = [0.01, 0.1, 1.0];

/// Lowest frequency at which the closed loop is measured, Hz: below, the floor is most of what is seen.
const CLOSED_FROM: f64 = 10.0;

/// Windows of the board's levels that are compared: ten seconds.
const WINDOWS: usize = 40;

pub fn commission(arguments: &CommissionArguments, searcher: &Searcher) -> Result<(), Failure> {
    let settings = MeasurementSettings {
        averages: arguments.averages,
        amplitude: arguments.amplitude,
        ..MeasurementSettings::USUAL
    };
    settings.check()?;
    // What takes long comes before the connection.
    let study = study(&arguments.model)?;
    let table = searcher.design(&arguments.model, &study)?.table;
    let name = &study.machine().name;
    let named = format!("{name}-commissioning");
    let folder = arguments.folder.clone().unwrap_or_else(|| named.into());
    fs::create_dir_all(&folder).map_err(|error| Failure::Io {
        path: folder.display().to_string(),
        what: "made",
        error,
    })?;
    let signals = Signals::catch()?;
    let mut client = Client::connect(&arguments.at)?;
    client.stop_when(signals.came.clone());
    confirm(
        arguments,
        settings.duration(f64::from(table.get().sample_rate))?,
    )?;
    let mut run = Run {
        record: Commissioning::new(name, arguments.at.to_string()),
        folder,
        model: &arguments.model,
        settings,
        searcher,
        client: &mut client,
    };
    let outcome = run.steps(&study, &table);
    // However it ended.
    let rest = run.client.uninterrupted(at_rest);
    let kept = run.keep();
    match (outcome, rest) {
        (Ok(()), Ok(())) => kept,
        (Ok(()), Err(error)) => Err(error.into()),
        (Err(Failure::Link(LinkError::Interrupted)), Ok(())) => Err(Failure::Interrupted {
            board: "the legs are at rest".to_owned(),
            code: signals.exit_code(),
        }),
        (Err(failure), Ok(())) => Err(failure),
        (Err(failure), Err(error)) => Err(Failure::NotAtRest {
            why: failure.to_string(),
            error,
        }),
    }
}

/// Asks before anything moves.
fn confirm(arguments: &CommissionArguments, seconds: f64) -> Result<(), Failure> {
    if arguments.yes {
        return Ok(());
    }
    if !(io::stdin().is_terminal() && io::stderr().is_terminal()) {
        return Err(Failure::Setting {
            option: "--yes",
            must: "be given where nobody can be asked: the machine will be moved".to_owned(),
        });
    }
    let question = format!(
        "The legs will push the machine: self-test, {seconds:.0} s of test signals with the loop open, then the loop closed at 1, 10 and 100 % of its gain. Go on?"
    );
    let theme = ColorfulTheme::default();
    let answer = Confirm::with_theme(&theme)
        .with_prompt(question)
        .default(false);
    match answer.interact() {
        Ok(true) => Ok(()),
        Ok(false) => Err(Failure::Declined),
        Err(dialoguer::Error::IO(error)) => Err(Failure::Io {
            path: "the terminal".to_owned(),
            what: "read",
            error,
        }),
    }
}

/// Ends what runs on the board.
fn at_rest(client: &mut Client) -> Result<(), LinkError> {
    let rests = |report: &ControllerReport| {
        matches!(report.mode, Mode::Untested | Mode::Idle | Mode::Failed)
    };
    client.end_injection()?;
    if !rests(&client.report()?) {
        client.command(Request::Stop)?;
        client.wait_for(rests)?;
    }
    Ok(())
}

/// A run.
struct Run<'a> {
    record: Commissioning,
    folder: PathBuf,
    model: &'a Path,
    settings: MeasurementSettings,
    searcher: &'a Searcher,
    client: &'a mut Client,
}

impl Run<'_> {
    /// All steps, each a condition for the next.
    fn steps(&mut self, filed: &Study, table: &ValidTable) -> Result<(), Failure> {
        self.prepare("board ready", table)?;
        let measurement = self.measured(filed, table)?;
        self.record.resonances.clone_from(&measurement.resonances);
        self.gate(Gate::measured(&measurement))?;

        let bar = Bar::fit();
        let fit = identify::fit(filed.machine(), &measurement, &bar);
        drop(bar);
        let fit = match fit {
            Ok(fit) => fit,
            Err(error) => {
                let criterion = "the file explains the measurement";
                return self.gate(Gate::failed("model fitted", criterion, error.to_string()));
            }
        };
        let gate = Gate::fitted(&fit);
        let path = fitted_path(self.model, filed.machine());
        let measured = self.measurement(table);
        let text = fitted_text(self.model, filed.machine(), &fit, &measured);
        self.record.fit = Some(fit);
        self.gate(gate)?;
        write_whole(&path, text.as_bytes())?;

        // From the file, so that whoever repeats it gets the same.
        let fitted = study(&path)?;
        let design = match self.searcher.design(&path, &fitted) {
            Ok(design) => design,
            Err(error) => {
                let criterion = "a controller within all limits of the file";
                return self.gate(Gate::failed(
                    "controller designed",
                    criterion,
                    error.to_string(),
                ));
            }
        };
        let (gate, table) = (Gate::designed(&design), design.table);
        self.record.design = Some(design);
        self.gate(gate)?;
        self.prepare("table sent", &table)?;

        let open = self.levels()?;
        for gain in GAINS {
            self.close(gain)?;
            let settings = MeasurementSettings {
                band: [CLOSED_FROM, Pass::reach(table.get().sample_rate.into())],
                coarse: true,
                // What is safe with the loop open need not be so here.
                amplitude: None,
                ..self.settings
            };
            let closed = match self.measure(&fitted, &table, &settings) {
                Err(Failure::Frf(error)) => {
                    let step = closed_at(gain.into());
                    return self.gate(Gate::failed(&step, "no fault", error.to_string()));
                }
                closed => closed?,
            };
            let closed = ClosedLoop::new(gain.into(), &closed);
            let gate = Gate::closed(&closed);
            self.record.closed.push(closed);
            self.gate(gate)?;
        }
        let closed = self.levels()?;
        let acceptance = Acceptance::new(&fitted, &table, [&open, &closed]);
        let acceptance = acceptance.map_err(in_loop(&path))?;
        let gate = Gate::accepted(&acceptance);
        self.record.acceptance = Some(acceptance);
        self.gate(gate)
    }

    /// Adds a gate to the record, and stops at one that was not passed.
    fn gate(&mut self, gate: Gate) -> Result<(), Failure> {
        print::text(&gate.to_string())?;
        let (passed, step) = (gate.passed, gate.step.clone());
        self.record.gates.push(gate);
        self.keep()?;
        if passed {
            Ok(())
        } else {
            Err(Failure::Gate { step })
        }
    }

    /// Writes the record as it is now.
    fn keep(&self) -> Result<(), Failure> {
        let json =
            serde_json::to_string_pretty(&self.record).expect("numbers and strings serialise");
        write_whole(&self.folder.join("record.json"), json.as_bytes())?;
        let page = page(&self.record)?;
        write_whole(&self.folder.join("record.html"), page.as_bytes())
    }

    /// Sends `table` if the board runs another one, and tests sensors and legs.
    fn prepare(&mut self, step: &str, table: &ValidTable) -> Result<(), Failure> {
        let criterion = "no fault; each leg and sensor answers as the model predicts";
        let report = self.client.report()?;
        let mut why = report.fault;
        if why.is_none() {
            if !matches!(report.mode, Mode::Untested | Mode::Idle) {
                let found = "the loop is not at rest; use host-gen link stop";
                return self.gate(Gate::failed(step, criterion, found));
            }
            if self.client.identity()?.checksum != table.checksum() {
                self.client.send_table(table)?;
            }
            self.client.command(Request::SelfTest)?;
            why = self
                .client
                .wait_for(|report| report.mode != Mode::Testing)?
                .fault;
        }
        let found = match why {
            Some(fault) => {
                return self.gate(Gate::failed(step, criterion, cause(fault.cause)));
            }
            None => format!("table {:08x}, self-test passed", table.checksum()),
        };
        self.gate(Gate::done(step, criterion, found))
    }

    /// Where the measurement with `table` is kept.
    fn measurement(&self, table: &ValidTable) -> PathBuf {
        let name = format!("measured-{:08x}.json", table.checksum());
        self.folder.join(name)
    }

    /// The measurement of an earlier run with the same table, or a new one.
    fn measured(&mut self, study: &Study, table: &ValidTable) -> Result<Measurement, Failure> {
        let path = self.measurement(table);
        if path.exists() {
            let found = format!("{}: taken up from an earlier run", path.display());
            self.gate(Gate::done("measurement found", "of the same table", found))?;
            return read(&path);
        }
        let settings = self.settings;
        let measurement = self.measure(study, table, &settings)?;
        let json = serde_json::to_string(&measurement).expect("numbers and strings serialise");
        write_whole(&path, json.as_bytes())?;
        Ok(measurement)
    }

    fn measure(
        &mut self,
        study: &Study,
        table: &ValidTable,
        settings: &MeasurementSettings,
    ) -> Result<Measurement, Failure> {
        let bar = Bar::of(settings.windows());
        Ok(measure(self.client, study, table, settings, &bar)?)
    }

    /// Closes the loop at this gain, or brings it there.
    fn close(&mut self, gain: f32) -> Result<(), Failure> {
        self.client.command(Request::SetGain(gain))?;
        if self.client.report()?.mode == Mode::Idle {
            self.client.command(Request::Start)?;
        }
        let report = self.client.wait_for(|report| {
            report.fault.is_some()
                || report.mode != Mode::Starting && (report.gain - report.target).abs() < 1e-6
        })?;
        match report.fault {
            None => Ok(()),
            Some(fault) => self.gate(Gate::failed(
                &closed_at(gain.into()),
                "no fault",
                cause(fault.cause),
            )),
        }
    }

    fn levels(&mut self) -> Result<Vec<Levels>, Failure> {
        // What was before is still in the first window.
        let mut levels = self.client.levels()?;
        levels = self.client.levels_after(levels.window)?;
        let mut all = Vec::new();
        while all.len() < WINDOWS {
            levels = self.client.levels_after(levels.window)?;
            all.push(levels);
        }
        Ok(all)
    }
}
