//! Processor in the loop: the plant here, the firmware on an emulated board, one
//! sample at a time over one UART, the link over the other. The host runs the same
//! controller beside it and compares every code and every answer; the board's codes
//! move the plant.
//!
//! With `--listen` no session runs: the plant moves the board for ever, and the board's
//! link is on TCP for whoever comes. With `--admits` nothing runs: it says whether a board can run
//! the machine's table. Otherwise a whole session: identity,
//! self-test, injection, recording, soft start, closed loop with shocks, a fault, safe
//! state, snapshot, clearing, restart, another table.
//!
//! With `--quick` the other table comes first and is the one that the session runs
//! under: as the compiled-in one, but tested and ramped in a tenth of the time, and
//! settled in a quarter.

#![forbid(unsafe_code)]

use std::io::{self, Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use clap::Parser;
use firmware::budget;
use firmware::exchange::{REPLY, REQUEST, parse_reply, request};
use firmware::link_task::LinkTask;
use firmware::loop_task::BoardController;
use firmware::ram_flash::RamFlash;
use firmware::store::Store;
use firmware::tables::{self, Entry};
use host_gen::design::{Cache, Search, Study};
use host_gen::machine::Machine;
use host_gen::simulate::{Rig, is_on_board_of};
use shared::controller::{ControllerReport, Memory, Refusal};
use shared::injection::{Injection, Signal};
use shared::link::{Cutter, Packet, Reply, Request, VERSION, encode};
use shared::multisine::{LINES, Line, Slot};
use shared::recorder::{Record, Recording, Trigger};
use shared::supervisor::{Cause, Mode};
use shared::table::{Limits, TABLE_ROOM, Table, ValidTable};
use tempfile::TempDir;

/// Runs the firmware on emulated boards against the simulated plant.
#[derive(Parser)]
struct Cli {
    /// Machine file of the plant.
    #[arg(long)]
    model: PathBuf,
    /// Samples per board with the loop closed; the rest of the session comes on
    /// top.
    #[arg(long, default_value_t = 200_000)]
    samples: u32,
    /// The session under a table that is sent first, which tests and ramps in a tenth of
    /// the time; the compiled-in one runs before and after it.
    #[arg(long)]
    quick: bool,
    /// No session: one board runs until it is stopped, its link at this address.
    #[arg(long, value_name = "ADDRESS")]
    listen: Option<String>,
    /// No session: whether this board can run the machine's table.
    #[arg(long, value_name = "MACHINE", conflicts_with_all = ["board", "listen"])]
    admits: Option<String>,
    /// Machine file of the plant, if it is not the machine of the table.
    #[arg(long, value_name = "MODEL", requires = "listen")]
    truth: Option<PathBuf>,
    /// The emulator's name of a board, and the image with the machine's table.
    /// Without any, the host rehearses the session alone, in seconds.
    #[arg(long, num_args = 2, value_names = ["MACHINE", "IMAGE"])]
    board: Vec<String>,
    /// The program that runs the board `virtual-h743`: the reference board with its real
    /// image, of the package in `virtual-board`.
    #[arg(long, value_name = "PROGRAM", default_value = "virtual-board")]
    virtual_board: PathBuf,
}

/// The name of the reference board in software; any other is one of QEMU's.
const VIRTUAL: &str = "virtual-h743";

/// A board that is silent for this long has stopped.
const SILENCE: Duration = Duration::from_secs(60);

/// A shock, so that clamp and anti-windup are compared too: the floor shakes this
/// much harder,
const ROUGH: f64 = 60.0;

/// for so many samples, in a quick session for a tenth of them,
const SHOCK: u32 = 1_000;

/// again after so many: time enough to recover, or the supervisor would rightly
/// give up.
const SHOCKS_APART: u32 = 60_000;

/// Records that the recorder has room for when the host is alone.
const ROOM: usize = 8_192;

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
    if let Some(board) = &cli.admits {
        return admits(&study, board, &cli.model);
    }
    let boards: Vec<_> = cli.board.chunks_exact(2).collect();
    if let Some(address) = &cli.listen {
        let [board] = boards[..] else {
            return Err("--listen takes one board".into());
        };
        let plant = match &cli.truth {
            Some(path) => {
                let truth = Machine::load(path)?;
                is_on_board_of(&truth, study.machine())?;
                Study::new(truth)?
            }
            None => study,
        };
        return serve(&plant, &cli.board(board), address);
    }
    let name = &study.machine().name;
    let Some(entry) = tables::ALL.iter().find(|entry| entry.machine == name) else {
        return Err(format!("the firmware has no table of {name}").into());
    };
    if boards.is_empty() {
        let count = in_the_loop(&study, entry, cli, "host", None)?;
        println!(
            "{name} on the host alone: {} samples, {} answers, clamp active in {}; {:.0} s",
            count.samples, count.answers, count.clamped, count.seconds
        );
        return Ok(true);
    }
    // Side by side: most of the time goes into waiting for single bytes.
    let results = thread::scope(|scope| {
        let threads: Vec<_> = boards
            .iter()
            .map(|board| {
                let study = &study;
                scope.spawn(move || {
                    in_the_loop(study, entry, cli, &board[0], Some(cli.board(board)))
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
            "{name} on {}: {} of {} samples and {} of {} answers equal to the host's; clamp active in {}; {:.0} s",
            board[0],
            count.equal,
            count.samples,
            count.answers_equal,
            count.answers,
            count.clamped,
            count.seconds
        );
        good &= count.equal == count.samples && count.answers_equal == count.answers;
    }
    Ok(good)
}

/// Whether a board can run the table of `study`, the machine of `model`.
///
/// # Errors
/// The first of the board's limits that the table exceeds, and all of them.
fn admits(study: &Study, board: &str, model: &Path) -> Outcome<bool> {
    let cache = Cache::from_environment();
    let search = Search {
        cache: cache.as_ref(),
        ..Search::FULL
    };
    let limits = limits(board);
    let design = search.design(study);
    let table = design
        .map_err(|error| format!("{}: {error}", model.display()))?
        .table;
    let Err(error) = limits.admit(&table) else {
        return Ok(true);
    };
    let t = table.get();
    let (begun, ended) = limits.written;
    let board = if board == VIRTUAL {
        format!(
            "the reference board, which runs up to {} Hz, latches from {:.1} µs after a sample until {:.1} µs \
             after the next, and has 16-bit converters and inputs for one kind of sensors",
            limits.rate,
            1e6 * ended,
            1e6 * begun
        )
    } else {
        format!("{board}, which has 16-bit converters")
    };
    Err(format!(
        "{}: {error}. The machine, with {} Hz, the latch {:.1} µs after the sample and control.feedback = \"{}\", is \
         made for another board than {board}. Base the file on models/nucleo-h743.toml, or change \
         [board] and control.feedback",
        model.display(),
        t.sample_rate,
        1e6 * t.latch,
        study.machine().target.feedback.name(),
    )
    .into())
}

/// What tables a board can run.
fn limits(board: &str) -> Limits {
    if board == VIRTUAL {
        budget::LIMITS
    } else {
        Limits::NONE
    }
}

/// A board to emulate.
struct Board<'a> {
    machine: &'a str,
    image: &'a Path,
    /// The program that runs the reference board.
    virtual_board: &'a Path,
}

impl Cli {
    /// A board of two arguments: machine and image.
    fn board<'a>(&'a self, arguments: &'a [String]) -> Board<'a> {
        Board {
            machine: &arguments[0],
            image: Path::new(&arguments[1]),
            virtual_board: &self.virtual_board,
        }
    }
}

impl Board<'_> {
    /// Records that its recorder has room for.
    fn room(&self) -> usize {
        if self.machine == VIRTUAL {
            8_192
        } else {
            16_384
        }
    }

    /// Starts the emulator with the converters' line and the link at these places.
    fn start(&self, converters: &str, link: &str) -> Outcome<Running> {
        let mut command;
        if self.machine == VIRTUAL {
            command = Command::new(self.virtual_board);
            command.args(["--converters", converters, "--link", link]);
            command.arg(self.image);
        } else {
            command = Command::new("qemu-system-arm");
            command
                .args(["-M", self.machine, "-display", "none", "-monitor", "none"])
                .args(["-semihosting-config", "enable=on,target=native"])
                .args(["-serial", converters, "-serial", link])
                .arg("-kernel")
                .arg(self.image);
        }
        Ok(Running(command.stdin(Stdio::null()).spawn()?))
    }
}

/// The plant on a board's converters, for ever.
fn serve(study: &Study, board: &Board, address: &str) -> Outcome<bool> {
    let socket = Socket::new("converters")?;
    let link = if board.machine == VIRTUAL {
        format!("tcp:{address}")
    } else {
        format!("tcp:{address},server=on,wait=off")
    };
    let mut process = board.start(&socket.argument(), &link)?;
    let mut converters = socket.accept(&mut process)?;
    let mut rig = Rig::new(
        study.plant().clone(),
        &study.machine().board,
        &study.machine().simulation,
    );
    let mut sample = || -> Outcome<()> {
        let request = request(rig.sample());
        rig.advance(parse_reply(&exchange(&mut converters, &request)?)?);
        Ok(())
    };
    // An emulator that answers has its link too.
    sample()?;
    println!("listening on {address}");
    loop {
        sample()?;
    }
}

#[derive(Default)]
struct Count {
    samples: u32,
    equal: u32,
    answers: u32,
    answers_equal: u32,
    clamped: u32,
    seconds: f64,
}

fn in_the_loop(
    study: &Study,
    entry: &'static Entry,
    cli: &Cli,
    name: &str,
    board: Option<Board>,
) -> Outcome<Count> {
    let start = Instant::now();
    let settings = &study.machine().simulation;
    // One a run of this program and board, as on a board.
    let room = board.as_ref().map_or(ROOM, Board::room);
    let memory = Memory {
        records: vec![Record::NONE; room].leak(),
        lines: vec![Slot::EMPTY; LINES].leak(),
    };
    let limits = board
        .as_ref()
        .map_or(Limits::NONE, |board| limits(board.machine));
    let host: &'static BoardController = Box::leak(Box::new(BoardController::new()));
    let store = Store::new(RamFlash::new(), 0..RamFlash::SIZE as u32);
    let mut session = Session {
        name,
        board: board.as_ref().map(Emulated::start).transpose()?,
        rig: Rig::new(study.plant().clone(), &study.machine().board, settings),
        link: LinkTask::begin(host, entry, limits, store, memory),
        host,
        session: 0,
        sequence: 0,
        count: Count::default(),
        stuck: None,
    };
    if cli.quick {
        session.quick(cli.samples)?;
    } else {
        session.long(cli.samples)?;
    }
    if let Some(board) = session.board.take() {
        board.end()?;
    }
    let mut count = session.count;
    count.seconds = start.elapsed().as_secs_f64();
    Ok(count)
}

/// A board, unless the host is alone, and the host's copy of it.
struct Session<'a> {
    name: &'a str,
    board: Option<Emulated>,
    rig: Rig,
    host: &'static BoardController,
    link: LinkTask<RamFlash>,
    session: u32,
    sequence: u32,
    count: Count,
    /// The code that sensor 3 gives whatever it feels.
    stuck: Option<i16>,
}

impl Session<'_> {
    /// All of it under a table with short waits, and a little under the compiled-in one.
    fn quick(&mut self, samples: u32) -> Outcome<()> {
        self.hello()?;
        let mut table = self.table()?;
        let supervision = &mut table.supervision;
        supervision.ramp = supervision.ramp.powi(10);
        // Shorter, the machine still swings as the loop closes, and clamps by itself.
        supervision.settle /= 4;
        supervision.safe_ramp /= 10;
        let test = &mut table.self_test;
        (test.settle, test.measure, test.watch) =
            (test.settle / 10, test.measure / 10, test.watch / 10);
        self.send(table.validate()?)?;
        self.whole(samples, SHOCK / 10)?;
        self.stop_and_forget()?;
        // The compiled-in table is back: the first leg's test.
        self.done(&Request::SelfTest)?;
        self.samples(2500)
    }

    /// All of it under the compiled-in table, and a little under another.
    fn long(&mut self, samples: u32) -> Outcome<()> {
        self.hello()?;
        self.whole(samples, SHOCK)?;
        self.stop()?;
        // Another only in how long it settles.
        let mut table = self.table()?;
        table.supervision.settle /= 2;
        self.send(table.validate()?)?;
        self.done(&Request::SelfTest)?;
        self.until(|mode| mode != Mode::Testing, Mode::Idle)?;
        self.done(&Request::Start)?;
        self.samples(2000)?;
        self.stop_and_forget()
    }

    /// Who is there.
    fn hello(&mut self) -> Outcome<()> {
        self.samples(100)?;
        self.expect(&Request::Hello(7), |reply| *reply == Reply::Hello)?;
        self.expect(
            &Request::Identity,
            |reply| matches!(reply, Reply::Identity(identity) if !identity.sent),
        )
    }

    /// From power-up to a second start after a fault, `samples` of it with the loop
    /// closed, the floor's shocks `shock` long.
    fn whole(&mut self, samples: u32, shock: u32) -> Outcome<()> {
        let refused = |why| move |reply: &Reply| *reply == Reply::Refused(why);
        self.expect(&Request::Start, refused(Refusal::Mode))?;
        self.expect(&Request::SetGain(f32::NAN), refused(Refusal::Range))?;
        self.garbled()?;
        self.done(&Request::SelfTest)?;
        self.until(|mode| mode != Mode::Testing, Mode::Idle)?;

        self.done(&Request::Record(Recording {
            trigger: Trigger::Injection,
            before: 20,
            after: 180,
        }))?;
        self.samples(100)?;
        let lines = (0..LINES as u32).map(|k| Line {
            turns: 2 + k,
            amplitude: 0.5,
        });
        self.done(&Request::Multisine(10, lines.collect()))?;
        self.done(&Request::Inject(Injection {
            signal: Signal::Multisine,
            legs: [1.0, -2.0, 3.0, -1.0, 0.5, 0.0],
            samples: 1100,
        }))?;
        self.samples(1100)?;
        self.records(Request::Recording, 200)?;
        for k in 0..LINES {
            let whole = |reply: &Reply| matches!(reply, Reply::Line(line) if line.windows == 1);
            self.expect(&Request::Line(k as u8), whole)?;
        }

        self.done(&Request::Start)?;
        self.until(|mode| mode != Mode::Starting, Mode::Closed)?;
        self.done(&Request::Inject(Injection {
            signal: Signal::Noise { seed: 3 },
            legs: [5.0; 6],
            samples: 2000,
        }))?;
        for k in 0..samples {
            // None in the last second: the fault is to find a machine that is quiet
            // enough for what comes after it.
            let rough = k % SHOCKS_APART < shock && k + 20_000 < samples;
            self.rig.floor_gain = if rough { ROUGH } else { 1.0 };
            self.sample()?;
        }
        self.rig.floor_gain = 1.0;
        if let Some(fault) = self.report()?.fault {
            return Err(format!("the loop opened by itself: {fault:?}").into());
        }
        self.count.clamped = self.report()?.clamped;
        if samples >= 30_000 && self.count.clamped == 0 {
            return Err("the run was to hold clamped samples".into());
        }

        self.stuck = Some(5);
        self.until(|mode| mode == Mode::Failed, Mode::Failed)?;
        let fault = self.report()?.fault.map(|fault| fault.cause);
        if fault != Some(Cause::Stuck(1 << 2)) {
            return Err(format!("sensor 3 stuck was told as {fault:?}").into());
        }
        self.expect(&Request::Start, refused(Refusal::Mode))?;
        self.records(Request::Snapshot, 64)?;
        self.stuck = None;
        self.done(&Request::Clear)?;
        self.expect(&Request::Start, refused(Refusal::Mode))?;
        self.done(&Request::SelfTest)?;
        self.until(|mode| mode != Mode::Testing, Mode::Idle)?;
        self.done(&Request::Start)?;
        self.samples(2000)?;
        self.expect(&Request::Report, |reply| matches!(reply, Reply::Report(_)))
    }

    fn stop(&mut self) -> Outcome<()> {
        self.done(&Request::Stop)?;
        self.until(|mode| mode != Mode::Stopping, Mode::Idle)
    }

    /// A table over the link, kept from then on; not if a bit of it is lost.
    fn send(&mut self, table: ValidTable) -> Outcome<()> {
        let mut room = [0; TABLE_ROOM];
        let bytes = table.encode(&mut room).ok_or("a table that is too long")?;
        for (at, piece) in (0..).step_by(256).zip(bytes.chunks(256)) {
            self.done(&Request::Piece(at, piece.iter().copied().collect()))?;
        }
        // Shorter than the room.
        let length = bytes.len() as u32;
        let keep = Request::Keep(length, table.checksum() ^ 1);
        self.expect(&keep, |reply| matches!(reply, Reply::Refused(_)))?;
        self.done(&Request::Keep(length, table.checksum()))?;
        self.expect(&Request::Identity, |reply| {
            matches!(reply, Reply::Identity(identity)
                if identity.sent && identity.checksum == table.checksum())
        })
    }

    /// Not while the legs are driven; then the compiled-in table is back.
    fn stop_and_forget(&mut self) -> Outcome<()> {
        let mode = Refusal::Mode;
        self.expect(&Request::Forget, |reply| *reply == Reply::Refused(mode))?;
        self.stop()?;
        self.done(&Request::Forget)?;
        self.expect(
            &Request::Identity,
            |reply| matches!(reply, Reply::Identity(identity) if !identity.sent),
        )
    }

    /// The table that runs.
    fn table(&self) -> Outcome<Table> {
        let table = self.host.with(|controller| *controller.table());
        Ok(*table.ok_or("no table")?.get())
    }

    fn report(&self) -> Outcome<ControllerReport> {
        let report = self.host.with(|controller| controller.report());
        report.ok_or_else(|| "no table".into())
    }

    fn sample(&mut self) -> Outcome<()> {
        let mut adc = self.rig.sample();
        if let Some(code) = self.stuck {
            adc.sensors[2].0 = code;
        }
        let expected = self.host.on_sample(adc.into()).ok_or("no table")?;
        let dac = match &mut self.board {
            Some(board) => parse_reply(&exchange(&mut board.converters, &request(adc))?)?,
            None => expected,
        };
        self.count.samples += 1;
        self.count.equal += u32::from(dac == expected);
        if dac != expected && self.count.samples - self.count.equal == 1 {
            println!(
                "{}: sample {}: {adc:?} gave {dac:?}, on the host {expected:?}",
                self.name, self.count.samples
            );
        }
        self.rig.advance(dac);
        Ok(())
    }

    fn samples(&mut self, count: u32) -> Outcome<()> {
        (0..count).try_for_each(|_| self.sample())
    }

    /// Runs on until the host's mode is one where `end` holds, which must be
    /// `expected`.
    fn until(&mut self, end: impl Fn(Mode) -> bool, expected: Mode) -> Outcome<()> {
        for _ in 0..400_000 {
            let mode = self.report()?.mode;
            if end(mode) {
                return if mode == expected {
                    Ok(())
                } else {
                    let fault = self.report()?.fault;
                    Err(format!("{mode:?} with {fault:?}, not {expected:?}").into())
                };
            }
            self.sample()?;
        }
        Err(format!("{expected:?} did not come").into())
    }

    /// Asks both; their answers, byte by byte, are to be equal.
    fn ask(&mut self, request: &Request) -> Outcome<Reply> {
        self.sequence += 1;
        let packet = Packet {
            version: VERSION,
            session: self.session,
            sequence: self.sequence,
            body: request.clone(),
        };
        let frame = encode(&packet).ok_or("a request that is too long")?;
        let reply = self.frames(&frame)?;
        self.session = reply.session;
        Ok(reply.body)
    }

    /// Sends bytes to both.
    fn frames(&mut self, bytes: &[u8]) -> Outcome<Packet<Reply>> {
        let mut expected = None;
        for byte in bytes {
            expected = self.link.on_byte(*byte, self.host).or(expected);
        }
        let expected = expected.ok_or("a frame without an answer")?;
        let found = match &mut self.board {
            Some(board) => board.talk(bytes)?,
            None => expected.to_vec(),
        };
        self.count.answers += 1;
        self.count.answers_equal += u32::from(found == expected[..]);
        if found != expected[..] {
            println!("{}: answered {found:?}, the host {expected:?}", self.name);
        }
        let mut cutter = Cutter::new();
        let mut packets = found.iter().filter_map(|byte| cutter.push(*byte));
        Ok(packets.next().ok_or("an answer without an end")??)
    }

    fn expect(&mut self, request: &Request, is: impl Fn(&Reply) -> bool) -> Outcome<()> {
        let reply = self.ask(request)?;
        if is(&reply) {
            Ok(())
        } else {
            Err(format!("{request:?} was answered with {reply:?}").into())
        }
    }

    fn done(&mut self, request: &Request) -> Outcome<()> {
        self.expect(request, |reply| *reply == Reply::Done)
    }

    fn records(&mut self, request: fn(u32) -> Request, length: usize) -> Outcome<()> {
        let mut from = 0;
        loop {
            match self.ask(&request(from))? {
                Reply::Records(records) if records.is_empty() => break,
                // At most the room.
                Reply::Records(records) => from += records.len() as u32,
                reply => return Err(format!("{reply:?} in place of records").into()),
            }
        }
        if from as usize == length {
            Ok(())
        } else {
            Err(format!("{from} records, not {length}").into())
        }
    }

    /// A frame with a bit turned, an old one, and one of no session: each is
    /// refused and changes nothing.
    fn garbled(&mut self) -> Outcome<()> {
        let before = self.report()?;
        let packet = |session, sequence| {
            encode(&Packet {
                version: VERSION,
                session,
                sequence,
                body: Request::SelfTest,
            })
            .ok_or("a request that is too long")
        };
        let mut bad = packet(self.session, self.sequence + 1)?;
        bad[4] ^= 0x10;
        let old = packet(self.session, self.sequence)?;
        let other = packet(self.session ^ 2, self.sequence + 1)?;
        for (frame, why) in [
            (bad, Refusal::Frame),
            (old, Refusal::Replayed),
            (other, Refusal::Session),
        ] {
            let reply = self.frames(&frame)?.body;
            if reply != Reply::Refused(why) {
                return Err(format!("{reply:?}, not {why:?}").into());
            }
        }
        if self.report()? == before {
            Ok(())
        } else {
            Err("a refused frame changed something".into())
        }
    }
}

