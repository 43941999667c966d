//! Millions of seeded frames against the board's end of the link: random bytes,
//! good frames garbled, old ones and those of other sessions. None may be carried
//! out, and nothing may panic.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use firmware::tables;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng};
use shared::controller::{Controller, Memory, Refusal};
use shared::link::{Answer, Cutter, Packet, Reply, Request, Server, VERSION, encode};

/// Sends bad frames to the board's end of the link.
#[derive(Parser)]
struct Cli {
    /// How many.
    #[arg(long, default_value_t = 1_000_000)]
    frames: u64,
    /// Of the random numbers.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

fn main() -> ExitCode {
    let Cli { frames, seed } = Cli::parse();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let entry = &tables::METROLOGY_FRAME;
    let mut controller = Controller::new(*entry.table, entry.checksum, Memory::none());
    let (mut cutter, mut server) = (Cutter::new(), Server::new());
    let frame = |session, sequence, body| {
        let packet = Packet {
            version: VERSION,
            session,
            sequence,
            body,
        };
        encode(&packet).expect("requests are shorter than a frame")
    };
    let mut answers = |bytes: &[u8]| -> Vec<Packet<Reply>> {
        let packets = bytes.iter().filter_map(|byte| cutter.push(*byte));
        packets
            .map(|incoming| match server.answer(incoming, &mut controller) {
                Answer::Reply(reply) => reply,
                // No bad frame may come so far.
                Answer::Table(_) => Packet {
                    version: VERSION,
                    session: 0,
                    sequence: 0,
                    body: Reply::Done,
                },
            })
            .collect()
    };
    let hello = answers(&frame(0, 1000, Request::Hello(1)));
    let session = hello.first().map_or(0, |packet| packet.session);
    let requests = [
        Request::SelfTest,
        Request::Start,
        Request::Stop,
        Request::Clear,
        Request::SetGain(0.5),
        Request::Telemetry(1),
        Request::Recording(3),
        Request::Levels,
        Request::Forget,
        Request::Piece(0, [7; 40].into_iter().collect()),
    ];
    let mut accepted = 0u64;
    for _ in 0..frames {
        let pick = random.next_u32();
        let request = requests[pick as usize % requests.len()].clone();
        let bytes = match pick >> 8 & 3 {
            // Noise of any length.
            0 => {
                let mut noise = vec![0; random.next_u32() as usize % 64 + 1];
                random.fill_bytes(&mut noise);
                noise.push(0);
                noise
            }
            // A good frame with a burst of up to 32 bits turned, which CRC-32 always
            // finds.
            1 => {
                let mut bytes = frame(session, 2000, request).to_vec();
                let bits = 8 * (bytes.len() - 1);
                let at = random.next_u32() as usize % (bits - 32);
                let burst = random.next_u32() | 1;
                for bit in (0..32).filter(|bit| burst >> bit & 1 != 0) {
                    bytes[(at + bit) / 8] ^= 1 << ((at + bit) % 8);
                }
                bytes
            }
            // One of before.
            2 => frame(session, random.next_u32() % 1001, request).to_vec(),
            // Another session's.
            _ => frame(session ^ (random.next_u32() | 2), 2000, request).to_vec(),
        };
        accepted += answers(&bytes)
            .iter()
            .filter(|packet| !matches!(packet.body, Reply::Refused(_)))
            .count() as u64;
    }
    let last = answers(&frame(session, 1001, Request::Start));
    let alive = last
        .last()
        .is_some_and(|packet| packet.body == Reply::Refused(Refusal::Mode));
    println!("{frames} bad frames, {accepted} carried out; the link lives: {alive}");
    if accepted == 0 && alive {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
