//! Charts as data, for the page, for pictures and for CSV files.

use serde::Serialize;

/// A chart: axes, series and marks.
#[derive(Clone, Debug, Serialize)]
pub struct Chart {
    /// Identifier in file names and on the page: lower-case letters and hyphens.
    pub id: &'static str,
    /// Title above the chart.
    pub title: String,
    /// What it shows and how to read it.
    pub note: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// The curves and sets of points.
    pub series: Vec<Series>,
    /// Vertical lines, each with its x and the name of what starts there.
    pub marks: Vec<(f64, String)>,
}

impl Chart {
    /// A chart without marks; `x` and `y` are its axes.
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

/// An axis of a chart.
#[derive(Clone, Debug, Serialize)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// Linear or logarithmic scale.
    pub scale: Scale,
    /// Lowest and highest value shown at first; none to show all values.
    pub range: Option<[f64; 2]>,
    /// Names shown in place of the numbers 0, 1, 2 and so on; empty to show numbers.
    pub names: Vec<String>,
}

/// Scale of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// Linear.
    Linear,
    /// Logarithmic.
    Log,
    /// Linear, with units of the same length on both axes.
    Equal,
}

impl Axis {
    /// A linear axis that shows all values.
    pub fn linear(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            scale: Scale::Linear,
            range: None,
            names: Vec::new(),
        }
    }

    /// A logarithmic axis that shows all values.
    pub fn log(label: impl Into<String>) -> Self {
        Self {
            scale: Scale::Log,
            ..Self::linear(label)
        }
    }

    /// This axis, with the values from `low` to `high` shown at first.
    pub fn from_to(mut self, low: f64, high: f64) -> Self {
        self.range = Some([low, high]);
        self
    }
}

/// A curve or a set of points.
#[derive(Clone, Debug, Serialize)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// x of each point, rounded to six digits.
    pub x: Vec<f64>,
    /// y of each point, rounded to six digits; as many as `x`.
    pub y: Vec<f64>,
    /// Style of the line or the points.
    pub style: Style,
    /// Colour, by meaning.
    pub colour: Colour,
    /// Whether the series is shown at first.
    pub shown: bool,
    /// Whether charts that compare machines contain this series.
    pub main: bool,
    /// A text for each point; empty for no texts.
    pub labels: Vec<String>,
}

/// Style of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Style {
    /// A solid line through the points.
    Line,
    /// A dashed line through the points.
    Dashed,
    /// A thin, dotted line: a limit.
    Limit,
    /// Points without a line.
    Points,
}

/// Colours by meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// Without control.
    Open,
    /// Acceleration feedback, or the closed loop where only one is shown.
    Acceleration,
    /// Force feedback.
    Force,
    /// Both kinds of feedback.
    Both,
    /// A limit.
    Limit,
    /// Number n of a list; the eight colours repeat.
    Nth(usize),
}

impl Colour {
    /// Red, green and blue, 0 to 255; most are from the palette of Okabe and Ito, which
    /// colour-blind readers can tell apart.
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
    /// A solid line through `points`, shown at first; coordinates are rounded to six
    /// digits.
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

    /// This series in another style.
    pub fn styled(mut self, style: Style) -> Self {
        self.style = style;
        self
    }

    /// This series, also in charts that compare machines.
    pub fn main(mut self) -> Self {
        self.main = true;
        self
    }

    /// This series, shown at first only if `shown`.
    pub fn shown(mut self, shown: bool) -> Self {
        self.shown = shown;
        self
    }

    /// This series with a text for each point.
    pub fn labelled(mut self, labels: Vec<String>) -> Self {
        self.labels = labels;
        self
    }
}

/// Rounds to six digits: more are not visible, and they make the page larger.
fn six_digits(x: f64) -> f64 {
    format!("{x:.5e}").parse().unwrap_or(x)
}

/// Charts that compare machines, each given with its name: for every chart that all
/// machines have, one chart with the main series of all.
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
