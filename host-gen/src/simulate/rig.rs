//! The simulated machine with its converters: DAC codes in, ADC codes out.

use core::ops::Range;
use std::collections::VecDeque;

use nalgebra::{Complex, DMatrix, DVectorView, Vector3, Vector6};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use shared::LEGS;
use shared::codes::{AdcCode, DacCode, Samples};

use super::base_motion::BaseMotion;
use super::blocks::{BLOCK, Blocks};
use super::floor_tilt::Tilt;
use super::piezo::Stacks;
use super::shaped_noise::ShapedNoise;
use crate::floor::Record;
use crate::machine::{Board, Machine, Sensor, Simulation};
use crate::plant::SampledPlant;
use crate::plant::sampled::{ByInput, SampledStateSpace};

/// Why a machine cannot be simulated at the converters of another one's board.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum OtherBoard {
    /// The sample rates differ.
    #[error(
        "its board samples at {truth} Hz and the one of the model at {model} Hz; give both files the same board.sample_rate"
    )]
    Rate {
        /// Of the machine that is to be simulated, Hz.
        truth: f64,
        /// Of the model, Hz.
        model: f64,
    },
    /// Other kinds of sensors.
    #[error("it feeds back other sensors than the model; give both files the same target.feedback")]
    Sensors,
}

/// Whether `truth` can be simulated on the board for which `model` has a table: a machine that is not
/// the model. All else may differ.
///
/// # Errors
/// [`OtherBoard`] with what does not fit.
pub fn is_on_board_of(truth: &Machine, model: &Machine) -> Result<(), OtherBoard> {
    let rates = [truth, model].map(|machine| machine.board.sample_rate);
    if rates[0] != rates[1] {
        return Err(OtherBoard::Rate {
            truth: rates[0],
            model: rates[1],
        });
    }
    if truth.target.feedback != model.target.feedback {
        return Err(OtherBoard::Sensors);
    }
    Ok(())
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
    /// Whether new forces take effect within a period, not at its start.
    within: bool,
    state: Vec<[f64; BLOCK]>,
    performance_now: Vec<[f64; BLOCK]>,
    count: usize,
    /// Forces latched or on their way, the latest first.
    forces: VecDeque<[f64; LEGS]>,
    base_motion: BaseMotion,
    /// What rotates the base, at the last sample, if waves do, m/s².
    waves: Vector3<f64>,
    /// The tilt of the floor, with gravity.
    tilt: Option<Tilt>,
    kinds: Vec<Kind>,
    /// What the piezo stacks do that is not linear.
    stacks: Option<Stacks>,
    sensor_noise: ChaCha8Rng,
    output_noise: ChaCha8Rng,
    /// Acceleration of the floor inputs now and at the next sample, m/s².
    floor: [[f64; LEGS]; 2],
    /// Factor on the floor's acceleration from the next sample on; initially 1.
    pub floor_gain: f64,
    /// Voltage added to the offsets of the sensors from the next sample on, one value for
    /// each channel, the same for both kinds of sensors, V; initially 0.
    pub drift: [f64; LEGS],
}

/// One kind of sensors.
struct Kind {
    sensor: Sensor,
    /// Gains of the channels.
    gains: [f64; LEGS],
    /// The rms of the white noise of sensor and ADC together, V.
    white: f64,
    /// The sensors' own noise, if it is not white.
    shaped: Option<ShapedNoise>,
}

