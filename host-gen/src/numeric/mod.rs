//! Numerics that nalgebra and faer do not have.

pub(crate) mod discs;
pub mod eigen;
pub mod exposure;
pub mod frequencies;
pub(crate) mod loci;
pub(crate) mod motion;
pub mod pencil;
pub mod power_law;
pub(crate) mod products;
pub mod quadrature;
pub mod rows;
pub mod singular;
pub mod six;
pub(crate) mod unit_diagonal;
pub mod vector_fit;

/// Why a computation has no result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NumericError {
    /// An eigenvalue iteration did not converge.
    #[error(
        "an eigenvalue iteration did not converge because the machine's stiffnesses and masses differ by too many orders of magnitude; check their units"
    )]
    NotConverged,
    /// 1 + K·D is singular, with K the proportional gain and D the plant's direct feedthrough:
    /// the ideal loop, without sampling and delay, has no unique leg forces.
    #[error(
        "the ideal loop is ill-posed: 1 + K·D is singular, for example because a suspension mode has no stiffness; check the stiffness of the legs"
    )]
    IllPosed,
    /// The transfer function from leg forces to sensors is singular at every frequency.
    #[error(
        "the transfer function from leg forces to sensors is singular at every frequency: a combination of the legs moves no sensor; check where legs and sensors are"
    )]
    Singular,
}
