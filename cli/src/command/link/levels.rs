//! `host-gen link levels`.

use std::fmt::{self, Display, Formatter};
use std::io::Write as _;

use clap::Args;
use host_gen::board::link::Client;
use serde::Serialize;
use shared::LEGS;
use shared::levels::{Level, Levels};

use crate::arguments::Format;
use crate::failure::Failure;
use crate::print;

#[derive(Args)]
pub struct LevelsArguments {
    /// Go on with every new window, until the command is stopped.
    #[arg(long)]
    watch: bool,
}

pub fn levels(
    client: &mut Client,
    arguments: &LevelsArguments,
    format: Format,
) -> Result<(), Failure> {
    let mut levels = client.levels()?;
    loop {
        let text = print::rendered(format, &LevelsView::from(levels));
        let mut out = anstream::stdout();
        // A reader may wait for it, and may have had enough.
        let shown = out.write_all(text.as_bytes()).and_then(|()| out.flush());
        if shown.is_err() || !arguments.watch {
            return print::written(shown);
        }
        levels = client.levels_after(levels.window)?;
    }
}

/// [`Level`] in decibels; null without a signal.
#[derive(Serialize)]
struct LevelView {
    rms_db: Option<f32>,
    peak_db: Option<f32>,
}

impl From<Level> for LevelView {
    fn from(level: Level) -> Self {
        Self {
            rms_db: level.rms.decibels(),
            peak_db: level.peak.decibels(),
        }
    }
}

#[derive(Serialize)]
struct LevelsView {
    window: u32,
    sensors: [LevelView; LEGS],
    forces: [LevelView; LEGS],
    legs: [LevelView; LEGS],
    limit_percent: u8,
    load_percent: u8,
}

impl From<Levels> for LevelsView {
    fn from(levels: Levels) -> Self {
        let Levels {
            window,
            sensors,
            forces,
            legs,
            limit,
            load,
        } = levels;
        let [sensors, forces, legs] = [sensors, forces, legs].map(|kind| kind.map(Into::into));
        Self {
            window,
            sensors,
            forces,
            legs,
            limit_percent: limit,
            load_percent: load,
        }
    }
}

impl Display for LevelsView {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if self.window == 0 {
            return writeln!(f, "no levels yet: the first window has not ended");
        }
        let kinds = [
            ("sensors", &self.sensors),
            ("force sensors", &self.forces),
            ("legs", &self.legs),
        ];
        let seen = |level: &LevelView| level.peak_db.is_some();
        let kinds = kinds.map(|(name, levels)| levels.iter().any(seen).then_some((name, levels)));
        writeln!(f, "window {}, dB of full scale", self.window)?;
        write!(f, "   ")?;
        for (name, _) in kinds.into_iter().flatten() {
            write!(f, "{name:>17}")?;
        }
        write!(f, "\n   ")?;
        for _ in kinds.into_iter().flatten() {
            write!(f, "{:>9}{:>8}", "rms", "peak")?;
        }
        writeln!(f)?;
        for i in 0..LEGS {
            write!(f, "  {}", i + 1)?;
            for (_, levels) in kinds.into_iter().flatten() {
                let number = |x: Option<f32>| x.map_or("-".to_owned(), |x| format!("{x:.1}"));
                let LevelView { rms_db, peak_db } = &levels[i];
                write!(f, "{:>9}{:>8}", number(*rms_db), number(*peak_db))?;
            }
            writeln!(f)?;
        }
        write!(
            f,
            "  largest leg force: {} % of its limit",
            self.limit_percent
        )?;
        match self.load_percent {
            0 => writeln!(f, "; processor's load: not measured"),
            load => writeln!(f, "; processor's load: {load} %"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half decibels below full scale, as on the link.
    fn levels(forces: [[u8; 2]; LEGS]) -> Levels {
        let level = |[rms, peak]: [u8; 2]| serde_json::json!({ "rms": rms, "peak": peak });
        let sensors = [125, 126, 127, 128, 129, 255].map(|rms| level([rms, 100]));
        let legs = [[0, 0], [255, 254], [255, 255], [21, 12], [6, 0], [7, 1]].map(level);
        let value = serde_json::json!({
            "window": 7,
            "sensors": sensors,
            "forces": forces.map(level),
            "legs": legs,
            "limit": 52,
            "load": 38,
        });
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn text() {
        let view = LevelsView::from(levels([[255; 2]; LEGS]));
        let expected = "\
window 7, dB of full scale
             sensors             legs
         rms    peak      rms    peak
  1    -62.5   -50.0      0.0     0.0
  2    -63.0   -50.0        -  -127.0
  3    -63.5   -50.0        -       -
  4    -64.0   -50.0    -10.5    -6.0
  5    -64.5   -50.0     -3.0     0.0
  6        -   -50.0     -3.5    -0.5
  largest leg force: 52 % of its limit; processor's load: 38 %
";
        assert_eq!(view.to_string(), expected);
        let both = LevelsView::from(levels([[40, 30]; LEGS])).to_string();
        let row = "  1    -62.5   -50.0    -20.0   -15.0      0.0     0.0\n";
        assert!(both.contains(row), "{both}");
    }

    #[test]
    fn json() {
        let view = serde_json::to_value(LevelsView::from(levels([[255; 2]; LEGS]))).unwrap();
        assert_eq!(view["sensors"][0]["rms_db"], -62.5);
        assert!(view["legs"][1]["rms_db"].is_null());
        assert_eq!(
            (&view["limit_percent"], &view["load_percent"]),
            (&52.into(), &38.into())
        );
    }
}
