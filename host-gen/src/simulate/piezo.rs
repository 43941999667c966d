//! What piezo stacks do that is not linear: hysteresis, creep, and the amplifier's current.

use shared::LEGS;

use crate::machine::Piezo;

/// The stacks of all legs, from the forces that linear ones would make to those that they make.
pub(super) struct Stacks {
    legs: [Stack; LEGS],
    /// Relative growth in each decade of time.
    creep: f64,
    /// 1 − e^(−T/τ) of each of the [`DECADES`].
    approach: [f64; DECADES],
    /// The largest change in a sample period, N.
    step: f64,
}

/// Decades of creep from [`FIRST`] on: the last ends after a day.
const DECADES: usize = 6;

/// Time from which on creep counts, s.
const FIRST: f64 = 0.1;

#[derive(Clone)]
struct Stack {
    /// What the amplifier's current lets through, N.
    driven: f64,
    hysteresis: Hysteresis,
    /// What each decade of creep follows, N.
    followed: [f64; DECADES],
}

impl Stacks {
    /// Stacks at the middle of their range, never driven before.
    pub(super) fn new(piezo: &Piezo, period: f64) -> Self {
        let stack = Stack {
            driven: 0.0,
            hysteresis: Hysteresis::new(piezo.bend()),
            followed: [0.0; DECADES],
        };
        Self {
            legs: core::array::from_fn(|_| stack.clone()),
            creep: piezo.creep,
            approach: core::array::from_fn(|decade| {
                // In the middle of its decade, on a logarithmic axis.
                let time = FIRST * 10f64.powf(decade as f64 + 0.5);
                -(-period / time).exp_m1()
            }),
            step: piezo.rate.map_or(f64::INFINITY, |rate| rate * period),
        }
    }

    /// The forces in the next sample period, N, if linear stacks would make `forces`.
    pub(super) fn advance(&mut self, forces: [f64; LEGS]) -> [f64; LEGS] {
        let mut made = forces;
        for (force, stack) in made.iter_mut().zip(&mut self.legs) {
            let change = (*force - stack.driven).clamp(-self.step, self.step);
            stack.driven += change;
            let moved = stack.hysteresis.follow(stack.driven);
            let mut crept = 0.0;
            if self.creep > 0.0 {
                for (followed, approach) in stack.followed.iter_mut().zip(self.approach) {
                    *followed += approach * (moved - *followed);
                    crept += *followed;
                }
            }
            *force = moved + self.creep * crept;
        }
        made
    }
}

/// The Prandtl–Ishlinskii model with play operators of all widths in equal density, which is
/// Rayleigh's law.
///
/// The sum over the operators has a closed form: between reversals it is a parabola, whose growth
/// counts from the last reversal, and a reversal is forgotten when its swing is exceeded. So what is
/// kept are the reversals that are not forgotten.
#[derive(Clone)]
struct Hysteresis {
    /// α, 1/N.
    bend: f64,
    input: f64,
    /// Input and output at the reversals, each nearer to the present than the one before.
    reversals: Vec<[f64; 2]>,
}

impl Hysteresis {
    fn new(bend: f64) -> Self {
        Self {
            bend,
            input: 0.0,
            reversals: Vec::new(),
        }
    }

    /// The output for the next input; between inputs it moves straight.
    fn follow(&mut self, input: f64) -> f64 {
        let up = input > self.input;
        // The present motion goes on since the last reversal, or begins with one here.
        let since = self.reversals.last().map_or(0.0, |[at, _]| *at);
        let goes_on = self.input == since || (self.input > since) == up;
        if !goes_on && input != self.input {
            let reversal = [self.input, self.output(self.input)];
            self.reversals.push(reversal);
        }
        self.input = input;
        // A swing beyond that between the last two reversals forgets both; beyond the first
        // reversal, the virgin curve goes on.
        loop {
            match self.reversals[..] {
                [.., [before, _], [last, _]]
                    if (input - last).abs() >= (before - last).abs()
                        && (input - last) * (before - last) > 0.0 =>
                {
                    self.reversals.truncate(self.reversals.len() - 2);
                }
                [[only, _]] if input.abs() >= only.abs() => self.reversals.clear(),
                _ => break,
            }
        }
        self.output(input)
    }

