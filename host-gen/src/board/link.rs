//! The host's end of the link: a client over a serial port or TCP.

use std::collections::VecDeque;
use std::fmt;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant, SystemTime};

use shared::LEGS;
use shared::controller::{ControllerReport, Health, Identity, Refusal, Telemetry};
use shared::injection::{Injection, Signal};
use shared::levels::Levels;
use shared::link::upload::PIECE;
use shared::link::{Cutter, Packet, Reply, Request, VERSION, encode};
use shared::multisine::LineParts;
use shared::recorder::{Record, Recorded, Recording};
use shared::table::{TABLE_ROOM, ValidTable};

use super::words::reason;

/// Address of a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// A TCP address, HOST:PORT.
    Tcp(String),
    /// Path or name of a serial port.
    Serial(String),
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let port = text.rsplit_once(':').map(|(_, port)| port.parse::<u16>());
        match port {
            Some(Ok(_)) => Ok(Self::Tcp(text.to_owned())),
            None if !text.is_empty() => Ok(Self::Serial(text.to_owned())),
            _ => Err("write HOST:PORT, or the path of a serial port".to_owned()),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(name) | Self::Serial(name) => f.write_str(name),
        }
    }
}

/// Errors of the link.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The serial port or the connection failed.
    #[error("{at}: {error}")]
    Line {
        /// Address of the board.
        at: Address,
        /// Error of the operating system.
        error: io::Error,
    },
    /// The board did not reply in time, and nothing else arrived.
    #[error("{0}: no reply within {SILENCE:?}; check the address, and that the board runs")]
    Silent(Address),
    /// Bytes arrived, but not the reply in time.
    #[error(
        "{at}: {bytes} bytes arrived within {SILENCE:?}, but no reply among them; check that this is the link of a board, its wiring, and that no other program uses it"
    )]
    Noise {
        /// Address of the board.
        at: Address,
        /// Number of bytes that arrived.
        bytes: u64,
    },
    /// The board replies, but takes no samples.
    #[error(
        "{0}: the board replies, but has taken no sample for {SILENCE:?}; check its converters and its clock"
    )]
    Standing(Address),
    /// What [`Client::stop_when`] was given has become true.
    #[error("interrupted")]
    Interrupted,
    /// The board refused the request.
    #[error("the board refuses the request: {}", reason(*.0))]
    Refused(Refusal),
    /// The reply does not belong to the request.
    #[error("the reply does not belong to the request; check that no other program uses this link")]
    Answer,
}

/// Longest wait for a connection, and for a whole reply.
const SILENCE: Duration = Duration::from_secs(5);

/// Longest wait of a single read or write: so often, deadlines and interruptions are looked
/// at.
const PATIENCE: Duration = Duration::from_millis(20);

/// A byte stream: a serial port or a TCP connection.
trait ByteStream: Read + Write {}
impl<T: Read + Write> ByteStream for T {}

/// A session with a board.
pub struct Client {
    line: BufReader<Box<dyn ByteStream>>,
    at: Address,
    cutter: Cutter,
    session: u32,
    sequence: u32,
    telemetry: VecDeque<Telemetry>,
    /// Bytes that have arrived.
    bytes: u64,
    stop: Option<Arc<AtomicBool>>,
}

/// Whether a read or write only took longer than [`PATIENCE`], or a signal came.
fn is_pause(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}

/// Opens a TCP connection.
fn dial(name: &str) -> io::Result<TcpStream> {
    let mut failed = io::Error::other("the name has no address");
    for address in name.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, SILENCE) {
            Ok(stream) => {
                stream.set_read_timeout(Some(PATIENCE))?;
                stream.set_write_timeout(Some(PATIENCE))?;
                stream.set_nodelay(true)?;
                return Ok(stream);
            }
            Err(error) => failed = error,
        }
    }
    Err(failed)
}

