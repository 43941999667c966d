//! Zeros, poles, singular values, the generalised plant, and machines side by
//! side.

use std::fmt::{self, Display, Formatter};

use nalgebra::Complex;
use rayon::prelude::*;
use serde::Serialize;
use shared::LEGS;
use shared::table::ValidTable;

use super::aligned::{TITLE, WARNING, write_table};
use super::{Pole, Rows, digest, rows};
use crate::closed_loop::{SampledLoop, close_ideal, grid, stable};
use crate::design::ideal_poles;
use crate::energy::{Kind, energies};
use crate::export::Generalised;
use crate::law::LinearLaw;
use crate::linear::largest_singular_value;
use crate::machine::{Feedback, Machine, MachineError};
use crate::plant::pole_peaks;
use crate::robustness::{Robust, Spread};
use crate::shaping::{Band, Shaped, ShapingError};
use crate::study::{Looped, Study};
use crate::zeros::{grow, transmission_zeros};

/// The two kinds of feedback, those that a machine has sensors for, each with
/// its study.
pub fn both_kinds(machine: &Machine) -> Result<Vec<Study>, MachineError> {
    let kinds = [Feedback::Acceleration, Feedback::Force];
    let machines = kinds.map(|feedback| machine.with_feedback(feedback));
    machines.into_iter().flatten().map(Study::new).collect()
}

/// `host-gen zeros`.
#[derive(Debug, Serialize)]
pub struct Zeros {
    machine: String,
    model_sha256: String,
    kinds: Vec<ZerosOfKind>,
}

#[derive(Debug, Serialize)]
struct ZerosOfKind {
    feedback: &'static str,
    zeros: Vec<Zero>,
    /// A zero that grows: the machine with its sensors held is unstable.
    unstable: bool,
}

#[derive(Debug, Serialize)]
struct Zero {
    #[serde(flatten)]
    at: Pole,
    /// The nearest pole of the ideal loop, Hz.
    nearest_closed_loop_hz: Option<f64>,
}

impl Zeros {
    /// Of all kinds of feedback a machine has sensors for.
    ///
    /// # Errors
    /// As [`Study::new`]. Where an eigenvalue iteration does not end, that
    /// kind's list is empty.
    pub fn new(machine: &Machine) -> Result<Self, MachineError> {
        let kinds = both_kinds(machine)?.iter().map(ZerosOfKind::new).collect();
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            kinds,
        })
    }
}

impl ZerosOfKind {
    fn new(study: &Study) -> Self {
        let plant = &study.plant.plant.state_space;
        let feedback = study.design.feedback;
        let zeros = transmission_zeros(plant, feedback).unwrap_or_default();
        let poles = ideal_poles(plant, &study.gains).unwrap_or_default();
        let unstable = grow(&zeros);
        Self {
            feedback: feedback.name(),
            zeros: zeros
                .into_iter()
                // One of each conjugate pair.
                .filter(|s| s.im >= 0.0)
                .map(|s| Zero {
                    nearest_closed_loop_hz: poles
                        .iter()
                        .min_by(|a, b| (*a - s).norm().total_cmp(&(*b - s).norm()))
                        .map(|pole| Pole::from(*pole).hz),
                    at: s.into(),
                })
                .collect(),
            unstable,
        }
    }
}

impl Display for Zeros {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Transmission zeros of {}, leg forces to sensors (G22){TITLE:#}",
            self.machine
        )?;
        writeln!(
            f,
            "  High gain moves the poles of the closed loop to them: there the loop cannot act."
        )?;
        for kind in &self.kinds {
            writeln!(f, "  {} feedback", kind.feedback)?;
            writeln!(
                f,
                "            Hz     damping   nearest pole of the ideal loop, Hz"
            )?;
            for zero in &kind.zeros {
                let nearest = zero.nearest_closed_loop_hz.unwrap_or(f64::NAN);
                writeln!(
                    f,
                    "    {:>10.3}  {:>10.4}   {nearest:>10.3}",
                    zero.at.hz, zero.at.damping
                )?;
            }
            if kind.unstable {
                writeln!(
                    f,
                    "    {WARNING}Warning:{WARNING:#} a zero is unstable. With the sensor outputs held at zero, the machine is unstable:\n    its stiffness under gravity is negative, and no gain of this kind can stabilise it."
                )?;
            }
        }
        Ok(())
    }
}

/// `host-gen poles`.
#[derive(Debug, Serialize)]
pub struct Poles {
    machine: String,
    model_sha256: String,
    feedback: &'static str,
    open: Vec<Pole>,
    ideal: Vec<Pole>,
    sampled: Vec<Pole>,
    stable: bool,
}

