//! Runs the reference board's image on the virtual board.
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use virtual_board::board::Board;
use virtual_board::image::Image;
use virtual_board::serve::{Place, serve};
use virtual_board::time::Cost;

/// The reference board in software: its image, unchanged, with the converters and the link
/// on sockets.
#[derive(Parser)]
struct Cli {
    /// The image, an ELF file.
    image: PathBuf,
    /// Socket of the plant: twelve ADC codes in, six DAC codes out.
    #[arg(long, value_name = "unix:PATH")]
    converters: Place,
    /// Socket of the link.
    #[arg(long, value_name = "unix:PATH|tcp:ADDRESS")]
    link: Place,
    /// Core cycles for an instruction. A parameter, not a measurement.
    #[arg(long, default_value_t = Cost::DEFAULT.instruction)]
    cycles_per_instruction: f64,
    /// Core cycles for an access to a peripheral's register, on top of its instruction. A
    /// parameter, not a measurement.
    #[arg(long, default_value_t = Cost::DEFAULT.access)]
    cycles_per_access: f64,
    /// Run every pass of the main loop, also where nothing can happen. Slower, with the
    /// same results.
    #[arg(long)]
    no_skip: bool,
}

fn main() -> ExitCode {
    match run(&Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("error: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(cli: &Cli) -> Result<(), String> {
    let path = cli.image.display();
    let bytes = std::fs::read(&cli.image).map_err(|error| format!("{path}: {error}"))?;
    let image = Image::parse(&bytes).map_err(|error| format!("{path}: {error}"))?;
    let cost = Cost {
        instruction: cli.cycles_per_instruction,
        access: cli.cycles_per_access,
    };
    let mut board = Board::new(image, cost)?;
    board.machine.idle_mut().skips = !cli.no_skip;
    serve(&mut board, &cli.converters, &cli.link)?;
    println!("measured on the virtual board:\n{}", board.measured());
    Ok(())
}
