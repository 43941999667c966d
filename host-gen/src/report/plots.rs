//! Charts as SVG, PNG and CSV.

use core::ops::Range;

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};

use super::chart::{Axis, Chart, Scale, Series, Style};

const WIDTH: u32 = 960;
const HEIGHT: u32 = 560;

/// Width of the legend on the right.
const LEGEND: u32 = 230;

/// Pixels of a PNG for each pixel of the SVG: print quality at a width of 160 mm.
const ZOOM: f32 = 2.0;

const FONT: &[u8] = include_bytes!("font/DejaVuSans.ttf");
const FAMILY: &str = "DejaVu Sans";

/// The error of a chart that cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[error("the chart {chart} cannot be drawn: {reason}")]
pub struct PlotError {
    chart: String,
    reason: String,
}

/// An axis with its range and ticks; on a logarithmic axis, these are logarithms.
struct Drawn<'a> {
    axis: &'a Axis,
    low: f64,
    high: f64,
    ticks: Vec<f64>,
    /// Whether ticks are written as decimals, not with powers of ten.
    decimal: bool,
}

impl<'a> Drawn<'a> {
    fn new(axis: &'a Axis, values: impl Iterator<Item = f64>) -> Self {
        let place = |x: f64| place(axis.scale, x);
        let (mut low, mut high) = match axis.range {
            Some([low, high]) => (place(low), place(high)),
            None => {
                let seen = values.map(place).filter(|x| x.is_finite());
                seen.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                    (low.min(x), high.max(x))
                })
            }
        };
        if !(low.is_finite() && high.is_finite()) {
            (low, high) = (0.0, 1.0);
        }
        if high - low < 1e-9 * high.abs().max(1e-30) {
            (low, high) = (low - 0.5, high + 0.5);
        }
        if axis.range.is_none() && axis.scale != Scale::Log {
            let margin = 0.04 * (high - low);
            (low, high) = (low - margin, high + margin);
        }
        Self {
            axis,
            low,
            high,
            ticks: Vec::new(),
            decimal: true,
        }
    }

    /// Widens the range to at least `length`, so that units are as long as on the other
    /// axis.
    fn widen(&mut self, length: f64) {
        let more = 0.5 * (length - (self.high - self.low)).max(0.0);
        (self.low, self.high) = (self.low - more, self.high + more);
    }

    fn set_ticks(&mut self) {
        self.ticks = if !self.axis.names.is_empty() {
            (0..self.axis.names.len()).map(|i| i as f64).collect()
        } else if self.axis.scale == Scale::Log {
            self.decades()
        } else {
            self.even()
        };
        // One notation for all of them.
        let mut values = self.ticks.iter().map(|at| self.value(*at).abs());
        self.decimal = values.all(|x| x == 0.0 || (1e-4..1e5).contains(&x));
    }

    /// Powers of ten, and 2 and 5 times these where there are few.
    fn decades(&self) -> Vec<f64> {
        let decades = self.high - self.low;
        let parts: &[f64] = if decades < 3.5 {
            &[1.0, 2.0, 5.0]
        } else {
            &[1.0]
        };
        let exponents = self.low.floor() as i32..=self.high.ceil() as i32;
        let every = (decades / 8.0).ceil().max(1.0) as i32;
        exponents
            .filter(|exponent| exponent % every == 0)
            .flat_map(|exponent| {
                parts
                    .iter()
                    .map(move |part| f64::from(exponent) + part.log10())
            })
            .filter(|x| (self.low - 1e-9..=self.high + 1e-9).contains(x))
            .collect()
    }

    /// About seven, 1, 2 or 5 times a power of ten apart.
    fn even(&self) -> Vec<f64> {
        let rough = (self.high - self.low) / 7.0;
        let unit = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .into_iter()
            .map(|part| part * unit)
            .find(|step| *step >= rough)
            .unwrap_or(rough);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }

    /// The value at a tick.
    fn value(&self, at: f64) -> f64 {
        let value = match self.axis.scale {
            Scale::Log => 10f64.powf(at),
            _ => at,
        };
        // 0.1 + 0.2 is a tick at 0.3.
        format!("{value:.6e}").parse().unwrap_or(value)
    }

    fn label(&self, at: f64) -> String {
        if let Some(name) = self.axis.names.get(at.round() as usize) {
            return name.clone();
        }
        let value = self.value(at);
        if value != 0.0 && !self.decimal {
            format!("{value:e}")
        } else {
            format!("{value}")
        }
    }

    fn coordinate(&self) -> Coordinate {
        Coordinate {
            range: self.low..self.high,
            ticks: self.ticks.clone(),
        }
    }

    fn holds(&self, x: f64) -> bool {
        let slack = 1e-9 * (self.high - self.low);
        x >= self.low - slack && x <= self.high + slack
    }
}

