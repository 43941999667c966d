//! What the host and the firmware must agree on, to the bit: the converter
//! codes, the controller table and the controller step.
//!
//! ```text
//! AdcCode ─ calibration ─ AC coupling ─ roll-off ─ PI (6×6) ─ clamp ─ DacCode
//!                                                    ▲
//!                                           injection, N
//! ```
//!
//! # Signs
//!
//! * A leg force σ is positive when it pushes the frame away from its foot, so
//!   that σ does positive work on the elongation `e1` and B_0 = I (Eq. 13).
//! * A force sensor reads the whole leg force in the same direction: the
//!   actuator's force less what the elongated leg pulls back, σ − (EA/L)·e1
//!   (Eq. 11).
//! * An accelerometer reads the absolute acceleration along its direction.
//! * The controller subtracts: σ = −(K_a·y + K_v·∫y) (Eqs. 14, 21, 22).
//!
//! Equation numbers are those of J. van Dijk, "Mechatronic Design of
//! Hard-Mount Concepts for Precision Equipment".
//!
//! # Numbers
//!
//! Everything is `f32`, multiply then add, in one written order. Rust never
//! contracts that into a fused multiply-add, and the `VMLA` that a Cortex-M
//! uses for it rounds twice as well, so a host and a board give the same bits.
#![no_std]
#![forbid(unsafe_code)]

pub mod codes;
pub mod controller;
pub mod injection;
pub mod link;
pub mod recorder;
pub mod self_test;
pub mod step;
pub mod supervisor;
pub mod table;
mod watch;

/// CRC-32 (ISO-HDLC), of frames and of tables.
const CRC_32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// Legs, and with them sensors and actuators of the controller.
pub const LEGS: usize = 6;
