//! AD5676R, eight outputs, 16 bits, 0 to 5 V with its own 2.5 V reference and a gain
//! of two.
//!
//! Pins set by hardware: GAIN high (0 to 5 V), RSTSEL high (a reset gives the middle of
//! the range, no force). RESET is low unless the processor drives it high: whatever
//! stops or restarts the processor takes the forces away, without a frame.
//!
//! 24 bits a frame, the highest first, taken on SCLK's falling edges (SPI mode 1 or 2)
//! up to 50 MHz: four of command, four of channel, sixteen of code. A code goes into
//! the channel's input register; a low LDAC puts all of them out at once.

use embedded_hal::spi::SpiDevice;
use shared::LEGS;
use shared::codes::DacCode;

/// Size of a frame, bytes.
pub const FRAME: usize = 3;

/// Highest clock frequency, Hz (data sheet, t1).
pub const CLOCK: u32 = 50_000_000;

/// Highest clock frequency that is used to read a code back, Hz. The data sheet's limit for
/// read-back is lower than [`CLOCK`].
pub const READ_CLOCK: u32 = 7_000_000;

/// Longest settling time of the output to within 2 LSB of the code, s (data sheet, a step
/// from a quarter to three quarters of the range).
pub const SETTLING: f64 = 8e-6;

/// The command in a frame (data sheet, command definitions).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DacCommand {
    /// Write a channel's input register. The next LDAC updates the output.
    Write(DacChannel, DacCode),
    /// Write a channel's input register and update the output.
    WriteAndUpdate(DacChannel, DacCode),
    /// Reset to the state after power-up.
    Reset,
    /// Use the internal reference, with the gain set by the pin.
    InternalReference,
    /// Read a channel's code back in the next frame.
    ReadBack(DacChannel),
    /// No operation: clocks out the code that is read back.
    Nothing,
}

/// One of the first six outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DacChannel(u8);

impl DacChannel {
    /// The channel of each leg.
    pub const ALL: [Self; LEGS] = [Self(0), Self(1), Self(2), Self(3), Self(4), Self(5)];
}

impl DacCommand {
    /// The frame as a number, which is sent from its highest bit.
    pub const fn word(self) -> u32 {
        let (command, channel, DacCode(data)) = match self {
            Self::Nothing => (0b0000, 0, DacCode(0)),
            Self::Write(channel, code) => (0b0001, channel.0, code),
            Self::WriteAndUpdate(channel, code) => (0b0011, channel.0, code),
            // The key that a reset requires.
            Self::Reset => (0b0110, 0, DacCode(0x1234)),
            Self::InternalReference => (0b0111, 0, DacCode(0)),
            Self::ReadBack(channel) => (0b1001, channel.0, DacCode(0)),
        };
        (command << 4 | channel as u32) << 16 | data as u32
    }

    /// The bytes of the frame.
    pub const fn encode(self) -> [u8; FRAME] {
        let [_, a, b, c] = self.word().to_be_bytes();
        [a, b, c]
    }
}

/// Decodes the code in the frame after [`DacCommand::ReadBack`].
pub fn decode(frame: &[u8; FRAME]) -> DacCode {
    let [_, high, low] = *frame;
    DacCode(u16::from_be_bytes([high, low]))
}

/// Why the converter does not work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DacError {
    /// The bus failed.
    Bus,
    /// A channel reads back another code than was written.
    ReadBack,
}

/// The converter on its bus. A timer drives LDAC.
#[derive(Debug)]
pub struct Ad5676r<S> {
    device: S,
    /// Codes of the last frames, and of those before them.
    written: [[DacCode; LEGS]; 2],
    /// The channel to read back next.
    next: DacChannel,
}

impl<S: SpiDevice> Ad5676r<S> {
    /// A driver on `device`, which must frame each transfer with SYNC and use SPI mode 1 or 2:
    /// at up to [`CLOCK`] where it only writes, or [`READ_CLOCK`] where it reads too.
    pub const fn new(device: S) -> Self {
        Self {
            device,
            written: [[DacCode(0); LEGS]; 2],
            next: DacChannel(0),
        }
    }

    /// Resets the converter, sets the six outputs to `safe` without waiting for LDAC, and reads
    /// every code back.
    ///
    /// # Errors
    /// If the bus fails, or a channel reads back another code: the wiring is wrong.
    pub fn start(&mut self, safe: [DacCode; LEGS]) -> Result<(), DacError> {
        self.send(DacCommand::Reset)?;
        self.send(DacCommand::InternalReference)?;
        for (channel, code) in DacChannel::ALL.into_iter().zip(safe) {
            self.send(DacCommand::WriteAndUpdate(channel, code))?;
        }
        self.written = [safe; 2];
        for _ in DacChannel::ALL {
            self.read_back()?;
        }
        Ok(())
    }

    /// The frames, as [`DacCommand::word`], that write the codes which the outputs take at the
    /// next LDAC, each with SYNC of its own. The bus sends them.
    pub fn frames(&mut self, codes: [DacCode; LEGS]) -> [u32; LEGS] {
        let [last, _] = self.written;
        self.written = [codes, last];
        let mut frames = [0; LEGS];
        for ((frame, channel), code) in frames.iter_mut().zip(DacChannel::ALL).zip(codes) {
            *frame = DacCommand::Write(channel, code).word();
        }
        frames
    }

    /// Reads the code of one output back, of each call's the next one, so that a broken wire is
    /// noticed while the loop runs. It must be the code of the last frames, or of those before
    /// if LDAC has not come yet.
    ///
    /// # Errors
    /// If the bus fails, or the output has another code.
    pub fn read_back(&mut self) -> Result<(), DacError> {
        let DacChannel(channel) = self.next;
        self.next = DacChannel((channel + 1) % LEGS as u8);
        self.send(DacCommand::ReadBack(DacChannel(channel)))?;
        let mut frame = DacCommand::Nothing.encode();
        self.device
            .transfer_in_place(&mut frame)
            .map_err(|_| DacError::Bus)?;
        let found = decode(&frame);
        let mut written = self.written.iter();
        if written.any(|codes| codes.get(usize::from(channel)) == Some(&found)) {
            Ok(())
        } else {
            Err(DacError::ReadBack)
        }
    }

    /// The bus.
    pub const fn device(&mut self) -> &mut S {
        &mut self.device
    }

    fn send(&mut self, command: DacCommand) -> Result<(), DacError> {
        self.device
            .write(&command.encode())
            .map_err(|_| DacError::Bus)
    }
}
