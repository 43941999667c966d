//! Which frequencies a pass measures, and with what forces.

use core::f64::consts::{PI, TAU};

use nalgebra::{Complex, Matrix6};
use rustfft::FftPlanner;
use shared::LEGS;
use shared::codes::Calibration;
use shared::injection::{FADE, Injection, Signal};
use shared::link::Request;
use shared::multisine::{BLOCK, FEWEST, LINES, Line, WINDOWS};
use shared::table::{Table, ValidTable};

use super::{FrfError, RationalFit, Resonance, setting};
use crate::control::LinearLaw;
use crate::control::supervision::sensor_noise;
use crate::design::Study;
use crate::numeric::exposure::about_mean;
use crate::plant::Gain;

/// Largest part of a leg's force limit that the test signal may reach, with the loop open and closed:
/// where it begins and ends, the soft machine that a closed loop makes swings, and the forces against
/// that are several times those of the signal.
const PART_OF_LIMIT: [f64; 2] = [0.5, 0.1];

/// Largest part of the ADC's range that the response of a sensor may reach: its transient
/// can be as large again, the floor moves the machine too, and its damping may be lower.
const PART_OF_RANGE: f64 = 1.0 / 3.0;

/// Largest part of a ratio of the supervisor that the responses of the sensors may reach.
const PART_OF_RATIO: f64 = 0.9;

/// Length of a window of the first pass, s, up to a factor of √2; those of the second are twice as
/// long.
const WINDOW: f64 = 3.3;

/// Smallest distance between two lines, turns in a window: nearer ones are in each other's window.
const APART: u32 = 2;

/// Schroeder's phase of line `k` of `count`, rad, as on the board.
fn schroeder(k: usize, count: usize) -> f64 {
    -PI * (k * k) as f64 / count as f64
}

/// The lines that are measured at once, and their windows.
#[derive(Clone, Debug, PartialEq)]
pub struct Pass {
    /// Length of a window, as a power of two of samples.
    pub window: u8,
    /// Turns in a window, ascending.
    pub turns: Vec<u32>,
    /// Amplitude of each line, N.
    pub amplitudes: Vec<f64>,
    /// The sample rate, Hz.
    rate: f64,
}

impl Pass {
    /// Samples in a window.
    pub fn samples(&self) -> u32 {
        1 << self.window
    }

    /// Frequencies of the lines, Hz.
    pub fn hertz(&self) -> Vec<f64> {
        let turns = self.turns.iter();
        turns.map(|turns| self.hz(f64::from(*turns))).collect()
    }

    fn hz(&self, turns: f64) -> f64 {
        turns * self.rate / f64::from(self.samples())
    }

    /// The largest force that the sum of the lines could ever have, N.
    pub fn force(&self) -> f64 {
        self.amplitudes.iter().sum()
    }

    /// The request that sets the lines.
    pub fn lines(&self) -> Request {
        let lines = self.turns.iter().zip(&self.amplitudes);
        let lines = lines.map(|(turns, amplitude)| Line {
            turns: *turns,
            amplitude: *amplitude as f32,
        });
        Request::Multisine(self.window, lines.collect())
    }

    /// The signal in one leg for so many samples.
    pub fn injection(&self, leg: usize, samples: u32) -> Injection {
        let mut legs = [0.0; LEGS];
        legs[leg] = 1.0;
        Injection {
            signal: Signal::Multisine,
            legs,
            samples,
        }
    }

    /// The injected force at a line, N: X of Re(X·e^(jωt)).
    pub fn injected(&self, line: usize) -> Complex<f64> {
        let phase = schroeder(line, self.turns.len()) - 0.5 * PI;
        Complex::from_polar(self.amplitudes[line], phase)
    }

    /// Windows at `rate`, Hz, that last `factor` as long as those of the first pass, for `band`, Hz.
    fn with_windows(rate: f64, factor: f64, band: [f64; 2]) -> Self {
        let [shortest, longest] = WINDOWS.map(f64::from);
        let window = (WINDOW * rate).log2().round() + factor.log2();
        // So long that the lowest frequency has enough turns.
        let needed = (f64::from(FEWEST) * rate / band[0]).log2().ceil();
        let window = if factor > 1.0 {
            window.max(needed)
        } else {
            window
        };
        Self {
            window: window.clamp(shortest, longest) as u8,
            turns: Vec::new(),
            amplitudes: Vec::new(),
            rate,
        }
    }

    /// Adds a line near `hz`, if there is room for it.
    fn add(&mut self, hz: f64, band: [f64; 2]) {
        let turns = (hz / self.hz(1.0)).round() as u32;
        let [low, high] = band.map(|hz| hz / self.hz(1.0));
        let range = (low.floor() as u32).max(FEWEST)..=high.ceil() as u32;
        let is_free = self
            .turns
            .iter()
            .all(|other| turns.abs_diff(*other) >= APART);
        if self.turns.len() < LINES && range.contains(&turns) && is_free {
            self.turns.push(turns);
        }
    }

