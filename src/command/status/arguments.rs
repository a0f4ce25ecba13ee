//! The arguments of `hydraxis status`.

use std::path::PathBuf;

use clap::Args;
use pipeline::channel::Prefix;

/// `status`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis status                          the one group that runs
  hydraxis status --prefix demo --watch    again every second, until Ctrl-C
  hydraxis status --json - | jq .axes      for programs
  hydraxis status --reset                  and let all stages count and measure from zero again

Everything is read from shared memory, from two channels that no stage reads: watching costs the loops nothing.
Exit codes: 0 all stages are well, 1 no such group runs, or one of its stages is silent.")]
pub struct StatusArguments {
    /// Name of the group's channels; without it the one group that runs
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Again every second, until Ctrl-C or the end of the group
    #[arg(long, conflicts_with = "json")]
    pub watch: bool,
    /// Then let all stages count losses and misses and measure latencies from zero again
    #[arg(long)]
    pub reset: bool,
    /// Write the same as JSON, to a file or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
