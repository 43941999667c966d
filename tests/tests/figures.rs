//! The figures in the documents against what the program computes.
//!
//! A figure is found by the text around it, so this fails too when its sentence is gone. To add
//! one, add a line to [`all`]: the file, the text with `{}` in place of each number, and the
//! values. A value is compared with as many digits as are written.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use firmware::budget::{ACCESSES, ADC_CLOCK, BEGIN, Budget, DAC_CLOCK, DUE, GUARD, LIMITS, SETUP};
use host_gen::closed_loop::Pole;
use host_gen::closed_loop::budget::budget;
use host_gen::control::table::coefficient;
use host_gen::design::{Cache, Design, DesignedStudy, Search, Study};
use host_gen::floor::Criterion;
use host_gen::floor::Floor;
use host_gen::machine::{FeedbackKind, Machine};
use host_gen::plant::zeros::transmission_zeros;

/// Figures in one place of a file.
struct Figure {
    file: &'static str,
    /// With `{}` for each number. White space and line breaks count as one space.
    text: &'static str,
    values: Vec<f64>,
}

/// The folder of the project.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn machine(name: &str) -> Machine {
    Machine::load(&root().join("models").join(name).with_extension("toml")).unwrap()
}

/// The designs of several machines, with what other steps of the whole test have found, where
/// that is kept.
fn designs(machines: Vec<Machine>) -> Vec<DesignedStudy> {
    static KEPT: LazyLock<Option<Cache>> = LazyLock::new(Cache::from_environment);
    let search = Search {
        cache: KEPT.as_ref(),
        ..Search::FULL
    };
    DesignedStudy::all(machines, &search).unwrap()
}

/// The frequencies of the slowest and the fastest zero with forces fed back, Hz.
fn force_zeros(study: &Study) -> [f64; 2] {
    let zeros = transmission_zeros(&study.plant().plant.state_space, FeedbackKind::Force).unwrap();
    // In ascending order: six conjugate pairs of the legs, then those of the lens.
    [zeros[0], zeros[11]].map(|zero| Pole::from(zero).hz)
}

/// Instructions on the Cortex-M7 of what a row of the kept baseline names, with this law.
fn instructions(law: &str, of: &str) -> f64 {
    let baseline = include_str!("../../firmware/instructions.txt");
    let name = format!("mps2-an500 {law} {of} ");
    let mut lines = baseline.lines();
    let line = lines.find_map(|line| line.strip_prefix(&name));
    line.unwrap().parse().unwrap()
}

/// Open, ideal and sampled peak of the suspension band, then of the internal band, dB.
fn peaks(design: &Design) -> [[f64; 3]; 2] {
    let [suspension, internal] = &design.bands[..] else {
        panic!("two bands");
    };
    [suspension, internal].map(|band| [band.open_db, band.ideal_db, band.sampled_db])
}

/// Sampled peak of the suspension band and of the internal band, dB, and the frequency from which
/// the machine is isolated, Hz.
fn row(DesignedStudy { design, .. }: &DesignedStudy) -> Vec<f64> {
    let design = design.as_ref().unwrap();
    let [suspension, internal] = peaks(design).map(|[.., sampled]| sampled);
    vec![suspension, internal, design.isolation_from_hz]
}

/// The part of the performance's power on a floor VC-C, all outputs together, that is noise of the
/// sensors, from 0.5 to 300 Hz as `host-gen floor` gives it, %.
fn sensor_noise(DesignedStudy { study, design }: &DesignedStudy) -> f64 {
    let (board, band) = (&study.machine().board, [0.5, 300.0]);
    let table = Some(&design.as_ref().unwrap().table);
    let floor = Floor::Criterion(Criterion::VcC);
    let budget = budget(study.plant(), board, table, &floor, band, None).unwrap();
    let powers = budget.performance.iter();
    let powers: Vec<_> = powers.map(|spectrum| budget.power(spectrum)).collect();
    let sensors: f64 = powers.iter().map(|powers| powers[1]).sum();
    100.0 * sensors / powers.iter().flatten().sum::<f64>()
}

