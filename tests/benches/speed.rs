//! The two long computations: singular values of the generalised plant, and the
//! closed loop in time. `cargo xtask speed` runs `speed.py` beside them.

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use host_gen::design::{Search, Study};
use host_gen::machine::{Machine, Simulation};
use host_gen::numeric::singular::largest_singular_value;
use host_gen::simulate::run::run;
use nalgebra::{Complex, Const, Dyn, OMatrix};

fn study() -> Study {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/metrology-frame.toml");
    let machine = Machine::load(&path).expect("the model is checked in");
    Study::new(machine).expect("the model is checked in")
}

/// σ_max of the 12×12 plant of 24 states at 2000 frequencies.
fn sigma(criterion: &mut Criterion) {
    let study = study();
    let plant = &study.plant().plant;
    let rows = plant.sensors().start..plant.performance().end;
    let hz: Vec<f64> = (0..2000)
        .map(|i| 0.1 * 10f64.powf(3.5 * f64::from(i) / 1999.0))
        .collect();
    criterion.bench_function("sigma of G, 12x12, 2000 frequencies", |bencher| {
        bencher.iter(|| {
            hz.iter()
                .map(|&hz| {
                    let response = plant.response(black_box(hz));
                    let mut g = OMatrix::<Complex<f64>, Dyn, Const<12>>::zeros(rows.len());
                    g.fixed_columns_mut::<6>(0)
                        .copy_from(&response.from_floor(rows.clone()));
                    g.fixed_columns_mut::<6>(6)
                        .copy_from(&response.from_legs(rows.clone()));
                    largest_singular_value(&g)
                })
                .fold(0.0, f64::max)
        });
    });
}

/// 200,000 steps of plant, converters with noise, and the controller's step.
fn closed_loop(criterion: &mut Criterion) {
    let study = study();
    let design = Search::FULL.design(&study);
    let table = design.expect("the target is reached").table;
    let board = &study.machine().board;
    let settings = Simulation {
        duration: 10.0,
        settling: 0.0,
        ..study.machine().simulation
    };
    let mut group = criterion.benchmark_group("closed loop");
    group.sample_size(10);
    group.bench_function("200,000 steps", |bencher| {
        bencher.iter(|| run(study.plant(), board, &settings, black_box(&table), true));
    });
    group.finish();
}

criterion_group!(speed, sigma, closed_loop);
criterion_main!(speed);
