//! A lower bound of the mean square that the search minimises.
//!
//! The motion is A − M·T·R: A of the sources without control, M from the forces along the modes to
//! the performance outputs, and R = P⁻¹·(what the sensors measure of the sources). T is block
//! diagonal, with a block for the modes that couple to each other. Each Φ that is orthogonal to
//! every causal T gives a bound of the integral J of ‖A − M·T·R‖²:
//!
//! J ≥ ∫ min over T of ‖A − M·T·R‖² + Re tr(Φ·T),
//!
//! where T only keeps its limits, at each frequency by itself. These are a ball ‖T − c·1‖ ≤ r.
//!
//! The programme that proposes Φ is the primal one: T at the points of a grid, orthogonal to a
//! finite number of Φ, by Newton's method with the barrier −ln det(r² − (T − c)ᴴ·(T − c)). T = 0 is
//! where it begins. Its multipliers are the coefficients of Φ.

use nalgebra::{Cholesky, Complex, DMatrix, DVector, Dyn};
use rayon::prelude::*;
use serde::Serialize;
use shared::LEGS;

use super::test_function::TestFunction;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::Gain;

/// What no controller that feeds back `blocks` of modes by themselves can pass.
#[derive(Clone, Debug, Serialize)]
pub struct MeanSquareBound {
    /// The rms that no such controller is below, m/s²; of displacements, m.
    pub rms: f64,
    /// The difference between two grids, one twice as fine as the other, dB; `rms` is the lower.
    pub grid_db: f64,
    /// The numbers of the modes, from 1, that couple to each other. A controller that the bound
    /// holds for moves no mode for what the sensors measure of another block; with one block, it is
    /// any.
    pub blocks: Vec<Vec<usize>>,
    /// Φ, by its entries.
    pub certificate: Vec<EntryFunction>,
}

/// What an entry of T is multiplied by in tr(Φ·T).
#[derive(Clone, Debug, Serialize)]
pub struct EntryFunction {
    /// The mode along which the force acts, from 1.
    pub to: usize,
    /// The mode that is measured, from 1.
    pub from: usize,
    /// The entry of Φ in row `from` and column `to`.
    pub function: TestFunction,
}

/// The limits of T at a frequency: ‖T − centre·1‖ ≤ radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ball {
    centre: f64,
    radius: f64,
}

impl Ball {
    /// A ball that has all T with σ_max(1 − T) ≤ `sensitivity` and σ_max(T) ≤ `roll_off`.
    ///
    /// For 0 ≤ c ≤ 1, ‖(T − c)x‖² = (1 − c)·‖T·x‖² + c·‖(T − 1)x‖² − c·(1 − c)·‖x‖². The c of the
    /// smallest ball is taken. If one of the limits lies within the other, it is that one.
    pub(super) fn new(sensitivity: f64, roll_off: f64) -> Self {
        if roll_off.is_infinite() {
            return Self {
                centre: 1.0,
                radius: sensitivity,
            };
        }
        let [s, t] = [sensitivity, roll_off].map(|x| x * x);
        let centre = (0.5 * (1.0 + t - s)).clamp(0.0, 1.0);
        Self {
            centre,
            radius: ((1.0 - centre) * t + centre * s - centre * (1.0 - centre)).sqrt(),
        }
    }
}

/// The entries of T that are not zero, row and column.
#[derive(Clone, Debug)]
pub(super) struct Pattern {
    entries: Vec<(usize, usize)>,
}