/// All figures.
fn all() -> Vec<Figure> {
    const README: &str = "README.md";
    const LOOP: &str = "docs/loop.md";
    const BOARD: &str = "docs/board.md";

    let [frame, low] = ["metrology-frame", "low-parasitic"].map(machine);
    let others = ["both-sensors", "nucleo-h743", "nucleo-h743-fast"].map(machine);
    let kinds = [&frame, &low].map(Machine::by_feedback).concat();
    // The frame's outputs in the middle of a hold.
    let latched = [25e-6, 75e-6].map(|latch_delay| {
        let mut machine = frame.clone();
        machine.board.latch_delay = latch_delay;
        machine
    });
    let designed = designs([kinds, others.to_vec(), latched.to_vec()].concat());
    let [
        acceleration,
        force,
        both,
        low_acceleration,
        low_force,
        low_both,
        sensors,
        nucleo,
        fast,
        sooner,
        later,
    ] = &designed[..]
    else {
        panic!("three kinds of feedback of two machines, and five machines");
    };
    // As the table in docs/loop.md says.
    assert!(force.design.is_err());

    let study = &acceleration.study;
    let design = acceleration.design.as_ref().unwrap();
    let modes = study.model().modes().hertz();
    let target = &frame.target;
    let [suspension, internal] = peaks(design);
    let open = [suspension[0], internal[0]];
    let [[.., both_suspension], [.., both_internal]] = peaks(sensors.design.as_ref().unwrap());
    let board = &frame.board;
    let (khz, us) = (1e-3, 1e6);
    let leak = coefficient(design.leak_hz, board.period());

    let reference = &nucleo.study.machine().board;
    let quick = &fast.study.machine().board;
    let [latch, sample] = ["closed latch", "closed"].map(|of| instructions("modal", of));
    let [longest_latch, longest] =
        ["clamped latch", "clamped longest"].map(|of| instructions("modal", of));
    let usual_time = Budget::new(sample, latch);
    let longest_time = Budget::new(longest, longest_latch);
    let after = |parts: &[f64]| us * (BEGIN + parts.iter().sum::<f64>());
    let loads = |period: f64| [usual_time, longest_time].map(|time| 100.0 * time.busy() / period);
    let [load, quick_load] = [reference, quick].map(|board| loads(board.period()));
    let margin = |latch: f64| us * (latch - longest_time.ready());
    let computed = [usual_time.fetch, usual_time.latch, usual_time.begin]
        .iter()
        .sum::<f64>();
    let accesses = ACCESSES.map(f64::from);
    let adc = 1.0 / reference.adc.lsb();
    let accelerometer = reference.accelerometer.as_ref().unwrap().sensitivity;
    let force_sensor = reference.force_sensor.as_ref().unwrap().sensitivity;
    let full_scale = 32768.0 * reference.adc.lsb();
    let bands = |designed| row(designed)[..2].to_vec();

    let figure = |file, text, values: &[f64]| Figure {
        file,
        text,
        values: values.to_vec(),
    };
    #[rustfmt::skip]
    let figures = vec![
        figure(README, "| suspension modes | {} to {} Hz | {} Hz, damping {} | isolates from {} Hz |",
            &[modes[0], modes[5], target.frequency, target.damping, design.isolation_from_hz]),
        figure(README, "| worst floor → lens gain, 5–40 Hz | {} dB | {} dB | {} dB |", &suspension),
        figure(README, "| the same, 40–300 Hz | {} dB | {} dB | {} dB |", &internal),
        figure(README, "| peak sensitivity | | | {} |", &[design.peak_sensitivity.value]),
        figure(README, "The board samples at {} kHz and needs {} µs from the sample to the middle of the output",
            &[khz * board.sample_rate, us * board.whole_delay()]),
        figure(README, "reduce the worst gain by another {} dB in the suspension band and {} dB in the internal one",
            &[suspension[2] - both_suspension, internal[2] - both_internal]),
        figure(README, "`models/nucleo-h743.toml`: {} kHz and {} µs in all",
            &[khz * reference.sample_rate, us * reference.whole_delay()]),
        figure(README, "the design reaches {} dB in the suspension band and {} dB in the internal one",
            &bands(nucleo)),

        figure(LOOP, "| {} µs from sample to latch | 0.50 | {} / {} dB |",
            &[vec![us * latched[0].board.latch_delay], bands(sooner).to_vec()].concat()),
        figure(LOOP, "| {} µs, the file | 1.00 | {} / {} dB |",
            &[vec![us * board.latch_delay], bands(acceleration).to_vec()].concat()),
        figure(LOOP, "| {} µs | 0.50 | {} / {} dB |",
            &[vec![us * latched[1].board.latch_delay], bands(later).to_vec()].concat()),
        figure(LOOP, "high-passes at {}·f_n", &[design.ac_coupling_hz / target.frequency]),
        figure(LOOP, "The integrals leak at {}·f_n", &[design.leak_hz / target.frequency]),
        figure(LOOP, "At {} kHz, a coefficient 1 − c with c = {}·10⁻⁶ keeps only {} bits of c",
            &[khz * board.sample_rate, 1e6 * leak, (leak / f64::from(f32::EPSILON / 2.0)).log2().floor() + 1.0]),
        figure(LOOP, "are at {} to {} Hz on the paper's machine", &force_zeros(&force.study)),
        figure(LOOP, "With force feedback, {} Hz and a peak sensitivity of {} are therefore unreachable",
            &[target.frequency, target.max_sensitivity]),
        figure(LOOP, "On the low-parasitic variant the zeros are at {} to {} Hz", &force_zeros(&low_force.study)),
        figure(LOOP, "--by-feedback`, {} kHz and {} µs, dB", &[khz * board.sample_rate, us * board.whole_delay()]),
        figure(LOOP, "| paper's machine, open | {} | {} |", &open),
        figure(LOOP, "| acceleration | {} | {} | {} Hz | | force | unreachable | | |", &row(acceleration)),
        figure(LOOP, "| force | unreachable | | | | both | {} | {} | {} Hz |", &row(both)),
        figure(LOOP, "| low-parasitic, acceleration | {} | {} | {} Hz |", &row(low_acceleration)),
        figure(LOOP, "| force | {} | {} | {} Hz |", &row(low_force)),
        figure(LOOP, "| force | {} | {} | {} Hz | | both | {} | {} | {} Hz |", &[row(low_force), row(low_both)].concat()),
        figure(LOOP, "twelve converter channels and {} % more instructions per sample",
            &[100.0 * (instructions("both", "closed") / instructions("modal", "closed") - 1.0)]),
        figure(LOOP, "sensor noise is {} % of the power that is left on a VC-C floor, instead of {} %",
            &[sensor_noise(both), sensor_noise(acceleration)]),

        figure(BOARD, "| PE2, SPI4 SCK | AD7606 RD/SCLK | {} MHz |", &[1e-6 * ADC_CLOCK]),
        figure(BOARD, "| PC10, SPI3 SCK | AD5676R SCLK | {} MHz;", &[1e-6 * DAC_CLOCK]),
        figure(BOARD, "{} V/(m/s²): {} codes per m/s², ±{} m/s² |",
            &[accelerometer, adc * accelerometer, full_scale / accelerometer]),
        figure(BOARD, "{} V/N: {} codes per N, ±{} N |",
            &[force_sensor, adc * force_sensor, full_scale / force_sensor]),
        figure(BOARD, "{} N/V: {} codes per N, range ±{} N, limit ±{} N |",
            &[reference.actuator_gain, 1.0 / (reference.dac.lsb() * reference.actuator_gain),
              reference.dac.reach(reference.actuator_gain), reference.force_limit]),
        figure(BOARD, "```text 0 {} {} {} {} {} {} T = {} µs",
            &[after(&[]), us * DUE, after(&[usual_time.read]), after(&[usual_time.read, computed]),
              after(&[usual_time.read, computed, usual_time.write]), us * reference.latch_delay, us * reference.period()]),
        figure(BOARD, "| convert | {} | {} |", &[us * BEGIN; 2]),
        figure(BOARD, "| read 2 × 48 bits | {} | {} | {} MHz;",
            &[us * usual_time.read, us * longest_time.read, 1e-6 * ADC_CLOCK]),
        figure(BOARD, "| fetch the codes | {} | {} | {} accesses", &[us * usual_time.fetch, us * longest_time.fetch, accesses[1]]),
        figure(BOARD, "| from codes to codes | {} | {} | {} and {} instructions",
            &[us * usual_time.latch, us * longest_time.latch, latch, longest_latch]),
        figure(BOARD, "| hand over | {} | {} | {} accesses", &[us * usual_time.begin, us * longest_time.begin, accesses[2]]),
        figure(BOARD, "| second half | {} | {} | {} and {} instructions, {} accesses",
            &[us * usual_time.follow, us * longest_time.follow, sample - latch, longest - longest_latch, accesses[3]]),
        figure(BOARD, "| write 6 × 24 bits | {} | {} | {} MHz;",
            &[us * usual_time.write, us * longest_time.write, 1e-6 * DAC_CLOCK]),
        figure(BOARD, "| until LDAC | {} | {} |", &[us * SETUP; 2]),
        figure(BOARD, "| **ready after** | **{}** | **{}** |", &[us * usual_time.ready(), us * longest_time.ready()]),
        figure(BOARD, "| **processor busy** | **{}** | **{}** | from the interrupt, {} µs",
            &[us * usual_time.busy(), us * longest_time.busy(), us * DUE]),
        figure(BOARD, "| | {} kHz | {} kHz |", &[khz * reference.sample_rate, khz * quick.sample_rate]),
        figure(BOARD, "| load, usual / longest | {} / {} % | {} / {} % |", &[load, quick_load].concat()),
        figure(BOARD, "| latch after the sample | {} µs | {} µs |", &[us * reference.latch_delay, us * quick.latch_delay]),
        figure(BOARD, "| margin before the latch, at the least | {} µs | {} µs |", &[margin(reference.latch_delay), margin(quick.latch_delay)]),
        figure(BOARD, "| hold, half a period | {} µs | {} µs |", &[0.5 * us * reference.period(), 0.5 * us * quick.period()]),
        figure(BOARD, "| whole delay | {} µs | {} µs |", &[us * reference.whole_delay(), us * quick.whole_delay()]),
        figure(BOARD, "| suspension / internal band, dB | {} / {} | {} / {} |", &[bands(nucleo), bands(fast)].concat()),
        figure(BOARD, "The highest rate is {} kHz: the link begins nothing in the {} µs before an interrupt",
            &[khz * f64::from(LIMITS.rate), us * f64::from(GUARD)]),
        figure(BOARD, "{} kHz, LDAC {} µs after CONVST", &[khz * reference.sample_rate, us * reference.latch_delay]),
        figure(BOARD, "Apply 1 V to one input after the other: {} on that channel", &[adc]),
    ];
    figures
}

