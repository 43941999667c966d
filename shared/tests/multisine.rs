//! The multisine against sums in double precision, and its answers against the amplitudes of
//! signals that are known.

mod common;

use core::f64::consts::{PI, TAU};

use common::table;
use heapless::Vec;
use proptest::prelude::*;
use shared::LEGS;
use shared::codes::{AdcCode, DacCode, Samples};
use shared::injection::{FADE, Injection, Injector, Signal};
use shared::multisine::{CHANNELS, LINES, Line, Multisine, Slot, WINDOWS};
use shared::recorder::Record;

fn lines(turns: &[u32]) -> Vec<Line, LINES> {
    let line = |(k, turns): (usize, &u32)| Line {
        turns: *turns,
        amplitude: 0.5 + k as f32,
    };
    turns.iter().enumerate().map(line).collect()
}

/// The signal is the sum of its sines with Schroeder's phases.
#[test]
fn it_is_the_sum_of_its_sines() {
    let mut slots = [Slot::EMPTY; LINES];
    let mut multisine = Multisine::new(&mut slots);
    for (window, turns) in [(10, &[2, 5, 17, 40][..]), (20, &[2, 65_535]), (13, &[7])] {
        let lines = lines(turns);
        assert!(multisine.set(window, &lines));
        let peak: f32 = lines.iter().map(|line| line.amplitude).sum();
        assert_eq!(multisine.peak(), peak);
        let count = lines.len() as f64;
        for at in (0..4_000_000).step_by(997) {
            let expected: f64 = (0..)
                .zip(&lines)
                .map(|(k, line)| {
                    let turns = f64::from(line.turns) * f64::from(at) / 2f64.powi(window.into());
                    let shift = f64::from(k * k) / (2.0 * count);
                    f64::from(line.amplitude) * (TAU * (turns.fract() - shift)).sin()
                })
                .sum();
            let error = (f64::from(multisine.value(at)) - expected).abs();
            // The error of each sine, and of the sum's roundings.
            assert!(error < 5e-7 * f64::from(peak), "{window} {at}: {error:e}");
        }
    }
}

