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
        0x04, 0xe3, 0xcb, 0xc3, 0xc8, 0x30, 0x24, 0x06,
        0x9c, 0x4e, 0x71, 0x2a, 0xc2, 0x02, 0x27, 0xa6,
        0x9b, 0x12, 0x5b, 0x52, 0x38, 0x11, 0x1d, 0x64,
        0x82, 0xa8, 0xf9, 0x25, 0x7f, 0xed, 0x2b, 0x8c,
    ]),
    // Hz.
    sample_rate: 20000.0,
    // s.
    latch: 2.5e-5,
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
    ac_limit: 0.0022793873,
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
                        Section { rate: 0.00078734313, damping: 0.6910461, direct: 0.0050342944, band: 2.9235675, low: 0.99496573 },
                        Section { rate: 0.021405267, damping: 9.277496, direct: 0.38731074, band: -3.363399, low: 0.61268926 },
                        Section { rate: 0.035504013, damping: 0.3099924, direct: 0.73743564, band: 17.492481, low: 0.26256436 },
                    ],
                    proportional: 199.89468, integral: 0.04417905,
                },
                Channel {
                    sections: [
                        Section { rate: 0.00078734313, damping: 0.6910461, direct: 0.0050342944, band: 2.9235675, low: 0.99496573 },
                        Section { rate: 0.021405267, damping: 9.277496, direct: 0.38731074, band: -3.363399, low: 0.61268926 },
                        Section { rate: 0.035504013, damping: 0.3099924, direct: 0.73743564, band: 17.492481, low: 0.26256436 },
                    ],
                    proportional: 199.89468, integral: 0.04417905,
                },
                Channel {
                    sections: [
                        Section { rate: 7.679648e-5, damping: 7.353059, direct: 0.032617968, band: 25.468647, low: 0.967382 },
                        Section { rate: 0.014076571, damping: 3.3905478, direct: 0.048729066, band: 2.8539846, low: 0.95127094 },
                        Section { rate: 0.093501925, damping: 0.6944389, direct: 0.5193521, band: 0.94314307, low: 0.4806479 },
                    ],
                    proportional: 401.6835, integral: 0.08855473,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0009991613, damping: 0.73677, direct: 0.014624695, band: 0.93769395, low: 0.9853753 },
                        Section { rate: 0.008791031, damping: 4.7077503, direct: 0.07714639, band: 7.853289, low: 0.9228536 },
                        Section { rate: 0.08101776, damping: 0.59029114, direct: 0.43800002, band: 1.0650839, low: 0.562 },
                    ],
                    proportional: 630.9227, integral: 0.13896707,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0009991613, damping: 0.73677, direct: 0.014624695, band: 0.93769395, low: 0.9853753 },
                        Section { rate: 0.008791031, damping: 4.7077503, direct: 0.07714639, band: 7.853289, low: 0.9228536 },
                        Section { rate: 0.08101776, damping: 0.59029114, direct: 0.43800002, band: 1.0650839, low: 0.562 },
                    ],
                    proportional: 630.9227, integral: 0.13896707,
                },
                Channel {
                    sections: [
                        Section { rate: 0.0007620193, damping: 1.1978825, direct: 0.013974459, band: 2.1430106, low: 0.9860255 },
                        Section { rate: 0.00404702, damping: 14.053515, direct: 0.300339, band: 7.241227, low: 0.699661 },
                        Section { rate: 0.13535969, damping: 0.5458149, direct: 0.13284458, band: 0.9571388, low: 0.86715543 },
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
        pilot: 0.02412,
        watch: 10000,
        tolerance: 0.4,
        // By leg: what each sensor answers a push of 1 N.
        sensors: [
            [p(0.002634, -0.0004861), p(0.004332, -0.0007987), p(0.001463, -0.0002698), p(-0.0007405, 0.0001363), p(-0.000734, 0.0001354), p(-0.001456, 0.0002688)],
            [p(-0.002634, 0.0004861), p(0.004332, -0.0007987), p(-0.001456, 0.0002688), p(-0.000734, 0.0001354), p(-0.0007405, 0.0001363), p(0.001463, -0.0002698)],
            [p(0.001208, -0.000223), p(-0.000734, 0.0001354), p(0.002279, -0.0004207), p(0.004332, -0.0007987), p(-0.0007405, 0.0001363), p(-0.00064, 0.0001179)],
            [p(-0.001214, 0.0002239), p(-0.0007405, 0.0001363), p(-0.002283, 0.0004212), p(0.004332, -0.0007987), p(-0.000734, 0.0001354), p(0.0006362, -0.0001174)],
            [p(0.001214, -0.0002239), p(-0.0007405, 0.0001363), p(0.0006362, -0.0001174), p(-0.000734, 0.0001354), p(0.004332, -0.0007987), p(-0.002283, 0.0004212)],
            [p(-0.001208, 0.000223), p(-0.000734, 0.0001354), p(-0.00064, 0.0001179), p(-0.0007405, 0.0001363), p(0.004332, -0.0007987), p(0.002279, -0.0004207)],
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
pub const CHECKSUM: u32 = 0x19d2da34;

const fn p(re: f32, im: f32) -> Phasor {
    Phasor { re, im }
}
