//! `host-gen sil` and the two clients: ours, and one that knows only the document.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::edits::model_path;
use host_gen::board::link::{Address, Client, LinkError};
use host_gen::board::measure::{MeasurementSettings, measure};
use host_gen::design::{Cache, Search, Study};
use host_gen::machine::Machine;
use shared::controller::Refusal;
use shared::link::Request;
use shared::recorder::{Recording, Trigger};
use shared::supervisor::Mode;

/// A board that is software, ended with the test.
struct Board(Child, Address);

impl Board {
    fn start() -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_host-gen"))
            .arg("sil")
            .arg(model_path())
            .args(["--listen", "127.0.0.1:0", "--fast"])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut out = BufReader::new(process.stdout.take().unwrap());
        out.read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("listening on ").unwrap();
        let address = address.parse().unwrap();
        Self(process, address)
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A whole session, the plant measured in place with it: off the model by no more
/// than a few times what its own scatter makes one expect.
#[test]
fn a_session_over_tcp() {
    let board = Board::start();
    let mut client = Client::connect(&board.1).unwrap();
    let error = client.command(Request::Start).unwrap_err();
    assert!(
        matches!(error, LinkError::Refused(Refusal::Mode)),
        "{error}"
    );
    client.command(Request::SelfTest).unwrap();
    let report = client.wait_for(|r| r.mode != Mode::Testing).unwrap();
    assert_eq!(report.mode, Mode::Idle, "{report:?}");

    let study = Study::new(Machine::load(&model_path()).unwrap()).unwrap();
    // What the board's process has found just now, if results are kept.
    let cache = std::env::var_os("HOST_GEN_CACHE").map(Cache::at);
    let search = Search {
        cache: cache.as_ref(),
        ..Search::FULL
    };
    let table = search.design(&study).unwrap().table;
    assert_eq!(client.identity().unwrap().checksum, table.checksum());
    let settings = MeasurementSettings {
        period: 8192,
        averages: 6,
        settling: 30,
        amplitude: 1.0,
    };
    let lines = measure(&mut client, &study, &table, &settings, &()).unwrap();
    assert_eq!(lines.len(), 64);
    for line in &lines {
        // Of 36 entries with six averages each: three times is a wide bound.
        assert!(line.error < 3.0 * line.expected_error, "{line:?}");
    }
    // And not only noise: at 200 Hz the plant is known to a few parts in a thousand.
    let high = lines.iter().filter(|line| line.hz > 200.0);
    assert!(high.clone().count() > 10 && high.clone().all(|line| line.error < 0.01));

    client.command(Request::Start).unwrap();
    let report = client.wait_for(|r| r.mode != Mode::Starting).unwrap();
    assert_eq!(report.mode, Mode::Closed, "{report:?}");
    let recording = Recording {
        trigger: Trigger::Now,
        before: 0,
        after: 500,
    };
    let (records, _) = client.record(recording).unwrap();
    assert_eq!(records.len(), 500);
    assert!(records.iter().any(|record| record.dac[0].0 != 32768));
    client.command(Request::Stop).unwrap();
    let report = client.wait_for(|r| r.mode != Mode::Stopping).unwrap();
    assert_eq!(report.mode, Mode::Idle);

    // Another table, and back.
    let mut tuned = *table.get();
    tuned.self_test.pilot = 0.0;
    let tuned = tuned.validate().unwrap();
    client.send_table(&tuned).unwrap();
    let identity = client.identity().unwrap();
    assert_eq!((identity.checksum, identity.sent), (tuned.checksum(), true));
    assert_eq!(client.report().unwrap().mode, Mode::Untested);
    client.command(Request::Forget).unwrap();
    assert_eq!(client.identity().unwrap().checksum, table.checksum());

    // Another session ends this one.
    let mut other = Client::connect(&board.1).unwrap();
    other.report().unwrap();
}

/// The program in Python that was written from `docs/link.md`.
#[test]
fn a_foreign_program() {
    let board = Board::start();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/external/link_client.py");
    let output = Command::new("python3")
        .arg(script)
        .arg(board.1.to_string())
        .output()
        .expect("the foreign client needs python3");
    let said = String::from_utf8_lossy(&output.stdout);
    let wrong = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}{wrong}");
    assert!(said.contains("stopped at"), "{said}");
}