#[test]
fn what_is_out_of_range_changes_nothing() {
    let mut slots = [Slot::EMPTY; 4];
    let mut multisine = Multisine::new(&mut slots);
    let table = table().validate().unwrap();
    let injection = Injection {
        signal: Signal::Multisine,
        legs: [1.0, 0.0, 0.0, 0.0, 0.0, -2.0],
        samples: 10,
    };
    // Without lines there is nothing to inject.
    assert!(!injection.is_within(&table, &multisine));
    assert!(multisine.set(10, &lines(&[2, 63])));
    assert!(injection.is_within(&table, &multisine));
    let [shortest, longest] = WINDOWS;
    let of = |amplitude: f32| {
        let mut lines = lines(&[3, 9]);
        lines[1].amplitude = amplitude;
        lines
    };
    for (window, lines) in [
        (shortest - 1, lines(&[3])),
        (longest + 1, lines(&[3])),
        (10, lines(&[])),
        (10, lines(&[1])),
        (10, lines(&[3, 64])),
        (10, lines(&[3, 5, 7, 9, 11])),
        (10, of(-1.0)),
        (10, of(f32::NAN)),
        (10, of(f32::INFINITY)),
    ] {
        assert!(!multisine.set(window, &lines), "{window} {lines:?}");
        assert_eq!(multisine.peak(), 2.0);
    }
    // Two sines, 0.5 and 1.5: 200 N is the limit of a leg.
    for (size, good) in [(100.0, true), (-100.0, true), (100.1, false)] {
        let injection = Injection {
            legs: [0.0, 0.0, size, 0.0, 0.0, 0.0],
            ..injection
        };
        assert_eq!(injection.is_within(&table, &multisine), good, "{size}");
    }
    let mut injector = Injector::new(&table, injection, &multisine);
    for at in 0..10 {
        // All of it is near an end.
        let value = multisine.value(at) * (at.min(10 - at) as f32 / FADE as f32);
        let forces = [value, 0.0, 0.0, 0.0, 0.0, -2.0 * value];
        assert_eq!(injector.forces().0, forces);
        assert_eq!(injector.left(), 10 - at);
        assert_eq!(injector.advance(&multisine), at < 9);
    }
    assert_eq!(multisine.answer(2), None);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// Each channel's part at each line is what was put there, to the rounding of codes; and a
    /// constant, a vibration between the lines and one that the averages fold onto a line change
    /// little of it.
    #[test]
    fn the_parts_are_those_of_the_signal(
        window in 12u8..16,
        seed in any::<u32>(),
        count in 1usize..=LINES,
    ) {
        let length = 1u32 << window;
        let highest = length / 16;
        // Two apart at least, spread over all that is allowed.
        let step = (highest - 4) / LINES as u32;
        let turns: std::vec::Vec<_> =
            (0..count as u32).map(|k| 2 + k * step + (seed.rotate_left(k) % (step - 1).max(1))).collect();
        let mut slots = [Slot::EMPTY; LINES];
        let mut multisine = Multisine::new(&mut slots);
        prop_assert!(multisine.set(window, &lines(&turns)));
        // Amplitude and phase of each channel at each line.
        let part = |channel: usize, line: usize| {
            let hash = seed.wrapping_add((channel * 57 + line) as u32).wrapping_mul(0x9E37_79B9);
            let size = f64::from(hash >> 24) + 20.0;
            let phase = TAU * f64::from(hash & 0xffff) / 65_536.0;
            (size, phase)
        };
        // At the longest distance from all lines that is possible near a line.
        let between = f64::from(turns[0]) + 3.5;
        let code = |channel: usize, at: u32| {
            let turn = f64::from(at) / f64::from(length);
            let lines: f64 = turns.iter().enumerate().map(|(k, turns)| {
                let (size, phase) = part(channel, k);
                size * (TAU * f64::from(*turns) * turn + phase).cos()
            }).sum();
            (lines + 100.0 * (TAU * between * turn).cos() + 77.0).round() as i32
        };
        let record = |at: u32| {
            let adc = |i: usize| AdcCode(code(i, at) as i16);
            Record {
                adc: Samples {
                    sensors: core::array::from_fn(adc),
                    forces: core::array::from_fn(|i| adc(LEGS + i)),
                },
                dac: core::array::from_fn(|i| DacCode((code(2 * LEGS + i, at) + 32768) as u16)),
            }
        };
        for at in 0..length + 15 {
            multisine.see(&record(at));
            let windows = multisine.answer(0).unwrap().windows;
            prop_assert_eq!(windows, u32::from(at >= length + 7), "{}", at);
        }
        for (k, turns) in turns.iter().enumerate() {
            let answer = multisine.answer(k).unwrap();
            for channel in 0..CHANNELS {
                let (size, phase) = part(channel, k);
                let [re, im] = answer.parts[channel].map(f64::from);
                let error = (re - size * phase.cos()).hypot(im - size * phase.sin());
                // Hann's window at a distance of x lines: sin(πx)/(πx)/(1 − x²), of each side.
                let leak = |x: f64| ((PI * x).sin() / (PI * x) / (1.0 - x * x)).abs();
                let leaks = leak(between - f64::from(*turns)) + leak(between + f64::from(*turns));
                // Roundings of codes have an rms of 0.29, a part of √(3/length) in each line.
                let rounding = 6.0 * 0.29 * (3.0 / f64::from(length)).sqrt();
                prop_assert!(
                    error < 1.05 * 100.0 * leaks + rounding + 1e-5 * 300.0 * LINES as f64,
                    "line {} of {:?}, channel {}: {}", k, turns, channel, error
                );
            }
        }
    }
}

/// What the averages fold onto a line is weakened by the triangle's response.
#[test]
fn what_is_above_is_not_folded_onto_a_line() {
    let mut slots = [Slot::EMPTY; 1];
    let mut multisine = Multisine::new(&mut slots);
    let (window, turns) = (13u8, 100u32);
    let length = 1u32 << window;
    multisine.set(window, &lines(&[turns]));
    // An eighth of the rate, and as much above it as the line is above 0.
    let above = f64::from(length / 8 + turns);
    for at in 0..length + 15 {
        let code = 10_000.0 * (TAU * above * f64::from(at) / f64::from(length)).cos();
        let adc = Samples::from([AdcCode(code.round() as i16); LEGS]);
        multisine.see(&Record {
            adc,
            dac: [DacCode(32768); LEGS],
        });
    }
    let answer = multisine.answer(0).unwrap();
    let [re, im] = answer.parts[0].map(f64::from);
    let response = |turns: f64| {
        let half = PI * turns / f64::from(length);
        ((8.0 * half).sin() / (8.0 * half.sin())).powi(2)
    };
    let expected = 10_000.0 * response(above) / response(f64::from(turns));
    assert!((re.hypot(im) / expected - 1.0).abs() < 1e-3, "{re} {im}");
    assert!(expected < 10_000.0 * 0.02);
    // No force: nothing, not even the rounding of the zero.
    assert!(
        answer.parts[2 * LEGS..]
            .iter()
            .flatten()
            .all(|x| x.abs() < 1e-4)
    );
}
