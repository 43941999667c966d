//! Controller table of the machine "nucleo-h743".
//!
//! Made by `host-gen generate`; do not edit. `host-gen check` compares it with
//! the machine file.

use nalgebra::matrix;
use shared::codes::{AdcCode, Calibration, DacCode, Drive};
use shared::table::{
    Channel, Feedback, Law, Modal, ModelDigest, Paths, Phasor, Section, SelfTest, Supervision,
    Table, ValidTable,
};

/// The table, checked by the compiler.
#[rustfmt::skip]
pub static TABLE: ValidTable = match (Table {
    version: 6,
    model: ModelDigest([
        0x18, 0x9c, 0x6f, 0x6d, 0x05, 0xd0, 0x2c, 0x83,
        0x8e, 0x66, 0xe9, 0x2a, 0x5e, 0x01, 0xfa, 0xde,
        0x4f, 0x6d, 0xa1, 0x4f, 0x6a, 0xa3, 0xa5, 0x27,
        0xb8, 0xdd, 0xa0, 0xc7, 0xa4, 0xed, 0x0b, 0x45,
    ]),
    // Hz.
    sample_rate: 20000.0,
    // s.
    latch: 1.5e-5,
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
    ac_limit: 0.0042078244,
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
            complement: None,
            channels: [
                Channel {
                    sections: [
                        Section { rate: 0.001033512, damping: 1.0921104, direct: 0.0021921736, band: 1.8108573, low: 0.9978078 },
                        Section { rate: 0.014536926, damping: 0.35611194, direct: 0.15949327, band: 1.2545553, low: 0.84050673 },
                        Section { rate: 0.02900229, damping: 2.1690958, direct: 3.9126127, band: -7.831078, low: -2.9126127 },
                    ],
                    proportional: 199.89468, integral: 0.04417905,
                },
                Channel {
                    sections: [
                        Section { rate: 0.001033512, damping: 1.0921104, direct: 0.0021921736, band: 1.8108573, low: 0.9978078 },
                        Section { rate: 0.014536926, damping: 0.35611194, direct: 0.15949327, band: 1.2545553, low: 0.84050673 },
                        Section { rate: 0.02900229, damping: 2.1690958, direct: 3.9126127, band: -7.831078, low: -2.9126127 },
                    ],
                    proportional: 199.89468, integral: 0.04417905,
                },
                Channel {
                    sections: [
                        Section { rate: 0.00062775845, damping: 2.1952338, direct: 0.002324492, band: 2.4468415, low: 0.9976755 },
                        Section { rate: 0.025071288, damping: 2.7060447, direct: 0.26260775, band: 0.7117401, low: 0.73739225 },
                        Section { rate: 0.045776222, damping: 1.1817003, direct: 1.2093903, band: 1.2734312, low: -0.2093903 },
                    ],
                    proportional: 401.6835, integral: 0.08855473,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0006465312, damping: 1.7238215, direct: 0.0012893565, band: 1.5911077, low: 0.99871063 },
                        Section { rate: 0.032632925, damping: 1.7182225, direct: 0.2692373, band: 1.3535546, low: 0.7307627 },
                        Section { rate: 0.017242761, damping: 0.25806883, direct: 1.031583, band: -0.013037432, low: -0.03158296 },
                    ],
                    proportional: 630.9227, integral: 0.13896707,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0006465312, damping: 1.7238215, direct: 0.0012893565, band: 1.5911077, low: 0.99871063 },
                        Section { rate: 0.032632925, damping: 1.7182225, direct: 0.2692373, band: 1.3535546, low: 0.7307627 },
                        Section { rate: 0.017242761, damping: 0.25806883, direct: 1.031583, band: -0.013037432, low: -0.03158296 },
                    ],
                    proportional: 630.9227, integral: 0.13896707,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0047025755, damping: 3.1607316, direct: 0.0051541366, band: 0.8647552, low: 0.99484587 },
                        Section { rate: 0.0047025755, damping: 3.1607316, direct: 0.027439224, band: 1.0119159, low: 0.97256076 },
                        Section { rate: 0.05635683, damping: 1.1018394, direct: 3.1924357, band: -0.6891347, low: -2.1924357 },
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
    // Samples.
    supervision: Supervision { ramp: 1.0001727, settle: 40000, safe_ramp: 1000, rail: 100, stuck: 2000, spike: [48, 48], spikes: 5, lost: 3, late: 3, saturated: 20000, silence: 12000000, window: 1000, growth: 1.5, grown: 6, level: 0.1, wild: 20.0, dull: 6.0, strange: 20 },
    self_test: SelfTest {
        step: 125413045,
        amplitude: 10.0,
        settle: 2000,
        measure: 5000,
        pilot: 0.02413,
        watch: 10000,
        tolerance: 0.4,
        // By leg: what each sensor answers a push of 1 N.
        sensors: [
            [p(0.002634, -0.0004849), p(0.004333, -0.0007962), p(0.001464, -0.000269), p(-0.0007406, 0.0001358), p(-0.000734, 0.0001351), p(-0.001456, 0.0002682)],
            [p(-0.002634, 0.0004849), p(0.004333, -0.0007962), p(-0.001456, 0.0002682), p(-0.000734, 0.0001351), p(-0.0007406, 0.0001358), p(0.001464, -0.000269)],
            [p(0.001208, -0.0002225), p(-0.000734, 0.0001351), p(0.00228, -0.0004197), p(0.004333, -0.0007962), p(-0.0007406, 0.0001358), p(-0.00064, 0.0001175)],
            [p(-0.001214, 0.0002231), p(-0.0007406, 0.0001358), p(-0.002283, 0.0004201), p(0.004333, -0.0007962), p(-0.000734, 0.0001351), p(0.0006362, -0.0001171)],
            [p(0.001214, -0.0002231), p(-0.0007406, 0.0001358), p(0.0006362, -0.0001171), p(-0.000734, 0.0001351), p(0.004333, -0.0007962), p(-0.002283, 0.0004201)],
            [p(-0.001208, 0.0002225), p(-0.000734, 0.0001351), p(-0.00064, 0.0001175), p(-0.0007406, 0.0001358), p(0.004333, -0.0007962), p(0.00228, -0.0004197)],
        ],
        forces: [
            [p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0)],
            [p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0)],
            [p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0)],
            [p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0)],
            [p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0)],
            [p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0), p(0.0, 0.0)],
        ],
    },
})
.validate()
{
    Ok(table) => table,
    Err(_) => panic!("this table was edited by hand"),
};

/// [`ValidTable::checksum`] of it when it was made.
pub const CHECKSUM: u32 = 0xdbcdf869;

const fn p(re: f32, im: f32) -> Phasor {
    Phasor { re, im }
}
