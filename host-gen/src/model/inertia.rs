//! Coordinates with and without inertia.

use nalgebra::linalg::Cholesky;
use nalgebra::{DMatrix, DVector};

use super::independence::reach;
use super::layout::Layout;
use crate::machine::Structure;

/// The N coordinates of a machine, with and without inertia.
#[derive(Clone, Debug)]
pub(super) struct Inertia {
    /// X as columns, with XᵀMX = 1.
    pub(super) with: DMatrix<f64>,
    /// The motions without inertia, as columns: rotations of point masses and thin rods, and
    /// nodes that only beams without mass hold.
    pub(super) without: DMatrix<f64>,
}

/// A principal moment of inertia, relative to the body's largest one and to its mass times the
/// square of the machine's size, that counts as zero. Also the part of a coordinate's inertia that
/// remains if all others are free to follow it.
const NO_INERTIA: f64 = 1e-12;

/// A moment of inertia, relative to mass times the square of the machine's size, that rounding
/// leaves of zero.
const ROUNDING: f64 = 1e-15;

impl Inertia {
    /// `spread` tells of each coordinate whether mass is spread over it and others, as a beam's is
    /// over its ends; all others are those of rigid bodies alone.
    pub(super) fn new(
        machine: &Structure,
        layout: &Layout,
        mass: &DMatrix<f64>,
        spread: &[bool],
    ) -> Self {
        let size = layout.size();
        let length = reach(machine);
        let (mut with, mut without) = (Vec::new(), Vec::new());
        let mut coupled = Vec::new();
        for (i, body) in machine.bodies.iter().enumerate() {
            if spread[6 * i] {
                coupled.extend(6 * i..6 * i + 6);
                continue;
            }
            for axis in 0..3 {
                let mut column = DVector::zeros(size);
                column[6 * i + axis] = 1.0 / body.mass.sqrt();
                with.push(column);
            }
            let (moments, axes) = body.principal();
            let scale = moments.amax().max(body.mass * length * length);
            for (moment, axis) in moments.iter().zip(axes.column_iter()) {
                let none = *moment <= NO_INERTIA * scale;
                let mut column = DVector::zeros(size);
                let size = if none { 1.0 } else { moment.sqrt() };
                column.rows_mut(6 * i + 3, 3).copy_from(&(axis / size));
                if none { &mut without } else { &mut with }.push(column);
            }
        }
        coupled.extend(layout.own());
        let has_own = |&i: &usize| {
            let scale = if layout.turns(i) {
                mass[(i - 3, i - 3)] * length * length
            } else {
                0.0
            };
            mass[(i, i)] > ROUNDING * scale
        };
        let (coupled, none): (Vec<usize>, Vec<usize>) = coupled.iter().partition(|i| has_own(i));
        without.extend(none.iter().map(|&i| {
            let mut column = DVector::zeros(size);
            column[i] = 1.0;
            column
        }));
        for (inert, columns) in split(mass, &coupled) {
            let all = if inert { &mut with } else { &mut without };
            all.extend(columns.column_iter().map(|column| {
                let mut whole = DVector::zeros(size);
                for (&i, x) in coupled.iter().zip(column.iter()) {
                    whole[i] = *x;
                }
                whole
            }));
        }
        let columns = |all: Vec<DVector<f64>>| match &all[..] {
            [] => DMatrix::zeros(size, 0),
            all => DMatrix::from_columns(all),
        };
        Self {
            with: columns(with),
            without: columns(without),
        }
    }
}

/// The motions with inertia, X with XᵀMX = 1, and those without, as columns in the coordinates
/// `of`, whose own masses are above 0.
fn split(mass: &DMatrix<f64>, of: &[usize]) -> [(bool, DMatrix<f64>); 2] {
    let n = of.len();
    // Relative to its own inertia, no coordinate is small because of its unit or of a light part.
    let scale: Vec<f64> = of.iter().map(|&i| mass[(i, i)].sqrt()).collect();
    let relative = DMatrix::from_fn(n, n, |i, j| mass[(of[i], of[j])] / (scale[i] * scale[j]));
    let own = |mut columns: DMatrix<f64>| {
        for (mut row, scale) in columns.row_iter_mut().zip(&scale) {
            row /= *scale;
        }
        columns
    };
    if let Some(factor) = Cholesky::new(relative.clone()) {
        let l = factor.l();
        let least = l.diagonal().iter().fold(1.0, |a: f64, x| a.min(x * x));
        if least > NO_INERTIA.sqrt() {
            let inverse = l.solve_lower_triangular(&DMatrix::identity(n, n));
            if let Some(inverse) = inverse {
                return [
                    (true, own(inverse.transpose())),
                    (false, DMatrix::zeros(n, 0)),
                ];
            }
        }
    }
    let eigen = relative.symmetric_eigen();
    let inert = |wanted: bool| -> Vec<usize> {
        let all = 0..n;
        all.filter(|&i| (eigen.eigenvalues[i] > NO_INERTIA) == wanted)
            .collect()
    };
    let mut with = eigen.eigenvectors.select_columns(&inert(true));
    for (mut column, &i) in with.column_iter_mut().zip(&inert(true)) {
        column /= eigen.eigenvalues[i].sqrt();
    }
    let without = eigen.eigenvectors.select_columns(&inert(false));
    [(true, own(with)), (false, own(without))]
}
