//! Results as text with colours; the printer removes the colours where there is no
//! terminal.

mod aligned;
mod bound;
mod commission;
mod changes;
mod compare;
mod compliance;
mod controller;
mod faults;
mod floors;
mod gains;
mod identification;
mod loops;
mod modes;
mod plant_matrices;
mod poles;
mod robustness;
mod shapes;
mod sigma;
mod summary;
mod zeros;

pub use identification::change_cells;