/// An emulator with its UARTs on sockets.
struct Emulated {
    process: Running,
    converters: UnixStream,
    link: UnixStream,
    /// Whether it ends when both are closed, after it has printed what it measured.
    ends: bool,
}

impl Emulated {
    fn start(board: &Board) -> Outcome<Self> {
        let [converters, link] = [Socket::new("converters")?, Socket::new("link")?];
        let mut process = board.start(&converters.argument(), &link.argument())?;
        Ok(Self {
            converters: converters.accept(&mut process)?,
            link: link.accept(&mut process)?,
            process,
            ends: board.machine == VIRTUAL,
        })
    }

    /// Lets the board print what it measured, if it does.
    fn end(self) -> Outcome<()> {
        let Self {
            mut process,
            converters,
            link,
            ends,
        } = self;
        drop((converters, link));
        if ends && !process.0.wait()?.success() {
            return Err("the virtual board failed at its end".into());
        }
        Ok(())
    }

    /// Sends a frame over the link and waits for one.
    fn talk(&mut self, frame: &[u8]) -> Outcome<Vec<u8>> {
        self.link.write_all(frame)?;
        let mut answer = Vec::new();
        let mut byte = [1];
        while byte != [0] {
            self.link
                .read_exact(&mut byte)
                .map_err(|error| format!("the link does not answer: {error}"))?;
            answer.push(byte[0]);
        }
        Ok(answer)
    }
}

