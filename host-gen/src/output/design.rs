//! What `host-gen design` prints: the ideal loop beside the one that runs.

use std::fmt::{self, Display, Formatter};

use nalgebra::Complex;
use rayon::prelude::*;
use serde::Serialize;
use shared::LEGS;
use shared::table::ValidTable;

use super::aligned::TITLE;
use super::{digest, write_shaped};
use crate::closed_loop::{SampledLoop, close_ideal, corner, grid, stable};
use crate::design::ideal_poles;
use crate::law::LinearLaw;
use crate::machine::{Board, Machine};
use crate::margins::{Margins, margins};
use crate::plant::{Gain, pole_peaks};
use crate::rounding::{Rounding, rounding};
use crate::shaping::{Effort, Shaped, ShapingError, isolation_band};
use crate::study::{Study, StudyError};

/// Where isolation is told, Hz.
const AT: [f64; 6] = [2.0, 5.0, 10.0, 20.0, 50.0, 100.0];

/// `host-gen design`.
#[derive(Debug, Serialize)]
pub struct Designed {
    machine: String,
    model_sha256: String,
    feedback: &'static str,
    shaped: Shaped,
    isolation_at_hz: [f64; AT.len()],
    modes: Vec<Mode>,
    margins: Margins,
    delay: Delay,
    rounding: Vec<Rounding>,
    chart: Vec<Cell>,
}

/// One mode of the design model.
#[derive(Debug, Serialize)]
struct Mode {
    /// Without control, Hz.
    hz: f64,
    open: Isolation,
    /// None where the ideal loop is unstable.
    ideal: Option<Isolation>,
    sampled: Isolation,
}

/// How a mode follows the same motion of the floor.
#[derive(Debug, Serialize)]
struct Isolation {
    /// Above this it is under 1/√2, Hz.
    corner_hz: f64,
    /// At [`AT`], dB, positive where it follows less.
    db: [f64; AT.len()],
    /// Its highest amplification, dB, and where, Hz.
    peak_db: f64,
    peak_hz: f64,
}

/// What the whole delay is made of, s.
#[derive(Debug, Serialize)]
struct Delay {
    latch: f64,
    hold: f64,
    amplifier: f64,
    sensor: f64,
    whole: f64,
}

impl Delay {
    fn new(board: &Board) -> Self {
        let lag = |hz: Option<f64>| hz.map_or(0.0, |hz| 1.0 / (core::f64::consts::TAU * hz));
        let [amplifier, sensor] = [board.actuator_bandwidth, board.sensor.bandwidth].map(lag);
        Self {
            latch: board.latch_delay,
            hold: 0.5 * board.period(),
            amplifier,
            sensor,
            whole: board.whole_delay() + amplifier + sensor,
        }
    }
}

/// What another board would give.
#[derive(Debug, Serialize)]
struct Cell {
    sample_rate: f64,
    whole_delay: f64,
    /// By band, dB; empty where the target cannot be reached.
    sampled_db: Vec<f64>,
}

impl Designed {
    /// Of a study with its table. With `chart`, designs for other boards too,
    /// which takes some times as long.
    ///
    /// # Errors
    /// Where an eigenvalue iteration does not end.
    pub fn new(
        study: &Study,
        table: &ValidTable,
        shaped: Shaped,
        chart: bool,
        progress: &(dyn Fn() + Sync),
    ) -> Result<Self, StudyError> {
        let machine = &study.machine;
        let plant = &study.plant.plant;
        let closed = SampledLoop {
            plant: &study.plant,
            law: LinearLaw::new(table),
        };
        let poles = closed.poles().ok_or(ShapingError::Eigenvalues)?;
        let ideal =
            ideal_poles(&plant.state_space, &study.gains).ok_or(ShapingError::Eigenvalues)?;
        let floor = plant.rigid_floor.map(Complex::from);
        let band = isolation_band(&study.design, machine.target.frequency);
        let whole = plant.whole();
        let open = |hz: f64| plant.response(hz).from_floor(whole.clone()) * floor;
        let under_ideal = |hz: f64| close_ideal(plant, &study.gains, hz, whole.clone()) * floor;
        let sampled = |hz: f64| closed.transmissibility(hz);
        let modes = (0..LEGS)
            .map(|k| Mode {
                hz: study.design.hertz()[k],
                open: Isolation::new(k, band, &plant.peaks(), &open),
                ideal: stable(&ideal)
                    .then(|| Isolation::new(k, band, &pole_peaks(&ideal), &under_ideal)),
                sampled: Isolation::new(k, band, &pole_peaks(&poles), &sampled),
            })
            .collect();
        let board = &machine.board;
        let margins = margins(
            &closed,
            &study.design,
            board.whole_delay(),
            machine.target.max_sensitivity,
            &pole_peaks(&poles),
        );
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            feedback: study.design.feedback.name(),
            isolation_at_hz: AT,
            modes,
            margins,
            delay: Delay::new(board),
            rounding: rounding(machine, table),
            chart: if chart {
                other_boards(machine, progress)?
            } else {
                Vec::new()
            },
            shaped,
        })
    }
}

