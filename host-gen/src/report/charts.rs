//! The charts of one machine.

use nalgebra::{Complex, DMatrix, DVector, Vector3};
use rayon::prelude::*;
use shared::LEGS;

use super::SIGMA;
use super::chart::{Axis, Chart, Colour, Scale, Series, Style, coinciding};
use crate::analysis::compliance::{Compliance, LoadCompliance, OutputCompliance};
use crate::analysis::sigma::{LawKind, SigmaAnalysis};
use crate::closed_loop::budget::{NoiseBudget, SOURCES, Spectra};
use crate::closed_loop::isolation::isolation_band;
use crate::closed_loop::{SampledLoop, close_ideal, ideal_poles, stable};
use crate::control::LinearLaw;
use crate::design::{DesignedStudy, Study};
use crate::files::identifier::identifiers;
use crate::floor::criterion::{Criterion, third_centres};
use crate::machine::{Carrier, FeedbackKind, Machine, Structure};
use crate::model::energy::{Kind, energies};
use crate::model::structure::StructureModel;
use crate::numeric::NumericError;
use crate::numeric::frequencies::{grid, pole_peaks};
use crate::numeric::singular::largest_singular_value;
use crate::numeric::six::ComplexMatrix6;
use crate::plant::Gain;
use crate::simulate::session::History;

fn db(x: f64) -> f64 {
    20.0 * x.log10()
}

pub(super) fn hertz() -> Axis {
    Axis::log("frequency, Hz")
}

fn colour(feedback: FeedbackKind) -> Colour {
    match feedback {
        FeedbackKind::Acceleration => Colour::Acceleration,
        FeedbackKind::Force => Colour::Force,
        FeedbackKind::Both => Colour::Both,
    }
}

/// A horizontal line.
fn limit(name: impl Into<String>, from: f64, to: f64, y: f64) -> Series {
    Series::line(name, Colour::Limit, [(from, y), (to, y)]).styled(Style::Limit)
}

/// σ_max(G11), Fig. 5. `own` is the feedback of the machine's file.
pub fn sigma(sigma: &SigmaAnalysis, own: FeedbackKind) -> Chart {
    let series = sigma.curves.iter().map(|curve| {
        let points = sigma.hz.iter().zip(&curve.sigma_max);
        let points = points.map(|(hz, sigma)| (*hz, db(*sigma)));
        let name = &curve.name;
        match curve.of {
            None => Series::line(name, Colour::Open, points).main(),
            Some((kind, law)) => {
                let series = Series::line(name, colour(kind), points);
                match law {
                    LawKind::Ideal => series.styled(Style::Dashed),
                    LawKind::Sampled if kind == own => series.main(),
                    LawKind::Sampled => series,
                }
            }
        }
    });
    let chart = Chart::new(
        "sigma",
        "From the floor to the performance outputs: σ_max(G11)",
        "The worst-case gain from the floor to the performance outputs at each frequency (Fig. 5 of the paper). Lower is better.",
        [hertz(), Axis::linear("σ_max(G11), dB")],
        series.collect(),
    );
    Chart {
        styles: "Dashed: the ideal law, without delay or sampling. Solid: the sampled, delayed law, as on the board.".to_owned(),
        ..chart
    }
}

