//! Virtual time. One tick is a thousandth of a cycle of a 480 MHz core, so that cycles of
//! the core (1,000 ticks), of the timers (2,000) and of the low-speed oscillator
//! (15,000,000) are whole numbers of ticks.

/// A moment, or a span, of virtual time in ticks.
pub type Ticks = u64;

/// Ticks in a second.
pub const SECOND: Ticks = 480_000_000_000;

/// Ticks in a microsecond.
pub const MICROSECOND: Ticks = SECOND / 1_000_000;

/// Ticks in a millisecond.
pub const MILLISECOND: Ticks = SECOND / 1_000;

/// The span of `cycles` of a clock of `hertz`, rounded to the nearest tick.
pub fn cycles(cycles: u64, hertz: u64) -> Ticks {
    let hertz = hertz.max(1);
    let half = hertz / 2;
    // Usually that many bits are enough, and it is asked for often.
    match cycles
        .checked_mul(SECOND)
        .and_then(|exact| exact.checked_add(half))
    {
        Some(exact) => exact / hertz,
        None => {
            let exact = u128::from(cycles) * u128::from(SECOND) + u128::from(half);
            (exact / u128::from(hertz)) as Ticks
        }
    }
}

/// The number of whole cycles of a clock of `hertz` in `span`.
pub fn whole(span: Ticks, hertz: u64) -> u64 {
    match span.checked_mul(hertz) {
        Some(exact) => exact / SECOND,
        None => (u128::from(span) * u128::from(hertz) / u128::from(SECOND)) as u64,
    }
}

/// A span of so many seconds, rounded to the nearest tick.
pub fn seconds(seconds: f64) -> Ticks {
    // The cast saturates.
    (seconds * SECOND as f64).round() as Ticks
}

/// How many seconds a span has.
pub fn in_seconds(span: Ticks) -> f64 {
    span as f64 / SECOND as f64
}

/// What instructions and accesses cost. These are parameters, not measurements: a Cortex-M7
/// issues up to two instructions in a cycle and waits for buses and for the floating-point
/// unit, and nothing here knows when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Core cycles for an instruction.
    pub instruction: f64,
    /// Core cycles on top for every access to a peripheral's register.
    pub access: f64,
}

impl Cost {
    /// One cycle for an instruction, twenty for an access: over the bridges to a register at
    /// a quarter of the core's clock, ten to twenty are usual.
    pub const DEFAULT: Self = Self {
        instruction: 1.0,
        access: 20.0,
    };

    /// Core cycles from an exception's acceptance to its first instruction, with code and
    /// stack in tightly coupled memory (Cortex-M7 Technical Reference Manual: 12).
    pub const ENTRY: f64 = 12.0;

    /// Core cycles of a return from an exception.
    pub const RETURN: f64 = 10.0;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 480 MHz against each clock of the board.
    #[test]
    fn clocks_of_the_board() {
        assert_eq!(cycles(1, 480_000_000), 1_000);
        assert_eq!(cycles(1, 240_000_000), 2_000);
        assert_eq!(cycles(7, 64_000_000), 52_500);
        assert_eq!(cycles(1, 32_000), 15_000_000);
        // 8 cycles at 112 MHz are 71.43 ns.
        assert_eq!(cycles(8, 112_000_000), 34_286);
        assert_eq!(whole(SECOND - 1, 32_000), 31_999);
        assert_eq!(seconds(1e-6), MICROSECOND);
    }
}
