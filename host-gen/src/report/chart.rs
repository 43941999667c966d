//! A chart: what it shows, for the page, for pictures and for tables of numbers.

use serde::Serialize;

/// A chart.
#[derive(Clone, Debug, Serialize)]
pub struct Chart {
    /// What it is called in file names and on the page; lower-case, hyphens.
    pub id: &'static str,
    /// Above it.
    pub title: String,
    /// What it shows and how to read it.
    pub note: String,
    /// Across.
    pub x: Axis,
    /// Up.
    pub y: Axis,
    /// What is drawn.
    pub series: Vec<Series>,
    /// Upright lines, each at an x, with a name: what begins there.
    pub marks: Vec<(f64, String)>,
}

impl Chart {
    /// Without marks.
    pub fn new(
        id: &'static str,
        title: impl Into<String>,
        note: impl Into<String>,
        [x, y]: [Axis; 2],
        series: Vec<Series>,
    ) -> Self {
        Self {
            id,
            title: title.into(),
            note: note.into(),
            x,
            y,
            series,
            marks: Vec::new(),
        }
    }
}

/// An axis.
#[derive(Clone, Debug, Serialize)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// How values lie on it.
    pub scale: Scale,
    /// What is shown at first; all of it if not given.
    pub range: Option<[f64; 2]>,
    /// Names of the values 0, 1, 2 and so on, in place of numbers.
    pub names: Vec<String>,
}

/// How values lie on an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By their logarithm.
    Log,
    /// Evenly, a unit as long as on the other axis.
    Equal,
}

impl Axis {
    /// Evenly.
    pub fn linear(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            scale: Scale::Linear,
            range: None,
            names: Vec::new(),
        }
    }

    /// By the logarithm.
    pub fn log(label: impl Into<String>) -> Self {
        Self {
            scale: Scale::Log,
            ..Self::linear(label)
        }
    }

    /// The same, from one value to another at first.
    pub fn from_to(mut self, low: f64, high: f64) -> Self {
        self.range = Some([low, high]);
        self
    }
}

/// Points that belong together.
#[derive(Clone, Debug, Serialize)]
pub struct Series {
    /// Name.
    pub name: String,
    /// Six digits of each.
    pub x: Vec<f64>,
    /// As many.
    pub y: Vec<f64>,
    /// How it is drawn.
    pub style: Style,
    /// Which of the page's colours.
    pub colour: Colour,
    /// Whether it is shown at first.
    pub shown: bool,
    /// Whether machines are laid over each other by this one.
    pub main: bool,
    /// What is said of each point; empty if nothing is.
    pub labels: Vec<String>,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Style {
    /// Straight between the points.
    Line,
    /// The same, dashed.
    Dashed,
    /// Thin and dotted: a limit.
    Limit,
    /// Each point by itself.
    Points,
}

/// Colours by meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// Without control.
    Open,
    /// Accelerations fed back, or the loop closed where only one is shown.
    Acceleration,
    /// Forces fed back.
    Force,
    /// Both.
    Both,
    /// A limit.
    Limit,
    /// The nth of many.
    Nth(usize),
}

impl Colour {
    /// Red, green, blue: those of Okabe and Ito, which colour-blind people tell
    /// apart.
    pub fn rgb(self) -> [u8; 3] {
        const MANY: [[u8; 3]; 8] = [
            [0, 114, 178],
            [213, 94, 0],
            [0, 158, 115],
            [204, 121, 167],
            [86, 180, 233],
            [230, 159, 0],
            [120, 94, 240],
            [90, 90, 90],
        ];
        match self {
            Self::Open => [120, 128, 136],
            Self::Acceleration => MANY[0],
            Self::Force => MANY[1],
            Self::Both => MANY[2],
            Self::Limit => [176, 58, 46],
            Self::Nth(n) => MANY[n % MANY.len()],
        }
    }
}

/// As `"0,114,178"`.
impl Serialize for Colour {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let [r, g, b] = self.rgb();
        serializer.collect_str(&format_args!("{r},{g},{b}"))
    }
}

impl Series {
    /// A line that is shown.
    pub fn line(
        name: impl Into<String>,
        colour: Colour,
        points: impl IntoIterator<Item = (f64, f64)>,
    ) -> Self {
        let (x, y) = points
            .into_iter()
            .map(|(x, y)| (six_digits(x), six_digits(y)))
            .unzip();
        Self {
            name: name.into(),
            x,
            y,
            style: Style::Line,
            colour,
            shown: true,
            main: false,
            labels: Vec::new(),
        }
    }

    /// The same in another style.
    pub fn styled(mut self, style: Style) -> Self {
        self.style = style;
        self
    }

    /// The same, which machines are laid over each other by.
    pub fn main(mut self) -> Self {
        self.main = true;
        self
    }

    /// The same, at first not shown unless `shown`.
    pub fn shown(mut self, shown: bool) -> Self {
        self.shown = shown;
        self
    }

    /// The same with something said of each point.
    pub fn labelled(mut self, labels: Vec<String>) -> Self {
        self.labels = labels;
        self
    }
}

/// More than a picture shows or a reader wants.
fn six_digits(x: f64) -> f64 {
    format!("{x:.5e}").parse().unwrap_or(x)
}

/// The charts of several machines, named, laid over each other: of every chart
/// that all have, the main series.
pub fn laid_over(machines: &[(String, &[Chart])]) -> Vec<Chart> {
    let Some(((_, first), others)) = machines.split_first() else {
        return Vec::new();
    };
    let charts = first.iter().filter_map(|chart| {
        let same = |charts: &&[Chart]| charts.iter().any(|other| other.id == chart.id);
        if !others.iter().all(|(_, charts)| same(charts)) {
            return None;
        }
        let mut series = Vec::new();
        for (n, (machine, charts)) in machines.iter().enumerate() {
            let own = charts.iter().filter(|other| other.id == chart.id);
            for main in own.flat_map(|own| own.series.iter().filter(|s| s.main)) {
                let mut main = main.clone();
                main.name = format!("{machine}: {}", main.name);
                main.colour = Colour::Nth(n);
                series.push(main);
            }
        }
        (!series.is_empty()).then(|| Chart {
            series,
            ..chart.clone()
        })
    });
    charts.collect()
}
