//! AD5676R, eight outputs, 16 bits (data sheet rev. D): command and channel tables 8 to 10,
//! the straps those of `docs/board.md` (GAIN high: 0 to 5 V; RSTSEL high: mid-range).

use crate::time::{MICROSECOND, Ticks};
use crate::wires::History;

/// The number of outputs.
pub const CHANNELS: usize = 8;

/// The code in the middle of the range, which RSTSEL high gives at power-up and reset.
pub const MIDDLE: u16 = 0x8000;

/// Output voltage of full scale: the reference of 2.5 V times the gain of two.
pub const FULL_SCALE: f64 = 5.0;

/// What is wrong with the chip or its wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Defect {
    /// SDI is cut: the chip sees zeros.
    SdiCut,
    /// SDO is cut: the processor reads zeros or ones.
    SdoCut(bool),
    /// SCLK is cut.
    SclkCut,
}

/// The chip.
pub struct Ad5676r {
    /// What is wrong with it.
    pub defect: Option<Defect>,
    /// Complete frames it took since power-up.
    pub frames: u64,
    /// Falling edges of LDAC, not in reset, since power-up.
    pub latches: u64,
    /// Input registers were written since the last LDAC.
    pending: bool,
    inputs: [u16; CHANNELS],
    outputs: [u16; CHANNELS],
    history: [History<u16>; CHANNELS],
    recording: bool,
    selected: bool,
    /// When SYNC rose last.
    rose: Option<Ticks>,
    ldac_low: bool,
    reset: bool,
    shift: u32,
    bits: u32,
    /// What SDO gives in the next frame.
    answer: u32,
    /// The frame on SDO now.
    sending: u32,
}

impl Default for Ad5676r {
    fn default() -> Self {
        Self {
            defect: None,
            frames: 0,
            latches: 0,
            pending: false,
            inputs: [MIDDLE; CHANNELS],
            outputs: [MIDDLE; CHANNELS],
            history: Default::default(),
            recording: false,
            selected: false,
            rose: None,
            ldac_low: false,
            reset: true,
            shift: 0,
            bits: 0,
            answer: 0,
            sending: 0,
        }
    }
}

/// Shortest time for which SYNC is high between two frames: that of the AD5686R's slower timing
/// (t8), since the AD5676R's was not at hand.
const SYNC_HIGH: Ticks = 30 * MICROSECOND / 1000;

/// What the chip does not know, or the model does not have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Misuse {
    /// A frame.
    Frame(u32),
    /// SYNC was high for less than it may be.
    Sync,
}

impl std::fmt::Display for Misuse {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Frame(frame) => write!(f, "frame {frame:#08x} is not modelled"),
            Self::Sync => write!(f, "SYNC is not high long enough"),
        }
    }
}

impl Ad5676r {
    /// Codes on the outputs.
    pub fn outputs(&self) -> [u16; CHANNELS] {
        self.outputs
    }

    /// Codes in the input registers, which the next LDAC puts out.
    pub fn inputs(&self) -> [u16; CHANNELS] {
        self.inputs
    }

    /// The codes of the last sample: on the outputs, or on their way there if the latch is
    /// yet to come.
    pub fn latest(&self) -> [u16; CHANNELS] {
        if self.pending {
            self.inputs
        } else {
            self.outputs
        }
    }

    /// Voltage of a code.
    pub fn volts(code: u16) -> f64 {
        f64::from(code) / 65_536.0 * FULL_SCALE
    }

    /// Records the outputs from now on.
    pub fn record(&mut self, now: Ticks) {
        self.recording = true;
        self.note(now);
    }

    /// Every change of an output since [`Ad5676r::record`].
    pub fn history(&self, channel: usize) -> &History<u16> {
        &self.history[channel]
    }

    /// Forgets the changes before now.
    pub fn forget(&mut self) {
        self.history.iter_mut().for_each(History::forget);
    }

    fn note(&mut self, now: Ticks) {
        if self.recording {
            for (history, code) in self.history.iter_mut().zip(self.outputs) {
                history.note(now, code);
            }
        }
    }

    fn put_out(&mut self, now: Ticks) {
        self.pending = false;
        self.outputs = self.inputs;
        self.note(now);
    }

    fn clear(&mut self, now: Ticks) {
        self.inputs = [MIDDLE; CHANNELS];
        self.answer = 0;
        self.put_out(now);
    }

    /// Power comes on: as a reset, whatever was before.
    pub fn power_up(&mut self, now: Ticks) {
        self.clear(now);
        (self.selected, self.ldac_low, self.reset) = (false, false, true);
        self.rose = None;
        (self.shift, self.bits, self.sending) = (0, 0, 0);
    }

    /// RESET: while low, all outputs are in the middle, and LDAC and frames are ignored.
    pub fn reset(&mut self, low: bool, now: Ticks) {
        if low && !self.reset {
            self.clear(now);
        }
        self.reset = low;
    }

    /// LDAC: a falling edge puts all input registers out; while it is low, every write goes
    /// to the output at once. Whether it was such an edge, and not in reset.
    pub fn ldac(&mut self, low: bool, now: Ticks) -> bool {
        let latches = low && !self.ldac_low && !self.reset;
        self.ldac_low = low;
        if latches {
            self.latches += 1;
            self.put_out(now);
        }
        latches
    }

