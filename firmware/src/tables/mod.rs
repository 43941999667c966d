//! Controller tables, made by `host-gen generate` and never by hand.

use shared::table::ValidTable;

pub mod both_sensors;
pub mod metrology_frame;
pub mod nucleo_h743;

/// A machine's table.
pub struct Entry {
    /// The machine's name.
    pub machine: &'static str,
    /// Its table.
    pub table: &'static ValidTable,
    /// What its checksum was when it was made.
    pub checksum: u32,
}

/// The paper's machine on a board of 75 µs.
pub static METROLOGY_FRAME: Entry = Entry {
    machine: "metrology-frame",
    table: &metrology_frame::TABLE,
    checksum: metrology_frame::CHECKSUM,
};

/// The same with both kinds of sensors.
pub static BOTH_SENSORS: Entry = Entry {
    machine: "both-sensors",
    table: &both_sensors::TABLE,
    checksum: both_sensors::CHECKSUM,
};

/// The same on the reference board.
pub static NUCLEO_H743: Entry = Entry {
    machine: "nucleo-h743",
    table: &nucleo_h743::TABLE,
    checksum: nucleo_h743::CHECKSUM,
};

/// All of them.
pub static ALL: [&Entry; 3] = [&METROLOGY_FRAME, &BOTH_SENSORS, &NUCLEO_H743];