/// Transmissibility from the floor to the machine as a whole.
///
/// # Errors
/// Where an eigenvalue iteration does not converge.
pub fn isolation(own: &DesignedStudy) -> Result<Chart, NumericError> {
    let study = &own.study;
    let plant = &study.plant().plant;
    let rigid = plant.rigid_floor.map(Complex::from);
    let whole = plant.whole();
    let [low, high] = isolation_band(study.design_model(), study.machine().target.frequency);
    let ideal = ideal_poles(&plant.state_space, study.gains())?;
    let closed = own
        .design
        .as_ref()
        .ok()
        .map(|design| SampledLoop::new(study.plant(), &design.table));
    let mut peaks = [plant.peaks(), pole_peaks(&ideal)].concat();
    if let Some(closed) = &closed {
        peaks.extend(pole_peaks(&closed.poles()?));
    }
    let points = grid(low, high, 300, &peaks);
    let curve = |gain: &(dyn Fn(f64) -> Gain + Sync)| -> Vec<(f64, f64)> {
        let points = points.par_iter();
        points
            .map(|&hz| (hz, db(largest_singular_value(&gain(hz)))))
            .collect()
    };
    let open = curve(&|hz| plant.open(hz, whole.clone()) * rigid);
    let mut series = vec![Series::line("open", Colour::Open, open).main()];
    let colour = colour(study.design_model().feedback);
    if stable(&ideal) {
        let ideal = curve(&|hz| close_ideal(plant, study.gains(), hz, whole.clone()) * rigid);
        series.push(Series::line("ideal", colour, ideal).styled(Style::Dashed));
    }
    if let Some(closed) = &closed {
        let sampled = curve(&|hz| closed.transmissibility(hz));
        series.push(Series::line("sampled", colour, sampled).main());
    }
    series.push(limit("1/√2: isolates below", low, high, -db(2.0) / 2.0));
    Ok(Chart::new(
        "isolation",
        "How the machine follows the floor: transmissibility",
        "All bodies as one, in the worst direction. At 0 dB the machine moves with the floor; below −3 dB it is isolated. A hard mount without control follows the floor up to its suspension modes and amplifies there.",
        [hertz(), Axis::linear("transmissibility, dB")],
        series,
    ))
}

/// How far each load displaces its own node and the performance outputs, one chart for each load.
pub fn compliance(Compliance { hz, loads }: &Compliance) -> Vec<Chart> {
    let ids = identifiers(loads.iter().map(|load| ("compliance", &load.name[..])));
    let one = |(load, id): (&LoadCompliance, String)| {
        let performance = &load.outputs[..load.outputs.len() - loads.len()];
        let size = |output: &OutputCompliance| output.open_highest.magnitude;
        let largest = (0..performance.len())
            .max_by(|&a, &b| size(&performance[a]).total_cmp(&size(&performance[b])));
        let outputs = [load.own()].into_iter().chain(performance);
        let series = outputs.enumerate().flat_map(|(n, output)| {
            let own = n == 0;
            let shown = own || largest.is_some_and(|largest| n == largest + 1);
            let line = |side: &str, magnitudes: &[f64]| {
                let points = hz.iter().copied().zip(magnitudes.iter().copied());
                // Below, it is as at rest.
                let points = points.filter(|(hz, _)| *hz >= SIGMA.0);
                let name = format!("{}, {side}", output.name);
                let line = Series::line(name, Colour::Nth(n), points).shown(shown);
                if own { line.main() } else { line }
            };
            let open = line("open", &output.open).styled(Style::Dashed);
            let closed = output.closed.as_ref().map(|closed| line("closed", closed));
            [Some(open), closed].into_iter().flatten()
        });
        // What is zero has no place on a logarithmic axis.
        let series = series.filter(|line| line.y.iter().any(|y| *y > 0.0));
        let (note, per) = match load.unit {
            "N" => (
                "How far a force along its direction moves its own node along it, and the performance outputs, per newton.",
                "m per N",
            ),
            _ => (
                "How far a moment about its axis turns its own node about it, rad, and moves the performance outputs, m, per newton metre.",
                "m or rad per N m",
            ),
        };
        let chart = Chart::new(
            id,
            format!("Compliance to {}", load.name),
            format!(
                "{note} Lower is stiffer. What symmetry makes zero is left out. Click in the legend to show other outputs."
            ),
            [hertz(), Axis::log(per)],
            series.collect(),
        );
        Chart {
            styles: "Dashed: without control. Solid: with control.".to_owned(),
            ..chart
        }
    };
    loads.iter().zip(ids).map(one).collect()
}

