//! The plant as matrices A, B, C and D.

use nalgebra::{DMatrix, DVector, MatrixXx6};
use shared::LEGS;

/// Number of inputs of the plant: the six floor accelerations of Eq. (8), m/s², then the six leg
/// forces of Eq. (9), N.
pub const INPUTS: usize = 2 * LEGS;

/// A linear system ẋ = A·x + B·u, Eq. (3), with outputs y = C·x + D·u, Eq. (4).
///
/// The state is x = (z, ż) with the modal coordinates z, √kg·m. n modes have 2n states.
#[derive(Clone, Debug)]
pub struct StateSpace {
    /// A of Eq. (3), 2n×2n: [[0, 1], [−Λ, −Δ]] with Λ in rad²/s² and Δ in 1/s.
    pub a: DMatrix<f64>,
    /// B of Eq. (3), 2n×12. Columns are the inputs as in [`INPUTS`].
    pub b: DMatrix<f64>,
    /// C of Eq. (4), with one row for each output. For the rows see
    /// [`Plant::sensors`](super::Plant::sensors) and the methods after it.
    pub c: DMatrix<f64>,
    /// D of Eq. (4), direct feedthrough from the inputs to the outputs, rows as in C.
    pub d: DMatrix<f64>,
}

/// A discrete linear system ξ⁺ = A·ξ + B·u, y = C·ξ + D·u for one sample.
#[derive(Clone, Debug)]
pub struct DiscreteStateSpace {
    /// A, square, one row for each state.
    pub a: DMatrix<f64>,
    /// B, one column for each input.
    pub b: DMatrix<f64>,
    /// C, one row for each output.
    pub c: DMatrix<f64>,
    /// D, with the rows of C and the columns of B.
    pub d: DMatrix<f64>,
}

/// The outputs in terms of z̈, ż, z, q̈_r and σ, each with one row for each output:
/// y = acceleration·z̈ + velocity·ż + (displacement + weight)·z + floor·q̈_r + actuators·σ.
pub(super) struct Outputs {
    pub(super) acceleration: DMatrix<f64>,
    pub(super) velocity: DMatrix<f64>,
    pub(super) displacement: DMatrix<f64>,
    /// Added to `displacement`: what the accelerometers read of the weight.
    pub(super) weight: DMatrix<f64>,
    pub(super) floor: MatrixXx6<f64>,
    pub(super) actuators: MatrixXx6<f64>,
}

impl Outputs {
    pub(super) fn zeros(count: usize, modes: usize) -> Self {
        Self {
            acceleration: DMatrix::zeros(count, modes),
            velocity: DMatrix::zeros(count, modes),
            displacement: DMatrix::zeros(count, modes),
            weight: DMatrix::zeros(count, modes),
            floor: MatrixXx6::zeros(count),
            actuators: MatrixXx6::zeros(count),
        }
    }
}

impl StateSpace {
    /// A and B of Eq. (6) in modal coordinates, and C and D of the `outputs`.
    ///
    /// The modes follow z̈ + Δ·ż + Λ·z = b_r·q̈_r + b_a·σ, with `squares` the diagonal of Λ,
    /// `damping` Δ, `floor` b_r and `actuators` b_a.
    pub(super) fn new(
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
            velocity,
            displacement,
            weight,
            ..
        } = outputs;
        let mut c = DMatrix::zeros(acceleration.nrows(), 2 * n);
        c.columns_mut(0, n)
            .copy_from(&(displacement + weight - acceleration * stiffness));
        c.columns_mut(n, n)
            .copy_from(&(velocity - acceleration * damping));
        let mut d = DMatrix::zeros(acceleration.nrows(), INPUTS);
        d.columns_mut(0, LEGS)
            .copy_from(&(acceleration * floor + &outputs.floor));
        d.columns_mut(LEGS, LEGS)
            .copy_from(&(acceleration * actuators + &outputs.actuators));
        Self { a, b, c, d }
    }
}
