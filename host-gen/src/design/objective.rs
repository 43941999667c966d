//! Objective and constraints of the search for shapes.
//!
//! The sampled loop, in modal coordinates, must be stable with a peak sensitivity within
//! the bound and must isolate above the corner; among such loops, the one with the lowest
//! level of the performance outputs in the machine's bands is the best.

use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2};
use core::ops::Range;

use nalgebra::Complex;
use rayon::prelude::*;
use shared::LEGS;

use crate::closed_loop::SLOWEST;
use crate::closed_loop::isolation::isolation_band;
use crate::closed_loop::sensitivity::ELSEWHERE;
use crate::control::gains::ModalTransform;
use crate::control::law::{ac_coupling, channel_response, low_pass};
use crate::control::{Shape, table};
use crate::machine::{FeedbackKind, Machine, Minimise, Target};
use crate::model::design_model::DesignModel;
use crate::numeric::frequencies::grid;
use crate::numeric::quadrature::nodes;
use crate::numeric::singular::{largest_singular_value, smallest_is_above};
use crate::numeric::six::ComplexMatrix6;
use crate::plant::{Gain, SampledPlant};

/// The loop at one frequency, in modal coordinates.
struct LoopPoint {
    z: Complex<f64>,
    /// T_in·G22·T_out for the sensors that every channel uses.
    plant: ComplexMatrix6,
    /// T_in·G22·T_out for the force sensors that complement the accelerometers.
    complement: Option<ComplexMatrix6>,
}

/// The channels of the law at one frequency.
struct ChannelGains {
    gains: [Complex<f64>; LEGS],
    /// The factors of accelerometers and of force sensors in each channel.
    split: Option<[[Complex<f64>; 2]; LEGS]>,
}

impl ChannelGains {
    /// The channels' inputs: both kinds of sensors, each with its factor.
    fn blend(&self, own: &ComplexMatrix6, complement: Option<&ComplexMatrix6>) -> ComplexMatrix6 {
        let mut blend = *own;
        if let (Some(split), Some(complement)) = (self.split, complement) {
            for (i, [part, rest]) in split.into_iter().enumerate() {
                for (x, other) in blend.row_mut(i).iter_mut().zip(complement.row(i).iter()) {
                    *x = part * *x + rest * other;
                }
            }
        }
        blend
    }
}

/// The loop at one frequency with outputs to observe.
struct OutputPoint {
    point: LoopPoint,
    /// From the floor to the outputs without control.
    open: Gain,
    /// From the floor to the channels, by each kind of sensors.
    to_modes: ComplexMatrix6,
    to_modes_complement: Option<ComplexMatrix6>,
    /// From forces along the modes to the outputs.
    from_modes: Gain,
}

/// The points of one band, and the 0 dB reference of its level.
struct BandPoints {
    points: Vec<OutputPoint>,
    /// The weight of each point in the integral over the band, Hz; empty if peaks are minimised.
    weights: Vec<f64>,
    reference_db: f64,
}

/// The performance of shapes for one machine and target, and their constraints.
pub(super) struct Objective<'a> {
    machine: &'a Machine,
    model: &'a DesignModel,
    target: Target,
    loops: Vec<LoopPoint>,
    bands: Vec<BandPoints>,
    /// From rigid floor motion to the rigid whole, above the corner.
    isolation: Vec<OutputPoint>,
    /// T_in and T_out and their inverses.
    input: ComplexMatrix6,
    input_inverse: ComplexMatrix6,
    output: ComplexMatrix6,
    output_inverse: ComplexMatrix6,
}

/// The level of a loop that just misses the required isolation: above any level in dB.
pub(super) const MISSED: f64 = 1e4 * FRAC_1_SQRT_2;

/// The part of the sensitivity bound that is used: a peak between two points of the grid
/// may be higher.
const MARGIN: f64 = 0.995;

