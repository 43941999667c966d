//! What changed from a machine's table before to its table now, in figures.

use serde::{Deserialize, Serialize};
use shared::table::Paths;

use crate::closed_loop::SampledLoop;
use crate::closed_loop::margins::margins;
use crate::design::{Design, Study};
use crate::machine::FeedbackKind;
use crate::numeric::NumericError;
use crate::numeric::frequencies::pole_peaks;

/// The figures by which two tables are compared; kept from one table to the next.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figures {
    /// Name of the machine.
    pub(crate) machine: String,
    /// [`shared::table::ValidTable::checksum`] of the table.
    pub(crate) checksum: u32,
    /// Gains, margins and limits, in the order in which they are shown.
    figures: Vec<Figure>,
}

/// A figure of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Figure {
    /// What it is, with its unit.
    name: String,
    /// One value, or one for each mode or leg; `None` where it is infinite.
    values: Vec<Option<f64>>,
}

/// Result of `host-gen generate --changes`: the table against the one before.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Changes {
    /// The file of the table.
    pub(crate) table: String,
    pub(crate) now: Figures,
    /// The table before; `None` if this is the first one.
    pub(crate) before: Option<Figures>,
    /// The figures that changed in the digits shown.
    pub(crate) changed: Vec<Change>,
}

/// A figure that changed, as text.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Change {
    pub(crate) name: String,
    /// `None` if the table before has no such figure.
    pub(crate) before: Option<String>,
    /// `None` if the table now has no such figure.
    pub(crate) now: Option<String>,
}

impl Figures {
    /// The figures of the table in `design`, the design of `study`: gains, margins of the sampled
    /// loop, and limits of legs, AC coupling, test signals and supervisor. Each name has its unit.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub fn new(study: &Study, design: &Design) -> Result<Self, NumericError> {
        let machine = study.machine();
        let table = design.table.get();
        let model = study.design_model();
        let closed = SampledLoop::new(study.plant(), &design.table);
        let peaks = pole_peaks(&closed.poles()?);
        let margin = margins(&closed, model, &machine.target, &peaks).together;
        let [proportional, integral, sensed] = match model.feedback {
            FeedbackKind::Acceleration | FeedbackKind::Both => {
                ["K_a, N/(m/s²)", "K_v, N/(m/s)", "m/s²"]
            }
            FeedbackKind::Force => ["K_P", "K_I, 1/s", "N"],
        };
        let mut figures = Vec::new();
        let mut add = |name: &str, values: &[f64]| figures.push(Figure::new(name, values));
        add("suspension modes, Hz", &model.hertz());
        add(
            &format!("largest entry of {proportional}"),
            &[study.gains().proportional.amax()],
        );
        add(
            &format!("largest entry of {integral}"),
            &[study.gains().integral.amax()],
        );
        if let Paths::Modal(modal) = &table.law.paths {
            let gains = modal.channels.map(|channel| channel.proportional.into());
            add("proportional gain of each mode", &gains);
        }
        add("peak sensitivity", &[design.peak_sensitivity.value]);
        add("gain margin, all modes at once, factor", &[margin.gain]);
        add("phase margin, all modes at once, °", &[margin.phase_deg]);
        add("isolates from, Hz", &[design.isolation_from_hz]);
        for band in &design.bands {
            let name = format!("highest σ_max(G11), {}, dB", band.name);
            add(&name, &[band.sampled_db]);
        }
        add("sample rate, Hz", &[table.sample_rate.into()]);
        add("latch, s after the sample", &[table.latch.into()]);
        let limits = table.actuators.map(|drive| drive.limit.into());
        add("force limit of each leg, N", &limits);
        add(
            &format!("limit of the AC coupling, {sensed}"),
            &[table.ac_limit.into()],
        );
        let test = &table.self_test;
        add("force of the self-test, N", &[test.amplitude.into()]);
        add("force of the pilot, N", &[test.pilot.into()]);
        let supervision = &table.supervision;
        let seconds = |samples: u32| f64::from(samples) / f64::from(table.sample_rate);
        add(
            "clamped until a fault, s",
            &[seconds(supervision.saturated)],
        );
        add("silent until a fault, s", &[seconds(supervision.silence)]);
        add("smallest spike, codes", &supervision.spike.map(f64::from));
        Ok(Self {
            machine: machine.name.clone(),
            checksum: design.table.checksum(),
            figures,
        })
    }

    /// The figure of this name, as text.
    fn text(&self, name: &str) -> Option<String> {
        let figure = self.figures.iter().find(|figure| figure.name == name)?;
        Some(figure.text())
    }
}

