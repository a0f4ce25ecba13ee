//! `hydraxis report`: what happened in a recorded run, as one page for people.
//!
//! ```text
//! recording --story, once through--> lines, models, latencies, events --page--> HTML
//! ```

mod latency;
mod line;
mod models;
mod page;
mod spans;
mod story;
mod teeth;
mod timeline;
mod verdict;
mod watch;

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use clap::Args;

use crate::{
    failure::Failure,
    recording::reading::Reading,
    report::output::{OutputError, create, is_stdout},
};
use story::Story;
use verdict::Verdict;

/// `report`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis report demo.mcap                        writes demo.html
  hydraxis report demo.mcap --output -             to standard output
  hydraxis report fault-2026-01-31T10-20-30.125Z-demo.mcap

One HTML file that needs no other file, no network and no script, and prints on A4: a verdict in words; what ran; who
commanded each axis, with faults and events over time; the bucket's teeth and their cut; per axis reference, position,
error, command, the models with the curve of the valve, coefficients and forgetting; latencies by percentile with late
ticks by cause. Exit codes: 0 written, whatever the verdict is; 2 no recording.")]
pub struct ReportArguments {
    /// A recording, or a black box
    #[arg(value_name = "FILE.mcap")]
    pub file: PathBuf,
    /// The page, a file or - for standard output [default: the name of the recording, with the ending .html]
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &ReportArguments) -> Result<(), Failure> {
    let path = arguments.output.clone().unwrap_or_else(|| arguments.file.with_extension("html"));
    let said = write(&arguments.file, &path)?;
    if !is_stdout(&path) {
        print!("{said}");
    }
    Ok(())
}

/// Writes the page about a recording. Returns the verdict, one line for each sentence.
///
/// # Errors
/// The file is no recording, or the page cannot be written.
pub fn write(recording: &Path, path: &Path) -> Result<String, Failure> {
    let name = recording.file_name().unwrap_or_default().to_string_lossy();
    let reading = Reading::open(recording).map_err(Failure::usage)?;
    let story = Story::read(reading).map_err(|failure| failure.about(recording.display().to_string()))?;
    let text = page::html(&story, &name).map_err(|error| Failure::run(error).about("report"))?;
    let mut file = create("--output", path)?;
    let written = file.write_all(text.as_bytes()).and_then(|()| file.flush());
    written.map_err(|source| OutputError::Write { option: "--output", path: path.to_owned(), source })?;
    let verdict = Verdict::new(&story);
    let wrong: String = verdict.wrong.iter().map(|sentence| format!("  {sentence}\n")).collect();
    Ok(format!("{}: {}\n{wrong}", path.display(), verdict.word))
}
