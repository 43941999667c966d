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
use shared::codes::Calibration;
use shared::controller::ControllerReport;
use shared::injection::{Injection, Injector, LONGEST, Next, PERIOD, Signal};
use shared::link::Request;
use shared::recorder::{Record, Recorded, Recording, Trigger};
use shared::supervisor::{Cause, Mode};
use shared::table::{Table, ValidTable};

use super::link::{Client, LinkError};
use super::words::cause;
use crate::control::LinearLaw;
use crate::control::supervision::sensor_noise;
use crate::design::Study;
use crate::numeric::exposure::about_mean;
use crate::plant::Gain;
use crate::progress::Progress;

/// Settings of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct MeasurementSettings {
    /// Samples in a period of the multisine: a power of two, at least [`SHORTEST`].
    pub period: u32,
    /// Number of periods that are averaged, at least [`FEWEST`].
    pub averages: u32,
    /// Periods to wait until transients have died out.
    pub settling: u32,
    /// Amplitude of each sine, N. None for that of [`amplitude`].
    pub amplitude: Option<f64>,
}

/// Shortest period of a measurement, samples: the multisine's lines lie below half of it.
pub const SHORTEST: u32 = 512;

/// Smallest number of averages: coherence and expected error come from their scatter.
pub const FEWEST: u32 = 2;

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

/// A measurement.
#[derive(Clone, Debug, Serialize)]
pub struct Measurement {
    /// Amplitude of each sine, N.
    pub amplitude: f64,
    /// The results, in ascending order of their frequency.
    pub lines: Vec<MeasuredLine>,
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
        /// Amplitude of each sine, N.
        amplitude: f64,
    },
    /// The loop was opened or closed during the measurement.
    #[error("leg {leg}: the loop was opened or closed during the measurement")]
    Changed {
        /// Number of the leg with the test signal, from 1.
        leg: usize,
    },
    /// The test signal ended before its windows, again and again.
    #[error("leg {leg}: the link is too slow: the test signal ends before it is recorded")]
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
    /// The recorded forces do not contain the multisine.
    #[error(
        "leg {leg}: the recorded forces do not contain the injected signal; --amplitude is too low, or the leg is at its limit"
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
            "; the amplitude of {amplitude:.3} N was too high for this machine: clear the fault, repeat the self-test and use a lower --amplitude"
        ),
        _ => String::new(),
    }
}

/// Largest part of a leg's force limit that the test signal, and what the loop adds to it,
/// may reach.
const PART_OF_LIMIT: f64 = 0.5;

/// Largest part of the ADC's range that the response of a sensor may reach: its transient
/// can be as large again, the floor moves the machine too, and its damping may be lower.
const PART_OF_RANGE: f64 = 1.0 / 3.0;

/// Largest part of a ratio of the supervisor that the responses of the sensors may reach.
const PART_OF_RATIO: f64 = 0.9;

