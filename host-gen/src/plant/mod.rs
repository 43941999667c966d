//! What the sensors measure of leg forces and floor: the generalised plant as matrices, as
//! partial fractions, as frequency responses, and as the board samples it.

pub mod export;
mod filter;
pub mod generalised;
mod lags;
pub(crate) mod noise;
pub mod partial_fractions;
pub mod response;
pub mod sampled;
pub mod state_space;
pub(crate) mod tilt;
pub mod zeros;

pub use generalised::Plant;
pub use response::{Control, Gain, Response};
pub use sampled::SampledPlant;
pub use state_space::{DiscreteStateSpace, StateSpace};
