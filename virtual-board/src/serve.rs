//! The board's converters and its link over sockets, as an emulator gives its serial ports:
//! the converters as `firmware::exchange` has them, the link byte by byte.
//!
//! Sampling waits for the plant ([`crate::gate`]). Bytes of the link arrive while it waits,
//! at the link's own pace; a sample begins only when the link is quiet again and the
//! program does nothing but wait. So it makes no difference how fast the other ends are.

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::str::FromStr;

use firmware::exchange::{REQUEST, parse_request, refusal, reply};
use rustix::event::{PollFd, PollFlags, poll};

use crate::board::{Board, LEGS};

/// Where a socket is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// `unix:PATH`: connects to a socket.
    Unix(String),
    /// `tcp:ADDRESS`: waits for connections, one at a time.
    Tcp(String),
}

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            Some(("unix", path)) => Ok(Self::Unix(path.to_owned())),
            Some(("tcp", address)) => Ok(Self::Tcp(address.to_owned())),
            _ => Err(format!("{text}: neither unix:PATH nor tcp:ADDRESS")),
        }
    }
}

/// The other end of the link.
enum Link {
    Unix(UnixStream),
    Tcp(TcpListener, Option<TcpStream>),
}

impl Link {
    fn open(place: &Place) -> io::Result<Self> {
        match place {
            Place::Unix(path) => Ok(Self::Unix(UnixStream::connect(path)?)),
            Place::Tcp(address) => Ok(Self::Tcp(TcpListener::bind(address)?, None)),
        }
    }

    fn fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Unix(stream) => stream.as_fd(),
            Self::Tcp(_, Some(stream)) => stream.as_fd(),
            Self::Tcp(listener, None) => listener.as_fd(),
        }
    }

    /// Reads what there is; to be called when there is something. None at the end of a
    /// link that does not come again.
    fn read(&mut self) -> io::Result<Option<Vec<u8>>> {
        let mut bytes = [0; 4096];
        match self {
            Self::Unix(stream) => {
                let count = stream.read(&mut bytes)?;
                Ok((count > 0).then(|| bytes[..count].to_vec()))
            }
            Self::Tcp(listener, stream @ None) => {
                let (accepted, _) = listener.accept()?;
                accepted.set_nodelay(true)?;
                *stream = Some(accepted);
                Ok(Some(Vec::new()))
            }
            Self::Tcp(_, connection) => {
                let count = connection
                    .as_mut()
                    .and_then(|stream| stream.read(&mut bytes).ok())
                    .unwrap_or(0);
                if count == 0 {
                    // The next one may connect.
                    *connection = None;
                }
                Ok(Some(bytes[..count].to_vec()))
            }
        }
    }

    /// Sends bytes; without anyone to read them they are lost, as on a serial line.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Unix(stream) => stream.write_all(bytes),
            Self::Tcp(_, stream) => {
                if let Some(connected) = stream
                    && connected.write_all(bytes).is_err()
                {
                    *stream = None;
                }
                Ok(())
            }
        }
    }
}

/// Runs a board until the plant hangs up.
///
/// # Errors
/// If a socket fails, or the image does something that is not modelled.
pub fn serve(board: &mut Board, converters: &Place, link: &Place) -> Result<(), String> {
    let failed = |what: &'static str| move |error: io::Error| format!("{what}: {error}");
    let Place::Unix(path) = converters else {
        return Err("the converters are on unix:PATH".to_owned());
    };
    let mut converters = UnixStream::connect(path).map_err(failed("converters"))?;
    let mut link = Link::open(link).map_err(failed("link"))?;
    let run = |error: crate::bus::Unmodelled| error.to_string();
    board.lockstep();
    board.settle().map_err(run)?;
    loop {
        let sent = board.received();
        if !sent.is_empty() {
            link.write(&sent).map_err(failed("link"))?;
        }
        let (sample, bytes) = ready(&converters, &link).map_err(failed("poll"))?;
        if bytes {
            let Some(bytes) = link.read().map_err(failed("link"))? else {
                return Ok(());
            };
            board.send(&bytes);
            board.settle().map_err(run)?;
        } else if sample {
            let mut request = [0; REQUEST];
            match converters.read_exact(&mut request) {
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(()),
                outcome => outcome.map_err(failed("converters"))?,
            }
            let answer = match parse_request(&request) {
                Ok(samples) => {
                    let codes: [i16; LEGS] = samples.sensors.map(|code| code.0);
                    let outputs = board.sample(codes).map_err(run)?;
                    reply(outputs.map(shared_code))
                }
                Err(_) => refusal(),
            };
            converters
                .write_all(&answer)
                .map_err(failed("converters"))?;
        }
    }
}

/// Waits for either side: whether there is a sample, and whether there is something on the
/// link.
fn ready(converters: &UnixStream, link: &Link) -> io::Result<(bool, bool)> {
    let wanted = PollFlags::IN;
    let mut fds = [
        PollFd::from_borrowed_fd(converters.as_fd(), wanted),
        PollFd::from_borrowed_fd(link.fd(), wanted),
    ];
    poll(&mut fds, None)?;
    Ok((!fds[0].revents().is_empty(), !fds[1].revents().is_empty()))
}

fn shared_code(code: u16) -> shared::codes::DacCode {
    shared::codes::DacCode(code)
}
