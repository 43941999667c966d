//! The generalised plant G of Fig. 4, in modal form, continuous and sampled.
//!
//! Inputs are the six floor accelerations and the six leg forces; outputs are
//! the feedback sensors, the performance accelerations, and the motion of the
//! machine as a rigid whole, from which the corner is read.
//!
//! The paper stacks the inputs of Eq. (6) in one order in B and in the other in
//! u; here the floor always comes first, as in Fig. 4.

use core::f64::consts::TAU;
use core::ops::Range;

use nalgebra::{Complex, DMatrix, DVector, Matrix6, Matrix6xX, MatrixXx6};
use shared::LEGS;

use crate::design::Design;
use crate::linear::eigenvalues;
use crate::machine::{Board, EntryError, Feedback, Machine, MachineError, Performance};
use crate::multibody::{Modes, Multibody, deformation_stiffness};

/// Floor accelerations, then leg forces.
pub const INPUTS: usize = 2 * LEGS;

/// ẋ = A·x + B·u, y = C·x + D·u with x = (z, ż), z the modal coordinates.
#[derive(Clone, Debug)]
pub struct StateSpace {
    /// A, 1/s.
    pub a: DMatrix<f64>,
    /// B, columns as [`INPUTS`].
    pub b: DMatrix<f64>,
    /// C, rows as [`Plant::sensors`], [`Plant::performance`], [`Plant::whole`].
    pub c: DMatrix<f64>,
    /// D.
    pub d: DMatrix<f64>,
}

/// One pole of the plant with what drives it and what shows it:
/// output·input/(s − λ), and the conjugate of it for a pair.
#[derive(Clone, Debug)]
pub struct Pole {
    /// λ, rad/s; of a pair the one above the real axis.
    pub lambda: Complex<f64>,
    /// Whether its conjugate is a pole too.
    pub pair: bool,
    input: DVector<Complex<f64>>,
    output: DVector<Complex<f64>>,
}

/// The poles' parts with real vectors, a column or a row each:
/// output[0]·input goes with the sum of what a pole and its conjugate pass,
/// output[1]·input with j times their difference. So a frequency takes real
/// products, and of a mode that no damper couples to others half of them.
#[derive(Clone, Debug)]
struct Terms {
    /// Index of the pole.
    poles: Vec<usize>,
    outputs: [DMatrix<f64>; 2],
    /// From floor accelerations and from forces.
    inputs: [MatrixXx6<f64>; 2],
}

/// The plant.
#[derive(Clone, Debug)]
pub struct Plant {
    /// As matrices.
    pub state_space: StateSpace,
    /// As poles.
    pub poles: Vec<Pole>,
    terms: Terms,
    /// G(0) and G'(0). Accelerations far below the modes are small differences
    /// of D and the poles' parts; from here they are not.
    slow: [DMatrix<f64>; 2],
    sensors: usize,
    performance: usize,
    /// Floor accelerations that move the base along each rigid mode, 6×6: with
    /// these for inputs, [`Plant::whole`] is the identity at low frequency.
    pub rigid_floor: Matrix6<f64>,
}

/// Outputs y = A·z̈ + D·z + F·q̈_r + B·σ while they are put together.
struct Outputs {
    acceleration: DMatrix<f64>,
    displacement: DMatrix<f64>,
    floor: MatrixXx6<f64>,
    actuators: MatrixXx6<f64>,
}

impl Outputs {
    fn zeros(count: usize, modes: usize) -> Self {
        Self {
            acceleration: DMatrix::zeros(count, modes),
            displacement: DMatrix::zeros(count, modes),
            floor: MatrixXx6::zeros(count),
            actuators: MatrixXx6::zeros(count),
        }
    }
}

