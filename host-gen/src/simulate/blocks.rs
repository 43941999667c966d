//! Fast products of small matrices.

use nalgebra::DMatrix;

/// A matrix in blocks of four rows, the last one padded with zeros. The sums of a block fit into
/// the vector registers of any processor.
pub(super) struct Blocks(Vec<Vec<[f64; BLOCK]>>);

pub(super) const BLOCK: usize = 4;

impl Blocks {
    pub(super) fn new(matrix: &DMatrix<f64>) -> Self {
        let block = |first| {
            let entry = |i, j| matrix.get((first + i, j)).map_or(0.0, |x: &f64| *x);
            (0..matrix.ncols())
                .map(|j| core::array::from_fn(|i| entry(i, j)))
                .collect()
        };
        Self((0..matrix.nrows()).step_by(BLOCK).map(block).collect())
    }

    /// `sum` += matrix·`vector`; `sum` in blocks as the matrix.
    pub(super) fn add_product(&self, vector: &[f64], sum: &mut [[f64; BLOCK]]) {
        for (columns, sum) in self.0.iter().zip(sum) {
            // Two sums, so that one need not wait for the other. Both are local: the compiler cannot
            // know that `sum` is none of the columns.
            let mut even = *sum;
            let mut odd = [0.0; BLOCK];
            let mut columns = columns.chunks_exact(2);
            let mut pairs = vector.chunks_exact(2);
            for (columns, x) in columns.by_ref().zip(pairs.by_ref()) {
                for i in 0..BLOCK {
                    even[i] += columns[0][i] * x[0];
                    odd[i] += columns[1][i] * x[1];
                }
            }
            for (column, x) in columns.remainder().iter().zip(pairs.remainder()) {
                for i in 0..BLOCK {
                    even[i] += column[i] * x;
                }
            }
            for i in 0..BLOCK {
                sum[i] = even[i] + odd[i];
            }
        }
    }
}
