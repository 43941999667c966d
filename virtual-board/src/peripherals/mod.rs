//! The processor's peripherals, a file each. Registers have the names of RM0433 (rev. 8),
//! with its sections, or of the ARMv7-M Architecture Reference Manual (DDI 0403E) for those
//! of the core.
//!
//! A peripheral has what the image uses. Any other access is an error with the register's
//! name: nothing is read as zero or dropped because nobody thought of it.

pub mod dbgmcu;
pub mod dma;
pub mod dwt;
pub mod flash;
pub mod gpio;
pub mod iwdg;
pub mod mpu;
pub mod nvic;
pub mod pwr;
pub mod rcc;
pub mod scb;
pub mod spi;
pub mod syscfg;
pub mod tim1;
pub mod usart;

/// A register's offset from its peripheral's base, and its name.
pub type Register = (u32, &'static str);

/// Why an access cannot be carried out.
pub type Refusal = String;

/// The name of the register at an offset, or the offset.
pub fn name(registers: &[Register], offset: u32) -> String {
    match registers.iter().find(|(at, _)| *at == offset & !3) {
        Some((at, name)) if *at == offset => (*name).to_owned(),
        Some((at, name)) => format!("{name}[byte {}]", offset - at),
        None => format!("offset {offset:#05x}"),
    }
}

/// `value`, if it sets no bit outside `known`.
///
/// # Errors
/// If it sets others: what they do is not modelled.
pub fn only(value: u32, known: u32) -> Result<u32, Refusal> {
    let others = value & !known;
    if others == 0 {
        Ok(value)
    } else {
        Err(format!("bits {others:#010x} are not modelled"))
    }
}

/// The refusal of an access to a register that is not modelled.
pub fn unknown<T>() -> Result<T, Refusal> {
    Err("the register is not modelled".to_owned())
}
