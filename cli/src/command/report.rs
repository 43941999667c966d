//! `host-gen report`.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use host_gen::machine::{Machine, Structure};
use host_gen::report::page::page;
use host_gen::report::plots::{csv, png, svg};
use host_gen::report::{Report, Review};

use crate::arguments::{Format, Several};
use crate::failure::{Failure, in_study};
use crate::files::write_whole;
use crate::floor::FloorChoice;
use crate::print;
use crate::search::{Bar, Searcher};

#[derive(Args)]
pub struct ReportArguments {
    #[command(flatten)]
    several: Several,
    /// Output format: text writes the page, json prints its data (docs/json.md).
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
    /// File of the page [default: NAME-report.html].
    #[arg(long)]
    output: Option<PathBuf>,
    /// Folder for every chart as SVG, PNG and CSV.
    #[arg(long, value_name = "FOLDER")]
    plots: Option<PathBuf>,
    /// The floor [default: the floor.spectrum of the file, or else vc-c].
    #[command(flatten)]
    floor: FloorChoice,
}

pub fn report(arguments: &ReportArguments, searcher: &Searcher) -> Result<(), Failure> {
    let several = &arguments.several;
    let passive = match &several.models[..] {
        [model] if !several.by_feedback => Structure::load_passive(model)?,
        _ => None,
    };
    let (review, names) = match passive {
        Some(passive) => (Review::passive(&passive)?, passive.name),
        None => controlled(arguments, searcher)?,
    };
    let path = match &arguments.output {
        Some(path) => path.clone(),
        None => PathBuf::from(format!("{names}-report.html")),
    };
    if let Some(folder) = &arguments.plots {
        plots(&review, folder)?;
    }
    if arguments.format == Format::Json {
        return print::text(&(review.json() + "\n"));
    }
    write_whole(&path, page(&review).as_bytes())?;
    println!("{}: open it in a browser", path.display());
    Ok(())
}

/// The review of machines with control, and their names.
fn controlled(
    arguments: &ReportArguments,
    searcher: &Searcher,
) -> Result<(Review, String), Failure> {
    let machines = arguments.several.load()?;
    let bar = Bar::search();
    let floor = arguments.floor.floor()?;
    let (floor, search) = (floor.as_ref(), searcher.full(&bar));
    let of = in_study(&arguments.several.models[0]);
    let mut reports = Vec::new();
    for machine in &machines {
        if arguments.several.by_feedback {
            reports.extend(Report::by_feedback(machine, floor, &search).map_err(&of)?);
        } else {
            reports.push(Report::new(machine, floor, &search).map_err(&of)?);
        }
    }
    drop(bar);
    Ok((Review::new(reports).map_err(of)?, names(&machines)))
}

/// The names of the machines, repeated names once, joined by hyphens.
fn names(machines: &[Machine]) -> String {
    let mut names: Vec<&str> = machines.iter().map(|m| &m.name[..]).collect();
    names.dedup();
    names.join("-")
}

fn plots(review: &Review, folder: &Path) -> Result<(), Failure> {
    fs::create_dir_all(folder).map_err(|error| Failure::Io {
        path: folder.display().to_string(),
        what: "created",
        error,
    })?;
    let pictures = review.pictures();
    for (name, chart) in &pictures {
        let write = |ending: &str, bytes: &[u8]| {
            write_whole(&folder.join(format!("{name}.{ending}")), bytes)
        };
        let picture = svg(chart)?;
        write("svg", picture.as_bytes())?;
        write("png", &png(chart, &picture)?)?;
        write("csv", csv(chart).as_bytes())?;
    }
    // Standard output may be used for JSON.
    eprintln!(
        "{}: {} charts, each as SVG, PNG and CSV",
        folder.display(),
        pictures.len()
    );
    Ok(())
}
