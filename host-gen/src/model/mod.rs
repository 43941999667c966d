//! How the machine moves: from bodies and beams to M, D, K, M_r, B_0, modes,
//! static loads, and the six-leg design model.

pub(crate) mod beam;
pub mod design_model;
pub mod energy;
pub mod gravity;
pub mod independence;
pub mod multibody;
pub mod template;
