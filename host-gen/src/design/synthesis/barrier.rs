//! Barriers that keep transfer matrices below a limit, with gradient and curvature.
//!
//! All matrices V of a loop change with the channel gains C = diag(c) by dV = −P·dC·Q. The
//! barrier −ln det(1 − VᴴV/γ²) of σ_max(V) < γ is convex in V. Its exact gradient and the
//! curvature that it has for V linear in C are collected here in terms of dc/c.

use nalgebra::{Complex, SMatrix};
use shared::LEGS;

use crate::numeric::loci::Eigenvalues;
use crate::numeric::products::{adjoint_product, product};
use crate::numeric::six::ComplexMatrix6;

type Square<const K: usize> = SMatrix<Complex<f64>, K, K>;

/// Columns for six floor motions, sensors or forces; one row for each channel gain.
pub(super) type Rows<const K: usize> = SMatrix<Complex<f64>, K, LEGS>;

/// What the terms at one frequency add to a cost, by relative changes x = dc/c of the K channel
/// gains: Re Σ gradient·x + ½·Re(Σ hermitian·x·x* + Σ symmetric·x*·x*).
#[derive(Clone)]
pub(super) struct Curvature<const K: usize> {
    pub(super) value: f64,
    pub(super) gradient: [Complex<f64>; K],
    pub(super) hermitian: Square<K>,
    pub(super) symmetric: Square<K>,
}

/// What the terms of one level add by changes of the logarithm of that level's limit.
#[derive(Clone)]
pub(super) struct LevelCurvature<const K: usize> {
    pub(super) slope: f64,
    pub(super) curvature: f64,
    /// Mixed with dc/c.
    pub(super) mixed: [Complex<f64>; K],
}

impl<const K: usize> Curvature<K> {
    pub(super) fn zero() -> Self {
        Self {
            value: 0.0,
            gradient: [Complex::ZERO; K],
            hermitian: Square::zeros(),
            symmetric: Square::zeros(),
        }
    }
}

impl<const K: usize> LevelCurvature<K> {
    pub(super) fn zero() -> Self {
        Self {
            slope: 0.0,
            curvature: 0.0,
            mixed: [Complex::ZERO; K],
        }
    }
}

/// A matrix V with its limit, and how it changes: dV = −P·dC·Q. P has six columns, also with
/// twelve gains: two gains of a mode act on the same force. V and P come in blocks of six rows.
pub(super) struct Bounded<'a, const K: usize> {
    pub(super) v: &'a [ComplexMatrix6],
    pub(super) p: &'a [ComplexMatrix6],
    pub(super) q: &'a Rows<K>,
    /// The limit γ of σ_max(V).
    pub(super) limit: f64,
}

/// Aᴴ·B of two matrices in blocks of rows.
fn gram(a: &[ComplexMatrix6], b: &[ComplexMatrix6]) -> ComplexMatrix6 {
    a.iter().zip(b).map(|(a, b)| adjoint_product(a, b)).sum()
}

/// The lower triangular inverse of the Cholesky factor of 1 − VᴴV/γ², and −ln of its
/// determinant; none if σ_max(V) is not below γ.
fn factor(v: &[ComplexMatrix6], limit: f64) -> Option<(ComplexMatrix6, f64)> {
    let mut m = gram(v, v) * Complex::from(-1.0 / (limit * limit));
    for i in 0..LEGS {
        m[(i, i)] += 1.0;
    }
    let mut lower = ComplexMatrix6::zeros();
    let mut log = 0.0;
    for j in 0..LEGS {
        let mut pivot = m[(j, j)].re;
        for k in 0..j {
            pivot -= lower[(j, k)].norm_sqr();
        }
        if pivot.is_nan() || pivot <= 1e-12 {
            return None;
        }
        log -= pivot.ln();
        let root = pivot.sqrt();
        lower[(j, j)] = Complex::from(root);
        for i in j + 1..LEGS {
            let mut x = m[(i, j)];
            for k in 0..j {
                x -= lower[(i, k)] * lower[(j, k)].conj();
            }
            lower[(i, j)] = x / root;
        }
    }
    Some((lower, log))
}

/// The inverse of a lower triangular matrix with real diagonal.
fn inverse_of_lower(lower: &ComplexMatrix6) -> ComplexMatrix6 {
    let mut inverse = ComplexMatrix6::zeros();
    for j in 0..LEGS {
        inverse[(j, j)] = Complex::from(1.0 / lower[(j, j)].re);
        for i in j + 1..LEGS {
            let mut x = Complex::ZERO;
            for k in j..i {
                x -= lower[(i, k)] * inverse[(k, j)];
            }
            inverse[(i, j)] = x / lower[(i, i)].re;
        }
    }
    inverse
}

