//! Newton's method on the barrier cost, and the path of its minima to the constrained minimum.

use nalgebra::DVector;

use super::problem::{Expansion, Problem, Stage};
use crate::progress::Progress;

/// Factor from one weight to the next.
const FACTOR: f64 = 2.0;

/// When the search goes on to the next weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Care {
    /// Most Newton steps for one weight.
    steps: usize,
    /// A weight is done when a step gains less than this part of it.
    done: f64,
}

/// To compare starts, and to get inside the limits.
pub(super) const ROUGHLY: Care = Care {
    steps: 25,
    done: 1e-4,
};

/// For the result. A path along limits that bend takes many steps, each of which gains little:
/// with the numbers above it ends 10 dB above the minimum in some bands.
pub(super) const CLOSELY: Care = Care {
    steps: 100,
    done: 3e-5,
};

/// Longest step of a variable.
const LONGEST: f64 = 0.7;

/// What is added to the diagonal of the curvature at least, the factor by which it changes, and
/// how often it is raised in one step.
const LEAST: f64 = 1e-3;
const MORE: f64 = 4.0;
const TRIES: usize = 16;

/// The step that minimises the expansion with `added` on the diagonal of the curvature, and the
/// first order of what it gains; none if the curvature is not positive definite then.
fn newton(expansion: &Expansion, added: f64) -> Option<(DVector<f64>, f64)> {
    let mut matrix = expansion.curvature.clone();
    for i in 0..matrix.nrows() {
        matrix[(i, i)] += added;
    }
    let step = -matrix.cholesky()?.solve(&expansion.gradient);
    let gain = -expansion.gradient.dot(&step);
    Some((step, gain))
}

/// Moves `x` down the cost with this `weight`.
///
/// All variables are logarithms, so the step is limited in their own units: what is added to the
/// diagonal is raised until no variable moves by more than [`LONGEST`] and the cost falls.
fn settle<const K: usize>(
    problem: &Problem<K>,
    stage: Stage,
    weight: f64,
    care: Care,
    x: &mut Vec<f64>,
    progress: &dyn Progress,
    enough: &impl Fn(&[f64]) -> bool,
) {
    let mut added = LEAST;
    for _ in 0..care.steps {
        progress.advance();
        let Some(expansion) = problem.expand(stage, weight, x) else {
            return;
        };
        let mut moved = false;
        for _ in 0..TRIES {
            let Some((step, gain)) = newton(&expansion, added) else {
                added *= MORE;
                continue;
            };
            if step.amax() > LONGEST {
                added *= MORE;
                continue;
            }
            if gain < care.done * weight {
                return;
            }
            let to: Vec<f64> = x
                .iter()
                .zip(step.iter())
                .map(|(x, step)| x + step)
                .collect();
            let value = problem.value(stage, weight, &to);
            let falls = value.is_some_and(|value| value < expansion.value - 0.1 * gain);
            if falls {
                *x = to;
                moved = true;
                added = (added / MORE).max(LEAST);
                break;
            }
            added *= MORE;
        }
        if !moved || enough(x) {
            return;
        }
    }
}

/// Follows the minima from the weight `first` to `last`, or until `enough` of the variables.
pub(super) fn follow<const K: usize>(
    problem: &Problem<K>,
    stage: Stage,
    mut x: Vec<f64>,
    [first, last]: [f64; 2],
    care: Care,
    progress: &dyn Progress,
    enough: impl Fn(&[f64]) -> bool,
) -> Vec<f64> {
    let mut weight = first;
    while weight <= last {
        settle(problem, stage, weight, care, &mut x, progress, &enough);
        if enough(&x) {
            break;
        }
        weight *= FACTOR;
    }
    x
}
