//! Controller tables, made by `host-gen generate` and never by hand.

use shared::table::ValidTable;

pub mod both_sensors;
pub mod metrology_frame;

/// The tables by the name of their machine.
pub static ALL: [(&str, &ValidTable); 2] = [
    ("metrology-frame", &metrology_frame::TABLE),
    ("both-sensors", &both_sensors::TABLE),
];
