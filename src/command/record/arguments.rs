//! Arguments of `hydraxis record`.

use std::path::PathBuf;

use clap::Args;
use pipeline::channel::Prefix;

use crate::recording::LIMIT;

/// Fewest bytes of a folder of recordings.
const LEAST: u64 = 16_000_000;

/// `record`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis record                            the only group that runs, into the folder for recordings
  hydraxis record --prefix demo --output demo.mcap
  hydraxis info demo.mcap
  hydraxis export demo.mcap --csv demo.csv

`hydraxis run` in real time starts it by itself. Writes every message of every channel, the machine file and the values
that replaced its own, as MCAP with CDR and ROS 2 schemas, until Ctrl-C or the end of the group. Every 0.1 s what was
read can be read in the file, also after a kill. In a folder the oldest recordings make room for new ones.")]
pub struct RecordArguments {
    /// The group [default: the only one that runs]
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// One new file, of any length
    #[arg(long, value_name = "FILE.mcap", conflicts_with_all = ["folder", "limit"])]
    pub output: Option<PathBuf>,
    /// Folder for recordings [default: $HYDRAXIS_RECORDINGS, $STATE_DIRECTORY, $XDG_STATE_HOME/hydraxis or
    /// ~/.local/state/hydraxis]
    #[arg(long, value_name = "DIR")]
    pub folder: Option<PathBuf>,
    /// Most bytes of all recordings in the folder, such as 500MB or 2GB
    #[arg(long, value_name = "SIZE", default_value = LIMIT, value_parser = size)]
    pub limit: u64,
    /// The group waits for this recorder, so that no message is missed
    #[arg(long, hide = true, requires = "parent")]
    pub lockstep: bool,
    /// End when the process with this number ends, or when standard input does
    #[arg(long, hide = true)]
    pub parent: Option<i32>,
}

/// A number of bytes with its unit.
pub fn size(text: &str) -> Result<u64, String> {
    let allowed = || format!("allowed: {} MB or more, such as 500MB or 2GB", LEAST / 1_000_000);
    let units = [("MB", 1e6), ("GB", 1e9), ("TB", 1e12)];
    let (number, unit) =
        units.iter().find_map(|(unit, size)| Some((text.strip_suffix(unit)?, size))).ok_or_else(allowed)?;
    let bytes = number.trim().parse::<f64>().map_err(|_| allowed())? * unit;
    if bytes >= LEAST as f64 && bytes <= 1e18 { Ok(bytes as u64) } else { Err(allowed()) }
}