impl<const K: usize> Bounded<'_, K> {
    /// The barrier alone; none if σ_max(V) is not below γ.
    pub(super) fn value(&self) -> Option<f64> {
        factor(self.v, self.limit).map(|(_, log)| log)
    }

    /// Adds the barrier at the channel gains `c`; false if σ_max(V) is not below γ.
    pub(super) fn add(
        &self,
        c: &[Complex<f64>; K],
        sum: &mut Curvature<K>,
        level: Option<&mut LevelCurvature<K>>,
    ) -> bool {
        let Some((lower, log)) = factor(self.v, self.limit) else {
            return false;
        };
        sum.value += log;
        let inverse = inverse_of_lower(&lower);
        let scale = Complex::from(1.0 / self.limit);
        // With U = V/γ and R' = (1 − UᴴU)⁻¹ = L⁻ᴴ·L⁻¹: Pᴴ(1 − UUᴴ)⁻¹P = PᴴP + XᴴX and
        // Q·R'·Qᴴ = YᴴY with X = L⁻¹UᴴP and Y = L⁻¹Qᴴ.
        let x = product(&inverse, &gram(self.v, self.p)) * (scale * scale);
        let y: SMatrix<Complex<f64>, LEGS, K> = product(&inverse, &self.q.adjoint());
        let pp = gram(self.p, self.p) * (scale * scale) + adjoint_product(&x, &x);
        let qq = adjoint_product(&y, &y);
        let e = adjoint_product(&x, &y);
        for k in 0..K {
            sum.gradient[k] -= c[k] * e[(k % LEGS, k)].conj() * 2.0;
            for l in 0..K {
                let (i, j) = (k % LEGS, l % LEGS);
                sum.hermitian[(k, l)] += c[k] * c[l].conj() * pp[(j, i)] * qq[(k, l)] * 2.0;
                sum.symmetric[(k, l)] += (c[k] * c[l]).conj() * e[(j, k)] * e[(i, l)] * 2.0;
            }
        }
        if let Some(level) = level {
            let whole = adjoint_product(&inverse, &inverse);
            let trace = inverse.norm_squared();
            level.slope -= 2.0 * (trace - LEGS as f64);
            level.curvature += 4.0 * (whole.norm_squared() - trace);
            let z = adjoint_product(&inverse, &x);
            let w = adjoint_product(&inverse, &y);
            for k in 0..K {
                let i = k % LEGS;
                let own = w.column(k).dotc(&z.column(i)) * 2.0 - e[(i, k)].conj();
                level.mixed[k] += c[k] * own * 2.0;
            }
        }
        true
    }
}

/// Keeps the eigenvalues of L that have a negative real part and a magnitude above one away from the
/// negative real axis: then 1 + g·L is singular at no gain g from 0 to 1.
///
/// The barrier of an eigenvalue λ is a function of u = (`least`/sin(arg λ))². It grows beyond all
/// limits where u reaches 1, and is zero below [`FELT`].
#[derive(Clone, Copy)]
pub(super) struct Sector {
    /// The least |sin(arg λ)|.
    least: f64,
}

/// [`Sector::least`] as a part of what |1 + λ| is at the limit of σ_max(S), 1/γ.
///
/// On the circle over [−1, 0], |sin(arg λ)| is |1 + λ|, which S below its limit keeps above 1/γ. So
/// the barrier is zero there, and has no step where an eigenvalue enters the circle.
const SOFTLY: f64 = 1.0 / 3.0;

/// The least u at which a [`Sector`]'s barrier is not zero.
const FELT: f64 = SOFTLY * SOFTLY;

/// Distance from an eigenvalue to the point at which the resolvent gives its projection, as a part
/// of the eigenvalue. Eigenvalues that are nearer to each other count as equal.
const BESIDE: f64 = 1e-6;

/// A barrier as a function of u, with two derivatives.
fn felt(u: f64) -> [f64; 3] {
    let inverse = 1.0 / (1.0 - u);
    let at = 1.0 / (1.0 - FELT);
    [
        (inverse / at).ln() - (u - FELT) * at,
        inverse - at,
        inverse * inverse,
    ]
}

impl Sector {
    /// The sector for a loop with σ_max(S) below `limit`.
    pub(super) fn new(limit: f64) -> Self {
        Self {
            least: SOFTLY / limit,
        }
    }

