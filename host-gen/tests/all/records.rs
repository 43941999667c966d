//! Recorded floors against SciPy's `signal.welch`, and what is no record.

use core::f64::consts::TAU;

use crate::common::{edited, looped};
use host_gen::closed_loop::budget::budget;
use host_gen::files::columns::TextError;
use host_gen::floor::{Floor, Record, Welch};
use host_gen::simulate::run::compare;

/// Noise between −1/2 and 1/2 that another program can make.
fn noise(axis: usize, i: usize) -> f64 {
    let v = ((i + 1) as f64 * (12.9898 + axis as f64)).sin() * 43758.5453;
    v - v.floor() - 0.5
}

/// A record of 1,000 samples at 250 Hz along three axes, of units in brackets.
fn record(units: [&str; 3]) -> String {
    let [x, y, z] = units;
    let mut text = format!("time [ms],z{z},temperature,y{y},x{x}\n");
    for i in 0..1000 {
        let [x, y, z] = [0, 1, 2].map(|axis| noise(axis, i) + 0.3);
        text += &format!("{},{z:e},20.1,{y:e},{x:e}\n", 4 * i);
    }
    text
}

fn welch(text: &str, rate: Option<f64>) -> Welch {
    Record::read(text, rate).unwrap().welch().unwrap()
}

/// Sixteen windows of 116 samples, Hann's, each half over the next, without their means:
/// `scipy.signal.welch(x, 250, nperseg=116, noverlap=58)`, roots.
#[test]
fn spectra_are_those_of_scipy() {
    let found = welch(&record(["", " [mg]", " (m/s^2)"]), None);
    assert_eq!((found.windows, found.window), (16, 116.0 / 250.0));
    for (line, expected) in [
        (
            2.0,
            [2.415087289745e-2, 2.531965164187e-4, 2.625360353259e-2],
        ),
        (
            7.0,
            [2.208434125811e-2, 2.532049175776e-4, 2.624530913423e-2],
        ),
        (
            30.0,
            [2.050987913845e-2, 2.058151309980e-4, 2.152079507005e-2],
        ),
        (
            57.0,
            [2.344810377486e-2, 2.900944660984e-4, 2.153280914014e-2],
        ),
    ] {
        let densities = found.floor.densities(line * 250.0 / 116.0);
        for (found, expected) in densities.into_iter().zip(expected) {
            assert!(
                (found / expected - 1.0).abs() < 1e-6,
                "{line}: {found:e} {expected:e}"
            );
        }
    }
    assert_eq!(found.floor.densities(1.0), [0.0; 3]);
}

/// A velocity's spectrum times ω, a displacement's times ω², in the unit of the column.
#[test]
fn integrals_are_derived() {
    let hz = 30.0 * 250.0 / 116.0;
    for (unit, size) in [
        ("[mm/s]", 1e-3 * TAU * hz),
        ("[nm]", 1e-9 * (TAU * hz).powi(2)),
    ] {
        let found = welch(&record([unit; 3]), None).floor.densities(hz)[2];
        let expected = 2.152079507005e-2 * size;
        assert!(
            (found / expected - 1.0).abs() < 1e-6,
            "{found:e} {expected:e}"
        );
    }
}

/// The power of a sine is half its amplitude squared, wherever it lies between the lines.
#[test]
fn a_sine_keeps_its_power() {
    for hz in [20.0, 20.37] {
        let samples = (0..20_000).map(|i| (TAU * hz * f64::from(i) / 500.0).sin() * 3e-3);
        let text: String = samples.map(|x| format!("{x}\n")).collect();
        let found = welch(&text, Some(500.0));
        let step = 1.0 / found.window;
        let power: f64 = (2..)
            .map(|k| f64::from(k) * step)
            .take_while(|hz| *hz < 240.0)
            .map(|hz| found.floor.densities(hz)[1].powi(2) * step)
            .sum();
        assert!((power / 4.5e-6 - 1.0).abs() < 1e-3, "{power:e}");
    }
}

/// What programs write is read alike: names, separators, a byte order mark, times or a rate.
#[test]
fn records_are_read() {
    let times: Vec<f64> = (0..600).map(|i| 0.25 + 0.002 * f64::from(i)).collect();
    let of = |head: &str, separator: &str, axes: usize, timed: bool| {
        let mut text = head.to_owned();
        for (i, t) in times.iter().enumerate() {
            let time = timed.then(|| t.to_string());
            let values = (0..axes).map(|_| noise(0, i).to_string());
            let row: Vec<_> = time.into_iter().chain(values).collect();
            text += &(row.join(separator) + "\r\n");
        }
        text
    };
    let plain = welch(&of("t,x,y,z\n", ",", 3, true), None);
    for (text, rate) in [
        (
            of(
                "\u{feff}Time [s];X [m/s²];Y [m/s²];Z [m/s²]\n",
                ";",
                3,
                true,
            ),
            None,
        ),
        (of("# a floor\n\nt\tx\ty\tz\n", "\t", 3, true), None),
        (of("", " ", 3, true), None),
        (of("x, y, z\n", ", ", 3, false), Some(500.0)),
        (of("", ",", 3, false), Some(500.0)),
        (of("", ",", 1, false), Some(500.0)),
        (of("acc_z\n", ",", 1, false), Some(500.0)),
        (of("t,x\n", ",", 1, true), None),
    ] {
        let found = welch(&text, rate);
        assert_eq!(found.windows, plain.windows);
        let at = 20.0 / found.window;
        let (a, b) = (found.floor.densities(at), plain.floor.densities(at));
        assert!((0..3).all(|i| (a[i] / b[i] - 1.0).abs() < 1e-9), "{text}");
    }
}

