//! Transfer functions measured in place: a multisine in each leg in turn, and the
//! recorder.
//!
//! With the forces of six experiments as the columns of U and the sensors' answers
//! as those of Y, the plant is G22 = Y·U⁻¹ whether the loop is open or closed. The
//! forces are what the DAC was given, the law's part included; with R what was
//! injected, the sensitivity at the legs is U·R⁻¹.

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

/// How to measure.
#[derive(Clone, Copy, Debug)]
pub struct MeasurementSettings {
    /// Samples in a period of the multisine, a power of two.
    pub period: u32,
    /// Periods that are averaged.
    pub averages: u32,
    /// Periods until the machine swings as the multisine does.
    pub settling: u32,
    /// Of each sine, N.
    pub amplitude: f64,
}

/// The first sine's turns in a period, those from one sine to the next, and how many:
/// from 5 to 315 Hz at 20 kHz and 8192 samples.
const FIRST: u32 = 2;
const APART: u32 = 2;
const COUNT: u32 = 64;

/// The multisine that is measured with.
pub fn multisine(period: u32) -> Signal {
    Signal::Multisine {
        period,
        first: FIRST,
        apart: APART,
        count: COUNT,
    }
}

/// What was measured at one frequency.
#[derive(Clone, Debug, Serialize)]
pub struct MeasuredLine {
    /// Hz.
    pub hz: f64,
    /// Sensors by legs: G22, unit of the sensor per N, as [re, im].
    pub plant: Vec<[[f64; 2]; LEGS]>,
    /// The model's.
    pub model: Vec<[[f64; 2]; LEGS]>,
    /// Largest singular value of the difference over that of the model, each kind
    /// of sensors by itself, the worse.
    pub error: f64,
    /// What the scatter of the averages makes one expect of it, root mean square.
    pub expected_error: f64,
    /// The lowest coherence of any sensor with the forces, the worst leg.
    pub coherence: f64,
    /// With the loop closed: largest singular value of the sensitivity at the legs,
    /// measured, and as the model and the table say.
    pub sensitivity: Option<[f64; 2]>,
}

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum FrfError {
    /// The link.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The board runs another table than the one that the machine file gives.
    #[error(
        "the board runs a table of another machine or another version of it; run host-gen generate and flash it"
    )]
    OtherTable,
    /// Neither open nor closed.
    #[error("the loop is neither idle nor closed; see host-gen link status")]
    Mode,
    /// The recorder is too small.
    #[error("the board's recorder has room for {room} records; --period must not be above that")]
    Room {
        /// Records.
        room: u32,
    },
    /// What came back holds nothing of the multisine.
    #[error(
        "leg {leg}: the forces do not hold what was injected; --amplitude is too low or the legs are clamped"
    )]
    Nothing {
        /// From 1.
        leg: usize,
    },
}

/// One experiment: means over the averages of forces, sensors and injection at each
/// line, and powers for the coherence.
struct Experiment {
    /// By line and average, all channels: sensors, then forces.
    spectra: Vec<Vec<Vec<Complex<f64>>>>,
    /// By line: what was injected in the leg, N, in the phase of the spectra's
    /// means.
    injected: Vec<Complex<f64>>,
}

/// Measures the plant, and with the loop closed its sensitivity, and lays them
/// over those of `study` under `table`. `progress` is called after every window.
///
/// # Errors
/// Where the board does not let it, or runs something else.
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
    // Long enough whatever the windows in between take; ended when they are done.
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
            // Counted from the multisine's own start.
            let turn = -core::f64::consts::TAU * turns as f64 * phase as f64 / f64::from(period);
            let turn = Complex::cis(turn);
            spectrum.push(columns.iter().map(|c| c[turns] * turn).collect::<Vec<_>>());
        }
    }
    // Nothing, in its place: the loop stays as it is.
    client.command(Request::Inject(Injection {
        legs: [0.0; LEGS],
        samples: 1,
        ..injection
    }))?;
    // One period of what was injected.
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

/// Hann's window: what is slow and strong, as the closed loop's forces are, does
/// not leak into the lines, and no line into one two places on.
fn windowed(column: &mut [Complex<f64>]) {
    let length = column.len() as f64;
    for (k, x) in column.iter_mut().enumerate() {
        *x *= (core::f64::consts::PI * k as f64 / length).sin().powi(2);
    }
}

/// Of sensors, then forces, all in their units.
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
    // The scatter of y − G·u, which is what Y·U⁻¹ is off by where both are noisy.
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
            // Of the sensor that the leg moves most: others may answer nothing.
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
