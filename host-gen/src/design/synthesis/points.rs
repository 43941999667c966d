//! The loop of one machine at the frequencies of a grid, with its terms.

use core::slice::from_ref;

use nalgebra::{Complex, SMatrix};
use shared::LEGS;

use super::barrier::{Bounded, Curvature, LevelCurvature, Rows, Sector, add_square};
use crate::numeric::loci::{Eigenvalues, eigenvalues};
use crate::numeric::products::product;
use crate::numeric::singular::largest_singular_value;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::Gain;

/// Any number of rows, in blocks of six; zeros fill the last.
type Blocks = Vec<ComplexMatrix6>;

/// What a point of a grid is for.
#[derive(Clone)]
pub(super) enum Purpose<const K: usize> {
    /// The sensitivity, and the complementary sensitivity with its limit there.
    Loop {
        /// The largest allowed σ_max(T); infinite for none.
        roll_off: f64,
    },
    /// The motion of an output.
    Output(Output<K>),
}

/// Outputs that see each source through the loop: V = direct − from_modes·C·S·to_modes.
#[derive(Clone)]
pub(super) struct Output<const K: usize> {
    /// From forces along the modes to the outputs.
    pub(super) from_modes: Blocks,
    pub(super) sources: Vec<Source<K>>,
    pub(super) goal: Goal,
}

/// Six independent sources of motion: of the floor, or noise.
#[derive(Clone)]
pub(super) struct Source<const K: usize> {
    /// To the outputs without control.
    pub(super) direct: Blocks,
    /// To the channels.
    pub(super) to_modes: Rows<K>,
}

impl<const K: usize> Output<K> {
    /// V of each source, and X = S·C·to_modes, the forces along the modes.
    fn motions(
        &self,
        s: &ComplexMatrix6,
        c: &[Complex<f64>; K],
    ) -> impl Iterator<Item = (&Source<K>, Blocks, ComplexMatrix6)> {
        self.sources.iter().map(move |source| {
            let forces = product(s, &times(c, &source.to_modes));
            let pairs = source.direct.iter().zip(&self.from_modes);
            let v = pairs.map(|(direct, from_modes)| direct - product(from_modes, &forces));
            (source, v.collect(), forces)
        })
    }
}

/// The rows of `matrix` in blocks.
pub(super) fn blocks(matrix: &Gain) -> Blocks {
    (0..matrix.nrows().div_ceil(LEGS))
        .map(|block| {
            ComplexMatrix6::from_fn(|i, j| {
                let entry = matrix.get((block * LEGS + i, j));
                entry.copied().unwrap_or(Complex::ZERO)
            })
        })
        .collect()
}

/// The largest singular value of a matrix in blocks.
fn largest(blocks: &[ComplexMatrix6]) -> f64 {
    let whole = Gain::from_fn(LEGS * blocks.len(), |i, j| blocks[i / LEGS][(i % LEGS, j)]);
    largest_singular_value(&whole)
}

/// What a term wants of an output.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Goal {
    /// σ_max(V) below `limit`, times the exponential of a level if it has one, by its index.
    Below { limit: f64, level: Option<usize> },
    /// weight·‖V‖² as a part of the mean square.
    Square(f64),
}

/// The loop at one frequency.
#[derive(Clone)]
pub(super) struct Point<const K: usize> {
    /// z − 1.
    pub(super) delta: Complex<f64>,
    /// Gain of each channel without its filters.
    pub(super) base: [Complex<f64>; K],
    /// The plant from forces along the modes to the channels.
    pub(super) plant: SMatrix<Complex<f64>, K, LEGS>,
    pub(super) purpose: Purpose<K>,
}

/// The matrices that turn the loop to the legs and to the sensors.
#[derive(Clone)]
pub(super) struct Openings {
    /// T_out and its inverse.
    pub(super) legs: [ComplexMatrix6; 2],
    /// T_in⁻¹ and T_in of each kind of sensors.
    pub(super) sensors: Vec<[ComplexMatrix6; 2]>,
}

/// The limits of σ_max(S) at the modes and elsewhere, and the part of the roll-off's limits that
/// is used.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    pub(super) modes: f64,
    pub(super) elsewhere: f64,
    pub(super) roll_off: f64,
    /// Whether the loop must be stable at every gain of the soft start.
    pub(super) soft_start: bool,
}

impl Limits {
    /// The sector that eigenvalues of L must leave free, if the loop must start softly.
    pub(super) fn sector(self) -> Option<Sector> {
        self.soft_start.then(|| Sector::new(self.modes))
    }

    /// The limits on perturbed machines, of which no soft start is asked.
    pub(super) fn of_perturbed(self) -> Self {
        Self {
            soft_start: false,
            ..self
        }
    }

    /// All limits times `factor`.
    pub(super) fn scaled(self, factor: f64) -> Self {
        Self {
            modes: self.modes * factor,
            elsewhere: self.elsewhere * factor,
            roll_off: self.roll_off * factor,
            ..self
        }
    }
}

