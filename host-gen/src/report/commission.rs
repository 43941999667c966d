//! The record of a commissioning, as one HTML file with its charts in it.

use super::chart::{Axis, Chart, Colour, Series, Style};
use super::charts::hertz;
use super::plots::{PlotError, svg};
use super::text::change_cells;
use crate::commission::Commissioning;

const STYLE: &str = "body{font:15px/1.5 sans-serif;color:#222;max-width:980px;margin:2em auto;padding:0 1em}\
table{border-collapse:collapse;margin:1em 0}td,th{padding:.3em .9em .3em 0;text-align:left;vertical-align:top;border-bottom:1px solid #ddd}\
td.number{text-align:right}.passed{color:#0a7a3c}.failed{color:#b03a2e;font-weight:bold}svg{max-width:100%;height:auto}\
@media print{h2{break-after:avoid}svg,tr{break-inside:avoid}}";

/// Text inside an element.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// A table with a head; numbers are aligned right from column `names` on.
fn table(head: &[&str], names: usize, rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let mut text = "<table><tr>".to_owned();
    for cell in head {
        text += &format!("<th>{cell}</th>");
    }
    text += "</tr>\n";
    for row in rows {
        text += "<tr>";
        for (i, cell) in row.iter().enumerate() {
            let class = if i < names { "" } else { " class=\"number\"" };
            text += &format!("<td{class}>{}</td>", escaped(cell));
        }
        text += "</tr>\n";
    }
    text + "</table>\n"
}

/// The charts of what the run has measured.
pub fn charts(run: &Commissioning) -> Vec<Chart> {
    let mut all = Vec::new();
    if let Some(fit) = &run.fit {
        let curve = |name: &str, colour, of: fn(&crate::identify::Misfit) -> f64| {
            let points = fit.lines.iter().map(|line| (line.hz, 100.0 * of(line)));
            Series::line(name, colour, points)
        };
        all.push(Chart::new(
            "fit",
            "Difference between the measured plant and the model",
            "Relative to the measured plant, the larger of the two kinds of sensors. Where the fitted model is no further away than the noise, nothing is left to be explained.",
            [hertz(), Axis::log("difference, %")],
            vec![
                curve("file", Colour::Open, |line| line.before),
                curve("fitted", Colour::Acceleration, |line| line.error),
                curve("noise", Colour::Limit, |line| line.expected).styled(Style::Limit),
            ],
        ));
    }
    if !run.closed.is_empty() {
        let series = run.closed.iter().enumerate().flat_map(|(n, closed)| {
            let name = format!("{:.0} % of the gain", 100.0 * closed.gain);
            let lines = closed.lines.iter();
            let designed = lines
                .clone()
                .map(|line| (line.hz, line.sensitivity.designed));
            let measured = lines.map(|line| (line.hz, line.sensitivity.measured));
            let colour = Colour::Nth(n);
            [
                Series::line(format!("{name}, design"), colour, designed).styled(Style::Dashed),
                Series::line(name, colour, measured),
            ]
        });
        all.push(Chart::new(
            "sensitivity",
            "Sensitivity at the legs: σ_max(S)",
            "Measured with the loop closed, and that of the design. Where it is low, the loop undoes most of the test signal, and floor and noise are most of what was measured.",
            [hertz(), Axis::log("σ_max(S)")],
            series.collect(),
        ));
    }
    all
}

/// The page.
///
/// # Errors
/// If a chart cannot be drawn.
pub fn page(run: &Commissioning) -> Result<String, PlotError> {
    let title = format!("Commissioning of {}", escaped(&run.machine));
    let mut text = format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\n<title>{title}</title>\n<style>{STYLE}</style>\n<h1>{title}</h1>\n<p>Board at {}.</p>\n<h2>Steps</h2>\n<table><tr><th>step</th><th>must hold</th><th>found</th><th></th></tr>\n",
        escaped(&run.board)
    );
    for gate in &run.gates {
        let outcome = if gate.passed { "passed" } else { "failed" };
        let [step, criterion, found] =
            [&gate.step, &gate.criterion, &gate.found].map(|x| escaped(x));
        text += &format!(
            "<tr><td>{step}</td><td>{criterion}</td><td>{found}</td><td class=\"{outcome}\">{outcome}</td></tr>\n"
        );
    }
    text += "</table>\n";
    if !run.resonances.is_empty() {
        text += "<h2>Measured resonances</h2>\n";
        let row = |resonance: &crate::board::measure::Resonance| {
            vec![
                format!("{:.3}", resonance.hz),
                format!("{:.2}", 100.0 * resonance.damping),
            ]
        };
        text += &table(&["Hz", "damping, %"], 0, run.resonances.iter().map(row));
    }
    if let Some(fit) = &run.fit {
        text += "<h2>Changes of the file's values</h2>\n<p>Those that the measurement determines, with half their intervals of 95 %.</p>\n";
        let rows = fit.estimates.iter().filter(|estimate| estimate.determined);
        text += &table(&["", "change", "±", ""], 1, rows.map(change_cells));
    }
    for chart in charts(run) {
        let (heading, note) = (escaped(&chart.title), escaped(&chart.note));
        text += &format!("<h2>{heading}</h2>\n{}\n<p>{note}</p>\n", svg(&chart)?);
    }
    if let Some(acceptance) = &run.acceptance {
        text += "<h2>On its floor</h2>\n<p>Rms of the leg forces with the loop closed, about the mean of each quarter of a second.</p>\n";
        let row = |leg: &crate::commission::LegForce| {
            vec![
                leg.name.clone(),
                format!("{:.4}", leg.measured),
                format!("{:.4}", leg.designed),
            ]
        };
        let head = ["leg", "measured, N", "by design on the file's floor, N"];
        text += &table(&head, 1, acceptance.legs.iter().map(row));
        text += "<p>Rms of the sensors.</p>\n";
        let level = |db: Option<f64>| db.map_or("-".to_owned(), |db| format!("{db:.1}"));
        let row = |sensor: &crate::commission::SensorLevel| {
            vec![
                sensor.name.clone(),
                level(sensor.open),
                level(sensor.closed),
            ]
        };
        let head = ["sensor", "loop open, dB of full scale", "closed"];
        text += &table(&head, 1, acceptance.sensors.iter().map(row));
    }
    text += "</html>\n";
    Ok(text)
}
