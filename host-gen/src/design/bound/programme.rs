//! The convex programme whose solution is a test function.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, SecondOrderConeT, SupportedConeT, ZeroConeT,
};
use nalgebra::{Complex, DMatrix};

use super::limits::Limit;

/// A point of the unit circle with its weight in the mean, and the limits of t there.
pub(super) struct Sample {
    pub(super) z: Complex<f64>,
    pub(super) weight: f64,
    /// At least one.
    pub(super) limits: Vec<Limit>,
}

/// A matrix under construction, by its entries; rows of cones in order.
#[derive(Default)]
struct Rows {
    rows: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
    right: Vec<f64>,
}

impl Rows {
    /// A row of s = right − Σ entries·x.
    fn push(&mut self, entries: impl IntoIterator<Item = (usize, f64)>, right: f64) {
        let row = self.right.len();
        for (column, value) in entries {
            self.rows.push(row);
            self.columns.push(column);
            self.values.push(value);
        }
        self.right.push(right);
    }
}

/// The combination of the columns of `basis`, one row for each sample, that proves the highest γ;
/// none if the solver found none. Only a proposal: what it proves is for the caller to verify.
///
/// At each sample, Φ is split into one part y for each limit. A t within limits of radius
/// kept + γ·scaled has Re(y·t) ≥ Re(y·centre) − (kept + γ·scaled)·|y|. With Σ scaled·|y| = 1, the
/// sum of Re(y·centre) − kept·|y| over all samples is the γ at which the right sides add up to zero.
pub(super) fn solve(samples: &[Sample], basis: &DMatrix<Complex<f64>>) -> Option<Vec<f64>> {
    let count = basis.ncols();
    let mut variables = count;
    let mut cost = vec![0.0; count];
    let mut scaled = Vec::new();
    let mut cones = Rows::default();
    for (k, sample) in samples.iter().enumerate() {
        let values: Vec<Complex<f64>> = basis.row(k).iter().map(|x| x * sample.weight).collect();
        let first = variables;
        // For each limit its |y| or more; then, from the second on, y.
        let sizes: Vec<usize> = (0..sample.limits.len())
            .map(|j| first + (3 * j).saturating_sub(2))
            .collect();
        variables += 3 * sample.limits.len() - 2;
        cost.resize(variables, 0.0);
        for (limit, size) in sample.limits.iter().zip(&sizes) {
            cost[*size] += limit.kept;
            if limit.scaled > 0.0 {
                scaled.push((*size, limit.scaled));
            }
        }
        // The first part is what the others leave of Φ.
        let Limit { centre, .. } = sample.limits[0];
        for (j, value) in values.iter().enumerate() {
            cost[j] -= (value * centre).re;
        }
        let others = &sizes[1..];
        cones.push([(first, -1.0)], 0.0);
        for part in 0..2 {
            let value = |x: &Complex<f64>| if part == 0 { x.re } else { x.im };
            let own = values.iter().map(|x| -value(x)).enumerate();
            cones.push(own.chain(others.iter().map(|at| (at + 1 + part, 1.0))), 0.0);
        }
        for (limit, at) in sample.limits[1..].iter().zip(others) {
            let apart = limit.centre - centre;
            cost[at + 1] -= apart.re;
            cost[at + 2] += apart.im;
            for part in 0..3 {
                cones.push([(at + part, -1.0)], 0.0);
            }
        }
    }
    let blocks = cones.right.len() / 3;
    // The equation last.
    cones.push(scaled, 1.0);
    let mut kinds: Vec<SupportedConeT<f64>> = vec![SecondOrderConeT(3); blocks];
    kinds.push(ZeroConeT(1));
    let matrix = CscMatrix::new_from_triplets(
        cones.right.len(),
        variables,
        cones.rows,
        cones.columns,
        cones.values,
    );
    let settings = DefaultSettings {
        verbose: false,
        ..DefaultSettings::default()
    };
    let none = CscMatrix::zeros((variables, variables));
    let solver = DefaultSolver::new(&none, &cost, &matrix, &cones.right, &kinds, settings);
    let mut solver = solver.ok()?;
    solver.solve();
    let found = &solver.solution.x[..count];
    let usable = found.iter().all(|x| x.is_finite());
    usable.then(|| found.to_vec())
}
