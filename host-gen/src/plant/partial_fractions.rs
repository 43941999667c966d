//! The plant in modal form: a sum of poles, each with what drives it and what
//! shows it.

use nalgebra::{Complex, DMatrix, DVector, RowDVector};

use super::state_space::StateSpace;
use crate::numeric::NumericError;
use crate::numeric::eigen::eigenvalues;

/// One pole of the plant with what drives it and what shows it:
/// output·input/(s − λ), and the conjugate of it for a pair.
#[derive(Clone, Debug)]
pub struct PlantPole {
    /// λ, rad/s; of a pair the one above the real axis.
    pub lambda: Complex<f64>,
    /// Whether its conjugate is a pole too.
    pub pair: bool,
    pub(super) input: DVector<Complex<f64>>,
    pub(super) output: DVector<Complex<f64>>,
}

impl StateSpace {
    /// Partial fractions. None where A has no full set of eigenvectors, as
    /// with a mode damped exactly critically.
    ///
    /// # Errors
    /// Where the eigenvalue iteration does not converge.
    pub(super) fn poles(
        &self,
        squares: &DVector<f64>,
        damping: &DMatrix<f64>,
    ) -> Result<Option<Vec<PlantPole>>, NumericError> {
        let n = squares.len();
        let diagonal = (0..n).all(|i| (0..n).all(|j| i == j || damping[(i, j)] == 0.0));
        let mut poles = if diagonal {
            (0..n)
                .map(|i| self.poles_of_mode(i, squares[i], damping[(i, i)]))
                .collect::<Option<Vec<_>>>()
                .map(|of_modes| of_modes.concat())
        } else {
            self.coupled_poles(eigenvalues(&self.a)?)
        };
        if let Some(poles) = &mut poles {
            poles.sort_by(|a, b| a.lambda.norm().total_cmp(&b.lambda.norm()));
        }
        Ok(poles)
    }

    /// The poles of one mode, s² + Δ·s + Λ = (s − λ₁)(s − λ₂).
    fn poles_of_mode(&self, mode: usize, square: f64, damping: f64) -> Option<Vec<PlantPole>> {
        let n = self.a.nrows() / 2;
        let half = 0.5 * damping;
        let root = Complex::from(half * half - square).sqrt();
        if root == Complex::ZERO {
            return None;
        }
        let complex = |row: RowDVector<f64>| row.transpose().map(Complex::from);
        let input = complex(self.b.row(n + mode).into_owned());
        let shape = |column| self.c.column(column).map(Complex::from);
        let pole = |root: Complex<f64>, pair| {
            let lambda = root - half;
            PlantPole {
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

    /// The poles of modes that dampers couple, from the eigenvalues of A.
    ///
    /// Poles that symmetry makes equal get an orthonormal set of eigenvectors:
    /// those of an eigenvalue iteration may be parallel to all digits.
    fn coupled_poles(&self, mut values: Vec<Complex<f64>>) -> Option<Vec<PlantPole>> {
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
            let pole = PlantPole {
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