impl StateSpace {
    /// From z̈ + Δ·ż + Λ·z = b_r·q̈_r + b_a·σ.
    fn new(
        squares: &DVector<f64>,
        damping: &DMatrix<f64>,
        floor: &MatrixXx6<f64>,
        actuators: &MatrixXx6<f64>,
        outputs: &Outputs,
    ) -> Self {
        let n = squares.len();
        let stiffness = DMatrix::from_diagonal(squares);
        let mut a = DMatrix::zeros(2 * n, 2 * n);
        a.view_mut((0, n), (n, n)).fill_with_identity();
        a.view_mut((n, 0), (n, n)).copy_from(&-&stiffness);
        a.view_mut((n, n), (n, n)).copy_from(&-damping);
        let mut b = DMatrix::zeros(2 * n, INPUTS);
        b.view_mut((n, 0), (n, LEGS)).copy_from(floor);
        b.view_mut((n, LEGS), (n, LEGS)).copy_from(actuators);
        let Outputs {
            acceleration,
            displacement,
            ..
        } = outputs;
        let mut c = DMatrix::zeros(acceleration.nrows(), 2 * n);
        c.columns_mut(0, n)
            .copy_from(&(displacement - acceleration * stiffness));
        c.columns_mut(n, n).copy_from(&(-acceleration * damping));
        let mut d = DMatrix::zeros(acceleration.nrows(), INPUTS);
        d.columns_mut(0, LEGS)
            .copy_from(&(acceleration * floor + &outputs.floor));
        d.columns_mut(LEGS, LEGS)
            .copy_from(&(acceleration * actuators + &outputs.actuators));
        Self { a, b, c, d }
    }

    /// Partial fractions. None where A has no full set of eigenvectors, as
    /// with a mode damped exactly critically.
    fn poles(&self, squares: &DVector<f64>, damping: &DMatrix<f64>) -> Option<Vec<Pole>> {
        let n = squares.len();
        let diagonal = (0..n).all(|i| (0..n).all(|j| i == j || damping[(i, j)] == 0.0));
        let mut poles = if diagonal {
            (0..n)
                .map(|i| self.poles_of_mode(i, squares[i], damping[(i, i)]))
                .collect::<Option<Vec<_>>>()?
                .concat()
        } else {
            self.coupled_poles()?
        };
        poles.sort_by(|a, b| a.lambda.norm().total_cmp(&b.lambda.norm()));
        Some(poles)
    }

    /// The poles of one mode, s² + Δ·s + Λ = (s − λ₁)(s − λ₂).
    fn poles_of_mode(&self, mode: usize, square: f64, damping: f64) -> Option<Vec<Pole>> {
        let n = self.a.nrows() / 2;
        let half = 0.5 * damping;
        let root = Complex::from(half * half - square).sqrt();
        if root == Complex::ZERO {
            return None;
        }
        let complex = |row: nalgebra::RowDVector<f64>| row.transpose().map(Complex::from);
        let input = complex(self.b.row(n + mode).into_owned());
        let shape = |column| self.c.column(column).map(Complex::from);
        let pole = |root: Complex<f64>, pair| {
            let lambda = root - half;
            Pole {
                lambda,
                pair,
                input: &input / (root + root),
                output: shape(mode) + shape(n + mode) * lambda,
            }
        };
        Some(if square > half * half {
            vec![pole(root, true)]
        } else {
            vec![pole(root, false), pole(-root, false)]
        })
    }

