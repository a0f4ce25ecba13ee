//! The command line of a benchmark.

use std::path::PathBuf;

use clap::Parser;

/// Arguments of a benchmark.
#[derive(Parser)]
pub struct Arguments {
    /// Takes few samples: shows that everything works, not how fast.
    #[arg(long, visible_alias = "test")]
    pub quick: bool,
    /// Writes the figures to this file as well.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

impl Arguments {
    /// The arguments of this process; ends the process if they are wrong.
    pub fn read() -> Self {
        let arguments = Self::parse();
        let _ = arguments.bench;
        arguments
    }
}