/// What is no record is refused with its line, cause and mend.
#[test]
fn what_is_no_record_is_refused() {
    let long = |head: &str, row: &str| format!("{head}\n{}", format!("{row}\n").repeat(600));
    let timed = |change: &dyn Fn(usize, f64) -> String| {
        let rows = (0..600).map(|i| change(i, 0.01 * i as f64) + "\n");
        format!("t,x\n{}", rows.collect::<String>())
    };
    for (text, rate, line, words) in [
        (String::new(), None, None, "the record is empty"),
        (long("x,y,z", "1,2,3"), None, None, "give --rate"),
        (
            long("a,b,c", "1,2,3"),
            Some(1e3),
            None,
            "no column is called x, y or z",
        ),
        (long("x,y", "1,2"), Some(1e3), None, "two axes"),
        (
            long("x [mg],y [m/s],z", "1,2,3"),
            Some(1e3),
            None,
            "one kind",
        ),
        (
            long("x [inch],y,z", "1,2,3"),
            Some(1e3),
            Some(1),
            "\"inch\" is no unit",
        ),
        (
            long("t [h],x", "1,2"),
            None,
            Some(1),
            "\"h\" is no unit of time",
        ),
        (
            long("x", "1").replacen("\n1\n", "\n1\nnan\n", 1),
            Some(1e3),
            Some(3),
            "\"nan\" is not",
        ),
        (
            long("x;y;z", "1,5;2,5;3"),
            Some(1e3),
            Some(2),
            "decimals have a point",
        ),
        (
            long("x,y,z", "1,2"),
            Some(1e3),
            Some(2),
            "2 values, but there are 3 columns",
        ),
        (
            long("", "1,2,3,4,5,6"),
            None,
            Some(2),
            "6 columns without names",
        ),
        (
            "x\n".to_owned() + &"1\n".repeat(300),
            Some(1e3),
            None,
            "300 samples are no record",
        ),
        (
            timed(&|_, t| format!("{t},1")),
            Some(100.0),
            None,
            "leave --rate out",
        ),
        (
            "# a comment\n\n".to_owned()
                + &timed(&|i, t| format!("{},1", if i == 300 { t + 0.004 } else { t }))
                    .replace("\n2.5,", "\n# another\n2.5,"),
            None,
            Some(305),
            "a step of",
        ),
        (
            timed(&|i, t| format!("{},1", if i > 299 { t + 3.0 } else { t })),
            None,
            Some(302),
            "a step of",
        ),
        (
            timed(&|_, _| "1,1".to_owned()),
            None,
            Some(3),
            "must increase",
        ),
        (
            long("x [g]", "1e12\n0\n-1e12\n0"),
            Some(1e3),
            None,
            "a density must be from 0",
        ),
    ] {
        let error: TextError = match Record::read(&text, rate).and_then(|read| read.welch()) {
            Ok(_) => panic!("{} is read", &text[..40]),
            Err(error) => error,
        };
        assert!(error.message.contains(words), "{words}: {error}");
        assert_eq!(error.line, line, "{words}: {error}");
    }
}

/// The simulation on a record against the budget on its spectra, axis by axis: a record along z alone
/// moves what a spectrum along z alone does.
#[test]
fn a_record_drives_the_simulation() {
    let (study, table, _) = looped(&edited(&[
        ("damping.modal", "0.1"),
        ("simulation.duration", "60.0"),
        ("simulation.settling", "20.0"),
    ]));
    let machine = study.machine();
    for axis in 0..3 {
        let mut text = "x,y,z\n".to_owned();
        for i in 0..60_000 {
            let at = |own: usize| {
                if own == axis {
                    1e-2 * noise(axis, i)
                } else {
                    0.0
                }
            };
            text += &format!("{},{},{}\n", at(0), at(1), at(2));
        }
        let record = Record::read(&text, Some(1000.0)).unwrap();
        let floor = record.welch().unwrap().floor;
        let names = machine.performance_names();
        let given = Some((&record, "noise".to_owned()));
        let (board, settings) = (&machine.board, &machine.simulation);
        let run = compare(study.plant(), board, settings, table, names, given, &());
        assert_eq!(run.record.as_deref(), Some("noise"));
        let open = budget(study.plant(), board, None, &floor, [0.3, 490.0], None).unwrap();
        let largest = run.open.rms.iter().copied().fold(0.0, f64::max);
        assert!(largest > 1e-5, "{largest}");
        for (rms, spectrum) in run.open.rms.iter().zip(&open.performance) {
            let expected = open.power(spectrum).iter().sum::<f64>().sqrt();
            // Both estimate the same from 60 s.
            assert!(
                (rms - expected).abs() < 0.1 * largest,
                "along {axis}: {rms:e}, not {expected:e}"
            );
        }
    }
}

/// Spectra of three axes move the base each along its own.
#[test]
fn axes_move_alone() {
    let found = welch(&record(["", " [mg]", " [mg]"]), None).floor;
    let Floor::Axes(spectra) = &found else {
        panic!("{found:?}");
    };
    let [low, high] = found.range();
    assert!(low > 4.0 && high < 125.0);
    let alone = |axis: usize| Floor::Table(spectra[axis].clone()).densities(50.0)[0];
    assert_eq!(found.densities(50.0), [0, 1, 2].map(alone));
}
