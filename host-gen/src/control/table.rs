//! The controller table from gains and shapes.

use nalgebra::{Complex, Matrix6};
use shared::LEGS;
use shared::table::{
    self, Channel, Complement, Direct, FORMAT_VERSION, Law, Modal, Paths, Table, TableError,
    ValidTable,
};

use super::gains::{Gains, ModalTransform};
use super::law::LinearLaw;
use super::shape::Shape;
use super::supervision::{self_test, supervision};
use crate::machine::{FeedbackKind, Machine, Target};
use crate::model::design_model::DesignModel;
use crate::plant::SampledPlant;

/// Corner frequency of the AC coupling over the target frequency. This low it costs the lower
/// crossover little phase.
pub const AC_COUPLING: f64 = 0.05;

/// Corner frequency of the integral's leak over the target frequency.
pub const LEAK: f64 = 0.01;

/// Corner frequency of the anti-windup over the target frequency. With 1, the loop of the reference
/// board stays in the clamp for ever after a shock; with 0.1 most loops need more than six seconds to
/// leave it.
const ANTI_WINDUP: f64 = 0.6;

/// Limit of the AC coupling over the sensor value that drives a leg to its limit at the target
/// frequency.
///
/// On a quiet floor the sensors stay far below, so the coupling is linear. After half a second of
/// shock, the offset it leaves takes less than the force limit of the legs.
const SHOCK: f64 = 20.0;

/// The coefficient c of the first-order section x += c·(u − x) with its corner at `hz`, Hz, for the
/// sample period `period`, s. Between 0 and 1.
pub fn coefficient(hz: f64, period: f64) -> f64 {
    -(-core::f64::consts::TAU * hz * period).exp_m1()
}

/// The table of a direct law: the matrices of `gains` and one roll-off at `roll_off`, Hz, for all
/// sensors.
///
/// `gains` are those for `target`, and `plant` is the sampled plant of `machine`.
///
/// # Errors
/// If a number does not fit the table, as [`Table::validate`] finds.
pub fn direct(
    machine: &Machine,
    plant: &SampledPlant,
    target: &Target,
    gains: &Gains,
    roll_off: f64,
) -> Result<ValidTable, TableError> {
    let period = machine.board.period();
    let single = |m: &Matrix6<f64>| m.map(|x| x as f32);
    let paths = Paths::Direct(Direct {
        roll_off: coefficient(roll_off, period) as f32,
        proportional: single(&gains.proportional),
        integral: single(&(gains.integral * (0.5 * period))),
    });
    with_paths(machine, plant, target, paths)
}

/// The table of a modal law: one channel with its shape for each mode of the design model.
///
/// `shapes` are in the order of the modes, and `plant` is the sampled plant of `machine`.
///
/// # Errors
/// If a number does not fit the table, as [`Table::validate`] finds.
pub fn modal(
    machine: &Machine,
    plant: &SampledPlant,
    model: &DesignModel,
    target: &Target,
    shapes: &[Shape; LEGS],
) -> Result<ValidTable, TableError> {
    let ModalTransform {
        input,
        beside,
        output,
    } = ModalTransform::new(model);
    let period = machine.board.period();
    let (_, forces) = machine.board.calibrations();
    let complement = forces.zip(beside).map(|(sensors, input)| Complement {
        sensors,
        input: input.map(|x| x as f32),
        // Without a crossover frequency only the accelerometers act.
        split: shapes.each_ref().map(|shape| {
            let split = shape.split_hz.map(|hz| coefficient(hz, period) as f32);
            split.unwrap_or(1.0)
        }),
    });
    with_paths(
        machine,
        plant,
        target,
        Paths::Modal(Modal {
            input: input.map(|x| x as f32),
            complement,
            channels: channels(model, target, shapes, period),
            sections: Shape::SECTIONS,
            output: output.map(|x| x as f32),
        }),
    )
}

/// The channels of a modal law: the gains and the sections of each mode, in the order of the modes.
///
/// The modal mass with feedback, ω_k²/ω_n² by Eq. (18), gives the proportional gain
/// ω_k²/ω_n² − 1. The integral gain is 2ζ_n·ω_k²/ω_n, times T/2 for the trapezoidal integral.
/// These are the gains of Eq. (19) and Eq. (20), or those of Eq. (22), in the coordinates of
/// Eq. (17). `period` is T, s.
pub fn channels(
    model: &DesignModel,
    target: &Target,
    shapes: &[Shape; LEGS],
    period: f64,
) -> [Channel; LEGS] {
    let omega = target.omega();
    core::array::from_fn(|i| {
        let whole = (model.omega[i] / omega).powi(2);
        Channel {
            sections: shapes[i].sections(period),
            proportional: (whole - 1.0) as f32,
            integral: (2.0 * target.damping * omega * whole * 0.5 * period) as f32,
        }
    })
}

/// The table of `machine` with the law `paths`.
fn with_paths(
    machine: &Machine,
    plant: &SampledPlant,
    target: &Target,
    paths: Paths,
) -> Result<ValidTable, TableError> {
    let board = &machine.board;
    let period = board.period();
    let frequency = target.frequency;
    let (sensors, _) = board.calibrations();
    let table = Table {
        version: FORMAT_VERSION,
        model: machine.digest,
        sample_rate: board.sample_rate as f32,
        latch: board.latch_delay as f32,
        feedback: match target.feedback {
            FeedbackKind::Acceleration | FeedbackKind::Both => table::Feedback::Acceleration,
            FeedbackKind::Force => table::Feedback::Force,
        },
        sensors,
        adc_max: board.adc.max(),
        ac_coupling: coefficient(AC_COUPLING * frequency, period) as f32,
        ac_limit: f32::MAX,
        law: Law {
            paths,
            leak: coefficient(LEAK * frequency, period) as f32,
            anti_windup: coefficient(ANTI_WINDUP * frequency, period) as f32,
        },
        actuators: board.drives(),
        dac_max: board.dac.max(),
        supervision: supervision(machine),
        self_test: self_test(machine, plant),
    }
    .validate()?;
    // A sensor value this many times above the one that drives a leg to its limit at f_n is a
    // shock.
    let z = Complex::cis(core::f64::consts::TAU * frequency * period);
    let most = LinearLaw::new(&table)
        .response(z)
        .row_iter()
        .map(|row| row.iter().map(|x| x.norm()).sum::<f64>())
        .fold(0.0, f64::max);
    let mut table = *table.get();
    table.ac_limit = (SHOCK * board.force_limit / most) as f32;
    table.validate()
}