/// Loop gain by mode, sensitivity, and the Nyquist curves of the modes.
///
/// # Errors
/// Where an eigenvalue iteration does not converge.
pub fn loops(study: &Study, law: LinearLaw) -> Result<[Chart; 3], NumericError> {
    let closed = SampledLoop {
        plant: study.plant(),
        law,
    };
    let target = &study.machine().target;
    let poles = closed.poles()?;
    let peaks = [study.plant().plant.peaks(), pole_peaks(&poles)].concat();
    let (low, high) = (0.01 * target.frequency, 0.5 / study.plant().period);
    let points = grid(low, high, 500, &peaks);
    let modal_loop = closed.modal_loop(&study.design_model().modal);
    let values: Vec<(f64, ComplexMatrix6)> =
        points.iter().map(|&hz| (hz, modal_loop(hz))).collect();
    let hertz_of = study.design_model().hertz();
    // Modes in pairs, as symmetric machines have them, are one curve with one name.
    let by_mode = |axes: &[Axis; 2], value: &dyn Fn(f64, Complex<f64>) -> (f64, f64)| {
        let one = |k: usize| {
            let points = values.iter().map(|(hz, l)| value(*hz, l[(k, k)]));
            Series::line("", Colour::Nth(k), points)
        };
        let all: Vec<Series> = (0..LEGS).map(one).collect();
        let groups = coinciding(&all, axes.each_ref());
        let named = groups.into_iter().map(|modes| Series {
            name: mode_names(&modes, &hertz_of),
            ..all[modes[0]].clone()
        });
        named.collect::<Vec<_>>()
    };
    let gain_axes = [hertz(), Axis::linear("|L|, dB")];
    let mut gains = by_mode(&gain_axes, &|hz, l| (hz, db(l.norm())));
    gains.push(limit("1", low, high, 0.0));
    let sensitivity = values.iter().map(|(hz, l)| {
        let smallest = (ComplexMatrix6::identity() + l).singular_values().min();
        (*hz, -db(smallest))
    });
    let sensitivity = vec![
        Series::line(
            "σ_max(S)",
            colour(study.design_model().feedback),
            sensitivity,
        )
        .main(),
        limit(
            format!("bound: {}", target.max_sensitivity),
            low,
            high,
            db(target.max_sensitivity),
        ),
    ];
    let equal = |label: &str| Axis {
        scale: Scale::Equal,
        ..Axis::linear(label)
    };
    let nyquist_axes = [
        equal("Re L").from_to(-3.0, 2.0),
        equal("Im L").from_to(-2.0, 2.0),
    ];
    let mut nyquist = by_mode(&nyquist_axes, &|_, l| (l.re, l.im));
    // Around −1: on this circle the sensitivity of one mode is at its bound.
    let radius = 1.0 / target.max_sensitivity;
    let circle = (0..=72).map(|i| {
        let (sin, cos) = (f64::from(i) * core::f64::consts::TAU / 72.0).sin_cos();
        (radius * cos - 1.0, radius * sin)
    });
    nyquist.push(Series::line("bound around −1", Colour::Limit, circle).styled(Style::Limit));
    Ok([
        Chart::new(
            "loop-gain",
            "Loop gain by mode",
            "Opened at the force along each mode of the design model. Where the loop gain is large, the closed loop behaves as the target requires.",
            gain_axes,
            gains,
        ),
        Chart::new(
            "sensitivity",
            "Sensitivity: attenuation and amplification by the loop",
            "The largest singular value of (1 + L)⁻¹, all modes at once. Below 0 dB the loop attenuates, above 0 dB it amplifies. The lower the peak, the larger the margins.",
            [hertz(), Axis::linear("σ_max(S), dB")],
            sensitivity,
        ),
        Chart::new(
            "nyquist",
            "Nyquist curves of the modes",
            "L of each mode in the complex plane, from low frequency to half the sample rate. Modes with little coupling stay outside the circle around −1.",
            nyquist_axes,
            nyquist,
        ),
    ])
}

