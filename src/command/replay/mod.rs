//! `hydraxis replay`: a recording through the cores of the stages, in one process.
//!
//! ```text
//! verify:   plant -> reading -> sample -> snapshot, command     each core gets what was recorded, and must answer it
//! live:     readings, requests, references, stops -> sensor-proc, ident-proc, control-proc as processes
//! compare:  recorded samples, commands, references, requests -> identifiers, controller     beside what was
//! ```
//!
//! | file | what it holds |
//! |---|---|
//! | `machine` | the machine of a recording |
//! | `feed` | the messages of a recording, channel by channel |
//! | `controller` | the controller with the inputs that its recorded commands name |
//! | `verify`, `difference` | every message made again, bit for bit |
//! | `live`, `source` | the recording in the place of the plant of a living group |
//! | `compare`, `figures` | predictions and commands of another estimator or model |
//! | `report` | text and JSON |

mod compare;
mod controller;
mod difference;
mod feed;
mod figures;
mod live;
mod machine;
mod report;
pub mod source;
mod state;
mod verify;

use std::{net::SocketAddr, path::PathBuf};

use clap::Args;
use pipeline::channel::Prefix;

use crate::{
    arguments::values::setting,
    failure::Failure,
    group::page::LISTEN,
    report::output::{Output, expect_one_stdout, is_stdout},
};
use compare::compare;
use live::live;
use machine::Recorded;
use verify::verify;

/// `replay`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis run --lockstep --duration 60s --record run.mcap
  hydraxis replay run.mcap --verify                                        bit for bit, or the first difference
  hydraxis replay run.mcap --set axis.boom.identification.estimator=constant:0.995
  hydraxis replay monday.mcap --live --monitor                             on the page, through stages as processes
  hydraxis replay monday.mcap --model new-model.toml --csv beside.csv      what another model would have commanded

Without --verify, identification and controller of today run on the recorded samples, with the values of --model and
--set in the place of the recorded ones. The tables show how well their models would have predicted, and what they
would have commanded at each tick, after the motion and the commands that were. Machine file, model and references come
out of the recording. Exit codes: 0 done, 1 a difference was found, 2 bad usage or no recording.")]
pub struct ReplayArguments {
    /// A recording, or a black box
    #[arg(value_name = "FILE.mcap")]
    pub file: PathBuf,
    /// Compute every message of a run in lock-step again, and name the first difference
    #[arg(long, conflicts_with_all = ["settings", "model", "csv"])]
    pub verify: bool,
    /// Replace the value of a key of the recorded machine file; may be given several times
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = setting)]
    pub settings: Vec<(String, String)>,
    /// Model file of `hydraxis commission`; its values replace those of the recording
    #[arg(long, value_name = "MODEL.toml")]
    pub model: Option<PathBuf>,
    /// Write predictions and commands of every tick as CSV to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Give the recording to a group of living stages, in real time; nothing real moves
    #[arg(long, conflicts_with_all = ["verify", "csv"])]
    pub live: bool,
    /// With --live, lock-step instead of real time
    #[arg(long, requires = "live")]
    pub lockstep: bool,
    /// With --live, record the group to a new file
    #[arg(long, value_name = "NEW.mcap", requires = "live")]
    pub record: Option<PathBuf>,
    /// With --live, name of the group
    #[arg(long, requires = "live")]
    pub prefix: Option<Prefix>,
    /// With --live, also show the group as a page for browsers
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, require_equals = true, default_missing_value = LISTEN,
        requires = "live")]
    pub monitor: Option<SocketAddr>,
}

/// Runs the command.
pub fn run(arguments: &ReplayArguments) -> Result<(), Failure> {
    expect_one_stdout(&[("--json", &arguments.json), ("--csv", &arguments.csv)])?;
    let recorded = Recorded::open(&arguments.file)?;
    if arguments.live {
        return live(&recorded, arguments);
    }
    let mut output = Output::open(arguments.json.as_deref())?;
    if arguments.csv.as_deref().is_some_and(is_stdout) {
        output = output.without_tables();
    }
    let file = arguments.file.display().to_string();
    if arguments.verify {
        let report = verify(&recorded)?;
        output.write(|| report.text(&file), &report)?;
        return report.verdict();
    }
    let report = compare(&recorded, arguments)?;
    Ok(output.write(|| report.text(&file), &report)?)
}
