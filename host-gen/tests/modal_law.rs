//! The modal law against the direct one, and against what the paper says.

mod common;

use common::{edited, study};
use host_gen::law::LinearLaw;
use host_gen::shape::{Resonance, Shape};
use host_gen::table::{direct, modal};

/// A lag at `hz`; the rest does nothing.
fn one_lag(hz: f64) -> Shape {
    let neutral = Resonance {
        hz: 700.0,
        damping: 1.0,
    };
    Shape {
        lags_hz: [hz, 900.0],
        zero_hz: 900.0,
        notch: neutral,
        notch_poles: neutral,
    }
}

/// With all channels shaped alike the modal law is K_a, K_v or K_P, K_I with a
/// common low-pass: both kinds, legs of unequal stiffness.
#[test]
fn alike_shapes_are_the_direct_law() {
    for feedback in ["acceleration", "force"] {
        let study = study(&edited(&[
            ("control.feedback", &format!("\"{feedback}\"")),
            (
                "beams.leg5",
                "{ nodes = [\"n11\", \"n3\"], stiffness = { axial = 5e6, bending = [371.0, 371.0], torsion = 5.84 } }",
            ),
        ]));
        let target = &study.machine.target;
        let one = direct(&study.machine, target, &study.gains, 3.0).unwrap();
        let two = modal(&study.machine, &study.design, target, &[one_lag(3.0); 6]).unwrap();
        for hz in [0.01, 0.1, 1.0, 3.0, 14.0, 90.0, 1000.0, 9000.0] {
            let z = study.plant.z(hz);
            let [one, two] = [one, two].map(|table| LinearLaw::new(&table).response(z));
            let error = (one - two).camax() / one.camax();
            // Coefficients in single precision.
            assert!(error < 2e-6, "{feedback}, {hz} Hz: {error:.1e}");
        }
    }
}
