//! Defects in the simulated loop, and the reactions of self-test and supervisor.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng};
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;
use serde::Serialize;
use shared::LEGS;
use shared::codes::{AdcCode, DacCode, Samples};
use shared::controller::{Memory, Reading};
use shared::supervisor::{Cause, Event, Mode};
use shared::table::ValidTable;

use super::software_board::SoftwareBoard;
use crate::design::Study;
use crate::progress::Progress;

/// A defect of converters, sensors, legs, floor or table. Sensors and legs are given by
/// index, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Defect {
    /// The sensor gives no signal, only the noise of the ADC.
    SensorDead(usize),
    /// The sensor repeats the code that it gave when the defect began.
    SensorStuck(usize),
    /// The sensor has additional noise of 3,000 codes rms.
    SensorNoisy(usize),
    /// The sensor's sign is inverted.
    SensorInverted(usize),
    /// Two sensors are exchanged.
    SensorsSwapped(usize, usize),
    /// The sensor is at the positive end of the ADC's range.
    SensorRailed(usize),
    /// The leg gives no force.
    LegDead(usize),
    /// The leg gives at most a tenth of its force limit.
    LegSaturated(usize),
    /// The leg has Bouc–Wen hysteresis of 15 %.
    LegHysteretic(usize),
    /// One bit of an ADC word is flipped, in one of 1,000 samples on average.
    AdcBits,
    /// One bit of a DAC word is flipped, in one of 1,000 samples on average.
    DacBits,
    /// One of 100 samples is lost on average.
    SamplesLostSingly,
    /// All samples are lost.
    SamplesLost,
    /// Every deadline is missed.
    Late,
    /// The floor's motion is 1,000 times as strong for half a second.
    FloorShock,
    /// One bit of the table is flipped.
    Table,
}

impl Defect {
    /// Every single defect of a machine with six sensors and six legs.
    pub fn all() -> Vec<Self> {
        let mut all = Vec::new();
        let of_each: [fn(usize) -> Self; 8] = [
            Self::SensorDead,
            Self::SensorStuck,
            Self::SensorNoisy,
            Self::SensorInverted,
            Self::SensorRailed,
            Self::LegDead,
            Self::LegSaturated,
            Self::LegHysteretic,
        ];
        for of in of_each {
            all.extend((0..LEGS).map(of));
        }
        for i in 0..LEGS {
            all.extend((i + 1..LEGS).map(|j| Self::SensorsSwapped(i, j)));
        }
        all.extend([
            Self::AdcBits,
            Self::DacBits,
            Self::SamplesLostSingly,
            Self::SamplesLost,
            Self::Late,
            Self::FloorShock,
            Self::Table,
        ]);
        all
    }

    /// A short name; sensors and legs are numbered from 1.
    pub fn name(self) -> String {
        match self {
            Self::SensorDead(i) => format!("sensor {} dead", i + 1),
            Self::SensorStuck(i) => format!("sensor {} stuck", i + 1),
            Self::SensorNoisy(i) => format!("sensor {} noisy", i + 1),
            Self::SensorInverted(i) => format!("sensor {} inverted", i + 1),
            Self::SensorsSwapped(i, j) => format!("sensors {} and {} swapped", i + 1, j + 1),
            Self::SensorRailed(i) => format!("sensor {} at the rail", i + 1),
            Self::LegDead(i) => format!("leg {} dead", i + 1),
            Self::LegSaturated(i) => format!("leg {} saturated", i + 1),
            Self::LegHysteretic(i) => format!("leg {} hysteretic", i + 1),
            Self::AdcBits => "bit errors, ADC".to_owned(),
            Self::DacBits => "bit errors, DAC".to_owned(),
            Self::SamplesLostSingly => "samples lost singly".to_owned(),
            Self::SamplesLost => "samples lost".to_owned(),
            Self::Late => "deadlines missed".to_owned(),
            Self::FloorShock => "floor shock".to_owned(),
            Self::Table => "table corrupted".to_owned(),
        }
    }
}

/// The result of one case of a campaign.
#[derive(Clone, Debug, Serialize)]
pub struct DefectOutcome {
    /// The defects, all present at the same time.
    pub defects: Vec<Defect>,
    /// Fault found by the self-test, with the defects present from the start; none if it
    /// passes.
    pub self_test: Option<Cause>,
    /// Fault found by the supervisor when the defects begin with the loop closed, and the
    /// time until then, s; none if the loop stays closed.
    pub closed: Option<(Cause, f64)>,
    /// Whether all outputs stayed within the legs' limits.
    pub inside: bool,
    /// Time from the detection of the fault to the safe codes at the outputs, s; none
    /// without a fault, or if the outputs did not reach the safe codes.
    pub safe_after: Option<f64>,
    /// Whether the outputs reached the safe codes within the ramp time of the table and
    /// stayed there; true without a fault.
    pub safe: bool,
    /// Rms of the performance outputs with the defects relative to that before, dB; none
    /// if the loop was opened.
    pub worse_db: Option<f64>,
}

