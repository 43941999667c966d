//! Charts as data, for the page, for pictures and for CSV files.

use serde::Serialize;

/// A chart: axes, series and marks.
#[derive(Clone, Debug, Serialize)]
pub struct Chart {
    /// Identifier in file names and on the page: ASCII letters, digits, hyphens and underscores.
    pub id: String,
    /// Title above the chart.
    pub title: String,
    /// What it shows and how to read it.
    pub note: String,
    /// What the styles of its lines mean; empty if the names of the series say it.
    pub styles: String,
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
        id: impl Into<String>,
        title: impl Into<String>,
        note: impl Into<String>,
        [x, y]: [Axis; 2],
        series: Vec<Series>,
    ) -> Self {
        Self {
            id: id.into(),
            title: title.into(),
            note: note.into(),
            styles: String::new(),
            x,
            y,
            series,
            marks: Vec::new(),
        }
    }
}

/// What the lines of charts that compare machines mean.
const COMPARED: &str = "Each machine has its colour. Dashed: without control. Solid: with control.";

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

/// Groups of series, by index, that one could not tell apart in a chart with axes `x` and `y`: each
/// point of one lies on the line of the other. Series are in the order of the first of each group.
pub fn coinciding(series: &[Series], [x, y]: [&Axis; 2]) -> Vec<Vec<usize>> {
    let [xs, ys] = [
        unit_places(x, series.iter().map(|s| &s.x[..])),
        unit_places(y, series.iter().map(|s| &s.y[..])),
    ];
    let lines: Vec<Vec<[f64; 2]>> = xs
        .into_iter()
        .zip(ys)
        .map(|(xs, ys)| xs.into_iter().zip(ys).map(|(x, y)| [x, y]).collect())
        .collect();
    let same = |a: usize, b: usize| lies_on(&lines[a], &lines[b]) && lies_on(&lines[b], &lines[a]);
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for i in 0..series.len() {
        match groups.iter_mut().find(|group| same(group[0], i)) {
            Some(group) => group.push(i),
            None => groups.push(vec![i]),
        }
    }
    groups
}

/// Where values are on an axis, 0 at its lower end and 1 at its upper one; what is outside is not a
/// number.
fn unit_places<'a>(axis: &Axis, values: impl Iterator<Item = &'a [f64]>) -> Vec<Vec<f64>> {
    let place = |x: &f64| match axis.scale {
        Scale::Log => x.log10(),
        Scale::Linear | Scale::Equal => *x,
    };
    let mut lists: Vec<Vec<f64>> = values
        .map(|list| list.iter().map(place).collect())
        .collect();
    let [low, high] = axis.range.map_or_else(
        || {
            let all = lists.iter().flatten().filter(|x| x.is_finite());
            all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
                [low.min(*x), high.max(*x)]
            })
        },
        |range| range.map(|x| place(&x)),
    );
    for x in lists.iter_mut().flatten() {
        let part = (*x - low) / (high - low);
        *x = if (0.0..=1.0).contains(&part) {
            part
        } else {
            f64::NAN
        };
    }
    lists
}

/// Distance of two lines that are one on a screen, in parts of an axis: a line is two pixels wide,
/// a plot some hundred.
const ONE_LINE: f64 = 0.003;

/// Whether each point of `one` that is within the axes lies on the line through `other`.
fn lies_on(one: &[[f64; 2]], other: &[[f64; 2]]) -> bool {
    let near = |[x, y]: [f64; 2]| {
        other.windows(2).any(|ends| {
            let [[ax, ay], [bx, by]] = [ends[0], ends[1]];
            let (along_x, along_y) = (bx - ax, by - ay);
            let length = along_x * along_x + along_y * along_y;
            let part = if length > 0.0 {
                (((x - ax) * along_x + (y - ay) * along_y) / length).clamp(0.0, 1.0)
            } else {
                0.0
            };
            (ax + part * along_x - x).hypot(ay + part * along_y - y) < ONE_LINE
        })
    };
    let seen = one.iter().filter(|[x, y]| x.is_finite() && y.is_finite());
    seen.copied().all(near)
}

/// Charts that compare machines, each given with its name: for every chart that all
/// machines have, one chart with the main series of all. Each machine has its colour; lines without
/// control are dashed. Where rows have names, each machine has the rows that its main series are in.
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
        let mut rows: Vec<String> = Vec::new();
        for (n, (machine, charts)) in machines.iter().enumerate() {
            for own in charts.iter().filter(|other| other.id == chart.id) {
                for main in own.series.iter().filter(|s| s.main) {
                    let mut main = main.clone();
                    main.name = format!("{machine}: {}", main.name);
                    // The colour tells the machine, so the line tells what is without control.
                    if main.colour == Colour::Open && main.style == Style::Line {
                        main.style = Style::Dashed;
                    }
                    main.colour = Colour::Nth(n);
                    for y in &mut main.y {
                        if let Some(name) = own.y.names.get(*y as usize) {
                            let name = format!("{machine}: {name}");
                            let row = rows.iter().position(|row| *row == name);
                            *y = row.unwrap_or(rows.len()) as f64;
                            if row.is_none() {
                                rows.push(name);
                            }
                        }
                    }
                    series.push(main);
                }
            }
        }
        let mut y = chart.y.clone();
        if !rows.is_empty() {
            y = y.from_to(-0.5, rows.len() as f64 - 0.5);
        }
        let lines = series.iter().any(|s| s.style == Style::Dashed);
        let styles = if lines { COMPARED } else { "" };
        (!series.is_empty()).then(|| Chart {
            series,
            styles: styles.to_owned(),
            y: Axis { names: rows, ..y },
            ..chart.clone()
        })
    });
    charts.collect()
}
