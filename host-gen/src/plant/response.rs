//! Frequency response from partial fractions.

use core::f64::consts::TAU;
use core::ops::Range;

use nalgebra::{Complex, DMatrix, DVector, Matrix6, Matrix6xX, MatrixXx6};
use shared::LEGS;

use super::partial_fractions::PlantPole;
use super::tilt::FloorTilt;
use crate::numeric::frequencies::NARROWEST;

/// The residues of all poles as products of real vectors, so that a frequency takes real matrix
/// products only.
///
/// Let g be the gain of a pole at one frequency and g* that of its conjugate. A term contributes
/// outputs[0]·inputs·(g + g*) + outputs[1]·inputs·j·(g − g*). A pole whose input vector is real,
/// such as that of a mode that no damper couples to others, has one term; another pole has two.
#[derive(Clone, Debug)]
pub(super) struct Terms {
    /// The index of each term's pole.
    poles: Vec<usize>,
    outputs: [DMatrix<f64>; 2],
    /// Rows for the floor accelerations, and rows for the leg forces.
    inputs: [MatrixXx6<f64>; 2],
}

/// s = jω at `hz`, Hz; around an undamped pole a little to the right of it, as the Nyquist contour
/// goes, by [`NARROWEST`] of the frequency. And whether it is there.
///
/// At such a pole the open plant is infinite, but a closed loop is not: the pole cancels in it,
/// and what is evaluated this close differs by that part only.
pub(super) fn contour(poles: &[PlantPole], hz: f64) -> (Complex<f64>, bool) {
    let s = Complex::new(0.0, TAU * hz);
    let near = |pole: &PlantPole| {
        let size = NARROWEST * pole.lambda.norm();
        pole.lambda.re.abs() < size && (s - pole.lambda).norm() < 10.0 * size
    };
    if poles.iter().any(near) {
        (s + NARROWEST * TAU * hz, true)
    } else {
        (s, false)
    }
}

/// The gains of all poles at `s`, rad/s; those from the leg forces times `hold`.
///
/// `value` and `slope` are G(0) and dG/ds at s = 0. The poles' contributions are counted from
/// there, so that accelerations far below the modes keep their digits.
pub(super) fn continuous<'a>(
    poles: &[PlantPole],
    [value, slope]: &'a [DMatrix<f64>; 2],
    s: Complex<f64>,
    hold: Complex<f64>,
) -> ResponsePart<'a> {
    // 1/(s − λ) minus its value and slope at s = 0.
    let passes = |_, lambda: Complex<f64>| {
        let ratio = s / lambda;
        let gain = ratio * ratio / (s - lambda);
        [gain, gain * hold]
    };
    ResponsePart {
        direct: [
            Some((value, [Complex::ONE, hold])),
            Some((slope, [s, s * hold])),
        ],
        gains: gains(poles, passes),
    }
}

/// For each pole, for floor and leg forces: the sum of the gains of the pole and its conjugate,
/// and j times their difference.
///
/// `passes` gives the two gains, from the floor and from the leg forces, for the index of a pole
/// and either λ or its conjugate.
pub(super) fn gains(
    poles: &[PlantPole],
    passes: impl Fn(usize, Complex<f64>) -> [Complex<f64>; 2],
) -> Vec<[[Complex<f64>; 2]; 2]> {
    let j = Complex::new(0.0, 1.0);
    let of = |(k, pole): (usize, &PlantPole)| {
        let own = passes(k, pole.lambda);
        if pole.pair {
            let other = passes(k, pole.lambda.conj());
            [0, 1].map(|group| {
                let (own, other) = (own[group], other[group]);
                [own + other, j * (own - other)]
            })
        } else {
            own.map(|own| [own, Complex::ZERO])
        }
    };
    poles.iter().enumerate().map(of).collect()
}

impl Terms {
    pub(super) fn new(poles: &[PlantPole]) -> Self {
        let mut of = Vec::new();
        let mut outputs = [const { Vec::new() }; 2];
        let mut inputs = Vec::new();
        for (k, pole) in poles.iter().enumerate() {
            // A phase factor moved from input to output makes the input real if all its entries
            // have the same phase.
            let largest = pole.input[pole.input.icamax()];
            let phase = if largest == Complex::ZERO {
                Complex::ONE
            } else {
                largest / largest.norm()
            };
            let split = |v: DVector<Complex<f64>>| (v.map(|z| z.re), v.map(|z| z.im));
            let (input_re, input_im) = split(&pole.input * phase.conj());
            let (re, im) = split(&pole.output * phase);
            for (input, sum, difference) in
                [(input_re, re.clone(), im.clone()), (input_im, -im, re)]
            {
                if input.amax() > 0.0 {
                    of.push(k);
                    inputs.push(input.transpose());
                    outputs[0].push(sum);
                    outputs[1].push(difference);
                }
            }
        }
        let inputs = DMatrix::from_rows(&inputs);
        Self {
            poles: of,
            outputs: outputs.map(|columns| DMatrix::from_columns(&columns)),
            inputs: [0, LEGS].map(|first| inputs.fixed_columns::<LEGS>(first).into_owned()),
        }
    }
}