/// Text with one space for all white space between words.
fn collapsed(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The number at the start of `text`, as it is written.
fn number(text: &str) -> &str {
    let sign = text.strip_prefix('−').map_or(0, |_| '−'.len_utf8());
    let digits = text[sign..].find(|c: char| !c.is_ascii_digit() && c != '.' && c != ',');
    let end = digits.map_or(text.len(), |digits| sign + digits);
    text[..end].trim_end_matches(['.', ','])
}

/// The numbers in place of each `{}` where `pattern` is in `text`; none if it is not, or twice.
fn written<'a>(text: &'a str, pattern: &str) -> Option<Vec<&'a str>> {
    let mut pieces = pattern.split("{}");
    let first = pieces.next()?;
    let pieces: Vec<&str> = pieces.collect();
    let at = |start: usize| {
        let mut rest = text[start..].strip_prefix(first)?;
        let mut numbers = Vec::new();
        for piece in &pieces {
            let number = number(rest);
            rest = rest[number.len()..].strip_prefix(piece)?;
            if number.is_empty() {
                return None;
            }
            numbers.push(number);
        }
        Some(numbers)
    };
    // Not within a number, where the pattern begins with one.
    let within = |start: usize| {
        let before = text[..start].chars().next_back();
        first.is_empty() && before.is_some_and(|c| c.is_ascii_digit() || ".,−".contains(c))
    };
    let starts = text.char_indices().map(|(start, _)| start);
    let mut found = starts.filter(|start| !within(*start)).filter_map(at);
    found.next().filter(|_| found.next().is_none())
}

