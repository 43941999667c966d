//! The loop in time: sampled plant, converters with noise, and the very step
//! that the firmware runs.

use core::ops::Range;
use std::collections::VecDeque;

use nalgebra::{Complex, DMatrix, DVectorView};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;
use shared::LEGS;
use shared::codes::{AdcCode, DacCode, Samples};
use shared::step::{Demand, State, step};
use shared::table::ValidTable;

use crate::machine::{Board, Sensor, Simulation};
use crate::plant::{ByInput, SampledPlant, SampledStateSpace};

/// White noise, then two second-order Butterworth filters at the band's ends.
struct BandNoise {
    filters: [Biquad; 2],
    states: [[[f64; 2]; 2]; LEGS],
    scale: f64,
    random: ChaCha8Rng,
}

/// A second-order section, transposed direct form II.
#[derive(Clone, Copy)]
struct Biquad {
    b: [f64; 3],
    a: [f64; 2],
}

impl Biquad {
    /// Butterworth by the bilinear transform, its corner at `hz` exact.
    fn butterworth(hz: f64, period: f64, high_pass: bool) -> Self {
        let k = (core::f64::consts::PI * hz * period).tan();
        let norm = 1.0 / (1.0 + core::f64::consts::SQRT_2 * k + k * k);
        let b0 = if high_pass { norm } else { k * k * norm };
        Self {
            b: [b0, if high_pass { -2.0 * b0 } else { 2.0 * b0 }, b0],
            a: [
                2.0 * (k * k - 1.0) * norm,
                (1.0 - core::f64::consts::SQRT_2 * k + k * k) * norm,
            ],
        }
    }

    fn step(&self, state: &mut [f64; 2], x: f64) -> f64 {
        let y = self.b[0] * x + state[0];
        state[0] = self.b[1] * x - self.a[0] * y + state[1];
        state[1] = self.b[2] * x - self.a[1] * y;
        y
    }
}

impl BandNoise {
    fn new(settings: &Simulation, period: f64, random: ChaCha8Rng) -> Self {
        let [low, high] = settings.floor_band;
        let filters = [
            Biquad::butterworth(low, period, true),
            Biquad::butterworth(high, period, false),
        ];
        // White noise comes out with the root of the impulse response's energy;
        // three periods of the slow corner hold all of it.
        let mut states = [[0.0; 2]; 2];
        let mut energy = 0.0;
        for k in 0..(3.0 / (low * period)).ceil() as usize {
            let mut x = if k == 0 { 1.0 } else { 0.0 };
            for (filter, state) in filters.iter().zip(&mut states) {
                x = filter.step(state, x);
            }
            energy += x * x;
        }
        Self {
            filters,
            states: [[[0.0; 2]; 2]; LEGS],
            scale: settings.floor_rms / energy.sqrt(),
            random,
        }
    }

    fn sample(&mut self) -> [f64; LEGS] {
        core::array::from_fn(|i| {
            let white: f64 = StandardNormal.sample(&mut self.random);
            let mut x = white * self.scale;
            for (filter, state) in self.filters.iter().zip(&mut self.states[i]) {
                x = filter.step(state, x);
            }
            x
        })
    }
}

/// A matrix in blocks of twelve rows, the last one filled up with zeros: what a
/// compiler turns into products of registers.
struct Blocks(Vec<Vec<[f64; BLOCK]>>);

const BLOCK: usize = 12;

impl Blocks {
    fn new(matrix: &DMatrix<f64>) -> Self {
        let block = |first| {
            let entry = |i, j| matrix.get((first + i, j)).map_or(0.0, |x: &f64| *x);
            (0..matrix.ncols())
                .map(|j| core::array::from_fn(|i| entry(i, j)))
                .collect()
        };
        Self((0..matrix.nrows()).step_by(BLOCK).map(block).collect())
    }

    /// `sum` += matrix·`vector`; `sum` in blocks as the matrix.
    fn add_product(&self, vector: &[f64], sum: &mut [[f64; BLOCK]]) {
        for (columns, sum) in self.0.iter().zip(sum) {
            // Two sums, so that one need not wait for the other.
            let mut odd = [0.0; BLOCK];
            let mut columns = columns.chunks_exact(2);
            let mut pairs = vector.chunks_exact(2);
            for (columns, x) in columns.by_ref().zip(pairs.by_ref()) {
                for i in 0..BLOCK {
                    sum[i] += columns[0][i] * x[0];
                    odd[i] += columns[1][i] * x[1];
                }
            }
            for (column, x) in columns.remainder().iter().zip(pairs.remainder()) {
                for i in 0..BLOCK {
                    sum[i] += column[i] * x;
                }
            }
            for i in 0..BLOCK {
                sum[i] += odd[i];
            }
        }
    }
}

