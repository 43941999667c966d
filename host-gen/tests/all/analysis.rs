//! Zeros, energies, gravity, damping, singular values and exports against
//! second methods.

use core::f64::consts::TAU;
use std::path::Path;
use std::sync::LazyLock;

use crate::common::{assert_digits, edited, frame, model_path, search, study};
use host_gen::analysis::sigma::{Frequencies, SigmaAnalysis};
use host_gen::closed_loop::ideal_poles;
use host_gen::design::{DesignedStudy, Study};
use host_gen::machine::FeedbackKind;
use host_gen::machine::Machine;
use host_gen::model::energy::{Kind, energies};
use host_gen::model::gravity::buckling_load;
use host_gen::numeric::singular::largest_singular_value;
use host_gen::plant::export::{Generalised, matrix_market};
use host_gen::plant::zeros::{grow, transmission_zeros};
use nalgebra::{Complex, DMatrix};

fn zeros(study: &Study) -> Vec<f64> {
    let zeros = transmission_zeros(
        &study.plant().plant.state_space,
        study.design_model().feedback,
    )
    .unwrap();
    let mut hz: Vec<f64> = zeros
        .iter()
        .filter(|s| s.im > 0.0)
        .map(|s| s.norm() / TAU)
        .collect();
    hz.sort_by(f64::total_cmp);
    hz
}

fn adaptive(low: f64, high: f64, count: usize) -> Frequencies {
    Frequencies::Adaptive { low, high, count }
}

fn model(name: &str) -> Study {
    let path = model_path().with_file_name(name);
    Study::new(Machine::load(&path).unwrap()).unwrap()
}

/// Zeros of the input-output map against the published modes with the sensors
/// held, undamped.
#[test]
fn zeros_are_the_modes_with_the_sensors_held() {
    let undamped = |more: (&str, &str)| study(&edited(&[("damping.modal", "0.0"), more]));
    let acceleration = zeros(&undamped(("control.feedback", "\"acceleration\"")));
    let expected = ["48.315", "48.315", "59.627", "59.627", "63.368", "77.954"];
    assert_eq!(acceleration.len(), 6);
    for (hz, expected) in acceleration.iter().zip(expected) {
        assert_digits(*hz, expected);
    }
    let force = zeros(&undamped(("control.feedback", "\"force\"")));
    assert_eq!(force.len(), 12);
    let expected = ["1.629", "1.793", "1.793", "2.367", "2.367", "2.759"];
    for (hz, expected) in force.iter().zip(expected) {
        assert_digits(*hz, expected);
    }
}

/// At a zero G22 loses rank, wherever it came from: also for sensors on the
/// lens, where D is singular and the pencil has to do.
#[test]
fn at_a_zero_g22_loses_rank() {
    let on_lens: Vec<(String, String)> = ["x3", "z3", "y5", "z5", "z7", "y7"]
        .iter()
        .map(|name| {
            let node = match &name[1..] {
                "3" => "lens15",
                "5" => "lens16",
                _ => "lens17",
            };
            (
                format!("sensors.acceleration.{name}.node"),
                format!("\"{node}\""),
            )
        })
        .collect();
    let mut edits: Vec<(&str, &str)> = on_lens
        .iter()
        .map(|(a, b)| (a.as_str(), b.as_str()))
        .collect();
    edits.push(("damping.modal", "0.02"));
    // Nodes in a triangle: x and z at one, y and z at the next, z and y.
    for study in [frame(), study(&edited(&edits)), model("low-parasitic.toml")] {
        let ss = &study.plant().plant.state_space;
        let zeros = transmission_zeros(ss, study.design_model().feedback).unwrap();
        let g22 = |s: Complex<f64>| {
            let n = ss.a.nrows();
            let resolvent = DMatrix::from_diagonal_element(n, n, s) - ss.a.map(Complex::from);
            let b = ss.b.columns(6, 6).map(Complex::from);
            let c = ss.c.rows(0, 6).map(Complex::from);
            let d = ss.d.view((0, 6), (6, 6)).map(Complex::from);
            c * resolvent.lu().solve(&b).unwrap() + d
        };
        for zero in zeros.iter().filter(|s| s.im > 0.0) {
            let at = g22(*zero).singular_values();
            let off = g22(zero * 1.01).singular_values();
            assert!(
                at.min() < 1e-3 * off.min(),
                "{zero}: {} {}",
                at.min(),
                off.min()
            );
        }
    }
}

