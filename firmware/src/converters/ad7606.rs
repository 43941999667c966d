//! AD7606, eight channels sampled at one instant, 16 bits, ±10 V, in serial mode.
//!
//! Pins set by hardware: PAR/SER high (serial), RANGE high (±10 V), OS0 to OS2 low
//! (no oversampling), STBY high. A rising edge on CONVST A and B, tied together,
//! samples all channels; BUSY is high until the results can be read. The data sheet
//! (rev. C) gives 3.45 to 4.15 µs for that.
//!
//! Serial: SCLK idles high, data is valid on its falling edges (SPI mode 2), channel
//! V1 first, each from its highest bit down, two's complement. All comes out of DOUTA
//! when it is clocked long enough; six channels take 96 clocks.

use embedded_hal::digital::InputPin;
use embedded_hal::spi::SpiDevice;
use shared::LEGS;
use shared::codes::AdcCode;

/// Size of the frame of six channels, bytes.
pub const FRAME: usize = 2 * LEGS;

/// Longest conversion time, s (data sheet, t_CONV without oversampling).
pub const CONVERSION: f64 = 4.15e-6;

/// Highest clock frequency with VDRIVE at 3.3 V ± 10 %, Hz (data sheet, f_SCLK above 2.7 V).
pub const CLOCK: u32 = 14_500_000;

/// Why a sample could not be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdcError {
    /// BUSY is still high: the conversion has not ended.
    Busy,
    /// The bus failed.
    Bus,
}

/// Decodes the codes of V1 to V6 from the bytes read from DOUTA.
pub fn decode(frame: &[u8; FRAME]) -> [AdcCode; LEGS] {
    let mut codes = [AdcCode(0); LEGS];
    let (pairs, _) = frame.as_chunks();
    for (code, pair) in codes.iter_mut().zip(pairs) {
        *code = AdcCode(i16::from_be_bytes(*pair));
    }
    codes
}

/// The converter on its bus.
#[derive(Debug)]
pub struct Ad7606<S, B> {
    device: S,
    busy: B,
}

impl<S: SpiDevice, B: InputPin> Ad7606<S, B> {
    /// A driver on `device`, which must frame each transfer with CS and use SPI mode 2 at up to
    /// [`CLOCK`]. `busy` is the BUSY pin.
    pub const fn new(device: S, busy: B) -> Self {
        Self { device, busy }
    }

    /// Reads the codes of V1 to V6 from the last conversion.
    ///
    /// # Errors
    /// If BUSY is high or the bus fails.
    pub fn read(&mut self) -> Result<[AdcCode; LEGS], AdcError> {
        if self.busy.is_high().map_err(|_| AdcError::Bus)? {
            return Err(AdcError::Busy);
        }
        let mut frame = [0; FRAME];
        self.device.read(&mut frame).map_err(|_| AdcError::Bus)?;
        Ok(decode(&frame))
    }
}