/// The frequency response of a plant at one frequency, from the floor accelerations, m/s², and
/// the leg forces, N, to all its outputs. Blocks are computed on demand.
#[derive(Clone, Debug)]
pub struct Response<'a> {
    pub(super) terms: &'a Terms,
    pub(super) part: ResponsePart<'a>,
    /// For a sampled plant, the response from the samples of the forces to those of the sensors.
    pub(super) sampled: Option<ResponsePart<'a>>,
    /// What a tilt of the floor does, with s of this frequency, rad/s.
    pub(super) tilt: Option<(&'a FloorTilt, Complex<f64>)>,
    pub(super) sensors: usize,
    /// Whether the frequency is that of an undamped pole, to ten times [`NARROWEST`].
    pub(super) at_pole: bool,
}

/// The factors of [`Terms`] at one frequency, and the matrices to add.
#[derive(Clone, Debug)]
pub(super) struct ResponsePart<'a> {
    /// The real matrices that the poles' contributions are added to.
    pub(super) direct: [Option<Scaled<'a>>; 2],
    /// For each pole, for floor and forces: the factors of the two outputs of its terms.
    pub(super) gains: Vec<[[Complex<f64>; 2]; 2]>,
}

/// A real matrix, with a factor for the columns of the floor and one for those of the forces.
pub(super) type Scaled<'a> = (&'a DMatrix<f64>, [Complex<f64>; 2]);

/// Complex gains from six inputs to any number of outputs.
pub type Gain = MatrixXx6<Complex<f64>>;

/// Complex gains from six or twelve sensors to the six leg forces, N per unit of the sensor.
pub type Control = Matrix6xX<Complex<f64>>;

impl Response<'_> {
    /// The block from the floor accelerations, m/s², to the output `rows`.
    pub fn from_floor(&self, rows: Range<usize>) -> Gain {
        let gain = self.part.block(self.terms, rows.clone(), 0);
        match self.tilt {
            Some((tilt, s)) => tilt.add(gain, rows, s),
            None => gain,
        }
    }

    /// The block from the leg forces, N, to the output `rows`.
    ///
    /// For a sampled plant and rows of sensors only, from the samples of the forces to the samples
    /// of the sensors. For other rows, to the continuous outputs.
    pub fn from_legs(&self, rows: Range<usize>) -> Gain {
        match &self.sampled {
            Some(sampled) if rows.end <= self.sensors => sampled.block(self.terms, rows, 1),
            _ => self.part.block(self.terms, rows, 1),
        }
    }

    /// G22: the block from the leg forces, N, to the six or twelve sensors, m/s² or N.
    pub fn g22(&self) -> Gain {
        self.from_legs(0..self.sensors)
    }

    /// The gains from the floor accelerations to the output `rows` with the loop closed by output
    /// feedback, Eq. (5): σ = C·y, with C = `controller`.
    ///
    /// With twelve sensors, a controller of six columns feeds back the first six only. Undamped
    /// poles of the plant cancel. All gains are infinite if the frequency is exactly that of an
    /// undamped pole of the closed loop.
    pub fn close(&self, rows: Range<usize>, controller: &Control) -> Gain {
        // σ = (1 − C·G22)⁻¹·C·G21·q̈_r
        let sensors = 0..controller.ncols();
        let difference = Matrix6::identity() - controller * self.from_legs(sensors.clone());
        match difference.try_inverse() {
            Some(inverse) => {
                let force = inverse * (controller * self.from_floor(sensors));
                self.from_floor(rows.clone()) + self.from_legs(rows) * force
            }
            // Exactly at a pole of the closed loop.
            None => self.from_floor(rows).map(|_| Complex::from(f64::INFINITY)),
        }
    }
}

impl ResponsePart<'_> {
    /// The block from the floor (`group` 0) or the leg forces (`group` 1) to these rows.
    fn block(&self, terms: &Terms, rows: Range<usize>, group: usize) -> Gain {
        let Terms {
            poles,
            outputs,
            inputs,
        } = terms;
        // Real parts in the upper half of the rows, imaginary parts in the lower half.
        let mut passed = DMatrix::<f64>::zeros(2 * rows.len(), poles.len());
        for (t, (mut column, &pole)) in passed.column_iter_mut().zip(poles).enumerate() {
            let [sum, difference] = self.gains[pole][group];
            let [a, b] = outputs
                .each_ref()
                .map(|all| &all.column(t).data.into_slice()[rows.clone()]);
            let (re, im) = column.as_mut_slice().split_at_mut(rows.len());
            for ((re, im), (a, b)) in re.iter_mut().zip(im).zip(a.iter().zip(b)) {
                *re = sum.re * a + difference.re * b;
                *im = sum.im * a + difference.im * b;
            }
        }
        let mut parts = passed * &inputs[group];
        for (matrix, factors) in self.direct.iter().flatten() {
            for j in 0..LEGS {
                let entries = matrix.column(group * LEGS + j);
                let entries = entries.rows_range(rows.clone());
                let mut column = parts.column_mut(j);
                let mut halves = column.rows_range_pair_mut(..rows.len(), rows.len()..);
                halves.0.axpy(factors[group].re, &entries, 1.0);
                halves.1.axpy(factors[group].im, &entries, 1.0);
            }
        }
        Gain::from_fn(rows.len(), |i, j| {
            Complex::new(parts[(i, j)], parts[(rows.len() + i, j)])
        })
    }
}
