//! What the real board does: the client of its link, and responses measured in place.

pub mod link;
pub mod measure;
pub mod words;