/// By what limits are multiplied.
#[derive(Clone, Copy)]
pub(super) struct Widening<'a> {
    /// Whether level 0 also widens the limits that have no level of their own.
    pub(super) all: bool,
    /// The logarithms of factors.
    pub(super) levels: &'a [f64],
}

impl Widening<'_> {
    /// The level of a limit with its own level `own` or none.
    fn level(self, own: Option<usize>) -> Option<usize> {
        own.or(self.all.then_some(0))
    }

    /// The factor of a limit with its own level `own` or none.
    fn factor(self, own: Option<usize>) -> f64 {
        let level = self.level(own);
        level.map_or(1.0, |level| self.levels[level].exp())
    }
}

/// What a point adds.
pub(super) struct PointCost<const K: usize> {
    pub(super) terms: Curvature<K>,
    /// The level of the terms, if they have one, and what changing it does.
    pub(super) level: Option<(usize, LevelCurvature<K>)>,
    /// The part of the mean square.
    pub(super) square: Curvature<K>,
    /// The eigenvalues of L at a point of the loop.
    pub(super) eigenvalues: Option<Eigenvalues>,
}

/// C·G: gains times the plant, 6×6.
fn times<const K: usize>(
    c: &[Complex<f64>; K],
    rows: &SMatrix<Complex<f64>, K, LEGS>,
) -> ComplexMatrix6 {
    let mut product = ComplexMatrix6::zeros();
    for j in 0..LEGS {
        for (k, gain) in c.iter().enumerate() {
            product[(k % LEGS, j)] += gain * rows[(k, j)];
        }
    }
    product
}

/// S = (1 + L)⁻¹.
fn sensitivity(l: &ComplexMatrix6) -> Option<ComplexMatrix6> {
    (ComplexMatrix6::identity() + l).try_inverse()
}

impl<const K: usize> Point<K> {
    /// The level of its limit, if it has one.
    pub(super) fn level(&self) -> Option<usize> {
        match &self.purpose {
            Purpose::Output(Output {
                goal: Goal::Below { level, .. },
                ..
            }) => *level,
            _ => None,
        }
    }

    /// Whether it is a point of the loop.
    pub(super) fn is_of_loop(&self) -> bool {
        matches!(self.purpose, Purpose::Loop { .. })
    }

    /// L with the loop opened at the modes, at the channel gains `c`.
    fn loop_gain(&self, c: &[Complex<f64>; K]) -> ComplexMatrix6 {
        times(c, &self.plant)
    }

    /// The eigenvalues of L at the channel gains `c`.
    pub(super) fn eigenvalues(&self, c: &[Complex<f64>; K]) -> Option<Eigenvalues> {
        eigenvalues(&self.loop_gain(c))
    }

