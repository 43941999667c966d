//! Numerics that nalgebra and faer do not have.

pub mod eigen;
pub mod frequencies;
pub mod rows;
pub mod singular;
pub mod six;

/// A computation that has no result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NumericError {
    /// An eigenvalue iteration did not converge.
    #[error(
        "an eigenvalue iteration did not converge; the machine's stiffnesses and masses differ by too many orders of magnitude"
    )]
    NotConverged,
    /// 1 + K·D is singular, so the unsampled loop determines no forces.
    #[error(
        "the unsampled loop is ill-posed: 1 + K·D is singular, as where a suspension mode has no stiffness"
    )]
    IllPosed,
}
