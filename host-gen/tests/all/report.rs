//! The report against what the other commands find, and its pictures and numbers
//! against themselves read back.

use std::sync::LazyLock;

use crate::common::{edited, looped_frame, model_path, parse, search, set, study};
use host_gen::design::{Cache, Search, Study};
use host_gen::floor::{Criterion, Floor};
use host_gen::machine::Machine;
use host_gen::report::chart::{Axis, Chart, Colour, Scale, Series, Style, coinciding};
use host_gen::report::page::page;
use host_gen::report::plots::{csv, png, svg};
use host_gen::report::{Report, Review};
use host_gen::simulate::run::compare;
use host_gen::simulate::session::history;
use resvg::tiny_skia::Pixmap;
use serde_json::Value;

/// Under the direct law, whose search is short.
fn report(edits: &[(&str, &str)]) -> Report {
    let machine = parse(&edited(edits)).unwrap();
    Report::new(
        &machine,
        Some(&Floor::Criterion(Criterion::VcC).into()),
        &search(),
    )
    .unwrap()
}

fn value(review: &Review) -> Value {
    serde_json::from_str(&review.json()).unwrap()
}

fn review(edits: &[&[(&str, &str)]]) -> Review {
    Review::new(edits.iter().map(|edits| report(edits)).collect()).unwrap()
}

/// The paper's machine.
fn frame() -> &'static Review {
    static FRAME: LazyLock<Review> = LazyLock::new(|| review(&[&[]]));
    &FRAME
}

/// The data in the page is the review, and nothing in the page is fetched.
#[test]
fn page_holds_the_review_and_asks_for_nothing() {
    let whole = page(frame());
    assert!(whole.len() < 6_000_000, "{} bytes", whole.len());
    // A file with a text that would end the element it stands in.
    let text = format!("{}\n# </script>\n", edited(&[]));
    let report = Report::quick(&parse(&text).unwrap()).unwrap();
    let review = Review::new(vec![report]).unwrap();
    let json = review.json();
    assert!(json.contains("</script>"));
    let page = page(&review);
    let start = "<script type=\"application/json\" id=\"data\">";
    let data = page.split_once(start).unwrap().1;
    let data = data.split_once("</script>").unwrap().0;
    let read: Value = serde_json::from_str(data).unwrap();
    assert_eq!(read, serde_json::from_str::<Value>(&json).unwrap());
    let markup = page.split_once("<body>").unwrap().0;
    for attribute in ["src=", "<link rel=\"stylesheet\"", "@import", "url("] {
        assert!(!markup.contains(attribute), "{attribute}");
    }
    assert_eq!(page.matches("<script src").count(), 0);
}

fn chart<'a>(review: &'a Review, id: &str) -> &'a Chart {
    let pictures = review.pictures().into_iter();
    let mut own = pictures.filter(|(name, _)| name == id);
    own.next().unwrap_or_else(|| panic!("no chart {id}")).1
}

