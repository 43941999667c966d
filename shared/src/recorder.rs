//! A recorder of samples at full rate: a ring buffer that stops after a trigger.

use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{AdcCode, DacCode, Samples};

/// One sample: the codes read and the codes put out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
// Copied in words of 32 bits.
#[repr(align(4))]
pub struct Record {
    /// The ADC codes.
    pub adc: Samples,
    /// The DAC codes put out in answer.
    pub dac: [DacCode; LEGS],
}

impl Record {
    /// All codes zero.
    pub const NONE: Self = Self {
        adc: Samples::NONE,
        dac: [DacCode(0); LEGS],
    };
}

impl Record {
    /// The same record, copied code by code: for the compiler's copy of the whole it calls a
    /// subroutine that takes twice as many instructions.
    #[inline]
    pub fn copied(&self) -> Self {
        Self {
            adc: Samples {
                sensors: core::array::from_fn(|i| self.adc.sensors[i]),
                forces: core::array::from_fn(|i| self.adc.forces[i]),
            },
            dac: core::array::from_fn(|i| self.dac[i]),
        }
    }
}

/// The event that triggers a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Trigger {
    /// The next sample.
    Now,
    /// A fault.
    Fault,
    /// The first sample of an injection.
    Injection,
    /// The first sample in which a sensor's code rises above a level.
    Rise {
        /// The sensor, 0 to 5, or the force sensor of a
        /// [`Complement`](crate::table::Complement), 6 to 11.
        sensor: u8,
        /// The level. The code before must be at or below it, the new one above.
        level: AdcCode,
    },
}

/// A request for a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recording {
    /// The event that the recording is centred on.
    pub trigger: Trigger,
    /// Number of samples to keep from before the trigger; fewer if the trigger comes
    /// earlier.
    pub before: u32,
    /// Number of samples to record from the trigger on, at least 1.
    pub after: u32,
}

/// The progress of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Recorded {
    /// No recording was requested.
    Off,
    /// The recorder waits for the trigger.
    Waiting,
    /// The trigger has occurred, and the samples after it are being recorded.
    Running,
    /// The recording is complete.
    Done {
        /// Number of records.
        length: u32,
        /// Number of records from before the trigger.
        before: u32,
        /// Sample of the trigger, since power-up.
        at: u64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RecorderState {
    Off,
    Waiting(Recording),
    Running {
        recording: Recording,
        /// Remaining samples.
        left: u32,
        at: u64,
    },
    Done {
        length: usize,
        before: usize,
        at: u64,
    },
}

/// A recorder in memory given by the caller.
#[derive(Debug)]
pub struct Recorder<'a> {
    ring: &'a mut [Record],
    /// Index of the next record to write.
    next: usize,
    /// Number of records written since the recorder was armed, up to the ring's length.
    filled: usize,
    state: RecorderState,
    /// The previous sample, while waiting.
    last: Option<Samples>,
}

impl<'a> Recorder<'a> {
    /// An idle recorder with the memory `room`.
    pub fn new(room: &'a mut [Record]) -> Self {
        Self {
            ring: room,
            next: 0,
            filled: 0,
            state: RecorderState::Off,
            last: None,
        }
    }

    /// Number of records that fit into the memory.
    pub fn room(&self) -> usize {
        self.ring.len()
    }

    /// Whether samples are to be passed to [`Recorder::push`].
    pub fn records(&self) -> bool {
        matches!(
            self.state,
            RecorderState::Waiting(_) | RecorderState::Running { .. }
        )
    }

    fn write(&mut self, record: &Record) {
        if let Some(slot) = self.ring.get_mut(self.next) {
            *slot = record.copied();
            self.filled = self.filled.max(self.next + 1);
            self.next += 1;
        }
        if self.next >= self.ring.len() {
            self.next = 0;
        }
    }

    /// Starts a new recording and drops the last one. Returns false and changes nothing if
    /// the recording is too long for the memory, has no sample after the trigger, or names a
    /// sensor that does not exist.
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
            self.state = RecorderState::Waiting(recording);
        }
        room && sensor
    }

    /// Takes the record of sample `at`. `fault` and `injection` say whether one begins with
    /// this sample.
    pub fn push(&mut self, at: u64, record: &Record, fault: bool, injection: bool) {
        if let RecorderState::Waiting(recording) = self.state {
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
                self.state = RecorderState::Running {
                    recording,
                    left: recording.after,
                    at,
                };
            }
            self.last = Some(record.adc);
        }
        match self.state {
            RecorderState::Off | RecorderState::Done { .. } => {}
            RecorderState::Waiting(_) => self.write(record),
            RecorderState::Running {
                recording,
                left,
                at,
            } => {
                self.write(record);
                let after = recording.after as usize;
                self.state = if left > 1 {
                    RecorderState::Running {
                        recording,
                        left: left - 1,
                        at,
                    }
                } else {
                    let there = self.filled.saturating_sub(after);
                    let before = there.min(recording.before as usize);
                    RecorderState::Done {
                        length: before + after,
                        before,
                        at,
                    }
                };
            }
        }
    }

    /// The progress of the recording.
    pub fn recorded(&self) -> Recorded {
        match self.state {
            RecorderState::Off => Recorded::Off,
            RecorderState::Waiting(_) => Recorded::Waiting,
            RecorderState::Running { .. } => Recorded::Running,
            // Both come from the u32 of a recording.
            RecorderState::Done { length, before, at } => Recorded::Done {
                length: length as u32,
                before: before as u32,
                at,
            },
        }
    }

    /// Record `index` of a complete recording, the oldest first.
    pub fn get(&self, index: usize) -> Option<&Record> {
        let RecorderState::Done { length, .. } = self.state else {
            return None;
        };
        // Counted back from the newest. A ring that is not full starts at 0.
        let back = length.checked_sub(index).filter(|back| *back > 0)?;
        let at = match self.next.checked_sub(back) {
            Some(at) => at,
            None => (self.next + self.filled).checked_sub(back)?,
        };
        self.ring.get(at)
    }
}
