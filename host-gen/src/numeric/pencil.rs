//! Finite eigenvalues of a matrix pencil, with those at zero and at infinity told apart by rank.

use nalgebra::{Complex, DMatrix};

use super::NumericError;
use super::eigen::{eigenvalues, generalised_eigenvalues};

/// A singular value below this part of the matrix' size is zero to rounding.
const RANK: f64 = 1e-11;

/// The finite eigenvalues of a pencil s·E − F.
#[derive(Clone, Debug)]
pub struct Finite {
    /// Those that are not zero, in no particular order.
    pub others: Vec<Complex<f64>>,
    /// How many are exactly zero.
    pub at_zero: usize,
}

/// The finite s for which s·E − F is singular. E and F are square and of the same size, with
/// entries of about 1.
///
/// Infinite eigenvalues and those at zero are counted by the rank of E and F and taken out step by
/// step with orthogonal transforms (the staircase form of Van Dooren, 1979), because rounding turns
/// each of them into a value of any sign: a double one at zero into the square root of the
/// precision.
///
/// # Errors
/// [`NumericError::Singular`] if s·E − F is singular for every s, and
/// [`NumericError::NotConverged`] if the eigenvalue iteration does not converge.
pub fn finite_eigenvalues(e: DMatrix<f64>, f: DMatrix<f64>) -> Result<Finite, NumericError> {
    let [e, f] = without_infinite(e, f)?;
    let before = e.nrows();
    // Eigenvalues at zero are the infinite ones of 1/s.
    let [f, e] = without_infinite(f, e)?;
    let at_zero = before - e.nrows();
    let others = if e.nrows() == 0 {
        Vec::new()
    } else if condition(&e) < 1e8
        && let Some(a) = e.clone().lu().solve(&f)
    {
        eigenvalues(&a)?
    } else {
        generalised_eigenvalues(&f, &e)?
    };
    Ok(Finite { others, at_zero })
}

fn condition(matrix: &DMatrix<f64>) -> f64 {
    let values = matrix.singular_values();
    values.max() / values.min()
}

/// The pencil without its infinite eigenvalues: E is regular afterwards.
fn without_infinite(
    mut e: DMatrix<f64>,
    mut f: DMatrix<f64>,
) -> Result<[DMatrix<f64>; 2], NumericError> {
    if e.nrows() == 0 {
        return Ok([e, f]);
    }
    let (zero_e, zero_f) = (RANK * e.norm(), RANK * f.norm());
    while e.nrows() > 0 {
        let n = e.nrows();
        let Svd { u, values, .. } = Svd::new(&e)?;
        let (kept, dropped) = split(&values, zero_e);
        if dropped.is_empty() {
            break;
        }
        // These rows have no s: they are conditions on the vector.
        let conditions = u.select_columns(&dropped).transpose() * &f;
        let mut square = DMatrix::zeros(n, n);
        square.rows_mut(0, dropped.len()).copy_from(&conditions);
        let Svd { v, values, .. } = Svd::new(&square)?;
        let (bound, free) = split(&values, zero_f);
        if bound.len() < dropped.len() {
            return Err(NumericError::Singular);
        }
        let rows = u.select_columns(&kept).transpose();
        let free = v.select_columns(&free);
        e = &rows * e * &free;
        f = rows * f * free;
    }
    Ok([e, f])
}

/// U, singular values and V of a square matrix.
///
/// By faer: nalgebra's iteration loses digits where many singular values are equal or zero, as
/// here.
struct Svd {
    u: DMatrix<f64>,
    values: Vec<f64>,
    v: DMatrix<f64>,
}

impl Svd {
    fn new(matrix: &DMatrix<f64>) -> Result<Self, NumericError> {
        let n = matrix.nrows();
        let svd = faer::Mat::from_fn(n, n, |i, j| matrix[(i, j)])
            .svd()
            .map_err(|_| NumericError::NotConverged)?;
        Ok(Self {
            u: DMatrix::from_fn(n, n, |i, j| svd.U()[(i, j)]),
            values: (0..n).map(|i| svd.S()[i]).collect(),
            v: DMatrix::from_fn(n, n, |i, j| svd.V()[(i, j)]),
        })
    }
}

/// Indices of the singular values above `zero`, and of the others.
fn split(values: &[f64], zero: f64) -> (Vec<usize>, Vec<usize>) {
    (0..values.len()).partition(|&i| values[i] > zero)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// (s + 3) beside a double zero at s = 0 and a chain of two at infinity, mixed by an
    /// orthogonal matrix.
    #[test]
    fn zero_and_infinite_eigenvalues_are_counted() {
        let mut e = DMatrix::zeros(5, 5);
        let mut f = DMatrix::zeros(5, 5);
        (e[(0, 0)], f[(0, 0)]) = (1.0, -3.0);
        (e[(1, 1)], e[(2, 2)], f[(1, 2)]) = (1.0, 1.0, 1.0);
        (e[(3, 4)], f[(3, 3)], f[(4, 4)]) = (1.0, 1.0, 1.0);
        let mixed = |seed: f64| {
            DMatrix::from_fn(5, 5, |i, j| (seed + (7 * i + 3 * j * j) as f64).sin())
                .qr()
                .q()
        };
        let (left, right) = (mixed(0.3), mixed(1.7));
        let finite = finite_eigenvalues(&left * e * &right, &left * f * &right).unwrap();
        assert_eq!(finite.at_zero, 2);
        assert_eq!(finite.others.len(), 1);
        assert!((finite.others[0] + 3.0).norm() < 1e-12);
    }

    #[test]
    fn a_singular_pencil_is_an_error() {
        let mut e = DMatrix::identity(3, 3);
        e[(2, 2)] = 0.0;
        let mut f = DMatrix::identity(3, 3);
        f[(2, 2)] = 0.0;
        assert!(finite_eigenvalues(e, f).is_err());
    }
}
