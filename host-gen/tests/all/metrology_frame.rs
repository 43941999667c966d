//! The metrology frame of the paper against the numbers of an independent
//! dense model, to all their digits.

use core::f64::consts::TAU;

use crate::common::{assert_digits, edited, frame, looped_frame, study};
use host_gen::closed_loop::ideal_poles;
use host_gen::design::Study;
use nalgebra::{Cholesky, DMatrix};

fn assert_all(found: &[f64], expected: &[&str]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert_digits(*found, expected);
    }
}

/// √λ/2π of K v = λ M v, ascending: by the square root of M here, by a
/// Cholesky factor in the library.
fn hertz(stiffness: &DMatrix<f64>, mass: &DMatrix<f64>) -> Vec<f64> {
    let eigen = mass.clone().symmetric_eigen();
    let root = &eigen.eigenvectors
        * DMatrix::from_diagonal(&eigen.eigenvalues.map(|x| x.powf(-0.5)))
        * eigen.eigenvectors.transpose();
    let mut all: Vec<f64> = (&root * stiffness * &root)
        .symmetric_eigenvalues()
        .iter()
        .map(|x| x.max(0.0).sqrt() / TAU)
        .collect();
    all.sort_by(f64::total_cmp);
    all
}

#[test]
fn modes() {
    let study = frame();
    assert_all(
        &study.model().modes().hertz(),
        &[
            "13.910", "13.910", "19.527", "23.401", "23.401", "31.369", "83.138", "83.138",
            "87.397", "87.397", "95.434", "97.402",
        ],
    );
    assert_all(
        &study.design_model().hertz(),
        &["14.174", "14.174", "20.067", "25.138", "25.138", "32.324"],
    );
}

/// Sensors blocked: the frame does not move and the lens is left.
#[test]
fn zeros_of_acceleration_feedback() {
    let frame = frame();
    let model = frame.model();
    let lens = |m: &DMatrix<f64>| m.view((6, 6), (6, 6)).into_owned();
    assert_all(
        &hertz(&lens(&model.stiffness), &lens(&model.mass)),
        &["48.315", "48.315", "59.627", "59.627", "63.368", "77.954"],
    );
}

/// Leg forces zero: the elongation stiffness is gone.
#[test]
fn zeros_of_force_feedback() {
    let without_axial = |study: &Study| {
        let e = &study.model().elongations;
        let axial = 8.389e6;
        hertz(
            &(&study.model().stiffness - e.transpose() * axial * e),
            &study.model().mass,
        )
    };
    assert_all(
        &without_axial(&frame())[..6],
        &["1.629", "1.793", "1.793", "2.367", "2.367", "2.759"],
    );
    let low = study(&edited(&[
        (
            "profiles.leg.bending",
            "[24.733333333333334, 24.733333333333334]",
        ),
        ("profiles.leg.torsion", "0.38933333333333333"),
    ]));
    assert_all(
        &without_axial(&low)[..6],
        &["0.421", "0.463", "0.463", "0.612", "0.612", "0.713"],
    );
}

/// The hand check: six legs at 45° with axial stiffness alone, k = 8.389e6 N/m.
/// Upward 6·k/2, sideways 6·k/4, on 1593.6 kg: 20.00 Hz and that over √2.
#[test]
fn translation_of_the_rigid_whole_by_hand() {
    let study = study(&edited(&[
        ("profiles.leg.bending", "[0.0, 0.0]"),
        ("profiles.leg.torsion", "0.0"),
    ]));
    let ride = &study.model().ride;
    let stiffness = ride.transpose() * &study.model().stiffness * ride;
    let mass = 742.0 + 851.6;
    assert_digits((stiffness[(2, 2)] / mass).sqrt() / TAU, "20.00");
    assert_digits((stiffness[(0, 0)] / mass).sqrt() / TAU, "14.14");
    assert_digits((stiffness[(1, 1)] / mass).sqrt() / TAU, "14.14");
    for (axis, k) in [(0, 1.5), (1, 1.5), (2, 3.0)] {
        let expected = k * 8.389e6;
        assert!((stiffness[(axis, axis)] / expected - 1.0).abs() < 1e-12);
    }
}

