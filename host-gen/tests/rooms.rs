//! Each room of the library imports only from the rooms above it.

#[path = "../../shared/tests/rooms.rs"]
mod rooms;
