//! Commands that talk to a board.

pub mod link;
pub mod sil;