/// The name of modes, by index, that are one curve: their numbers and frequencies.
fn mode_names(modes: &[usize], hertz: &[f64; LEGS]) -> String {
    let numbers: Vec<String> = modes.iter().map(|k| (k + 1).to_string()).collect();
    let mut frequencies: Vec<String> = modes.iter().map(|k| format!("{:.1}", hertz[*k])).collect();
    frequencies.dedup();
    let s = if modes.len() > 1 { "s" } else { "" };
    let [numbers, frequencies] = [numbers, frequencies].map(|words| words.join(" and "));
    format!("mode{s} {numbers}, {frequencies} Hz")
}

/// Modes, zeros and poles on one frequency axis.
///
/// # Errors
/// Where an eigenvalue iteration does not converge.
pub fn frequencies(studies: &[DesignedStudy]) -> Result<Chart, NumericError> {
    let mut names = vec!["modes".to_owned()];
    let mut series = Vec::new();
    if let Some(DesignedStudy { study, .. }) = studies.first() {
        let modes = study.model().modes();
        let energies = energies(study.machine(), study.model(), &modes);
        for (kind, name, colour) in [
            (Kind::Suspension, "suspension modes", Colour::Nth(6)),
            (Kind::Internal, "internal modes", Colour::Nth(3)),
        ] {
            let own = modes.hertz().into_iter().zip(&energies);
            let own: Vec<f64> = own
                .filter(|(hz, e)| e.kind == kind && *hz > 0.0)
                .map(|(hz, _)| hz)
                .collect();
            let labels = own.iter().map(|hz| format!("{hz:.3} Hz")).collect();
            let points = own.into_iter().map(|hz| (hz, 0.0));
            series.push(points_of(name, colour, points, labels).main());
        }
    }
    for DesignedStudy { study, design } in studies {
        let feedback = study.design_model().feedback;
        let space = &study.plant().plant.state_space;
        let name = feedback.name();
        let fastest = core::f64::consts::PI / study.plant().period;
        let mut add = |what: String, list: Vec<Complex<f64>>| {
            let row = names.len() as f64;
            let upper = list
                .into_iter()
                .filter(|s| s.im >= 0.0 && s.norm() < fastest);
            let (points, labels): (Vec<_>, Vec<_>) = upper
                .map(|s| {
                    let hz = s.norm() / core::f64::consts::TAU;
                    let label = format!("{hz:.4} Hz, damping {:.4}", -s.re / s.norm());
                    ((hz, row), label)
                })
                .unzip();
            series.push(points_of(what.clone(), colour(feedback), points, labels));
            names.push(what);
        };
        // With both kinds of feedback, each kind has its own zeros, and the ideal loop is
        // that of acceleration feedback.
        if feedback != FeedbackKind::Both {
            let zeros = study.zeros()?;
            add(format!("{name}: zeros"), zeros);
            let ideal = ideal_poles(space, study.gains())?;
            add(format!("{name}: ideal poles"), ideal);
        }
        if let Ok(design) = design {
            let poles = SampledLoop::new(study.plant(), &design.table).poles()?;
            add(format!("{name}: sampled poles"), poles);
        }
    }
    let highest = (names.len() - 1) as f64;
    Ok(Chart::new(
        "frequencies",
        "Zeros, modes and poles",
        "With high gain, poles move to the zeros of the path from leg forces to sensors (section 5 of the paper). The loop cannot act at the frequency of a zero. Zeros far below the modes are harmless. Zeros among the suspension modes, as with force feedback through stiff legs, limit the isolation.",
        [
            hertz().from_to(0.05, 2000.0),
            Axis {
                names,
                ..Axis::linear("").from_to(-0.5, highest + 0.5)
            },
        ],
        series,
    ))
}