    /// The poles of modes that dampers couple.
    ///
    /// Poles that symmetry makes equal get an orthonormal set of eigenvectors:
    /// those of an eigenvalue iteration may be parallel to all digits.
    fn coupled_poles(&self) -> Option<Vec<Pole>> {
        let mut values = eigenvalues(&self.a)?;
        let size = values.iter().map(|z| z.norm()).fold(0.0, f64::max);
        let zero = 1e-12 * size;
        // A pole below the real axis comes with the one above.
        values.retain(|lambda| lambda.im > -zero);
        let a = self.a.map(Complex::from);
        let n = a.nrows();
        let mut found: Vec<(Complex<f64>, bool, DVector<Complex<f64>>)> = Vec::new();
        while let Some(first) = values.pop() {
            let mut equal = vec![first];
            values.retain(|lambda| {
                let far = (lambda - first).norm() > EQUAL * size;
                if !far {
                    equal.push(*lambda);
                }
                far
            });
            let count = equal.len();
            let lambda = equal.iter().sum::<Complex<f64>>() / count as f64;
            let shifted = &a - DMatrix::from_diagonal_element(n, n, lambda);
            let svd = shifted.svd(false, true);
            let directions = svd.v_t?;
            let mut order: Vec<usize> = (0..n).collect();
            order.sort_by(|&i, &j| svd.singular_values[i].total_cmp(&svd.singular_values[j]));
            // Where an eigenvector is missing, so is a small singular value.
            if svd.singular_values[order[count - 1]] > 10.0 * EQUAL * size {
                return None;
            }
            for &i in &order[..count] {
                found.push((lambda, lambda.im > zero, directions.row(i).adjoint()));
            }
        }
        let columns: Vec<_> = found
            .iter()
            .flat_map(|(_, pair, vector)| {
                let conjugate = pair.then(|| vector.map(|z| z.conj()));
                core::iter::once(vector.clone()).chain(conjugate)
            })
            .collect();
        let inverse = DMatrix::from_columns(&columns).try_inverse()?;
        let input = inverse * self.b.map(Complex::from);
        let c = self.c.map(Complex::from);
        let mut row = 0;
        let poles = found.into_iter().map(|(lambda, pair, vector)| {
            let pole = Pole {
                lambda,
                pair,
                input: input.row(row).transpose(),
                output: &c * vector,
            };
            row += 1 + usize::from(pair);
            pole
        });
        Some(poles.collect())
    }
}

/// Poles nearer to each other than this part of the largest count as equal.
const EQUAL: f64 = 1e-9;

impl Plant {
    /// The flexible machine with the sensors of `design`.
    ///
    /// # Errors
    /// Where a mode is damped exactly critically.
    pub fn new(
        machine: &Machine,
        model: &Multibody,
        design: &Design,
    ) -> Result<Self, MachineError> {
        let modes = model.modes();
        let n = modes.squares.len();
        let shapes = &modes.shapes;
        let floor_inverse = model.floor_inverse();
        let floor = -shapes.transpose() * &model.mass * &model.ride * floor_inverse;
        let actuators = shapes.transpose() * model.elongations.transpose();

        let sensors = match design.feedback {
            Feedback::Acceleration | Feedback::Force => LEGS,
            Feedback::Both => 2 * LEGS,
        };
        let count = machine.performance.len();
        let mut out = Outputs::zeros(sensors + count + 2 * LEGS + 3, n);
        if design.feedback != Feedback::Force {
            let all = machine.accelerometers.iter().flatten();
            for (i, sensor) in all.enumerate() {
                let (relative, ride) = model.direction(machine, sensor);
                let row = relative.transpose() * shapes;
                out.acceleration.row_mut(i).copy_from(&row);
                out.floor.row_mut(i).copy_from(&(ride * floor_inverse));
            }
        }
        if design.feedback != Feedback::Acceleration {
            // σ − (EA/L)·e1, Eq. (11) with the push positive.
            let all = machine.force_sensors.iter().flatten();
            for (i, &beam) in (sensors - LEGS..).zip(all) {
                for (j, &actuator) in machine.actuators.iter().enumerate() {
                    if actuator == beam {
                        let axial = deformation_stiffness(&machine.beams[beam])[(0, 0)];
                        let row = model.elongations.row(j) * shapes * -axial;
                        out.displacement.row_mut(i).copy_from(&row);
                        out.actuators[(i, j)] = 1.0;
                    }
                }
            }
        }
        for (i, output) in machine.performance.iter().enumerate() {
            let at = sensors + i;
            match output {
                Performance::Deformation(d) => {
                    let row = model.deformation(machine, *d).transpose() * shapes;
                    out.acceleration.row_mut(at).copy_from(&row);
                }
                Performance::Acceleration(d) => {
                    let (relative, ride) = model.direction(machine, d);
                    let row = relative.transpose() * shapes;
                    out.acceleration.row_mut(at).copy_from(&row);
                    out.floor.row_mut(at).copy_from(&(ride * floor_inverse));
                }
            }
        }
        // The machine as a rigid whole: its momentum along each rigid mode,
        // whose shape in the motion of the whole is b = E_s⁻¹·S·w.
        let rigid_modes = design
            .rigid
            .elongations
            .try_inverse()
            .expect("the elongations were checked to be independent")
            * design.modal;
        let momentum = rigid_modes.transpose() * model.ride.transpose() * &model.mass;
        out.acceleration
            .rows_mut(sensors + count, LEGS)
            .copy_from(&(&momentum * shapes));
        out.floor
            .rows_mut(sensors + count, LEGS)
            .copy_from(&(&momentum * &model.ride * floor_inverse));

        let legs = sensors + count + LEGS;
        out.acceleration
            .rows_mut(legs, LEGS)
            .copy_from(&(&model.elongations * shapes));
        for axis in 0..3 {
            let (relative, ride) = model.mounts(machine, axis);
            let at = legs + LEGS + axis;
            out.acceleration
                .row_mut(at)
                .copy_from(&(relative.transpose() * shapes));
            out.floor.row_mut(at).copy_from(&(ride * floor_inverse));
        }

        let Modes {
            squares, damping, ..
        } = &modes;
        let state_space = StateSpace::new(squares, damping, &floor, &actuators, &out);
        let poles = state_space.poles(squares, damping).ok_or_else(|| {
            machine.locate(EntryError::new(
                "damping",
                "a mode is damped exactly critically; change the damping a little",
            ))
        })?;
        // 1/(s² + Δ·s + Λ) is Λ⁻¹ − s·Λ⁻¹·Δ·Λ⁻¹ + …; accelerations start at s².
        let soft = DMatrix::from_diagonal(&squares.map(f64::recip));
        let mut value = DMatrix::zeros(state_space.d.nrows(), INPUTS);
        value.columns_mut(0, LEGS).copy_from(&out.floor);
        value.columns_mut(LEGS, LEGS).copy_from(&out.actuators);
        let input = state_space.b.rows(n, n);
        value += &out.displacement * &soft * input;
        let slope = -(&out.displacement * &soft * damping * &soft * input);
        Ok(Self {
            state_space,
            terms: Terms::new(&poles),
            poles,
            slow: [value, slope],
            sensors,
            performance: count,
            rigid_floor: model.floor * rigid_modes,
        })
    }

