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
        0xf5, 0x77, 0xbf, 0x35, 0x43, 0x88, 0x6e, 0x0d,
        0x0d, 0xc0, 0xab, 0x25, 0x6b, 0xdc, 0x8d, 0x59,
        0x14, 0x34, 0xb4, 0xf4, 0x4e, 0x4d, 0x92, 0x30,
        0xc8, 0x07, 0x97, 0xb6, 0x48, 0x5b, 0xfe, 0xe7,
    ]),
    // Hz.
    sample_rate: 20000.0,
    // s.
    latch: 2.8e-5,
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
    ac_limit: 0.0047535026,
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
                        Section { rate: 0.011145931, damping: 3.909619, direct: 0.00032885608, band: 0.039364815, low: 0.99967116 },
                        Section { rate: 0.20990509, damping: 2.0, direct: 1.0361542, band: -0.036475208, low: -0.036154203 },
                        Section { rate: 0.5, damping: 2.0, direct: 1.0, band: 0.0, low: 0.0 },
                    ],
                    proportional: 199.89468, integral: 0.04417905,
                },
                Channel {
                    sections: [
                        Section { rate: 0.011145931, damping: 3.909619, direct: 0.00032885608, band: 0.039364815, low: 0.99967116 },
                        Section { rate: 0.20990509, damping: 2.0, direct: 1.0361542, band: -0.036475208, low: -0.036154203 },
                        Section { rate: 0.5, damping: 2.0, direct: 1.0, band: 0.0, low: 0.0 },
                    ],
                    proportional: 199.89468, integral: 0.04417905,
                },
                Channel {
                    sections: [
                        Section { rate: 0.008958613, damping: 4.1953826, direct: 0.00071331824, band: 0.085589714, low: 0.9992867 },
                        Section { rate: 0.20990509, damping: 2.0, direct: 1.0, band: 0.0, low: 0.0 },
                        Section { rate: 0.5, damping: 2.0, direct: 1.0, band: 0.0, low: 0.0 },
                    ],
                    proportional: 401.6835, integral: 0.08855473,
                },
                Channel {
                    sections: [
                        Section { rate: 0.010673132, damping: 5.283318, direct: 0.0006040947, band: 0.06408109, low: 0.9993959 },
                        Section { rate: 0.20990509, damping: 2.0, direct: 1.0, band: 0.0, low: 0.0 },
                        Section { rate: 0.5, damping: 2.0, direct: 1.0, band: 0.0, low: 0.0 },
                    ],
                    proportional: 630.9227, integral: 0.13896707,
                },
                Channel {
                    sections: [
                        Section { rate: 0.010673132, damping: 5.283318, direct: 0.0006040947, band: 0.06408109, low: 0.9993959 },
                        Section { rate: 0.20990509, damping: 2.0, direct: 1.0, band: 0.0, low: 0.0 },
                        Section { rate: 0.5, damping: 2.0, direct: 1.0, band: 0.0, low: 0.0 },
                    ],
                    proportional: 630.9227, integral: 0.13896707,
                },
                Channel {
                    sections: [
                        Section { rate: 0.01272953, damping: 8.472071, direct: 0.000682597, band: 0.060569633, low: 0.9993174 },
                        Section { rate: 0.20990509, damping: 2.0, direct: 1.0, band: 0.0, low: 0.0 },
                        Section { rate: 0.5, damping: 2.0, direct: 1.0, band: 0.0, low: 0.0 },
                    ],
                    proportional: 1043.8573, integral: 0.22977613,
                },
            ],
            sections: 2,
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
        pilot: 0.02412,
        watch: 10000,
        tolerance: 0.4,
        // By leg: what each sensor answers a push of 1 N.
        sensors: [
            [p(0.002634, -0.0004865), p(0.004332, -0.0007994), p(0.001463, -0.0002701), p(-0.0007405, 0.0001365), p(-0.000734, 0.0001355), p(-0.001456, 0.000269)],
            [p(-0.002634, 0.0004865), p(0.004332, -0.0007994), p(-0.001456, 0.000269), p(-0.000734, 0.0001355), p(-0.0007405, 0.0001365), p(0.001463, -0.0002701)],
            [p(0.001208, -0.0002231), p(-0.000734, 0.0001355), p(0.002279, -0.000421), p(0.004332, -0.0007994), p(-0.0007405, 0.0001365), p(-0.00064, 0.000118)],
            [p(-0.001214, 0.0002241), p(-0.0007405, 0.0001365), p(-0.002283, 0.0004216), p(0.004332, -0.0007994), p(-0.000734, 0.0001355), p(0.0006362, -0.0001175)],
            [p(0.001214, -0.0002241), p(-0.0007405, 0.0001365), p(0.0006362, -0.0001175), p(-0.000734, 0.0001355), p(0.004332, -0.0007994), p(-0.002283, 0.0004216)],
            [p(-0.001208, 0.0002231), p(-0.000734, 0.0001355), p(-0.00064, 0.000118), p(-0.0007405, 0.0001365), p(0.004332, -0.0007994), p(0.002279, -0.000421)],
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
pub const CHECKSUM: u32 = 0xc929e975;

const fn p(re: f32, im: f32) -> Phasor {
    Phasor { re, im }
}