    /// Calls `each` with every bounded matrix of the loop and its level; false as soon as a call
    /// returns false.
    fn bounded(
        &self,
        c: &[Complex<f64>; K],
        s: &ComplexMatrix6,
        openings: &Openings,
        limits: Limits,
        mut each: impl FnMut(Bounded<'_, K>) -> bool,
    ) -> bool {
        let Purpose::Loop { roll_off } = self.purpose else {
            return true;
        };
        let q = product(&self.plant, s);
        let [out, out_inverse] = &openings.legs;
        let legs = product(out, s);
        if !each(Bounded {
            v: from_ref(s),
            p: from_ref(s),
            q: &q,
            limit: limits.modes,
        }) || !each(Bounded {
            v: &[product(&legs, out_inverse)],
            p: &[legs],
            q: &product(&q, out_inverse),
            limit: limits.elsewhere,
        }) {
            return false;
        }
        if roll_off.is_finite()
            && !each(Bounded {
                v: &[ComplexMatrix6::identity() - s],
                p: &[-s],
                q: &q,
                limit: roll_off * limits.roll_off,
            })
        {
            return false;
        }
        // At the sensors of a kind: V = T⁻¹·(1 − G·S·C)·T, and dV = −T⁻¹·G·S·dC·(1 − G·S·C)·T.
        openings
            .sensors
            .iter()
            .enumerate()
            .all(|(kind, [inverse, input])| {
                let first = kind * LEGS;
                let mut rest = SMatrix::<Complex<f64>, K, LEGS>::zeros();
                for j in 0..LEGS {
                    // 1 − G·S·C: the columns of this kind's gains.
                    rest.set_column(j, &(q.column(j) * -c[first + j]));
                    rest[(first + j, j)] += 1.0;
                }
                let rest = product(&rest, input);
                let rows = |of: &Rows<K>| of.fixed_rows::<LEGS>(first).into_owned();
                each(Bounded {
                    v: &[product(inverse, &rows(&rest))],
                    p: &[product(inverse, &rows(&q))],
                    q: &rest,
                    limit: limits.elsewhere,
                })
            })
    }

    /// The costs of this point at the channel gains `c`, with derivatives; none if a limit is
    /// passed.
    pub(super) fn cost(
        &self,
        c: &[Complex<f64>; K],
        openings: &Openings,
        limits: Limits,
        widening: Widening<'_>,
    ) -> Option<PointCost<K>> {
        let l = self.loop_gain(c);
        let s = sensitivity(&l)?;
        let mut cost = PointCost {
            terms: Curvature::zero(),
            level: None,
            square: Curvature::zero(),
            eigenvalues: None,
        };
        match &self.purpose {
            Purpose::Loop { .. } => {
                let index = widening.level(None);
                let mut level = index.map(|_| LevelCurvature::zero());
                let terms = &mut cost.terms;
                let limits = limits.scaled(widening.factor(None));
                if !self.bounded(c, &s, openings, limits, |bounded| {
                    bounded.add(c, terms, level.as_mut())
                }) {
                    return None;
                }
                let eigenvalues = eigenvalues(&l)?;
                if let Some(sector) = limits.sector()
                    && !sector.add(c, &self.plant, &l, &eigenvalues, terms, level.as_mut())
                {
                    return None;
                }
                cost.level = index.zip(level);
                cost.eigenvalues = Some(eigenvalues);
            }
            Purpose::Output(output) => {
                let p: Blocks = output.from_modes.iter().map(|m| product(m, &s)).collect();
                let moved = output.motions(&s, c).map(|(source, v, forces)| {
                    let q = source.to_modes - product(&self.plant, &forces);
                    (v, q)
                });
                let (limit, index) = match output.goal {
                    Goal::Square(weight) => {
                        add_square(c, weight, &p, moved, &mut cost.square);
                        return Some(cost);
                    }
                    Goal::Below { limit, level } => {
                        (limit * widening.factor(level), widening.level(level))
                    }
                };
                let mut level = index.map(|_| LevelCurvature::zero());
                for (v, q) in moved {
                    let bounded = Bounded {
                        v: &v,
                        p: &p,
                        q: &q,
                        limit,
                    };
                    if !bounded.add(c, &mut cost.terms, level.as_mut()) {
                        return None;
                    }
                }
                cost.level = index.zip(level);
            }
        }
        Some(cost)
    }

    /// The barrier, the part of the mean square, and the eigenvalues of L: as [`Self::cost`], without
    /// derivatives.
    pub(super) fn value(
        &self,
        c: &[Complex<f64>; K],
        openings: &Openings,
        limits: Limits,
        widening: Widening<'_>,
    ) -> Option<(f64, f64, Option<Eigenvalues>)> {
        let l = self.loop_gain(c);
        let s = sensitivity(&l)?;
        let mut sum = 0.0;
        let Purpose::Output(output) = &self.purpose else {
            let limits = limits.scaled(widening.factor(None));
            let inside = self.bounded(c, &s, openings, limits, |bounded| {
                bounded.value().is_some_and(|value| {
                    sum += value;
                    true
                })
            });
            if !inside {
                return None;
            }
            let eigenvalues = eigenvalues(&l)?;
            if let Some(sector) = limits.sector() {
                sum += sector.value(&eigenvalues)?;
            }
            return Some((sum, 0.0, Some(eigenvalues)));
        };
        let limit = match output.goal {
            Goal::Square(weight) => {
                let size = |v: Blocks| v.iter().map(ComplexMatrix6::norm_squared).sum::<f64>();
                let square: f64 = output.motions(&s, c).map(|(_, v, _)| size(v)).sum();
                return Some((0.0, weight * square, None));
            }
            Goal::Below { limit, level } => limit * widening.factor(level),
        };
        for (source, v, _) in output.motions(&s, c) {
            let bounded = Bounded {
                v: &v,
                p: &output.from_modes,
                q: &source.to_modes,
                limit,
            };
            sum += bounded.value()?;
        }
        Some((sum, 0.0, None))
    }

    /// The largest factor by which a matrix at this point exceeds its limit, or, for a level, its
    /// limit at level 0. This leaves out the eigenvalues.
    pub(super) fn excess(&self, c: &[Complex<f64>; K], openings: &Openings, limits: Limits) -> f64 {
        let Some(s) = sensitivity(&self.loop_gain(c)) else {
            return f64::INFINITY;
        };
        let mut highest = 0.0_f64;
        match &self.purpose {
            Purpose::Loop { .. } => {
                self.bounded(c, &s, openings, limits, |bounded| {
                    highest = highest.max(largest(bounded.v) / bounded.limit);
                    true
                });
            }
            Purpose::Output(output) => {
                if let Goal::Below { limit, .. } = output.goal {
                    for (_, v, _) in output.motions(&s, c) {
                        highest = highest.max(largest(&v) / limit);
                    }
                }
            }
        }
        highest
    }
}
