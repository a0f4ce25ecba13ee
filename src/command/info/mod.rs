//! `hydraxis info`: what a recording holds, on one screen.

mod contents;

use std::path::PathBuf;

use clap::Args;

use crate::{failure::Failure, recording::reading::Reading, report::output::Output};
use contents::ContentsReport;

/// `info`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis info demo.mcap
  hydraxis info demo.mcap --events                 each change of mode and of controller
  hydraxis info fault-2026-01-31T10-20-30.125Z-demo.mcap --json -

A file without an end, as a kill or a full disk leaves it, is read as far as it goes. Exit codes: 0 read, 2 no
recording.")]
pub struct InfoArguments {
    /// A recording, or a black box
    #[arg(value_name = "FILE.mcap")]
    pub file: PathBuf,
    /// Show all events, not only what fits on a screen
    #[arg(long)]
    pub events: bool,
    /// Write what was found as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &InfoArguments) -> Result<(), Failure> {
    let output = Output::open(arguments.json.as_deref())?;
    let reading = Reading::open(&arguments.file).map_err(Failure::usage)?;
    let report = ContentsReport::read(reading).map_err(Failure::usage)?;
    if let Some(damage) = report.without_channel() {
        let file = arguments.file.display();
        return Err(Failure::usage(format!(
            "{file}: found no channel ({damage}); allowed: a recording, or a black box"
        )));
    }
    Ok(output.write(|| report.text(&arguments.file.display().to_string(), arguments.events), &report)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{Facts, file::RecordingFile};
    use pipeline::message::EncoderSample;

    #[test]
    fn a_file_without_a_channel_is_no_recording() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("run.mcap");
        for with_channel in [false, true] {
            let _ = std::fs::remove_file(&file);
            let mut recording = RecordingFile::create(&file, &Facts::new(), &[], 0).unwrap();
            if with_channel {
                recording.add_channel::<EncoderSample>().unwrap();
            }
            recording.finish(&Facts::new()).unwrap();
            let arguments = InfoArguments { file: file.clone(), events: false, json: Some(folder.path().join("j")) };
            let said = run(&arguments).map_err(|failure| failure.to_string());
            match said {
                Ok(()) => assert!(with_channel),
                Err(said) => assert!(!with_channel && said.contains("found no channel"), "{said}"),
            }
        }
    }
}
