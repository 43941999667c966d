//! Controller tables, made by `host-gen generate` and never by hand.

pub mod metrology_frame;
