//! The program as a user, and another program, has it.

mod command_line;
#[path = "../../../host-gen/tests/all/edits.rs"]
mod edits;
mod files;
mod link;
#[path = "../../../tests/src/near.rs"]
mod near;
mod run;
mod snapshots;
