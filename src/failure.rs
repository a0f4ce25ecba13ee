//! How a command can fail, and the exit code that says so.

use std::{fmt, process::ExitCode};

/// Why a command ended without doing what was asked.
#[derive(Debug)]
pub enum Failure {
    /// The run failed: exit code 1.
    Run(String),
    /// The command line or a file is wrong: exit code 2, the code that clap uses too.
    Usage(String),
}

impl Failure {
    /// What was asked cannot be understood.
    pub fn usage(error: impl fmt::Display) -> Self {
        Self::Usage(error.to_string())
    }

    /// What was asked was understood and did not work out.
    pub fn run(error: impl fmt::Display) -> Self {
        Self::Run(error.to_string())
    }

    /// 1 or 2.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Run(_) => ExitCode::from(1),
            Self::Usage(_) => ExitCode::from(2),
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Run(text) | Self::Usage(text) => f.write_str(text),
        }
    }
}