impl Isolation {
    fn new(
        mode: usize,
        [low, high]: [f64; 2],
        peaks: &[(f64, f64)],
        gain: &dyn Fn(f64) -> Gain,
    ) -> Self {
        let own = |hz: f64| gain(hz)[(mode, mode)];
        let alone = |hz: f64| Gain::from_fn(1, |_, j| if j == 0 { own(hz) } else { Complex::ZERO });
        let db = |hz: f64| -20.0 * own(hz).norm().log10();
        let (peak_hz, peak_db) = grid(low, high, 200, peaks)
            .into_iter()
            .map(|hz| (hz, -db(hz)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((low, 0.0));
        Self {
            corner_hz: corner(low, high, peaks, alone),
            db: AT.map(db),
            peak_db,
            peak_hz,
        }
    }
}

/// The same machine at once and twice the sample rate, with the latch where it
/// is, 10 and 20 µs sooner, and 10 µs later, each with a rough search.
fn other_boards(machine: &Machine, progress: &(dyn Fn() + Sync)) -> Result<Vec<Cell>, StudyError> {
    let mut boards = Vec::new();
    for rate in [1.0, 2.0] {
        for later in [10e-6, 0.0, -10e-6, -20e-6] {
            let mut machine = machine.clone();
            let board = &mut machine.board;
            board.sample_rate *= rate;
            board.latch_delay += later;
            if board.latch_delay >= 0.0 {
                boards.push(machine);
            }
        }
    }
    boards
        .into_par_iter()
        .map(|machine| {
            let board = machine.board;
            let study = Study::new(machine)?;
            let sampled_db = match study.table_with(Effort::Rough, &progress) {
                Ok((_, shaped)) => shaped.bands.iter().map(|band| band.sampled_db).collect(),
                Err(ShapingError::Unreachable { .. }) => Vec::new(),
                Err(error) => return Err(error.into()),
            };
            Ok(Cell {
                sample_rate: board.sample_rate,
                whole_delay: board.whole_delay(),
                sampled_db,
            })
        })
        .collect()
}

impl Display for Designed {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Design of {}, {} feedback{TITLE:#}",
            self.machine, self.feedback
        )?;
        write_shaped(f, &self.shaped)?;
        let micro = |s: f64| 1e6 * s;
        let Delay {
            latch,
            hold,
            amplifier,
            sensor,
            whole,
        } = &self.delay;
        writeln!(
            f,
            "{TITLE}Delay, µs:{TITLE:#} sample to latch {:.1}, hold {:.1}, amplifier {:.1}, sensor {:.1}; total {:.1}",
            micro(*latch),
            micro(*hold),
            micro(*amplifier),
            micro(*sensor),
            micro(*whole)
        )?;
        writeln!(
            f,
            "{TITLE}How each mode follows the floor motion in its own shape{TITLE:#}"
        )?;
        write!(
            f,
            "                    corner  highest            attenuation, dB"
        )?;
        for hz in self.isolation_at_hz {
            write!(f, " {hz:>5} Hz")?;
        }
        writeln!(f)?;
        for mode in &self.modes {
            writeln!(f, "  {:.2} Hz", mode.hz)?;
            let rows = [
                ("open", Some(&mode.open)),
                ("ideal", mode.ideal.as_ref()),
                ("sampled", Some(&mode.sampled)),
            ];
            for (name, isolation) in rows {
                let Some(i) = isolation else {
                    writeln!(f, "    {name:<10} unstable")?;
                    continue;
                };
                write!(
                    f,
                    "    {name:<10} {:>8.2} Hz {:>6.1} dB at {:>5.2} Hz        ",
                    i.corner_hz, i.peak_db, i.peak_hz
                )?;
                for db in i.db {
                    write!(f, " {db:>8.1}")?;
                }
                writeln!(f)?;
            }
        }
        writeln!(
            f,
            "{TITLE}Disk margins{TITLE:#}          α     gain    phase"
        )?;
        let margins = self.margins.modes.iter().enumerate();
        let all = margins
            .map(|(k, margin)| (format!("mode {}", k + 1), margin))
            .chain([("all modes at once".to_owned(), &self.margins.together)]);
        for (name, margin) in all {
            writeln!(
                f,
                "  {name:<16} {:>5.2}   ×{:>5.2}   ±{:>4.1}°",
                margin.disk, margin.gain, margin.phase_deg
            )?;
        }
        let bode = &self.margins.bode;
        writeln!(
            f,
            "{TITLE}Bode's integral, mean of the modes:{TITLE:#} {:.0} Hz of attenuation, {:.0} Hz of amplification;",
            bode.attenuation_hz, bode.amplification_hz
        )?;
        writeln!(
            f,
            "  the bound, from {:.0} Hz to where the delay alone turns the phase by 180°, allows {:.0} Hz: {:.0} % of that is used",
            bode.crossover_hz,
            bode.limit_hz,
            100.0 * bode.amplification_hz / bode.limit_hz
        )?;
        write!(f, "Single precision relative to sensor noise, dB:")?;
        for Rounding {
            hz, over_noise_db, ..
        } in &self.rounding
        {
            write!(f, " {over_noise_db:.0} at {hz:.0} Hz")?;
        }
        write!(f, "\nCodes of the DAC relative to sensor noise, dB:")?;
        for Rounding {
            hz,
            codes_over_noise_db,
            ..
        } in &self.rounding
        {
            write!(f, " {codes_over_noise_db:.0} at {hz:.0} Hz")?;
        }
        writeln!(f)?;
        if !self.chart.is_empty() {
            write!(f, "Other boards, roughly   delay")?;
            for band in &self.shaped.bands {
                write!(f, " {:>14}", band.name)?;
            }
            writeln!(f)?;
        }
        for cell in &self.chart {
            write!(
                f,
                "  {:>8.0} Hz     {:>6.1} µs  ",
                cell.sample_rate,
                micro(cell.whole_delay)
            )?;
            for db in &cell.sampled_db {
                write!(f, " {db:>11.1} dB")?;
            }
            if cell.sampled_db.is_empty() {
                write!(f, " unreachable")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
