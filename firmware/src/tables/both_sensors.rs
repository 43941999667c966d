//! Controller table of the machine "both-sensors".
//!
//! Made by `host-gen generate`; do not edit. `host-gen check` compares it with
//! the machine file.

use nalgebra::matrix;
use shared::codes::{AdcCode, Calibration, DacCode, Drive};
use shared::table::{
    Channel, Complement, Feedback, Law, Modal, ModelDigest, Paths, Phasor, Section, SelfTest,
    Supervision, Table, ValidTable,
};

/// The table, checked by the compiler.
#[rustfmt::skip]
pub static TABLE: ValidTable = match (Table {
    version: 6,
    model: ModelDigest([
        0x72, 0xa3, 0x41, 0x6c, 0x3a, 0x7c, 0x1f, 0xbe,
        0x01, 0x1a, 0x2f, 0x66, 0xb1, 0xe5, 0x36, 0x43,
        0x80, 0x96, 0x5e, 0x16, 0x58, 0x4a, 0x49, 0xbb,
        0x8d, 0xa9, 0xb0, 0xe5, 0xb5, 0xc8, 0x32, 0xff,
    ]),
    // Hz.
    sample_rate: 20000.0,
    // s.
    latch: 5e-5,
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
    ac_coupling: 1.570784e-5,
    // m/s².
    ac_limit: 0.0006855462,
    law: Law {
        paths: Paths::Modal(Modal {
            // T_in, m/s² to √kg·m/s²
            input: matrix![
                39.32483, 0.6187369, -19.716982, -3.8363786, 3.2176416, 25.691418;
                5.9744344, -4.0726404, -23.111755, 1.5004783, 2.5721622, -16.213072;
                0.0, 13.30664, 0.0, 13.30664, 13.30664, 0.0;
                0.5197472, 14.6814995, -1.9729441, -5.3655934, -9.315907, -1.3727918;
                3.3457358, -2.2807145, -1.6717879, 13.854909, -11.574195, 2.191535;
                0.0, 0.0, 14.313164, 0.0, 0.0, -14.313164;
            ],
            complement: Some(Complement {
            // N per code.
            sensors: [
                Calibration { zero: 0.0, gain: 0.015258789 },
                Calibration { zero: 0.0, gain: 0.015258789 },
                Calibration { zero: 0.0, gain: 0.015258789 },
                Calibration { zero: 0.0, gain: 0.015258789 },
                Calibration { zero: 0.0, gain: 0.015258789 },
                Calibration { zero: 0.0, gain: 0.015258789 },
            ],
            // Sᵀ, N to N/√kg
            input: matrix![
                0.01756659, -0.016773967, -0.008783295, 0.0038687573, -0.008783295, 0.012905209;
                0.0, -0.005217198, -0.015213113, 0.01713528, 0.015213113, -0.011918082;
                0.017713131, 0.017713131, 0.017713131, 0.017713131, 0.017713131, 0.017713131;
                0.03136842, 0.029890101, -0.01568421, -0.0067037144, -0.01568421, -0.023186386;
                0.0, -0.0095162755, 0.027165847, 0.030643724, -0.027165847, -0.02112745;
                0.028522575, -0.028522575, 0.028522575, -0.028522575, 0.028522575, -0.028522575;
            ],
            split: [0.008310958, 0.008310958, 0.003349355, 0.025595294, 0.025595294, 0.042804815],
            }),
            channels: [
                Channel {
                    sections: [
                        Section { rate: 0.00028604647, damping: 32.674995, direct: 0.22374423, band: 312.65848, low: 0.7762558 },
                        Section { rate: 0.004513794, damping: 5.3606462, direct: 0.10515567, band: 0.08485196, low: 0.89484435 },
                        Section { rate: 0.024914758, damping: 0.782829, direct: 0.13465962, band: 2.1664102, low: 0.8653404 },
                    ],
                    proportional: 199.89468, integral: 0.04417905,
                },
                Channel {
                    sections: [
                        Section { rate: 0.00028604647, damping: 32.674995, direct: 0.22374423, band: 312.65848, low: 0.7762558 },
                        Section { rate: 0.004513794, damping: 5.3606462, direct: 0.10515567, band: 0.08485196, low: 0.89484435 },
                        Section { rate: 0.024914758, damping: 0.782829, direct: 0.13465962, band: 2.1664102, low: 0.8653404 },
                    ],
                    proportional: 199.89468, integral: 0.04417905,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0006913467, damping: 17.733025, direct: 0.11745237, band: 70.21957, low: 0.8825476 },
                        Section { rate: 0.0018028637, damping: 2.0, direct: 0.16718963, band: 0.48339784, low: 0.8328104 },
                        Section { rate: 0.012223327, damping: 2.0, direct: 0.07999637, band: 2.6445885, low: 0.92000365 },
                    ],
                    proportional: 401.6835, integral: 0.08855473,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0004826618, damping: 1.523911, direct: 0.05660095, band: 1.6919993, low: 0.9433991 },
                        Section { rate: 0.031708, damping: 2.2511554, direct: 1.0523255, band: -0.97565097, low: -0.052325547 },
                        Section { rate: 0.048804235, damping: 0.45742, direct: 0.016015232, band: 0.24577792, low: 0.98398477 },
                    ],
                    proportional: 630.9227, integral: 0.13896707,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0004826618, damping: 1.523911, direct: 0.05660095, band: 1.6919993, low: 0.9433991 },
                        Section { rate: 0.031708, damping: 2.2511554, direct: 1.0523255, band: -0.97565097, low: -0.052325547 },
                        Section { rate: 0.048804235, damping: 0.45742, direct: 0.016015232, band: 0.24577792, low: 0.98398477 },
                    ],
                    proportional: 630.9227, integral: 0.13896707,
                },
                Channel {
                    sections: [
                        Section { rate: 4.7695026e-5, damping: 11.47097, direct: 0.041162618, band: 14.966069, low: 0.9588374 },
                        Section { rate: 0.021836875, damping: 2.0638406, direct: 0.050901014, band: 0.6880618, low: 0.949099 },
                        Section { rate: 0.07347327, damping: 0.51354456, direct: 0.2857772, band: 1.8499017, low: 0.7142228 },
                    ],
                    proportional: 1043.8573, integral: 0.22977613,
                },
            ],
            sections: 3,
            // T_out, N/√kg to N
            output: matrix![
                18.975414, -0.06341628, 9.409215, 10.626399, -0.035513677, 5.8433247;
                -18.100388, -5.696167, 9.409215, 10.136377, -3.1899037, -5.8433247;
                -9.542627, -16.401484, 9.409215, -5.282444, 9.220489, 5.8433247;
                4.117169, 18.52348, 9.409215, -2.305651, 10.373312, -5.8433247;
                -9.432787, 16.4649, 9.409215, -5.3439555, -9.184975, 5.8433247;
                13.983219, -12.827312, 9.409215, -7.830726, -7.1834083, -5.8433247;
            ],
        }),
        leak: 3.1415877e-6,
        anti_windup: 0.00018847779,
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
    // Samples.
    supervision: Supervision { ramp: 1.0001727, settle: 40000, safe_ramp: 1000, rail: 100, stuck: 2000, spike: [48, 48], spikes: 5, lost: 3, late: 3, saturated: 20000, silence: 12000000, window: 1000, growth: 1.5, grown: 6, level: 0.1, wild: 20.0, dull: 6.0, strange: 20 },
    self_test: SelfTest {
        step: 125413045,
        amplitude: 10.0,
        settle: 2000,
        measure: 5000,
        pilot: 0.1269,
        watch: 10000,
        tolerance: 0.4,
        // By leg: what each sensor answers a push of 1 N.
        sensors: [
            [p(0.002502, -0.0009555), p(0.004115, -0.00157), p(0.00139, -0.0005302), p(-0.0007035, 0.0002678), p(-0.0006971, 0.0002664), p(-0.001383, 0.0005285)],
            [p(-0.002502, 0.0009555), p(0.004115, -0.00157), p(-0.001383, 0.0005285), p(-0.0006971, 0.0002664), p(-0.0007035, 0.0002678), p(0.00139, -0.0005302)],
            [p(0.001147, -0.0004384), p(-0.0006971, 0.0002664), p(0.002165, -0.000827), p(0.004115, -0.00157), p(-0.0007035, 0.0002678), p(-0.000608, 0.0002317)],
            [p(-0.001154, 0.0004399), p(-0.0007035, 0.0002678), p(-0.002169, 0.0008279), p(0.004115, -0.00157), p(-0.0006971, 0.0002664), p(0.0006043, -0.0002309)],
            [p(0.001154, -0.0004399), p(-0.0007035, 0.0002678), p(0.0006043, -0.0002309), p(-0.0006971, 0.0002664), p(0.004115, -0.00157), p(-0.002169, 0.0008279)],
            [p(-0.001147, 0.0004384), p(-0.0006971, 0.0002664), p(-0.000608, 0.0002317), p(-0.0007035, 0.0002678), p(0.004115, -0.00157), p(0.002165, -0.000827)],
        ],
        forces: [
            [p(0.9364, -0.3596), p(0.0007314, -0.0002054), p(0.0002041, -5.746e-5), p(-0.0008419, 0.0002366), p(0.0002041, -5.746e-5), p(-0.0008363, 0.0002353)],
            [p(0.0007314, -0.0002054), p(0.9364, -0.3596), p(-0.0008363, 0.0002353), p(0.0002041, -5.746e-5), p(-0.0008419, 0.0002366), p(0.0002041, -5.746e-5)],
            [p(0.0002041, -5.746e-5), p(-0.0008363, 0.0002353), p(0.9364, -0.3596), p(0.0007314, -0.0002054), p(0.0002041, -5.746e-5), p(-0.0008419, 0.0002366)],
            [p(-0.0008419, 0.0002366), p(0.0002041, -5.746e-5), p(0.0007314, -0.0002054), p(0.9364, -0.3596), p(-0.0008363, 0.0002353), p(0.0002041, -5.746e-5)],
            [p(0.0002041, -5.746e-5), p(-0.0008419, 0.0002366), p(0.0002041, -5.746e-5), p(-0.0008363, 0.0002353), p(0.9364, -0.3596), p(0.0007314, -0.0002054)],
            [p(-0.0008363, 0.0002353), p(0.0002041, -5.746e-5), p(-0.0008419, 0.0002366), p(0.0002041, -5.746e-5), p(0.0007314, -0.0002054), p(0.9364, -0.3596)],
        ],
    },
})
.validate()
{
    Ok(table) => table,
    Err(_) => panic!("this table was edited by hand"),
};

/// [`ValidTable::checksum`] of it when it was made.
pub const CHECKSUM: u32 = 0x4e1d8dc5;

const fn p(re: f32, im: f32) -> Phasor {
    Phasor { re, im }
}