/// `value` with the digits of `written`.
fn printed(value: f64, written: &str) -> String {
    let decimals = written.split_once('.').map_or(0, |(_, d)| d.len());
    format!("{value:.decimals$}").replace('-', "−")
}

/// What is wrong with a figure.
fn faults(figure: &Figure, text: &str) -> Vec<String> {
    let Figure {
        file,
        text: pattern,
        values,
    } = figure;
    let Some(numbers) = written(&collapsed(text), pattern)
        .map(|numbers| numbers.into_iter().map(str::to_owned).collect::<Vec<_>>())
    else {
        return vec![format!("{file}: not there, or more than once: {pattern}")];
    };
    assert_eq!(numbers.len(), values.len(), "{pattern}");
    let pairs = numbers.iter().zip(values);
    pairs
        .filter(|(written, value)| printed(**value, written) != written.replace(',', ""))
        .map(|(written, value)| {
            format!("{file}: {written} is written, {value} computed: {pattern}")
        })
        .collect()
}

#[test]
fn documents_have_the_figures_of_the_program() {
    let mut found = Vec::new();
    for figure in all() {
        let text = fs::read_to_string(root().join(figure.file)).unwrap();
        found.extend(faults(&figure, &text));
    }
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

/// A text made up, with one fault of each kind.
#[test]
fn faults_of_figures_are_found() {
    let text = "| a | −58.8 dB | 1,469\n| and 2 Hz, 2 Hz. At 3.50.\n";
    let check = |text: &str, pattern: &'static str, values: &[f64]| {
        let figure = Figure {
            file: "a.md",
            text: pattern,
            values: values.to_vec(),
        };
        faults(&figure, text)
    };
    for (pattern, values) in [
        ("| a | {} dB | {} |", &[-58.75001, 1469.4][..]),
        ("{} dB", &[-58.84999]),
        ("At {}.", &[3.5]),
    ] {
        assert_eq!(check(text, pattern, values), [""; 0], "{pattern}");
    }
    for (pattern, value, fault) in [
        (
            "| a | {} dB",
            58.8,
            "a.md: −58.8 is written, 58.8 computed: | a | {} dB",
        ),
        (
            "| a | {} dB",
            -58.74,
            "a.md: −58.8 is written, -58.74 computed: | a | {} dB",
        ),
        (
            "At {}.",
            3.506,
            "a.md: 3.50 is written, 3.506 computed: At {}.",
        ),
        ("{} Hz", 2.0, "a.md: not there, or more than once: {} Hz"),
        ("{} kHz", 2.0, "a.md: not there, or more than once: {} kHz"),
    ] {
        assert_eq!(check(text, pattern, &[value]), [fault]);
    }
}