fn points_of(
    name: impl Into<String>,
    colour: Colour,
    points: impl IntoIterator<Item = (f64, f64)>,
    labels: Vec<String>,
) -> Series {
    Series::line(name, colour, points)
        .styled(Style::Points)
        .labelled(labels)
}

/// Floor vibration: one-third octaves on the criteria, and the spectrum of the
/// performance by source.
pub fn vibration(floor: &str, [open, closed]: &[NoiseBudget; 2]) -> [Chart; 2] {
    let thirds = |budget: &NoiseBudget| {
        let thirds = budget.thirds().into_iter();
        thirds
            .map(|(hz, velocity, _)| (hz, 1e6 * velocity))
            .collect::<Vec<_>>()
    };
    let mut series = vec![
        Series::line("open", Colour::Open, thirds(open)).main(),
        Series::line("closed", Colour::Acceleration, thirds(closed)).main(),
    ];
    for criterion in Criterion::VC {
        let own = third_centres().filter(|hz| criterion.covers(*hz));
        let points = own.map(|hz| (hz, 1e6 * criterion.velocity(hz)));
        series.push(Series::line(criterion.name(), Colour::Limit, points).styled(Style::Limit));
    }
    let together = |spectra: &Spectra, part: &dyn Fn(&[f64; SOURCES.len()]) -> f64| {
        let sum = |i: usize| spectra.iter().map(|one| part(&one[i])).sum::<f64>();
        (0..spectra.first().map_or(0, Vec::len))
            .map(|i| sum(i).sqrt())
            .collect::<Vec<_>>()
    };
    let total = |budget: &NoiseBudget| {
        let density = together(&budget.performance, &|powers| powers.iter().sum());
        budget.hz.iter().copied().zip(density).collect::<Vec<_>>()
    };
    let mut spectrum = vec![
        Series::line("open", Colour::Open, total(open)).main(),
        Series::line("closed", Colour::Acceleration, total(closed)).main(),
    ];
    for (i, source) in SOURCES.into_iter().enumerate() {
        let density = together(&closed.performance, &|powers| powers[i]);
        let points = closed.hz.iter().copied().zip(density);
        spectrum.push(
            Series::line(format!("closed: from {source}"), Colour::Nth(i + 1), points)
                .styled(Style::Dashed),
        );
    }
    [
        Chart::new(
            "vibration",
            "Velocity of the frame, and the vibration criteria",
            format!(
                "One-third octaves, rms, the worst of x, y and z, on the floor {floor}. The frame meets a criterion if it stays below its line."
            ),
            [hertz().from_to(0.9, 100.0), Axis::log("velocity, µm/s rms")],
            series,
        ),
        Chart {
            styles: "The dashed lines are the parts of floor, sensor noise and converters in the closed loop: the noise budget by frequency.".to_owned(),
            ..Chart::new(
                "spectrum",
                "Spectrum of the performance, and its sources",
                "Amplitude density of all performance outputs together.",
                [hertz(), Axis::log("m/s²/√Hz")],
                spectrum,
            )
        },
    ]
}