/// Time with the loop closed before the defects begin, s.
const BEFORE: f64 = 4.0;
/// Time with the defects present, s.
const AFTER: f64 = 20.0;
/// Time simulated after a fault is latched, s.
const LATCHED: f64 = 0.5;

/// Simulates every one of `cases`, each a list of defects that are present at the same
/// time, on all cores. `progress` is called after each case.
pub fn campaign(
    study: &Study,
    table: &ValidTable,
    cases: &[Vec<Defect>],
    progress: &dyn Progress,
) -> Vec<DefectOutcome> {
    cases
        .par_iter()
        .map(|defects| {
            let outcome = BrokenLoop::new(study, table, defects).outcome(study, table);
            progress.advance();
            outcome
        })
        .collect()
}

/// Converters with defects.
struct Broken {
    defects: Vec<Defect>,
    random: ChaCha8Rng,
    /// The codes of stuck sensors.
    held: Option<Samples>,
    /// By leg: last input and state of the hysteresis, relative to the force limit.
    hysteresis: [[f64; 2]; LEGS],
    adc_noise: f64,
    zero: [f64; LEGS],
    stroke: [f64; LEGS],
}

impl Broken {
    fn new(study: &Study, table: &ValidTable, defects: &[Defect]) -> Self {
        let board = &study.machine().board;
        let drives = &table.get().actuators;
        Self {
            defects: defects.to_vec(),
            random: ChaCha8Rng::seed_from_u64(study.machine().simulation.seed),
            held: None,
            hysteresis: [[0.0; 2]; LEGS],
            adc_noise: board.adc_noise / board.adc.lsb(),
            zero: drives.map(|drive| drive.zero.into()),
            stroke: drives.map(|drive| f64::from(drive.gain.abs() * drive.limit)),
        }
    }

    fn noise(&mut self, rms: f64) -> f64 {
        let normal: f64 = StandardNormal.sample(&mut self.random);
        rms * normal
    }

    fn one_in(&mut self, count: u32) -> bool {
        self.random.next_u32().is_multiple_of(count)
    }

    /// A random channel and bit.
    fn bit(&mut self) -> (usize, u32) {
        let word = self.random.next_u32();
        (word as usize % LEGS, word >> 16 & 15)
    }

    fn read(&mut self, true_samples: Samples) -> Reading {
        let held = *self.held.get_or_insert(true_samples);
        let mut samples = true_samples;
        let mut lost = false;
        let mut late = false;
        for defect in self.defects.clone() {
            let codes = &mut samples.sensors;
            match defect {
                Defect::SensorDead(i) => codes[i] = AdcCode(self.noise(self.adc_noise) as i16),
                Defect::SensorStuck(i) => codes[i] = held.sensors[i],
                Defect::SensorNoisy(i) => {
                    // The cast saturates.
                    codes[i].0 = (f64::from(codes[i].0) + self.noise(3000.0)) as i16;
                }
                Defect::SensorInverted(i) => codes[i].0 = codes[i].0.saturating_neg(),
                Defect::SensorsSwapped(i, j) => codes.swap(i, j),
                Defect::SensorRailed(i) => codes[i] = AdcCode(i16::MAX),
                Defect::AdcBits if self.one_in(1000) => {
                    let (i, bit) = self.bit();
                    codes[i].0 ^= 1 << bit;
                }
                Defect::SamplesLostSingly => lost |= self.one_in(100),
                Defect::SamplesLost => lost = true,
                Defect::Late => late = true,
                _ => {}
            }
        }
        Reading {
            samples: (!lost).then_some(samples),
            late,
        }
    }

    fn give(&mut self, dac: [DacCode; LEGS]) -> [DacCode; LEGS] {
        let mut codes = dac;
        for defect in self.defects.clone() {
            match defect {
                Defect::LegDead(i) => codes[i] = self.code(i, 0.0),
                Defect::LegSaturated(i) => {
                    let part = self.part(i, codes[i]).clamp(-0.1, 0.1);
                    codes[i] = self.code(i, part);
                }
                Defect::LegHysteretic(i) => {
                    let part = self.part(i, codes[i]);
                    let [before, z] = &mut self.hysteresis[i];
                    // Bouc–Wen with A = 1, β = γ = ½, n = 1, its width a tenth of
                    // the limit: ż = (ẋ − ½·|ẋ|·z/w − ½·ẋ·|z|/w).
                    let dx = part - *before;
                    let width = 0.1;
                    *z += dx - 0.5 * (dx.abs() * *z + dx * z.abs()) / width;
                    *before = part;
                    let out = 0.85 * part + 0.15 * *z;
                    codes[i] = self.code(i, out);
                }
                Defect::DacBits if self.one_in(1000) => {
                    let (i, bit) = self.bit();
                    codes[i].0 ^= 1 << bit;
                }
                _ => {}
            }
        }
        codes
    }

    /// A leg's force relative to its limit.
    fn part(&self, leg: usize, code: DacCode) -> f64 {
        (f64::from(code.0) - self.zero[leg]) / self.stroke[leg]
    }

    fn code(&self, leg: usize, part: f64) -> DacCode {
        DacCode((self.zero[leg] + part * self.stroke[leg]).round() as u16)
    }
}

