//! What host and firmware must agree on to the bit: converter codes, controller table,
//! controller step, supervisor and link.
//!
//! ```text
//! AdcCode ─ calibration ─ AC coupling ─ roll-off ─ PI (6×6) ─ clamp ─ DacCode
//!                                                    ▲
//!                                           injection, N
//! ```
//!
//! # Rooms
//!
//! Each module imports only from modules above it in this table:
//!
//! | module | what is in it |
//! |---|---|
//! | [`codes`] | converter codes, and their conversion to and from V, m/s² and N |
//! | [`recorder`] | a ring buffer of samples at full rate |
//! | [`table`] | every number that configures a board, its validation and its encoding |
//! | [`step`] | the controller step, from ADC codes to DAC codes |
//! | [`multisine`] | sums of sines, and the part of every channel at each of them |
//! | [`injection`] | test signals added to the leg forces |
//! | [`supervisor`] | modes, the events that change them, faults |
//! | `monitors` | faults of sensors, outputs and the board, found in every sample |
//! | [`self_test`] | self-test and pilot: the answers of the sensors to each leg |
//! | [`levels`] | rms and peak of every sensor and leg, in dB of full scale |
//! | [`controller`] | all of these together, as a board or the simulation runs them |
//! | [`link`] | requests to a controller, and its replies, as frames |
//!
//! # Signs
//!
//! * A leg force σ is positive when it pushes the frame away from its foot. So a positive σ
//!   does positive work on a growing elongation `e1`, and B_0 = I, Eq. (13).
//! * A force sensor reads the whole leg force in the same direction: the actuator's force
//!   minus the force with which the elongated leg pulls back, σ − (EA/L)·e1, Eq. (11).
//! * An accelerometer reads the absolute acceleration along its direction.
//! * The controller subtracts: σ = −(K_a·y + K_v·∫y), Eq. (14), Eq. (21), Eq. (22).
//!
//! Equation numbers are those of J. van Dijk, "Mechatronic Design of
//! Hard-Mount Concepts for Precision Equipment".
//!
//! # Numbers
//!
//! Everything is `f32`: a multiplication, then an addition, always in the written order.
//! Rust never contracts the two into a fused multiply-add, and the `VMLA` instruction that a
//! Cortex-M uses for them also rounds twice. So a host and a board compute the same bits.
#![no_std]
#![forbid(unsafe_code)]

// In the order of the table above; `tests/rooms.rs` checks it.
pub mod codes;
pub mod recorder;
pub mod table;
pub mod step;
pub mod multisine;
pub mod injection;
pub mod supervisor;
mod monitors;
pub mod self_test;
pub mod levels;
pub mod controller;
pub mod link;

/// CRC-32 (ISO-HDLC), used for frames and tables.
const CRC_32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// Number of legs. It is also the number of sensors and of actuators in the loop.
pub const LEGS: usize = 6;