/// The session in time.
pub fn session(machine: &Machine, history: &History) -> [Chart; 3] {
    let envelope = &history.envelope;
    let time = || envelope.time.iter().copied();
    let ending = envelope.time.last().copied().unwrap_or(0.0);
    let close = &history.close_up;
    let energy = |signal: &[f64]| signal.iter().map(|x| x * x).sum::<f64>();
    let loudest = (0..close.open.len())
        .max_by(|&a, &b| energy(&close.open[a]).total_cmp(&energy(&close.open[b])));
    let names = machine.performance_names();
    let mut lines = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let pair = [
            ("open", &close.open, Colour::Open),
            ("closed", &close.closed, colour(machine.target.feedback)),
        ];
        for (what, signals, colour) in pair {
            let Some(signal) = signals.get(i) else {
                continue;
            };
            let points = close.time.iter().copied().zip(signal.iter().copied());
            lines.push(
                Series::line(format!("{name}, {what}"), colour, points).shown(loudest == Some(i)),
            );
        }
    }
    let mut forces: Vec<Series> = machine
        .actuators
        .iter()
        .zip(&envelope.force)
        .enumerate()
        .map(|(n, (leg, force))| {
            let points = time().zip(force.iter().copied());
            Series::line(&machine.beams[*leg].name, Colour::Nth(n), points)
        })
        .collect();
    let limit_of = machine.board.force_limit;
    forces.push(limit("limit", 0.0, ending, limit_of).shown(false));
    [
        Chart {
            marks: history
                .phases
                .iter()
                .map(|phase| (phase.from, phase.mode.to_owned()))
                .collect(),
            ..Chart::new(
                "session",
                "A session, from control off to the closed loop",
                format!(
                    "The firmware's controller on the simulated machine, converters and noise included, on the floor of its file ({:e} m/s² rms along each of x, y and z, {} to {} Hz). All performance outputs together, rms over 50 ms. The self-test excites each leg in turn; then the loop is closed with a soft start.",
                    machine.simulation.floor_rms,
                    machine.simulation.floor_band[0],
                    machine.simulation.floor_band[1],
                ),
                [Axis::linear("time, s"), Axis::log("m/s² rms")],
                vec![
                    Series::line(
                        "control off",
                        Colour::Open,
                        time().zip(envelope.open.iter().copied()),
                    )
                    .main(),
                    Series::line(
                        "control on",
                        colour(machine.target.feedback),
                        time().zip(envelope.closed.iter().copied()),
                    )
                    .main(),
                ],
            )
        },
        Chart::new(
            "close-up",
            "The same floor with and without control",
            "The last half second of the session. Click in the legend to show other outputs."
                .to_owned(),
            [Axis::linear("time, s"), Axis::linear("m/s²")],
            lines,
        ),
        Chart::new(
            "forces",
            "Leg forces during the session",
            format!("Largest magnitude in each 50 ms; the limit is {limit_of} N."),
            [Axis::linear("time, s"), Axis::linear("force, N")],
            forces,
        ),
    ]
}

/// The machine in an oblique view from above, m: at rest, then once for each mode. `legs` are the
/// beams with actuators, by index. The numbers of points grow in proportion to the numbers of nodes
/// and beams. None of a machine with neither bodies nor beams.
pub fn drawings(machine: &Structure, legs: &[usize], model: &StructureModel) -> Vec<Chart> {
    let modes = model.modes();
    let at_rest = Drawing::new(machine, legs, model, None);
    if at_rest.series().is_empty() {
        return Vec::new();
    }
    let axis = || Axis {
        scale: Scale::Equal,
        ..Axis::linear("m")
    };
    let mut drawings = vec![Chart::new(
        "machine",
        format!("{}: legs, bodies, beams", machine.name),
        "Oblique view from above. A body is drawn as lines from its centre of gravity to its nodes.",
        [axis(), axis()],
        at_rest.series(),
    )];
    let rest = [&at_rest.legs[..], &at_rest.others].concat();
    for (i, hz) in modes.hertz().into_iter().enumerate() {
        let shape = modes.shapes.column(i).into_owned();
        let moved = Drawing::new(machine, legs, model, Some(&shape));
        let mut series =
            vec![Series::line("at rest", Colour::Open, rest.clone()).styled(Style::Dashed)];
        series.extend(moved.series());
        drawings.push(Chart::new(
            "mode",
            format!("mode {}, {hz:.2} Hz", i + 1),
            "Magnified: the largest motion is drawn as an eighth of the size of the machine.",
            [axis(), axis()],
            series,
        ));
    }
    drawings
}

/// Line segments of a machine in the plane of the picture, m. After each segment stands
/// a point that is not a number: the line breaks there.
struct Drawing {
    legs: Vec<(f64, f64)>,
    others: Vec<(f64, f64)>,
    bodies: Vec<(f64, f64)>,
}

