//! The arguments of `hydraxis clean`.

use std::path::PathBuf;

use clap::Args;
use pipeline::channel::Prefix;

/// `clean`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis clean --dry-run          which groups there are on this machine, and what is left of the dead
  hydraxis clean                    removes it
  hydraxis clean --prefix demo      the same of one group; refused while it lives

  alive     a member runs: never touched
  dead      no member runs: its files in /dev/shm and its folder hydraxis.NAME in the folder for temporary files are
            removed
  unknown   memory without such a folder, which may be where another TMPDIR points, or another program's: removed only
            with --prefix, and only while no process has it mapped

A group that ends by itself leaves nothing, and `hydraxis run --prefix NAME` removes what is left of that name before it
starts. Exit codes: 0 done, 1 the group of --prefix lives or something could not be removed.")]
pub struct CleanArguments {
    /// Only this group
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Remove nothing, say what would be
    #[arg(long)]
    pub dry_run: bool,
    /// Write what was found and removed as JSON, to a file or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