impl<'a> Objective<'a> {
    /// The objective for `target`. `reference_db`: the 0 dB reference of σ_max(G11) for
    /// each band of the machine, dB. `isolation`: the frequency above which the machine
    /// as a whole must be isolated from the floor, Hz. `sharp`: frequency and half width,
    /// Hz, of peaks that a fast loop may have in addition to those of the plant.
    pub(super) fn new(
        machine: &'a Machine,
        model: &'a DesignModel,
        plant: &SampledPlant,
        target: Target,
        reference_db: &[f64],
        isolation: f64,
        sharp: &[(f64, f64)],
    ) -> Self {
        let transform = ModalTransform::new(model);
        let input = transform.input.map(Complex::from);
        let output = transform.output.map(Complex::from);
        let complement = transform.beside.map(|input| input.map(Complex::from));
        // The six rows of one kind of sensors.
        let of_kind = |gain: &Gain, input: ComplexMatrix6, first: usize| -> ComplexMatrix6 {
            input * gain.fixed_rows::<LEGS>(first)
        };
        let point = |hz: f64| {
            let g22 = plant.response(hz).g22();
            LoopPoint {
                z: plant.z(hz),
                plant: of_kind(&g22, input, 0) * output,
                complement: complement.map(|input| of_kind(&g22, input, LEGS) * output),
            }
        };
        let mut peaks = plant.plant.peaks();
        peaks.extend(sharp);
        let seen = |rows: Range<usize>, floor: ComplexMatrix6, hz: Vec<f64>| {
            let of_point = |hz: f64| {
                let response = plant.response(hz);
                let sensed = response.from_floor(plant.plant.sensors());
                OutputPoint {
                    point: point(hz),
                    open: response.from_floor(rows.clone()) * floor,
                    to_modes: of_kind(&sensed, input, 0) * floor,
                    to_modes_complement: complement
                        .map(|input| of_kind(&sensed, input, LEGS) * floor),
                    from_modes: response.from_legs(rows.clone()) * output,
                }
            };
            hz.into_iter().map(of_point).collect::<Vec<_>>()
        };
        let [_, high] = isolation_band(model, target.frequency);
        let performance = |floor, hz| seen(plant.plant.performance(), floor, hz);
        let peaks_in = |low: f64, high: f64, count: usize, reference_db: f64| BandPoints {
            points: performance(ComplexMatrix6::identity(), grid(low, high, count, &peaks)),
            weights: Vec::new(),
            reference_db,
        };
        let bands = match target.minimise {
            // Without bands: all frequencies at which the machine must isolate.
            Minimise::Peaks if machine.bands.is_empty() => {
                vec![peaks_in(isolation, high.max(2.0 * isolation), 120, 0.0)]
            }
            Minimise::Peaks => machine
                .bands
                .iter()
                .zip(reference_db)
                .map(|((_, low, high), &reference_db)| peaks_in(*low, *high, 60, reference_db))
                .collect(),
            Minimise::Rms => {
                let band = machine.simulation.floor_band;
                let singular = peaks.iter().map(|(hz, width)| Complex::new(*hz, *width));
                let singular: Vec<_> = singular.collect();
                let (hz, weights) = nodes(&band, &singular, |_| 0.0).into_iter().unzip();
                vec![BandPoints {
                    points: performance(plant.plant.base.map(Complex::from), hz),
                    weights,
                    reference_db: 0.0,
                }]
            }
        };
        Self {
            machine,
            model,
            target,
            loops: grid(SLOWEST * target.frequency, 0.5 / plant.period, 450, &peaks)
                .into_iter()
                .map(point)
                .collect(),
            bands,
            isolation: seen(
                plant.plant.whole(),
                plant.plant.rigid_floor.map(Complex::from),
                grid(isolation, high.max(1.1 * isolation), 30, &[]),
            ),
            input,
            input_inverse: input.try_inverse().expect("modes are independent"),
            output,
            output_inverse: output.try_inverse().expect("modes are independent"),
        }
    }

    /// Whether there are two kinds of sensors.
    pub(super) fn both(&self) -> bool {
        self.target.feedback == FeedbackKind::Both
    }