    /// The design model as matrices, its sensors only: undamped, and with force
    /// sensors that measure all of K_d·q, as section 4 of the paper assumes.
    pub fn of_design(design: &Design) -> StateSpace {
        let s = &design.modal;
        let mut out = Outputs::zeros(LEGS, LEGS);
        match design.feedback {
            Feedback::Acceleration | Feedback::Both => out
                .acceleration
                .rows_mut(0, LEGS)
                .copy_from(&(design.sensing * s)),
            Feedback::Force => {
                let displacement = -(design.sensing * design.rigid.stiffness * s);
                out.displacement.rows_mut(0, LEGS).copy_from(&displacement);
                out.actuators.rows_mut(0, LEGS).copy_from(&design.sensing);
            }
        }
        let by_six = |m: Matrix6<f64>| MatrixXx6::from_column_slice(m.as_slice());
        StateSpace::new(
            &DVector::from_iterator(LEGS, design.omega.iter().map(|w| w * w)),
            &DMatrix::zeros(LEGS, LEGS),
            &by_six(-(s.transpose() * design.rigid.rheonomic)),
            &by_six(s.transpose()),
            &out,
        )
    }

    /// Rows of the feedback sensors: six, or of both kinds twelve,
    /// accelerometers first.
    pub fn sensors(&self) -> Range<usize> {
        0..self.sensors
    }

    /// Rows of the performance accelerations.
    pub fn performance(&self) -> Range<usize> {
        self.sensors..self.sensors + self.performance
    }

    /// Rows of the acceleration of the machine as a rigid whole, in the modal
    /// coordinates of the design model: its momentum along each rigid mode,
    /// √kg·m/s².
    pub fn whole(&self) -> Range<usize> {
        let start = self.performance().end;
        start..start + LEGS
    }

