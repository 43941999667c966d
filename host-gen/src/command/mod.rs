//! Commands with a file of their own.

pub mod link;
pub mod new;
pub mod report;
pub mod sil;
pub mod snippet;
pub mod watch;
