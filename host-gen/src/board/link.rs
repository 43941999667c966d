//! The host's end of the link: a client over a serial port or TCP.

use std::collections::VecDeque;
use std::fmt;
use std::io::{self, BufReader, Read, Write};
use std::net::TcpStream;
use std::str::FromStr;
use std::time::{Duration, Instant, SystemTime};

use shared::controller::{ControllerReport, Health, Identity, Refusal, Telemetry};
use shared::link::upload::PIECE;
use shared::link::{Cutter, Packet, Reply, Request, VERSION, encode};
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
    /// The board did not reply in time.
    #[error("{0}: no reply within {SILENCE:?}; check the address, and that the board runs")]
    Silent(Address),
    /// The board refused the request.
    #[error("the board refuses the request: {}", reason(*.0))]
    Refused(Refusal),
    /// The reply does not belong to the request.
    #[error("the reply does not belong to the request; check that no other program uses this link")]
    Answer,
}

/// Longest wait for a reply.
const SILENCE: Duration = Duration::from_secs(5);

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
}

impl Client {
    /// Connects to the board at `at` and starts a session.
    ///
    /// # Errors
    /// [`LinkError`] if the port cannot be opened or the board does not reply.
    pub fn connect(at: &Address) -> Result<Self, LinkError> {
        let failed = |error: io::Error| LinkError::Line {
            at: at.clone(),
            error,
        };
        // Short, so that the total waiting time can be checked.
        let patience = Duration::from_millis(20);
        let line: Box<dyn ByteStream> = match at {
            Address::Tcp(name) => {
                let stream = TcpStream::connect(name).map_err(failed)?;
                stream.set_read_timeout(Some(patience)).map_err(failed)?;
                stream.set_nodelay(true).map_err(failed)?;
                Box::new(stream)
            }
            Address::Serial(name) => {
                let port = serialport::new(name, 921_600).timeout(patience).open();
                Box::new(port.map_err(|error| failed(error.into()))?)
            }
        };
        let mut client = Self {
            line: BufReader::new(line),
            at: at.clone(),
            cutter: Cutter::new(),
            session: 0,
            sequence: 0,
            telemetry: VecDeque::new(),
        };
        // Ends a frame that another program may have left incomplete.
        client.line.get_mut().write_all(&[0]).map_err(failed)?;
        // It only has to differ from one session to the next.
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let nonce = now.map_or(0, |time| time.as_nanos() as u32 ^ std::process::id());
        match client.ask(Request::Hello(nonce))? {
            Reply::Hello => Ok(client),
            _ => Err(LinkError::Answer),
        }
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
        let sent = self.line.get_mut().write_all(&frame);
        sent.map_err(|error| self.failed(error))?;
        let start = Instant::now();
        loop {
            if start.elapsed() > SILENCE {
                return Err(LinkError::Silent(self.at.clone()));
            }
            let Some(reply) = self.receive()? else {
                continue;
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

    /// The next packet; none if nothing arrived within the read timeout.
    fn receive(&mut self) -> Result<Option<Packet<Reply>>, LinkError> {
        let mut byte = [0; 1];
        loop {
            match self.line.read(&mut byte) {
                Ok(0) => {
                    let error = io::Error::from(io::ErrorKind::UnexpectedEof);
                    return Err(self.failed(error));
                }
                Ok(_) => {}
                Err(error)
                    if matches!(
                        error.kind(),
                        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut
                    ) =>
                {
                    return Ok(None);
                }
                Err(error) => return Err(self.failed(error)),
            }
            // A malformed frame is ignored; its request then times out.
            if let Some(Ok(packet)) = self.cutter.push(byte[0]) {
                return Ok(Some(packet));
            }
        }
    }

    /// The next telemetry packet; none if none arrived within the read timeout of 20 ms.
    ///
    /// # Errors
    /// [`LinkError`] if the connection fails.
    pub fn telemetry(&mut self) -> Result<Option<Telemetry>, LinkError> {
        if self.telemetry.is_empty()
            && let Some(packet) = self.receive()?
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
    /// As [`Client::ask`].
    pub fn wait_for(
        &mut self,
        is: impl Fn(&ControllerReport) -> bool,
    ) -> Result<ControllerReport, LinkError> {
        loop {
            let report = self.report()?;
            if is(&report) {
                return Ok(report);
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
