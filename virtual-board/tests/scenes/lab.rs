//! A board in a laboratory: its link in our hands, its outputs recorded.

use shared::controller::{ControllerReport, Health, Restart};
use shared::link::{Cutter, Packet, Reply, Request, VERSION, encode};
use shared::supervisor::Mode;
use virtual_board::board::{Board, LEGS};
use virtual_board::chips::ad5676r::MIDDLE;
use virtual_board::image::Image;
use virtual_board::peripherals::rcc::Reset;
use virtual_board::time::{Cost, MILLISECOND, Ticks, in_seconds};

pub type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Longest time until an answer.
const ANSWER: Ticks = 5_000 * MILLISECOND;

pub struct Lab {
    pub board: Board,
    session: u32,
    sequence: u32,
    /// Sessions so far: a number is not taken twice.
    hellos: u32,
    cutter: Cutter,
}

/// The image to run.
pub fn image() -> Outcome<Image> {
    let path = std::env::var("VIRTUAL_IMAGE").map_err(
        |_| "VIRTUAL_IMAGE is the path of the image; cargo xtask virtual --scenes sets it",
    )?;
    Ok(Image::parse(
        &std::fs::read(&path).map_err(|error| format!("{path}: {error}"))?,
    )?)
}

/// Whether the scenes that take minutes run.
pub fn long() -> bool {
    std::env::var("VIRTUAL_LONG").is_ok_and(|value| value == "1")
}

impl Lab {
    /// A board that runs, recorded from power-on.
    pub fn new() -> Outcome<Self> {
        let mut lab = Self::off()?;
        lab.board.run(20 * MILLISECOND)?;
        Ok(lab)
    }

    /// A board on which power has just come on.
    pub fn off() -> Outcome<Self> {
        let mut board = Board::new(image()?, Cost::DEFAULT)?;
        board.bus_mut().adc.noise = 3;
        board.record(&[]);
        Ok(Self {
            board,
            session: 0,
            sequence: 0,
            hellos: 0,
            cutter: Cutter::new(),
        })
    }

    /// A board whose loop pushes a leg, as its self-test does.
    pub fn pushing() -> Outcome<Self> {
        let mut lab = Self::new()?;
        lab.push()?;
        Ok(lab)
    }

    /// Starts the self-test, and waits until a leg is pushed.
    pub fn push(&mut self) -> Outcome {
        self.done(Request::SelfTest)?;
        self.board.run(200 * MILLISECOND)?;
        let outputs = &self.board.bus().dac.outputs()[..LEGS];
        if self.report()?.mode != Mode::Testing || outputs.iter().all(|code| *code == MIDDLE) {
            return Err(format!("no leg is pushed: {outputs:?}").into());
        }
        Ok(())
    }

    /// Asks, and waits for the answer.
    pub fn ask(&mut self, body: Request) -> Outcome<Reply> {
        if self.session == 0 && !matches!(body, Request::Hello(_)) {
            self.hello()?;
        }
        let frame = self.frame(body)?;
        self.board.received();
        self.board.send(&frame);
        let mut replies = self.replies(1)?;
        replies.pop().ok_or_else(|| "no answer".into())
    }

    /// A session of its own.
    pub fn hello(&mut self) -> Outcome {
        self.hellos += 1;
        let number = self.hellos;
        self.session = 0;
        match self.ask(Request::Hello(number))? {
            Reply::Hello => Ok(()),
            reply => Err(format!("{reply:?} to hello").into()),
        }
    }

    /// The bytes of a request.
    pub fn frame(&mut self, body: Request) -> Outcome<Vec<u8>> {
        self.sequence += 1;
        let packet = Packet {
            version: VERSION,
            session: self.session,
            sequence: self.sequence,
            body,
        };
        Ok(encode(&packet)
            .ok_or("a request that is too long")?
            .to_vec())
    }

    /// Waits for so many answers.
    pub fn replies(&mut self, count: usize) -> Outcome<Vec<Reply>> {
        let mut replies = Vec::new();
        let end = self.board.now() + ANSWER;
        while replies.len() < count {
            if self.board.now() >= end {
                return Err(format!(
                    "{} of {count} answers; resets {:?}",
                    replies.len(),
                    self.board.resets
                )
                .into());
            }
            self.board.run(MILLISECOND)?;
            for byte in self.board.received() {
                if let Some(packet) = self.cutter.push::<Reply>(byte) {
                    let packet = packet.map_err(|_| "a frame that cannot be read")?;
                    if packet.body == Reply::Hello {
                        // The board makes a number of ours and its own.
                        self.session = packet.session;
                    }
                    replies.push(packet.body);
                }
            }
        }
        Ok(replies)
    }