    /// u of an eigenvalue, if its barrier is not zero.
    pub(super) fn nearness(self, eigenvalue: Complex<f64>) -> Option<f64> {
        let square = eigenvalue.norm_sqr();
        // Within the circle over [−1, 0], no gain up to 1 brings 1 + g·λ nearer to zero than 1.
        if eigenvalue.re >= 0.0 || square <= -eigenvalue.re {
            return None;
        }
        let u = self.least * self.least * square / (eigenvalue.im * eigenvalue.im);
        (u > FELT).then_some(u)
    }

    /// The barrier of all eigenvalues; none if one is in the sector.
    pub(super) fn value(self, eigenvalues: &Eigenvalues) -> Option<f64> {
        let mut sum = 0.0;
        for u in eigenvalues.iter().filter_map(|x| self.nearness(*x)) {
            if u >= 1.0 {
                return None;
            }
            sum += felt(u)[0];
        }
        Some(sum)
    }

    /// Adds the barrier at the channel gains `c`; false if an eigenvalue of `l`, which is C·G, is
    /// in the sector.
    pub(super) fn add<const K: usize>(
        self,
        c: &[Complex<f64>; K],
        g: &Rows<K>,
        l: &ComplexMatrix6,
        eigenvalues: &Eigenvalues,
        sum: &mut Curvature<K>,
        mut level: Option<&mut LevelCurvature<K>>,
    ) -> bool {
        for eigenvalue in eigenvalues {
            let Some(u) = self.nearness(*eigenvalue) else {
                continue;
            };
            if u >= 1.0 {
                return false;
            }
            // The projection on its eigenvector, or on those of all that are equal, from the
            // resolvent right beside it.
            let beside = eigenvalue * (1.0 + BESIDE);
            let Some(resolvent) = (ComplexMatrix6::identity() * beside - l).try_inverse() else {
                return false;
            };
            let gp = product(g, &resolvent);
            let scale = (resolvent.trace() * eigenvalue).inv();
            // d(ln λ) = Σ y·dc/c.
            let y: [Complex<f64>; K] = core::array::from_fn(|k| gp[(k, k % LEGS)] * c[k] * scale);
            let cot = eigenvalue.re / eigenvalue.im;
            let [value, by_u, twice] = felt(u);
            let slope = -2.0 * u * cot;
            let first = by_u * slope;
            let second = twice * slope * slope + by_u * u * (6.0 * cot * cot + 2.0);
            sum.value += value;
            for k in 0..K {
                sum.gradient[k] += Complex::new(y[k].im, -y[k].re) * first;
                for l in 0..K {
                    sum.hermitian[(k, l)] += y[k] * y[l].conj() * (0.5 * second);
                    sum.symmetric[(k, l)] -= (y[k] * y[l]).conj() * (0.5 * second);
                }
            }
            if let Some(level) = &mut level {
                level.slope -= 2.0 * u * by_u;
                level.curvature += 4.0 * u * (twice * u + by_u);
                let mixed = -2.0 * slope * (u * twice + by_u);
                for (sum, y) in level.mixed.iter_mut().zip(&y) {
                    *sum += Complex::new(y.im, -y.re) * mixed;
                }
            }
        }
        true
    }
}

/// Adds weight·Σ ‖V‖² for each V with its Q, dV = −P·dC·Q.
pub(super) fn add_square<const K: usize>(
    c: &[Complex<f64>; K],
    weight: f64,
    p: &[ComplexMatrix6],
    moved: impl Iterator<Item = (Vec<ComplexMatrix6>, Rows<K>)>,
    sum: &mut Curvature<K>,
) {
    let pp = gram(p, p);
    let mut e = SMatrix::<Complex<f64>, LEGS, K>::zeros();
    let mut qq = Square::<K>::zeros();
    for (v, q) in moved {
        sum.value += weight * v.iter().map(ComplexMatrix6::norm_squared).sum::<f64>();
        let adjoint = q.adjoint();
        e += product(&gram(p, &v), &adjoint);
        qq += product(&q, &adjoint);
    }
    for k in 0..K {
        sum.gradient[k] -= c[k] * e[(k % LEGS, k)].conj() * (2.0 * weight);
        for l in 0..K {
            let (i, j) = (k % LEGS, l % LEGS);
            sum.hermitian[(k, l)] += c[k] * c[l].conj() * pp[(j, i)] * qq[(k, l)] * (2.0 * weight);
        }
    }
}