impl Pattern {
    /// Those between modes of the same block.
    pub(super) fn new(blocks: &[Vec<usize>]) -> Self {
        let pairs = |block: &Vec<usize>| {
            let block = block.clone();
            let columns = block.clone();
            block
                .into_iter()
                .flat_map(move |i| columns.clone().into_iter().map(move |j| (i, j)))
        };
        Self {
            entries: blocks.iter().flat_map(pairs).collect(),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }

    /// The functions of the entries, in their order.
    pub(super) fn certificate(&self, functions: Vec<TestFunction>) -> Vec<EntryFunction> {
        let pairs = self.entries.iter().zip(functions);
        let of = |(&(to, from), function): (&(usize, usize), TestFunction)| EntryFunction {
            to: to + 1,
            from: from + 1,
            function,
        };
        pairs.map(of).collect()
    }

    /// T.
    fn matrix(&self, t: &Entries) -> ComplexMatrix6 {
        let mut matrix = ComplexMatrix6::zeros();
        for (&at, t) in self.entries.iter().zip(t.iter()) {
            matrix[at] = *t;
        }
        matrix
    }
}

/// A number for each entry of a [`Pattern`].
type Entries = DVector<Complex<f64>>;

/// ‖A − M·T·R‖² times a weight, constant + Re(linear·t) + tᴴ·square·t.
#[derive(Clone, Debug)]
pub(super) struct Quadratic {
    constant: f64,
    linear: Entries,
    square: DMatrix<Complex<f64>>,
}

impl Quadratic {
    pub(super) fn new(pattern: &Pattern, weight: f64, a: &[Gain], m: &Gain, r: &[Gain]) -> Self {
        let inner = m.adjoint() * m;
        let mut outer = ComplexMatrix6::zeros();
        let mut cross = ComplexMatrix6::zeros();
        for (a, r) in a.iter().zip(r) {
            let r = r.fixed_rows::<LEGS>(0);
            outer += r * r.adjoint();
            cross += r * a.adjoint() * m;
        }
        let of = &pattern.entries;
        Self {
            constant: weight * a.iter().map(|a| a.norm_squared()).sum::<f64>(),
            linear: Entries::from_iterator(
                of.len(),
                of.iter().map(|(i, j)| cross[(*j, *i)] * (-2.0 * weight)),
            ),
            square: DMatrix::from_fn(of.len(), of.len(), |k, l| {
                let ((i, j), (p, q)) = (of[k], of[l]);
                inner[(i, p)] * outer[(q, j)] * Complex::from(weight)
            }),
        }
    }

    fn curved(&self, t: &Entries) -> f64 {
        t.dotc(&(&self.square * t)).re
    }

    fn value(&self, t: &Entries) -> f64 {
        self.constant + self.linear.dot(t).re + self.curved(t)
    }

    /// The linear form Re(slope·δt) by which the value changes at `t`.
    fn slope(&self, t: &Entries) -> Entries {
        &self.linear + (&self.square * t).map(|x| 2.0 * x.conj())
    }
}

/// A frequency with its weight in an integral over frequency, Hz, and what holds there.
#[derive(Clone, Debug)]
pub(super) struct Point {
    pub(super) z: Complex<f64>,
    pub(super) weight: f64,
    pub(super) ball: Ball,
    /// None outside of the band.
    pub(super) motion: Option<Quadratic>,
}

/// −ln det(r² − Dᴴ·D) with D = T − c, and what its derivatives are made of; none outside.
struct Barrier {
    value: f64,
    radius: f64,
    /// (r² − Dᴴ·D)⁻¹ and (r² − D·Dᴴ)⁻¹.
    inner: ComplexMatrix6,
    outer: ComplexMatrix6,
    /// (r² − Dᴴ·D)⁻¹·Dᴴ.
    slope: ComplexMatrix6,
}

impl Barrier {
    fn new(ball: Ball, t: &ComplexMatrix6) -> Option<Self> {
        let d = t - ComplexMatrix6::from_diagonal_element(ball.centre.into());
        let whole = ComplexMatrix6::from_diagonal_element((ball.radius * ball.radius).into());
        let inner = Cholesky::new(whole - d.adjoint() * d)?;
        // That of a matrix that is not positive has imaginary entries on its diagonal.
        let diagonal = inner.l_dirty().diagonal();
        if diagonal.iter().any(|x| x.re <= x.im.abs()) {
            return None;
        }
        let value = -2.0 * diagonal.iter().map(|x| x.re.ln()).sum::<f64>();
        let inner = inner.inverse();
        let outer = Cholesky::new(whole - d * d.adjoint())?.inverse();
        Some(Self {
            value,
            radius: ball.radius,
            slope: inner * d.adjoint(),
            inner,
            outer,
        })
    }
}

/// A vector or form of complex numbers as real ones: real parts, then imaginary ones with `sign`.
fn real(z: &Entries, sign: f64) -> DVector<f64> {
    let count = z.len();
    DVector::from_fn(2 * count, |i, _| {
        if i < count {
            z[i].re
        } else {
            sign * z[i - count].im
        }
    })
}

fn complex(x: &DVector<f64>) -> Entries {
    let count = x.len() / 2;
    Entries::from_fn(count, |i, _| Complex::new(x[i], x[count + i]))
}

/// How the cost at a point changes with T: slope·δx + ½·δxᵀ·curvature·δx, with the real parts of the
/// entries in x, then the imaginary ones.
struct Expansion {
    slope: DVector<f64>,
    curvature: DMatrix<f64>,
}

impl Point {
    /// weight·motion + `barrier` times that of the ball at `t`; none outside of the ball.
    fn cost(&self, pattern: &Pattern, barrier: f64, t: &Entries) -> Option<f64> {
        let wall = Barrier::new(self.ball, &pattern.matrix(t))?;
        Some(self.moved(t) + barrier * wall.value)
    }

