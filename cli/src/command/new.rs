//! `host-gen new`.

use std::io::{self, IsTerminal as _, Lines, StdinLock};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use dialoguer::theme::ColorfulTheme;
use dialoguer::{Input, Select};
use host_gen::analysis::warnings::warnings;
use host_gen::design::reach::limited_by_zeros;
use host_gen::design::{DesignError, Effort, Search};
use host_gen::machine::FeedbackKind;
use host_gen::machine::schema::schema;
use host_gen::model::template::{
    Mounts, Outline, ReadyBoard, ready_accelerometers, usual_leg_stiffness,
};

use crate::arguments::between;
use crate::failure::{Failure, short};
use crate::files::write_whole;
use crate::print;
use crate::search::{Searcher, study};

#[derive(Args)]
#[command(allow_negative_numbers = true)]
pub struct NewArguments {
    /// Name of the machine: lower-case letters, digits and hyphens, a letter first.
    name: Option<String>,
    /// Number of mounts: 3 with two legs each, or 6 with one leg each.
    #[arg(long, value_parser = mounts)]
    mounts: Option<Mounts>,
    /// Radius of the circle of mounts, m.
    #[arg(long)]
    radius: Option<f64>,
    /// Mount height above the feet, m.
    #[arg(long)]
    height: Option<f64>,
    /// Angle between a leg and the floor, degrees.
    #[arg(long)]
    leg_angle: Option<f64>,
    /// Axial stiffness EA/L of a leg, N/m [default: from the mass, so that the suspension is as
    /// hard as that of the paper's machine, 16 Hz in the mean of x, y and z].
    #[arg(long)]
    leg_stiffness: Option<f64>,
    /// Mass of the frame, kg.
    #[arg(long)]
    frame_mass: Option<f64>,
    /// Mass of the payload, kg; 0 for no payload.
    #[arg(long)]
    payload_mass: Option<f64>,
    /// Payload's centre of gravity beside the middle of the mounts, along x, m.
    #[arg(long)]
    payload_x: Option<f64>,
    /// The same along y, towards the first mount, m.
    #[arg(long)]
    payload_y: Option<f64>,
    /// Height of the payload's centre of gravity above the frame's, m; negative below it.
    #[arg(long)]
    payload_z: Option<f64>,
    /// Approximate frequency of the payload's internal modes on the frame, Hz.
    #[arg(long)]
    internal: Option<f64>,
    /// Sensors to feed back.
    #[arg(long, value_parser = feedback())]
    feedback: Option<FeedbackKind>,
    /// Target suspension frequency, Hz.
    #[arg(long)]
    frequency: Option<f64>,
    /// Board whose sample rate and delays are taken over.
    #[arg(long, value_parser = board())]
    board: Option<ReadyBoard>,
    /// Accelerometer of `host-gen parts` [default: usual figures].
    #[arg(long, value_parser = sensor())]
    sensor: Option<&'static str>,
    /// Ask no questions and read no answers: values that are not given are the usual ones.
    #[arg(long)]
    yes: bool,
    /// File to write [default: models/NAME.toml, or NAME.toml without a folder models].
    #[arg(long)]
    output: Option<PathBuf>,
}

fn feedback() -> impl TypedValueParser<Value = FeedbackKind> {
    PossibleValuesParser::new(FeedbackKind::ALL.map(FeedbackKind::name))
        .try_map(|name| name.parse())
}

fn board() -> impl TypedValueParser<Value = ReadyBoard> {
    PossibleValuesParser::new(ReadyBoard::ALL.map(ReadyBoard::name)).try_map(|name| {
        let mut all = ReadyBoard::ALL.into_iter();
        all.find(|board| board.name() == name)
            .ok_or("not the name of a board")
    })
}

fn sensor() -> impl TypedValueParser<Value = &'static str> {
    let names = || ready_accelerometers().map(|(name, _)| name);
    PossibleValuesParser::new(names()).try_map(move |name| {
        names()
            .find(|known| *known == name)
            .ok_or("not the name of a sensor")
    })
}

fn mounts(text: &str) -> Result<Mounts, String> {
    match text {
        "3" => Ok(Mounts::Three),
        "6" => Ok(Mounts::Six),
        _ => Err("use 3 mounts with two legs each, or 6 mounts with one leg each".to_owned()),
    }
}

/// Where values that were not given come from.
enum Questions {
    /// The usual values, without a question.
    Usual,
    /// A person at a terminal.
    Terminal,
    /// Standard input that is no terminal.
    Piped(Piped),
}

/// Answers in lines, one for each question that is asked; an empty line and the end of the input
/// stand for the usual value.
struct Piped {
    lines: Lines<StdinLock<'static>>,
    read: usize,
}