impl Poles {
    /// Of a study, the sampled loop under `table`.
    ///
    /// # Errors
    /// Where an eigenvalue iteration does not end.
    pub fn new(study: &Study, table: &ValidTable) -> Result<Self, ShapingError> {
        let plant = &study.plant.plant;
        let closed = SampledLoop {
            plant: &study.plant,
            law: LinearLaw::new(table),
        };
        let ideal = ideal_poles(&plant.state_space, &study.gains);
        let (Some(ideal), Some(sampled)) = (ideal, closed.poles()) else {
            return Err(ShapingError::Eigenvalues);
        };
        // One of each conjugate pair; poles of the delay, faster than half the
        // sample rate, say nothing of the machine.
        let fastest = core::f64::consts::PI / study.plant.period;
        let list = |poles: &[Complex<f64>]| {
            poles
                .iter()
                .filter(|s| s.im >= 0.0 && s.norm() < fastest)
                .map(|s| Pole::from(*s))
                .collect()
        };
        Ok(Self {
            machine: study.machine.name.clone(),
            model_sha256: digest(&study.machine),
            feedback: study.design.feedback.name(),
            open: list(&plant.poles.iter().map(|p| p.lambda).collect::<Vec<_>>()),
            ideal: list(&ideal),
            stable: stable(&sampled),
            sampled: list(&sampled),
        })
    }
}

impl Display for Poles {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Poles of {}, {} feedback{TITLE:#}",
            self.machine, self.feedback
        )?;
        let length = self
            .open
            .len()
            .max(self.ideal.len())
            .max(self.sampled.len());
        writeln!(
            f,
            "        open: Hz  damping      ideal: Hz  damping    sampled: Hz  damping"
        )?;
        for i in 0..length {
            for list in [&self.open, &self.ideal, &self.sampled] {
                match list.get(i) {
                    Some(pole) => write!(f, "    {:>12.4} {:>8.4}", pole.hz, pole.damping)?,
                    None => write!(f, "{:25}", "")?,
                }
            }
            writeln!(f)?;
        }
        writeln!(
            f,
            "  The sampled loop is {}.",
            if self.stable { "stable" } else { "unstable" }
        )
    }
}

/// `host-gen sigma`.
#[derive(Debug, Serialize)]
pub struct Sigma {
    machine: String,
    model_sha256: String,
    pub(crate) hz: Vec<f64>,
    pub(crate) curves: Vec<Curve>,
    /// Loops that are not among the curves, and why.
    pub(crate) missing: Vec<String>,
}

#[derive(Debug, Serialize)]
pub(crate) struct Curve {
    pub(crate) name: String,
    /// The largest singular value of G11 at every `hz`.
    pub(crate) sigma_max: Vec<f64>,
    /// What is fed back and how; none without control.
    #[serde(skip)]
    pub(crate) of: Option<(Feedback, Law)>,
}

/// The paper's law, or the board's.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Law {
    Ideal,
    Sampled,
}

/// Where to evaluate singular values.
#[derive(Clone, Debug)]
pub enum Frequencies {
    /// From `low` to `high` Hz, `count` evenly in the logarithm and more about
    /// every lightly damped pole, open and closed, so that no peak lies between
    /// two of them.
    Adaptive {
        /// Hz.
        low: f64,
        /// Hz.
        high: f64,
        /// At least two.
        count: usize,
    },
    /// At these alone, Hz.
    At(Vec<f64>),
}

