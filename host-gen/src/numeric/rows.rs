//! Linear dependence of rows.

use nalgebra::{DMatrix, DVector};

/// The index of the first row that depends linearly on the rows before it; `None` if all rows
/// are independent.
///
/// A row is dependent if at most `tolerance` of its length is orthogonal to the rows before it.
/// A zero row is dependent.
pub fn first_dependent_row(rows: &DMatrix<f64>, tolerance: f64) -> Option<usize> {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for (i, row) in rows.row_iter().enumerate() {
        let mut rest = row.transpose();
        let length = rest.norm();
        // Twice, because one pass leaves an error that grows with the condition number.
        for _ in 0..2 {
            for direction in &basis {
                let along = direction.dot(&rest);
                rest.axpy(-along, direction, 1.0);
            }
        }
        if rest.norm() <= tolerance * length || length == 0.0 {
            return Some(i);
        }
        basis.push(rest.normalize());
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dependent_row_is_named() {
        let rows = DMatrix::from_row_slice(3, 3, &[1.0, 2.0, 3.0, 0.0, 1.0, 0.0, 2.0, 5.0, 6.0]);
        assert_eq!(first_dependent_row(&rows, 1e-9), Some(2));
        let free = DMatrix::from_row_slice(3, 3, &[1.0, 2.0, 3.0, 0.0, 1.0, 0.0, 2.0, 5.0, 6.1]);
        assert_eq!(first_dependent_row(&free, 1e-9), None);
    }
}
