//! The plant as partial fractions: one term for each pole.

use nalgebra::{Complex, DMatrix, DVector, RowDVector};

use super::state_space::StateSpace;
use crate::numeric::NumericError;
use crate::numeric::eigen::eigenvalues;

/// A pole λ of the plant with its residue output·inputᵀ: the term output·inputᵀ/(s − λ), plus its
/// conjugate if the pole is one of a pair.
#[derive(Clone, Debug)]
pub struct PlantPole {
    /// The pole λ, rad/s. Of a conjugate pair, the one above the real axis.
    pub lambda: Complex<f64>,
    /// Whether the conjugate of λ is a pole too.
    pub pair: bool,
    pub(super) input: DVector<Complex<f64>>,
    pub(super) output: DVector<Complex<f64>>,
}

impl StateSpace {
    /// The partial fractions, in ascending order of |λ|. `None` if A has no full set of
    /// eigenvectors, for example because a mode is exactly critically damped.
    ///
    /// `squares` are ω² of the undamped modes, rad²/s², and `damping` is Δ in their coordinates,
    /// 1/s.
    ///
    /// # Errors
    /// If the eigenvalue iteration for modes coupled by dampers does not converge.
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

    /// The poles of one mode that no damper couples to others, from
    /// s² + Δ·s + Λ = (s − λ₁)·(s − λ₂). `None` if the two are equal.
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

    /// The poles of modes that dampers couple, from the eigenvalues of A. `None` if A has no full
    /// set of eigenvectors.
    ///
    /// Poles that are equal by symmetry get orthonormal eigenvectors from a singular value
    /// decomposition. Those of an eigenvalue iteration can be parallel to rounding.
    fn coupled_poles(&self, mut values: Vec<Complex<f64>>) -> Option<Vec<PlantPole>> {
        let size = values.iter().map(|z| z.norm()).fold(0.0, f64::max);
        let zero = 1e-12 * size;
        // A pole below the real axis is the conjugate of one above.
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
            // Each eigenvector needs a singular value that is zero to rounding.
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

/// Poles count as equal if they differ by less than this factor times the largest |λ|.
const EQUAL: f64 = 1e-9;
