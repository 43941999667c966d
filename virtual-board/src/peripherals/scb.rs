//! System control block (ARMv7-M ARM, B3.2) and the FPU's registers in it (B3.2.20, 22).

use super::nvic::{BUS_FAULT, MEM_MANAGE, Nvic, USAGE_FAULT};
use super::{Refusal, Register, only, unknown};

/// Registers, as offsets from 0xE000E000.
pub const REGISTERS: [Register; 24] = [
    (0x010, "SYST_CSR"),
    (0x014, "SYST_RVR"),
    (0x018, "SYST_CVR"),
    (0xD00, "CPUID"),
    (0xD04, "ICSR"),
    (0xD08, "VTOR"),
    (0xD0C, "AIRCR"),
    (0xD10, "SCR"),
    (0xD14, "CCR"),
    (0xD18, "SHPR1"),
    (0xD1C, "SHPR2"),
    (0xD20, "SHPR3"),
    (0xD24, "SHCSR"),
    (0xD28, "CFSR"),
    (0xD2C, "HFSR"),
    (0xD34, "MMFAR"),
    (0xD38, "BFAR"),
    (0xD84, "CSSELR"),
    (0xD88, "CPACR"),
    (0xF34, "FPCCR"),
    (0xF38, "FPCAR"),
    (0xF50, "ICIALLU"),
    (0xF5C, "DCIMVAC"),
    (0xF70, "DCCIMVAC"),
];

/// CFSR: instruction access violation of the MPU.
pub const IACCVIOL: u32 = 1;
/// CFSR: data access violation of the MPU.
pub const DACCVIOL: u32 = 1 << 1;
/// CFSR: MPU fault while stacking.
pub const MSTKERR: u32 = 1 << 4;
/// CFSR: MMFAR is valid.
pub const MMARVALID: u32 = 1 << 7;
/// CFSR: bus fault of an instruction fetch.
pub const IBUSERR: u32 = 1 << 8;
/// CFSR: precise bus fault of data.
pub const PRECISERR: u32 = 1 << 9;
/// CFSR: bus fault while unstacking.
pub const UNSTKERR: u32 = 1 << 11;
/// CFSR: bus fault while stacking.
pub const STKERR: u32 = 1 << 12;
/// CFSR: BFAR is valid.
pub const BFARVALID: u32 = 1 << 15;
/// CFSR: undefined instruction.
pub const UNDEFINSTR: u32 = 1 << 16;
/// CFSR: not in Thumb state.
pub const INVSTATE: u32 = 1 << 17;
/// CFSR: invalid return from an exception.
pub const INVPC: u32 = 1 << 18;
/// HFSR: escalated from another fault.
pub const FORCED: u32 = 1 << 30;
/// HFSR: a vector could not be read.
pub const VECTTBL: u32 = 1 << 1;

/// Where an H743 with its option bytes as delivered starts (RM0433 2.6, BOOT_ADD0).
pub const BOOT: u32 = 0x0800_0000;

/// The registers.
pub struct Scb {
    /// The vector table.
    pub vtor: u32,
    /// CCR.
    pub ccr: u32,
    /// CPACR.
    pub cpacr: u32,
    /// CFSR.
    pub cfsr: u32,
    /// HFSR.
    pub hfsr: u32,
    /// MMFAR.
    pub mmfar: u32,
    /// BFAR.
    pub bfar: u32,
    /// SYSRESETREQ was written.
    pub reset_requested: bool,
    fpccr: u32,
}

impl Default for Scb {
    fn default() -> Self {
        Self {
            vtor: BOOT,
            // STKALIGN, and the branch prediction that a Cortex-M7 cannot turn off.
            ccr: 1 << 9 | 1 << 18,
            cpacr: 0,
            cfsr: 0,
            hfsr: 0,
            mmfar: 0,
            bfar: 0,
            reset_requested: false,
            // ASPEN, LSPEN.
            fpccr: 3 << 30,
        }
    }
}

impl Scb {
    /// CCR.BFHFNMIGN: data bus faults are ignored at priority -1 and above.
    pub fn ignores_bus_faults(&self) -> bool {
        self.ccr >> 8 & 1 != 0
    }

    /// CCR.STKALIGN.
    pub fn aligns_stack(&self) -> bool {
        self.ccr >> 9 & 1 != 0
    }

    /// Reads a register.
    ///
    /// # Errors
    /// If it is not modelled.
    pub fn read(&self, offset: u32, size: usize, nvic: &Nvic) -> Result<u32, Refusal> {
        match (offset, size) {
            // Cortex-M7 r1p1.
            (0xD00, 4) => Ok(0x411F_C271),
            (0xD04, 4) => Ok(nvic.icsr()),
            (0xD08, 4) => Ok(self.vtor),
            (0xD0C, 4) => Ok(0xFA05_0000 | u32::from(nvic.prigroup) << 8),
            (0xD10, 4) => Ok(0),
            (0xD14, 4) => Ok(self.ccr),
            (0xD18..0xD24, 1) => Ok(u32::from(
                nvic.priority_register((offset - 0xD18 + 4) as u16),
            )),
            (0xD24, 4) => Ok([MEM_MANAGE, BUS_FAULT, USAGE_FAULT]
                .iter()
                .zip(16..)
                .fold(0, |word, (n, bit)| {
                    word | u32::from(nvic.is_enabled(*n)) << bit
                })),
            (0xD28, 4) => Ok(self.cfsr),
            (0xD2C, 4) => Ok(self.hfsr),
            (0xD34, 4) => Ok(self.mmfar),
            (0xD38, 4) => Ok(self.bfar),
            (0xD88, 4) => Ok(self.cpacr),
            (0xF34, 4) => Ok(self.fpccr),
            _ => unknown(),
        }
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If it, or a bit that is set, is not modelled.
    pub fn write(
        &mut self,
        offset: u32,
        size: usize,
        value: u32,
        nvic: &mut Nvic,
    ) -> Result<(), Refusal> {
        match (offset, size) {
            (0xD04, 4) => nvic.set_icsr(value)?,
            (0xD08, 4) => self.vtor = value & !0x7F,
            // Without the key nothing happens.
            (0xD0C, 4) if value >> 16 != 0x05FA => {}
            (0xD0C, 4) => {
                only(value & 0xFFFF, 0x0704)?;
                nvic.prigroup = (value >> 8 & 7) as u8;
                self.reset_requested |= value & 4 != 0;
            }
            // BFHFNMIGN, STKALIGN, the instruction cache (which changes no result here:
            // nothing writes code behind its back), branch prediction.
            (0xD14, 4) => self.ccr = only(value, 1 << 8 | 1 << 9 | 1 << 17 | 1 << 18)?,
            (0xD18..0xD24, 1) => nvic.set_priority((offset - 0xD18 + 4) as u16, value as u8),
            (0xD24, 4) => {
                only(value, 7 << 16)?;
                for (n, bit) in [MEM_MANAGE, BUS_FAULT, USAGE_FAULT].iter().zip(16..) {
                    nvic.enable(*n, value >> bit & 1 != 0);
                }
            }
            // Bits are cleared by writing 1.
            (0xD28, 4) => self.cfsr &= !value,
            (0xD2C, 4) => self.hfsr &= !value,
            (0xD88, 4) => self.cpacr = only(value, 0xF << 20)?,
            // The frames are stacked at once, whether LSPEN is set or not: only an
            // interrupt's latency can tell.
            (0xF34, 4) => self.fpccr = only(value, 3 << 30)?,
            (0xF50, 4) => {}
            _ => return unknown(),
        }
        Ok(())
    }
}
