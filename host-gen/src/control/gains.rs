//! The ideal gains of section 4 of the paper, and the coordinates in which they
//! are diagonal.

use nalgebra::Matrix6;

use crate::machine::{Feedback, Target};
use crate::model::design_model::{DesignModel, RigidModel};

/// A proportional-integral law, σ = −(P·y + I·∫y), rows actuators, columns
/// sensors: Eqs. (14), (21), (22).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// K_a, N/(m/s²), or K_P.
    pub proportional: Matrix6<f64>,
    /// K_v, N/(m/s), or K_I, 1/s.
    pub integral: Matrix6<f64>,
}

impl Gains {
    /// The gains that put all six modes of the design model at ω_n with
    /// damping ζ_n.
    ///
    /// Accelerations, Eqs. (19) and (20): K'_a = K_d/ω_n² − M_d,
    /// K'_v = 2ζ_n·ω_n·(K'_a + M_d), both times T_c⁻¹.
    ///
    /// Forces, Eq. (22): K_P = K_d·(ω_n²·M_d)⁻¹ − 1, K_I = 2ζ_n·ω_n·(1 + K_P).
    /// The paper prints the product the other way round. With y = σ − K_d·q
    /// the loop gives M_d·q̈ = −(1 + K_P)⁻¹·K_d·q, which is −ω_n²·M_d·q only in
    /// this order; the two agree where K_d and M_d commute, as they do for six
    /// equal legs without bending stiffness.
    ///
    /// Of both kinds, the accelerations'.
    pub fn new(model: &DesignModel, target: &Target) -> Self {
        let omega = target.omega();
        let RigidModel {
            mass, stiffness, ..
        } = &model.rigid;
        let (proportional, integral) = match model.feedback {
            Feedback::Acceleration | Feedback::Both => {
                let virtual_mass = stiffness / (omega * omega) - mass;
                let damping = (virtual_mass + mass) * (2.0 * target.damping * omega);
                (virtual_mass, damping)
            }
            Feedback::Force => {
                let inverse = (mass * (omega * omega))
                    .try_inverse()
                    .expect("the lumped mass is positive definite because every body's is");
                let whole = stiffness * inverse;
                (
                    whole - Matrix6::identity(),
                    whole * (2.0 * target.damping * omega),
                )
            }
        };
        let unsense = model
            .sensing
            .try_inverse()
            .expect("the sensors were checked to be independent");
        Self {
            proportional: proportional * unsense,
            integral: integral * unsense,
        }
    }
}

/// Sensors to modes and modes to legs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModalTransform {
    /// T_in. Accelerations: S⁻¹·T_c⁻¹, to √kg·m/s². Forces: Sᵀ in the sensors'
    /// order, to N/√kg.
    pub input: Matrix6<f64>,
    /// Sᵀ for the force sensors beside accelerometers.
    pub beside: Option<Matrix6<f64>>,
    /// T_out = S⁻ᵀ, from N/√kg to N.
    pub output: Matrix6<f64>,
}

impl ModalTransform {
    /// The coordinates in which the gains of [`Gains::new`] are diagonal:
    /// with K'_a = S⁻ᵀ·(Ω²/ω_n² − 1)·S⁻¹ and K_P = S⁻ᵀ·(Ω²/ω_n² − 1)·Sᵀ, both
    /// kinds have ω_k²/ω_n² − 1 and 2ζ_n·ω_k²/ω_n there.
    pub fn new(model: &DesignModel) -> Self {
        let inverse = model.modal.try_inverse().expect("modes are independent");
        let unsense = model
            .sensing
            .try_inverse()
            .expect("the sensors were checked to be independent");
        let to_modes = match model.feedback {
            Feedback::Acceleration | Feedback::Both => inverse,
            Feedback::Force => model.modal.transpose(),
        };
        // What symmetry makes zero is zero, and the same on every processor.
        let clean = |m: Matrix6<f64>| {
            let smallest = 1e-12 * m.amax();
            m.map(|x| if x.abs() < smallest { 0.0 } else { x })
        };
        Self {
            input: clean(to_modes * unsense),
            // An order of channels has its transpose for its inverse.
            beside: model
                .beside
                .map(|order| clean(model.modal.transpose() * order.transpose())),
            output: clean(inverse.transpose()),
        }
    }
}