/// The machine with its converters: takes DAC codes, gives ADC codes.
pub struct Rig {
    plant: SampledPlant,
    board: Board,
    /// The plant's poles, as [`SampledStateSpace::blocks`].
    poles: Vec<(usize, Complex<f64>, bool)>,
    /// The sensors from the state, then from floor and forces.
    sensors: [Blocks; 2],
    /// The mean performance from the state, and from what happens in a period.
    performance: [Blocks; 2],
    /// The state's change from what happens in a period.
    change: Blocks,
    /// Whether forces take over within a period, and not as it begins.
    within: bool,
    state: Vec<[f64; BLOCK]>,
    performance_now: Vec<[f64; BLOCK]>,
    count: usize,
    /// Forces latched or on their way, the latest first.
    forces: VecDeque<[f64; LEGS]>,
    floor_noise: BandNoise,
    /// Each kind of sensors with the rms of sensor and ADC together, V.
    kinds: Vec<(Sensor, f64)>,
    sensor_noise: ChaCha8Rng,
    output_noise: ChaCha8Rng,
    /// Now and at the next sample.
    floor: [[f64; LEGS]; 2],
    /// Scales the floor from here on; 1 at first.
    pub floor_gain: f64,
    /// Added to the offset of every sensor of either kind from here on, V; 0 at
    /// first.
    pub drift: [f64; LEGS],
}

impl Rig {
    /// At rest, with the floor noise and seed of `settings`.
    pub fn new(plant: SampledPlant, board: &Board, settings: &Simulation) -> Self {
        let SampledStateSpace {
            blocks: poles,
            change,
            output,
            mean,
            mean_by,
        } = plant.state_space();
        let rows = |matrix: &DMatrix<f64>, rows: Range<usize>| matrix.rows_range(rows).into_owned();
        // The forces they take over from come last: often they do not count.
        let within = change.before.amax() > 0.0;
        let in_period = |by: &ByInput| {
            let parts = [&by.now, &by.next, &by.after, &by.before];
            let parts = &parts[..if within { 4 } else { 3 }];
            let columns: Vec<_> = parts.iter().flat_map(|part| part.column_iter()).collect();
            DMatrix::from_columns(&columns)
        };
        let shown = plant.plant.performance();
        let sensed = plant.plant.sensors();
        let stream = |number| {
            let mut random = ChaCha8Rng::seed_from_u64(settings.seed);
            random.set_stream(number);
            random
        };
        // White noise of that density up to half the sample rate.
        let kind = |sensor: Sensor| {
            let rms = sensor.noise_density * (0.5 * board.sample_rate).sqrt();
            (sensor, (rms * sensor.sensitivity).hypot(board.adc_noise))
        };
        let kinds = [Some(board.sensor), board.beside];
        let blank = |rows: usize| vec![[0.0; BLOCK]; rows.div_ceil(BLOCK)];
        Self {
            state: blank(output.ncols()),
            performance_now: blank(shown.len()),
            count: shown.len(),
            poles,
            sensors: [
                Blocks::new(&rows(&output, sensed.clone())),
                Blocks::new(&rows(plant.direct(), sensed)),
            ],
            performance: [
                Blocks::new(&rows(&mean, shown.clone())),
                Blocks::new(&rows(&in_period(&mean_by), shown)),
            ],
            change: Blocks::new(&in_period(&change)),
            within,
            forces: vec![[0.0; LEGS]; plant.seen_delay() + 1].into(),
            floor_noise: BandNoise::new(settings, plant.period, stream(0)),
            kinds: kinds.into_iter().flatten().map(kind).collect(),
            sensor_noise: stream(1),
            output_noise: stream(2),
            floor: [[0.0; LEGS]; 2],
            floor_gain: 1.0,
            drift: [0.0; LEGS],
            board: *board,
            plant,
        }
    }

    /// The plant inside.
    pub fn plant(&self) -> &SampledPlant {
        &self.plant
    }

    /// The next sampling instant: the codes the ADC gives.
    pub fn sample(&mut self) -> Samples {
        let next = self.floor_noise.sample().map(|x| x * self.floor_gain);
        self.floor = [self.floor[1], next];
        let seen = self.forces[self.plant.whole_periods];
        let [from_state, direct] = &self.sensors;
        let mut y = [[0.0; BLOCK]];
        from_state.add_product(self.state.as_flattened(), &mut y);
        direct.add_product([self.floor[0], seen].as_flattened(), &mut y);
        let mut samples = Samples::from([AdcCode(0); LEGS]);
        let codes = [&mut samples.sensors, &mut samples.forces];
        let values = y[0].chunks_exact(LEGS);
        for ((codes, values), (sensor, noise)) in codes.into_iter().zip(values).zip(&self.kinds) {
            for ((code, value), drift) in codes.iter_mut().zip(values).zip(self.drift) {
                let normal: f64 = StandardNormal.sample(&mut self.sensor_noise);
                let offset = sensor.offset + drift;
                *code = self
                    .board
                    .adc
                    .code(value * sensor.sensitivity + offset + noise * normal);
            }
        }
        samples
    }

