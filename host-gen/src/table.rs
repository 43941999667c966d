//! From gains to the controller table, and to its Rust source.

use std::fmt::Write as _;

use nalgebra::{Complex, Matrix6};
use shared::LEGS;
use shared::codes::Calibration;
use shared::table::{
    self, Channel, Complement, Direct, FORMAT_VERSION, Law, Modal, Paths, SelfTest, Table,
    TableError, ValidTable,
};

use crate::design::{Design, Gains, ModalTransform};
use crate::law::LinearLaw;
use crate::machine::{Feedback, Machine, Target};
use crate::plant::SampledPlant;
use crate::shape::Shape;
use crate::supervision::{self_test, supervision};

/// AC coupling sits this far below ω_n, where it costs the lower crossover
/// little phase.
pub const AC_COUPLING: f64 = 0.05;

/// The integral leaks this far below ω_n.
pub const LEAK: f64 = 0.01;

/// Far enough from what a quiet floor gives that the AC coupling is linear
/// there, and near enough that half a second of shock leaves less than the legs
/// can push.
const SHOCK: f64 = 20.0;

/// c of a first-order section with its corner at `hz`, increment form.
pub fn coefficient(hz: f64, period: f64) -> f64 {
    -(-core::f64::consts::TAU * hz * period).exp_m1()
}

/// The table of a machine with the `gains` for `target` and a roll-off at
/// `roll_off` Hz, common to all channels.
pub fn direct(
    machine: &Machine,
    plant: &SampledPlant,
    target: &Target,
    gains: &Gains,
    roll_off: f64,
) -> Result<ValidTable, TableError> {
    let period = machine.board.period();
    let single = |m: &Matrix6<f64>| m.map(|x| x as f32);
    let paths = Paths::Direct(Direct {
        roll_off: coefficient(roll_off, period) as f32,
        proportional: single(&gains.proportional),
        integral: single(&(gains.integral * (0.5 * period))),
    });
    with_paths(machine, plant, target, paths)
}

/// The table of a machine with `shapes` for the modes of its design model.
pub fn modal(
    machine: &Machine,
    plant: &SampledPlant,
    design: &Design,
    target: &Target,
    shapes: &[Shape; LEGS],
) -> Result<ValidTable, TableError> {
    let ModalTransform {
        input,
        beside,
        output,
    } = design.transform();
    let period = machine.board.period();
    let complement = machine.board.beside.zip(beside).map(|(sensor, input)| {
        let calibration = machine.board.adc.calibration(sensor.sensitivity);
        Complement {
            sensors: [calibration; LEGS],
            input: input.map(|x| x as f32),
            // Without one the accelerometers count alone.
            split: shapes.each_ref().map(|shape| {
                let split = shape.split_hz.map(|hz| coefficient(hz, period) as f32);
                split.unwrap_or(1.0)
            }),
        }
    });
    with_paths(
        machine,
        plant,
        target,
        Paths::Modal(Modal {
            input: input.map(|x| x as f32),
            complement,
            channels: channels(design, target, shapes, period),
            sections: Shape::SECTIONS,
            output: output.map(|x| x as f32),
        }),
    )
}

/// The modes' gains with their sections: Eqs. (19) to (22) in the coordinates
/// of Eq. (17).
pub fn channels(
    design: &Design,
    target: &Target,
    shapes: &[Shape; LEGS],
    period: f64,
) -> [Channel; LEGS] {
    let omega = target.omega();
    core::array::from_fn(|i| {
        let whole = (design.omega[i] / omega).powi(2);
        Channel {
            sections: shapes[i].sections(period),
            proportional: (whole - 1.0) as f32,
            integral: (2.0 * target.damping * omega * whole * 0.5 * period) as f32,
        }
    })
}

/// The clamp's excess leaves the integral with time constant 1/ω_n.
fn with_paths(
    machine: &Machine,
    plant: &SampledPlant,
    target: &Target,
    paths: Paths,
) -> Result<ValidTable, TableError> {
    let board = &machine.board;
    let period = board.period();
    let frequency = target.frequency;
    let table = Table {
        version: FORMAT_VERSION,
        model: machine.digest,
        sample_rate: board.sample_rate as f32,
        latch: board.latch_delay as f32,
        feedback: match target.feedback {
            Feedback::Acceleration | Feedback::Both => table::Feedback::Acceleration,
            Feedback::Force => table::Feedback::Force,
        },
        sensors: [board.adc.calibration(board.sensor.sensitivity); LEGS],
        adc_max: board.adc.max(),
        ac_coupling: coefficient(AC_COUPLING * frequency, period) as f32,
        ac_limit: f32::MAX,
        law: Law {
            paths,
            leak: coefficient(LEAK * frequency, period) as f32,
            anti_windup: coefficient(frequency, period) as f32,
        },
        actuators: [board.dac.drive(board.actuator_gain, board.force_limit); LEGS],
        dac_max: board.dac.max(),
        supervision: supervision(machine),
        self_test: self_test(machine, plant),
    }
    .validate()?;
    // Past so many times what takes a leg to its limit at f_n it is a shock.
    let z = Complex::cis(core::f64::consts::TAU * frequency * period);
    let most = LinearLaw::new(&table)
        .response(z)
        .row_iter()
        .map(|row| row.iter().map(|x| x.norm()).sum::<f64>())
        .fold(0.0, f64::max);
    let mut table = *table.get();
    table.ac_limit = (SHOCK * board.force_limit / most) as f32;
    table.validate()
}

/// The Rust source of a table: the same table gives the same bytes, and the
/// numbers read back to the same bits.
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
    // Its fields print as they are written.
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
