//! Processor in the loop: the plant here, the firmware on an emulated board,
//! one sample at a time over its UART. The host runs the same step beside it
//! and compares every code; the board's codes move the plant.
#![forbid(unsafe_code)]

use std::io::{self, Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use clap::Parser;
use firmware::exchange::{REPLY, REQUEST, parse_reply, request};
use firmware::loop_task::LoopTask;
use firmware::tables;
use host_gen::machine::Machine;
use host_gen::simulation::Rig;
use host_gen::study::Study;
use shared::table::ValidTable;

/// Runs the firmware on emulated boards against the simulated plant.
#[derive(Parser)]
struct Cli {
    /// Machine file of the plant.
    #[arg(long)]
    model: PathBuf,
    /// Samples per board.
    #[arg(long)]
    samples: u32,
    /// The emulator's name of a board, and the image with the machine's table.
    #[arg(long, num_args = 2, value_names = ["MACHINE", "IMAGE"], required = true)]
    board: Vec<String>,
}

/// A board that is silent for this long has stopped.
const SILENCE: Duration = Duration::from_secs(60);

/// The last fifth of a run shakes the floor this much harder, so that clamp and
/// anti-windup are compared too.
const ROUGH: f64 = 60.0;

type Outcome<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;

fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(&cli) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(cli: &Cli) -> Outcome<bool> {
    let study = Study::new(Machine::load(&cli.model)?)?;
    let name = &study.machine.name;
    let Some((_, table)) = tables::ALL.iter().find(|(of, _)| of == name) else {
        return Err(format!("the firmware has no table of {name}").into());
    };
    let boards: Vec<_> = cli.board.chunks_exact(2).collect();
    // Side by side: most of the time goes into waiting for single bytes.
    let results = thread::scope(|scope| {
        let threads: Vec<_> = boards
            .iter()
            .map(|board| {
                let study = &study;
                scope.spawn(move || {
                    let image = Path::new(&board[1]);
                    in_the_loop(study, table, cli.samples, &board[0], image)
                })
            })
            .collect();
        threads
            .into_iter()
            .map(|thread| thread.join().expect("the loop does not panic"))
            .collect::<Vec<_>>()
    });
    let mut good = true;
    for (board, result) in boards.iter().zip(results) {
        let count = result.map_err(|error| format!("{}: {error}", board[0]))?;
        println!(
            "{} on {}: {} of {} samples equal to the host's, {} different; clamp active in {}, a sensor at a rail in {}; {:.0} s",
            name,
            board[0],
            count.equal,
            cli.samples,
            count.different,
            count.clamped,
            count.railed,
            count.seconds
        );
        good &= count.equal == cli.samples && count.different == 0;
        // Else the run has not compared what it should.
        if cli.samples >= 10_000 && (count.clamped == 0 || count.clamped == count.equal) {
            println!(
                "{}: the run was to hold clamped and unclamped samples",
                board[0]
            );
            good = false;
        }
    }
    Ok(good)
}

#[derive(Default)]
struct Count {
    equal: u32,
    different: u32,
    clamped: u32,
    railed: u32,
    seconds: f64,
}

fn in_the_loop(
    study: &Study,
    table: &'static ValidTable,
    samples: u32,
    machine: &str,
    image: &Path,
) -> Outcome<Count> {
    let mut board = Emulated::start(machine, image)?;
    let settings = &study.machine.simulation;
    let mut rig = Rig::new(study.plant.clone(), &study.machine.board, settings);
    let mut host = LoopTask::new(table);
    let mut count = Count::default();
    let start = Instant::now();
    for k in 0..samples {
        if k == samples / 5 * 4 {
            rig.floor_gain = ROUGH;
        }
        let adc = rig.sample();
        let expected = host.on_sample(adc);
        let reply = board.exchange(&request(adc))?;
        let output = parse_reply(&reply)?;
        if output == expected {
            count.equal += 1;
        } else {
            count.different += 1;
            if count.different == 1 {
                println!(
                    "{machine}: sample {k}: {adc:?} gave {output:?}, on the host {expected:?}"
                );
            }
        }
        count.clamped += u32::from(output.status.clamped);
        count.railed += u32::from(output.status.at_rail());
        rig.advance(output.dac);
    }
    count.seconds = start.elapsed().as_secs_f64();
    Ok(count)
}

/// An emulator with its UART on a socket.
struct Emulated {
    process: Child,
    line: UnixStream,
}

impl Emulated {
    fn start(machine: &str, image: &Path) -> Outcome<Self> {
        let folder = tempfile::tempdir()?;
        let socket = folder.path().join("uart");
        let listener = UnixListener::bind(&socket)?;
        listener.set_nonblocking(true)?;
        let mut process = Command::new("qemu-system-arm")
            .args(["-M", machine, "-display", "none", "-monitor", "none"])
            .args(["-semihosting-config", "enable=on,target=native"])
            .arg("-serial")
            .arg(format!("unix:{}", socket.display()))
            .arg("-kernel")
            .arg(image)
            .stdin(Stdio::null())
            .spawn()?;
        let start = Instant::now();
        let line = loop {
            match listener.accept() {
                Ok((line, _)) => break line,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(error) => return Err(error.into()),
            }
            if let Some(status) = process.try_wait()? {
                return Err(format!("the emulator ended at once ({status})").into());
            }
            if start.elapsed() > SILENCE {
                process.kill()?;
                return Err("the emulator did not connect its UART".into());
            }
            thread::sleep(Duration::from_millis(5));
        };
        line.set_nonblocking(false)?;
        line.set_read_timeout(Some(SILENCE))?;
        Ok(Self { process, line })
    }

    fn exchange(&mut self, request: &[u8; REQUEST]) -> Outcome<[u8; REPLY]> {
        self.line.write_all(request)?;
        let mut reply = [0; REPLY];
        self.line
            .read_exact(&mut reply)
            .map_err(|error| format!("the board does not answer: {error}"))?;
        Ok(reply)
    }
}

impl Drop for Emulated {
    fn drop(&mut self) {
        // It may have ended already; there is nothing else to do about it.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