    /// Fills up with lines at equal ratios of frequency; where they would be too near to each other,
    /// the others are closer.
    fn fill(&mut self, [low, high]: [f64; 2]) {
        for count in LINES..=4 * LINES {
            let mut filled = self.clone();
            for k in 0..count {
                let part = k as f64 / (count - 1) as f64;
                filled.add(low * (high / low).powf(part), [low, high]);
            }
            if filled.turns.len() == LINES || count == 4 * LINES {
                self.turns = filled.turns;
                break;
            }
        }
        self.turns.sort_unstable();
    }

    /// The first pass: over the whole `band`, Hz, as far as its windows are long enough.
    ///
    /// # Errors
    /// If the board's rate is too low for the band, or all of the band is too low for the windows.
    pub fn first(rate: f64, band: [f64; 2]) -> Result<Self, FrfError> {
        let mut pass = Self::with_windows(rate, 1.0, band);
        let [lowest, highest] = pass.range();
        if band[1] > highest {
            return Err(setting(
                "to",
                format!("be at most {highest:.1} Hz on this board"),
            ));
        }
        if band[1] < lowest {
            return Err(setting(
                "to",
                format!("be at least {lowest:.2} Hz on this board"),
            ));
        }
        pass.fill([band[0].max(lowest), band[1]]);
        Ok(pass)
    }

    /// The second pass: around the `resonances` found in the first one, and as many lines over the whole
    /// band as there is room for.
    ///
    /// # Errors
    /// If a window would be too long for the lowest frequency.
    pub fn second(rate: f64, band: [f64; 2], resonances: &[Resonance]) -> Result<Self, FrfError> {
        let mut pass = Self::with_windows(rate, 2.0, band);
        let [lowest, _] = pass.range();
        if band[0] < lowest {
            return Err(setting(
                "from",
                format!("be at least {lowest:.2} Hz on this board"),
            ));
        }
        // The narrow ones first: each has a line at its peak before any has others beside it.
        let width = |resonance: &Resonance| resonance.hz * resonance.damping;
        let mut resonances = resonances.to_vec();
        resonances.sort_by(|a, b| width(a).total_cmp(&width(b)));
        for resonance in &resonances {
            pass.add(resonance.hz, band);
        }
        for resonance in &resonances {
            let beside = pass.hz(f64::from(APART)).max(width(resonance));
            pass.add(resonance.hz - beside, band);
            pass.add(resonance.hz + beside, band);
        }
        pass.fill(band);
        Ok(pass)
    }

    /// A frequency that every pass on a board with this sample `rate`, Hz, can reach: Hz.
    pub fn reach(rate: f64) -> f64 {
        0.99 * rate / f64::from(2 * BLOCK)
    }

    /// Lowest and highest frequency of these windows, Hz.
    fn range(&self) -> [f64; 2] {
        let most = self.samples() / (2 * BLOCK) - 1;
        [FEWEST, most].map(|turns| self.hz(f64::from(turns)))
    }

    /// Sets the amplitudes. Their ratios are those with which the sum of the squares of the relative
    /// errors is least, if all together may use as much of the force limit as of the ranges of the
    /// sensors that answer most. And all are the largest with which, by `responses` for each
    /// leg in turn,
    ///
    /// - the sum stays within the force limit, and the forces of all legs within half of it at any
    ///   time; with the loop closed, within a fifth and a tenth;
    /// - every sensor stays within a third of the ADC's range, also where the signal fades in and out;
    /// - with the loop closed, the rms of the forces stays below `level`, from which growth is a
    ///   fault;
    /// - with the loop closed, the rms of every sensor in the supervisor's windows, with its noise and
    ///   the floor of `[simulation]`, stays within 0.9 times the ratios `wild` and `dull` to the median of its
    ///   kind. At any amplitude, if the responses alone do.
    ///
    /// `most` is the largest sum of them, N; none for the force limit.
    pub fn set_amplitudes(
        &mut self,
        study: &Study,
        table: &ValidTable,
        responses: &[Response],
        most: Option<f64>,
    ) {
        let t = table.get();
        // What an amplitude of 1 N takes of the force limit, the same for each line, and of the range.
        let of_limit = 1.0 / force_limit(t);
        let of_range: Vec<_> = responses
            .iter()
            .map(|response| response.of_range(t))
            .collect();
        let squares: Vec<_> = responses
            .iter()
            .map(|response| response.noise(study).powi(2))
            .collect();
        let weighted = |force: f64| -> Vec<f64> {
            let parts = of_range.iter().zip(&squares);
            parts
                .map(|(range, square)| (square / (force * of_limit + (1.0 - force) * range)).cbrt())
                .collect()
        };
        // The more forces weigh, the less of them is used.
        let [mut low, mut high] = [1e-9_f64, 1.0 - 1e-9];
        while high - low > 1e-9 * low {
            let middle = (low * high).sqrt();
            let used = weighted(middle);
            let limit = of_limit * used.iter().sum::<f64>();
            let range: f64 = used.iter().zip(&of_range).map(|(x, range)| x * range).sum();
            if limit > range {
                low = middle;
            } else {
                high = middle;
            }
        }
        let shape = weighted(low);
        let whole: f64 = shape.iter().sum();
        let shape: Vec<f64> = shape.iter().map(|size| size / whole).collect();
        let most = most.unwrap_or_else(|| self.largest(study, table, responses, &shape));
        // Rounded down: as sums of single precision, too, they are within the limit.
        self.amplitudes = shape.iter().map(|size| 0.999_99 * most * size).collect();
    }

