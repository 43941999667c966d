//! The step of `shared`, the law of `host-gen` and the table in `firmware` are
//! one thing.

use std::path::Path;

use firmware::tables::{self, Entry, metrology_frame};
use host_gen::control::LinearLaw;
use host_gen::control::emit::emit;
use host_gen::design::{Search, Study};
use host_gen::machine::Machine;
use host_gen::simulate::Rig;
use nalgebra::Complex;
use shared::LEGS;
use shared::codes::{AdcCode, Samples};
use shared::step::{Demand, State, step};
use shared::table::{Paths, ValidTable};

fn study(name: &str) -> Study {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../models/{name}.toml"));
    Study::new(Machine::load(&path).unwrap()).unwrap()
}

/// The compiled-in tables are, bit for bit, those that the model files give, and their
/// source is what `host-gen generate` writes: the emitted source reads back to what was
/// emitted.
#[test]
fn the_firmwares_tables_are_the_models() {
    for Entry {
        machine,
        table: compiled,
        checksum,
    } in &tables::ALL
    {
        let study = study(machine);
        let table = Search::FULL.design(&study).unwrap().table;
        assert_eq!(**compiled, table, "{machine}");
        assert_eq!(*checksum, table.checksum(), "{machine}");
        let source = machine.replace('-', "_");
        let source = format!("../firmware/src/tables/{source}.rs");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join(source);
        let written = std::fs::read_to_string(source).unwrap();
        assert!(written == emit(study.machine(), &table), "{machine}");
    }
}

/// The single-precision step, code to code, against the linear law that
/// stability was proven with: gain and phase of a sine from one sensor to all
/// legs.
#[test]
fn the_step_is_the_linear_law() {
    for hz in [0.05, 0.5, 1.0, 10.0, 200.0] {
        let z = Complex::cis(core::f64::consts::TAU * hz / 20e3);
        let amplitude = 30_000.0;
        // Smaller gains, so that the sine uses most of both converters and
        // leaves the clamp alone.
        let mut table = *metrology_frame::TABLE.get();
        let whole = LinearLaw::new(&metrology_frame::TABLE).response(z).camax();
        let scale = 100.0 / (whole * amplitude * f64::from(table.sensors[0].gain));
        // Nor does its size count as a shock.
        table.ac_limit = f32::MAX;
        match &mut table.law.paths {
            Paths::Direct(_) => panic!("the firmware's table is modal"),
            Paths::Modal(modal) => modal.output *= scale as f32,
        }
        let table = table.validate().unwrap();
        let law = LinearLaw::new(&table).response(z);
        for sensor in [0, 3] {
            let found = sine(&table, sensor, hz, amplitude);
            let expected = law.column(sensor);
            for leg in 0..LEGS {
                let error = (found[leg] - expected[leg]).norm() / law.camax();
                // Codes of 8 mN on 100 N, averaged, and a transient that has
                // died to 1e-3.
                assert!(
                    error < 2e-3,
                    "{hz} Hz, sensor {sensor}, leg {leg}: {error:.1e}"
                );
            }
        }
    }
}

/// Complex gain, N per m/s², of the step for a sine of `amplitude` codes.
fn sine(table: &ValidTable, sensor: usize, hz: f64, amplitude: f64) -> [Complex<f64>; LEGS] {
    let rate = 20e3;
    let omega = core::f64::consts::TAU * hz / rate;
    let period = (rate / hz).round();
    let at = |k: f64| {
        let mut adc = [AdcCode(0); LEGS];
        adc[sensor] = AdcCode((amplitude * (omega * k).sin()).round() as i16);
        Samples::from(adc)
    };
    let mut state = State::settled_on(table, at(0.0));
    // The leak, 0.01 Hz, dies to 1e-3 in 110 s; the AC coupling long before.
    let settled = (110.0 * rate / period).ceil() * period;
    let measured = (0.2 * rate / period).ceil().max(1.0) * period;
    let drive = table.get().actuators[0];
    let unit = f64::from(table.get().sensors[sensor].gain);
    let mut sums: [Complex<f64>; LEGS] = [Complex::ZERO; LEGS];
    let mut k = 0.0;
    while k < settled + measured {
        let out = step(table, &mut state, at(k), Demand::LAW);
        assert!(!out.status.clamped);
        if k >= settled {
            let turn = Complex::cis(-omega * k);
            for (sum, code) in sums.iter_mut().zip(out.dac) {
                let force = (f64::from(code.0) - f64::from(drive.zero)) / f64::from(drive.gain);
                *sum += turn * force;
            }
        }
        k += 1.0;
    }
    // sin = Im e^(jωk), so the input's own sum is amplitude·n/2j.
    let input = Complex::new(0.0, -0.5) * amplitude * unit * measured;
    sums.map(|sum| sum / input)
}

/// Shocks far beyond what the legs can give: afterwards the loop is as it was before. What the clamp
/// cuts off, integrals and slow filters would remember for as long as they are slow; and a loop can
/// stay in the clamp for ever, although it is stable at every lower gain.
#[test]
fn a_shock_is_forgotten() {
    for Entry { machine, table, .. } in &tables::ALL {
        let study = study(machine);
        let board = &study.machine().board;
        for shock in [5.0, 20.0, 100.0] {
            let settings = &study.machine().simulation;
            let mut rig = Rig::new(study.plant().clone(), board, settings);
            let mut state = State::settled_on(table, rig.sample());
            let mut run = |seconds: f64, floor: f64| {
                rig.floor_gain = floor;
                let steps = (seconds * board.sample_rate) as usize;
                let (mut clamped, mut square) = (0, 0.0);
                for _ in 0..steps {
                    let output = step(table, &mut state, rig.sample(), Demand::LAW);
                    clamped += usize::from(output.status.clamped);
                    let motion = rig.advance(output.dac);
                    square += motion.iter().map(|x| x * x).sum::<f64>();
                }
                (clamped, (square / steps as f64).sqrt())
            };
            // The loop is closed at once on a machine that swings.
            run(6.0, 1.0);
            let (clamped, before) = run(2.0, 1.0);
            assert_eq!(clamped, 0, "{machine}");
            let (clamped, _) = run(0.5, shock);
            assert!(clamped > 0, "{machine}");
            // The slowest pole decays in some 20 s.
            run(30.0, 1.0);
            let (clamped, after) = run(2.0, 1.0);
            // The rms of two seconds of noise varies by some hundredths.
            let settled = clamped == 0 && (after / before - 1.0).abs() < 0.2;
            assert!(
                settled,
                "{machine}, shock {shock}: {clamped}, {before} {after}"
            );
        }
    }
}