    /// The level to minimise, dB relative to the references. [`MISSED`] or more if the
    /// loop does not isolate above the corner; none if the loop is unstable or exceeds
    /// the sensitivity bound.
    pub(super) fn level(&self, shapes: &[Shape; LEGS]) -> Option<f64> {
        let period = self.machine.board.period();
        let channels = table::channels(self.model, &self.target, shapes, period);
        let slow = |part: f64| table::coefficient(part * self.target.frequency, period);
        let (high_pass, leak) = (slow(table::AC_COUPLING), slow(table::LEAK));
        let splits = shapes.map(|shape| shape.split_hz.map(|hz| table::coefficient(hz, period)));
        let at = |z: Complex<f64>| {
            let high_pass = ac_coupling(high_pass, z);
            let gains = channels
                .each_ref()
                .map(|channel| channel_response(channel, Shape::SECTIONS, leak, z));
            if self.both() {
                // Only accelerometers have AC coupling.
                let parts = |c: Option<f64>| {
                    let low = low_pass(c.unwrap_or(1.0), z);
                    [high_pass * low, 1.0 - low]
                };
                ChannelGains {
                    gains,
                    split: Some(splits.map(parts)),
                }
            } else {
                ChannelGains {
                    gains: gains.map(|gain| high_pass * gain),
                    split: None,
                }
            }
        };
        let bound = MARGIN * self.target.max_sensitivity;
        let within = |point: &LoopPoint| {
            let channels = at(point.z);
            let modes = point.return_difference(&channels);
            smallest_is_above(modes, bound)
                && smallest_is_above(self.output * modes * self.output_inverse, ELSEWHERE * bound)
                && smallest_is_above(
                    self.input_inverse * point.at_sensors(&channels) * self.input,
                    ELSEWHERE * bound,
                )
        };
        // A few points first: most candidates fail there already.
        let inside = self.loops.iter().step_by(9).all(within)
            && self.loops.par_iter().with_min_len(64).all(within);
        if !inside {
            return None;
        }
        // Nyquist: sections and plant are stable, so det(1 + L) must not encircle
        // zero.
        let determinants: Vec<_> = self
            .loops
            .par_iter()
            .with_min_len(64)
            .map(|point| point.return_difference(&at(point.z)).determinant())
            .collect();
        // The determinant starts at 1: AC coupling makes the loop gain zero at z = 1.
        let mut before = Complex::ONE;
        let mut turned = 0.0;
        for determinant in determinants {
            turned += (determinant / before).arg();
            before = determinant;
        }
        if turned.abs() > FRAC_PI_2 {
            return None;
        }
        let follows = self
            .isolation
            .iter()
            .map(|seen| largest_singular_value(&seen.closed(&at(seen.point.z))))
            .fold(0.0, f64::max);
        if follows > FRAC_1_SQRT_2 {
            return Some(MISSED * follows / FRAC_1_SQRT_2);
        }
        let levels: Vec<f64> = self
            .bands
            .iter()
            .map(|band| band.level(self.target.minimise, at))
            .collect();
        let mean = levels.iter().sum::<f64>() / levels.len() as f64;
        let worst = levels.into_iter().fold(f64::MIN, f64::max);
        Some(worst + 0.1 * mean)
    }
}

impl LoopPoint {
    /// 1 + T_in·G22·T_out·C, opened at the modal sensors.
    fn at_sensors(&self, channels: &ChannelGains) -> ComplexMatrix6 {
        let mut difference = channels.blend(&self.plant, self.complement.as_ref());
        for (i, gain) in channels.gains.into_iter().enumerate() {
            difference.column_mut(i).iter_mut().for_each(|x| *x *= gain);
            difference[(i, i)] += 1.0;
        }
        difference
    }

    /// 1 + C·T_in·G22·T_out, opened at the forces along the modes.
    fn return_difference(&self, channels: &ChannelGains) -> ComplexMatrix6 {
        let mut difference = channels.blend(&self.plant, self.complement.as_ref());
        for (i, gain) in channels.gains.into_iter().enumerate() {
            difference.row_mut(i).iter_mut().for_each(|x| *x *= gain);
            difference[(i, i)] += 1.0;
        }
        difference
    }
}

impl OutputPoint {
    /// From the floor with the loop closed.
    fn closed(&self, channels: &ChannelGains) -> Gain {
        // f = −C·(1 + G·C)⁻¹·T_in·G21.
        let difference = self.point.at_sensors(channels);
        let to_modes = channels.blend(&self.to_modes, self.to_modes_complement.as_ref());
        let Some(mut force) = difference.lu().solve(&to_modes) else {
            return self.open.map(|_| Complex::from(f64::INFINITY));
        };
        for (i, gain) in channels.gains.into_iter().enumerate() {
            force.row_mut(i).iter_mut().for_each(|x| *x *= gain);
        }
        &self.open - &self.from_modes * force
    }
}

impl BandPoints {
    /// The level of the band, dB relative to its reference.
    fn level(&self, minimise: Minimise, at: impl Fn(Complex<f64>) -> ChannelGains + Sync) -> f64 {
        // The Frobenius norm is between σ_max and √6 times it, smooth, and a
        // fraction of the work.
        let all: Vec<f64> = self
            .points
            .par_iter()
            .with_min_len(32)
            .map(|seen| seen.closed(&at(seen.point.z)).norm())
            .collect();
        let squares = match minimise {
            // The geometric mean of the highest square and the mean square over the grid:
            // the mean also falls when a lower point falls.
            Minimise::Peaks => {
                let highest = all.iter().copied().fold(0.0, f64::max);
                let mean = all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64;
                highest * mean.sqrt()
            }
            Minimise::Rms => all
                .iter()
                .zip(&self.weights)
                .map(|(x, weight)| weight * x * x)
                .sum(),
        };
        10.0 * squares.log10() - self.reference_db
    }
}