/// Section 5 of the paper in numbers: acceleration feedback brings all
/// suspension modes to 1 Hz and the internal ones onto the zeros; force
/// feedback leaves the suspension at about 1.9 to 3 Hz.
#[test]
fn ideal_loops_as_in_figure_5() {
    let poles = |feedback: &str| {
        let study = study(&edited(&[
            ("control.damping", "0.0"),
            ("control.feedback", feedback),
            ("damping.modal", "0.0"),
        ]));
        let poles = ideal_poles(&study.plant().plant.state_space, study.gains()).unwrap();
        let mut hz: Vec<f64> = poles
            .iter()
            .filter(|s| s.im > 0.0)
            .map(|s| s.norm() / TAU)
            .collect();
        hz.sort_by(f64::total_cmp);
        hz
    };
    let acceleration = poles("\"acceleration\"");
    for hz in &acceleration[..6] {
        // The flexible machine is a little softer than the design model.
        assert!((hz - 1.0).abs() < 1e-3, "{hz} Hz");
    }
    // Near the zeros, which are 48.315 to 77.954 Hz.
    assert!(acceleration[6] > 48.3 && acceleration[11] < 78.1);
    let force = poles("\"force\"");
    assert!(force[0] > 1.8 && force[5] < 3.0, "{:?}", &force[..6]);
}

/// 68 and 32 dB off the suspension and the internal peak: the ideal loop with
/// damping 0.7.
#[test]
fn ideal_isolation() {
    let (_, _, shaped) = looped_frame();
    let off = |i: usize| shaped.bands[i].open_db - shaped.bands[i].ideal_db;
    assert_digits(off(0), "68");
    assert_digits(off(1), "32");
}

/// S = M^(−1/2)·P of Eq. (17) diagonalises both matrices, and T_c maps q_s to
/// the sensors as the rigid machine does.
#[test]
fn modal_matrix_and_sensing() {
    let study = frame();
    let design = study.design_model();
    let one = design.modal.transpose() * design.suspension.mass * design.modal;
    assert!((one - nalgebra::Matrix6::identity()).amax() < 1e-10);
    let squares = design.modal.transpose() * design.suspension.stiffness * design.modal;
    for i in 0..6 {
        for j in 0..6 {
            let expected = if i == j { design.omega[i].powi(2) } else { 0.0 };
            assert!((squares[(i, j)] - expected).abs() < 1e-7 * design.omega[5].powi(2));
        }
    }
    // A lift by 1 mm: the three z sensors read 1 mm, the others nothing.
    let mut lift = nalgebra::Vector6::zeros();
    lift[2] = 1e-3;
    let read = design.sensing * (study.model().elongations.clone() * &study.model().ride * lift);
    for (value, expected) in read.iter().zip([0.0, 1e-3, 0.0, 1e-3, 1e-3, 0.0]) {
        assert!((value - expected).abs() < 1e-15);
    }
}

/// Eq. (2) solved densely at some frequencies against the modal plant.
#[test]
fn modal_plant_is_the_equation_of_motion() {
    use nalgebra::Complex;
    let study = frame();
    let equation = study.model().equation_of_motion();
    let complex = |m: &DMatrix<f64>| m.map(Complex::from);
    for hz in [0.3, 13.9, 20.0, 60.0, 83.138, 250.0] {
        let s = Complex::new(0.0, TAU * hz);
        let dynamic = complex(&equation.mass) * s * s
            + complex(&equation.damping) * s
            + complex(&equation.stiffness);
        let lu = dynamic.lu();
        let floor = lu
            .solve(&equation.rheonomic.map(|x| Complex::from(-x)))
            .unwrap()
            * s
            * s;
        let legs = lu.solve(&equation.input.map(Complex::from)).unwrap() * s * s;
        let response = study.plant().plant.response(hz);
        // q_d's last six are the performance outputs.
        let rows = study.plant().plant.performance();
        let found = response.from_floor(rows.clone());
        let error = (floor.rows(6, 6) - &found).camax() / found.camax();
        assert!(error < 1e-9, "floor, {hz} Hz: {error:.1e}");
        let found = response.from_legs(rows);
        let error = (legs.rows(6, 6) - &found).camax() / found.camax();
        assert!(error < 1e-9, "legs, {hz} Hz: {error:.1e}");
    }
    assert!(Cholesky::new(equation.mass).is_some());
    for i in 0..12 {
        for j in 0..6 {
            let expected = f64::from(u8::from(i == j));
            assert!(
                (equation.input[(i, j)] - expected).abs() < 1e-9,
                "B_0 = [1; 0]"
            );
        }
    }
}