    /// The largest sum of amplitudes of this `shape`, N.
    fn largest(
        &self,
        study: &Study,
        table: &ValidTable,
        responses: &[Response],
        shape: &[f64],
    ) -> f64 {
        let machine = study.machine();
        let board = &machine.board;
        let t = table.get();
        let closed = responses.iter().any(|response| response.closed);
        let part = PART_OF_LIMIT[usize::from(closed)];
        let mut most = 2.0 * part * force_limit(t);
        // What is slow fades in and out as a ramp, up to the largest value in that time; a signal ends
        // where its windows begin. Of the answer to a jump, a ramp of the time T leaves
        // sin(πfT)/(πfT) in a mode at f.
        let slowest = study.model().modes().hertz()[0].max(0.0);
        let turns = slowest * f64::from(FADE) / board.sample_rate;
        let value = |at: u32| -> f64 {
            let lines = self.turns.iter().zip(shape).enumerate();
            let part = |(k, (turns, size)): (usize, (&u32, &f64))| {
                let turn = f64::from(*turns) * f64::from(at) / f64::from(self.samples());
                size * (TAU * turn + schroeder(k, shape.len())).sin()
            };
            lines.map(part).sum()
        };
        let highest = (0..=FADE).map(|at| value(at).abs()).fold(0.0, f64::max);
        let faded = highest / (PI * turns).max(1.0);
        // Four points in the shortest turn.
        let length = self.samples() / 4;
        let inverse = FftPlanner::new().plan_fft_inverse(length as usize);
        // Peak of the response to the multisine with amplitudes of this shape.
        let peak = |of: &dyn Fn(&Response) -> Complex<f64>| {
            let mut wave = vec![Complex::ZERO; length as usize];
            for (k, response) in responses.iter().enumerate() {
                let phase = schroeder(k, responses.len());
                wave[self.turns[k] as usize] = of(response) * Complex::from_polar(shape[k], phase);
            }
            inverse.process(&mut wave);
            wave.iter().map(|x| x.im.abs()).fold(0.0, f64::max)
        };
        let sum = |of: &dyn Fn(&Response) -> f64| {
            let parts = responses.iter().zip(shape);
            parts
                .map(|(response, size)| size.powi(2) * of(response))
                .sum::<f64>()
        };
        // The variance of the floor in a part of the band for each line.
        let [low, high] = machine.simulation.floor_band;
        let floor = machine.simulation.floor_rms.powi(2) / responses.len() as f64;
        for leg in 0..LEGS {
            for i in 0..LEGS {
                let push = peak(&|response| response.forces[(i, leg)]);
                most = most.min(part * force_limit(t) / push);
                if closed {
                    let rms = sum(&|response| 0.5 * response.forces[(i, leg)].norm_sqr()).sqrt();
                    most = most.min(f64::from(t.supervision.level) * force_limit(t) / rms);
                }
            }
            for (kind, sensor) in board.fed_back().enumerate() {
                let rows: [usize; LEGS] = core::array::from_fn(|i| kind * LEGS + i);
                for i in rows {
                    // Far above the resonances, the answer is that to a jump of the force.
                    if let Some(fastest) = responses.last() {
                        let ramp = faded * fastest.sensors[(i, leg)].norm();
                        most = most.min(PART_OF_RANGE * range(t, calibration(t, i)) / ramp);
                    }
                    let motion = peak(&|response| response.sensors[(i, leg)]);
                    most = most.min(PART_OF_RANGE * range(t, calibration(t, i)) / motion);
                }
                let noise = sensor_noise(board, sensor);
                // Variances by floor and noise, and by a sum of amplitudes of 1 N.
                let variances = rows.map(|i| {
                    let by_floor = responses.iter().map(|response| {
                        let row: f64 = response.floor.row(i).iter().map(|x| x.norm_sqr()).sum();
                        let within = response.hz >= low && response.hz <= high;
                        if within {
                            floor * response.weight * row
                        } else {
                            0.0
                        }
                    });
                    let by_leg = |response: &Response| {
                        0.5 * response.weight * response.sensors[(i, leg)].norm_sqr()
                    };
                    [noise.powi(2) + by_floor.sum::<f64>(), sum(&by_leg)]
                });
                // Noise and floor alone may be unlike, too: then no amplitude helps. With the loop
                // open, they are not compared during a test signal.
                let least = if closed { 1e-3 * most } else { most };
                let at = |most: f64| variances.map(|[rest, own]| rest + most.powi(2) * own);
                while most > least && !is_plausible(t, at(most)) {
                    most *= 0.9;
                }
            }
        }
        most
    }
}