impl Figure {
    fn new(name: &str, values: &[f64]) -> Self {
        let finite = |value: &f64| value.is_finite().then_some(*value);
        Self {
            name: name.to_owned(),
            values: values.iter().map(finite).collect(),
        }
    }

    /// The values with four digits; one if all are the same.
    fn text(&self) -> String {
        let mut words: Vec<String> = self.values.iter().map(|value| digits(*value)).collect();
        if words.iter().all(|word| *word == words[0]) {
            words.truncate(1);
        }
        words.join(" ")
    }
}

/// A value with four digits.
fn digits(value: Option<f64>) -> String {
    let Some(value) = value else {
        return "∞".to_owned();
    };
    let size = value.abs();
    if value == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e4).contains(&size) {
        let decimals = (3.0 - size.log10().floor()).max(0.0) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.3e}")
    }
}

impl Changes {
    /// What changed from `before`, if there was a table before, to `now`, which was written to the
    /// file `table`.
    pub fn new(table: String, before: Option<Figures>, now: Figures) -> Self {
        let mut changed = Vec::new();
        if let Some(before) = &before {
            let names = now.figures.iter().chain(&before.figures);
            let mut names: Vec<_> = names.map(|figure| &figure.name).collect();
            let mut seen = std::collections::HashSet::new();
            names.retain(|name| seen.insert(*name));
            changed.extend(names.into_iter().filter_map(|name| {
                let change = Change {
                    name: name.clone(),
                    before: before.text(name),
                    now: now.text(name),
                };
                (change.before != change.now).then_some(change)
            }));
        }
        Self {
            table,
            now,
            before,
            changed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Change, Changes, Figure, Figures};

    fn figures(checksum: u32, figures: &[(&str, &[f64])]) -> Figures {
        Figures {
            machine: "scanner".to_owned(),
            checksum,
            figures: figures
                .iter()
                .map(|(name, values)| Figure::new(name, values))
                .collect(),
        }
    }

    /// Only what differs in the digits shown is named: new, gone and moved figures, an infinite
    /// margin too. Kept as JSON, they read back.
    #[test]
    fn what_changed_is_named() {
        let before = figures(
            1,
            &[
                ("gain", &[1e5 / 3.0]),
                ("margin", &[f64::INFINITY]),
                ("modes", &[2.0, 2.0]),
                ("gone", &[0.0]),
            ],
        );
        let now = figures(
            0xabc,
            &[
                ("gain", &[1e5 / 3.0 + 1e-3]),
                ("margin", &[2.5]),
                ("modes", &[2.0, 2.5]),
                ("new", &[1e-5]),
            ],
        );
        let kept = serde_json::to_string(&before).unwrap();
        let kept: Figures = serde_json::from_str(&kept).unwrap();
        let changes = Changes::new("table.rs".to_owned(), Some(kept), now.clone());
        let text = |text: &str| Some(text.to_owned());
        let change = |name: &str, before, now| Change {
            name: name.to_owned(),
            before,
            now,
        };
        assert_eq!(
            changes.changed,
            [
                change("margin", text("∞"), text("2.500")),
                change("modes", text("2.000"), text("2.000 2.500")),
                change("new", None, text("1.000e-5")),
                change("gone", text("0"), None),
            ]
        );
        let shown = changes.to_string();
        assert!(
            shown.contains("00000abc, before 00000001") && shown.contains("2.000 → 2.000 2.500"),
            "{shown}"
        );
        let first = Changes::new("table.rs".to_owned(), None, now.clone());
        assert!(first.to_string().contains("first"), "{first}");
        let same = Changes::new("table.rs".to_owned(), Some(now.clone()), now);
        assert!(same.to_string().contains("as before"), "{same}");
    }
}
