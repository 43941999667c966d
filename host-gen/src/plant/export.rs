//! The generalised plant for other programs.

use std::fmt::Write as _;

use nalgebra::DMatrix;

use super::generalised::Plant;
use super::state_space::INPUTS;

/// The generalised plant G of Fig. 4 as matrices: inputs are the six floor
/// accelerations and the six leg forces; outputs the performance accelerations
/// and the sensors.
pub struct Generalised {
    /// A.
    pub a: DMatrix<f64>,
    /// B.
    pub b: DMatrix<f64>,
    /// C.
    pub c: DMatrix<f64>,
    /// D.
    pub d: DMatrix<f64>,
}

impl Generalised {
    /// Of a plant: its outputs, the sensors last, the rigid whole left out.
    pub fn new(plant: &Plant) -> Self {
        let ss = &plant.state_space;
        let order = |m: &DMatrix<f64>| {
            let count = plant.performance().len();
            let sensors = plant.sensors();
            let mut out = DMatrix::zeros(count + sensors.len(), m.ncols());
            out.rows_mut(0, count)
                .copy_from(&m.rows_range(plant.performance()));
            out.rows_mut(count, sensors.len())
                .copy_from(&m.rows_range(sensors));
            out
        };
        debug_assert_eq!(ss.b.ncols(), INPUTS);
        Self {
            a: ss.a.clone(),
            b: ss.b.clone(),
            c: order(&ss.c),
            d: order(&ss.d),
        }
    }
}

/// A matrix as a dense Matrix Market file, which Python (`scipy.io.mmread`),
/// Octave (`mmread`) and Julia (`MatrixMarket.mmread`) read. Numbers read back
/// to the same bits.
pub fn matrix_market(matrix: &DMatrix<f64>) -> String {
    let mut text = String::from("%%MatrixMarket matrix array real general\n");
    // Writing to a String cannot fail.
    writeln!(text, "{} {}", matrix.nrows(), matrix.ncols()).unwrap_or_default();
    for x in matrix.iter() {
        writeln!(text, "{x:e}").unwrap_or_default();
    }
    text
}