    /// Rows of the second time derivatives of the actuated legs' elongations,
    /// m/s².
    pub fn legs(&self) -> Range<usize> {
        let start = self.whole().end;
        start..start + LEGS
    }

    /// Rows of the frame's acceleration along x, y and z, m/s²: the mean over
    /// the upper ends of the actuated legs.
    pub fn frame(&self) -> Range<usize> {
        let start = self.legs().end;
        start..start + 3
    }

    /// The pole pairs as resonances: Hz and half width, Hz.
    pub fn peaks(&self) -> Vec<(f64, f64)> {
        pole_peaks(self.poles.iter().map(|pole| &pole.lambda))
    }

    /// All transfer functions at `hz`.
    pub fn response(&self, hz: f64) -> Response<'_> {
        Response {
            terms: &self.terms,
            part: continuous(&self.poles, &self.slow, hz, Complex::ONE),
            sampled: None,
            sensors: self.sensors,
        }
    }
}

/// The transfer functions of `poles` at `hz`, those of the forces times `hold`.
fn continuous<'a>(
    poles: &[Pole],
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
fn gains(
    poles: &[Pole],
    passes: impl Fn(usize, Complex<f64>) -> [Complex<f64>; 2],
) -> Vec<[[Complex<f64>; 2]; 2]> {
    let j = Complex::new(0.0, 1.0);
    let of = |(k, pole): (usize, &Pole)| {
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
    fn new(poles: &[Pole]) -> Self {
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
    terms: &'a Terms,
    part: Part<'a>,
    /// What samples of the sensors see of sampled forces, where they are.
    sampled: Option<Part<'a>>,
    sensors: usize,
}

/// What goes with the terms at one frequency.
#[derive(Clone, Debug)]
struct Part<'a> {
    /// What the poles' parts are added to.
    direct: [Option<Scaled<'a>>; 2],
    /// By pole, for floor and forces: what goes with a term's outputs.
    gains: Vec<[[Complex<f64>; 2]; 2]>,
}

/// A real matrix, and its factors for the columns of the floor and the forces.
type Scaled<'a> = (&'a DMatrix<f64>, [Complex<f64>; 2]);

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

/// Lightly damped poles, rad/s, as peaks: Hz and half width, Hz.
pub fn pole_peaks<'a>(poles: impl IntoIterator<Item = &'a Complex<f64>>) -> Vec<(f64, f64)> {
    poles
        .into_iter()
        .filter(|s| s.im > 0.0 && s.re.abs() < 0.3 * s.im)
        .map(|s| (s.im / TAU, s.re.abs().max(1e-4 * s.im) / TAU))
        .collect()
}

/// One pole over a sample period, exactly, for inputs held in between.
#[derive(Clone, Copy, Debug)]
struct SampledPole {
    /// e^(λT).
    transition: Complex<f64>,
    /// From an input at the period's start and at its end, straight between.
    now: Complex<f64>,
    next: Complex<f64>,
    /// From one held from the start until the latch.
    before: Complex<f64>,
    /// From one held from the latch until the end.
    after: Complex<f64>,
    /// The mean over the period, from the state at its start and from the same
    /// inputs.
    mean: Means,
}

/// See [`SampledPole::mean`].
#[derive(Clone, Copy, Debug)]
struct Means {
    state: Complex<f64>,
    now: Complex<f64>,
    next: Complex<f64>,
    before: Complex<f64>,
    after: Complex<f64>,
}

/// (eˣ − 1 − x − … − xⁿ⁻¹/(n−1)!)/xⁿ: integrals of eˣ over and over.
fn phi(n: u32, x: Complex<f64>) -> Complex<f64> {
    if x.norm() < 0.5 {
        // Σ xᵏ/(k + n)!, to double precision.
        let mut term = Complex::from(1.0 / (1..=n).map(f64::from).product::<f64>());
        let mut sum = term;
        for k in 1..16 {
            term *= x / f64::from(k + n);
            sum += term;
        }
        sum
    } else if n == 0 {
        x.exp()
    } else {
        let before = 1.0 / (1..n).map(f64::from).product::<f64>();
        (phi(n - 1, x) - before) / x
    }
}