/// Energies of a mode add up, and by energy the first six modes of the frame
/// are its suspension.
#[test]
fn energies_say_what_a_mode_is() {
    let study = frame();
    let modes = study.model().modes();
    let all = energies(study.machine(), study.model(), &modes);
    for (i, energies) in all.iter().enumerate() {
        let kind = if i < 6 {
            Kind::Suspension
        } else {
            Kind::Internal
        };
        assert_eq!(energies.kind, kind, "mode {}", i + 1);
        let sum =
            |shares: &[host_gen::model::energy::Share]| shares.iter().map(|s| s.share).sum::<f64>();
        assert!((sum(&energies.strain) - 1.0).abs() < 1e-9);
        assert!((sum(&energies.kinetic) - 1.0).abs() < 1e-9);
    }
    // Rayleigh: strain energy is what the frequency comes from. A leg 1 %
    // stiffer raises f² by 1 % of that leg's share of the strain energy.
    let stiffer = study_with_leg4(1.01);
    let moved = stiffer.model().modes();
    for (i, energies) in all.iter().enumerate() {
        // Pairs of equal modes split; single ones do not.
        if [2, 5, 10, 11].contains(&i) {
            let share = energies.strain[0].share;
            let change = moved.squares[i] / modes.squares[i] - 1.0;
            assert!(
                (change - 0.01 * share).abs() < 2e-5,
                "mode {}: {change:e} {share:e}",
                i + 1
            );
        }
    }
}

fn study_with_leg4(factor: f64) -> Study {
    let stiffness = format!(
        "{{ axial = {:?}, bending = [{b:?}, {b:?}], torsion = {:?} }}",
        8.389e6 * factor,
        5.84 * factor,
        b = 371.0 * factor
    );
    study(&edited(&[
        ("profiles.leg4", &stiffness),
        ("beams.leg4.profile", "\"leg4\""),
    ]))
}

/// Six legs at 45° carry 1593.6 kg: 3.69 kN each if they were struts; bending
/// takes a little of it.
#[test]
fn legs_carry_the_weight() {
    let study = model_with_gravity("metrology-frame.toml");
    for leg in 0..6 {
        let load = study.model().statics.axial[leg];
        assert!((-3690.0..-3640.0).contains(&load), "{load} N");
    }
    // All the weight, through the legs' axial and transverse forces: the
    // vertical reaction of the elastic stiffness.
    let struts = study_of(&[
        ("gravity", "[0.0, 0.0, -9.81]"),
        ("profiles.leg.bending", "[0.0, 0.0]"),
        ("profiles.leg.torsion", "0.0"),
    ]);
    for leg in 0..6 {
        let expected = -1593.6 * 9.81 / 6.0 * 2f64.sqrt();
        let load = struts.model().statics.axial[leg];
        assert!((load / expected - 1.0).abs() < 1e-9, "{load} N");
    }
}

fn study_of(edits: &[(&str, &str)]) -> Study {
    study(&edited(edits))
}

fn model_with_gravity(name: &str) -> Study {
    let folder = tempfile::tempdir().unwrap();
    let base = std::fs::canonicalize(model_path().with_file_name(name)).unwrap();
    let path = folder.path().join("heavy.toml");
    let text = format!(
        "based_on = {:?}\ngravity = [0.0, 0.0, -9.81]\n",
        base.display().to_string()
    );
    std::fs::write(&path, text).unwrap();
    Study::new(Machine::load(&path).unwrap()).unwrap()
}

