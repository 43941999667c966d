//! Frequency response from the poles.

use core::f64::consts::TAU;
use core::ops::Range;

use nalgebra::{Complex, DMatrix, DVector, Matrix6, Matrix6xX, MatrixXx6};
use shared::LEGS;

use super::partial_fractions::PlantPole;

/// The poles' parts with real vectors, a column or a row each:
/// output[0]·input goes with the sum of what a pole and its conjugate pass,
/// output[1]·input with j times their difference. So a frequency takes real
/// products, and of a mode that no damper couples to others half of them.
#[derive(Clone, Debug)]
pub(super) struct Terms {
    /// Index of the pole.
    poles: Vec<usize>,
    outputs: [DMatrix<f64>; 2],
    /// From floor accelerations and from forces.
    inputs: [MatrixXx6<f64>; 2],
}

/// The transfer functions of `poles` at `hz`, those of the forces times `hold`.
pub(super) fn continuous<'a>(
    poles: &[PlantPole],
    [value, slope]: &'a [DMatrix<f64>; 2],
    hz: f64,
    hold: Complex<f64>,
) -> Part<'a> {
    let s = Complex::new(0.0, TAU * hz);
    // c·b/(s − λ) less its value and slope at zero.
    let passes = |_, lambda: Complex<f64>| {
        let ratio = s / lambda;
        let gain = ratio * ratio / (s - lambda);
        [gain, gain * hold]
    };
    Part {
        direct: [
            Some((value, [Complex::ONE, hold])),
            Some((slope, [s, s * hold])),
        ],
        gains: gains(poles, passes),
    }
}

/// Sum, and j times the difference, of what each pole and its conjugate pass;
/// `passes` gives, for a pole's index and λ or its conjugate, what floor and
/// forces are to be multiplied by.
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
            // A phase moved from input to output makes the input real where it
            // can be.
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

/// Frequency response of the plant at one frequency: floor accelerations and
/// leg forces to sensors, performance and the whole. What is asked for is
/// computed when it is.
#[derive(Clone, Debug)]
pub struct Response<'a> {
    pub(super) terms: &'a Terms,
    pub(super) part: Part<'a>,
    /// What samples of the sensors see of sampled forces, where they are.
    pub(super) sampled: Option<Part<'a>>,
    pub(super) sensors: usize,
}

/// What goes with the terms at one frequency.
#[derive(Clone, Debug)]
pub(super) struct Part<'a> {
    /// What the poles' parts are added to.
    pub(super) direct: [Option<Scaled<'a>>; 2],
    /// By pole, for floor and forces: what goes with a term's outputs.
    pub(super) gains: Vec<[[Complex<f64>; 2]; 2]>,
}

/// A real matrix, and its factors for the columns of the floor and the forces.
pub(super) type Scaled<'a> = (&'a DMatrix<f64>, [Complex<f64>; 2]);

/// Any number of outputs from six inputs, as complex gains.
pub type Gain = MatrixXx6<Complex<f64>>;

/// Six forces from six or twelve sensors as complex gains.
pub type Control = Matrix6xX<Complex<f64>>;

impl Response<'_> {
    /// From floor accelerations to these rows.
    pub fn from_floor(&self, rows: Range<usize>) -> Gain {
        self.part.block(self.terms, rows, 0)
    }

    /// From leg forces to these rows: the sensors' or others.
    pub fn from_legs(&self, rows: Range<usize>) -> Gain {
        match &self.sampled {
            Some(sampled) if rows.end <= self.sensors => sampled.block(self.terms, rows, 1),
            _ => self.part.block(self.terms, rows, 1),
        }
    }

    /// Leg forces to sensors, G22.
    pub fn g22(&self) -> Gain {
        self.from_legs(0..self.sensors)
    }

    /// Floor accelerations to `rows` with the loop closed by σ = C·y; C may
    /// take the first six sensors of twelve alone.
    pub fn close(&self, rows: Range<usize>, controller: &Control) -> Gain {
        // σ = (1 − C·G22)⁻¹·C·G21·q̈_r
        let sensors = 0..controller.ncols();
        let difference = Matrix6::identity() - controller * self.from_legs(sensors.clone());
        match difference.try_inverse() {
            Some(inverse) => {
                let force = inverse * (controller * self.from_floor(sensors));
                self.from_floor(rows.clone()) + self.from_legs(rows) * force
            }
            // Exactly on a closed-loop pole.
            None => self.from_floor(rows).map(|_| Complex::from(f64::INFINITY)),
        }
    }
}

impl Part<'_> {
    /// These rows from the floor (`group` 0) or the forces (1).
    fn block(&self, terms: &Terms, rows: Range<usize>, group: usize) -> Gain {
        let Terms {
            poles,
            outputs,
            inputs,
        } = terms;
        // Real and imaginary parts one above the other.
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
