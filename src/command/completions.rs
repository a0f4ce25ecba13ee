//! `hydraxis completions`: the script by which a shell completes subcommands and options.

use clap::{Args, CommandFactory};
use clap_complete::{Shell, generate};

use crate::{failure::Failure, report::output::show};

/// `completions`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  source <(hydraxis completions bash)                                     in this shell
  hydraxis completions fish > ~/.config/fish/completions/hydraxis.fish    in each shell to come

The Debian package has the scripts for bash, zsh and fish where these shells look for them.")]
pub struct CompletionsArguments {
    /// The shell
    pub shell: Shell,
}

/// Writes the script to standard output.
pub fn run(arguments: &CompletionsArguments) -> Result<(), Failure> {
    let mut script = Vec::new();
    generate(arguments.shell, &mut super::Arguments::command(), "hydraxis", &mut script);
    Ok(show(&String::from_utf8_lossy(&script))?)
}