/// The plant as the board sees it: sampled at kT, forces latched a while later
/// and held for T.
///
/// With a latch delay of m·T + θ, 0 ≤ θ < T, the force of sample k acts from
/// (k + m)T + θ on. A sample sees what was latched before its instant; where a
/// latch and a sample coincide the sample comes first, as it does on a board
/// whose converter samples on the edge that also latches. The floor moves
/// straight from sample to sample.
///
/// Frequency responses from forces to sensors are from sample to sample; to all
/// else they are to the continuous signal at that frequency, for the samples of
/// an acceleration also hold the steps that the held forces make.
///
/// Amplifier and sensors with a bandwidth are first-order lags here, between
/// converters and machine; the continuous plant does not have them.
#[derive(Clone, Debug)]
pub struct SampledPlant {
    poles: Vec<SampledPole>,
    lagged: Lagged,
    /// m.
    pub(crate) whole_periods: usize,
    /// θ/T.
    part: f64,
    /// T, s.
    pub period: f64,
    /// The continuous plant.
    pub plant: Plant,
}

/// The plant between the converters: with the lags of amplifiers and sensors.
#[derive(Clone, Debug)]
struct Lagged {
    poles: Vec<Pole>,
    terms: Terms,
    direct: DMatrix<f64>,
    /// As [`Plant::slow`].
    slow: [DMatrix<f64>; 2],
}

impl Lagged {
    fn new(plant: &Plant, board: &Board) -> Self {
        let mut lagged = Self {
            poles: plant.poles.clone(),
            terms: plant.terms.clone(),
            direct: plant.state_space.d.clone(),
            slow: plant.slow.clone(),
        };
        let [value, slope] = &mut lagged.slow;
        // a/(s + a) is 1 − s/a + …
        if let Some(hz) = board.actuator_bandwidth {
            let mut slope = slope.columns_mut(LEGS, LEGS);
            slope -= value.columns(LEGS, LEGS) / (TAU * hz);
        }
        let kinds = [Some(board.sensor), board.beside].into_iter().flatten();
        let bandwidths = kinds.map(|sensor| sensor.bandwidth).enumerate();
        let lags = bandwidths.filter_map(|(kind, hz)| Some((kind * LEGS, TAU * hz?)));
        for (first, a) in lags.clone() {
            let mut slope = slope.rows_mut(first, LEGS);
            slope -= value.rows(first, LEGS) / a;
        }
        let real = |values: DVector<f64>| values.map(Complex::from);
        let unit = |size, i| real(DVector::from_fn(size, |j, _| f64::from(u8::from(i == j))));
        // a/(s + a)·1/(s − λ) in partial fractions, and the same for what is
        // direct: the lag's own pole has the residue a·G(−a).
        if let Some(hz) = board.actuator_bandwidth {
            let a = TAU * hz;
            let residue = lagged.at(-a) * a;
            for pole in &mut lagged.poles {
                let factor = a / (pole.lambda + a);
                for input in pole.input.iter_mut().skip(LEGS) {
                    *input *= factor;
                }
            }
            lagged.direct.columns_mut(LEGS, LEGS).fill(0.0);
            lagged.poles.extend((LEGS..INPUTS).map(|j| Pole {
                lambda: Complex::from(-a),
                pair: false,
                input: unit(INPUTS, j),
                output: real(residue.column(j).into_owned()),
            }));
        }
        // Before any of them: a kind's lag is not on the other's way.
        let residues: Vec<_> = lags.clone().map(|(_, a)| lagged.at(-a) * a).collect();
        for ((first, a), residue) in lags.zip(residues) {
            for pole in &mut lagged.poles {
                let factor = a / (pole.lambda + a);
                for output in pole.output.iter_mut().skip(first).take(LEGS) {
                    *output *= factor;
                }
            }
            lagged.direct.rows_mut(first, LEGS).fill(0.0);
            let outputs = lagged.direct.nrows();
            lagged.poles.extend((first..first + LEGS).map(|i| Pole {
                lambda: Complex::from(-a),
                pair: false,
                input: real(residue.row(i).transpose()),
                output: unit(outputs, i),
            }));
        }
        lagged.terms = Terms::new(&lagged.poles);
        lagged
    }

