//! A table that the tests change as they need.
#![allow(dead_code, reason = "no test uses all of it")]

use nalgebra::Matrix6;
use shared::LEGS;
use shared::codes::{Adc, AdcCode, Dac, DacCode, LegForces};
use shared::step::Demand;
use shared::table::{
    Direct, FORMAT_VERSION, Feedback, Law, ModelDigest, Paths, Phasor, SelfTest, Supervision, Table,
};

pub fn table() -> Table {
    Table {
        version: FORMAT_VERSION,
        model: ModelDigest([0; 32]),
        sample_rate: 20e3,
        latch: 50e-6,
        feedback: Feedback::Acceleration,
        sensors: [Adc::new(16, 10.0).unwrap().calibration(20.0); LEGS],
        adc_max: AdcCode(32767),
        ac_coupling: 0.0,
        ac_limit: f32::MAX,
        law: Law {
            paths: Paths::Direct(DIRECT),
            leak: 0.0,
            anti_windup: 0.0,
        },
        actuators: [Dac::new(16, 0.0, 5.0).unwrap().drive(100.0, 200.0); LEGS],
        dac_max: DacCode(65535),
        supervision: SUPERVISION,
        self_test: SELF_TEST,
    }
}

pub const SUPERVISION: Supervision = Supervision {
    ramp: 1.01,
    settle: 1,
    safe_ramp: 1,
    rail: 1,
    stuck: 0,
    spike: [0; 2],
    spikes: 5,
    lost: 1,
    late: 0,
    saturated: 1,
    silence: 0,
    window: 16,
    growth: 2.0,
    grown: 1,
    level: 0.1,
    wild: 10.0,
    dull: 10.0,
    strange: 1,
};

pub const SELF_TEST: SelfTest = SelfTest {
    step: 1 << 25,
    amplitude: 1.0,
    settle: 0,
    measure: 128,
    pilot: 0.0,
    watch: 128,
    tolerance: 0.1,
    sensors: [[Phasor::ZERO; LEGS]; LEGS],
    forces: [[Phasor::ZERO; LEGS]; LEGS],
};

/// The law at full gain, and an injection in N.
pub fn pushed(injection: [f32; LEGS]) -> Demand {
    Demand {
        injection: LegForces(injection),
        ..Demand::LAW
    }
}

pub const DIRECT: Direct = Direct {
    roll_off: 1.0,
    proportional: Matrix6::from_array_storage(nalgebra::ArrayStorage([[0.0; LEGS]; LEGS])),
    integral: Matrix6::from_array_storage(nalgebra::ArrayStorage([[0.0; LEGS]; LEGS])),
};