    /// weight·motion at `t`.
    fn moved(&self, t: &Entries) -> f64 {
        self.motion
            .as_ref()
            .map_or(0.0, |motion| self.weight * motion.value(t))
    }

    fn expand(&self, pattern: &Pattern, barrier: f64, t: &Entries) -> Option<Expansion> {
        let count = pattern.len();
        let wall = Barrier::new(self.ball, &pattern.matrix(t))?;
        let twice = 2.0 * barrier;
        let mut slope = Entries::from_iterator(
            count,
            pattern
                .entries
                .iter()
                .map(|(i, j)| wall.slope[(*j, *i)] * twice),
        );
        let scale = twice * wall.radius * wall.radius;
        // The second derivative along z is zᴴ·hermitian·z + Re(zᵀ·symmetric·z).
        let of = &pattern.entries;
        let mut curvature = DMatrix::zeros(2 * count, 2 * count);
        let weighted = self.motion.as_ref().map(|motion| (motion, self.weight));
        for l in 0..count {
            let (p, q) = of[l];
            for k in 0..count {
                let (i, j) = of[k];
                let mut hermitian = wall.outer[(i, p)] * wall.inner[(q, j)] * scale;
                if let Some((motion, weight)) = weighted {
                    hermitian += motion.square[(k, l)] * (2.0 * weight);
                }
                let symmetric = wall.slope[(q, i)] * wall.slope[(j, p)] * twice;
                curvature[(k, l)] = hermitian.re + symmetric.re;
                curvature[(count + k, count + l)] = hermitian.re - symmetric.re;
                curvature[(k, count + l)] = -hermitian.im - symmetric.im;
                curvature[(count + k, l)] = hermitian.im - symmetric.im;
            }
        }
        if let Some((motion, weight)) = weighted {
            slope += motion.slope(t) * Complex::from(weight);
        }
        Some(Expansion {
            slope: real(&slope, -1.0),
            curvature,
        })
    }

    /// A lower bound of motion + Re(phi·t) in the ball, without weight: what its tangent at `t` is
    /// at least.
    fn below(&self, pattern: &Pattern, phi: &Entries, t: &Entries) -> f64 {
        let (mut form, mut rest) = (phi.clone(), 0.0);
        if let Some(motion) = &self.motion {
            form += motion.slope(t);
            rest = motion.constant - motion.curved(t);
        }
        let mut matrix = ComplexMatrix6::zeros();
        for ((i, j), y) in pattern.entries.iter().zip(form.iter()) {
            matrix[(*j, *i)] = *y;
        }
        let nuclear = matrix.singular_values().sum();
        rest + self.ball.centre * matrix.trace().re - self.ball.radius * nuclear
    }

