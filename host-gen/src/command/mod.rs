//! Commands with a file of their own.

pub mod link;
pub mod report;
pub mod sil;