    /// The output on the present branch.
    fn output(&self, input: f64) -> f64 {
        match self.reversals.last() {
            // The virgin curve: all operators begin at rest.
            None => input + self.bend * input * input.abs(),
            Some([at, from]) => {
                let swing = input - at;
                from + swing + 0.5 * self.bend * swing * swing.abs()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    const RANGE: f64 = 100.0;

    fn piezo() -> Piezo {
        Piezo {
            half_range: RANGE,
            hysteresis: 0.15,
            creep: 0.0,
            rate: None,
        }
    }

    /// Against the definition: a sum of many play operators, each of which follows its input with a
    /// dead band. On a virgin ramp to x, α·x² = Σ w·max(x − r, 0) = w·n/R·x²/2.
    #[test]
    fn it_is_the_sum_of_play_operators() {
        let bend = piezo().bend();
        let count = 20_000;
        let radius = |i: usize| RANGE * (i as f64 + 0.5) / count as f64;
        let weight = 2.0 * bend * RANGE / count as f64;
        let mut plays = vec![0.0_f64; count];
        let mut found = Hysteresis::new(bend);
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut input = 0.0_f64;
        let mut deepest = 0;
        for k in 0..4000 {
            let normal: f64 = StandardNormal.sample(&mut random);
            // Wild at first, then around a mean far from the middle.
            let pull = if k < 2000 { 0.0 } else { 0.1 * (40.0 - input) };
            input = (input + pull + 15.0 * normal).clamp(-RANGE, RANGE);
            let sum: f64 = plays
                .iter_mut()
                .enumerate()
                .map(|(i, play)| {
                    *play = play.clamp(input - radius(i), input + radius(i));
                    weight * *play
                })
                .sum();
            let expected = input + sum;
            let output = found.follow(input);
            deepest = deepest.max(found.reversals.len());
            // The sum has steps of a width of R/count.
            assert!(
                (output - expected).abs() < 1e-4 * RANGE,
                "{output} against {expected} at {input}, sample {k}"
            );
        }
        assert!(deepest > 5, "reversals within reversals were not tried");
    }

    /// The fundamental of a simulated sine, by summation, against the closed form; and the loop's
    /// width at the whole range against what the data sheet says.
    #[test]
    fn a_sine_has_the_describing_function_and_the_width_of_the_data_sheet() {
        let piezo = piezo();
        let count = 10_000;
        for part in [0.01, 0.3, 1.0] {
            let amplitude = part * RANGE;
            let mut found = Hysteresis::new(piezo.bend());
            let angle = |k: usize| core::f64::consts::TAU * k as f64 / count as f64;
            let outputs = (0..2 * count).map(|k| found.follow(amplitude * angle(k).sin()));
            let outputs: Vec<f64> = outputs.skip(count).collect();
            let (mut sine, mut cosine) = (0.0, 0.0);
            for (k, y) in outputs.iter().enumerate() {
                sine += y * angle(k).sin();
                cosine += y * angle(k).cos();
            }
            let scale = 2.0 / (count as f64 * amplitude);
            let expected = piezo.describing_function(amplitude);
            let error = (sine * scale - expected.re).hypot(cosine * scale - expected.im);
            assert!(
                error < 1e-4,
                "{} {} {expected}",
                sine * scale,
                cosine * scale
            );
            if part == 1.0 {
                let stroke = 2.0 * outputs.iter().copied().fold(0.0, f64::max);
                // Where the input is 0.
                let width = (outputs[0] - outputs[count / 2]).abs();
                assert!((width / stroke - 0.15).abs() < 1e-3, "{}", width / stroke);
            }
        }
    }

    /// A step creeps by the stated part in each decade of time.
    #[test]
    fn a_step_creeps_by_its_part_in_each_decade() {
        let creeping = Piezo {
            hysteresis: 0.0,
            creep: 0.01,
            ..piezo()
        };
        let period = 1e-2;
        let mut stacks = Stacks::new(&creeping, period);
        let forces: Vec<f64> = (0..100_000)
            .map(|_| stacks.advance([10.0; LEGS])[0])
            .collect();
        let at = |seconds: f64| forces[(seconds / period) as usize];
        for decade in [0.5, 5.0, 50.0] {
            let growth = (at(10.0 * decade) - at(decade)) / 10.0;
            // A decade of one exponential each makes it wavy.
            assert!(
                (growth / 0.01 - 1.0).abs() < 0.1,
                "{growth} after {decade} s"
            );
        }
    }

    /// A sine faster than the current allows comes out as a triangle of the current's slope.
    #[test]
    fn the_current_limits_the_slope() {
        let limited = Piezo {
            hysteresis: 0.0,
            rate: Some(5e4),
            ..piezo()
        };
        let period = 1e-5;
        let fastest = limited.fastest(20.0);
        let largest = |hz: f64| {
            let mut stacks = Stacks::new(&limited, period);
            let sine = |k: i32| 20.0 * (core::f64::consts::TAU * hz * f64::from(k) * period).sin();
            let forces = (0..20_000).map(|k| stacks.advance([sine(k); LEGS])[0]);
            forces.skip(10_000).fold(0.0, f64::max)
        };
        assert!((largest(0.9 * fastest) / 20.0 - 1.0).abs() < 1e-2);
        // A quarter of a period rises by a quarter of a period times the slope.
        let hz = 4.0 * fastest;
        let triangle = 5e4 / (4.0 * hz);
        assert!(
            (largest(hz) / triangle - 1.0).abs() < 0.05,
            "{}",
            largest(hz)
        );
    }
}
