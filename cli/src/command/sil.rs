//! `host-gen sil`.

use std::io::{self, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use host_gen::simulate::{SoftwareBoard, is_on_board_of};
use shared::controller::Memory;
use shared::multisine::{LINES, Slot};
use shared::recorder::Record;

use crate::failure::Failure;
use crate::search::{Searcher, study};

#[derive(Args)]
pub struct SilArguments {
    /// Machine file that the board's table is made from.
    model: PathBuf,
    /// Machine file of the machine that is simulated, if it is another one than the model.
    #[arg(long, value_name = "MODEL")]
    truth: Option<PathBuf>,
    /// HOST:PORT to listen on; with port 0, a free port is taken.
    #[arg(long, default_value = "127.0.0.1:7700")]
    listen: String,
    /// While a host is connected, run as fast as possible, not in real time.
    #[arg(long)]
    fast: bool,
}

/// Capacity of the recorder, records.
const ROOM: usize = 16_384;

/// Samples between two checks of the connection: 5 ms at 20 kHz.
const BATCH: u32 = 100;

/// Longest wait for a host to read what is sent.
const UNREAD: Duration = Duration::from_secs(1);

pub fn sil(arguments: &SilArguments, searcher: &Searcher) -> Result<(), Failure> {
    let failed = |error| Failure::Io {
        path: arguments.listen.clone(),
        what: "listened on",
        error,
    };
    let model = study(&arguments.model)?;
    let truth = arguments.truth.as_deref().map(study).transpose()?;
    if let (Some(truth), Some(path)) = (&truth, &arguments.truth) {
        is_on_board_of(truth.machine(), model.machine()).map_err(|error| Failure::Truth {
            path: path.display().to_string(),
            error,
        })?;
    }
    // An address that cannot be used is told at once. It is not kept meanwhile: a host that
    // asks too early is refused and does not wait for a reply.
    drop(TcpListener::bind(&arguments.listen).map_err(failed)?);
    let _ = writeln!(
        io::stderr(),
        "designing the controller of {}; the link is open from \"listening on\" on",
        arguments.model.display()
    );
    let table = searcher.design(&arguments.model, &model)?.table;
    let listener = TcpListener::bind(&arguments.listen).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let memory = Memory {
        records: &mut vec![Record::NONE; ROOM],
        lines: &mut vec![Slot::EMPTY; LINES],
    };
    let mut sil = SoftwareBoard::new(truth.as_ref().unwrap_or(&model), &table, memory);
    // A script that started this program may wait for this line.
    println!("listening on {}", listener.local_addr().map_err(failed)?);
    io::stdout().flush().map_err(failed)?;
    let mut host: Option<TcpStream> = None;
    let batch = Duration::from_secs_f64(f64::from(BATCH) / f64::from(table.get().sample_rate));
    let mut due = Instant::now();
    loop {
        for _ in 0..BATCH {
            sil.sample();
        }
        due += batch;
        if let Ok((stream, _)) = listener.accept() {
            // The latest connection is served.
            stream.set_nonblocking(true).map_err(failed)?;
            stream.set_nodelay(true).map_err(failed)?;
            // A host that does not read is left, like one that is gone.
            stream.set_write_timeout(Some(UNREAD)).map_err(failed)?;
            host = Some(stream);
        }
        if let Some(stream) = &mut host
            && serve(stream, &mut sil).is_err()
        {
            host = None;
        }
        let now = Instant::now();
        if arguments.fast && host.is_some() {
            due = now;
        }
        // Between two hosts in real time: what the board does when nobody asks is measured
        // in seconds.
        std::thread::sleep(due.saturating_duration_since(now));
    }
}

/// Handles all received bytes and sends all waiting telemetry. An error means that the
/// connection has ended.
fn serve(stream: &mut TcpStream, sil: &mut SoftwareBoard<'_>) -> io::Result<()> {
    let mut bytes = [0; 1024];
    loop {
        match stream.read(&mut bytes) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => {
                for byte in &bytes[..count] {
                    if let Some(frame) = sil.on_byte(*byte) {
                        send(stream, &frame)?;
                    }
                }
            }
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
            Err(error) => return Err(error),
        }
    }
    while let Some(frame) = sil.telemetry() {
        send(stream, &frame)?;
    }
    Ok(())
}

fn send(stream: &mut TcpStream, frame: &[u8]) -> io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.write_all(frame)?;
    stream.set_nonblocking(true)
}
