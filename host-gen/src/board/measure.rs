//! Transfer functions measured in place: a multisine in each leg in turn, and the
//! recorder.
//!
//! With the forces of six experiments as the columns of U and the sensors' answers as
//! those of Y, the plant is G22 = Y·U⁻¹ whether the loop is open or closed. The forces
//! are those given to the DAC, the controller's part included. With the injected forces
//! R, the sensitivity at the legs is U·R⁻¹.

use std::sync::Arc;

use nalgebra::{Complex, DMatrix, Matrix6};
use rustfft::{Fft, FftPlanner};
use serde::Serialize;
use shared::LEGS;
use shared::controller::ControllerReport;
use shared::injection::{Injection, Injector, Signal};
use shared::link::Request;
use shared::recorder::{Record, Recording, Trigger};
use shared::supervisor::Mode;
use shared::table::ValidTable;

use super::link::{Client, LinkError};
use crate::control::LinearLaw;
use crate::design::Study;
use crate::progress::Progress;

/// Settings of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct MeasurementSettings {
    /// Samples in a period of the multisine, a power of two.
    pub period: u32,
    /// Number of periods that are averaged.
    pub averages: u32,
    /// Periods to wait until transients have died out.
    pub settling: u32,
    /// Amplitude of each sine, N.
    pub amplitude: f64,
}

/// Cycles of the first sine in a period. With the two constants below, the sines are from
/// 5 to 315 Hz at 20 kHz and 8192 samples.
const FIRST: u32 = 2;
/// Cycles in a period between neighbouring sines.
const APART: u32 = 2;
/// Number of sines.
const COUNT: u32 = 64;

/// The multisine of a measurement; `period` in samples.
pub fn multisine(period: u32) -> Signal {
    Signal::Multisine {
        period,
        first: FIRST,
        apart: APART,
        count: COUNT,
    }
}

/// The result at one frequency.
#[derive(Clone, Debug, Serialize)]
pub struct MeasuredLine {
    /// Frequency, Hz.
    pub hz: f64,
    /// Measured G22: a row for each sensor, a column for each leg, unit of the sensor per
    /// N, as [re, im].
    pub plant: Vec<[[f64; 2]; LEGS]>,
    /// G22 of the model, in the form of `plant`.
    pub model: Vec<[[f64; 2]; LEGS]>,
    /// Frobenius norm of measured minus modelled G22, relative to that of the model; the
    /// larger value of the two kinds of sensors.
    pub error: f64,
    /// Rms value of `error` that is expected from the scatter of the averages alone.
    pub expected_error: f64,
    /// Coherence between the force of a leg and the sensor where it is highest, 0 to 1;
    /// the lowest value of all legs.
    pub coherence: f64,
    /// σ_max of the sensitivity at the legs, measured and predicted from model and table;
    /// none with the loop open.
    pub sensitivity: Option<[f64; 2]>,
}

/// Errors of a measurement.
#[derive(Debug, thiserror::Error)]
pub enum FrfError {
    /// The link failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The board runs another table than the one of the machine file.
    #[error(
        "the board runs the table of another machine, or of another version of the machine file; send the table with host-gen link table, or run host-gen generate and flash the board"
    )]
    OtherTable,
    /// The loop is neither idle nor closed.
    #[error("the loop is neither idle nor closed; see host-gen link status")]
    Mode,
    /// The period does not fit into the board's recorder.
    #[error("the board's recorder holds {room} records; --period must not be larger")]
    Room {
        /// Capacity of the recorder, records.
        room: u32,
    },
    /// The recorded forces do not contain the multisine.
    #[error(
        "leg {leg}: the recorded forces do not contain the injected signal; --amplitude is too low, or the leg is at its limit"
    )]
    Nothing {
        /// Number of the leg, from 1.
        leg: usize,
    },
}

/// One experiment: the multisine in one leg.
struct Experiment {
    /// Spectra by line, by average and by channel: sensors, then forces.
    spectra: Vec<Vec<Vec<Complex<f64>>>>,
    /// Spectrum of the injected force by line, with the window and the phase reference of
    /// `spectra`.
    injected: Vec<Complex<f64>>,
}

