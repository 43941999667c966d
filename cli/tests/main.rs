//! The program as a user, and another program, has it.

mod command_line;
#[path = "../all/common.rs"]
mod common;
mod link;
