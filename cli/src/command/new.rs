//! `host-gen new`.

use std::io::{self, IsTerminal as _};
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use dialoguer::theme::ColorfulTheme;
use dialoguer::{Input, Select};
use host_gen::machine::FeedbackKind;
use host_gen::machine::schema::schema;
use host_gen::model::template::{Mounts, Outline};

use crate::arguments::between;
use crate::failure::{Failure, short};
use crate::files::write_whole;

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
    /// Axial stiffness EA/L of a leg, N/m.
    #[arg(long)]
    leg_stiffness: Option<f64>,
    /// Mass of the frame, kg.
    #[arg(long)]
    frame_mass: Option<f64>,
    /// Mass of the payload, kg; 0 for no payload.
    #[arg(long)]
    payload_mass: Option<f64>,
    /// Distance of the payload's centre of gravity below the frame, m.
    #[arg(long)]
    payload_below: Option<f64>,
    /// Approximate frequency of the payload's internal modes on the frame, Hz.
    #[arg(long)]
    internal: Option<f64>,
    /// Sensors to feed back.
    #[arg(long, value_parser = feedback())]
    feedback: Option<FeedbackKind>,
    /// Target suspension frequency, Hz.
    #[arg(long)]
    frequency: Option<f64>,
    /// Ask no questions: values that are not given are those of the paper's machine.
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

fn mounts(text: &str) -> Result<Mounts, String> {
    match text {
        "3" => Ok(Mounts::Three),
        "6" => Ok(Mounts::Six),
        _ => Err("use 3 mounts with two legs each, or 6 mounts with one leg each".to_owned()),
    }
}

/// Asks for values that were not given, or takes the defaults.
struct Questions {
    asked: bool,
}

impl Questions {
    fn text(&self, given: Option<&String>, question: &str, usual: &str) -> Result<String, Failure> {
        match given {
            Some(given) => Ok(given.clone()),
            None if !self.asked => Ok(usual.to_owned()),
            None => Input::with_theme(&ColorfulTheme::default())
                .with_prompt(question)
                .default(usual.to_owned())
                .interact_text()
                .map_err(stopped),
        }
    }

    fn number(
        &self,
        flag: &'static str,
        given: Option<f64>,
        question: &str,
        usual: f64,
        [least, most]: [f64; 2],
    ) -> Result<f64, Failure> {
        let right = |x: f64| (least..=most).contains(&x);
        let number = match given {
            Some(given) => given,
            None if !self.asked => usual,
            None => Input::with_theme(&ColorfulTheme::default())
                .with_prompt(question)
                .default(usual)
                .validate_with(|x: &f64| {
                    if right(*x) {
                        Ok(())
                    } else {
                        Err(format!("Enter a number from {least} to {}", short(most)))
                    }
                })
                .interact_text()
                .map_err(stopped)?,
        };
        between(flag, number, [least, most], "")
    }

    fn choice<T: Copy>(
        &self,
        given: Option<T>,
        question: &str,
        choices: &[(&str, T)],
    ) -> Result<T, Failure> {
        match given {
            Some(given) => Ok(given),
            None if !self.asked => Ok(choices[0].1),
            None => Select::with_theme(&ColorfulTheme::default())
                .with_prompt(question)
                .items(choices.iter().map(|(name, _)| *name))
                .default(0)
                .interact()
                .map(|chosen| choices[chosen].1)
                .map_err(stopped),
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

pub fn new(arguments: &NewArguments) -> Result<(), Failure> {
    let ask = Questions {
        asked: !arguments.yes && io::stdin().is_terminal() && io::stderr().is_terminal(),
    };
    let usual = Outline::default();
    let a = arguments;
    let name = ask.text(a.name.as_ref(), "Name of the machine", &usual.name)?;
    let mounts = [
        ("3 mounts with two legs each", Mounts::Three),
        ("6 mounts with one leg each", Mounts::Six),
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
    let leg_stiffness = ask.number(
        "leg-stiffness",
        a.leg_stiffness,
        "Axial stiffness of a leg, N/m",
        usual.leg_stiffness,
        STIFFNESS,
    )?;
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
        "Mass of the payload below the frame, kg (0 for none)",
        usual.payload_mass,
        [0.0, MASS[1]],
    )?;
    let (mut payload_below, mut internal) = (usual.payload_below, usual.internal);
    if payload_mass > 0.0 {
        payload_below = ask.number(
            "payload-below",
            a.payload_below,
            "Distance of the payload's centre of gravity below the frame, m",
            payload_below,
            LENGTH,
        )?;
        internal = ask.number(
            "internal",
            a.internal,
            "Approximate frequency of the payload's internal modes, Hz",
            internal,
            HERTZ,
        )?;
    }
    let kinds = [
        (
            "acceleration: accelerometers on the frame",
            FeedbackKind::Acceleration,
        ),
        ("force: force sensors in the legs", FeedbackKind::Force),
        ("both", FeedbackKind::Both),
    ];
    let feedback = ask.choice(a.feedback, "Feedback", &kinds)?;
    let frequency = ask.number(
        "frequency",
        a.frequency,
        "Target suspension frequency, Hz",
        usual.frequency,
        HERTZ,
    )?;
    let outline = Outline {
        name,
        mounts,
        radius,
        height,
        leg_angle,
        leg_stiffness,
        frame_mass,
        payload_mass,
        payload_below,
        internal,
        feedback,
        frequency,
    };
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
    let path = path.display();
    println!("Wrote {path}. Next:");
    println!("  host-gen modes {path}    natural frequencies and mode shapes");
    println!("  host-gen report {path}   one page with everything");
    println!("  host-gen watch {path}    the same page, redrawn when the file changes");
    Ok(())
}