/// Responses at a line.
pub struct Response {
    hz: f64,
    /// Whether the loop is closed.
    closed: bool,
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

impl Response {
    /// At `hz` with the law of the closed loop, none with the loop open; of the `plant` from forces
    /// to sensors, and the model's floor.
    fn new(
        study: &Study,
        table: &ValidTable,
        law: Option<&LinearLaw>,
        hz: f64,
        plant: &Gain,
    ) -> Self {
        let t = table.get();
        let window = f64::from(t.supervision.window) / f64::from(t.sample_rate);
        let response = study.plant().response(hz);
        let rows = 0..plant.nrows();
        let (forces, floor) = match law {
            Some(law) => {
                let z = study.plant().z(hz);
                let floor = response.close(rows, &law.response(z));
                (sensitivity(law, z, plant), floor)
            }
            None => (Matrix6::identity(), response.from_floor(rows)),
        };
        Self {
            hz,
            closed: law.is_some(),
            forces,
            sensors: plant * forces,
            floor: floor * study.plant().plant.base_at(hz).map(Complex::from),
            weight: about_mean(hz, window),
        }
    }

    /// The largest answer of a sensor to a newton in any leg, as a part of its range, 1/N.
    fn of_range(&self, table: &Table) -> f64 {
        let rows = self.sensors.row_iter().enumerate();
        rows.map(|(i, row)| {
            let most = row.iter().map(|x| x.norm()).fold(0.0, f64::max);
            most / range(table, calibration(table, i))
        })
        .fold(0.0, f64::max)
    }

    /// The noise of the sensors as a force in the legs, relative to the others: floor and sensors; the
    /// larger value of the two kinds.
    fn noise(&self, study: &Study) -> f64 {
        let machine = study.machine();
        let kinds = machine.board.fed_back().enumerate();
        kinds
            .map(|(kind, sensor)| {
                let rows = |gain: &Gain| gain.rows(kind * LEGS, LEGS).norm_squared();
                let own = sensor_noise(&machine.board, sensor).powi(2);
                let own = LEGS as f64 * own / (0.5 * machine.board.sample_rate);
                // Also beyond its band, whose edges are not sharp.
                let [low, high] = machine.simulation.floor_band;
                let floor = machine.simulation.floor_rms.powi(2) / (high - low);
                ((own + floor * rows(&self.floor)) / rows(&self.sensors)).sqrt()
            })
            .fold(0.0, f64::max)
    }

    /// Those of the model at `hertz`.
    pub fn of_model(
        study: &Study,
        table: &ValidTable,
        law: Option<&LinearLaw>,
        hertz: &[f64],
    ) -> Vec<Self> {
        let at = |hz: &f64| Self::new(study, table, law, *hz, &study.plant().response(*hz).g22());
        hertz.iter().map(at).collect()
    }

    /// Those of a fitted plant at `hertz`.
    pub fn of_fit(
        study: &Study,
        table: &ValidTable,
        law: Option<&LinearLaw>,
        hertz: &[f64],
        fit: &RationalFit,
    ) -> Vec<Self> {
        let at = |hz: &f64| Self::new(study, table, law, *hz, &fit.at(*hz));
        hertz.iter().map(at).collect()
    }
}

/// The smallest force limit of a leg, N.
pub fn force_limit(table: &Table) -> f64 {
    let limits = table.actuators.iter().map(|drive| f64::from(drive.limit));
    limits.fold(f64::INFINITY, f64::min)
}

/// Calibration of a sensor; from [`LEGS`] on, of those used beside the table's.
pub fn calibration(table: &Table, sensor: usize) -> Calibration {
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
pub fn sensitivity(law: &LinearLaw, z: Complex<f64>, plant: &Gain) -> Matrix6<Complex<f64>> {
    let difference = Matrix6::identity() - law.response(z) * plant;
    let infinite = || Matrix6::repeat(Complex::from(f64::INFINITY));
    difference.try_inverse().unwrap_or_else(infinite)
}
