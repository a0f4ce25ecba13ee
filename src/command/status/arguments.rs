//! The arguments of `hydraxis status`.

use std::path::PathBuf;

use clap::Args;
use pipeline::channel::Prefix;

/// `status`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis status                          the only group that runs
  hydraxis status --prefix demo --watch    again every second, until Ctrl-C
  hydraxis status --json - | jq .axes      for programs
  hydraxis status --reset                  shows the figures; then all stages count and measure from zero again

Shows stages, channels, latencies and axes. It listens for half a second to two channels that no stage reads, so the
loops are not slowed down. Exit codes: 0 all stages are well, 1 no such group runs, or a stage is silent for more than a
second.")]
pub struct StatusArguments {
    /// Name of the group [default: the only group that runs]
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Show the figures every second, until Ctrl-C or the end of the group
    #[arg(long, conflicts_with = "json")]
    pub watch: bool,
    /// Afterwards all stages count losses and missed deadlines and measure latencies from zero again
    #[arg(long)]
    pub reset: bool,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
