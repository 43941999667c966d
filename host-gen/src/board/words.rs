//! Refusals and causes of faults in words.

use shared::LEGS;
use shared::controller::Refusal;
use shared::supervisor::Cause;

/// A refusal in words.
pub fn reason(refusal: Refusal) -> String {
    let words = match refusal {
        Refusal::Table(error) => return format!("the table does not run there: {error}"),
        Refusal::Memory => {
            "it has no memory to keep a table, or that failed; the table before runs on"
        }
        Refusal::Mode => "not in this mode; see host-gen link status",
        Refusal::Range => "a number is outside its limits",
        Refusal::Frame => "the frame was malformed",
        Refusal::Version => "it speaks another version of the link",
        Refusal::Session => "another program has begun a session",
        Refusal::Replayed => "the frame was an old one",
    };
    words.to_owned()
}

/// A cause in words.
pub fn cause(cause: Cause) -> String {
    let named = |mask: u16| {
        let of = |i: u32| {
            if i < LEGS as u32 {
                format!("sensor {}", i + 1)
            } else {
                format!("force sensor {}", i + 1 - LEGS as u32)
            }
        };
        let set = (0..16).filter(|i| mask >> i & 1 != 0);
        set.map(of).collect::<Vec<_>>().join(", ")
    };
    match cause {
        Cause::Table => "the table is not what it was when it was made".to_owned(),
        Cause::Rail(mask) => format!("at an end of the ADC's range: {}", named(mask)),
        Cause::Stuck(mask) => format!("the same code for too long: {}", named(mask)),
        Cause::Implausible(mask) => {
            format!(
                "moves far more or far less than the others: {}",
                named(mask)
            )
        }
        Cause::TestSensors(mask) => {
            format!("does not answer as the model says: {}", named(mask))
        }
        Cause::TestLegs(mask) => {
            let legs = (0..LEGS).filter(|i| mask >> i & 1 != 0);
            let legs: Vec<_> = legs.map(|i| format!("leg {}", i + 1)).collect();
            format!("does not push as the model says: {}", legs.join(", "))
        }
        Cause::Lost => "samples were not read".to_owned(),
        Cause::Late => "deadlines were missed".to_owned(),
        Cause::NotFinite => "a force was not a finite number".to_owned(),
        Cause::Saturated => "the legs were at their limits for too long".to_owned(),
        Cause::Diverging => "the forces grew and grew".to_owned(),
        Cause::Silent => "nobody was heard on the link".to_owned(),
        Cause::Erratic(mask) => format!("jumps there and back: {}", named(mask)),
    }
}
