//! Eigenvalues of a complex 6×6 matrix that changes with frequency.

use nalgebra::Complex;
use shared::LEGS;

use super::six::ComplexMatrix6;

/// QR steps after which the iteration ends. Two or three find an eigenvalue.
const STEPS: usize = 200;

/// The magnitude up to a factor of √2, which needs no root.
fn size(z: Complex<f64>) -> f64 {
    z.re.abs() + z.im.abs()
}

/// Makes all entries below the first subdiagonal zero, by Gaussian elimination with pivots.
fn make_hessenberg(h: &mut ComplexMatrix6) {
    for k in 1..LEGS - 1 {
        let pivot = (k..LEGS).fold(k, |best, i| {
            if size(h[(i, k - 1)]) > size(h[(best, k - 1)]) {
                i
            } else {
                best
            }
        });
        if size(h[(pivot, k - 1)]) == 0.0 {
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
    if size(far) == 0.0 { d } else { d - product / far }
}

/// The eigenvalues of a matrix, in no particular order; none if the iteration does not converge.
///
/// The QR iteration with one shift at a time, on the Hessenberg form.
pub(crate) fn eigenvalues(matrix: &ComplexMatrix6) -> Option<[Complex<f64>; LEGS]> {
    let mut h = *matrix;
    make_hessenberg(&mut h);
    let mut found = [Complex::ZERO; LEGS];
    let mut last = LEGS - 1;
    let mut steps = 0;
    loop {
        // The first row of the part that no zero on the subdiagonal splits.
        let mut first = last;
        while first > 0 {
            let around = size(h[(first, first)]) + size(h[(first - 1, first - 1)]);
            if size(h[(first, first - 1)]) <= f64::EPSILON * around {
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
            h[(last, last)] + size(h[(last, last - 1)])
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
pub(crate) fn continued(
    from: &[Complex<f64>; LEGS],
    to: &[Complex<f64>; LEGS],
) -> [Complex<f64>; LEGS] {
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