impl Rig {
    /// The machine at rest, with the floor noise and the seed of `settings`.
    pub fn new(plant: SampledPlant, board: &Board, settings: &Simulation) -> Self {
        let SampledStateSpace {
            blocks: poles,
            change,
            output,
            mean,
            mean_by,
        } = plant.state_space();
        let rows = |matrix: &DMatrix<f64>, rows: Range<usize>| matrix.rows_range(rows).into_owned();
        // The previous forces come last: often they have no effect.
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
        let kind = |(i, (sensor, gains)): (u64, (&Sensor, [f64; LEGS]))| {
            let density = &sensor.noise_density;
            let rate = board.sample_rate;
            let (white, shaped) = if density.is_white() {
                (density.rms(rate), None)
            } else {
                (0.0, Some(ShapedNoise::new(density, rate, stream(3 + i))))
            };
            Kind {
                sensor: sensor.clone(),
                gains,
                white: (white * sensor.sensitivity).hypot(board.adc_noise),
                shaped,
            }
        };
        let tilt = plant.plant.tilt.as_ref();
        let tilt = tilt.map(|tilt| Tilt::new(tilt, shown.clone()));
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
            base_motion: BaseMotion::noise(settings, plant.period, stream(0)),
            waves: Vector3::zeros(),
            tilt,
            kinds: (0..)
                .zip(board.fed_back().zip(board.gains.sensors))
                .map(kind)
                .collect(),
            stacks: board
                .piezo
                .as_ref()
                .map(|piezo| Stacks::new(piezo, plant.period)),
            sensor_noise: stream(1),
            output_noise: stream(2),
            floor: [[0.0; LEGS]; 2],
            floor_gain: 1.0,
            drift: [0.0; LEGS],
            board: board.clone(),
            plant,
        }
    }

    /// The same machine on a floor that moves as in `record`, again and again.
    pub fn on(mut self, record: &Record) -> Self {
        self.base_motion = BaseMotion::recorded(record, self.plant.period);
        self
    }

    /// The same machine moved by these `inputs` of its plant's base, one for each sample, in place of
    /// noise.
    pub(super) fn driven(mut self, inputs: Vec<[f64; LEGS]>) -> Self {
        self.base_motion = BaseMotion::given(inputs);
        self
    }

    /// The simulated plant.
    pub fn plant(&self) -> &SampledPlant {
        &self.plant
    }

    /// Advances the floor to the next sampling instant and returns the ADC codes.
    pub fn sample(&mut self) -> Samples {
        let mut motion = Vector6::from(self.base_motion.sample());
        if self.plant.plant.waves {
            let now = motion.fixed_rows::<3>(3).into_owned();
            let rates = (now - self.waves) / self.plant.period;
            motion.fixed_rows_mut::<3>(3).copy_from(&rates);
            self.waves = now;
        }
        let motion = self.plant.plant.base * motion;
        let mut next = motion * self.floor_gain;
        if let Some(tilt) = &mut self.tilt {
            next += tilt.sample(&motion, self.plant.period, self.floor_gain);
        }
        self.floor = [self.floor[1], next.into()];
        let seen = self.forces[self.plant.whole_periods];
        let [from_state, direct] = &self.sensors;
        let mut y = [[0.0; BLOCK]; (2 * LEGS).div_ceil(BLOCK)];
        from_state.add_product(self.state.as_flattened(), &mut y);
        direct.add_product([self.floor[0], seen].as_flattened(), &mut y);
        let mut samples = Samples::from([AdcCode(0); LEGS]);
        let codes = [&mut samples.sensors, &mut samples.forces];
        let values = y.as_flattened().chunks_exact(LEGS);
        for ((codes, values), kind) in codes.into_iter().zip(values).zip(&mut self.kinds) {
            let shaped = kind.shaped.as_mut().map(ShapedNoise::sample);
            let (sensor, noise) = (&kind.sensor, kind.white);
            let own = shaped.unwrap_or_default();
            let values = values.iter().zip(own).map(|(value, own)| value + own);
            let values = values.zip(kind.gains).map(|(value, gain)| value * gain);
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

    /// Sends `dac` to the outputs, where it is latched after the board's delay, and
    /// simulates one sample period. Returns the mean of each performance output over the
    /// period, m/s².
    pub fn advance(&mut self, dac: [DacCode; LEGS]) -> DVectorView<'_, f64> {
        let board = &self.board;
        let mut force = core::array::from_fn(|leg| {
            let normal: f64 = StandardNormal.sample(&mut self.output_noise);
            let gain = board.actuator_gain * board.gains.actuators[leg];
            board.dac.force(dac[leg], gain) + board.dac_noise * normal * gain
        });
        if let Some(stacks) = &mut self.stacks {
            force = stacks.advance(force);
        }
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
        if let Some(tilt) = &self.tilt {
            let mean = mean.as_flattened_mut().iter_mut();
            for (mean, weight) in mean.zip(tilt.weight().iter()) {
                *mean -= weight;
            }
        }

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