    /// G(s) for a real s.
    fn at(&self, s: f64) -> DMatrix<f64> {
        let mut sum = self.direct.clone();
        for pole in &self.poles {
            let twice = if pole.pair { 2.0 } else { 1.0 };
            let part = &pole.output * pole.input.transpose() * (twice / (s - pole.lambda));
            sum += part.map(|z| z.re);
        }
        sum
    }
}

/// The sampled plant as real matrices: a block of one or two states a pole.
pub(crate) struct SampledStateSpace {
    /// The diagonal blocks, by pole: first state, real and imaginary part of
    /// e^(λT), and whether there are two states.
    pub(crate) blocks: Vec<(usize, Complex<f64>, bool)>,
    /// The change over a period.
    pub(crate) change: ByInput,
    /// All outputs at the start of a period from the states.
    pub(crate) output: DMatrix<f64>,
    /// The mean of all outputs over a period from the states at its start.
    pub(crate) mean: DMatrix<f64>,
    /// The same from the inputs.
    pub(crate) mean_by: ByInput,
}

/// By what happens in a period.
pub(crate) struct ByInput {
    /// From floor accelerations at its start.
    pub(crate) now: MatrixXx6<f64>,
    /// At its end.
    pub(crate) next: MatrixXx6<f64>,
    /// From the forces latched in it.
    pub(crate) after: MatrixXx6<f64>,
    /// From the forces they take over from.
    pub(crate) before: MatrixXx6<f64>,
}

impl SampledPlant {
    /// Samples `plant` with the timing of `board`.
    pub fn new(plant: Plant, board: &Board) -> Self {
        let period = board.period();
        let periods = board.latch_delay / period;
        // A delay typed as a whole number of periods is one.
        let nearest = periods.round();
        let (whole_periods, part) = if (periods - nearest).abs() < 1e-9 {
            (nearest, 0.0)
        } else {
            (periods.floor(), (periods - periods.floor()) * period)
        };
        let lagged = Lagged::new(&plant, board);
        let poles = lagged
            .poles
            .iter()
            .map(|pole| {
                let x = pole.lambda * period;
                let rest = period - part;
                // Held for t, and the mean over the period of being held
                // since a while t before its end.
                let held = |t: f64| phi(1, pole.lambda * t) * t;
                let since = |t: f64| phi(2, pole.lambda * t) * (t * t / period);
                let ramp = phi(2, x) * period;
                let mean_ramp = phi(3, x) * period;
                SampledPole {
                    transition: x.exp(),
                    now: held(period) - ramp,
                    next: ramp,
                    before: (pole.lambda * rest).exp() * held(part),
                    after: held(rest),
                    mean: Means {
                        state: phi(1, x),
                        now: since(period) - mean_ramp,
                        next: mean_ramp,
                        before: since(period) - since(rest),
                        after: since(rest),
                    },
                }
            })
            .collect();
        Self {
            poles,
            lagged,
            // At most eight: checked with the file.
            whole_periods: whole_periods as usize,
            part: part / period,
            period,
            plant,
        }
    }

    /// D of the outputs as the ADC sees them.
    pub(crate) fn direct(&self) -> &DMatrix<f64> {
        &self.lagged.direct
    }

    /// How many samples old the force is that a sample sees.
    pub fn seen_delay(&self) -> usize {
        self.whole_periods + 1
    }

    /// e^(jωT) at `hz`.
    pub fn z(&self, hz: f64) -> Complex<f64> {
        Complex::cis(TAU * hz * self.period)
    }

