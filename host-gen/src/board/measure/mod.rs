//! Transfer functions measured in place: a multisine in each leg in turn, and what the board sums
//! up of sensors and forces at its lines.
//!
//! With the forces of six experiments as the columns of U and the sensors' answers as
//! those of Y, the plant is G22 = Y·U⁻¹ whether the loop is open or closed. The forces
//! are those given to the DAC, the controller's part included. With the injected forces
//! R, the sensitivity at the legs is U·R⁻¹.
//!
//! There are two passes: the first over all frequencies; the second with windows of twice the
//! length, and lines around the resonances that the first has found.

mod experiment;
mod lines;
mod rational_fit;

use nalgebra::{Complex, DMatrix, DVector, Matrix6};
use serde::{Deserialize, Serialize};
use shared::LEGS;
use shared::injection::{FADE, LONGEST};
use shared::multisine::BLOCK;
use shared::supervisor::{Cause, Mode};
use shared::table::ValidTable;

use super::link::{Client, LinkError};
use super::words::cause;
use crate::control::LinearLaw;
use crate::design::Study;
use crate::plant::Gain;
use crate::progress::Progress;
use experiment::{Course, Experiment};
use lines::{force_limit, sensitivity};

pub use lines::{Pass, Response};
pub use rational_fit::{RationalFit, Resonance, turn};

/// Settings of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct MeasurementSettings {
    /// Lowest and highest frequency, Hz.
    pub band: [f64; 2],
    /// Windows that are averaged in each experiment, at least [`FEWEST`].
    pub averages: u32,
    /// Windows to wait before, until transients have died out.
    pub settling: u32,
    /// Whether there is only the first pass.
    pub coarse: bool,
    /// Largest force of the test signal, N: the sum of the amplitudes of its lines. None for that of
    /// [`Pass::set_amplitudes`].
    pub amplitude: Option<f64>,
}

/// Smallest number of averages: the expected error comes from their scatter.
pub const FEWEST: u32 = 2;

/// A measurement.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Measurement {
    /// The resonances of a rational function through all lines, ascending; none where there are too
    /// few lines for one.
    pub resonances: Vec<Resonance>,
    /// The results, in ascending order of their frequency.
    pub lines: Vec<MeasuredLine>,
}

/// The result at one frequency.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct MeasuredLine {
    /// Frequency, Hz.
    pub hz: f64,
    /// Amplitude of the sine, N.
    pub amplitude: f64,
    /// Measured G22: a row for each sensor, a column for each leg, unit of the sensor per
    /// N, as [re, im].
    pub plant: Vec<[[f64; 2]; LEGS]>,
    /// Standard deviation of each entry of `plant`, as the scatter of the averages gives it: the root
    /// of the mean square of its error.
    pub deviation: Vec<[f64; LEGS]>,
    /// Covariance of the errors of a column of `plant`, the mean of all columns: sensors by sensors,
    /// as [re, im]. What moves the whole machine, as the floor does, is in all sensors at once.
    pub covariance: Vec<Vec<[f64; 2]>>,
    /// G22 of the model, in the form of `plant`.
    pub model: Vec<[[f64; 2]; LEGS]>,
    /// Frobenius norm of measured minus modelled G22, relative to that of the model; the
    /// larger value of the two kinds of sensors.
    pub error: f64,
    /// Rms value of `error` that is expected from the scatter of the averages alone.
    pub expected_error: f64,
    /// The sensitivity at the legs; none with the loop open.
    pub sensitivity: Option<MeasuredSensitivity>,
}

/// The sensitivity at the legs at one frequency.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
pub struct MeasuredSensitivity {
    /// σ_max of what was measured.
    pub measured: f64,
    /// σ_max of what follows from model and table.
    pub designed: f64,
    /// Expected error of `measured`, as the scatter of the averages gives it: the root of the mean
    /// square of the Frobenius norm of the error.
    pub deviation: f64,
}

/// Lines with a larger expected error, relative to what was measured, say nothing about poles.
const NOISY: f64 = 0.3;

impl MeasuredLine {
    /// Measured G22.
    pub fn gain(&self) -> Gain {
        Gain::from_fn(self.plant.len(), |i, j| {
            let [re, im] = self.plant[i][j];
            Complex::new(re, im)
        })
    }

