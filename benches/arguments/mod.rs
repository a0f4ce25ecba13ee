//! The command line of a benchmark.

use std::path::PathBuf;

use clap::{CommandFactory, Parser};

/// Arguments of a benchmark.
#[derive(Parser)]
pub struct Arguments {
    /// Takes few samples: shows that everything works, not how fast.
    #[arg(long, visible_alias = "test")]
    pub quick: bool,
    /// Writes the figures to this file as well.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Measures only the section with this name, in a benchmark that has several.
    #[arg(long, value_name = "SECTION")]
    pub only: Option<String>,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

impl Arguments {
    /// The arguments of this process; ends the process if they are wrong. `sections`: those that the benchmark has.
    pub fn read(sections: &[&str]) -> Self {
        let arguments = Self::parse();
        let _ = arguments.bench;
        if let Some(only) = arguments.only.as_deref().filter(|only| !sections.contains(only)) {
            let allowed = if sections.is_empty() { "nothing".to_owned() } else { sections.join(", ") };
            let said = format!("--only: found {only:?}; allowed: {allowed}\n");
            Self::command().error(clap::error::ErrorKind::InvalidValue, said).exit();
        }
        arguments
    }
}