    /// All transfer functions of the sampled plant at `hz`, forces counted from
    /// the sample they were computed from.
    pub fn response(&self, hz: f64) -> Response<'_> {
        let z = self.z(hz);
        let delay = z.powi(-(self.whole_periods as i32));
        let seen = delay / z;
        let passes = |k: usize, lambda| {
            let pole = &self.poles[k];
            let of = |x: Complex<f64>| {
                if lambda == self.lagged.poles[k].lambda {
                    x
                } else {
                    x.conj()
                }
            };
            let gain = (z - of(pole.transition)).inv();
            let force = gain * (of(pole.after) * delay + of(pole.before) * seen);
            [Complex::ZERO, force]
        };
        // Latched, then held for T.
        let turn = Complex::new(0.0, TAU * hz * self.period);
        let hold = delay * (-turn * self.part).exp() * phi(1, -turn);
        let Lagged {
            poles,
            terms,
            direct,
            slow,
        } = &self.lagged;
        Response {
            terms,
            sensors: self.plant.sensors,
            part: continuous(poles, slow, hz, hold),
            sampled: Some(Part {
                direct: [Some((direct, [Complex::ZERO, seen])), None],
                gains: gains(poles, passes),
            }),
        }
    }

    /// As real matrices, for marching and for eigenvalues.
    pub(crate) fn state_space(&self) -> SampledStateSpace {
        let mut blocks = Vec::new();
        let mut states = 0;
        for (sampled, pole) in self.poles.iter().zip(&self.lagged.poles) {
            blocks.push((states, sampled.transition, pole.pair));
            states += 1 + usize::from(pole.pair);
        }
        let outputs = self.plant.state_space.c.nrows();
        let mut output = DMatrix::zeros(outputs, states);
        let mut mean = DMatrix::zeros(outputs, states);
        let blank = |rows| MatrixXx6::zeros(rows);
        let by_input = |rows| ByInput {
            now: blank(rows),
            next: blank(rows),
            after: blank(rows),
            before: blank(rows),
        };
        let mut change = by_input(states);
        let mut mean_by = by_input(outputs);
        for ((sampled, pole), &(at, _, pair)) in
            self.poles.iter().zip(&self.lagged.poles).zip(&blocks)
        {
            for j in 0..LEGS {
                let (by_floor, by_leg) = (pole.input[j], pole.input[LEGS + j]);
                let mut put = |matrix: fn(&mut ByInput) -> &mut MatrixXx6<f64>, x: Complex<f64>| {
                    let matrix = matrix(&mut change);
                    matrix[(at, j)] = x.re;
                    if pair {
                        matrix[(at + 1, j)] = x.im;
                    }
                };
                put(|by| &mut by.now, sampled.now * by_floor);
                put(|by| &mut by.next, sampled.next * by_floor);
                put(|by| &mut by.after, sampled.after * by_leg);
                put(|by| &mut by.before, sampled.before * by_leg);
            }
            // y = output·ξ plus its conjugate for a pair.
            let twice = if pair { 2.0 } else { 1.0 };
            for (i, &c) in pole.output.iter().enumerate() {
                let c = twice * c;
                let put = |matrix: &mut DMatrix<f64>, c: Complex<f64>| {
                    matrix[(i, at)] = c.re;
                    if pair {
                        matrix[(i, at + 1)] = -c.im;
                    }
                };
                put(&mut output, c);
                put(&mut mean, c * sampled.mean.state);
                for j in 0..LEGS {
                    let (by_floor, by_leg) = (c * pole.input[j], c * pole.input[LEGS + j]);
                    mean_by.now[(i, j)] += (by_floor * sampled.mean.now).re;
                    mean_by.next[(i, j)] += (by_floor * sampled.mean.next).re;
                    mean_by.after[(i, j)] += (by_leg * sampled.mean.after).re;
                    mean_by.before[(i, j)] += (by_leg * sampled.mean.before).re;
                }
            }
        }
        let by_floor = self.lagged.direct.fixed_columns::<LEGS>(0);
        let by_leg = self.lagged.direct.fixed_columns::<LEGS>(LEGS);
        mean_by.now += by_floor * 0.5;
        mean_by.next += by_floor * 0.5;
        mean_by.after += by_leg * (1.0 - self.part);
        mean_by.before += by_leg * self.part;
        SampledStateSpace {
            blocks,
            change,
            output,
            mean,
            mean_by,
        }
    }
}
