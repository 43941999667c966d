//! The rooms of the firmware, checked as those of `shared`.

#[path = "../../shared/tests/rooms.rs"]
mod rooms;
