//! Controller table of the machine "metrology-frame".
//!
//! Made by `host-gen generate`; do not edit. `host-gen check` compares it with
//! the machine file.

use nalgebra::matrix;
use shared::codes::{AdcCode, Calibration, DacCode, Drive};
use shared::table::{Feedback, Law, ModelDigest, Shaping, Table, ValidTable};

/// The table, checked by the compiler.
#[rustfmt::skip]
pub static TABLE: ValidTable = match (Table {
    version: 1,
    model: ModelDigest([
        0xf7, 0xd9, 0x20, 0x54, 0xde, 0xfe, 0x5d, 0xe4,
        0xec, 0xc1, 0xf9, 0x10, 0x12, 0xc6, 0x86, 0x24,
        0x04, 0x4a, 0x72, 0x98, 0xfc, 0x44, 0xf9, 0x42,
        0x65, 0x63, 0x80, 0x7a, 0x75, 0x8d, 0x62, 0xcc,
    ]),
    // Hz.
    sample_rate: 20000.0,
    feedback: Feedback::Acceleration,
    // m/s² per code.
    sensors: [
        Calibration { zero: 0.0, gain: 1.5258789e-5 },
        Calibration { zero: 0.0, gain: 1.5258789e-5 },
        Calibration { zero: 0.0, gain: 1.5258789e-5 },
        Calibration { zero: 0.0, gain: 1.5258789e-5 },
        Calibration { zero: 0.0, gain: 1.5258789e-5 },
        Calibration { zero: 0.0, gain: 1.5258789e-5 },
    ],
    adc_max: AdcCode(32767),
    shaping: Shaping {
        ac_coupling: 3.141543e-5,
        roll_off: 0.00026542935,
    },
    law: Law {
        // K_a, N/(m/s²)
        proportional: matrix![
            152496.31, 151173.64, -380.68726, -561.6481, 266.40854, 1097.8053;
            -152496.31, 151173.64, 1097.8053, 266.40854, -561.6481, -380.68726;
            -76869.195, 266.40854, 197538.55, 151173.64, -561.6481, -65831.43;
            75627.11, -561.6481, -197179.98, 151173.64, 266.40854, 64755.754;
            -75627.11, -561.6481, 64755.754, 266.40854, 151173.64, -197179.98;
            76869.195, 266.40854, -65831.43, -561.6481, 151173.64, 197538.55;
        ],
        // K_v·T/2, N/(m/s²)
        integral: matrix![
            33.700893, 33.30932, -0.15187724, -0.124655515, 0.077831745, 0.32723635;
            -33.700893, 33.30932, 0.32723635, 0.077831745, -0.124655515, -0.15187724;
            -17.002312, 0.077831745, 43.583027, 33.30932, -0.124655515, -14.484878;
            16.698582, -0.124655515, -43.49535, 33.30932, 0.077831745, 14.221839;
            -16.698582, -0.124655515, 14.221839, 0.077831745, 33.30932, -43.49535;
            17.002312, 0.077831745, -14.484878, -0.124655515, 33.30932, 43.583027;
        ],
        leak: 3.1415877e-6,
        anti_windup: 0.00031410993,
    },
    // Codes per N, limit in N.
    actuators: [
        Drive { zero: 32768.0, gain: 131.072, limit: 200.0 },
        Drive { zero: 32768.0, gain: 131.072, limit: 200.0 },
        Drive { zero: 32768.0, gain: 131.072, limit: 200.0 },
        Drive { zero: 32768.0, gain: 131.072, limit: 200.0 },
        Drive { zero: 32768.0, gain: 131.072, limit: 200.0 },
        Drive { zero: 32768.0, gain: 131.072, limit: 200.0 },
    ],
    dac_max: DacCode(65535),
})
.validate()
{
    Ok(table) => table,
    Err(_) => panic!("this table was edited by hand"),
};