impl Sigma {
    /// σ_max(G11) at `frequencies` of the loops of one machine, the first of
    /// them also open.
    ///
    /// # Errors
    /// Where an eigenvalue iteration does not end.
    pub fn new(
        machine: &Machine,
        looped: &[Looped],
        frequencies: Frequencies,
    ) -> Result<Self, ShapingError> {
        let mut missing = Vec::new();
        let mut peaks = Vec::new();
        let mut loops = Vec::new();
        for Looped { study, sampled } in looped {
            let plant = &study.plant.plant;
            peaks.extend(plant.peaks());
            let ideal =
                ideal_poles(&plant.state_space, &study.gains).ok_or(ShapingError::Eigenvalues)?;
            peaks.extend(pole_peaks(&ideal));
            let name = study.design.feedback.name();
            // That of both kinds is the accelerations'.
            let own = study.design.feedback != Feedback::Both;
            let ideal_holds = own && stable(&ideal);
            if own && !ideal_holds {
                missing.push(format!("{name}, ideal: that loop is unstable"));
            }
            let sampled = match sampled {
                Ok((table, _)) => {
                    let law = LinearLaw::new(table);
                    let plant = &study.plant;
                    let closed = SampledLoop { plant, law };
                    peaks.extend(pole_peaks(&closed.poles().unwrap_or_default()));
                    Some(closed)
                }
                Err(reason) => {
                    missing.push(format!("{name}, sampled: {reason}"));
                    None
                }
            };
            loops.push((study, ideal_holds, sampled));
        }
        let hz = match frequencies {
            Frequencies::Adaptive { low, high, count } => grid(low, high, count, &peaks),
            Frequencies::At(hz) => hz,
        };
        let curve = |of: Option<(Feedback, Law)>, sigma: &(dyn Fn(f64) -> f64 + Sync)| Curve {
            name: match of {
                None => "open".to_owned(),
                Some((kind, Law::Ideal)) => format!("{}, ideal", kind.name()),
                Some((kind, Law::Sampled)) => format!("{}, sampled", kind.name()),
            },
            of,
            sigma_max: hz.par_iter().map(|&hz| sigma(hz)).collect(),
        };
        let mut curves = Vec::new();
        for (i, (study, ideal_holds, sampled)) in loops.iter().enumerate() {
            let plant = &study.plant.plant;
            let rows = plant.performance();
            if i == 0 {
                curves.push(curve(None, &|hz| {
                    largest_singular_value(&plant.response(hz).from_floor(rows.clone()))
                }));
            }
            let kind = study.design.feedback;
            if *ideal_holds {
                curves.push(curve(Some((kind, Law::Ideal)), &|hz| {
                    largest_singular_value(&close_ideal(plant, &study.gains, hz, rows.clone()))
                }));
            }
            if let Some(closed) = sampled {
                curves.push(curve(Some((kind, Law::Sampled)), &|hz| {
                    largest_singular_value(&closed.close(hz, rows.clone()))
                }));
            }
        }
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            hz,
            curves,
            missing,
        })
    }
}

impl Display for Sigma {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}σ_max(G11) of {}, dB, at the peaks of each curve{TITLE:#}",
            self.machine
        )?;
        for curve in &self.curves {
            writeln!(f, "  {}", curve.name)?;
            let db: Vec<f64> = curve.sigma_max.iter().map(|s| 20.0 * s.log10()).collect();
            for i in peaks(&db) {
                writeln!(f, "    {:>10.3} Hz {:>8.1} dB", self.hz[i], db[i])?;
            }
        }
        for missing in &self.missing {
            writeln!(f, "  not shown: {missing}")?;
        }
        Ok(())
    }
}

/// The maxima that stand half a dB above the valleys on either side; ripples
/// of rounding between close frequencies do not.
fn peaks(db: &[f64]) -> Vec<usize> {
    const RISE: f64 = 0.5;
    let mut peaks = Vec::new();
    let (mut top, mut bottom) = (0, 0);
    let mut rising = false;
    for i in 0..db.len() {
        if rising {
            if db[i] > db[top] {
                top = i;
            } else if db[i] < db[top] - RISE {
                peaks.push(top);
                rising = false;
                bottom = i;
            }
        } else if db[i] < db[bottom] {
            bottom = i;
        } else if db[i] > db[bottom] + RISE {
            rising = true;
            top = i;
        }
    }
    peaks
}

/// `host-gen robust`.
#[derive(Debug, Serialize)]
pub struct Robustness {
    machine: String,
    model_sha256: String,
    payload: Vec<String>,
    mass: f64,
    cog: f64,
    leg_stiffness: f64,
    seed: u64,
    #[serde(flatten)]
    result: Robust,
}

impl Robustness {
    /// Of a machine and what was found.
    pub fn new(machine: &Machine, result: Robust) -> Self {
        let settings = &machine.robustness;
        let name = |i: &usize| machine.bodies[*i].name.clone();
        Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            payload: settings.payload.iter().map(name).collect(),
            mass: settings.mass,
            cog: settings.cog,
            leg_stiffness: settings.leg_stiffness,
            seed: settings.seed,
            result,
        }
    }
}