impl Piped {
    /// The answer to a question, shown beside it; `None` for the usual value.
    fn answer(&mut self, question: &str) -> Result<Option<String>, Failure> {
        let Some(line) = self.line()? else {
            return Ok(None);
        };
        if line.is_empty() {
            return Ok(None);
        }
        eprintln!("{question}: {line}");
        Ok(Some(line))
    }

    fn line(&mut self) -> Result<Option<String>, Failure> {
        let Some(line) = self.lines.next() else {
            return Ok(None);
        };
        self.read += 1;
        let line = line.map_err(|error| Failure::Io {
            path: "standard input".to_owned(),
            what: "read",
            error,
        })?;
        Ok(Some(line.trim().to_owned()))
    }

    /// Answers without a question would mean that others are in the wrong place.
    fn end(&mut self) -> Result<(), Failure> {
        while let Some(answer) = self.line()? {
            if !answer.is_empty() {
                return Err(Failure::Unasked {
                    line: self.read,
                    answer,
                });
            }
        }
        Ok(())
    }

    fn wrong(&self, question: &str, answer: String, expected: String) -> Failure {
        Failure::Answer {
            line: self.read,
            question: question.to_owned(),
            answer,
            expected,
        }
    }
}

/// One of several answers: its name, as in options and pipes, what it is, and its value.
type Choice<T> = (&'static str, String, T);

impl Questions {
    fn new(yes: bool) -> Self {
        if yes {
            Self::Usual
        } else if !io::stdin().is_terminal() {
            Self::Piped(Piped {
                lines: io::stdin().lines(),
                read: 0,
            })
        } else if io::stderr().is_terminal() {
            Self::Terminal
        } else {
            Self::Usual
        }
    }

    fn text(
        &mut self,
        given: Option<&String>,
        question: &str,
        usual: &str,
    ) -> Result<String, Failure> {
        if let Some(given) = given {
            return Ok(given.clone());
        }
        match self {
            Self::Usual => Ok(usual.to_owned()),
            Self::Terminal => Input::with_theme(&ColorfulTheme::default())
                .with_prompt(question)
                .default(usual.to_owned())
                .interact_text()
                .map_err(stopped),
            Self::Piped(piped) => {
                let answer = piped.answer(question)?;
                Ok(answer.unwrap_or_else(|| usual.to_owned()))
            }
        }
    }

    fn number(
        &mut self,
        flag: &'static str,
        given: Option<f64>,
        question: &str,
        usual: f64,
        [least, most]: [f64; 2],
    ) -> Result<f64, Failure> {
        let right = |x: f64| (least..=most).contains(&x);
        let expected = || format!("a number from {} to {}", short(least), short(most));
        if let Some(given) = given {
            return between(flag, given, [least, most], "");
        }
        match self {
            Self::Usual => Ok(usual),
            Self::Terminal => Input::with_theme(&ColorfulTheme::default())
                .with_prompt(question)
                .default(usual)
                .validate_with(|x: &f64| {
                    if right(*x) {
                        Ok(())
                    } else {
                        Err(format!("Enter {}", expected()))
                    }
                })
                .interact_text()
                .map_err(stopped),
            Self::Piped(piped) => {
                let Some(answer) = piped.answer(question)? else {
                    return Ok(usual);
                };
                match answer.parse() {
                    Ok(number) if right(number) => Ok(number),
                    _ => Err(piped.wrong(question, answer, expected())),
                }
            }
        }
    }

    /// The first of the choices is the usual one.
    fn choice<T: Copy>(
        &mut self,
        given: Option<T>,
        question: &str,
        choices: &[Choice<T>],
    ) -> Result<T, Failure> {
        if let Some(given) = given {
            return Ok(given);
        }
        match self {
            Self::Usual => Ok(choices[0].2),
            Self::Terminal => Select::with_theme(&ColorfulTheme::default())
                .with_prompt(question)
                .items(
                    choices
                        .iter()
                        .map(|(name, what, _)| format!("{name}: {what}")),
                )
                .default(0)
                .interact()
                .map(|chosen| choices[chosen].2)
                .map_err(stopped),
            Self::Piped(piped) => {
                let Some(answer) = piped.answer(question)? else {
                    return Ok(choices[0].2);
                };
                match choices.iter().find(|(name, ..)| *name == answer) {
                    Some((.., chosen)) => Ok(*chosen),
                    None => {
                        let names: Vec<_> = choices.iter().map(|(name, ..)| *name).collect();
                        Err(piped.wrong(question, answer, format!("one of {}", names.join(", "))))
                    }
                }
            }
        }
    }
}

fn stopped(dialoguer::Error::IO(error): dialoguer::Error) -> Failure {
    Failure::Io {
        path: "the terminal".to_owned(),
        what: "read",
        error,
    }
}

/// Lengths, m.
const LENGTH: [f64; 2] = [1e-3, 1e3];

/// Masses, kg.
const MASS: [f64; 2] = [1e-3, 1e8];

/// Stiffnesses, N/m.
const STIFFNESS: [f64; 2] = [1e-3, 1e13];

/// Frequencies, Hz.
const HERTZ: [f64; 2] = [1e-3, 1e4];

/// Angles, degrees; upright legs have an error of their own.
const ANGLE: [f64; 2] = [1e-3, 90.0];

/// Horizontal distances and heights of a payload, m.
const PLACE: [f64; 2] = [-LENGTH[1], LENGTH[1]];

pub fn new(arguments: &NewArguments, searcher: &Searcher) -> Result<(), Failure> {
    let outline = outline(arguments)?;
    let path = arguments.output.clone().unwrap_or_else(|| {
        let models = PathBuf::from("models");
        let file = format!("{}.toml", outline.name);
        if models.is_dir() {
            models.join(file)
        } else {
            file.into()
        }
    });
    let text = outline.machine_file(&path)?;
    if path.is_file() || path.is_dir() {
        return Err(Failure::Exists(path.display().to_string()));
    }
    if path.exists() {
        // A device or a FIFO, with nothing beside it.
        return write_whole(&path, text.as_bytes());
    }
    write_whole(&path, text.as_bytes())?;
    // The schema that the first line of the file names.
    let beside = path.with_file_name("machine.schema.json");
    if !beside.exists() {
        write_whole(&beside, schema().as_bytes())?;
    }
    println!("Wrote {}.", path.display());
    print::warn(&outline.doubts());
    tell_reach(&path, searcher)?;
    let path = path.display();
    println!("Next:");
    println!("  host-gen modes {path}    natural frequencies and mode shapes");
    println!("  host-gen report {path}   one page with everything");
    println!("  host-gen watch {path}    the same page, redrawn when the file changes");
    Ok(())
}

/// How long to search for a controller before the program says that it does not know.
const PATIENCE: Duration = Duration::from_secs(30);

/// Prints the suspension frequencies of a machine, what is suspicious about it, and whether its
/// target is reached, by a rough search; what is known without it if that takes too long.
fn tell_reach(path: &Path, searcher: &Searcher) -> Result<(), Failure> {
    let study = study(path)?;
    let modes = study.design_model().hertz();
    println!(
        "Suspension modes from {:.1} to {:.1} Hz.",
        modes[0],
        modes[modes.len() - 1]
    );
    print::warn(&warnings(&study));
    if io::stderr().is_terminal() {
        let most = PATIENCE.as_secs();
        eprintln!("Searching roughly for a controller, {most} s at most. The file is complete.");
    }
    let asked = study.machine().target.frequency;
    let limited = limited_by_zeros(&study);
    let kind = study.machine().target.feedback.name();
    let cache = searcher.cache().cloned();
    let (done, result) = mpsc::channel();
    // Nobody waits for a search that takes too long: it ends with the program.
    thread::spawn(move || {
        let search = Search {
            effort: Effort::Rough,
            cache: cache.as_ref(),
            progress: &(),
        };
        // If nobody waits, nobody is to be told.
        let _ = done.send(search.design(&study));
    });
    let thorough = format!(
        "host-gen design {} searches thoroughly, and verifies the controller on perturbed machines",
        path.display()
    );
    match result.recv_timeout(PATIENCE) {
        Ok(Ok(design)) => println!(
            "By a rough search, the target of {asked} Hz is reached: the loop isolates from {:.2} Hz. {thorough}.",
            design.isolation_from_hz
        ),
        Ok(Err(error @ DesignError::Unreachable { .. })) => {
            print::warn(&[format!("by a rough search, {error}. {thorough}")]);
        }
        Ok(Err(error)) => print::warn(&[error.to_string()]),
        Err(RecvTimeoutError::Disconnected) => panic!("the search ended without a result"),
        Err(RecvTimeoutError::Timeout) => {
            let zeros = match limited {
                Ok(Some(hz)) => format!(
                    "; even without sampling and delay, the ideal loop with {kind} feedback isolates only from {hz:.2} Hz, and more gain does not help (host-gen zeros)"
                ),
                Ok(None) | Err(_) => String::new(),
            };
            print::warn(&[format!(
                "whether the target of {asked} Hz is reached is not known: a rough search has not ended in {} s{zeros}. {thorough}",
                PATIENCE.as_secs()
            )]);
        }
    }
    Ok(())
}

/// The numbers from options, answers and usual values.
fn outline(a: &NewArguments) -> Result<Outline, Failure> {
    let mut ask = Questions::new(a.yes);
    let usual = Outline::default();
    let name = ask.text(a.name.as_ref(), "Name of the machine", &usual.name)?;
    let mounts = [
        ("3", "mounts with two legs each".to_owned(), Mounts::Three),
        ("6", "mounts with one leg each".to_owned(), Mounts::Six),
    ];
    let mounts = ask.choice(a.mounts, "Mounts", &mounts)?;
    let radius = ask.number(
        "radius",
        a.radius,
        "Radius of the circle of mounts, m",
        usual.radius,
        LENGTH,
    )?;
    let height = ask.number(
        "height",
        a.height,
        "Mount height above the feet, m",
        usual.height,
        LENGTH,
    )?;
    let leg_angle = ask.number(
        "leg-angle",
        a.leg_angle,
        "Angle between a leg and the floor, degrees",
        usual.leg_angle,
        ANGLE,
    )?;
    if leg_angle > 89.0 {
        return Err(Failure::Upright);
    }
    let frame_mass = ask.number(
        "frame-mass",
        a.frame_mass,
        "Mass of the frame, kg",
        usual.frame_mass,
        MASS,
    )?;
    let payload_mass = ask.number(
        "payload-mass",
        a.payload_mass,
        "Mass of the payload, kg (0 for none)",
        usual.payload_mass,
        [0.0, MASS[1]],
    )?;
    let (mut payload_at, mut internal) = (usual.payload_at, usual.internal);
    if payload_mass > 0.0 {
        let given = [
            (
                "payload-x",
                a.payload_x,
                "Payload's centre of gravity beside the middle, along x, m",
            ),
            ("payload-y", a.payload_y, "The same along y, m"),
            (
                "payload-z",
                a.payload_z,
                "Its height above the frame's, m (negative: below)",
            ),
        ];
        for (at, (flag, given, question)) in payload_at.iter_mut().zip(given) {
            *at = ask.number(flag, given, question, *at, PLACE)?;
        }
        if payload_at[2].abs() < LENGTH[0] {
            return Err(Failure::InPlane { least: LENGTH[0] });
        }
        internal = ask.number(
            "internal",
            a.internal,
            "Approximate frequency of the payload's internal modes, Hz",
            internal,
            HERTZ,
        )?;
    }
    let leg_stiffness = ask.number(
        "leg-stiffness",
        a.leg_stiffness,
        "Axial stiffness of a leg, N/m (usual: a suspension of 16 Hz in the mean of x, y and z)",
        usual_leg_stiffness(frame_mass + payload_mass),
        STIFFNESS,
    )?;
    let kinds = [
        (FeedbackKind::Acceleration, "accelerometers on the frame"),
        (FeedbackKind::Force, "force sensors in the legs"),
        (FeedbackKind::Both, "accelerometers and force sensors"),
    ];
    let kinds = kinds.map(|(kind, what)| (kind.name(), what.to_owned(), kind));
    let feedback = ask.choice(a.feedback, "Feedback", &kinds)?;
    let frequency = ask.number(
        "frequency",
        a.frequency,
        "Target suspension frequency, Hz",
        usual.frequency,
        HERTZ,
    )?;
    let boards = [
        (ReadyBoard::Example, "16 bits, 20 kHz, 50 µs of delay"),
        (ReadyBoard::Nucleo, "the reference board, 20 kHz, 25 µs"),
        (ReadyBoard::NucleoFast, "the reference board, 50 kHz, 15 µs"),
    ];
    let boards = boards.map(|(board, what)| (board.name(), what.to_owned(), board));
    let board = ask.choice(a.board, "Board", &boards)?;
    let accelerometer = match (a.sensor, feedback) {
        // Only accelerometers are in the library.
        (None, FeedbackKind::Force) => None,
        (sensor, _) => {
            let usual = (
                "usual",
                "figures that are usual for such machines".to_owned(),
                None,
            );
            let library = ready_accelerometers();
            let library = library.map(|(name, part)| (name, part.part.clone(), Some(name)));
            let sensors: Vec<_> = [usual].into_iter().chain(library).collect();
            ask.choice(sensor.map(Some), "Accelerometers", &sensors)?
        }
    };
    if let Questions::Piped(piped) = &mut ask {
        piped.end()?;
    }
    Ok(Outline {
        name,
        mounts,
        radius,
        height,
        leg_angle,
        leg_stiffness,
        frame_mass,
        payload_mass,
        payload_at,
        internal,
        feedback,
        frequency,
        board,
        accelerometer,
    })
}