    /// SYNC: low frames 24 bits; a rising edge after fewer is no frame.
    ///
    /// # Errors
    /// If the frame that ends is one that the model does not have, or the pause was too short.
    pub fn sync(&mut self, low: bool, now: Ticks) -> Result<(), Misuse> {
        if low == self.selected {
            return Ok(());
        }
        self.selected = low;
        if low {
            (self.shift, self.bits) = (0, 0);
            self.sending = std::mem::take(&mut self.answer);
            let long = self.rose.is_none_or(|rose| now >= rose + SYNC_HIGH);
            return if long { Ok(()) } else { Err(Misuse::Sync) };
        }
        self.rose = Some(now);
        if self.bits < 24 || self.reset {
            return Ok(());
        }
        self.frames += 1;
        self.carry_out(self.shift & 0x00FF_FFFF, now)
    }

    /// Whether SYNC is low.
    pub fn is_selected(&self) -> bool {
        self.selected
    }

    /// One cycle of SCLK: takes SDI at its falling edge, and returns what SDO holds.
    pub fn clock(&mut self, sdi: bool) -> bool {
        let sdo = match self.defect {
            Some(Defect::SdoCut(level)) => level,
            _ => self.sending >> 23 & 1 != 0,
        };
        if self.defect == Some(Defect::SclkCut) {
            return sdo;
        }
        self.sending <<= 1;
        let sdi = sdi && self.defect != Some(Defect::SdiCut);
        self.shift = self.shift << 1 | u32::from(sdi);
        self.bits += 1;
        sdo
    }

    fn carry_out(&mut self, frame: u32, now: Ticks) -> Result<(), Misuse> {
        let (command, channel, code) = (frame >> 20, frame >> 16 & 0xF, frame as u16);
        let index = channel as usize;
        match command {
            0b0000 => {}
            0b0001 if index < CHANNELS => {
                self.inputs[index] = code;
                self.pending = true;
                if self.ldac_low {
                    self.put_out(now);
                }
            }
            0b0011 if index < CHANNELS => {
                self.inputs[index] = code;
                self.outputs[index] = code;
                self.note(now);
            }
            // With the key that the data sheet wants.
            0b0110 if code == 0x1234 => self.clear(now),
            // The internal reference on; its gain is a pin's.
            0b0111 if code & 0b101 == 0 => {}
            0b1001 if index < CHANNELS => {
                self.answer = frame & 0x00FF_0000 | u32::from(self.inputs[index]);
            }
            _ => return Err(Misuse::Frame(frame)),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn send(chip: &mut Ad5676r, frame: u32, now: Ticks) -> Result<u32, Misuse> {
        // However long ago the last was.
        chip.rose = None;
        chip.sync(true, now)?;
        let read = (0..24).rev().fold(0, |read, bit| {
            read << 1 | u32::from(chip.clock(frame >> bit & 1 != 0))
        });
        chip.sync(false, now)?;
        Ok(read)
    }

    fn ready() -> Ad5676r {
        let mut chip = Ad5676r::default();
        chip.ldac(false, 0);
        chip.reset(false, 0);
        chip.record(0);
        chip
    }

    #[test]
    fn ldac_puts_all_out_at_once() -> Result<(), Misuse> {
        let mut chip = ready();
        send(&mut chip, 0x10_1111, 1)?;
        send(&mut chip, 0x15_5555, 2)?;
        assert_eq!(chip.outputs(), [MIDDLE; 8]);
        chip.ldac(true, 3);
        assert_eq!(chip.history(0).changes(), [(0, MIDDLE), (3, 0x1111)]);
        assert_eq!(chip.history(5).changes(), [(0, MIDDLE), (3, 0x5555)]);
        // LDAC still low: at once.
        send(&mut chip, 0x12_2222, 4)?;
        assert_eq!(chip.outputs()[2], 0x2222);
        Ok(())
    }

    #[test]
    fn a_code_reads_back_in_the_next_frame() -> Result<(), Misuse> {
        let mut chip = ready();
        send(&mut chip, 0x33_ABCD, 0)?;
        assert_eq!(chip.outputs()[3], 0xABCD);
        assert_eq!(send(&mut chip, 0x93_0000, 0)?, 0);
        assert_eq!(send(&mut chip, 0, 0)? & 0xFFFF, 0xABCD);
        assert_eq!(send(&mut chip, 0, 0)?, 0);
        chip.defect = Some(Defect::SdoCut(true));
        send(&mut chip, 0x93_0000, 0)?;
        assert_eq!(send(&mut chip, 0, 0)?, 0xFF_FFFF);
        Ok(())
    }

    #[test]
    fn reset_low_is_the_middle_and_deaf() -> Result<(), Misuse> {
        let mut chip = ready();
        send(&mut chip, 0x33_ABCD, 1)?;
        chip.reset(true, 2);
        assert_eq!(chip.outputs(), [MIDDLE; 8]);
        send(&mut chip, 0x33_0000, 3)?;
        chip.ldac(true, 4);
        assert_eq!(chip.outputs(), [MIDDLE; 8]);
        assert_eq!(chip.latches, 0);
        Ok(())
    }

    /// t8.
    #[test]
    fn sync_is_high_for_long_enough() -> Result<(), Misuse> {
        for (pause, expected) in [(SYNC_HIGH - 1, Err(Misuse::Sync)), (SYNC_HIGH, Ok(()))] {
            let mut chip = ready();
            chip.sync(true, 0)?;
            chip.sync(false, 1000)?;
            assert_eq!(chip.sync(true, 1000 + pause), expected);
        }
        Ok(())
    }

    #[test]
    fn short_and_unknown_frames() -> Result<(), Misuse> {
        let mut chip = ready();
        chip.sync(true, 0)?;
        chip.clock(true);
        chip.sync(false, 0)?;
        assert_eq!(chip.frames, 0);
        assert_eq!(send(&mut chip, 0x40_0000, 0), Err(Misuse::Frame(0x40_0000)));
        Ok(())
    }
}