impl Display for Robustness {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let r = &self.result;
        writeln!(
            f,
            "{TITLE}The controller of {} on {} randomly perturbed machines{TITLE:#}",
            self.machine, r.samples
        )?;
        writeln!(
            f,
            "  payload {} mass ±{:.0} %, centre of gravity ±{:.0} mm; legs ±{:.0} %; seed {}",
            self.payload.join(", "),
            100.0 * self.mass,
            1e3 * self.cog,
            100.0 * self.leg_stiffness,
            self.seed
        )?;
        writeln!(f, "  stable on {} of {}", r.stable, r.samples)?;
        writeln!(f, "{:34}   lowest    nominal    highest", "")?;
        let line = |f: &mut Formatter<'_>, title: &str, s: &Spread| {
            writeln!(
                f,
                "  {title:<30} {:>10.3} {:>10.3} {:>10.3}",
                s.min, s.nominal, s.max
            )
        };
        line(f, "peak sensitivity", &r.peak_sensitivity)?;
        line(f, "isolates from, Hz", &r.isolation_from_hz)?;
        line(f, "lowest damping of any pole", &r.lowest_damping)?;
        for band in &r.bands {
            line(
                f,
                &format!("σ_max(G11), {}, dB", band.name),
                &band.sampled_db,
            )?;
        }
        for (title, list) in [("mode, open", &r.open), ("pole, ideal", &r.ideal)] {
            for (i, moving) in list.iter().enumerate() {
                line(f, &format!("{title} {}, Hz", i + 1), &moving.hz)?;
            }
        }
        for (i, moving) in r.ideal.iter().enumerate() {
            line(
                f,
                &format!("pole, ideal {}, damping", i + 1),
                &moving.damping,
            )?;
        }
        Ok(())
    }
}

/// `host-gen plant`.
#[derive(Debug, Serialize)]
pub struct PlantMatrices {
    machine: String,
    model_sha256: String,
    inputs: Vec<String>,
    kinds: Vec<PlantOfKind>,
}

#[derive(Debug, Serialize)]
struct PlantOfKind {
    feedback: &'static str,
    outputs: Vec<String>,
    a: Rows,
    b: Rows,
    c: Rows,
    d: Rows,
}

impl PlantMatrices {
    /// Of all kinds of feedback a machine has sensors for.
    ///
    /// # Errors
    /// As [`Study::new`].
    pub fn new(machine: &Machine) -> Result<Self, MachineError> {
        let beam = |i: &usize| machine.beams[*i].name.clone();
        let kinds = both_kinds(machine)?
            .iter()
            .map(|study| {
                let g = Generalised::new(&study.plant.plant);
                let mut outputs = machine.performance_names();
                outputs.extend(machine.sensor_names(study.design.feedback));
                PlantOfKind {
                    feedback: study.design.feedback.name(),
                    outputs,
                    a: rows(&g.a),
                    b: rows(&g.b),
                    c: rows(&g.c),
                    d: rows(&g.d),
                }
            })
            .collect();
        Ok(Self {
            machine: machine.name.clone(),
            model_sha256: digest(machine),
            inputs: machine
                .floor
                .iter()
                .map(|input| input.name.clone())
                .chain(machine.actuators.iter().map(beam))
                .collect(),
            kinds,
        })
    }
}

impl Display for PlantMatrices {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}Generalised plant of {} (Fig. 4){TITLE:#}",
            self.machine
        )?;
        writeln!(f, "  inputs: {}", self.inputs.join(" "))?;
        for kind in &self.kinds {
            writeln!(
                f,
                "  {} feedback: {} states, outputs {}",
                kind.feedback,
                kind.a.len(),
                kind.outputs.join(" ")
            )?;
        }
        writeln!(
            f,
            "  The matrices: --format json, or --matrix-market FOLDER."
        )
    }
}

/// One of a band's levels, dB.
type Level = fn(&Band) -> f64;

/// `host-gen compare`.
#[derive(Debug, Serialize)]
pub struct Compared {
    machines: Vec<Column>,
}

#[derive(Debug, Serialize)]
struct Column {
    machine: String,
    model_sha256: String,
    feedback: &'static str,
    suspension_hz: Vec<f64>,
    internal_hz: Vec<f64>,
    rigid_modes_hz: [f64; LEGS],
    acceleration_zeros_hz: Vec<f64>,
    force_zeros_hz: Vec<f64>,
    /// Largest gain of the law, N/(m/s²) or 1.
    largest_gain: f64,
    /// Nothing where the target cannot be reached.
    shaped: Option<Shaped>,
}

impl Compared {
    /// Machines side by side.
    ///
    /// # Errors
    /// As [`Study::new`].
    pub fn new<'a>(machines: impl IntoIterator<Item = &'a Looped>) -> Result<Self, MachineError> {
        let machines = machines
            .into_iter()
            .map(Column::new)
            .collect::<Result<_, _>>()?;
        Ok(Self { machines })
    }
}