/// Measures the plant, and with the loop closed also the sensitivity, and compares them
/// with those of `study` with `table`. `progress` is called after each averaged period.
///
/// # Errors
/// [`FrfError`] if the link fails, the board runs another table, its mode or its recorder
/// does not allow the measurement, or a leg's force does not contain the multisine.
pub fn measure(
    client: &mut Client,
    study: &Study,
    table: &ValidTable,
    settings: &MeasurementSettings,
    progress: &dyn Progress,
) -> Result<Vec<MeasuredLine>, FrfError> {
    let identity = client.identity()?;
    if identity.checksum != table.checksum() {
        return Err(FrfError::OtherTable);
    }
    if settings.period > identity.room {
        return Err(FrfError::Room {
            room: identity.room,
        });
    }
    let closed = match client.report()?.mode {
        Mode::Idle => false,
        Mode::Closed => true,
        _ => return Err(FrfError::Mode),
    };
    let fft = FftPlanner::new().plan_fft_forward(settings.period as usize);
    let mut experiments = Vec::new();
    for leg in 0..LEGS {
        let experiment = experiment(client, table, settings, &fft, leg, progress)?;
        experiments.push(experiment.ok_or(FrfError::Nothing { leg: leg + 1 })?);
    }
    let law = LinearLaw::new(table);
    let rate = f64::from(table.get().sample_rate);
    let lines = (0..COUNT as usize).filter_map(|line| {
        let turns = FIRST + APART * line as u32;
        let hz = rate * f64::from(turns) / f64::from(settings.period);
        evaluate(study, &law, &experiments, line, hz, closed)
    });
    Ok(lines.collect())
}

fn experiment(
    client: &mut Client,
    table: &ValidTable,
    settings: &MeasurementSettings,
    fft: &Arc<dyn Fft<f64>>,
    leg: usize,
    progress: &dyn Progress,
) -> Result<Option<Experiment>, FrfError> {
    let period = settings.period;
    let mut legs = [0.0; LEGS];
    legs[leg] = settings.amplitude as f32;
    // Longer than all recordings take; it is ended after them.
    let injection = Injection {
        signal: multisine(period),
        legs,
        samples: shared::injection::LONGEST,
    };
    client.command(Request::Inject(injection))?;
    let ControllerReport { injected, .. } = client.report()?;
    let settled = injected + u64::from(period) * u64::from(settings.settling);
    client.wait_for(|report| report.at >= settled || report.injecting == 0)?;
    let mut spectra = vec![Vec::new(); COUNT as usize];
    for _ in 0..settings.averages {
        let (records, at) = client.record(Recording {
            trigger: Trigger::Now,
            before: 0,
            after: period,
        })?;
        progress.advance();
        let phase = (at - injected) % u64::from(period);
        let columns = transforms(table, &records, fft);
        for (line, spectrum) in spectra.iter_mut().enumerate() {
            let turns = (FIRST + APART * line as u32) as usize;
            // Phase relative to the start of the multisine.
            let turn = -core::f64::consts::TAU * turns as f64 * phase as f64 / f64::from(period);
            let turn = Complex::cis(turn);
            spectrum.push(columns.iter().map(|c| c[turns] * turn).collect::<Vec<_>>());
        }
    }
    // A zero signal replaces the multisine; the mode stays as it is.
    client.command(Request::Inject(Injection {
        legs: [0.0; LEGS],
        samples: 1,
        ..injection
    }))?;
    // One period of the injected force.
    let mut injector = Injector::new(table, injection);
    let mut wave: Vec<Complex<f64>> = (0..period)
        .map(|_| {
            let forces = injector.advance().map_or(0.0, |forces| forces.0[leg]);
            Complex::from(f64::from(forces))
        })
        .collect();
    windowed(&mut wave);
    fft.process(&mut wave);
    let injected = (0..COUNT)
        .map(|line| wave[(FIRST + APART * line) as usize])
        .collect();
    let there = spectra
        .iter()
        .flatten()
        .all(|c| c[c.len() - LEGS + leg].norm() > 0.0);
    Ok(there.then_some(Experiment { spectra, injected }))
}

/// Applies Hann's window: strong content at low frequency, as in the forces of the closed
/// loop, does not leak into the lines, nor does a line leak into another line.
fn windowed(column: &mut [Complex<f64>]) {
    let length = column.len() as f64;
    for (k, x) in column.iter_mut().enumerate() {
        *x *= (core::f64::consts::PI * k as f64 / length).sin().powi(2);
    }
}

