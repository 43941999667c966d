//! Levels against the same in double precision, over all samples and over those that count.

mod common;

use core::f64::consts::{SQRT_2, TAU};

use common::table;
use micromath::F32;
use shared::LEGS;
use shared::codes::{AdcCode, Dac, DacCode, Samples};
use shared::levels::{Decibels, Level, Levels, Meter};
use shared::link::{Packet, Reply, VERSION, encode};
use shared::table::ValidTable;

/// One channel in seven samples.
const ROUND: usize = 7;

/// What a window takes at 20 kHz: a quarter of a second, and one sample for each number.
const WINDOW: usize = 714 * ROUND;
const EVALUATION: usize = 2 * 3 * LEGS + 1;

/// Half a step, and the error of the logarithm.
const ROUNDING: f64 = 0.25 + 0.0005;

/// A sample of all eighteen channels, from its number.
type Signal<'a> = &'a dyn Fn(usize, usize) -> f64;

fn sample(at: usize, signal: Signal) -> (Samples, [DacCode; LEGS]) {
    // As casts of code do: to the nearest, within the range.
    let adc = |i| AdcCode(signal(at, i).round() as i16);
    let samples = Samples {
        sensors: core::array::from_fn(adc),
        forces: core::array::from_fn(|i| adc(i + LEGS)),
    };
    let dac = |i| DacCode((32768.0 + signal(at, i + 2 * LEGS)).round() as u16);
    (samples, core::array::from_fn(dac))
}

fn run(meter: &mut Meter, table: &ValidTable, count: usize, signal: Signal) {
    for at in 0..count {
        let (samples, dac) = sample(at, signal);
        meter.see(table, &samples, &dac);
    }
}

/// The levels of a window of a signal.
fn levels(table: &ValidTable, signal: Signal) -> Levels {
    let mut meter = Meter::NEW;
    run(&mut meter, table, WINDOW + EVALUATION - 1, signal);
    assert_eq!(meter.levels(0, 0).window, 0);
    run(&mut meter, table, 1, signal);
    let levels = meter.levels(0, 0);
    assert_eq!(levels.window, 1);
    levels
}

/// rms about the mean and peak of a channel in dB of 32,768 codes, by the formulas: of the
/// samples `of`.
fn expected<'a>(
    of: impl Iterator<Item = &'a (Samples, [DacCode; LEGS])> + Clone,
    channel: usize,
) -> [f64; 2] {
    let codes = of.map(|(samples, dac)| match channel {
        0..6 => f64::from(samples.sensors[channel].0),
        6..12 => f64::from(samples.forces[channel - 6].0),
        _ => f64::from(dac[channel - 12].0) - 32768.0,
    });
    let count = codes.clone().count() as f64;
    let mean = codes.clone().sum::<f64>() / count;
    let square = codes.clone().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
    let peak = codes.map(f64::abs).fold(0.0, f64::max);
    [square.sqrt(), peak].map(|x| 20.0 * (x / 32768.0).log10())
}

fn all(levels: &Levels) -> Vec<Level> {
    [levels.sensors, levels.forces, levels.legs].concat()
}

fn numbers(level: &Level) -> [f64; 2] {
    [level.rms, level.peak].map(|x| f64::from(x.decibels().unwrap()))
}

/// Compares the levels of a signal with those of the samples that count, to the rounding, and
/// with those of all samples, to `scatter` dB.
#[track_caller]
fn compare(signal: Signal, scatter: [f64; 2]) -> Levels {
    let table = table().validate().unwrap();
    let levels = levels(&table, signal);
    let samples: Vec<_> = (0..WINDOW).map(|at| sample(at, signal)).collect();
    for (channel, level) in all(&levels).iter().enumerate() {
        let own = samples.iter().skip(channel % LEGS).step_by(ROUND);
        let [exact, whole] = [expected(own, channel), expected(samples.iter(), channel)];
        for ((got, exact), (whole, scatter)) in numbers(level)
            .into_iter()
            .zip(exact)
            .zip(whole.into_iter().zip(scatter))
        {
            assert!((got - exact).abs() < ROUNDING, "{channel}: {got}, {exact}");
            let off = (got - whole).abs();
            assert!(off < ROUNDING + scatter, "{channel}: {got}, {whole}");
        }
    }
    levels
}

/// Sines from full scale to three codes, on an offset: below and above half of the rate at which
/// a channel counts.
#[test]
fn sines() {
    for hz in [10.3, 441.7, 1700.1, 8765.4] {
        let signal = |at: usize, i: usize| {
            let amplitude = 32767.0 * 0.6f64.powi(i as i32);
            let offset = if i == 0 { 0.0 } else { 0.3 * amplitude };
            offset + amplitude * (TAU * hz * at as f64 / 20e3 + i as f64).sin()
        };
        compare(&signal, [0.15, 0.15]);
    }
    // By hand: a sine at full scale, −20·log₁₀√2 = −3.01 dB.
    let full = compare(&|at, _| 32767.0 * (0.1234 * at as f64).sin(), [0.05; 2]);
    assert_eq!(numbers(&full.sensors[0]), [-3.0, 0.0]);
    assert!((20.0 * SQRT_2.log10() - 3.01).abs() < 0.01);
}

