//! What happens in time: the machine with its converters, runs of the loop, whole
//! sessions, a board in software, faults in it, and loads on the machine.

mod band_noise;
mod base_motion;
mod blocks;
pub mod compliance;
pub mod faults;
mod floor_tilt;
mod piezo;
pub mod profile;
pub mod push;
pub mod rig;
pub mod run;
pub mod session;
mod shaped_noise;
pub mod software_board;

pub use rig::{OtherBoard, Rig, is_on_board_of};
pub use software_board::SoftwareBoard;