    /// Root of the sum of the squares of all deviations of a kind of sensors, and the Frobenius norm
    /// of its measured G22: by kind.
    fn kinds(&self) -> Vec<[f64; 2]> {
        let plant = self.gain();
        let rows = (0..plant.nrows()).step_by(LEGS);
        rows.map(|row| {
            let deviations = self.deviation[row..row + LEGS].as_flattened();
            let square: f64 = deviations.iter().map(|x| x * x).sum();
            [square.sqrt(), plant.rows(row, LEGS).norm()]
        })
        .collect()
    }

    /// Expected error relative to what was measured; the larger value of the two kinds of sensors.
    pub fn noise(&self) -> f64 {
        let parts = self.kinds().into_iter().map(|[error, size]| error / size);
        parts.fold(0.0, f64::max)
    }

    /// Whether it is so exact that it says something about poles.
    pub fn is_clear(&self) -> bool {
        self.noise() < NOISY
    }

    /// Frobenius norm of measured minus another G22, relative to the measured one; the larger value
    /// of the two kinds of sensors.
    pub fn distance(&self, other: &Gain) -> f64 {
        let plant = self.gain();
        let rows = (0..plant.nrows()).step_by(LEGS);
        rows.map(|row| {
            let [measured, other] = [&plant, other].map(|gain| gain.rows(row, LEGS));
            (measured - other).norm() / measured.norm()
        })
        .fold(0.0, f64::max)
    }
}

/// Errors of a measurement.
#[derive(Debug, thiserror::Error)]
pub enum FrfError {
    /// The link failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A setting is out of range.
    #[error("--{option} must {must}")]
    Setting {
        /// Name of the setting.
        option: &'static str,
        /// What it must be.
        must: String,
    },
    /// The board stopped with a fault during the measurement.
    #[error("leg {leg}: the board stopped with a fault: {}{}", cause(*.why), advice(*.why, *.amplitude))]
    Fault {
        /// Number of the leg with the test signal, from 1.
        leg: usize,
        /// Cause of the fault.
        why: Cause,
        /// Largest force of the test signal, N.
        amplitude: f64,
    },
    /// The loop was opened or closed during the measurement.
    #[error("leg {leg}: the loop was opened or closed during the measurement")]
    Changed {
        /// Number of the leg with the test signal, from 1.
        leg: usize,
    },
    /// A window was over before all of the one before it was fetched.
    #[error(
        "leg {leg}: the link is too slow: the board has measured a window before the one before it was fetched"
    )]
    Slow {
        /// Number of the leg with the test signal, from 1.
        leg: usize,
    },
    /// The board runs another table than the one of the machine file.
    #[error(
        "the board runs the table of another machine, or of another version of the machine file; send the table with host-gen link table, or run host-gen generate and flash the board"
    )]
    OtherTable,
    /// A fault was latched before the measurement.
    #[error("a fault is latched: {}; use host-gen link clear, and repeat the self-test", cause(*.0))]
    Latched(Cause),
    /// The loop is neither idle nor closed.
    #[error("the loop is neither idle nor closed; see host-gen link status")]
    Mode,
    /// The forces do not contain the multisine.
    #[error(
        "leg {leg}: the forces do not contain the injected signal; --amplitude is too low, or the leg is at its limit"
    )]
    Nothing {
        /// Number of the leg, from 1.
        leg: usize,
    },
}

/// What to do about a fault during a measurement.
fn advice(why: Cause, amplitude: f64) -> String {
    match why {
        Cause::Rail(_)
        | Cause::Implausible(_)
        | Cause::Erratic(_)
        | Cause::Saturated
        | Cause::Diverging => format!(
            "; the test signal of {amplitude:.3} N was too large for this machine: clear the fault, repeat the self-test and use a lower --amplitude"
        ),
        _ => String::new(),
    }
}