/// A loop whose converters get defects.
struct BrokenLoop {
    sil: SoftwareBoard<'static>,
    broken: Broken,
    inside: bool,
    rate: f64,
    safe: [DacCode; LEGS],
    performance: f64,
}

impl BrokenLoop {
    fn new(study: &Study, table: &ValidTable, defects: &[Defect]) -> Self {
        Self {
            sil: SoftwareBoard::new(study, table, Memory::none()),
            broken: Broken::new(study, table, defects),
            inside: true,
            rate: study.machine().board.sample_rate,
            safe: table.safe_codes(),
            performance: 0.0,
        }
    }

    /// Runs one sample, with the defects if `broken`; returns the codes of the
    /// controller.
    fn sample(&mut self, broken: bool) -> [DacCode; LEGS] {
        let Self { sil, broken: b, .. } = self;
        let samples = sil.rig.sample();
        let reading = if broken {
            b.read(samples)
        } else {
            samples.into()
        };
        let dac = sil.controller.on_sample(reading);
        let given = if broken { b.give(dac) } else { dac };
        self.performance += self.sil.rig.advance(given).norm_squared();
        // Half a code of tolerance: a limit is rounded to the nearest code.
        let within = |(i, code): (usize, &DacCode)| {
            let over = self.broken.part(i, *code).abs() - 1.0;
            over * self.broken.stroke[i] <= 0.5
        };
        self.inside &= dac.iter().enumerate().all(within);
        dac
    }

    fn steps(&self, seconds: f64) -> usize {
        (seconds * self.rate) as usize
    }

    fn mode(&self) -> Mode {
        self.sil.controller.report().mode
    }

    /// Runs until the mode changes, at most 30 s.
    fn while_in(&mut self, mode: Mode, broken: bool) {
        for _ in 0..self.steps(30.0) {
            if self.mode() != mode {
                break;
            }
            self.sample(broken);
        }
    }

    fn outcome(mut self, study: &Study, table: &ValidTable) -> DefectOutcome {
        let defects = self.broken.defects.clone();
        // The self-test of a machine with the defects present from the start.
        let mut first = Self::new(study, table, &defects);
        let self_test = first.tested();
        self.ask(Event::SelfTest);
        self.while_in(Mode::Testing, false);
        self.ask(Event::Start);
        self.while_in(Mode::Starting, false);
        self.performance = 0.0;
        for _ in 0..self.steps(BEFORE) {
            self.sample(false);
        }
        let before = core::mem::take(&mut self.performance) / self.steps(BEFORE) as f64;

        if defects.contains(&Defect::Table) {
            // A board's link task does this check once a second.
            self.turn_a_bit(table);
        }
        let shock = defects.contains(&Defect::FloorShock);
        let mut at = None;
        let mut after = 0;
        for k in 0..self.steps(AFTER) {
            self.sil.rig.floor_gain = if shock && k < self.steps(0.5) {
                1000.0
            } else {
                1.0
            };
            self.sample(true);
            after += 1;
            if self.sil.controller.report().fault.is_some() {
                at = Some(k);
                break;
            }
        }
        let worse = 10.0 * (self.performance / f64::from(after) / before).log10();
        let fault = self.sil.controller.report().fault;
        let closed = fault
            .zip(at)
            .map(|(fault, k)| (fault.cause, k as f64 / self.rate));
        let mut safe_after = None;
        let mut quiet = true;
        if closed.is_some() {
            for k in 0..self.steps(LATCHED) {
                let dac = self.sample(true);
                match safe_after {
                    None if dac == self.safe => safe_after = Some((k + 1) as f64 / self.rate),
                    None => {}
                    Some(_) => quiet &= dac == self.safe,
                }
            }
        }
        let bound = f64::from(table.get().supervision.safe_ramp) / self.rate;
        let safe = match (closed, safe_after) {
            (None, _) => true,
            // With a tolerance for rounding.
            (Some(_), Some(time)) => quiet && time <= bound + 1e-9,
            (Some(_), None) => false,
        };
        DefectOutcome {
            defects,
            self_test,
            closed,
            inside: self.inside && first.inside,
            safe_after,
            safe,
            worse_db: closed.is_none().then_some(worse),
        }
    }

    /// The fault that the self-test finds; none if it passes.
    fn tested(&mut self) -> Option<Cause> {
        self.ask(Event::SelfTest);
        self.while_in(Mode::Testing, true);
        self.sil.controller.report().fault.map(|fault| fault.cause)
    }

    fn ask(&mut self, event: Event) {
        // If a defect has opened the loop already, the request is refused; the outcome
        // shows it.
        let _ = self.sil.controller.ask(event);
    }

    /// Flips one bit of the table and compares checksums, as a board does with its
    /// memory.
    fn turn_a_bit(&mut self, table: &ValidTable) {
        let mut changed = *table.get();
        changed.law.leak = f32::from_bits(changed.law.leak.to_bits() ^ 1);
        let checksum = self.sil.controller.identity().checksum;
        if changed
            .validate()
            .is_ok_and(|changed| changed.checksum() != checksum)
        {
            self.sil.controller.table_changed();
        }
    }
}
