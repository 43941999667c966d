//! The generalised plant as matrices for other programs.

use std::fmt::Write as _;

use nalgebra::DMatrix;

use super::generalised::Plant;
use super::state_space::INPUTS;

/// The generalised plant G of Fig. 4 as matrices.
///
/// The inputs are the six floor accelerations, m/s², and the six leg forces, N. The outputs are
/// the performance accelerations, m/s², and the sensors, m/s² or N. The states are the modal
/// coordinates and their rates.
pub struct Generalised {
    /// A of Eq. (3), 2n×2n for n modes.
    pub a: DMatrix<f64>,
    /// B of Eq. (3), 2n×12: floor accelerations, then leg forces.
    pub b: DMatrix<f64>,
    /// C of Eq. (4), one row for each output: performance, then sensors.
    pub c: DMatrix<f64>,
    /// D of Eq. (4), with the rows of C and the columns of B.
    pub d: DMatrix<f64>,
}

impl Generalised {
    /// The matrices of `plant`, with its performance outputs and then its sensors as the only
    /// outputs.
    pub fn new(plant: &Plant) -> Self {
        let ss = &plant.state_space;
        let order = |m| Self::outputs(plant, m);
        debug_assert_eq!(ss.b.ncols(), INPUTS);
        Self {
            a: ss.a.clone(),
            b: ss.b.clone(),
            c: order(&ss.c),
            d: order(&ss.d),
        }
    }

    /// The rows of `m`, one for each output of `plant`, that are those of the performance outputs, and
    /// then those of the sensors.
    pub fn outputs(plant: &Plant, m: &DMatrix<f64>) -> DMatrix<f64> {
        let count = plant.performance().len();
        let sensors = plant.sensors();
        let mut out = DMatrix::zeros(count + sensors.len(), m.ncols());
        out.rows_mut(0, count)
            .copy_from(&m.rows_range(plant.performance()));
        out.rows_mut(count, sensors.len())
            .copy_from(&m.rows_range(sensors));
        out
    }
}

/// A matrix as the text of a dense Matrix Market file.
///
/// Python (`scipy.io.mmread`) and Julia (`MatrixMarket.mmread`) read this format; Octave does not
/// without a function from elsewhere. The numbers read back to the same bits.
pub fn matrix_market(matrix: &DMatrix<f64>) -> String {
    let mut text = String::from("%%MatrixMarket matrix array real general\n");
    // Writing to a String cannot fail.
    writeln!(text, "{} {}", matrix.nrows(), matrix.ncols()).unwrap_or_default();
    for x in matrix.iter() {
        writeln!(text, "{x:e}").unwrap_or_default();
    }
    text
}

/// A matrix as plain text: one line for each row, with a space between two numbers.
///
/// Octave and MATLAB (`load`), Julia (`DelimitedFiles.readdlm`) and Python (`numpy.loadtxt`) read
/// it without packages of their own. The numbers read back to the same bits.
pub fn plain_text(matrix: &DMatrix<f64>) -> String {
    let rows = matrix.row_iter().map(|row| {
        let numbers: Vec<String> = row.iter().map(|x| format!("{x:e}")).collect();
        numbers.join(" ") + "\n"
    });
    rows.collect()
}