/// Measures the plant, and with the loop closed also the sensitivity, and compares them
/// with those of `study` with `table`. `progress` is called after each averaged window.
///
/// However it ends, the test signal is ended, too.
///
/// # Errors
/// [`FrfError`] if a setting is out of range, the link fails, the board runs another table,
/// its mode does not allow the measurement or changes, or a leg's force does not contain the
/// multisine.
pub fn measure(
    client: &mut Client,
    study: &Study,
    table: &ValidTable,
    settings: &MeasurementSettings,
    progress: &dyn Progress,
) -> Result<Measurement, FrfError> {
    settings.check()?;
    if client.identity()?.checksum != table.checksum() {
        return Err(FrfError::OtherTable);
    }
    let report = client.report()?;
    if let Some(fault) = report.fault {
        return Err(FrfError::Latched(fault.cause));
    }
    let law = match report.mode {
        Mode::Idle => None,
        Mode::Closed => Some(LinearLaw::new(table).with_gain(report.gain.into())),
        _ => return Err(FrfError::Mode),
    };
    let limit = force_limit(table.get());
    if settings
        .amplitude
        .is_some_and(|amplitude| amplitude > limit)
    {
        return Err(setting(
            "amplitude",
            format!("be at most {limit:.3} N, the force limit of a leg"),
        ));
    }
    let rate = f64::from(table.get().sample_rate);
    let course = Course {
        study,
        table,
        law: law.as_ref(),
        settings: *settings,
        mode: report.mode,
        progress,
    };
    let delay = study.machine().board.whole_delay();
    let mut measured = course.pass(client, Pass::first(rate, settings.band)?, None)?;
    if !settings.coarse {
        let fit = RationalFit::new(&measured, delay);
        let resonances = fit.as_ref().map_or(&[][..], |fit| &fit.resonances);
        let pass = Pass::second(rate, settings.band, resonances)?;
        measured.extend(course.pass(client, pass, fit.as_ref())?);
        measured.sort_by(|a, b| a.hz.total_cmp(&b.hz));
    }
    Ok(Measurement {
        resonances: RationalFit::new(&measured, delay).map_or_else(Vec::new, |fit| fit.resonances),
        lines: measured,
    })
}

fn setting(option: &'static str, must: impl Into<String>) -> FrfError {
    FrfError::Setting {
        option,
        must: must.into(),
    }
}

impl MeasurementSettings {
    /// What is usual: both passes from 0.5 to 500 Hz.
    pub const USUAL: Self = Self {
        band: [0.5, 500.0],
        averages: FEWEST,
        settling: 1,
        coarse: false,
        amplitude: None,
    };

    /// Checks the settings as far as they do not depend on a board.
    ///
    /// # Errors
    /// [`FrfError::Setting`] with the first one that is out of range.
    pub fn check(&self) -> Result<(), FrfError> {
        let [low, high] = self.band;
        if !(low > 0.0 && low.is_finite()) {
            return Err(setting("from", "be above 0 Hz and finite"));
        }
        if !(high > low && high.is_finite()) {
            return Err(setting(
                "to",
                format!("be above --from, {low} Hz, and finite"),
            ));
        }
        if self.averages < FEWEST {
            let must = format!(
                "be at least {FEWEST}: the expected error comes from the scatter of the averages"
            );
            return Err(setting("averages", must));
        }
        if self.amplitude.is_some_and(|n| !(n.is_finite() && n > 0.0)) {
            return Err(setting("amplitude", "be above 0 N and finite"));
        }
        Ok(())
    }

    /// Number of windows that are averaged in all.
    pub fn windows(&self) -> usize {
        let passes = if self.coarse { 1 } else { 2 };
        passes * LEGS * self.averages as usize
    }

    /// Length of all test signals on a board with this sample `rate`, Hz: s.
    ///
    /// # Errors
    /// [`FrfError::Setting`] if the board cannot measure so.
    pub fn duration(&self, rate: f64) -> Result<f64, FrfError> {
        let mut samples = self.samples(&Pass::first(rate, self.band)?)?;
        if !self.coarse {
            samples += self.samples(&Pass::second(rate, self.band, &[])?)?;
        }
        Ok(LEGS as f64 * f64::from(samples) / rate)
    }

    /// Samples of the test signal in an experiment with the windows of `pass`.
    ///
    /// # Errors
    /// If that is more than the board allows.
    fn samples(&self, pass: &Pass) -> Result<u32, FrfError> {
        let windows = u64::from(self.settling) + u64::from(self.averages);
        let samples = windows * u64::from(pass.samples()) + u64::from(AFTER);
        u32::try_from(samples)
            .ok()
            .filter(|samples| *samples <= LONGEST)
            .ok_or_else(|| {
                let most = (LONGEST - AFTER) / pass.samples();
                let must = format!(
                    "with --averages be at most {most} windows together, the longest test signal"
                );
                setting("settling", must)
            })
    }
}