/// The default amplitude of each sine, N: the largest with which, as the model predicts for
/// each leg in turn,
///
/// - the sines together stay within half the force limit, and with the loop closed also the
///   forces of all legs;
/// - with the loop closed, the rms of the forces stays below `level`, from which growth is a
///   fault;
/// - every sensor stays within a third of the ADC's range;
/// - the rms of every sensor in the supervisor's windows, with its noise and the floor of
///   `[simulation]`, stays within 0.9 times the ratios `wild` and `dull` to the median of its
///   kind. At any amplitude, if the responses alone do.
///
/// It is rounded down to two digits. `law` is that of the closed loop, none with the loop
/// open; `period` is that of the multisine, samples.
pub fn amplitude(study: &Study, table: &ValidTable, law: Option<&LinearLaw>, period: u32) -> f64 {
    let machine = study.machine();
    let board = &machine.board;
    let t = table.get();
    let rate = f64::from(t.sample_rate);
    let mut most = PART_OF_LIMIT * force_limit(t) / f64::from(COUNT);
    let lines: Vec<_> = (0..COUNT)
        .map(|line| {
            let hz = rate * f64::from(FIRST + APART * line) / f64::from(period);
            Line::new(study, law, hz, f64::from(t.supervision.window) / rate)
        })
        .collect();
    let inverse = FftPlanner::new().plan_fft_inverse(period as usize);
    // Peak of the response to the multisine with sines of 1 N.
    let peak = |of: &dyn Fn(&Line) -> Complex<f64>| {
        let mut wave = vec![Complex::ZERO; period as usize];
        for (k, line) in lines.iter().enumerate() {
            let schroeder = -core::f64::consts::PI * (k * k) as f64 / f64::from(COUNT);
            wave[FIRST as usize + APART as usize * k] = of(line) * Complex::cis(schroeder);
        }
        inverse.process(&mut wave);
        wave.iter().map(|x| x.im.abs()).fold(0.0, f64::max)
    };
    let sum = |of: &dyn Fn(&Line) -> f64| lines.iter().map(of).sum::<f64>();
    // Density of the floor along each axis, times the distance of the lines.
    let [low, high] = machine.simulation.floor_band;
    let apart = rate * f64::from(APART) / f64::from(period);
    let floor = machine.simulation.floor_rms.powi(2) / (high - low) * apart;
    for leg in 0..LEGS {
        if law.is_some() {
            for i in 0..LEGS {
                let push = peak(&|line| line.forces[(i, leg)]);
                most = most.min(PART_OF_LIMIT * force_limit(t) / push);
                let rms = sum(&|line| 0.5 * line.forces[(i, leg)].norm_sqr()).sqrt();
                most = most.min(f64::from(t.supervision.level) * force_limit(t) / rms);
            }
        }
        for (kind, sensor) in board.fed_back().enumerate() {
            let rows: [usize; LEGS] = core::array::from_fn(|i| kind * LEGS + i);
            for i in rows {
                let motion = peak(&|line| line.sensors[(i, leg)]);
                most = most.min(PART_OF_RANGE * range(t, calibration(t, i)) / motion);
            }
            let noise = sensor_noise(board, sensor);
            // Variances by floor and noise, and by sines of 1 N.
            let variances = rows.map(|i| {
                let by_floor = |line: &Line| {
                    let row: f64 = line.floor.row(i).iter().map(|x| x.norm_sqr()).sum();
                    let within = line.hz >= low && line.hz <= high;
                    if within { line.weight * row } else { 0.0 }
                };
                let by_leg = |line: &Line| 0.5 * line.weight * line.sensors[(i, leg)].norm_sqr();
                [noise.powi(2) + floor * sum(&by_floor), sum(&by_leg)]
            });
            // Noise and floor alone may be unlike, too: then no amplitude helps.
            let least = 1e-3 * most;
            let at = |most: f64| variances.map(|[rest, own]| rest + most.powi(2) * own);
            while most > least && !is_plausible(t, at(most)) {
                most *= 0.9;
            }
        }
    }
    let digit = 10.0_f64.powf(most.log10().floor() - 1.0);
    let rounded = (most / digit).floor() * digit;
    // Without the rounding errors of the product.
    format!("{rounded:.1e}").parse().unwrap_or(rounded)
}

/// Unit responses of the model at one frequency.
struct Line {
    hz: f64,
    /// From injected forces to leg forces.
    forces: Matrix6<Complex<f64>>,
    /// From injected forces to sensors.
    sensors: Gain,
    /// From the motions of the base to sensors.
    floor: Gain,
    /// Part of a sine's variance that is left about the mean of one of the supervisor's
    /// windows.
    weight: f64,
}

impl Line {
    /// At `hz`, for windows of `window` seconds.
    fn new(study: &Study, law: Option<&LinearLaw>, hz: f64, window: f64) -> Self {
        let response = study.plant().response(hz);
        let plant = response.g22();
        let rows = 0..plant.nrows();
        let (forces, floor) = match law {
            Some(law) => {
                let z = study.plant().z(hz);
                let floor = response.close(rows, &law.response(z));
                (sensitivity(law, z, &plant), floor)
            }
            None => (Matrix6::identity(), response.from_floor(rows)),
        };
        Self {
            hz,
            forces,
            sensors: plant * forces,
            floor: floor * study.plant().plant.base.map(Complex::from),
            weight: about_mean(hz, window),
        }
    }
}

/// The smallest force limit of a leg, N.
fn force_limit(table: &Table) -> f64 {
    let limits = table.actuators.iter().map(|drive| f64::from(drive.limit));
    limits.fold(f64::INFINITY, f64::min)
}

/// Calibration of a sensor; from [`LEGS`] on, of those used beside the table's.
fn calibration(table: &Table, sensor: usize) -> Calibration {
    match (sensor.checked_sub(LEGS), table.complement()) {
        (Some(i), Some(complement)) => complement.sensors[i],
        _ => table.sensors[sensor % LEGS],
    }
}

/// The value at which a sensor is at an end of the ADC's range, the nearer one, m/s² or N.
fn range(table: &Table, calibration: Calibration) -> f64 {
    let codes = f64::from(table.adc_max.0) - f64::from(calibration.zero).abs();
    codes.max(0.0) * f64::from(calibration.gain).abs()
}

/// Whether the supervisor would find sensors of a kind with these variances alike.
fn is_plausible(table: &Table, mut variances: [f64; LEGS]) -> bool {
    variances.sort_unstable_by(f64::total_cmp);
    let median = 0.5 * (variances[2] + variances[3]);
    let [wild, dull] = [table.supervision.wild, table.supervision.dull]
        .map(|ratio| (PART_OF_RATIO * f64::from(ratio)).powi(2));
    variances[5] <= wild * median && median <= dull * variances[0]
}