/// An axis for the plotting library.
struct Coordinate {
    range: Range<f64>,
    ticks: Vec<f64>,
}

impl Ranged for Coordinate {
    type ValueType = f64;
    type FormatOption = DefaultFormatting;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let part = (value - self.range.start) / (self.range.end - self.range.start);
        from + (f64::from(to - from) * part).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

fn place(scale: Scale, x: f64) -> f64 {
    match scale {
        Scale::Log => x.log10(),
        _ => x,
    }
}

fn colour(series: &Series) -> RGBColor {
    let [r, g, b] = series.colour.rgb();
    RGBColor(r, g, b)
}

/// `chart` as SVG.
///
/// # Errors
/// [`PlotError`] if the plotting library fails.
pub fn svg(chart: &Chart) -> Result<String, PlotError> {
    let mut text = String::new();
    draw(chart, &mut text).map_err(|reason| PlotError {
        chart: chart.id.clone(),
        reason: reason.to_string(),
    })?;
    Ok(text)
}

fn draw(chart: &Chart, text: &mut String) -> Result<(), Box<dyn std::error::Error>> {
    let shown: Vec<&Series> = chart.series.iter().filter(|s| s.shown).collect();
    // The name of a limit is drawn at its end.
    let named = |s: &Series| s.style == Style::Limit && chart.x.scale != Scale::Equal;
    let legend = chart.y.names.is_empty() && shown.iter().filter(|s| !named(s)).count() > 1;
    let root = SVGBackend::with_string(text, (WIDTH, HEIGHT)).into_drawing_area();
    root.fill(&WHITE)?;
    let side = if legend { LEGEND } else { 20 };
    let (left, right) = root.split_horizontally(WIDTH - side);

    let mut x = Drawn::new(&chart.x, shown.iter().flat_map(|s| s.x.iter().copied()));
    let mut y = Drawn::new(&chart.y, shown.iter().flat_map(|s| s.y.iter().copied()));
    let names = chart.y.names.iter().map(|name| name.chars().count()).max();
    let label_width = names.map_or(70, |longest| 8 * longest as u32 + 20);
    if chart.x.scale == Scale::Equal {
        let plot = f64::from(WIDTH - side - label_width - 30) / f64::from(HEIGHT - 110);
        let (width, height) = (x.high - x.low, y.high - y.low);
        x.widen(height * plot);
        y.widen(width / plot);
    }
    x.set_ticks();
    y.set_ticks();

    let mut context = ChartBuilder::on(&left)
        .caption(&chart.title, (FAMILY, 19))
        .margin(12)
        .x_label_area_size(52)
        .y_label_area_size(label_width)
        .build_cartesian_2d(x.coordinate(), y.coordinate())?;
    context
        .configure_mesh()
        .x_desc(&chart.x.label)
        .y_desc(&chart.y.label)
        .x_labels(100)
        .y_labels(100)
        .label_style((FAMILY, 14))
        .axis_desc_style((FAMILY, 15))
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 228, 231))
        .x_label_formatter(&|at| x.label(*at))
        .y_label_formatter(&|at| y.label(*at))
        .draw()?;
    for series in &shown {
        let colour = colour(series);
        let points = series.x.iter().zip(&series.y).map(|(a, b)| {
            let point = (place(chart.x.scale, *a), place(chart.y.scale, *b));
            (x.holds(point.0) && y.holds(point.1)).then_some(point)
        });
        let points: Vec<_> = points.collect();
        // A line is interrupted outside the axes and at values that are not numbers.
        let pieces = points
            .split(Option::is_none)
            .map(|piece| piece.iter().flatten().copied());
        for piece in pieces {
            match series.style {
                Style::Line => {
                    context.draw_series(LineSeries::new(piece, colour.stroke_width(2)))?;
                }
                Style::Limit => {
                    if let Some(end) = piece.clone().last().filter(|_| named(series)) {
                        let letters = series.name.chars().count() as i32;
                        let style = (FAMILY, 12).into_font().color(&colour);
                        let above = EmptyElement::at(end)
                            + Text::new(series.name.clone(), (-7 * letters, -15), style);
                        context.draw_series([above])?;
                    }
                    context.draw_series(LineSeries::new(piece, colour.mix(0.6)))?;
                }
                Style::Dashed => {
                    let dashes = DashedLineSeries::new(piece, 7, 5, colour.stroke_width(2));
                    context.draw_series(dashes)?;
                }
                Style::Points => {
                    context.draw_series(piece.map(|at| Circle::new(at, 5, colour.filled())))?;
                }
            }
        }
    }
    for (at, name) in &chart.marks {
        let at = place(chart.x.scale, *at);
        let grey = RGBColor(185, 194, 201);
        context.draw_series(LineSeries::new([(at, y.low), (at, y.high)], grey))?;
        let style = (FAMILY, 12).into_font().transform(FontTransform::Rotate90);
        context.draw_series([Text::new(name.clone(), (at, y.high), style)])?;
    }
    if legend {
        let listed = shown.iter().filter(|s| !named(s));
        for (i, series) in listed.enumerate() {
            let height = 64 + 22 * i as i32;
            let style = match series.style {
                Style::Limit => colour(series).mix(0.6).stroke_width(1),
                _ => colour(series).stroke_width(3),
            };
            let strokes: &[(i32, i32)] = match series.style {
                Style::Dashed => &[(4, 13), (18, 27)],
                _ => &[(4, 27)],
            };
            for &(from, to) in strokes {
                right.draw(&PathElement::new(vec![(from, height), (to, height)], style))?;
            }
            right.draw(&Text::new(
                series.name.clone(),
                (34, height - 8),
                (FAMILY, 14),
            ))?;
        }
    }
    root.present()?;
    Ok(())
}

