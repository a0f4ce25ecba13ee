//! Why recordings cannot be read: one type for each operation.

use std::path::PathBuf;

use pipeline::columns::TableError;

/// Why [`Recording::read`](super::Recording::read) fails.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The file is not a table of finite numbers with these columns.
    #[error(transparent)]
    Table(#[from] TableError),
    /// The file has no column with the time, and no period was given.
    #[error("{} (or give the sample period with --period)", .0)]
    NoTime(#[source] TableError),
    /// The file has no column with the name of the input or of the output.
    #[error("{} (choose with --input and --output, in a machine file with axis.NAME.columns)", .0)]
    NoColumn(#[source] TableError),
    /// The file has too few rows for a purpose.
    #[error("{}: found {rows} rows; allowed: at least {needed} {purpose}", file.display())]
    TooFewRows {
        /// The file.
        file: PathBuf,
        /// Rows found.
        rows: usize,
        /// Rows needed.
        needed: usize,
        /// What the rows are needed for, such as "to tell anything".
        purpose: String,
    },
}

/// Why [`Recording::read_all`](super::Recording::read_all) fails: the recording cannot be replayed on a machine.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// The columns of an axis cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The period of the file is not that of the machine.
    #[error(
        "{}: found a period of {found:.6} s; allowed: that of the machine file, timing.period = {expected:.6} s",
        file.display()
    )]
    Period {
        /// The file.
        file: PathBuf,
        /// Period of the file, s.
        found: f64,
        /// Period of the machine, s.
        expected: f64,
    },
}
