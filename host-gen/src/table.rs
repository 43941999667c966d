//! From gains to the controller table, and to its Rust source.

use std::fmt::Write as _;

use nalgebra::Matrix6;
use shared::LEGS;
use shared::table::{FORMAT_VERSION, Feedback, Law, Shaping, Table, TableError, ValidTable};

use crate::design::Gains;
use crate::machine::{Machine, Target};

/// AC coupling sits this far below ω_n, where it costs the lower crossover
/// little phase.
pub const AC_COUPLING: f64 = 0.1;

/// The integral leaks this far below ω_n.
pub const LEAK: f64 = 0.01;

/// c of a first-order section with its corner at `hz`, increment form.
pub fn coefficient(hz: f64, period: f64) -> f64 {
    -(-core::f64::consts::TAU * hz * period).exp_m1()
}

/// The table of a machine with the `gains` for `target` and a roll-off at
/// `roll_off` Hz.
///
/// The clamp's excess leaves the integral with time constant 1/ω_n.
pub fn build(
    machine: &Machine,
    target: &Target,
    gains: &Gains,
    roll_off: f64,
) -> Result<ValidTable, TableError> {
    let board = &machine.board;
    let period = board.period();
    let frequency = target.frequency;
    let single = |m: &Matrix6<f64>| m.map(|x| x as f32);
    Table {
        version: FORMAT_VERSION,
        model: machine.digest,
        sample_rate: board.sample_rate as f32,
        feedback: target.feedback,
        sensors: [board.adc.calibration(board.sensor.sensitivity); LEGS],
        adc_max: board.adc.max(),
        shaping: Shaping {
            ac_coupling: coefficient(AC_COUPLING * frequency, period) as f32,
            roll_off: coefficient(roll_off, period) as f32,
        },
        law: Law {
            proportional: single(&gains.proportional),
            integral: single(&(gains.integral * (0.5 * period))),
            leak: coefficient(LEAK * frequency, period) as f32,
            anti_windup: coefficient(frequency, period) as f32,
        },
        actuators: [board.dac.drive(board.actuator_gain, board.force_limit); LEGS],
        dac_max: board.dac.max(),
    }
    .validate()
}

/// The Rust source of a table: the same table gives the same bytes, and the
/// numbers read back to the same bits.
pub fn emit(machine: &Machine, table: &ValidTable) -> String {
    let t = table.get();
    let mut out = String::new();
    let (sensor_unit, gain_names) = match t.feedback {
        Feedback::Acceleration => ("m/s²", ("K_a, N/(m/s²)", "K_v·T/2, N/(m/s²)")),
        Feedback::Force => ("N", ("K_P", "K_I·T/2")),
    };
    // Writing to a String cannot fail.
    let mut line = |text: &str| writeln!(out, "{text}").unwrap_or_default();
    line(&format!(
        "//! Controller table of the machine \"{}\".",
        machine.name
    ));
    line("//!");
    line("//! Made by `host-gen generate`; do not edit. `host-gen check` compares it with");
    line("//! the machine file.");
    line("");
    line("use nalgebra::matrix;");
    line("use shared::codes::{AdcCode, Calibration, DacCode, Drive};");
    line("use shared::table::{Feedback, Law, ModelDigest, Shaping, Table, ValidTable};");
    line("");
    line("/// The table, checked by the compiler.");
    line("#[rustfmt::skip]");
    line("pub static TABLE: ValidTable = match (Table {");
    line(&format!("    version: {},", t.version));
    line("    model: ModelDigest([");
    for bytes in t.model.0.chunks(8) {
        let row: Vec<_> = bytes.iter().map(|b| format!("0x{b:02x},")).collect();
        line(&format!("        {}", row.join(" ")));
    }
    line("    ]),");
    line("    // Hz.");
    line(&format!("    sample_rate: {:?},", t.sample_rate));
    line(&format!("    feedback: Feedback::{:?},", t.feedback));
    line(&format!("    // {sensor_unit} per code."));
    line("    sensors: [");
    for s in &t.sensors {
        line(&format!(
            "        Calibration {{ zero: {:?}, gain: {:?} }},",
            s.zero, s.gain
        ));
    }
    line("    ],");
    line(&format!("    adc_max: AdcCode({}),", t.adc_max.0));
    line("    shaping: Shaping {");
    line(&format!(
        "        ac_coupling: {:?},",
        t.shaping.ac_coupling
    ));
    line(&format!("        roll_off: {:?},", t.shaping.roll_off));
    line("    },");
    line("    law: Law {");
    for (field, name, m) in [
        ("proportional", gain_names.0, &t.law.proportional),
        ("integral", gain_names.1, &t.law.integral),
    ] {
        line(&format!("        // {name}"));
        line(&format!("        {field}: matrix!["));
        for row in m.row_iter() {
            let row: Vec<_> = row.iter().map(|x| format!("{x:?}")).collect();
            line(&format!("            {};", row.join(", ")));
        }
        line("        ],");
    }
    line(&format!("        leak: {:?},", t.law.leak));
    line(&format!("        anti_windup: {:?},", t.law.anti_windup));
    line("    },");
    line("    // Codes per N, limit in N.");
    line("    actuators: [");
    for a in &t.actuators {
        line(&format!(
            "        Drive {{ zero: {:?}, gain: {:?}, limit: {:?} }},",
            a.zero, a.gain, a.limit
        ));
    }
    line("    ],");
    line(&format!("    dac_max: DacCode({}),", t.dac_max.0));
    line("})");
    line(".validate()");
    line("{");
    line("    Ok(table) => table,");
    line("    Err(_) => panic!(\"this table was edited by hand\"),");
    line("};");
    out
}
