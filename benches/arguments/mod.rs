//! What a benchmark can be told.

use std::path::PathBuf;

use clap::Parser;

/// The command line of a benchmark.
#[derive(Parser)]
pub struct Arguments {
    /// Few samples: shows that everything works, not how fast.
    #[arg(long, visible_alias = "test")]
    pub quick: bool,
    /// Writes the figures here as well.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Sent by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

impl Arguments {
    /// What was typed; ends the program if that cannot be understood.
    pub fn read() -> Self {
        let arguments = Self::parse();
        let _ = arguments.bench;
        arguments
    }
}
