//! Controller table of the machine "metrology-frame".
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
        0x5f, 0xdb, 0x60, 0x83, 0x79, 0xe2, 0x08, 0x13,
        0xa9, 0xfe, 0x1c, 0xd4, 0x37, 0x10, 0x85, 0xc0,
        0x24, 0x1b, 0x13, 0x74, 0xf5, 0x86, 0x99, 0x8b,
        0xfa, 0x94, 0x8d, 0xcc, 0x80, 0xc5, 0x95, 0xda,
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
    ac_limit: 0.0046993913,
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
                        Section { rate: 0.0006825841, damping: 1.8415427, direct: 0.14019707, band: 1.8792436, low: 0.85980296 },
                        Section { rate: 0.015222036, damping: 0.24901153, direct: 0.99855703, band: -0.031903632, low: 0.0014429465 },
                        Section { rate: 0.028335607, damping: 2.413316, direct: 0.0070342678, band: 0.15368316, low: 0.99296576 },
                    ],
                    proportional: 199.89468, integral: 0.04417905,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0006825841, damping: 1.8415427, direct: 0.14019707, band: 1.8792436, low: 0.85980296 },
                        Section { rate: 0.015222036, damping: 0.24901153, direct: 0.99855703, band: -0.031903632, low: 0.0014429465 },
                        Section { rate: 0.028335607, damping: 2.413316, direct: 0.0070342678, band: 0.15368316, low: 0.99296576 },
                    ],
                    proportional: 199.89468, integral: 0.04417905,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0019949728, damping: 2.9355133, direct: 0.07375566, band: 0.6317532, low: 0.9262443 },
                        Section { rate: 0.021308187, damping: 3.350317, direct: 0.043282706, band: 0.27107915, low: 0.9567173 },
                        Section { rate: 0.04190032, damping: 0.9878605, direct: 0.17401177, band: 1.9780325, low: 0.82598823 },
                    ],
                    proportional: 401.6835, integral: 0.08855473,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0060252, damping: 10.344333, direct: 0.13298842, band: -1.2695352, low: 0.8670116 },
                        Section { rate: 0.017038584, damping: 0.3337726, direct: 0.03809148, band: 1.347372, low: 0.9619085 },
                        Section { rate: 0.025702477, damping: 1.4552326, direct: 0.05187001, band: 0.28227615, low: 0.94813 },
                    ],
                    proportional: 630.9227, integral: 0.13896707,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0060252, damping: 10.344333, direct: 0.13298842, band: -1.2695352, low: 0.8670116 },
                        Section { rate: 0.017038584, damping: 0.3337726, direct: 0.03809148, band: 1.347372, low: 0.9619085 },
                        Section { rate: 0.025702477, damping: 1.4552326, direct: 0.05187001, band: 0.28227615, low: 0.94813 },
                    ],
                    proportional: 630.9227, integral: 0.13896707,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0028982905, damping: 7.752824, direct: 0.016661718, band: 0.07272624, low: 0.9833383 },
                        Section { rate: 0.009630527, damping: 2.7037039, direct: 0.08524398, band: 4.689634, low: 0.914756 },
                        Section { rate: 0.07923117, damping: 0.9518247, direct: 0.24876612, band: 0.49971688, low: 0.7512339 },
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
        pilot: 0.02413,
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
pub const CHECKSUM: u32 = 0x9640d534;

const fn p(re: f32, im: f32) -> Phasor {
    Phasor { re, im }
}