impl Drawing {
    /// The machine at rest, or moved along a mode shape.
    fn new(
        machine: &Structure,
        legs: &[usize],
        model: &StructureModel,
        shape: Option<&DVector<f64>>,
    ) -> Self {
        let moved: Vec<Vector3<f64>> = (0..machine.nodes.len())
            .map(|node| match shape {
                Some(shape) => model.translation(node, shape),
                None => Vector3::zeros(),
            })
            .collect();
        let largest = moved.iter().map(Vector3::norm).fold(0.0, f64::max);
        let scale = if largest > 0.0 {
            0.12 * size(machine) / largest
        } else {
            0.0
        };
        let node = |node: usize| oblique(machine.nodes[node].at + moved[node] * scale);
        let cog = |body: usize| {
            let motion = shape.map_or_else(Vector3::zeros, |shape| {
                shape.fixed_rows::<3>(6 * body).into_owned()
            });
            oblique(machine.bodies[body].cog + motion * scale)
        };
        // A flexible body has no one motion: from the mean position of its nodes.
        let middle = |body: usize| {
            let nodes = machine.flexible[body].nodes.iter();
            let (sum, count) = nodes.fold((Vector3::zeros(), 0.0), |(sum, count), &node| {
                (
                    sum + machine.nodes[node].at + moved[node] * scale,
                    count + 1.0,
                )
            });
            oblique(sum / count)
        };
        let segment = |from, to| [from, to, (f64::NAN, f64::NAN)];
        let shape = shape.map(|shape| DMatrix::from_column_slice(shape.len(), 1, shape.as_slice()));
        let beam = |beam: usize| {
            let points = model.along(machine, beam).into_iter().map(|point| {
                let moved = shape.as_ref().map_or_else(Vector3::zeros, |shape| {
                    point.motion(shape).fixed_view::<3, 1>(0, 0).into_owned()
                });
                oblique(point.at + moved * scale)
            });
            points.chain([(f64::NAN, f64::NAN)]).collect::<Vec<_>>()
        };
        let others = 0..machine.beams.len();
        let others = others.filter(|i| !legs.contains(i));
        let carried = machine.nodes.iter().enumerate();
        let bodies = carried.filter_map(|(i, carried)| match carried.carrier {
            Carrier::Base | Carrier::Free => None,
            Carrier::Flexible(body) => Some(segment(middle(body), node(i))),
            Carrier::Body(body) => Some(segment(cog(body), node(i))),
        });
        Self {
            legs: legs.iter().flat_map(|leg| beam(*leg)).collect(),
            others: others.flat_map(beam).collect(),
            bodies: bodies.flatten().collect(),
        }
    }

    /// One for each kind of part that the machine has.
    fn series(&self) -> Vec<Series> {
        let parts = [
            ("bodies", Colour::Nth(4), &self.bodies),
            ("legs", Colour::Nth(1), &self.legs),
            ("other beams", Colour::Nth(2), &self.others),
        ];
        let parts = parts.into_iter().filter(|(.., points)| !points.is_empty());
        parts
            .map(|(name, colour, points)| Series::line(name, colour, points.iter().copied()))
            .collect()
    }
}

/// Turned about z, then seen from above: no length is drawn longer than it is.
fn oblique(p: Vector3<f64>) -> (f64, f64) {
    let (sin, cos) = 0.6_f64.sin_cos();
    let (above, level) = 0.46_f64.sin_cos();
    (
        p.x * cos - p.y * sin,
        above * (p.x * sin + p.y * cos) + level * p.z,
    )
}

/// The diagonal of the box around all nodes, its sides along the axes, m.
fn size(machine: &Structure) -> f64 {
    let nodes = || machine.nodes.iter().map(|node| node.at);
    let low = nodes().reduce(|a, b| a.inf(&b));
    let high = nodes().reduce(|a, b| a.sup(&b));
    low.zip(high).map_or(0.0, |(low, high)| (high - low).norm())
}