impl Column {
    fn new(Looped { study, sampled }: &Looped) -> Result<Self, MachineError> {
        let kinds = both_kinds(&study.machine)?;
        let zeros = |feedback| {
            let study = kinds.iter().find(|study| study.design.feedback == feedback);
            let zeros = study
                .and_then(|s| transmission_zeros(&s.plant.plant.state_space, feedback))
                .unwrap_or_default();
            let upper = zeros.into_iter().filter(|s| s.im >= 0.0);
            upper.map(|s| Pole::from(s).hz).collect()
        };
        let modes = study.model.modes();
        let energies = energies(&study.machine, &study.model, &modes);
        let of = |kind| {
            let pairs = modes.hertz().into_iter().zip(&energies);
            let those = pairs.filter(|(_, energies)| energies.kind == kind);
            those.map(|(hz, _)| hz).collect()
        };
        Ok(Self {
            machine: study.machine.name.clone(),
            model_sha256: digest(&study.machine),
            feedback: study.design.feedback.name(),
            suspension_hz: of(Kind::Suspension),
            internal_hz: of(Kind::Internal),
            rigid_modes_hz: study.design.hertz(),
            acceleration_zeros_hz: zeros(Feedback::Acceleration),
            force_zeros_hz: zeros(Feedback::Force),
            largest_gain: study.gains.proportional.amax(),
            shaped: sampled.as_ref().ok().map(|(_, shaped)| shaped.clone()),
        })
    }
}

impl Display for Compared {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut rows = Vec::new();
        let line = |rows: &mut Vec<Vec<String>>, title: &str, cell: &dyn Fn(&Column) -> String| {
            let title = [title.to_owned()].into_iter();
            rows.push(title.chain(self.machines.iter().map(cell)).collect());
        };
        line(&mut rows, "", &|c| c.machine.clone());
        line(&mut rows, "feedback", &|c| c.feedback.to_owned());
        let list = |rows: &mut Vec<_>, title: &str, of: &dyn Fn(&Column) -> &[f64]| {
            let longest = self.machines.iter().map(|c| of(c).len()).max();
            for i in 0..longest.unwrap_or(0) {
                let title = if i == 0 { title } else { "" };
                line(rows, title, &|c| {
                    of(c).get(i).map_or_else(String::new, |x| format!("{x:.3}"))
                });
            }
        };
        list(&mut rows, "suspension modes, Hz", &|c| &c.suspension_hz);
        list(&mut rows, "internal modes, Hz", &|c| &c.internal_hz);
        list(&mut rows, "design model, Hz", &|c| &c.rigid_modes_hz);
        list(&mut rows, "zeros, acceleration feedback, Hz", &|c| {
            &c.acceleration_zeros_hz
        });
        list(&mut rows, "zeros, force feedback, Hz", &|c| {
            &c.force_zeros_hz
        });
        line(&mut rows, "largest proportional gain", &|c| {
            format!("{:.4e}", c.largest_gain)
        });
        let of_loop = |c: &Column, cell: &dyn Fn(&Shaped) -> String| {
            c.shaped
                .as_ref()
                .map_or_else(|| "unreachable".to_owned(), cell)
        };
        line(&mut rows, "peak sensitivity", &|c| {
            of_loop(c, &|r| format!("{:.3}", r.peak_sensitivity.value))
        });
        line(&mut rows, "isolates from, Hz", &|c| {
            of_loop(c, &|r| format!("{:.2}", r.isolation_from_hz))
        });
        line(&mut rows, "the same, ideal loop, Hz", &|c| {
            of_loop(c, &|r| format!("{:.2}", r.isolation_from_ideal_hz))
        });
        let bands = self.machines.iter().filter_map(|c| c.shaped.as_ref());
        let names: Vec<_> = bands
            .flat_map(|r| r.bands.iter().map(|band| band.name.clone()))
            .fold(Vec::new(), |mut names, name| {
                if !names.contains(&name) {
                    names.push(name);
                }
                names
            });
        for name in names {
            let values: [(&str, Level); 3] = [
                ("open", |band| band.open_db),
                ("ideal", |band| band.ideal_db),
                ("sampled", |band| band.sampled_db),
            ];
            for (what, value) in values {
                line(
                    &mut rows,
                    &format!("σ_max(G11), {name}, {what}, dB"),
                    &|c| {
                        of_loop(c, &|r| {
                            let band = r.bands.iter().find(|band| band.name == name);
                            band.map_or_else(String::new, |band| format!("{:.1}", value(band)))
                        })
                    },
                );
            }
        }
        write_table(f, 0, 1, rows)
    }
}
