//! Reports for design reviews: as data, as a page, as pictures.

use indexmap::IndexMap;
use serde::Serialize;

use crate::analysis::compare::MachineComparison;
use crate::analysis::compliance::Compliance;
use crate::analysis::controller::DesignAnalysis;
use crate::analysis::floors::FloorAnalysis;
use crate::analysis::gains::GainAnalysis;
use crate::analysis::modes::ModeAnalysis;
use crate::analysis::poles::PoleAnalysis;
use crate::analysis::sigma::{Frequencies, SigmaAnalysis};
use crate::analysis::warnings::{Statement, warnings};
use crate::analysis::zeros::ZeroAnalysis;
use crate::closed_loop::budget::both_budgets;
use crate::control::LinearLaw;
use crate::design::{DesignedStudy, NoDesign, Search, StudyError};
use crate::floor::{Criterion, Floor, NamedFloor};
use crate::machine::{FeedbackKind, Machine, MachineError, Structure};
use crate::model::structure::StructureModel;
use crate::simulate::run::{Comparison, compare};
use crate::simulate::session::{Phase, history};
use chart::{Chart, laid_over};
use scene::Scene;

pub mod campaign;
pub mod changes;
pub mod chart;
mod charts;
pub mod commission;
pub mod page;
pub mod plots;
pub mod scene;
pub mod summary;
mod text;

/// Frequencies of singular values: lowest and highest, Hz, and their number.
const SIGMA: (f64, f64, usize) = (0.1, 300.0, 400);

/// The floor where neither the file nor the caller says one.
const USUAL: Floor = Floor::Criterion(Criterion::VcC);

/// Lowest and highest frequency of spectra, Hz.
const SPECTRA: [f64; 2] = [0.5, 300.0];

/// The report on one machine.
#[derive(Debug, Serialize)]
pub struct Report {
    machine: String,
    files: Vec<SourceFile>,
    scene: Scene,
    modes: ModeAnalysis,
    charts: Vec<Chart>,
    /// Drawings for papers; the page shows the machine in 3D.
    #[serde(skip)]
    drawings: Vec<Chart>,
    #[serde(flatten)]
    control: Option<Control>,
}

/// What only a machine with control has.
#[derive(Debug, Serialize)]
struct Control {
    model_sha256: String,
    feedback: &'static str,
    frequency_hz: f64,
    damping: f64,
    sample_rate: f64,
    settings: Vec<Setting>,
    /// Gains for each kind of feedback that the machine has sensors for.
    gains: Vec<GainAnalysis>,
    zeros: ZeroAnalysis,
    /// Displacements for the loads, whose lists over frequency are in the charts; none without loads.
    compliance: Option<Compliance>,
    closed: Option<Closed>,
    /// The reason if there is no closed loop.
    missing: Option<String>,
    statements: Vec<Statement>,
    warnings: Vec<String>,
    /// Curves that are missing in the chart of singular values, each with the reason.
    not_shown: Vec<String>,
    #[serde(skip)]
    own: DesignedStudy,
}

/// Results that need the closed loop.
#[derive(Debug, Serialize)]
struct Closed {
    poles: PoleAnalysis,
    design: DesignAnalysis,
    floor: FloorAnalysis,
    simulation: Comparison,
    phases: Vec<Phase>,
    table_format: u16,
    table_checksum: u32,
}

/// A file of the machine, as it was read.
#[derive(Debug, Serialize)]
struct SourceFile {
    path: String,
    text: String,
}

/// A key of the machine's file and its value.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Setting {
    key: String,
    value: String,
}

impl Report {
    /// The report without the closed loop. It needs no search for a controller and takes
    /// tens of milliseconds.
    ///
    /// # Errors
    /// [`StudyError`] if the machine gives no valid model or an eigenvalue iteration does
    /// not converge.
    pub fn quick(machine: &Machine) -> Result<Self, StudyError> {
        Self::of(machine, &DesignedStudy::own_feedback(machine, None)?, None)
    }

    /// The full report, with the design from `search` on `floor`; if none, on that of the
    /// machine's file, or else at the limit of VC-C. Of the kinds of feedback that the machine's file does not ask for, it
    /// shows what needs no design.
    ///
    /// # Errors
    /// [`StudyError`] if the machine gives no valid model or an eigenvalue iteration does
    /// not converge. If no controller is found, the report gives the reason.
    pub fn new(
        machine: &Machine,
        floor: Option<&NamedFloor>,
        search: &Search<'_>,
    ) -> Result<Self, StudyError> {
        let studies = DesignedStudy::own_feedback(machine, Some(search))?;
        Self::of(machine, &studies, floor)
    }

    /// As [`Report::new`], a report on the machine with each kind of feedback. Each report
    /// shows the designs of all kinds.
    ///
    /// # Errors
    /// As [`Report::new`].
    pub fn by_feedback(
        machine: &Machine,
        floor: Option<&NamedFloor>,
        search: &Search<'_>,
    ) -> Result<Vec<Self>, StudyError> {
        let studies = DesignedStudy::by_feedback(machine, search)?;
        let report = |own: &DesignedStudy| Self::of(own.study.machine(), &studies, floor);
        studies.iter().map(report).collect()
    }

