//! The Rust source of a table, and the comparison of a file with it.

use std::fmt::Write as _;

use nalgebra::Matrix6;
use shared::LEGS;
use shared::codes::Calibration;
use shared::table::{self, Complement, Direct, Modal, Paths, SelfTest, ValidTable};

use crate::machine::Machine;

/// The Rust source of `table`, a controller table of `machine`.
///
/// The same table always gives the same bytes, and the numbers read back to the same bits.
pub fn emit(machine: &Machine, table: &ValidTable) -> String {
    let t = table.get();
    let mut out = String::new();
    let sensor_unit = match t.feedback {
        table::Feedback::Acceleration => "m/s²",
        table::Feedback::Force => "N",
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
    line(match &t.law.paths {
        Paths::Direct(_) => {
            "use shared::table::{\n    Direct, Feedback, Law, ModelDigest, Paths, Phasor, SelfTest, Supervision, Table, ValidTable,\n};"
        }
        Paths::Modal(Modal {
            complement: None, ..
        }) => {
            "use shared::table::{\n    Channel, Feedback, Law, Modal, ModelDigest, Paths, Phasor, Section, SelfTest, Supervision,\n    Table, ValidTable,\n};"
        }
        Paths::Modal(_) => {
            "use shared::table::{\n    Channel, Complement, Feedback, Law, Modal, ModelDigest, Paths, Phasor, Section, SelfTest,\n    Supervision, Table, ValidTable,\n};"
        }
    });
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
    line("    // s.");
    line(&format!("    latch: {:?},", t.latch));
    line(&format!("    feedback: Feedback::{:?},", t.feedback));
    line(&format!("    // {sensor_unit} per code."));
    emit_sensors(&mut line, "    ", &t.sensors);
    line(&format!("    adc_max: AdcCode({}),", t.adc_max.0));
    line(&format!("    ac_coupling: {:?},", t.ac_coupling));
    line(&format!("    // {sensor_unit}."));
    line(&format!("    ac_limit: {:?},", t.ac_limit));
    line("    law: Law {");
    match &t.law.paths {
        Paths::Direct(direct) => emit_direct(&mut line, direct, t.feedback),
        Paths::Modal(modal) => emit_modal(&mut line, modal, t.feedback),
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
    line("    // Samples.");
    // `Debug` prints a struct expression with all fields.
    line(&format!("    supervision: {:?},", t.supervision));
    emit_test(&mut line, &t.self_test);
    line("})");
    line(".validate()");
    line("{");
    line("    Ok(table) => table,");
    line("    Err(_) => panic!(\"this table was edited by hand\"),");
    line("};");
    line("");
    line("/// [`ValidTable::checksum`] of it when it was made.");
    line(&format!(
        "pub const CHECKSUM: u32 = {:#010x};",
        table.checksum()
    ));
    line("");
    line("const fn p(re: f32, im: f32) -> Phasor {");
    line("    Phasor { re, im }");
    line("}");
    out
}

fn emit_test(line: &mut impl FnMut(&str), test: &SelfTest) {
    let SelfTest {
        step,
        amplitude,
        settle,
        measure,
        pilot,
        watch,
        tolerance,
        sensors,
        forces,
    } = test;
    line("    self_test: SelfTest {");
    line(&format!("        step: {step},"));
    line(&format!("        amplitude: {amplitude:?},"));
    line(&format!("        settle: {settle},"));
    line(&format!("        measure: {measure},"));
    line(&format!("        pilot: {pilot:?},"));
    line(&format!("        watch: {watch},"));
    line(&format!("        tolerance: {tolerance:?},"));
    line("        // By leg: what each sensor answers a push of 1 N.");
    for (name, kind) in [("sensors", sensors), ("forces", forces)] {
        line(&format!("        {name}: ["));
        for leg in kind {
            let row: Vec<_> = leg
                .iter()
                .map(|p| format!("p({:?}, {:?})", p.re, p.im))
                .collect();
            line(&format!("            [{}],", row.join(", ")));
        }
        line("        ],");
    }
    line("    },");
}

fn emit_matrix(line: &mut impl FnMut(&str), field: &str, comment: &str, m: &Matrix6<f32>) {
    line(&format!("            // {comment}"));
    line(&format!("            {field}: matrix!["));
    for row in m.row_iter() {
        let row: Vec<_> = row.iter().map(|x| format!("{x:?}")).collect();
        line(&format!("                {};", row.join(", ")));
    }
    line("            ],");
}

fn emit_sensors(line: &mut impl FnMut(&str), indent: &str, sensors: &[Calibration; LEGS]) {
    line(&format!("{indent}sensors: ["));
    for s in sensors {
        line(&format!(
            "{indent}    Calibration {{ zero: {:?}, gain: {:?} }},",
            s.zero, s.gain
        ));
    }
    line(&format!("{indent}],"));
}

fn emit_direct(line: &mut impl FnMut(&str), direct: &Direct, feedback: table::Feedback) {
    let [proportional, integral] = match feedback {
        table::Feedback::Acceleration => ["K_a, N/(m/s²)", "K_v·T/2, N/(m/s²)"],
        table::Feedback::Force => ["K_P", "K_I·T/2"],
    };
    line("        paths: Paths::Direct(Direct {");
    line(&format!("            roll_off: {:?},", direct.roll_off));
    emit_matrix(line, "proportional", proportional, &direct.proportional);
    emit_matrix(line, "integral", integral, &direct.integral);
    line("        }),");
}

fn emit_modal(line: &mut impl FnMut(&str), modal: &Modal, feedback: table::Feedback) {
    let input = match feedback {
        table::Feedback::Acceleration => "T_in, m/s² to √kg·m/s²",
        table::Feedback::Force => "T_in, N to N/√kg",
    };
    line("        paths: Paths::Modal(Modal {");
    emit_matrix(line, "input", input, &modal.input);
    match &modal.complement {
        None => line("            complement: None,"),
        Some(Complement {
            sensors,
            input,
            split,
        }) => {
            line("            complement: Some(Complement {");
            line("            // N per code.");
            emit_sensors(line, "            ", sensors);
            emit_matrix(line, "input", "Sᵀ, N to N/√kg", input);
            line(&format!("            split: {split:?},"));
            line("            }),");
        }
    }
    line("            channels: [");
    for channel in &modal.channels {
        line("                Channel {");
        line("                    sections: [");
        for s in &channel.sections {
            line(&format!(
                "                        Section {{ rate: {:?}, damping: {:?}, direct: {:?}, band: {:?}, low: {:?} }},",
                s.rate, s.damping, s.direct, s.band, s.low
            ));
        }
        line("                    ],");
        line(&format!(
            "                    proportional: {:?}, integral: {:?},",
            channel.proportional, channel.integral
        ));
        line("                },");
    }
    line("            ],");
    line(&format!("            sections: {},", modal.sections));
    emit_matrix(line, "output", "T_out, N/√kg to N", &modal.output);
    line("        }),");
}

/// The first line in which a table's file, `found`, differs from the `expected` source, in words.
/// `None` if they are equal. Line endings do not count: version control may change them.
pub fn difference(found: &str, expected: &str) -> Option<String> {
    let mut pairs = found.lines().zip(expected.lines());
    match pairs.by_ref().enumerate().find(|(_, (a, b))| a != b) {
        Some((i, (a, b))) if a.trim() == b.trim() => Some(format!(
            "line {} has other white space at its start or end",
            i + 1
        )),
        Some((i, (a, b))) => Some(format!(
            "line {} is \"{}\", should be \"{}\"",
            i + 1,
            a.trim(),
            b.trim()
        )),
        None if found.lines().count() == expected.lines().count() => None,
        None => Some("the file is cut off or has additional lines at its end".to_owned()),
    }
}