/// Spectra of the sensors, then of the forces, in their units.
fn transforms(
    table: &ValidTable,
    records: &[Record],
    fft: &Arc<dyn Fft<f64>>,
) -> Vec<Vec<Complex<f64>>> {
    let t = table.get();
    let mut columns: Vec<Vec<Complex<f64>>> = Vec::new();
    let mut add = |of: &dyn Fn(&Record) -> f64| {
        let mut column: Vec<_> = records.iter().map(|r| Complex::from(of(r))).collect();
        windowed(&mut column);
        fft.process(&mut column);
        columns.push(column);
    };
    for i in 0..LEGS {
        add(&|record| t.sensors[i].value(record.adc.sensors[i]).into());
    }
    if let Some(complement) = t.complement() {
        for i in 0..LEGS {
            add(&|record| complement.sensors[i].value(record.adc.forces[i]).into());
        }
    }
    for i in 0..LEGS {
        let drive = t.actuators[i];
        add(&|record| (f64::from(record.dac[i].0) - f64::from(drive.zero)) / f64::from(drive.gain));
    }
    columns
}

fn evaluate(
    study: &Study,
    law: &LinearLaw,
    experiments: &[Experiment],
    line: usize,
    hz: f64,
    closed: bool,
) -> Option<MeasuredLine> {
    let averages = experiments[0].spectra[line].len();
    let channels = experiments[0].spectra[line][0].len();
    let sensors = channels - LEGS;
    let mean = |experiment: &Experiment, channel: usize| {
        let all = experiment.spectra[line].iter();
        all.map(|c| c[channel]).sum::<Complex<f64>>() / averages as f64
    };
    let u = Matrix6::from_fn(|i, j| mean(&experiments[j], sensors + i));
    let y = DMatrix::from_fn(sensors, LEGS, |i, j| mean(&experiments[j], i));
    let inverse = u.try_inverse()?;
    let plant = &y * inverse;
    let z = study.plant().z(hz);
    let model = study.plant().response(hz).g22();
    // The scatter of y − G·u: the error of Y·U⁻¹ where both are noisy.
    let scatter = DMatrix::from_fn(sensors, LEGS, |i, j| {
        let all = experiments[j].spectra[line].iter();
        let residual = |c: &Vec<Complex<f64>>| {
            let by_forces: Complex<f64> = (0..LEGS).map(|k| plant[(i, k)] * c[sensors + k]).sum();
            (c[i] - by_forces).norm_sqr()
        };
        let square: f64 = all.map(residual).sum();
        square / (averages * (averages - 1).max(1)) as f64
    });
    let by_force = inverse.map(|x| x.norm_sqr());
    let mut error = 0.0_f64;
    let mut expected = 0.0_f64;
    for first in (0..sensors).step_by(LEGS) {
        let whole = model.rows(first, LEGS).map(|x| x.norm_sqr()).sum();
        let off = (plant.rows(first, LEGS) - model.rows(first, LEGS)).map(|x| x.norm_sqr());
        let by_noise = scatter.rows(first, LEGS) * by_force;
        error = error.max((off.sum() / whole).sqrt());
        expected = expected.max((by_noise.sum() / whole).sqrt());
    }
    let coherence = (0..LEGS)
        .map(|j| {
            let all = &experiments[j].spectra[line];
            // Of the sensor with the highest coherence: others may not respond to this
            // leg.
            (0..sensors)
                .map(|i| {
                    let cross: Complex<f64> =
                        all.iter().map(|c| c[i] * c[sensors + j].conj()).sum();
                    let power = |k: usize| all.iter().map(|c| c[k].norm_sqr()).sum::<f64>();
                    cross.norm_sqr() / (power(i) * power(sensors + j))
                })
                .fold(0.0, f64::max)
        })
        .fold(1.0, f64::min);
    let sensitivity = closed.then(|| {
        let r = Matrix6::from_fn(|i, j| {
            if i == j {
                experiments[j].injected[line]
            } else {
                Complex::ZERO
            }
        });
        let measured = r
            .try_inverse()
            .map_or_else(Matrix6::zeros, |inverse| u * inverse);
        let difference = Matrix6::identity() - law.response(z) * &model;
        let predicted = difference.try_inverse().unwrap_or_else(Matrix6::zeros);
        [measured, predicted].map(|s| s.singular_values().max())
    });
    let pairs = |m: &dyn Fn(usize, usize) -> Complex<f64>| {
        (0..sensors)
            .map(|i| core::array::from_fn(|j| [m(i, j).re, m(i, j).im]))
            .collect()
    };
    Some(MeasuredLine {
        hz,
        plant: pairs(&|i, j| plant[(i, j)]),
        model: pairs(&|i, j| model[(i, j)]),
        error,
        expected_error: expected,
        coherence,
        sensitivity,
    })
}
