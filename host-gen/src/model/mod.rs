//! How the machine moves: M, D, K, M_r and B_0 from bodies and beams, the modes, the static
//! loads, and the rigid design model on six legs.

pub(crate) mod beam;
pub mod design_model;
pub mod energy;
mod flexible;
pub mod gravity;
pub mod independence;
mod inertia;
pub(crate) mod layout;
pub mod multibody;
mod spring;
pub mod structure;
pub mod template;