/// The picture of `chart` as PNG, from its `svg`; twice as many pixels in each direction.
///
/// # Errors
/// [`PlotError`] if `svg` is not valid SVG.
pub fn png(chart: &Chart, svg: &str) -> Result<Vec<u8>, PlotError> {
    let failed = |reason: String| PlotError {
        chart: chart.id.clone(),
        reason,
    };
    let mut options = Options::default();
    options.fontdb_mut().load_font_data(FONT.to_vec());
    let tree = Tree::from_str(svg, &options).map_err(|error| failed(error.to_string()))?;
    let size = tree.size().to_int_size();
    let pixels = |length: u32| (length as f32 * ZOOM) as u32;
    let mut pixmap = Pixmap::new(pixels(size.width()), pixels(size.height()))
        .ok_or_else(|| failed("the picture has no size".to_owned()))?;
    resvg::render(
        &tree,
        Transform::from_scale(ZOOM, ZOOM),
        &mut pixmap.as_mut(),
    );
    pixmap
        .encode_png()
        .map_err(|error| failed(error.to_string()))
}

/// The numbers of a chart as CSV, hidden series included. Columns: series, x, y.
pub fn csv(chart: &Chart) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let up = match &chart.y.label[..] {
        "" => "row",
        label => label,
    };
    let mut write = |record: [&str; 3]| writer.write_record(record);
    let mut outcome = write(["series", &chart.x.label, up]);
    for series in &chart.series {
        for (x, y) in series.x.iter().zip(&series.y) {
            outcome = outcome.and_then(|()| write([&series.name, &x.to_string(), &y.to_string()]));
        }
    }
    outcome.expect("a vector takes what is written to it");
    let bytes = writer
        .into_inner()
        .expect("a vector takes what is written to it");
    String::from_utf8(bytes).expect("strings were written")
}
