//! Scenes: the image on the virtual board, with something that goes wrong, and what must
//! come of it: outputs at their safe codes within a bound, and the cause read back.
//!
//! `cargo xtask virtual --scenes` runs them: the image's path is in `VIRTUAL_IMAGE`. Those
//! that take minutes run only with `VIRTUAL_LONG=1`, and say so otherwise.

mod converters;
mod lab;
mod line;
mod model;
mod processor;
mod starts;
mod storage;
mod timing;
