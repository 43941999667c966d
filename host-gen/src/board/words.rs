//! Refusals and causes of faults in words.

use shared::LEGS;
use shared::controller::Refusal;
use shared::supervisor::Cause;

/// The reason of a refusal, as text that continues "the board refuses the request:".
pub fn reason(refusal: Refusal) -> String {
    let words = match refusal {
        Refusal::Table(error) => return format!("it cannot run the table: {error}"),
        Refusal::Memory => {
            "it has no memory to store a table, or writing failed; the previous table still runs"
        }
        Refusal::Mode => "not allowed in this mode; see host-gen link status",
        Refusal::Range => "a value is out of range",
        Refusal::Frame => "the frame was malformed",
        Refusal::Version => "it uses another version of the link protocol",
        Refusal::Session => "another program has started a session",
        Refusal::Replayed => "the frame was a repeated, old one",
    };
    words.to_owned()
}

/// The cause of a fault, as text; sensors and legs are numbered from 1.
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
        Cause::Table => "the table has changed in memory".to_owned(),
        Cause::Rail(mask) => format!("at an end of the ADC's range: {}", named(mask)),
        Cause::Stuck(mask) => format!("the same code for too long: {}", named(mask)),
        Cause::Implausible(mask) => {
            format!(
                "moves much more or much less than the others: {}",
                named(mask)
            )
        }
        Cause::TestSensors(mask) => {
            format!("does not respond as the model predicts: {}", named(mask))
        }
        Cause::TestLegs(mask) => {
            let legs = (0..LEGS).filter(|i| mask >> i & 1 != 0);
            let legs: Vec<_> = legs.map(|i| format!("leg {}", i + 1)).collect();
            format!("does not push as the model predicts: {}", legs.join(", "))
        }
        Cause::Lost => "samples were lost".to_owned(),
        Cause::Late => "deadlines were missed".to_owned(),
        Cause::NotFinite => "a force was not a finite number".to_owned(),
        Cause::Saturated => "the legs were at their limits for too long".to_owned(),
        Cause::Diverging => "the forces kept growing".to_owned(),
        Cause::Silent => "no message on the link for the time supervision.silence (0 lets the loop run without a host)".to_owned(),
        Cause::Erratic(mask) => format!("jumps for single samples: {}", named(mask)),
    }
}
