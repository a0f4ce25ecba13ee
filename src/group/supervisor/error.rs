//! Why a supervisor cannot begin, or ends a run.

use std::{io, path::PathBuf};

use pipeline::channel::{BoardError, ChannelError};
use thiserror::Error;

use super::super::{launch::LaunchError, signals::SignalError};

/// Why a supervisor cannot begin, or ends a run.
#[derive(Debug, Error)]
pub enum SupervisorError {
    /// The file of the log cannot be created.
    #[error("--log-folder: {} cannot be written", .path.display())]
    Log {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The group runs another machine.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// Signals cannot be handled.
    #[error(transparent)]
    Signals(#[from] SignalError),
    /// The kernel does not tell when processes end.
    #[error("the ends of processes cannot be watched")]
    Watch(#[source] io::Error),
    /// No command line can be made for a stage.
    #[error(transparent)]
    Launch(#[from] LaunchError),
    /// The program of a stage cannot be started.
    #[error("{stage}: \"{program}\" cannot be started")]
    Start {
        /// The stage.
        stage: &'static str,
        /// Its program.
        program: String,
        /// What the system says.
        source: io::Error,
    },
    /// The exit status of a stage cannot be read.
    #[error("{stage}: its exit status cannot be read")]
    Status {
        /// The stage.
        stage: &'static str,
        /// What the system says.
        source: io::Error,
    },
    /// A channel of the group cannot be read.
    #[error(transparent)]
    Channel(#[from] ChannelError),
    /// A stage ended and must not be started again, or did not end as it was asked to.
    #[error("{what}{last_lines}")]
    Ended {
        /// The stages with the causes, the first one first.
        what: String,
        /// The last lines of the stage, each on a line of its own.
        last_lines: String,
    },
}
