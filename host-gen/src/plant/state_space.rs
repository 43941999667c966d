//! The plant as matrices.

use nalgebra::{DMatrix, DVector, MatrixXx6};
use shared::LEGS;

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

/// Outputs y = A·z̈ + D·z + F·q̈_r + B·σ while they are put together.
pub(super) struct Outputs {
    pub(super) acceleration: DMatrix<f64>,
    pub(super) displacement: DMatrix<f64>,
    pub(super) floor: MatrixXx6<f64>,
    pub(super) actuators: MatrixXx6<f64>,
}

impl Outputs {
    pub(super) fn zeros(count: usize, modes: usize) -> Self {
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
}
