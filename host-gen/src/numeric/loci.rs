//! Eigenvalues of a complex 6×6 matrix that changes with frequency.

use nalgebra::Complex;
use shared::LEGS;

use super::six::ComplexMatrix6;

/// QR steps after which the iteration ends. Two or three find an eigenvalue.
const STEPS: usize = 200;

/// The eigenvalues of a matrix.
pub(crate) type Eigenvalues = [Complex<f64>; LEGS];

/// Makes all entries below the first subdiagonal zero, by Gaussian elimination with pivots.
fn make_hessenberg(h: &mut ComplexMatrix6) {
    for k in 1..LEGS - 1 {
        let pivot = k + h.column(k - 1).rows_range(k..).icamax();
        if h[(pivot, k - 1)] == Complex::ZERO {
            continue;
        }
        h.swap_rows(pivot, k);
        h.swap_columns(pivot, k);
        let inverse = h[(k, k - 1)].inv();
        for i in k + 1..LEGS {
            let factor = h[(i, k - 1)] * inverse;
            if factor == Complex::ZERO {
                continue;
            }
            h[(i, k - 1)] = Complex::ZERO;
            for j in k..LEGS {
                let own = h[(k, j)];
                h[(i, j)] -= factor * own;
            }
            for j in 0..LEGS {
                let own = h[(j, i)];
                h[(j, k)] += factor * own;
            }
        }
    }
}

/// The eigenvalue of the last two rows and columns up to `last` that is nearer to the last entry
/// of the diagonal.
fn shift(h: &ComplexMatrix6, last: usize) -> Complex<f64> {
    let (a, d) = (h[(last - 1, last - 1)], h[(last, last)]);
    let half = (a - d) * 0.5;
    let product = h[(last - 1, last)] * h[(last, last - 1)];
    let root = (half * half + product).sqrt();
    let far = if (half * root.conj()).re < 0.0 {
        half - root
    } else {
        half + root
    };
    if far == Complex::ZERO {
        d
    } else {
        d - product / far
    }
}

/// The eigenvalues of a matrix, in no particular order; none if the iteration does not converge.
///
/// The QR iteration with one shift at a time, on the Hessenberg form.
pub(crate) fn eigenvalues(matrix: &ComplexMatrix6) -> Option<Eigenvalues> {
    let mut h = *matrix;
    make_hessenberg(&mut h);
    let mut found = [Complex::ZERO; LEGS];
    let mut last = LEGS - 1;
    let mut steps = 0;
    loop {
        // The first row of the part that no zero on the subdiagonal splits.
        let mut first = last;
        while first > 0 {
            let around = h[(first, first)].l1_norm() + h[(first - 1, first - 1)].l1_norm();
            if h[(first, first - 1)].l1_norm() <= f64::EPSILON * around {
                break;
            }
            first -= 1;
        }
        if first == last {
            found[last] = h[(last, last)];
            if last == 0 {
                return Some(found);
            }
            last -= 1;
            steps = 0;
            continue;
        }
        steps += 1;
        if steps > STEPS {
            return None;
        }
        // Now and then another shift, so that no cycle lasts.
        let shift = if steps % 10 == 0 {
            h[(last, last)] + h[(last, last - 1)].l1_norm()
        } else {
            shift(&h, last)
        };
        for i in first..=last {
            h[(i, i)] -= shift;
        }
        let mut turns = [(0.0, Complex::ZERO); LEGS];
        for k in first..last {
            let (a, b) = (h[(k, k)], h[(k + 1, k)]);
            let length = (a.norm_sqr() + b.norm_sqr()).sqrt();
            if length == 0.0 || !length.is_finite() {
                turns[k] = (1.0, Complex::ZERO);
                continue;
            }
            // [c, s; −s*, c] with real c takes the subdiagonal away.
            let norm = a.norm();
            let unit = if norm == 0.0 { Complex::ONE } else { a / norm };
            let (c, s) = (norm / length, unit * b.conj() / length);
            turns[k] = (c, s);
            h[(k, k)] = unit * length;
            h[(k + 1, k)] = Complex::ZERO;
            for j in k + 1..=last {
                let (x, y) = (h[(k, j)], h[(k + 1, j)]);
                h[(k, j)] = x * c + s * y;
                h[(k + 1, j)] = y * c - s.conj() * x;
            }
        }
        for k in first..last {
            let (c, s) = turns[k];
            for i in first..=(k + 1) {
                let (x, y) = (h[(i, k)], h[(i, k + 1)]);
                h[(i, k)] = x * c + s.conj() * y;
                h[(i, k + 1)] = y * c - s * x;
            }
        }
        for i in first..=last {
            h[(i, i)] += shift;
        }
    }
}

