//! From gains and shapes to the controller table.

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
use crate::machine::{Feedback, Machine, Target};
use crate::model::design_model::DesignModel;
use crate::plant::SampledPlant;

/// AC coupling sits this far below ω_n, where it costs the lower crossover
/// little phase.
pub const AC_COUPLING: f64 = 0.05;

/// The integral leaks this far below ω_n.
pub const LEAK: f64 = 0.01;

/// Far enough from what a quiet floor gives that the AC coupling is linear
/// there, and near enough that half a second of shock leaves less than the legs
/// can push.
const SHOCK: f64 = 20.0;

/// c of a first-order section with its corner at `hz`, increment form.
pub fn coefficient(hz: f64, period: f64) -> f64 {
    -(-core::f64::consts::TAU * hz * period).exp_m1()
}

/// The table of a machine with the `gains` for `target` and a roll-off at
/// `roll_off` Hz, common to all channels.
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

/// The table of a machine with `shapes` for the modes of its design model.
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
    let complement = machine.board.beside.zip(beside).map(|(sensor, input)| {
        let calibration = machine.board.adc.calibration(sensor.sensitivity);
        Complement {
            sensors: [calibration; LEGS],
            input: input.map(|x| x as f32),
            // Without one the accelerometers count alone.
            split: shapes.each_ref().map(|shape| {
                let split = shape.split_hz.map(|hz| coefficient(hz, period) as f32);
                split.unwrap_or(1.0)
            }),
        }
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

/// The modes' gains with their sections: Eqs. (19) to (22) in the coordinates
/// of Eq. (17).
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

/// The clamp's excess leaves the integral with time constant 1/ω_n.
fn with_paths(
    machine: &Machine,
    plant: &SampledPlant,
    target: &Target,
    paths: Paths,
) -> Result<ValidTable, TableError> {
    let board = &machine.board;
    let period = board.period();
    let frequency = target.frequency;
    let table = Table {
        version: FORMAT_VERSION,
        model: machine.digest,
        sample_rate: board.sample_rate as f32,
        latch: board.latch_delay as f32,
        feedback: match target.feedback {
            Feedback::Acceleration | Feedback::Both => table::Feedback::Acceleration,
            Feedback::Force => table::Feedback::Force,
        },
        sensors: [board.adc.calibration(board.sensor.sensitivity); LEGS],
        adc_max: board.adc.max(),
        ac_coupling: coefficient(AC_COUPLING * frequency, period) as f32,
        ac_limit: f32::MAX,
        law: Law {
            paths,
            leak: coefficient(LEAK * frequency, period) as f32,
            anti_windup: coefficient(frequency, period) as f32,
        },
        actuators: [board.dac.drive(board.actuator_gain, board.force_limit); LEGS],
        dac_max: board.dac.max(),
        supervision: supervision(machine),
        self_test: self_test(machine, plant),
    }
    .validate()?;
    // Past so many times what takes a leg to its limit at f_n it is a shock.
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
