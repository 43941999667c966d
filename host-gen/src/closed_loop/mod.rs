//! How plant and law behave together: the ideal and the sampled loop, with poles, sensitivity,
//! isolation and margins.

pub mod bands;
pub mod bode;
pub mod budget;
pub mod ideal;
pub mod isolation;
pub mod margins;
pub mod poles;
pub mod sampled;
pub mod sensitivity;

pub use ideal::{close_ideal, ideal_poles, ideal_response};
pub use poles::{Pole, stable};
pub use sampled::SampledLoop;
pub use sensitivity::{LoopGrid, PeakSensitivity, RollOffUse};

/// Lowest frequency of the loop's frequency grids over the target frequency: far below AC coupling
/// and leak.
pub const SLOWEST: f64 = 1e-3;