    pub fn done(&mut self, body: Request) -> Outcome {
        match self.ask(body.clone())? {
            Reply::Done => Ok(()),
            reply => Err(format!("{body:?} was answered with {reply:?}").into()),
        }
    }

    pub fn report(&mut self) -> Outcome<ControllerReport> {
        match self.ask(Request::Report)? {
            Reply::Report(report) => Ok(report),
            reply => Err(format!("{reply:?} in place of a report").into()),
        }
    }

    pub fn health(&mut self) -> Outcome<Health> {
        match self.ask(Request::Health)? {
            Reply::Health(health) => Ok(health),
            reply => Err(format!("{reply:?} in place of health").into()),
        }
    }

    /// The cause of the last start, asked in a session of its own once it is known.
    pub fn restart(&mut self) -> Outcome<Restart> {
        self.board.run(150 * MILLISECOND)?;
        self.hello()?;
        Ok(self.health()?.restart)
    }

    /// From `since` on, every output is in the middle after at most `bound`, and for the
    /// rest of the time until now.
    pub fn safe_within(&self, since: Ticks, bound: Ticks) -> Outcome {
        for leg in 0..LEGS {
            let last = self
                .board
                .output(leg)
                .iter()
                .rfind(|(at, code)| *at > since + bound && *code != MIDDLE);
            let at_bound = self.board.bus().dac.history(leg).at(since + bound);
            if last.is_some() || at_bound != Some(MIDDLE) {
                return Err(format!(
                    "leg {leg}: {at_bound:?} {:.6} s after the event; last not safe {:?} s after",
                    in_seconds(bound),
                    last.map(|(at, code)| (in_seconds(*at - since), *code))
                )
                .into());
            }
        }
        Ok(())
    }

    /// The board was reset once since, for a cause, within a time.
    pub fn reset_within(&self, cause: Reset, since: Ticks, bound: Ticks) -> Outcome {
        let resets: Vec<_> = self
            .board
            .resets
            .iter()
            .filter(|(at, _)| *at >= since)
            .collect();
        match resets[..] {
            [(at, found)] if *found == cause && *at <= since + bound => Ok(()),
            _ => Err(format!("resets {resets:?}, not {cause:?} within {bound} ticks").into()),
        }
    }

    /// Address of an instruction, in a function of the image whose name holds `part`.
    pub fn function(&self, part: &str) -> Outcome<u32> {
        let found = self.board.image.find(part).map(|symbol| symbol.address);
        found.ok_or_else(|| format!("the image has no function {part}").into())
    }

    /// The address of a halfword in the flash.
    pub fn instruction(&self, halfword: u16) -> Outcome<u32> {
        let flash = self
            .board
            .bus()
            .memory
            .area(virtual_board::memory::Area::Flash);
        let at = flash[..0xC_0000]
            .chunks_exact(2)
            .position(|bytes| *bytes == halfword.to_le_bytes());
        let at = at.ok_or_else(|| format!("no {halfword:#06x} in the image"))?;
        Ok(0x0800_0000 + 2 * at as u32)
    }

    /// Runs until the sample interrupt is well inside its handler.
    pub fn run_into_interrupt(&mut self) -> Outcome {
        let handler = self.function("TIM1_CC")?;
        if !self.board.run_to(handler, 10 * MILLISECOND)? {
            return Err("the interrupt does not come".into());
        }
        let inside = virtual_board::time::MICROSECOND;
        Ok(self.board.run(10 * inside)?)
    }

    /// Runs until thread mode, outside a critical section.
    pub fn run_into_main(&mut self) -> Outcome {
        for _ in 0..1000 {
            let masked = self.board.machine.masks().primask;
            if self.board.bus().nvic.running() == 0 && !masked {
                return Ok(());
            }
            self.board.run(virtual_board::time::MICROSECOND)?;
        }
        Err("thread mode does not come".into())
    }
}