/// The legs of the low-parasitic variant would buckle, and what its force
/// sensors leave free falls; the paper's leg has fourteen times the margin.
#[test]
fn the_low_parasitic_legs_cannot_carry_the_machine() {
    let margin = |study: &Study| {
        -buckling_load(&study.machine().beams[0]).unwrap() / study.model().statics.axial[0]
    };
    let frame = model_with_gravity("metrology-frame.toml");
    let low = model_with_gravity("low-parasitic.toml");
    assert!(margin(&frame) > 14.0 && margin(&low) < 1.0);
    let grows = |study: &Study| {
        let study =
            Study::new(study.machine().with_feedback(FeedbackKind::Force).unwrap()).unwrap();
        grow(&transmission_zeros(&study.plant().plant.state_space, FeedbackKind::Force).unwrap())
    };
    assert!(!grows(&frame));
    assert!(grows(&low));
    let refused = search().design(&low).unwrap_err().to_string();
    assert!(refused.contains("unstable under gravity"), "{refused}");
}

/// Rayleigh damping: ζ = α/2ω + βω/2. A loss factor in every beam: ζ = η/2.
#[test]
fn damping_by_formula() {
    let damping = |edits: &[(&str, &str)]| {
        let mut table: toml::Table = edited(edits).parse().unwrap();
        table["damping"].as_table_mut().unwrap().remove("modal");
        let study = study(&table.to_string());
        let poles: Vec<(f64, f64)> = study
            .plant()
            .plant
            .poles
            .iter()
            .map(|p| (p.lambda.norm(), -p.lambda.re / p.lambda.norm()))
            .collect();
        assert_eq!(poles.len(), 12);
        poles
    };
    for (omega, zeta) in damping(&[("damping.rayleigh", "[2.0, 1e-4]")]) {
        assert!((zeta - (1.0 / omega + 0.5e-4 * omega)).abs() < 1e-9);
    }
    // Those of single modes, and of the rest.
    let own = [0.01, 0.02, 0.03];
    let mut poles = damping(&[("damping.modes", "[0.01, 0.02, 0.03]")]);
    poles.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (k, (_, zeta)) in poles.into_iter().enumerate() {
        assert!((zeta - own.get(k).unwrap_or(&0.005)).abs() < 1e-9, "{k}");
    }
    for (_, zeta) in damping(&[
        ("profiles.leg.loss_factor", "0.04"),
        ("profiles.block.loss_factor", "0.04"),
    ]) {
        assert!((zeta - 0.02).abs() < 1e-9);
    }
}

/// Dampers along the legs couple the modes: the plant against Eq. (2) solved
/// densely, and the power that they take against the energy that is lost.
#[test]
fn dampers_along_legs() {
    let study = study(&edited(&[
        ("damping.modal", "0.0"),
        ("profiles.leg.damper", "2e4"),
    ]));
    let plant = &study.plant().plant;
    let equation = study.model().equation_of_motion();
    // c on each leg's own elongation rate, which are the first six coordinates.
    for i in 0..12 {
        for j in 0..12 {
            let expected = if i == j && i < 6 { 2e4 } else { 0.0 };
            assert!(
                (equation.damping[(i, j)] - expected).abs() < 1e-4,
                "{i}, {j}"
            );
        }
    }
    for hz in [0.5, 13.9, 31.0, 90.0] {
        let s = Complex::new(0.0, TAU * hz);
        let complex = |m: &DMatrix<f64>| m.map(Complex::from);
        let dynamic = complex(&equation.mass) * s * s
            + complex(&equation.damping) * s
            + complex(&equation.stiffness);
        let rheonomic = equation.rheonomic.map(|x| Complex::from(-x));
        let q = dynamic.lu().solve(&rheonomic).unwrap() * s * s;
        let found = plant.response(hz).from_floor(plant.performance());
        let error = (q.rows(6, 6) - &found).camax() / found.camax();
        assert!(error < 1e-8, "{hz} Hz: {error:.1e}");
    }
    // Damped poles in the sampled loop's matrix too.
    assert!(ideal_poles(&plant.state_space, study.gains()).is_ok());
    assert!(search().design(&study).is_ok());
}

