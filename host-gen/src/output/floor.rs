//! `host-gen floor`: spectra, sources and the criterion met.

use std::fmt::{self, Display, Formatter};

use serde::Serialize;

use super::aligned::{TITLE, cells, write_table};
use super::digest;
use crate::spectrum::{Budget, Criterion, Powers, SOURCES};
use crate::study::Study;

/// What a floor and the board's noise come to, with and without control.
#[derive(Debug, Serialize)]
pub struct Floors {
    machine: String,
    model_sha256: String,
    feedback: &'static str,
    floor: String,
    low_hz: f64,
    high_hz: f64,
    sources: [&'static str; SOURCES.len()],
    open: Side,
    closed: Side,
}

#[derive(Debug, Serialize)]
struct Side {
    /// The strictest criterion the frame meets.
    criterion: Option<&'static str>,
    rms: Vec<Rms>,
    thirds: Vec<Third>,
    hz: Vec<f64>,
    /// Amplitude densities of the performance outputs, all sources together.
    performance: Vec<Vec<f64>>,
    /// Of the frame's velocity along x, y, z.
    frame_velocity: Vec<Vec<f64>>,
}

#[derive(Debug, Serialize)]
struct Rms {
    name: String,
    unit: &'static str,
    rms: f64,
    /// Parts of the power, in the order of the sources.
    shares: Powers,
}

#[derive(Debug, Serialize)]
struct Third {
    hz: f64,
    /// The worst of x, y and z, m/s.
    velocity: f64,
    dominant: &'static str,
}

fn shares(powers: &Powers) -> (f64, Powers) {
    let total: f64 = powers.iter().sum();
    let share = |power: f64| if total > 0.0 { power / total } else { 0.0 };
    (total.sqrt(), powers.map(share))
}

fn dominant(powers: &Powers) -> &'static str {
    let largest = (0..SOURCES.len()).max_by(|&a, &b| powers[a].total_cmp(&powers[b]));
    SOURCES[largest.unwrap_or(0)]
}

impl Side {
    fn new(study: &Study, budget: Budget, [low, high]: [f64; 2]) -> Self {
        let machine = &study.machine;
        let legs = |what: &str| {
            let name = |leg: &usize| format!("{what} {}", machine.beams[*leg].name);
            machine.actuators.iter().map(name).collect::<Vec<_>>()
        };
        let axes = ["x", "y", "z"].map(|axis| format!("frame {axis}")).to_vec();
        let groups = [
            (&budget.performance, machine.performance_names(), "m/s²"),
            (&budget.frame, axes, "m/s"),
            (&budget.force, legs("force"), "N"),
            (&budget.stroke, legs("stroke"), "m"),
        ];
        let rms = groups
            .into_iter()
            .flat_map(|(spectra, names, unit)| {
                spectra
                    .iter()
                    .zip(names)
                    .map(move |(s, name)| (s, name, unit))
            })
            .map(|(spectrum, name, unit)| {
                let (rms, shares) = shares(&budget.power(spectrum, low, high));
                Rms {
                    name,
                    unit,
                    rms,
                    shares,
                }
            })
            .collect();
        let thirds = budget.thirds().into_iter();
        let densities = |spectra: &[Vec<Powers>]| {
            let amplitude = |powers: &Powers| powers.iter().sum::<f64>().sqrt();
            let all = spectra.iter();
            all.map(|spectrum| spectrum.iter().map(amplitude).collect())
                .collect()
        };
        Self {
            criterion: budget.criterion().map(Criterion::name),
            rms,
            thirds: thirds
                .map(|(hz, velocity, powers)| Third {
                    hz,
                    velocity,
                    dominant: dominant(&powers),
                })
                .collect(),
            performance: densities(&budget.performance),
            frame_velocity: densities(&budget.frame),
            hz: budget.hz,
        }
    }
}

impl Floors {
    /// Of a study on the floor `name`: without control and with it, from `band`'s
    /// one end to the other.
    pub fn new(study: &Study, name: String, band: [f64; 2], open: Budget, closed: Budget) -> Self {
        Self {
            machine: study.machine.name.clone(),
            model_sha256: digest(&study.machine),
            feedback: study.design.feedback.name(),
            floor: name,
            low_hz: band[0],
            high_hz: band[1],
            sources: SOURCES,
            open: Side::new(study, open, band),
            closed: Side::new(study, closed, band),
        }
    }
}

impl Floors {
    /// The same with the lists over frequency empty.
    pub(crate) fn without_spectra(mut self) -> Self {
        for side in [&mut self.open, &mut self.closed] {
            side.hz.clear();
            side.performance.clear();
            side.frame_velocity.clear();
        }
        self
    }
}

impl Display for Floors {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}{} on the floor {}, {} to {} Hz, {} feedback{TITLE:#}",
            self.machine, self.floor, self.low_hz, self.high_hz, self.feedback
        )?;
        let mut head = cells(["rms", "unit", "open", "closed"]);
        head.extend(self.sources.map(|source| format!("from {source}")));
        let sides = self.open.rms.iter().zip(&self.closed.rms);
        let rows = sides.map(|(open, closed)| {
            let mut row = cells([&closed.name, closed.unit]);
            row.extend([open.rms, closed.rms].map(|x| format!("{x:.2e}")));
            row.extend(closed.shares.map(|share| format!("{:.1} %", 100.0 * share)));
            row
        });
        write_table(f, 2, 2, [head].into_iter().chain(rows))?;
        writeln!(
            f,
            "  The shares are those of the power with the loop closed."
        )?;
        writeln!(
            f,
            "  Frame velocity in one-third octaves, worst of x, y, z, µm/s\n        Hz       open     closed   main source, closed"
        )?;
        for (open, closed) in self.open.thirds.iter().zip(&self.closed.thirds) {
            writeln!(
                f,
                "    {:>6.1} {:>10.4} {:>10.4}   {}",
                closed.hz,
                1e6 * open.velocity,
                1e6 * closed.velocity,
                closed.dominant
            )?;
        }
        let name = |side: &Side| side.criterion.unwrap_or("none of VC-A to VC-G");
        writeln!(
            f,
            "  The frame meets {} without control and {} with control.",
            name(&self.open),
            name(&self.closed)
        )
    }
}
