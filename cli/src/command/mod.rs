//! The commands.

pub mod campaign;
pub mod compare;
pub mod design;
pub mod floor;
pub mod link;
pub mod model;
pub mod new;
pub mod plant;
pub mod poles;
pub mod report;
pub mod robust;
pub mod sigma;
pub mod sil;
pub mod simulate;
pub mod table;
pub mod watch;
