//! Products of small complex matrices.

use nalgebra::{Complex, SMatrix};

/// A·B: sums of real products, which a processor forms side by side. nalgebra's complex product
/// takes several times as long.
pub(crate) fn product<const R: usize, const M: usize, const C: usize>(
    a: &SMatrix<Complex<f64>, R, M>,
    b: &SMatrix<Complex<f64>, M, C>,
) -> SMatrix<Complex<f64>, R, C> {
    let mut product = SMatrix::zeros();
    let (a, b) = (&a.data.0, &b.data.0);
    let out: &mut [[Complex<f64>; R]; C] = &mut product.data.0;
    for (out, b) in out.iter_mut().zip(b) {
        // A times the real part of B's column, and A times its imaginary part.
        let mut real = [[0.0; 2]; R];
        let mut imaginary = [[0.0; 2]; R];
        for (a, b) in a.iter().zip(b) {
            for i in 0..R {
                real[i][0] += a[i].re * b.re;
                real[i][1] += a[i].im * b.re;
                imaginary[i][0] += a[i].re * b.im;
                imaginary[i][1] += a[i].im * b.im;
            }
        }
        for i in 0..R {
            out[i] = Complex::new(real[i][0] - imaginary[i][1], real[i][1] + imaginary[i][0]);
        }
    }
    product
}

/// Aᴴ·B.
pub(crate) fn adjoint_product<const R: usize, const M: usize, const C: usize>(
    a: &SMatrix<Complex<f64>, M, R>,
    b: &SMatrix<Complex<f64>, M, C>,
) -> SMatrix<Complex<f64>, R, C> {
    product(&a.adjoint(), b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_nalgebras() {
        let entry = |i: usize| {
            let part = |by: f64| (by * (i as f64 + 1.0)).fract() - 0.5;
            Complex::new(part(0.618_034), part(0.414_214))
        };
        let a = SMatrix::<Complex<f64>, 6, 12>::from_fn(|i, j| entry(17 * i + j));
        let b = SMatrix::<Complex<f64>, 12, 3>::from_fn(|i, j| entry(5 * i + 7 * j + 3));
        let c = SMatrix::<Complex<f64>, 6, 3>::from_fn(|i, j| entry(i + 11 * j + 2));
        // A product of twelve terms below one, in another order.
        assert!((product(&a, &b) - a * b).camax() < 1e-14);
        assert!((adjoint_product(&a, &c) - a.adjoint() * c).camax() < 1e-14);
    }
}