    /// The least motion + Re(phi·t) in the ball, from below, without weight: to `tolerance`, if
    /// that is found.
    pub(super) fn least(&self, pattern: &Pattern, phi: &Entries, tolerance: f64) -> f64 {
        let mut t = Entries::zeros(pattern.len());
        let mut best = self.below(pattern, phi, &t);
        let Some(motion) = &self.motion else {
            return best;
        };
        let own = Self {
            weight: 1.0,
            ..self.clone()
        };
        let form = real(phi, -1.0);
        let above = |t: &Entries| motion.value(t) + phi.dot(t).re;
        let mut barrier = (above(&t) - best) / LEGS as f64;
        for _ in 0..STAGES {
            for _ in 0..STEPS {
                let Some((step, decrease)) = own.expand(pattern, barrier, &t).and_then(|here| {
                    let slope = here.slope + &form;
                    let step = Cholesky::new(here.curvature)?.solve(&-&slope);
                    let decrease = -slope.dot(&step);
                    Some((complex(&step), decrease))
                }) else {
                    return best;
                };
                let cost = |t: &Entries| Some(own.cost(pattern, barrier, t)? + phi.dot(t).re);
                let before = cost(&t);
                let moved = halved(|part| {
                    let to = &t + &step * Complex::from(part);
                    let enough = before? - 0.1 * part * decrease;
                    (cost(&to)? <= enough + ROUNDING * before?.abs()).then_some(to)
                });
                let Some(to) = moved else {
                    break;
                };
                t = to;
                if decrease < CLOSE * barrier {
                    break;
                }
            }
            best = best.max(self.below(pattern, phi, &t));
            if above(&t) - best < tolerance {
                break;
            }
            barrier *= REDUCTION;
        }
        best
    }
}

/// What test functions prove.
pub(super) struct Proof {
    /// One for each entry of the pattern.
    pub(super) functions: Vec<TestFunction>,
    /// Lower bounds of the mean square on two grids.
    pub(super) squares: [f64; 2],
}

/// The best coefficients found for `function` in each entry on the points of the programme,
/// `coarse`, and what they prove on two finer grids.
pub(super) fn certified(
    pattern: &Pattern,
    mut function: TestFunction,
    coarse: &[Point],
    fine: &[Vec<Point>; 2],
) -> Option<Proof> {
    let weights = coarse.iter().map(|point| (point.z, point.weight));
    let (basis, triangle) = function.orthonormal(&weights.collect::<Vec<_>>());
    let (found, reached) = propose(pattern, coarse, &basis)?;
    let found = triangle.solve_upper_triangular(&found)?;
    let functions = found.column_iter().map(|column| TestFunction {
        coefficients: column.iter().copied().collect(),
        ..function.clone()
    });
    let functions: Vec<_> = functions.collect();
    let squares = fine.each_ref().map(|points| {
        let moving = points.iter().filter(|point| point.motion.is_some());
        let band: f64 = moving.map(|point| point.weight).sum();
        proven(pattern, &functions, points, LEFT * reached / band)
    });
    Some(Proof { functions, squares })
}

/// What is found with a part of a step, the whole first, then halves.
fn halved<T>(mut with: impl FnMut(f64) -> Option<T>) -> Option<T> {
    (0..40).find_map(|k| with(0.5_f64.powi(k)))
}

/// Steps at a weight of the barrier, and weights.
const STEPS: usize = 40;
const STAGES: usize = 24;

/// Factor of the barrier's weight from one stage to the next.
const REDUCTION: f64 = 0.05;

/// Decrease at which a stage ends, as a part of the barrier's weight.
const CLOSE: f64 = 0.5;

/// What may be lost to the barrier in the end, as a part of the mean square.
const LOST: f64 = 3e-3;

/// Part of the mean square that the verification may leave.
const LEFT: f64 = 1e-3;

/// Rounding of a sum.
const ROUNDING: f64 = 1e-13;

/// The coefficients of the combinations of `basis`, one row for each point, for each entry of T,
/// and the mean square of the T that they belong to.
fn propose(
    pattern: &Pattern,
    points: &[Point],
    basis: &DMatrix<Complex<f64>>,
) -> Option<(DMatrix<f64>, f64)> {
    let (count, terms) = (pattern.len(), basis.ncols());
    // Of Re(w·ψ·t), by the real and imaginary parts of t.
    let weighted = |part: fn(&Complex<f64>) -> f64| {
        DMatrix::from_fn(points.len(), terms, |f, n| {
            points[f].weight * part(&basis[(f, n)])
        })
    };
    let parts = [weighted(|x| x.re), weighted(|x| -x.im)];
    let transposed = parts.each_ref().map(|part| part.transpose());
    let mut all: Vec<Entries> = vec![Entries::zeros(count); points.len()];
    let total = |all: &[Entries]| -> f64 {
        let pairs = points.iter().zip(all);
        pairs.map(|(point, t)| point.moved(t)).sum()
    };
    let size = (LEGS * points.len()) as f64;
    let mut barrier = 0.1 * total(&all) / size;
    let mut coefficients = DMatrix::zeros(terms, count);
    for _ in 0..STAGES {
        for _ in 0..STEPS {
            let solved: Option<Vec<_>> = points
                .par_iter()
                .zip(&all)
                .map(|(point, t)| {
                    let here = point.expand(pattern, barrier, t)?;
                    let inverse = Cholesky::new(here.curvature)?.inverse();
                    let free = real(t, 1.0) - &inverse * &here.slope;
                    Some((inverse, here.slope, free))
                })
                .collect();
            let solved = solved?;
            let schur = schur(count, &parts, &transposed, &solved);
            let mut right = DVector::zeros(count * terms);
            for k in 0..count {
                let [re, im] = [k, count + k].map(|row| {
                    DVector::from_iterator(points.len(), solved.iter().map(|(.., x)| x[row]))
                });
                right
                    .rows_mut(k * terms, terms)
                    .copy_from(&(&transposed[0] * re + &transposed[1] * im));
            }
            let found = positive(schur)?.solve(&right);
            coefficients = DMatrix::from_column_slice(terms, count, found.as_slice());
            let [re, im] = parts.each_ref().map(|part| part * &coefficients);
            let steps: Vec<(Entries, f64)> = solved
                .par_iter()
                .enumerate()
                .map(|(f, (inverse, slope, _))| {
                    let form = DVector::from_fn(2 * count, |i, _| {
                        if i < count {
                            re[(f, i)]
                        } else {
                            im[(f, i - count)]
                        }
                    });
                    let slope = slope + form;
                    let step = -(inverse * &slope);
                    (complex(&step), -slope.dot(&step))
                })
                .collect();
            let decrease: f64 = steps.iter().map(|(_, decrease)| decrease).sum();
            let cost = |all: &[Entries]| -> Option<f64> {
                let costs = points.par_iter().zip(all);
                let costs = costs.map(|(point, t)| point.cost(pattern, barrier, t));
                let costs: Option<Vec<f64>> = costs.collect();
                Some(costs?.iter().sum())
            };
            let before = cost(&all);
            let moved = halved(|part| {
                let to = all.iter().zip(&steps);
                let to = to.map(|(t, (step, _))| t + step * Complex::from(part));
                let to: Vec<_> = to.collect();
                let enough = before? - 0.1 * part * decrease;
                (cost(&to)? <= enough + ROUNDING * before?.abs()).then_some(to)
            });
            let Some(to) = moved else {
                break;
            };
            all = to;
            if decrease < CLOSE * barrier {
                break;
            }
        }
        if barrier * size < LOST * total(&all) {
            break;
        }
        barrier *= REDUCTION;
    }
    Some((coefficients, total(&all)))
}

/// The decomposition of a positive matrix that rounding may have made singular.
fn positive(matrix: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    [1e-13, 1e-11, 1e-9].into_iter().find_map(|part| {
        let mut matrix = matrix.clone();
        for i in 0..matrix.nrows() {
            matrix[(i, i)] *= 1.0 + part;
        }
        Cholesky::new(matrix)
    })
}

/// Σ over the points of formsᵀ·curvature⁻¹·forms, for the forms Re(w·ψ·t) of all entries.
fn schur(
    count: usize,
    parts: &[DMatrix<f64>; 2],
    transposed: &[DMatrix<f64>; 2],
    solved: &[(DMatrix<f64>, DVector<f64>, DVector<f64>)],
) -> DMatrix<f64> {
    let terms = parts[0].ncols();
    let pairs: Vec<_> = (0..count)
        .flat_map(|l| (0..=l).map(move |k| (k, l)))
        .collect();
    let blocks: Vec<_> = pairs
        .par_iter()
        .map(|(k, l)| {
            let side = |row: usize| {
                let mut sum = DMatrix::zeros(solved.len(), terms);
                for (part, column) in parts.iter().zip([*l, count + *l]) {
                    let factors = solved.iter().map(|(inverse, ..)| inverse[(row, column)]);
                    let factors = DVector::from_iterator(solved.len(), factors);
                    for (mut to, from) in sum.column_iter_mut().zip(part.column_iter()) {
                        to.cmpy(1.0, &factors, &from, 1.0);
                    }
                }
                sum
            };
            &transposed[0] * side(*k) + &transposed[1] * side(count + *k)
        })
        .collect();
    let mut whole = DMatrix::zeros(count * terms, count * terms);
    for ((k, l), block) in pairs.into_iter().zip(blocks) {
        let at = (k * terms, l * terms);
        whole.view_mut(at, (terms, terms)).copy_from(&block);
        let transposed = block.transpose();
        let at = (l * terms, k * terms);
        whole.view_mut(at, (terms, terms)).copy_from(&transposed);
    }
    whole
}

/// What the functions of the entries prove on `points`: a lower bound of the mean square, to
/// `tolerance` per Hz.
fn proven(pattern: &Pattern, functions: &[TestFunction], points: &[Point], tolerance: f64) -> f64 {
    let parts = points.par_iter().map(|point| {
        let phi = functions.iter().map(|function| function.at(point.z));
        let phi = Entries::from_iterator(pattern.len(), phi);
        point.weight * point.least(pattern, &phi, tolerance)
    });
    parts.collect::<Vec<_>>().into_iter().sum()
}