    /// Latches `dac` in its turn and lets the period pass; gives the means of
    /// the performance accelerations over it, m/s².
    pub fn advance(&mut self, dac: [DacCode; LEGS]) -> DVectorView<'_, f64> {
        let board = &self.board;
        let force = dac.map(|code| {
            let normal: f64 = StandardNormal.sample(&mut self.output_noise);
            board.dac.force(code, board.actuator_gain)
                + board.dac_noise * normal * board.actuator_gain
        });
        self.forces.pop_back();
        self.forces.push_front(force);
        let late = self.plant.whole_periods;
        let [now, next] = self.floor;
        let inputs = [now, next, self.forces[late], self.forces[late + 1]];
        let inputs = inputs[..if self.within { 4 } else { 3 }].as_flattened();

        let [from_state, from_inputs] = &self.performance;
        let mean = &mut self.performance_now;
        mean.fill([0.0; BLOCK]);
        from_state.add_product(self.state.as_flattened(), mean);
        from_inputs.add_product(inputs, mean);

        let x = self.state.as_flattened_mut();
        for &(at, z, pair) in &self.poles {
            if pair {
                let (re, im) = (x[at], x[at + 1]);
                x[at] = z.re * re - z.im * im;
                x[at + 1] = z.im * re + z.re * im;
            } else {
                x[at] *= z.re;
            }
        }
        self.change.add_product(inputs, &mut self.state);
        DVectorView::from_slice(
            &self.performance_now.as_flattened()[..self.count],
            self.count,
        )
    }
}

/// What one run showed.
#[derive(Clone, Debug, Serialize)]
pub struct Run {
    /// rms of each performance output, m/s².
    pub rms: Vec<f64>,
    /// Largest magnitude of each, m/s².
    pub peak: Vec<f64>,
    /// Largest force asked of any leg, N.
    pub force_peak: f64,
    /// Steps in which the clamp was active.
    pub clamped_steps: usize,
    /// Steps in which a sensor was at the end of the ADC's range.
    pub railed_steps: usize,
    /// Measured steps.
    pub steps: usize,
}

/// Runs the machine over settling and duration of `settings`, under `table` or,
/// without one, with the outputs at rest.
pub fn run(
    plant: &SampledPlant,
    board: &Board,
    settings: &Simulation,
    table: &ValidTable,
    closed: bool,
) -> Run {
    let mut rig = Rig::new(plant.clone(), board, settings);
    let count = plant.plant.performance().len();
    let mut run = Run {
        rms: vec![0.0; count],
        peak: vec![0.0; count],
        force_peak: 0.0,
        clamped_steps: 0,
        railed_steps: 0,
        steps: steps(settings.duration, board),
    };
    let settling = steps(settings.settling, board);
    let safe = table.safe_codes();
    let mut state = None;
    for k in 0..settling + run.steps {
        let adc = rig.sample();
        let mut dac = safe;
        if closed {
            let state = state.get_or_insert_with(|| State::settled_on(table, adc));
            let output = step(table, state, adc, Demand::LAW);
            dac = output.dac;
            if k >= settling {
                run.clamped_steps += usize::from(output.status.clamped);
                run.railed_steps += usize::from(output.status.at_rail());
            }
        }
        let performance = rig.advance(dac);
        if k >= settling {
            for (i, x) in performance.iter().enumerate() {
                run.rms[i] += x * x;
                run.peak[i] = run.peak[i].max(x.abs());
            }
            for code in dac {
                let force = board.dac.force(code, board.actuator_gain);
                run.force_peak = run.force_peak.max(force.abs());
            }
        }
    }
    for rms in &mut run.rms {
        *rms = (*rms / run.steps as f64).sqrt();
    }
    run
}

fn steps(seconds: f64, board: &Board) -> usize {
    // At least one, so that an rms is defined.
    ((seconds * board.sample_rate).round() as usize).max(1)
}

/// The same floor with and without control.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Names of the performance outputs.
    pub outputs: Vec<String>,
    /// Measured time, s.
    pub duration_s: f64,
    /// rms of each floor input, m/s².
    pub floor_rms: f64,
    /// Its band, Hz.
    pub floor_band_hz: [f64; 2],
    /// Of the random numbers.
    pub seed: u64,
    /// Without control.
    pub open: Run,
    /// Under the table.
    pub closed: Run,
}

/// Runs open and closed loop under the same floor.
pub fn compare(
    plant: &SampledPlant,
    board: &Board,
    settings: &Simulation,
    table: &ValidTable,
    outputs: Vec<String>,
) -> Comparison {
    let one = |closed| run(plant, board, settings, table, closed);
    let (open, closed) = rayon::join(|| one(false), || one(true));
    Comparison {
        outputs,
        duration_s: settings.duration,
        floor_rms: settings.floor_rms,
        floor_band_hz: settings.floor_band,
        seed: settings.seed,
        open,
        closed,
    }
}