/// Samples of the signal after its last window: the board adds up all of that, and the signal fades
/// out.
const AFTER: u32 = 2 * BLOCK + FADE;

fn evaluate(
    study: &Study,
    law: Option<&LinearLaw>,
    pass: &Pass,
    experiments: &[Experiment],
    line: usize,
) -> Option<MeasuredLine> {
    let hz = pass.hertz()[line];
    let averages = experiments[0].windows.len();
    let channels = experiments[0].windows[0][line].len();
    let sensors = channels - LEGS;
    let mean = |experiment: &Experiment, channel: usize| {
        let all = experiment.windows.iter();
        all.map(|window| window[line][channel])
            .sum::<Complex<f64>>()
            / averages as f64
    };
    let u = Matrix6::from_fn(|i, j| mean(&experiments[j], sensors + i));
    let y = Gain::from_fn(sensors, |i, j| mean(&experiments[j], i));
    let inverse = u.try_inverse()?;
    let plant = &y * inverse;
    let z = study.plant().z(hz);
    let model = study.plant().response(hz).g22();
    // The scatter of y − G·u: the error of Y·U⁻¹ where both are noisy.
    let scatter = |experiment: &Experiment| {
        let residuals = experiment.windows.iter().map(|window| {
            let parts = DVector::from_column_slice(&window[line]);
            parts.rows(0, sensors) - &plant * parts.rows(sensors, LEGS)
        });
        let squares = residuals.map(|residual| &residual * residual.adjoint());
        squares.fold(DMatrix::zeros(sensors, sensors), |sum, square| sum + square)
            / Complex::from((averages * (averages - 1)) as f64)
    };
    let scatters: Vec<DMatrix<_>> = experiments.iter().map(scatter).collect();
    let forces = inverse.map(|x| x.norm_sqr());
    let by_noise = DMatrix::from_fn(sensors, LEGS, |i, j| scatters[j][(i, i)].re) * forces;
    let covariance = scatters
        .iter()
        .zip(forces.row_iter())
        .map(|(scatter, row)| scatter * Complex::from(row.sum() / LEGS as f64));
    let covariance = covariance.fold(DMatrix::zeros(sensors, sensors), |sum, part| sum + part);
    // The larger value of the two kinds of sensors.
    let worst = |error: &dyn Fn(usize) -> f64| {
        let kinds = (0..sensors).step_by(LEGS);
        let kinds = kinds.map(|first| error(first) / model.rows(first, LEGS).norm());
        kinds.fold(0.0, f64::max)
    };
    let off = &plant - &model;
    let error = worst(&|first| off.rows(first, LEGS).norm());
    let expected = worst(&|first| by_noise.rows(first, LEGS).sum().sqrt());
    let sensitivity = law.map(|law| {
        let injected = pass.injected(line);
        let sigma_max = |s: Matrix6<Complex<f64>>| s.singular_values().max();
        let squares = (0..LEGS).flat_map(|i| experiments.iter().zip(0..LEGS).map(move |e| (i, e)));
        let square = squares.map(|(i, (experiment, j))| {
            let all = experiment.windows.iter();
            all.map(|window| (window[line][sensors + i] - u[(i, j)]).norm_sqr())
                .sum::<f64>()
        });
        let square = square.sum::<f64>() / (averages * (averages - 1)) as f64;
        MeasuredSensitivity {
            measured: sigma_max(u / injected),
            designed: sigma_max(sensitivity(law, z, &model)),
            deviation: square.sqrt() / injected.norm(),
        }
    });
    let pair = |x: Complex<f64>| [x.re, x.im];
    let pairs = |m: &Gain| {
        let row = |i: usize| core::array::from_fn(|j| pair(m[(i, j)]));
        (0..sensors).map(row).collect()
    };
    let rows = covariance.row_iter();
    let covariance = rows.map(|row| row.iter().map(|x| pair(*x)).collect());
    let deviation = (0..sensors).map(|i| core::array::from_fn(|j| by_noise[(i, j)].sqrt()));
    Some(MeasuredLine {
        hz,
        amplitude: pass.amplitudes[line],
        plant: pairs(&plant),
        deviation: deviation.collect(),
        covariance: covariance.collect(),
        model: pairs(&model),
        error,
        expected_error: expected,
        sensitivity,
    })
}
