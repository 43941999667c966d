//! Controller tables, made by `host-gen generate` and never by hand.

use shared::table::ValidTable;

pub mod both_sensors;
pub mod metrology_frame;

/// A machine's table.
pub struct Entry {
    /// The machine's name.
    pub machine: &'static str,
    /// Its table.
    pub table: &'static ValidTable,
    /// What its checksum was when it was made.
    pub checksum: u32,
}

/// All of them.
pub static ALL: [Entry; 2] = [
    Entry {
        machine: "metrology-frame",
        table: &metrology_frame::TABLE,
        checksum: metrology_frame::CHECKSUM,
    },
    Entry {
        machine: "both-sensors",
        table: &both_sensors::TABLE,
        checksum: both_sensors::CHECKSUM,
    },
];
