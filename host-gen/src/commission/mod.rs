//! Commissioning: what each step must show before the next one moves the machine more.

mod gates;

use serde::Serialize;
use shared::LEGS;
use shared::levels::{Level, Levels, seconds};
use shared::table::ValidTable;

use crate::board::measure::{MeasuredSensitivity, Measurement, Resonance};
use crate::closed_loop::budget::{LOWEST, budget};
use crate::design::{Design, Study};
use crate::identify::Identification;
use crate::numeric::NumericError;

pub use gates::{Gate, closed_at};

/// A run, as far as it has come.
#[derive(Clone, Debug, Serialize)]
pub struct Commissioning {
    /// Name of the machine.
    pub machine: String,
    /// The board's address.
    pub board: String,
    /// The steps so far; only the last one can have failed.
    pub gates: Vec<Gate>,
    /// Resonances of the measured machine.
    pub resonances: Vec<Resonance>,
    /// The fit.
    pub fit: Option<Identification>,
    /// The design for the fitted machine.
    pub design: Option<Design>,
    /// The closed loop at each gain.
    pub closed: Vec<ClosedLoop>,
    /// What the machine does on its floor.
    pub acceptance: Option<Acceptance>,
}

impl Commissioning {
    /// Before the first step.
    pub fn new(machine: &str, board: String) -> Self {
        Self {
            machine: machine.to_owned(),
            board,
            gates: Vec::new(),
            resonances: Vec::new(),
            fit: None,
            design: None,
            closed: Vec::new(),
            acceptance: None,
        }
    }
}

/// The sensitivity at the legs of a closed loop.
#[derive(Clone, Debug, Serialize)]
pub struct ClosedLoop {
    /// The loop gain, relative to that of the table (no unit).
    pub gain: f64,
    /// By frequency.
    pub lines: Vec<SensitivityLine>,
}

/// The sensitivity at a frequency.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SensitivityLine {
    /// Frequency, Hz.
    pub hz: f64,
    /// What was measured and designed there.
    #[serde(flatten)]
    pub sensitivity: MeasuredSensitivity,
}

impl ClosedLoop {
    /// From a measurement with the loop closed.
    pub fn new(gain: f64, measurement: &Measurement) -> Self {
        let lines = measurement.lines.iter().filter_map(|line| {
            Some(SensitivityLine {
                hz: line.hz,
                sensitivity: line.sensitivity?,
            })
        });
        Self {
            gain,
            lines: lines.collect(),
        }
    }
}

/// Forces and sensors on the floor as it is, with the loop open and closed.
#[derive(Clone, Debug, Serialize)]
pub struct Acceptance {
    /// The legs.
    pub legs: Vec<LegForce>,
    /// The sensors that are fed back, accelerometers first.
    pub sensors: Vec<SensorLevel>,
}

/// The force of a leg with the loop closed.
#[derive(Clone, Debug, Serialize)]
pub struct LegForce {
    /// Its name.
    pub name: String,
    /// Rms about the mean of each window of the board's levels, N.
    pub measured: f64,
    /// The same by the design on the floor of the file, N.
    pub designed: f64,
}

/// The signal of a sensor.
#[derive(Clone, Debug, Serialize)]
pub struct SensorLevel {
    /// Its name.
    pub name: String,
    /// Rms with the loop open, dB of full scale; none without a signal.
    pub open: Option<f64>,
    /// Rms with the loop closed, dB of full scale; none without a signal.
    pub closed: Option<f64>,
}

/// Rms over several windows of the board's levels, relative to full scale.
fn rms(levels: &[Levels], of: impl Fn(&Levels) -> Level) -> f64 {
    let power = |levels| {
        let decibels = of(levels).rms.decibels();
        decibels.map_or(0.0, |db| 10f64.powf(0.1 * f64::from(db)))
    };
    let all: f64 = levels.iter().map(power).sum();
    (all / levels.len() as f64).sqrt()
}

impl Acceptance {
    /// From the levels of windows with the loop open and closed under `table`, designed for `study`.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn new(
        study: &Study,
        table: &ValidTable,
        [open, closed]: [&[Levels]; 2],
    ) -> Result<Self, NumericError> {
        let machine = study.machine();
        let t = table.get();
        let window = f64::from(seconds(t));
        let highest = 0.5 * machine.board.sample_rate;
        let expected = budget(
            study.plant(),
            &machine.board,
            Some(table),
            &machine.floor_in_band(),
            [LOWEST, highest],
            Some(window),
        )?;
        let legs = (0..LEGS).map(|i| {
            let powers = expected.about_mean(&expected.force[i], window);
            let drive = t.actuators[i];
            let full = f64::from(drive.zero / drive.gain).abs();
            LegForce {
                name: machine.beams[machine.actuators[i]].name.clone(),
                measured: full * rms(closed, |levels| levels.legs[i]),
                designed: powers.iter().sum::<f64>().sqrt(),
            }
        });
        let names = machine.sensor_names(machine.target.feedback);
        let sensors = names.into_iter().enumerate();
        let sensors = sensors.map(|(i, name)| {
            let of = |levels: &Levels| match i.checked_sub(LEGS) {
                Some(i) => levels.forces[i],
                None => levels.sensors[i],
            };
            let [open, closed] = [open, closed].map(|all| {
                let rms = rms(all, of);
                (rms > 0.0).then(|| 20.0 * rms.log10())
            });
            SensorLevel { name, open, closed }
        });
        Ok(Self {
            legs: legs.collect(),
            sensors: sensors.collect(),
        })
    }
}