/// The byte stream to `at`. A name server, a host or a driver that does not answer is left
/// alone after [`SILENCE`].
fn open(at: &Address) -> Result<Box<dyn ByteStream>, LinkError> {
    let (sender, opened) = mpsc::channel();
    let address = at.clone();
    std::thread::spawn(move || {
        let line = match &address {
            Address::Tcp(name) => {
                dial(name).map(|line| Box::new(line) as Box<dyn ByteStream + Send>)
            }
            Address::Serial(name) => {
                let port = serialport::new(name, 921_600).timeout(PATIENCE).open();
                port.map(|line| Box::new(line) as _)
                    .map_err(io::Error::from)
            }
        };
        // Nobody waits any more after a time-out.
        let _ = sender.send(line);
    });
    match opened.recv_timeout(SILENCE) {
        Ok(Ok(line)) => Ok(line),
        Ok(Err(error)) if error.kind() != io::ErrorKind::TimedOut => Err(LinkError::Line {
            at: at.clone(),
            error,
        }),
        Ok(Err(_)) | Err(_) => Err(LinkError::Silent(at.clone())),
    }
}

impl Client {
    /// Connects to the board at `at` and starts a session.
    ///
    /// # Errors
    /// [`LinkError`] if the port cannot be opened or the board does not reply.
    pub fn connect(at: &Address) -> Result<Self, LinkError> {
        let mut client = Self {
            line: BufReader::new(open(at)?),
            at: at.clone(),
            cutter: Cutter::new(),
            session: 0,
            sequence: 0,
            telemetry: VecDeque::new(),
            bytes: 0,
            stop: None,
        };
        // Ends a frame that another program may have left incomplete.
        client.send(&[0], Instant::now() + SILENCE)?;
        // It only has to differ from one session to the next.
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let nonce = now.map_or(0, |time| time.as_nanos() as u32 ^ std::process::id());
        match client.ask(Request::Hello(nonce))? {
            Reply::Hello => Ok(client),
            _ => Err(LinkError::Answer),
        }
    }

    /// From now on, everything but [`Client::end_injection`] ends with
    /// [`LinkError::Interrupted`] once `stop` is true.
    pub fn stop_when(&mut self, stop: Arc<AtomicBool>) {
        self.stop = Some(stop);
    }

    /// What `wind_up` does with the client is not interrupted.
    pub fn uninterrupted<T>(&mut self, wind_up: impl FnOnce(&mut Self) -> T) -> T {
        let stop = self.stop.take();
        let outcome = wind_up(self);
        self.stop = stop;
        outcome
    }