/// The sensitivity at the legs, (1 − C·G)⁻¹; infinite at an undamped pole.
fn sensitivity(law: &LinearLaw, z: Complex<f64>, plant: &Gain) -> Matrix6<Complex<f64>> {
    let difference = Matrix6::identity() - law.response(z) * plant;
    let infinite = || Matrix6::repeat(Complex::from(f64::INFINITY));
    difference.try_inverse().unwrap_or_else(infinite)
}

/// One experiment: the multisine in one leg.
struct Experiment {
    /// Spectra by line, by average and by channel: sensors, then forces.
    spectra: Vec<Vec<Vec<Complex<f64>>>>,
    /// Spectrum of the injected force by line, with the window and the phase reference of
    /// `spectra`.
    injected: Vec<Complex<f64>>,
}

/// What the experiments of a measurement have in common.
struct Course<'a> {
    table: &'a ValidTable,
    settings: MeasurementSettings,
    /// Amplitude of each sine, N.
    amplitude: f64,
    /// The mode in which the board stays during the measurement.
    mode: Mode,
    fft: Arc<dyn Fft<f64>>,
    progress: &'a dyn Progress,
}

/// Measures the plant, and with the loop closed also the sensitivity, and compares them
/// with those of `study` with `table`. `progress` is called after each averaged period.
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
    let identity = client.identity()?;
    if identity.checksum != table.checksum() {
        return Err(FrfError::OtherTable);
    }
    if settings.period > identity.room {
        let must = format!(
            "be at most {}, the records in the board's recorder",
            identity.room
        );
        return Err(setting("period", must));
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
    let limit = force_limit(table.get()) / f64::from(COUNT);
    let amplitude = settings
        .amplitude
        .unwrap_or_else(|| amplitude(study, table, law.as_ref(), settings.period));
    if amplitude > limit {
        let must = format!(
            "be at most {limit:.3} N: {COUNT} sines together must not exceed the force limit of a leg"
        );
        return Err(setting("amplitude", must));
    }
    let course = Course {
        table,
        settings: *settings,
        amplitude,
        mode: report.mode,
        fft: FftPlanner::new().plan_fft_forward(settings.period as usize),
        progress,
    };
    let mut transfer = 0;
    let mut experiments = Vec::new();
    for leg in 0..LEGS {
        experiments.push(course.experiment(client, leg, &mut transfer)?);
    }
    let rate = f64::from(table.get().sample_rate);
    let lines = (0..COUNT as usize).filter_map(|line| {
        let turns = FIRST + APART * line as u32;
        let hz = rate * f64::from(turns) / f64::from(settings.period);
        evaluate(study, law.as_ref(), &experiments, line, hz)
    });
    Ok(Measurement {
        amplitude,
        lines: lines.collect(),
    })
}

fn setting(option: &'static str, must: impl Into<String>) -> FrfError {
    FrfError::Setting {
        option,
        must: must.into(),
    }
}

impl MeasurementSettings {
    /// Checks the settings as far as they do not depend on a board.
    ///
    /// # Errors
    /// [`FrfError::Setting`] with the first one that is out of range.
    pub fn check(&self) -> Result<(), FrfError> {
        if !self.period.is_power_of_two() || self.period < SHORTEST {
            let must = format!("be a power of two and at least {SHORTEST}");
            return Err(setting("period", must));
        }
        if self.period > PERIOD {
            return Err(setting("period", format!("be at most {PERIOD}")));
        }
        if self.averages < FEWEST {
            let must = format!(
                "be at least {FEWEST}: coherence and expected error come from the scatter of the averages"
            );
            return Err(setting("averages", must));
        }
        let longest = LONGEST / self.period;
        if u64::from(self.settling) + u64::from(self.averages) > u64::from(longest) {
            let must = format!(
                "with --averages be at most {longest} periods together, the longest test signal"
            );
            return Err(setting("settling", must));
        }
        if self.amplitude.is_some_and(|n| !(n.is_finite() && n > 0.0)) {
            return Err(setting("amplitude", "be above 0 N and finite"));
        }
        Ok(())
    }
}

/// Number of test signals in succession that may end before their first window.
const TRIALS: usize = 5;