/// Noise of twelve uniform numbers, standard deviation 0.01 to 0.1 of full scale.
#[test]
fn noise() {
    let uniform = |seed: u64| {
        // SplitMix64.
        let mut z = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    };
    let signal = |at: usize, i: usize| {
        let numbers = (0..12).map(|k| uniform(((at * 18 + i) * 12 + k) as u64));
        32768.0 * 0.1 / (1.0 + i as f64 / 2.0) * (numbers.sum::<f64>() - 6.0)
    };
    // 714 numbers: one standard deviation of the rms is 2.6 %, 0.23 dB. The highest of seven
    // times as many is higher: by 0.4 of 3.2 standard deviations on average.
    compare(&signal, [0.7, 3.0]);
}

/// Limit cycles of two to six samples between the ends of the range.
#[test]
fn rails() {
    for cycle in 2..=6 {
        let signal = |at: usize, _: usize| {
            let high = at % cycle < cycle / 2;
            if high { 32767.0 } else { -32768.0 }
        };
        let levels = compare(&signal, [0.02; 2]);
        // The mean is not zero in a cycle of an odd length.
        let least = if cycle % 2 == 0 { 0.0 } else { -0.5 };
        for level in all(&levels) {
            let [rms, peak] = numbers(&level);
            assert!(rms >= least && peak == 0.0, "{cycle}: {rms}");
        }
    }
}

/// A constant code has a peak and no rms; code 0 has neither, and the smallest change shows.
#[test]
fn hardly_anything() {
    let table = table().validate().unwrap();
    let signal = |_: usize, i: usize| [0.0, -328.0][i % 2];
    let constant = levels(&table, &signal);
    for (i, level) in all(&constant).into_iter().enumerate() {
        assert_eq!(level.rms, Decibels::NOTHING);
        // 20·log₁₀(328/32,768) = −39.99.
        let peak = [None, Some(-40.0)][i % 2];
        assert_eq!(level.peak.decibels(), peak);
    }
    let single = levels(&table, &|at, i| f64::from(u8::from(at == i % LEGS)));
    // √(1/714 − 1/714²) codes: −118.85 dB. A peak of one code: −90.31 dB.
    for level in all(&single) {
        assert_eq!(numbers(&level), [-119.0, -90.5]);
    }
}

/// A peak of half a leg's limit, on one leg; and the processor's load.
#[test]
fn limit_and_load() {
    let mut unequal = table();
    // 200 and 50 N at 100 N/V and 2.5 V: 26,214 and 6,554 codes.
    unequal.actuators[3] = Dac::new(16, 0.0, 5.0).unwrap().drive(100.0, 50.0);
    let unequal = unequal.validate().unwrap();
    let leg = |n: usize, code: f64| {
        move |at: usize, i: usize| if i == 12 + n && at == n { code } else { 0.0 }
    };
    assert_eq!(levels(&unequal, &leg(0, 13_107.0)).limit, 50);
    assert_eq!(levels(&unequal, &leg(3, -4_915.0)).limit, 75);
    assert_eq!(levels(&unequal, &leg(3, 6_554.0)).limit, 100);
    let meter = Meter::NEW;
    assert_eq!(meter.levels(19_900, 50_000).load, 39);
    assert_eq!(meter.levels(1, 0).load, 0);
    assert_eq!(meter.levels(u32::MAX, 1).load, 255);
}

/// Each window is evaluated anew; full scale is that of a converter with fewer bits.
#[test]
fn windows_and_converters() {
    let mut small = table();
    small.adc_max = AdcCode(2047);
    let small = small.validate().unwrap();
    let mut meter = Meter::NEW;
    let whole = WINDOW + EVALUATION;
    run(&mut meter, &small, whole, &|at, _| {
        2047.0 * (0.1 * at as f64).sin()
    });
    let loud = meter.levels(0, 0);
    assert_eq!(numbers(&loud.sensors[2]), [-3.0, 0.0]);
    // 2047/32,768 of the DAC: −24.09 dB.
    assert_eq!(numbers(&loud.legs[2]), [-27.0, -24.0]);
    run(&mut meter, &small, whole - 1, &|_, _| 0.0);
    assert_eq!(meter.levels(0, 0), loud);
    run(&mut meter, &small, 1, &|_, _| 0.0);
    let silent = meter.levels(0, 0);
    assert_eq!((silent.window, silent.limit), (2, 0));
    let nothing = |level: &Level| [level.rms, level.peak] == [Decibels::NOTHING; 2];
    assert!(all(&silent).iter().all(nothing));
}

/// The longest reply fits into a frame of 64 bytes with its zero.
#[test]
fn a_frame_of_64_bytes() {
    let table = table().validate().unwrap();
    let mut levels = levels(&table, &|_, _| 0.0);
    (levels.window, levels.limit, levels.load) = (u32::MAX, 255, 255);
    let packet = Packet {
        version: VERSION,
        session: u32::MAX,
        sequence: u32::MAX,
        body: Reply::Levels(levels),
    };
    // Every byte of the packet is at its longest: no zeros, all levels one byte.
    let length = encode(&packet).unwrap().len();
    assert!(length <= 64, "{length}");
}

/// micromath's logarithm against the one in double precision, over all ratios of powers that
/// occur: its error, in dB of a power. Below 1 it would be off by tenths of a decibel.
#[test]
fn error_of_the_logarithm() {
    let error = |x: f32| (10.0 * (f64::from(F32(x).log10().0) - f64::from(x).log10())).abs();
    let ratios = (0..=200_000).map(|i| 10f32.powf(14.0 * i as f32 / 200_000.0));
    let worst = ratios.map(error).fold(0.0, f64::max);
    assert!(worst > 0.0001 && worst < 0.0005, "{worst}");
    let reciprocals = (1..1000).map(|i| i as f32 / 1000.0);
    let below = reciprocals.map(error).fold(0.0, f64::max);
    assert!(below > 0.3, "{below}");
}
