//! The last samples at full rate: a ring that stops some time after a trigger.

use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{AdcCode, DacCode, Samples};

/// One sample: what was read and what was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Record {
    /// Read.
    pub adc: Samples,
    /// Given after it.
    pub dac: [DacCode; LEGS],
}

impl Record {
    /// All codes zero.
    pub const NONE: Self = Self {
        adc: Samples::NONE,
        dac: [DacCode(0); LEGS],
    };
}

/// What stops a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Trigger {
    /// Being armed.
    Now,
    /// A fault.
    Fault,
    /// The first sample of an injection.
    Injection,
    /// A sensor's code, 0 to 5, or that of a force sensor beside them, 6 to 11,
    /// rises past a level.
    Rise {
        /// Which.
        sensor: u8,
        /// Code.
        level: AdcCode,
    },
}

/// What to record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recording {
    /// When.
    pub trigger: Trigger,
    /// Samples from before the trigger, which are kept as far as there are any.
    pub before: u32,
    /// Samples from the trigger on, at least 1.
    pub after: u32,
}

/// How a recording stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Recorded {
    /// None is asked for.
    Off,
    /// The trigger has not come.
    Waiting,
    /// It has.
    Running,
    /// So many records are there, of which so many are from before the trigger.
    Done {
        /// Records.
        length: u32,
        /// From before the trigger.
        before: u32,
        /// The trigger's sample, since power came.
        at: u64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Off,
    Waiting(Recording),
    Running {
        recording: Recording,
        /// Samples still to come.
        left: u32,
        at: u64,
    },
    Done {
        length: usize,
        before: usize,
        at: u64,
    },
}

/// A recorder in as much memory as it is given.
#[derive(Debug)]
pub struct Recorder<'a> {
    ring: &'a mut [Record],
    /// Where the next record goes.
    next: usize,
    /// Records that are there.
    filled: usize,
    state: State,
    last: Option<Samples>,
}

impl<'a> Recorder<'a> {
    /// With nothing in it.
    pub fn new(room: &'a mut [Record]) -> Self {
        Self {
            ring: room,
            next: 0,
            filled: 0,
            state: State::Off,
            last: None,
        }
    }

    /// How many records there is room for.
    pub fn room(&self) -> usize {
        self.ring.len()
    }

    fn write(&mut self, record: Record) {
        if let Some(slot) = self.ring.get_mut(self.next) {
            *slot = record;
            self.filled = self.filled.max(self.next + 1);
            self.next += 1;
        }
        if self.next >= self.ring.len() {
            self.next = 0;
        }
    }

    /// Begins anew. False, and nothing changes, if there is no room or the sensor
    /// is none.
    pub fn arm(&mut self, recording: Recording) -> bool {
        let Recording {
            trigger,
            before,
            after,
        } = recording;
        let room = u64::from(before) + u64::from(after) <= self.ring.len() as u64 && after > 0;
        let sensor = match trigger {
            Trigger::Rise { sensor, .. } => usize::from(sensor) < 2 * LEGS,
            Trigger::Now | Trigger::Fault | Trigger::Injection => true,
        };
        if room && sensor {
            (self.next, self.filled) = (0, 0);
            self.last = None;
            self.state = State::Waiting(recording);
        }
        room && sensor
    }

    /// Sample `at`; `fault` and `injection` if they begin with it.
    pub fn push(&mut self, at: u64, record: Record, fault: bool, injection: bool) {
        if let State::Waiting(recording) = self.state {
            let triggered = match recording.trigger {
                Trigger::Now => true,
                Trigger::Fault => fault,
                Trigger::Injection => injection,
                Trigger::Rise { sensor, level } => {
                    let of = |samples: &Samples| {
                        let mut all = samples.sensors.iter().chain(&samples.forces);
                        all.nth(sensor.into()).map_or(i16::MIN, |code| code.0)
                    };
                    let now = of(&record.adc) > level.0;
                    self.last.is_some_and(|last| of(&last) <= level.0) && now
                }
            };
            if triggered {
                self.state = State::Running {
                    recording,
                    left: recording.after,
                    at,
                };
            }
            self.last = Some(record.adc);
        }
        match self.state {
            State::Off | State::Done { .. } => {}
            State::Waiting(_) => self.write(record),
            State::Running {
                recording,
                left,
                at,
            } => {
                self.write(record);
                let after = recording.after as usize;
                self.state = if left > 1 {
                    State::Running {
                        recording,
                        left: left - 1,
                        at,
                    }
                } else {
                    let there = self.filled.saturating_sub(after);
                    let before = there.min(recording.before as usize);
                    State::Done {
                        length: before + after,
                        before,
                        at,
                    }
                };
            }
        }
    }

    /// How it stands.
    pub fn recorded(&self) -> Recorded {
        match self.state {
            State::Off => Recorded::Off,
            State::Waiting(_) => Recorded::Waiting,
            State::Running { .. } => Recorded::Running,
            // Their sum is within a recording's u32s.
            State::Done { length, before, at } => Recorded::Done {
                length: length as u32,
                before: before as u32,
                at,
            },
        }
    }

    /// Record `index` of a finished recording, the oldest first.
    pub fn get(&self, index: usize) -> Option<&Record> {
        let State::Done { length, .. } = self.state else {
            return None;
        };
        // From the newest back; a ring that is not full begins at 0.
        let back = length.checked_sub(index).filter(|back| *back > 0)?;
        let at = match self.next.checked_sub(back) {
            Some(at) => at,
            None => (self.next + self.filled).checked_sub(back)?,
        };
        self.ring.get(at)
    }
}