/// One sample over the converters' line.
fn exchange(converters: &mut UnixStream, request: &[u8; REQUEST]) -> Outcome<[u8; REPLY]> {
    converters.write_all(request)?;
    let mut reply = [0; REPLY];
    converters
        .read_exact(&mut reply)
        .map_err(|error| format!("the board does not answer: {error}"))?;
    Ok(reply)
}

/// A process that ends with its owner.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already; there is nothing else to do about it.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A socket that the emulator connects a UART to.
struct Socket {
    folder: TempDir,
    name: &'static str,
    listener: UnixListener,
}

impl Socket {
    fn new(name: &'static str) -> Outcome<Self> {
        let folder = tempfile::tempdir()?;
        let listener = UnixListener::bind(folder.path().join(name))?;
        listener.set_nonblocking(true)?;
        Ok(Self {
            folder,
            name,
            listener,
        })
    }

    fn argument(&self) -> String {
        format!("unix:{}", self.folder.path().join(self.name).display())
    }

    fn accept(&self, process: &mut Running) -> Outcome<UnixStream> {
        let start = Instant::now();
        let line = loop {
            match self.listener.accept() {
                Ok((line, _)) => break line,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(error) => return Err(error.into()),
            }
            if let Some(status) = process.0.try_wait()? {
                return Err(format!("the emulator ended at once ({status})").into());
            }
            if start.elapsed() > SILENCE {
                return Err("the emulator did not connect its UARTs".into());
            }
            thread::sleep(Duration::from_millis(5));
        };
        line.set_nonblocking(false)?;
        line.set_read_timeout(Some(SILENCE))?;
        Ok(line)
    }
}