    fn of(
        machine: &Machine,
        studies: &[DesignedStudy],
        floor: Option<&NamedFloor>,
    ) -> Result<Self, StudyError> {
        let kind = machine.target.feedback;
        let own = studies
            .iter()
            .find(|l| l.study.design_model().feedback == kind);
        let own = own.expect("a machine has the sensors that it feeds back");
        let study = &own.study;
        let (low, high, count) = SIGMA;
        let sigma =
            SigmaAnalysis::new(machine, studies, Frequencies::Adaptive { low, high, count })?;
        let mut charts = vec![
            charts::sigma(&sigma, kind),
            charts::isolation(own)?,
            charts::frequencies(studies)?,
        ];
        let compliance = Compliance::of(study, own.design.as_ref().ok())?;
        charts.extend(compliance.iter().flat_map(charts::compliance));
        let mut closed = None;
        if let Ok(design) = &own.design {
            let table = &design.table;
            charts.extend(charts::loops(study, LinearLaw::new(table))?);
            let own = || machine.spectrum.clone().unwrap_or(USUAL).into();
            let NamedFloor { floor, name } = floor.cloned().unwrap_or_else(own);
            let (board, exposure) = (&machine.board, machine.exposure);
            let budgets = both_budgets(study.plant(), board, table, &floor, SPECTRA, exposure)?;
            charts.extend(charts::vibration(&name, &budgets));
            // The long parts in parallel.
            let ((history, simulation), analysis) = rayon::join(
                || {
                    let outputs = machine.performance_names();
                    let settings = &machine.simulation;
                    rayon::join(
                        || history(study, table),
                        || compare(study.plant(), board, settings, table, outputs, None, &()),
                    )
                },
                || DesignAnalysis::new(study, design.clone()),
            );
            charts.extend(charts::session(machine, &history));
            let [open, under] = budgets;
            closed = Some(Closed {
                poles: PoleAnalysis::new(study, table)?,
                design: analysis?,
                // The charts have the spectra.
                floor: FloorAnalysis::new(study, name, open, under).without_spectra(),
                simulation,
                phases: history.phases,
                table_format: shared::table::FORMAT_VERSION,
                table_checksum: table.checksum(),
            });
        }
        let gains = studies.iter().map(|l| &l.study);
        let gains = gains.filter(|study| study.design_model().feedback != FeedbackKind::Both);
        let control = Control {
            model_sha256: machine.digest.to_string(),
            feedback: kind.name(),
            frequency_hz: machine.target.frequency,
            damping: machine.target.damping,
            sample_rate: machine.board.sample_rate,
            settings: settings(machine),
            gains: gains.map(GainAnalysis::new).collect::<Result<_, _>>()?,
            zeros: ZeroAnalysis::new(machine)?,
            compliance: compliance.map(Compliance::without_spectra),
            closed,
            missing: own.design.as_ref().err().map(NoDesign::to_string),
            statements: machine.provenance.iter().map(Statement::new).collect(),
            warnings: warnings(study),
            not_shown: sigma.missing,
            own: own.clone(),
        };
        Ok(Self {
            machine: machine.name.clone(),
            files: files(machine),
            scene: Scene::new(machine),
            modes: ModeAnalysis::new(study),
            charts,
            drawings: charts::drawings(machine, &machine.actuators, study.model()),
            control: Some(control),
        })
    }

    /// The report on a machine without control: its parts and its modes.
    fn passive(machine: &Structure) -> Result<Self, MachineError> {
        Ok(Self {
            machine: machine.name.clone(),
            files: files(machine),
            scene: Scene::of_structure(machine),
            modes: ModeAnalysis::passive(machine)?,
            charts: Vec::new(),
            drawings: charts::drawings(machine, &[], &StructureModel::new(machine)?),
            control: None,
        })
    }

    /// All charts, then all drawings, each with its file name without extension.
    pub fn pictures(&self) -> Vec<(String, &Chart)> {
        let charts = self.charts.iter().map(|c| (c.id.clone(), c));
        let drawings = self.drawings.iter().enumerate();
        let drawings = drawings.map(|(i, c)| match i {
            0 => (c.id.clone(), c),
            _ => (format!("{}-{i}", c.id), c),
        });
        charts.chain(drawings).collect()
    }
}

fn files(machine: &Structure) -> Vec<SourceFile> {
    let files = machine.files().map(|(path, text)| SourceFile {
        path: path.display().to_string(),
        text: text.to_owned(),
    });
    files.collect()
}