impl Course<'_> {
    /// Injects the multisine into `leg` and records its windows. `transfer` is the longest
    /// time from the end of a window to the start of the next one so far, samples.
    fn experiment(
        &self,
        client: &mut Client,
        leg: usize,
        transfer: &mut u64,
    ) -> Result<Experiment, FrfError> {
        let mut spectra = vec![Vec::new(); COUNT as usize];
        let windows = self.windows(client, leg, transfer, &mut spectra);
        // However the windows ended, also without a link that answers.
        let ended = client.end_injection();
        windows?;
        ended?;
        self.well(client.report()?, leg)?;
        let there = spectra.iter().flatten();
        if !there
            .into_iter()
            .all(|c| c[c.len() - LEGS + leg].norm() > 0.0)
        {
            return Err(FrfError::Nothing { leg: leg + 1 });
        }
        Ok(Experiment {
            spectra,
            injected: self.injected(leg),
        })
    }

    fn injection(&self, leg: usize, samples: u32) -> Injection {
        let mut legs = [0.0; LEGS];
        legs[leg] = self.amplitude as f32;
        Injection {
            signal: multisine(self.settings.period),
            legs,
            samples,
        }
    }

    /// Fails if the board has a fault or has changed its mode.
    fn well(&self, report: ControllerReport, leg: usize) -> Result<ControllerReport, FrfError> {
        let leg = leg + 1;
        match report.fault {
            Some(fault) => Err(FrfError::Fault {
                leg,
                why: fault.cause,
                amplitude: self.amplitude,
            }),
            None if report.mode != self.mode => Err(FrfError::Changed { leg }),
            None => Ok(report),
        }
    }

    /// Records the windows of a leg. The test signal lasts as long as they should take; if
    /// that was not enough, another one follows for those that are missing.
    fn windows(
        &self,
        client: &mut Client,
        leg: usize,
        transfer: &mut u64,
        spectra: &mut [Vec<Vec<Complex<f64>>>],
    ) -> Result<(), FrfError> {
        let period = u64::from(self.settings.period);
        let settling = period * u64::from(self.settings.settling);
        let mut left = u64::from(self.settings.averages);
        let mut trials = 0;
        while left > 0 {
            if trials == TRIALS {
                return Err(FrfError::Slow { leg: leg + 1 });
            }
            trials += 1;
            // Half as long again as it took before.
            let needed = settling + left * (period + *transfer + *transfer / 2) + period;
            let samples = u32::try_from(needed).unwrap_or(LONGEST).min(LONGEST);
            client.command(Request::Inject(self.injection(leg, samples)))?;
            let ControllerReport { injected, .. } = client.report()?;
            let end = injected + u64::from(samples);
            let settled = injected + settling;
            let over = |report: &ControllerReport| {
                report.injecting == 0 || report.mode != self.mode || report.fault.is_some()
            };
            let mut report = client.wait_for(|report| report.at >= settled || over(report))?;
            while left > 0 {
                self.well(report, leg)?;
                if report.injecting == 0 || report.at + period > end {
                    break;
                }
                client.command(Request::Record(Recording {
                    trigger: Trigger::Now,
                    before: 0,
                    after: self.settings.period,
                }))?;
                let done = |report: &ControllerReport| {
                    matches!(report.recorded, Recorded::Done { .. } | Recorded::Off)
                };
                let recorded = client.wait_for(|report| done(report) || over(report))?;
                self.well(recorded, leg)?;
                if !done(&recorded) {
                    break;
                }
                let (records, at) = client.recording()?;
                report = client.report()?;
                *transfer = (*transfer).max(report.at.saturating_sub(at + period));
                // Ended by the board meanwhile: not all of the window is of the signal.
                if at + period > end || recorded.injecting == 0 {
                    break;
                }
                let phase = (at - injected) % period;
                let columns = transforms(self.table, &records, &self.fft);
                for (line, spectrum) in spectra.iter_mut().enumerate() {
                    let turns = (FIRST + APART * line as u32) as usize;
                    // Phase relative to the start of the multisine.
                    let turn = turns as f64 * phase as f64 / period as f64;
                    let turn = Complex::cis(-core::f64::consts::TAU * turn);
                    spectrum.push(columns.iter().map(|c| c[turns] * turn).collect::<Vec<_>>());
                }
                self.progress.advance();
                (left, trials) = (left - 1, 0);
            }
        }
        Ok(())
    }

    /// Spectrum of the injected force by line, of one period.
    fn injected(&self, leg: usize) -> Vec<Complex<f64>> {
        let period = self.settings.period;
        let mut memory = vec![[0.0; 2]; period as usize];
        let mut injector = Injector::new(self.table, self.injection(leg, period), None);
        while injector.advance(&mut memory) == Next::Waits {}
        let mut wave: Vec<Complex<f64>> = (0..period)
            .map(|_| {
                let force = injector.forces().0[leg];
                injector.advance(&mut memory);
                Complex::from(f64::from(force))
            })
            .collect();
        windowed(&mut wave);
        self.fft.process(&mut wave);
        (0..COUNT)
            .map(|line| wave[(FIRST + APART * line) as usize])
            .collect()
    }
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
    law: Option<&LinearLaw>,
    experiments: &[Experiment],
    line: usize,
    hz: f64,
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
        square / (averages * (averages - 1)) as f64
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
    let sensitivity = law.map(|law| {
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
        let predicted = sensitivity(law, z, &model);
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
