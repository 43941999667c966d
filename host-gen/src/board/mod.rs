//! What the real board does: the client of its link, responses measured in place, and records in
//! physical units.

pub mod link;
pub mod measure;
pub mod units;
pub mod words;
