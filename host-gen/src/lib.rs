//! From a machine's geometry to a controller table.
//!
//! Data flows one way. Each room imports only from those above it:
//!
//! | room | what it answers |
//! |---|---|
//! | [`progress`] | how does a long computation report that it advances? |
//! | [`files`] | how is a file written whole? |
//! | [`numeric`] | numerics that nalgebra and faer do not have |
//! | [`floor`] | how does the ground move? |
//! | [`machine`] | what does the file say? |
//! | [`model`] | how does the machine move? |
//! | [`plant`] | what do the sensors see of leg forces and floor? |
//! | [`control`] | what is a controller? |
//! | [`closed_loop`] | how do plant and controller behave together? |
//! | [`design`] | which controller is best? |
//! | [`analysis`] | what do machine and controller do? |
//! | [`simulate`] | what happens in time? |
//! | [`board`] | what does the real board do? |
//! | [`identify`] | which machine is it? |
//! | [`commission`] | may it move, and does it do what was designed? |
//! | [`report`] | how are results shown? |
//!
//! Equation numbers are those of J. van Dijk, "Mechatronic Design of
//! Hard-Mount Concepts for Precision Equipment". SI units; frequencies in Hz
//! where a name says so or a person reads them, else rad/s.
#![forbid(unsafe_code)]

/// The book's examples are tests.
#[cfg(doctest)]
#[doc = include_str!("../../docs/library.md")]
pub struct Library;
pub mod progress;
pub mod files;
pub mod numeric;
pub mod floor;
pub mod machine;
pub mod model;
pub mod plant;
pub mod control;
pub mod closed_loop;
pub mod design;
pub mod analysis;
pub mod simulate;
pub mod board;
pub mod identify;
pub mod commission;

pub mod report;