    /// Fails if the client is to stop.
    fn go_on(&self) -> Result<(), LinkError> {
        let stop = self.stop.as_ref();
        match stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            true => Err(LinkError::Interrupted),
            false => Ok(()),
        }
    }

    /// Writes all bytes before `deadline`.
    fn send(&mut self, mut bytes: &[u8], deadline: Instant) -> Result<(), LinkError> {
        while !bytes.is_empty() {
            match self.line.get_mut().write(bytes) {
                Ok(0) => return Err(self.failed(io::ErrorKind::WriteZero.into())),
                Ok(count) => bytes = &bytes[count..],
                Err(error) if is_pause(&error) => {}
                Err(error) => return Err(self.failed(error)),
            }
            if !bytes.is_empty() && Instant::now() > deadline {
                return Err(LinkError::Silent(self.at.clone()));
            }
            self.go_on()?;
        }
        Ok(())
    }

    /// Sends a request and waits for the reply. Telemetry that arrives before the reply
    /// is queued.
    ///
    /// # Errors
    /// [`LinkError`] if the connection fails, no reply comes, or the board refuses the
    /// request.
    pub fn ask(&mut self, request: Request) -> Result<Reply, LinkError> {
        self.sequence += 1;
        let hello = matches!(request, Request::Hello(_));
        let packet = Packet {
            version: VERSION,
            session: self.session,
            sequence: self.sequence,
            body: request,
        };
        let frame = encode(&packet).expect("requests are shorter than a frame");
        self.go_on()?;
        let deadline = Instant::now() + SILENCE;
        let before = self.bytes;
        self.send(&frame, deadline)?;
        loop {
            let Some(reply) = self.receive(deadline)? else {
                let at = self.at.clone();
                return Err(match self.bytes - before {
                    0 => LinkError::Silent(at),
                    bytes => LinkError::Noise { at, bytes },
                });
            };
            if let Reply::Telemetry(telemetry) = reply.body {
                self.keep(reply.session, telemetry);
                continue;
            }
            // A late reply, or one from another session.
            if reply.sequence != self.sequence || !hello && reply.session != self.session {
                if let Reply::Refused(refusal) = reply.body
                    && reply.sequence == 0
                    && !hello
                {
                    return Err(LinkError::Refused(refusal));
                }
                continue;
            }
            self.session = reply.session;
            return match reply.body {
                Reply::Refused(refusal) => Err(LinkError::Refused(refusal)),
                body => Ok(body),
            };
        }
    }

    fn failed(&self, error: io::Error) -> LinkError {
        LinkError::Line {
            at: self.at.clone(),
            error,
        }
    }

    fn keep(&mut self, session: u32, telemetry: Telemetry) {
        if session == self.session {
            self.telemetry.push_back(telemetry);
        }
    }

    /// The next packet; none if there was none before `deadline`, whatever else arrives.
    fn receive(&mut self, deadline: Instant) -> Result<Option<Packet<Reply>>, LinkError> {
        loop {
            self.go_on()?;
            let read = match self.line.fill_buf() {
                Ok([]) => Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(bytes) => {
                    // A malformed frame is ignored; its request then times out.
                    let mut packet = None;
                    let mut taken = 0;
                    for byte in bytes {
                        taken += 1;
                        packet = self.cutter.push(*byte).and_then(Result::ok);
                        if packet.is_some() {
                            break;
                        }
                    }
                    Ok((taken, packet))
                }
                Err(error) if is_pause(&error) => Ok((0, None)),
                Err(error) => Err(error),
            };
            let (taken, packet) = read.map_err(|error| self.failed(error))?;
            self.line.consume(taken);
            self.bytes += taken as u64;
            if packet.is_some() || Instant::now() > deadline {
                return Ok(packet);
            }
        }
    }

    /// The next telemetry packet; none if none arrived within 20 ms.
    ///
    /// # Errors
    /// [`LinkError`] if the connection fails.
    pub fn telemetry(&mut self) -> Result<Option<Telemetry>, LinkError> {
        if self.telemetry.is_empty()
            && let Some(packet) = self.receive(Instant::now() + PATIENCE)?
            && let Reply::Telemetry(telemetry) = packet.body
        {
            self.keep(packet.session, telemetry);
        }
        Ok(self.telemetry.pop_front())
    }

    /// Sends a request whose reply has no data.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn command(&mut self, request: Request) -> Result<(), LinkError> {
        match self.ask(request)? {
            Reply::Done => Ok(()),
            _ => Err(LinkError::Answer),
        }
    }

    /// Mode, gain, fault and counters of the controller.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn report(&mut self) -> Result<ControllerReport, LinkError> {
        match self.ask(Request::Report)? {
            Reply::Report(report) => Ok(report),
            _ => Err(LinkError::Answer),
        }
    }

    /// Identity of the table that the board runs.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn identity(&mut self) -> Result<Identity, LinkError> {
        match self.ask(Request::Identity)? {
            Reply::Identity(identity) => Ok(identity),
            _ => Err(LinkError::Answer),
        }
    }

    /// Load, jitter and free stack of the board's processor, and the cause of its last
    /// restart.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn health(&mut self) -> Result<Health, LinkError> {
        match self.ask(Request::Health)? {
            Reply::Health(health) => Ok(health),
            _ => Err(LinkError::Answer),
        }
    }

    /// Levels of the last window: rms and peak of every sensor and leg, and the processor's load.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn levels(&mut self) -> Result<Levels, LinkError> {
        match self.ask(Request::Levels)? {
            Reply::Levels(levels) => Ok(levels),
            _ => Err(LinkError::Answer),
        }
    }

    /// Waits for levels of another window than the one with number `window`.
    ///
    /// # Errors
    /// As [`Client::wait_for`].
    pub fn levels_after(&mut self, window: u32) -> Result<Levels, LinkError> {
        loop {
            let at = self.report()?.at;
            self.wait_for(|report| report.at != at)?;
            let levels = self.levels()?;
            if levels.window != window {
                return Ok(levels);
            }
            // A slow line has other things to carry.
            std::thread::sleep(PATIENCE);
        }
    }

    /// The answers at a line of the multisine.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn line(&mut self, index: usize) -> Result<LineParts, LinkError> {
        // There are far fewer.
        match self.ask(Request::Line(index as u8))? {
            Reply::Line(line) => Ok(line),
            _ => Err(LinkError::Answer),
        }
    }

    /// Ends the test signal and leaves the loop as it is. Says whether there was one. It is
    /// carried out even if the client is to stop.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn end_injection(&mut self) -> Result<bool, LinkError> {
        // A zero signal replaces it; the mode stays as it is.
        let nothing = Injection {
            signal: Signal::Noise { seed: 0 },
            legs: [0.0; LEGS],
            samples: 1,
        };
        self.uninterrupted(|client| {
            if client.report()?.injecting == 0 {
                return Ok(false);
            }
            match client.command(Request::Inject(nothing)) {
                // Meanwhile the mode has changed, which ends a test signal.
                Ok(()) | Err(LinkError::Refused(Refusal::Mode)) => {}
                Err(error) => return Err(error),
            }
            client.wait_for(|report| report.injecting == 0)?;
            Ok(true)
        })
    }

    /// Sends a table. The board validates it, stores it and runs it.
    ///
    /// # Errors
    /// As [`Client::ask`]; [`LinkError::Refused`] if the board cannot run the table.
    pub fn send_table(&mut self, table: &ValidTable) -> Result<(), LinkError> {
        let mut room = [0; TABLE_ROOM];
        let bytes = table.encode(&mut room).ok_or(LinkError::Answer)?;
        for (at, piece) in (0..).step_by(PIECE).zip(bytes.chunks(PIECE)) {
            self.command(Request::Piece(at, piece.iter().copied().collect()))?;
        }
        // Shorter than the room.
        self.command(Request::Keep(bytes.len() as u32, table.checksum()))
    }

    /// Asks for reports until `is` holds for one, and returns it.
    ///
    /// # Errors
    /// As [`Client::ask`]; [`LinkError::Standing`] if the board's samples stand still.
    pub fn wait_for(
        &mut self,
        is: impl Fn(&ControllerReport) -> bool,
    ) -> Result<ControllerReport, LinkError> {
        let (mut last, mut since) = (None, Instant::now());
        loop {
            let report = self.report()?;
            if is(&report) {
                return Ok(report);
            }
            if last.replace(report.at) != Some(report.at) {
                since = Instant::now();
            } else if since.elapsed() > SILENCE {
                return Err(LinkError::Standing(self.at.clone()));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Arms the recorder and waits for the recording: the records, and the sample number
    /// of the trigger.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn record(&mut self, recording: Recording) -> Result<(Vec<Record>, u64), LinkError> {
        self.command(Request::Record(recording))?;
        self.recording()
    }

    /// Waits for the recording in progress: the records, and the sample number of the
    /// trigger.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn recording(&mut self) -> Result<(Vec<Record>, u64), LinkError> {
        let done = |report: &ControllerReport| matches!(report.recorded, Recorded::Done { .. });
        let report = self.wait_for(|report| done(report) || report.recorded == Recorded::Off)?;
        let Recorded::Done { at, .. } = report.recorded else {
            return Err(LinkError::Answer);
        };
        Ok((self.records(Request::Recording)?, at))
    }

    /// All records of a recording or a snapshot: `request` makes the request for the
    /// records from an index on.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn records(&mut self, request: fn(u32) -> Request) -> Result<Vec<Record>, LinkError> {
        let mut all: Vec<Record> = Vec::new();
        loop {
            // At most as many as fit into the board's recorder.
            match self.ask(request(all.len() as u32))? {
                Reply::Records(records) if records.is_empty() => return Ok(all),
                Reply::Records(records) => all.extend(records),
                _ => return Err(LinkError::Answer),
            }
        }
    }
}