/// The eigenvalues `to` in the order in which they continue `from`, those nearest to each other
/// first, relative to their magnitude.
pub(crate) fn continued(from: &Eigenvalues, to: &Eigenvalues) -> Eigenvalues {
    let mut ordered = *to;
    let mut pairs = [(0.0, 0, 0); LEGS * LEGS];
    for (i, a) in from.iter().enumerate() {
        for (j, b) in to.iter().enumerate() {
            let apart = (a - b).norm_sqr() / (a.norm_sqr() + b.norm_sqr()).max(f64::MIN_POSITIVE);
            pairs[LEGS * i + j] = (apart, i, j);
        }
    }
    pairs.sort_unstable_by(|(a, ..), (b, ..)| a.total_cmp(b));
    let (mut used, mut placed) = ([false; LEGS], [false; LEGS]);
    for (_, i, j) in pairs {
        if !placed[i] && !used[j] {
            ordered[i] = to[j];
            placed[i] = true;
            used[j] = true;
        }
    }
    ordered
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Entries between −½ and ½ in both parts.
    fn entry(i: usize) -> Complex<f64> {
        let part = |by: f64| (by * (i as f64 + 1.0)).fract() - 0.5;
        Complex::new(part(0.618_034), part(0.414_214))
    }

    fn matrix(seed: usize) -> ComplexMatrix6 {
        ComplexMatrix6::from_fn(|i, j| entry(97 * seed + 6 * i + j))
    }

    /// The largest distance of an eigenvalue found to the one that it belongs to.
    fn apart(matrix: &ComplexMatrix6, expected: [Complex<f64>; LEGS]) -> f64 {
        let found = continued(&expected, &eigenvalues(matrix).unwrap());
        let pairs = expected.iter().zip(&found);
        pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    }

    /// V·diag(λ)·V⁻¹ has the eigenvalues λ, also if some are equal, or six orders of magnitude apart.
    #[test]
    fn eigenvalues_of_a_product() {
        for seed in 0..50 {
            let v = matrix(seed);
            let condition = v.norm() * v.try_inverse().unwrap().norm();
            let mut values: [Complex<f64>; LEGS] = core::array::from_fn(|i| entry(31 * seed + i));
            match seed % 3 {
                0 => {}
                1 => values[1] = values[0],
                _ => values[0] *= 1e6,
            }
            let diagonal = ComplexMatrix6::from_diagonal(&values.into());
            let product = v * diagonal * v.try_inverse().unwrap();
            // Rounding of the product, by the condition of V.
            let bound = 1e-15 * condition * condition * product.norm();
            assert!(apart(&product, values) < bound, "{seed}");
        }
    }

    #[test]
    fn eigenvalues_of_a_triangle_and_of_a_cycle() {
        let triangle = matrix(3).upper_triangle();
        let diagonal = core::array::from_fn(|i| triangle[(i, i)]);
        assert!(apart(&triangle, diagonal) < 1e-12);
        // A shift of coordinates: the sixth roots of one, at which unshifted steps stand still.
        let cycle = ComplexMatrix6::from_fn(|i, j| {
            Complex::from(if (i + 1) % LEGS == j { 1.0 } else { 0.0 })
        });
        let roots = core::array::from_fn(|i| Complex::cis(core::f64::consts::TAU * i as f64 / 6.0));
        assert!(apart(&cycle, roots) < 1e-12);
        assert_eq!(
            eigenvalues(&ComplexMatrix6::zeros()),
            Some([Complex::ZERO; LEGS])
        );
    }

    #[test]
    fn curves_are_continued() {
        let from: [Complex<f64>; LEGS] = core::array::from_fn(|i| entry(i) * 10f64.powi(i as i32));
        let mut moved = from.map(|x| x * Complex::new(1.05, 0.05));
        let expected = moved;
        moved.rotate_left(2);
        assert_eq!(continued(&from, &moved), expected);
    }
}