/// The frame with each kind of feedback, searched once.
fn looped() -> &'static [DesignedStudy] {
    static FRAME: LazyLock<Vec<DesignedStudy>> =
        LazyLock::new(|| DesignedStudy::by_feedback(frame().machine(), &search()).unwrap());
    &FRAME
}

/// Singular values from the exported state space against those of the curves.
#[test]
fn sigma_from_the_exported_matrices() {
    let study = frame();
    let Generalised { a, b, c, d } = Generalised::new(&study.plant().plant);
    assert_eq!((c.shape(), d.shape()), ((12, 24), (12, 12)));
    let sigma = SigmaAnalysis::new(study.machine(), looped(), adaptive(0.5, 200.0, 100)).unwrap();
    let json = serde_json::to_value(&sigma).unwrap();
    let hz: Vec<f64> = serde_json::from_value(json["hz"].clone()).unwrap();
    let open: Vec<f64> = serde_json::from_value(json["curves"][0]["sigma_max"].clone()).unwrap();
    // Under the direct law force feedback has no loop at 1 Hz.
    assert_eq!(json["curves"].as_array().unwrap().len(), 4);
    for (hz, open) in hz.iter().zip(&open) {
        let s = Complex::new(0.0, TAU * hz);
        let resolvent = DMatrix::from_diagonal_element(24, 24, s) - a.map(Complex::from);
        let b = b.columns(0, 6).map(Complex::from);
        let g11 = c.rows(0, 6).map(Complex::from) * resolvent.lu().solve(&b).unwrap()
            + d.view((0, 0), (6, 6)).map(Complex::from);
        let expected = g11.singular_values().max();
        // Below 1 Hz D and the poles' parts cancel to 1e-6 in the state space.
        assert!((open / expected - 1.0).abs() < 1e-6, "{hz} Hz");
    }
}

/// No peak lies between two frequencies: a sweep a thousand times finer about
/// every mode finds nothing higher.
#[test]
fn no_peak_is_missed() {
    let study = frame();
    let plant = &study.plant().plant;
    let sigma = SigmaAnalysis::new(study.machine(), looped(), adaptive(5.0, 200.0, 50)).unwrap();
    let json = serde_json::to_value(sigma).unwrap();
    let open: Vec<f64> = serde_json::from_value(json["curves"][0]["sigma_max"].clone()).unwrap();
    let highest = open.iter().copied().fold(0.0, f64::max);
    let mut fine: f64 = 0.0;
    for (centre, width) in plant.peaks() {
        for i in -500..=500 {
            let hz = centre + width * f64::from(i) / 100.0;
            let gain = plant.response(hz).from_floor(plant.performance());
            fine = fine.max(largest_singular_value(&gain));
        }
    }
    assert!(highest > 0.999 * fine, "{highest} of {fine}");
}

/// Matrix Market files read back to the same bits.
#[test]
fn matrix_market_reads_back() {
    let study = frame();
    let matrix = Generalised::new(&study.plant().plant).d;
    let text = matrix_market(&matrix);
    let mut lines = text.lines();
    assert_eq!(
        lines.next(),
        Some("%%MatrixMarket matrix array real general")
    );
    assert_eq!(lines.next(), Some("12 12"));
    let numbers: Vec<f64> = lines.map(|line| line.parse().unwrap()).collect();
    assert_eq!(DMatrix::from_column_slice(12, 12, &numbers), matrix);
}

/// Both kinds where there are sensors for both; one where there are not.
#[test]
fn kinds_of_feedback() {
    assert_eq!(Study::of_each_kind(frame().machine()).unwrap().len(), 2);
    let mut table: toml::Table = edited(&[]).parse().unwrap();
    table["sensors"].as_table_mut().unwrap().remove("force");
    let machine = Machine::parse(Path::new("one.toml"), &table.to_string()).unwrap();
    assert_eq!(Study::of_each_kind(&machine).unwrap().len(), 1);
}