fn highest(y: &[f64]) -> f64 {
    y.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

/// The charts' peaks are those that the search for the shaping found, each by its
/// own grid: the sensitivity climbs to its tops, the bands have 200 points and all
/// peaks.
#[test]
fn charts_peak_where_the_design_says() {
    let review = frame();
    let json = value(review);
    let shaped = &json["machines"][0]["closed"]["design"]["shaped"];
    let db = 20.0
        * shaped["peak_sensitivity"]["value"]
            .as_f64()
            .unwrap()
            .log10();
    let sensitivity = highest(&chart(review, "sensitivity").series[0].y);
    assert!((sensitivity - db).abs() < 0.05, "{sensitivity} and {db} dB");

    let sigma = chart(review, "sigma");
    for (series, key) in [("open", "open_db"), ("acceleration, sampled", "sampled_db")] {
        let own = sigma.series.iter().find(|s| s.name == series).unwrap();
        for band in shaped["bands"].as_array().unwrap() {
            let [low, high] = ["low_hz", "high_hz"].map(|key| band[key].as_f64().unwrap());
            // Between the points, where the band ends, straight.
            let at = |hz: f64| {
                let i = own.x.partition_point(|x| *x < hz).clamp(1, own.x.len() - 1);
                let part = (hz - own.x[i - 1]) / (own.x[i] - own.x[i - 1]);
                own.y[i - 1] + part * (own.y[i] - own.y[i - 1])
            };
            let points = own.x.iter().zip(&own.y);
            let inside = points.filter(|(hz, _)| (low..=high).contains(*hz));
            let mut inside: Vec<f64> = inside.map(|(_, y)| *y).collect();
            inside.extend([at(low), at(high)]);
            let found = highest(&inside);
            let expected = band[key].as_f64().unwrap();
            assert!(
                (found - expected).abs() < 0.1,
                "{series}: {found}, {expected} dB"
            );
        }
    }
    // It isolates from where the transmissibility last falls through 1/√2.
    let isolation = chart(review, "isolation");
    let sampled = isolation
        .series
        .iter()
        .find(|s| s.name == "sampled")
        .unwrap();
    let last = sampled.y.iter().rposition(|y| *y > -3.0103).unwrap();
    let from = shaped["isolation_from_hz"].as_f64().unwrap();
    assert!(
        sampled.x[last] <= from && from <= sampled.x[last + 1],
        "{} to {} Hz, {from}",
        sampled.x[last],
        sampled.x[last + 1]
    );
}

/// The drawn limits: the bound M of the sensitivity as a level in dB, and around −1 in the Nyquist
/// plane, where |1 + L| = 1/M; and half the power of the floor.
#[test]
fn limits_are_where_their_names_say() {
    let review = frame();
    let bound = parse(&edited(&[])).unwrap().target.max_sensitivity;
    let limit = |id: &str| {
        let mut series = chart(review, id).series.iter();
        series.find(|series| series.style == Style::Limit).unwrap()
    };
    let near = |found: f64, expected: f64| {
        // Six digits.
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    };
    for y in &limit("sensitivity").y {
        near(*y, 20.0 * bound.log10());
    }
    for y in &limit("isolation").y {
        near(*y, 10.0 * 0.5_f64.log10());
    }
    let circle = limit("nyquist");
    for (re, im) in circle.x.iter().zip(&circle.y) {
        near((1.0 + re).hypot(*im), 1.0 / bound);
    }
    let right = circle.x.iter().copied().fold(f64::MIN, f64::max);
    near(right, 1.0 / bound - 1.0);
}

/// The chart of vibration is in µm/s: VC-C is 12.5 µm/s from 8 Hz on (its published limit), and far
/// below the suspension, f_1, the frame without control follows a floor at this limit, as one mode
/// at f_1 or above would.
#[test]
fn vibration_without_control_is_that_of_the_floor() {
    let series = |name: &str| {
        let all = &chart(frame(), "vibration").series;
        all.iter().find(|series| series.name == name).unwrap()
    };
    let [open, limit] = ["open", "VC-C"].map(series);
    let at = |series: &Series, hz: f64| {
        let i = series.x.iter().position(|x| (x / hz - 1.0).abs() < 0.03);
        series.y[i.unwrap()]
    };
    for hz in [8.0, 80.0] {
        assert!((at(limit, hz) / 12.5 - 1.0).abs() < 0.01);
    }
    let lowest = study(&edited(&[])).model().modes().hertz()[0];
    for hz in [4.0, 5.0] {
        let follows = at(open, hz) / at(limit, hz);
        let most = 1.0 / (1.0 - (hz * 1.1 / lowest).powi(2));
        assert!((1.0..most).contains(&follows), "{hz} Hz: {follows}, {most}");
    }
}

/// A session: rest, self-test, rest, soft start, closed. Its end against the
/// standard run, which has other code for the loop and another stretch of the
/// floor: root mean squares over four seconds of noise agree to a quarter.
#[test]
fn history_ends_as_the_simulation_does() {
    let (study, table, _) = looped_frame();
    let history = history(study, table);
    let modes: Vec<&str> = history.phases.iter().map(|phase| phase.mode).collect();
    assert_eq!(
        modes,
        [
            "not tested",
            "self-test",
            "idle",
            "soft start",
            "loop closed"
        ]
    );
    let machine = study.machine();
    let names = machine.performance_names();
    let run = compare(
        study.plant(),
        &machine.board,
        &machine.simulation,
        table,
        names,
        None,
        &(),
    );
    let together = |rms: &[f64]| rms.iter().map(|x| x * x).sum::<f64>().sqrt();
    let envelope = &history.envelope;
    let begin = history.phases[4].from + 1.0;
    let begin = envelope.time.iter().position(|t| *t > begin).unwrap();
    for (found, expected) in [
        (&envelope.open[begin..], &run.open.rms),
        (&envelope.closed[begin..], &run.closed.rms),
    ] {
        let rms = together(found) / (found.len() as f64).sqrt();
        let ratio = rms / together(expected);
        assert!((0.75..1.25).contains(&ratio), "{ratio}");
    }
    // The close-up's means of five samples lose little of these signals.
    let close = &history.close_up;
    let power: f64 = close.open.iter().flatten().map(|x| x * x).sum();
    let rms = (power / close.time.len() as f64).sqrt();
    let ratio = rms / together(&run.open.rms);
    assert!((0.6..1.6).contains(&ratio), "{ratio}");
}

/// Lines are one if they are the same polygon, however it is divided, and not if they are a
/// hundredth of the axis apart, or if one goes on where the other ends.
#[test]
fn lines_on_each_other_are_one() {
    let axes = [Axis::log("Hz").from_to(1.0, 100.0), Axis::linear("dB")];
    let line = |count: i32, shift: f64, end: f64| {
        let points = (0..=count).map(|i| {
            let part = end * f64::from(i) / f64::from(count);
            (100_f64.powf(part), 10.0 * part + shift)
        });
        Series::line("", Colour::Open, points)
    };
    let series = [
        line(20, 0.0, 1.0),
        line(33, 0.0, 1.0),
        line(20, 0.2, 1.0),
        line(20, 0.0, 0.5),
        line(7, 0.201, 1.0),
    ];
    let groups = coinciding(&series, axes.each_ref());
    assert_eq!(groups, [vec![0, 1], vec![2, 4], vec![3]]);
}

/// In the charts of the loop each mode is named once, and those of the frame's pairs have one curve.
#[test]
fn modes_of_a_pair_have_one_curve() {
    for id in ["loop-gain", "nyquist"] {
        let series = &chart(frame(), id).series;
        let named: Vec<String> = series
            .iter()
            .filter(|s| s.style == Style::Line)
            .map(|s| s.name.split_once(',').unwrap().0.replace("modes ", ""))
            .map(|name| name.replace("mode ", ""))
            .collect();
        assert_eq!(named, ["1 and 2", "3", "4 and 5", "6"]);
    }
}

/// All parts of the machine are in the 3D view, with the numbers of the file.
#[test]
fn springs_and_point_masses_are_in_the_view() {
    let machine = parse(&edited(&[
        ("springs.tie.nodes", "[\"n3\", \"n5\"]"),
        ("springs.tie.stiffness", "[1.0, 2.0, 3.0]"),
        ("point_masses.box.node", "\"n5\""),
        ("point_masses.box.mass", "2.5"),
    ]));
    let report = Report::quick(&machine.unwrap()).unwrap();
    let json = value(&Review::new(vec![report]).unwrap());
    let scene = &json["machines"][0]["scene"];
    let name = |node: &Value| {
        let node = node.as_u64().unwrap() as usize;
        scene["nodes"][node]["name"].as_str().unwrap().to_owned()
    };
    let spring = &scene["springs"][0];
    assert_eq!(spring["name"], "tie");
    assert_eq!(name(&spring["ends"][0]), "n3");
    assert_eq!(name(&spring["ends"][1]), "n5");
    assert_eq!(
        spring["stiffness"],
        serde_json::json!([1.0, 2.0, 3.0, 0.0, 0.0, 0.0])
    );
    let mass = &scene["point_masses"][0];
    assert_eq!(mass["name"], "box");
    assert_eq!(mass["mass"], 2.5);
    assert_eq!(name(&mass["node"]), "n5");
}

/// The ticks of one axis of a picture are all decimals or all powers of ten.
#[test]
fn ticks_have_one_notation() {
    let labels = |low: f64, high: f64| -> Vec<String> {
        let axes = [Axis::linear("s"), Axis::log("m").from_to(low, high)];
        let series = vec![Series::line("one", Colour::Open, [(0.0, low), (1.0, high)])];
        let picture = svg(&Chart::new("ticks", "", "", axes, series)).unwrap();
        let texts = picture.split("<text").skip(1);
        let own = texts.map(|text| text.split_once('>').unwrap().1);
        own.map(|text| text.split_once("</text>").unwrap().0.trim().to_owned())
            .collect()
    };
    let small = labels(1e-7, 1e-2);
    for power in ["1e-7", "1e-3", "1e-2"] {
        assert!(small.contains(&power.to_owned()), "{small:?}");
    }
    assert!(!small.contains(&"0.01".to_owned()), "{small:?}");
    let usual = labels(1e-2, 1e3);
    for decimal in ["0.01", "1000"] {
        assert!(usual.contains(&decimal.to_owned()), "{usual:?}");
    }
}

/// Every number of a chart comes back from its CSV.
#[test]
fn csv_reads_back() {
    for (name, chart) in frame().pictures() {
        let text = csv(chart);
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        assert_eq!(&reader.headers().unwrap()[0], "series");
        let mut records = reader.records();
        for series in &chart.series {
            for (x, y) in series.x.iter().zip(&series.y) {
                let record = records.next().unwrap().unwrap();
                let number = |i: usize| record[i].parse::<f64>().unwrap();
                let same = |a: f64, b: f64| a == b || (a.is_nan() && b.is_nan());
                assert!(&record[0] == series.name.as_str(), "{name}");
                assert!(same(number(1), *x) && same(number(2), *y), "{name}");
            }
        }
        assert!(records.next().is_none(), "{name}");
    }
}

/// Every chart is drawn, in the colours of what is shown, with its title and its
/// letters: text that a font lacks would leave no ink.
#[test]
fn pictures_show_their_series() {
    let pictures = frame().pictures();
    // Thirteen charts, two of them of the loads, the machine, twelve modes.
    assert_eq!(pictures.len(), 26);
    for (name, chart) in pictures {
        let picture = svg(chart).unwrap();
        let pixels = Pixmap::decode_png(&png(chart, &picture).unwrap()).unwrap();
        assert_eq!((pixels.width(), pixels.height()), (1920, 1120));
        let ink = |colour: [u8; 3], rows: std::ops::Range<usize>| {
            let width = pixels.width() as usize;
            let pixels = &pixels.pixels()[rows.start * width..rows.end * width];
            let same = |p: &&resvg::tiny_skia::PremultipliedColorU8| {
                [p.red(), p.green(), p.blue()] == colour
            };
            pixels.iter().filter(same).count()
        };
        for series in chart.series.iter().filter(|s| s.shown) {
            // Limits are thin, and curves may lie on each other.
            if series.style != Style::Limit && !series.x.is_empty() {
                let count = ink(series.colour.rgb(), 0..1120);
                assert!(count > 20, "{name}: {} has {count} pixels", series.name);
            }
        }
        assert!(ink([0, 0, 0], 0..80) > 100, "{name} has no title");
        assert!(ink([0, 0, 0], 1000..1120) > 20, "{name} has no axis");
    }
}

/// An axis says what is where: the CSV's point of the highest peak lies, in the SVG,
/// where its axes' labels put it.
#[test]
fn axes_of_pictures_are_true() {
    let points = [(1.0, 0.0), (10.0, 5.0), (100.0, 10.0)];
    let chart = Chart {
        id: "true".to_owned(),
        title: "true".to_owned(),
        note: String::new(),
        styles: String::new(),
        x: Axis::log("Hz").from_to(1.0, 100.0),
        y: Axis::linear("dB").from_to(0.0, 10.0),
        series: vec![Series::line("one", Colour::Open, points).styled(Style::Points)],
        marks: Vec::new(),
    };
    assert_eq!(chart.x.scale, Scale::Log);
    let text = svg(&chart).unwrap();
    let number = |element: &str, key: &str| -> f64 {
        let (_, rest) = element.split_once(&format!(" {key}=\"")).unwrap();
        rest.split_once('"').unwrap().0.parse().unwrap()
    };
    let circles = text.split("<circle").skip(1);
    let centres: Vec<(f64, f64)> = circles
        .map(|circle| (number(circle, "cx"), number(circle, "cy")))
        .collect();
    // A decade and five decibels further are as far again.
    assert_eq!(centres.len(), 3);
    assert!((centres[0].0 + centres[2].0 - 2.0 * centres[1].0).abs() <= 1.0);
    assert!((centres[0].1 + centres[2].1 - 2.0 * centres[1].1).abs() <= 1.0);
    // And the ticks' letters stand under and beside them.
    let near = |label: &str, at: f64, key: &str| {
        let found = text.split("<text").skip(1).any(|element| {
            let own = element.split_once('>').unwrap().1;
            let own = own.split_once("</text>").unwrap().0.trim();
            own == label && (number(element, key) - at).abs() < 8.0
        });
        assert!(found, "{label} at {at}");
    };
    near("10", centres[1].0, "x");
    near("100", centres[2].0, "x");
    near("4", centres[0].1 + 0.4 * (centres[2].1 - centres[0].1), "y");
}

/// Side by side: the settings that were changed and no others, and curves of both.
#[test]
fn side_by_side_shows_what_differs() {
    let review = review(&[
        &[("name", "\"a\"")],
        &[
            ("name", "\"b\""),
            ("bodies.frame.mass", "700.0"),
            // The default, written out.
            ("gravity", "[0.0, 0.0, 0.0]"),
            ("board.actuator.bandwidth", "50000.0"),
        ],
    ]);
    let json = value(&review);
    let both = &json["side_by_side"];
    let differences = both["differences"].as_array().unwrap();
    let keys: Vec<&str> = differences.iter().map(|d| d[0].as_str().unwrap()).collect();
    let changed = ["name", "bodies.frame.mass", "board.actuator.bandwidth"];
    assert_eq!(keys, changed);
    assert_eq!(differences[1][1], serde_json::json!(["742.0", "700.0"]));
    assert_eq!(differences[2][1][0], Value::Null);
    let sigma = &chart(&review, "compared-sigma").series;
    let names: Vec<&str> = sigma.iter().map(|s| &s.name[..]).collect();
    assert_eq!(
        names,
        [
            "a: open",
            "a: acceleration, sampled",
            "b: open",
            "b: acceleration, sampled"
        ]
    );
    // Colours tell the machines, lines what is without control.
    let styles: Vec<Style> = sigma.iter().map(|s| s.style).collect();
    assert_eq!(
        styles,
        [Style::Dashed, Style::Line, Style::Dashed, Style::Line]
    );
    assert_eq!(sigma[0].colour, sigma[1].colour);
    assert_ne!(sigma[0].colour, sigma[2].colour);
    // Each machine has a row, and no row is empty.
    let rows = chart(&review, "compared-frequencies");
    assert_eq!(rows.y.names, ["a: modes", "b: modes"]);
    for (row, own) in ["a: ", "b: "].into_iter().enumerate() {
        let own = rows.series.iter().filter(|s| s.name.starts_with(own));
        let places: Vec<f64> = own.flat_map(|s| s.y.iter().copied()).collect();
        assert_eq!(places, vec![row as f64; 12]);
    }
    assert_eq!(sigma[0].y, chart(&review, "a-sigma").series[0].y);
    assert_eq!(sigma[2].y, chart(&review, "b-sigma").series[0].y);
    assert_ne!(sigma[0].y, sigma[2].y);
}

/// What an engineer must not overlook is in the report: a machine that falls, and
/// loops that cannot be had.
#[test]
fn warnings_and_what_is_missing() {
    let path = model_path().with_file_name("low-parasitic.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let heavy = format!("gravity = [0.0, 0.0, -9.81]\n{text}");
    let machine = Machine::parse(&path, &heavy).unwrap();
    let review = Review::new(vec![Report::quick(&machine).unwrap()]).unwrap();
    let json = value(&review);
    let report = &json["machines"][0];
    let warnings = report["warnings"].to_string();
    assert!(warnings.contains("buckles"), "{warnings}");
    assert!(report["closed"].is_null());
    assert_eq!(report["files"].as_array().unwrap().len(), 2);
    // No kind has its loop yet, and only that of the file will have one.
    let missing = report["not_shown"].as_array().unwrap();
    let ends: Vec<_> = missing
        .iter()
        .map(|missing| missing.as_str().unwrap().split_once(": ").unwrap())
        .collect();
    for (curve, reason) in [
        ("acceleration, sampled", "only designed with --by-feedback"),
        ("force, sampled", "the search is not finished"),
        ("both, sampled", "only designed with --by-feedback"),
    ] {
        assert!(ends.contains(&(curve, reason)), "{missing:?}");
    }

    let machine = parse(&edited(&[("control.feedback", "\"force\"")]));
    let report = Report::new(
        &machine.unwrap(),
        Some(&Floor::Criterion(Criterion::VcC).into()),
        &search(),
    )
    .unwrap();
    let json = value(&Review::new(vec![report]).unwrap());
    let reason = json["machines"][0]["missing"].as_str().unwrap();
    assert!(
        reason.contains("no controller was found that reaches"),
        "{reason}"
    );
}

/// A report designs the kind of feedback that the file asks for, whatever other designs are
/// kept; by feedback, it designs each kind once.
#[test]
fn other_kinds_are_designed_by_feedback_only() {
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::at(folder.path());
    let search = Search {
        cache: Some(&cache),
        ..Search::FULL
    };
    let searches = || std::fs::read_dir(folder.path()).unwrap().count();
    let machine = parse(&edited(&[])).unwrap();
    let alone = || {
        let report = Report::new(
            &machine,
            Some(&Floor::Criterion(Criterion::VcC).into()),
            &search,
        )
        .unwrap();
        Review::new(vec![report]).unwrap().json()
    };
    let first = alone();
    assert_eq!(searches(), 1);
    let each = Report::by_feedback(
        &machine,
        Some(&Floor::Criterion(Criterion::VcC).into()),
        &search,
    )
    .unwrap();
    assert_eq!(searches(), 2);
    assert_eq!(alone(), first);

    let not_shown = |json: &Value, i: usize| json["machines"][i]["not_shown"].to_string();
    let first: Value = serde_json::from_str(&first).unwrap();
    let expected = r#"["force, sampled: only designed with --by-feedback"]"#;
    assert_eq!(not_shown(&first, 0), expected);
    let each = value(&Review::new(each).unwrap());
    for (i, kind) in ["acceleration", "force"].into_iter().enumerate() {
        assert_eq!(each["machines"][i]["feedback"], kind);
        let missing = not_shown(&each, i);
        assert!(missing.contains("no controller was found"), "{missing}");
    }
}

/// The drawing of a mode moves nodes along the model's shape: in the plane of the
/// picture, the largest motion as an eighth of the machine's size or less.
#[test]
fn drawings_move() {
    let study = study(&edited(&[]));
    let machine = study.machine();
    let review = Review::new(vec![Report::quick(machine).unwrap()]).unwrap();
    let size = size_of(&study);
    for mode in 1..=12 {
        let chart = chart(&review, &format!("mode-{mode}"));
        let [rest, bodies] = ["at rest", "legs"].map(|name| {
            let series = chart.series.iter().find(|s| s.name == name);
            series.unwrap_or_else(|| panic!("{name}"))
        });
        // Legs come first among the beams at rest, in the same order.
        let shifts = (0..bodies.x.len()).map(|i| {
            let shift = (bodies.x[i] - rest.x[i]).hypot(bodies.y[i] - rest.y[i]);
            if shift.is_nan() { 0.0 } else { shift }
        });
        let largest = shifts.fold(0.0, f64::max);
        assert!(largest <= 0.1201 * size, "mode {mode}: {largest}");
        // Feet stand still.
        assert_eq!((bodies.x[0], bodies.y[0]), (rest.x[0], rest.y[0]));
    }
}

/// The diagonal of the box around the nodes.
fn size_of(study: &Study) -> f64 {
    let nodes = &study.machine().nodes;
    let side = |axis: usize| {
        let all = || nodes.iter().map(|node| node.at[axis]);
        all().fold(f64::MIN, f64::max) - all().fold(f64::MAX, f64::min)
    };
    side(0).hypot(side(1)).hypot(side(2))
}

/// A body with twice as many nodes takes twice as many points, not four times.
#[test]
fn drawings_grow_in_proportion_to_the_nodes() {
    let points = |more: usize| -> Vec<usize> {
        let mut file: toml::Table = edited(&[]).parse().unwrap();
        let mut names = file["bodies"]["frame"]["nodes"].as_array().unwrap().clone();
        for i in 0..more {
            let name = format!("more{i}");
            let at = vec![
                toml::Value::Float(0.001 * i as f64),
                toml::Value::Float(0.1),
                toml::Value::Float(0.2),
            ];
            set(&mut file, &format!("nodes.{name}"), toml::Value::Array(at));
            names.push(toml::Value::String(name));
        }
        set(&mut file, "bodies.frame.nodes", toml::Value::Array(names));
        let report = Report::quick(&parse(&file.to_string()).unwrap()).unwrap();
        let pictures = report.pictures().into_iter();
        let drawn = pictures.filter(|(name, _)| name == "machine" || name.starts_with("mode-"));
        drawn
            .map(|(_, chart)| chart.series.iter().map(|series| series.x.len()).sum())
            .collect()
    };
    let [few, many, most] = [100, 200, 400].map(points);
    assert_eq!(few.len(), 13);
    for ((few, many), most) in few.iter().zip(&many).zip(&most) {
        assert!(many > few);
        assert_eq!(most - many, 2 * (many - few));
    }
}

/// The compliance on the page: at rest that of the stiffness alone, and over frequency that of the
/// equation of motion, without damping. What symmetry makes zero is not drawn.
#[test]
fn compliance_on_the_page_is_that_of_the_equation_of_motion() {
    let edits = [("damping.modal", "0.0")];
    let study = study(&edited(&edits));
    let (machine, model) = (study.machine(), study.model());
    let quick = Report::quick(machine).unwrap();
    let review = Review::new(vec![quick]).unwrap();
    let json = value(&review);
    for (j, (load, id)) in machine
        .loads
        .iter()
        .zip(["compliance_frame", "compliance_twist"])
        .enumerate()
    {
        let push = if load.moment {
            // The rotation about z of the frame, the first body, and a couple of size 1 on it.
            let mut couple = nalgebra::DVector::zeros(model.stiffness.nrows());
            couple[5] = 1.0;
            couple
        } else {
            model.direction(machine, &load.at).0
        };
        let at = |hz: f64| {
            let omega = std::f64::consts::TAU * hz;
            let dynamic = &model.stiffness - &model.mass * (omega * omega);
            push.dot(&dynamic.lu().solve(&push).unwrap())
        };
        let still = at(0.0);
        let outputs = json["machines"][0]["compliance"]["loads"][j]["outputs"]
            .as_array()
            .unwrap();
        let own = outputs
            .iter()
            .find(|output| output["name"] == format!("at {}", load.at.name))
            .unwrap();
        let fixed = own["fixed"].as_f64().unwrap();
        assert!((fixed / still - 1.0).abs() < 1e-9, "{fixed:e} {still:e}");
        assert!(own["closed_highest"].is_null());

        let chart = chart(&review, id);
        let named = |name: &str| chart.series.iter().find(|s| s.name == name);
        let curve = named(&format!("at {}, open", load.at.name)).unwrap();
        let mut checked = 0;
        for (hz, y) in curve.x.iter().zip(&curve.y).step_by(10) {
            let expected = at(*hz);
            // Six digits of the frequency are few near a resonance without damping.
            if y / still < 5.0 && y / still > 0.2 {
                assert!((y / expected.abs() - 1.0).abs() < 1e-3, "{y:e} at {hz} Hz");
                checked += 1;
            }
        }
        assert!(checked > 10, "{checked}");
        // The frame turns about its axis without the first deformation of the lens.
        let stretched = named("block15.e1, open").is_some();
        assert_eq!(stretched, !load.moment);
    }
    // Without loads nothing is said of them.
    let none = Report::quick(&parse(&edited(&[("loads", "{}")])).unwrap()).unwrap();
    let none = Review::new(vec![none]).unwrap();
    assert!(value(&none)["machines"][0]["compliance"].is_null());
    let drawn = none.pictures().into_iter();
    assert!(
        drawn
            .map(|(name, _)| name)
            .all(|name| !name.starts_with("compliance"))
    );
}

/// Compared, loads of one name are in one chart and one row; without loads there are none.
#[test]
fn compliance_of_machines_side_by_side() {
    let machine = |edits: &[(&str, &str)]| Report::quick(&parse(&edited(edits)).unwrap()).unwrap();
    let loaded = Review::new(vec![
        machine(&[]),
        machine(&[("bodies.frame.mass", "800.0")]),
    ])
    .unwrap();
    let compared = chart(&loaded, "compared-compliance_frame");
    assert_eq!(compared.series.len(), 2);
    let json = value(&loaded);
    let columns = json["side_by_side"]["compared"]["machines"]
        .as_array()
        .unwrap();
    let own = |i: usize, key: &str| columns[i]["compliance"][0][key].clone();
    // Its mass does not change what holds it.
    let [one, other] = [0, 1].map(|i| own(i, "at_rest").as_f64().unwrap());
    assert!((one / other - 1.0).abs() < 1e-9, "{one:e} {other:e}");
    let [one, other] = [0, 1].map(|i| own(i, "open_highest")["hz"].as_f64().unwrap());
    assert!(other < 0.99 * one, "{one} {other}");
    assert_eq!(own(0, "unit"), "m/N");
}