/// All keys with their values, except those under `provenance`.
fn settings(machine: &Machine) -> Vec<Setting> {
    fn walk(prefix: &str, value: &toml::Value, settings: &mut Vec<Setting>) {
        match value {
            toml::Value::Table(table) => {
                for (key, value) in table {
                    let dot = if prefix.is_empty() { "" } else { "." };
                    walk(&format!("{prefix}{dot}{key}"), value, settings);
                }
            }
            value => settings.push(Setting {
                key: prefix.to_owned(),
                value: value.to_string(),
            }),
        }
    }
    let mut settings = Vec::new();
    // A checked machine's numbers are within those of TOML.
    for (key, value) in &machine.description().to_table().unwrap_or_default() {
        if key != "provenance" {
            walk(key, value, &mut settings);
        }
    }
    settings
}

/// The content of the page: the reports on one or more machines, and their comparison.
#[derive(Debug, Serialize)]
pub struct Review {
    /// Version of host-gen.
    version: &'static str,
    machines: Vec<Report>,
    /// The comparison; none with one machine.
    side_by_side: Option<SideBySide>,
}

/// A comparison of machines.
#[derive(Debug, Serialize)]
struct SideBySide {
    /// Names that tell the machines apart.
    names: Vec<String>,
    compared: MachineComparison,
    /// Settings that differ: the key, and the value in each machine, none if it does not
    /// have the key.
    differences: Vec<(String, Vec<Option<String>>)>,
    charts: Vec<Chart>,
}

impl Review {
    /// A review of `machines`, with a comparison if there are several.
    ///
    /// # Errors
    /// [`StudyError`] if a machine gives no valid model or an eigenvalue iteration does
    /// not converge.
    pub fn new(machines: Vec<Report>) -> Result<Self, StudyError> {
        let side_by_side = if machines.len() > 1 {
            Some(SideBySide::new(&machines)?)
        } else {
            None
        };
        Ok(Self {
            version: env!("CARGO_PKG_VERSION"),
            machines,
            side_by_side,
        })
    }

    /// A review of a machine without control: its parts and its modes.
    ///
    /// # Errors
    /// [`MachineError`] as [`StructureModel::new`].
    pub fn passive(machine: &Structure) -> Result<Self, MachineError> {
        Ok(Self {
            version: env!("CARGO_PKG_VERSION"),
            machines: vec![Report::passive(machine)?],
            side_by_side: None,
        })
    }

    /// All pictures, each with its file name without extension. With several machines,
    /// the names start with the name of the machine, or with `compared`.
    pub fn pictures(&self) -> Vec<(String, &Chart)> {
        let Some(both) = &self.side_by_side else {
            return self.machines.iter().flat_map(Report::pictures).collect();
        };
        let single = both.names.iter().zip(&self.machines);
        let single = single.flat_map(|(name, report)| {
            let pictures = report.pictures().into_iter();
            let name = name.replace([',', ' '], "-").replace("--", "-");
            pictures.map(move |(id, chart)| (format!("{name}-{id}"), chart))
        });
        let compared = both.charts.iter();
        let compared = compared.map(|chart| (format!("compared-{}", chart.id), chart));
        single.chain(compared).collect()
    }

    /// The review as JSON, for the page and for other programs, as `docs/json.md`
    /// describes it.
    pub fn json(&self) -> String {
        serde_json::to_string(self).expect("numbers and strings serialise")
    }
}

impl SideBySide {
    fn new(reports: &[Report]) -> Result<Self, StudyError> {
        // Each has control: there is no other way to a review of several.
        let controls: Vec<&Control> = reports.iter().flat_map(|report| &report.control).collect();
        // Machines of the same name are told apart by their feedback, or by their order.
        let feedback = |report: &Report| report.control.as_ref().map(|control| control.feedback);
        let name = |(i, report): (usize, &Report)| {
            let same = |other: &&Report| other.machine == report.machine;
            let alike = |other: &Report| feedback(other) == feedback(report);
            let others: Vec<_> = reports.iter().filter(same).collect();
            if others.len() < 2 {
                report.machine.clone()
            } else if others.iter().filter(|other| alike(other)).count() < 2 {
                format!(
                    "{}, {}",
                    report.machine,
                    feedback(report).unwrap_or_default()
                )
            } else {
                format!("{} {}", report.machine, i + 1)
            }
        };
        let names: Vec<String> = reports.iter().enumerate().map(name).collect();
        let charts: Vec<(String, &[Chart])> = names
            .iter()
            .zip(reports)
            .map(|(name, report)| (name.clone(), &report.charts[..]))
            .collect();
        // The value in each machine by key, in the order of the files.
        let mut values: IndexMap<&str, Vec<Option<String>>> = IndexMap::new();
        for (i, control) in controls.iter().enumerate() {
            for setting in &control.settings {
                let of_key = values.entry(&setting.key);
                of_key.or_insert_with(|| vec![None; controls.len()])[i] =
                    Some(setting.value.clone());
            }
        }
        Ok(Self {
            charts: laid_over(&charts),
            compared: MachineComparison::new(controls.iter().map(|control| &control.own))?,
            differences: values
                .into_iter()
                .filter(|(_, values)| values.iter().any(|value| value != &values[0]))
                .map(|(key, values)| (key.to_owned(), values))
                .collect(),
            names,
        })
    }
}
