//! The ideal gains of section 4 of the paper, and the coordinates in which they are diagonal.

use nalgebra::Matrix6;

use crate::machine::{FeedbackKind, Target};
use crate::model::design_model::{DesignModel, Suspension};

/// A proportional-integral law σ = −(P·y + I·∫y), Eq. (14).
///
/// σ are the six leg forces, N, and y the six sensor values, m/s² or N. Rows are actuators and
/// columns sensors, in the order of the machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// P, 6×6: K_a of Eq. (19), N/(m/s²), for accelerometers; K_P of Eq. (22), without unit, for
    /// force sensors.
    pub proportional: Matrix6<f64>,
    /// I, 6×6: K_v of Eq. (20), N/(m/s), for accelerometers; K_I of Eq. (22), 1/s, for force
    /// sensors.
    pub integral: Matrix6<f64>,
}

impl Gains {
    /// The gains that give all six modes of the design model the frequency ω_n and the damping ζ_n
    /// of `target`.
    ///
    /// Accelerometers: K'_a = K_d/ω_n² − M_d and K_a = K'_a·T_c⁻¹, Eq. (19);
    /// K'_v = 2ζ_n·ω_n·(K'_a + M_d) and K_v = K'_v·T_c⁻¹, Eq. (20).
    ///
    /// Force sensors: K_P = K_d·(ω_n²·M_d)⁻¹ − 1 and K_I = 2ζ_n·ω_n·(1 + K_P), Eq. (22). The paper
    /// prints the product in the opposite order. With y = σ − K_d·q the closed loop is
    /// M_d·q̈ = −(1 + K_P)⁻¹·K_d·q, which is −ω_n²·M_d·q only in the order used here. Both orders
    /// agree if K_d and M_d commute, as for six equal legs without bending stiffness.
    ///
    /// With both kinds of sensors, the gains are those for accelerometers.
    pub fn new(model: &DesignModel, target: &Target) -> Self {
        let omega = target.omega();
        let Suspension {
            mass, stiffness, ..
        } = &model.suspension;
        let (proportional, integral) = match model.feedback {
            FeedbackKind::Acceleration | FeedbackKind::Both => {
                let virtual_mass = stiffness / (omega * omega) - mass;
                let damping = (virtual_mass + mass) * (2.0 * target.damping * omega);
                (virtual_mass, damping)
            }
            FeedbackKind::Force => {
                let inverse = (mass * (omega * omega))
                    .try_inverse()
                    .expect("the mass is positive definite because every body's is");
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

/// The transforms from sensors to modes and from modes to leg forces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModalTransform {
    /// T_in, 6×6, from sensor values to modes. Accelerometers: S⁻¹·T_c⁻¹, from m/s² to √kg·m/s².
    /// Force sensors: Sᵀ with columns in the order of the sensors, from N to N/√kg.
    pub input: Matrix6<f64>,
    /// With both kinds of sensors, Sᵀ for the force sensors, 6×6, from N to N/√kg. `None` with one
    /// kind.
    pub beside: Option<Matrix6<f64>>,
    /// T_out = S⁻ᵀ, 6×6, from modal forces, N/√kg, to leg forces, N.
    pub output: Matrix6<f64>,
}

impl ModalTransform {
    /// The transforms of `model` in which the gains of [`Gains::new`] are diagonal.
    ///
    /// With S of Eq. (17), K'_a = S⁻ᵀ·(Ω²/ω_n² − 1)·S⁻¹ and K_P = S⁻ᵀ·(Ω²/ω_n² − 1)·Sᵀ. So for
    /// both kinds of sensors, mode k has the gains ω_k²/ω_n² − 1, Eq. (18), and 2ζ_n·ω_k²/ω_n.
    pub fn new(model: &DesignModel) -> Self {
        let inverse = model.modal.try_inverse().expect("modes are independent");
        let unsense = model
            .sensing
            .try_inverse()
            .expect("the sensors were checked to be independent");
        let to_modes = match model.feedback {
            FeedbackKind::Acceleration | FeedbackKind::Both => inverse,
            FeedbackKind::Force => model.modal.transpose(),
        };
        // Entries that are zero by symmetry differ from zero by rounding, and not by the same on
        // every processor.
        let clean = |m: Matrix6<f64>| {
            let smallest = 1e-12 * m.amax();
            m.map(|x| if x.abs() < smallest { 0.0 } else { x })
        };
        Self {
            input: clean(to_modes * unsense),
            beside: model.beside.map(|sensing| {
                let unsense = sensing
                    .try_inverse()
                    .expect("each leg has its own force sensor");
                clean(model.modal.transpose() * unsense)
            }),
            output: clean(inverse.transpose()),
        }
    }
}
