//! How a command can fail, and the exit code for each failure.
//!
//! The folders below the commands have one error type for each operation. This file is the only place that maps these
//! errors to exit codes: 2 for a command line or a file that is wrong, the code that clap uses as well; 1 for
//! everything else. A failure is shown with all of its sources, from the operation down to the system call.

use std::{error::Error, fmt, process::ExitCode};

use pipeline::{
    channel::{BoardError, ChannelError},
    machine::MachineError,
};
use thiserror::Error as ThisError;

use crate::{
    arguments::UnknownAxis,
    group::{
        lifeline::LifelineError, operator::OperatorError, preflight::PreflightError, recorder::RecorderError,
        running::UnknownGroup, signals::SignalError, supervisor::SupervisorError,
    },
    model::learned::NothingLearned,
    report::output::OutputError,
};

type AnyError = Box<dyn Error + Send + Sync>;

/// Why a command ended without doing what the user asked for.
#[derive(Debug)]
pub struct Failure {
    cause: Cause,
    error: AnyError,
}

/// Who has to change something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Cause {
    /// The command was understood and failed: exit code 1.
    Run,
    /// The command line or a file is wrong: exit code 2.
    Usage,
}

/// An error and what it is about.
#[derive(Debug, ThisError)]
#[error("{subject}: {source}")]
struct About {
    subject: String,
    source: AnyError,
}

/// An error and what to do about it.
#[derive(Debug, ThisError)]
#[error("{source}{advice}")]
struct Advised {
    advice: String,
    source: AnyError,
}

impl Failure {
    /// The command line or a file is wrong.
    pub fn usage(error: impl Into<AnyError>) -> Self {
        Self { cause: Cause::Usage, error: error.into() }
    }

    /// The command was understood and failed.
    pub fn run(error: impl Into<AnyError>) -> Self {
        Self { cause: Cause::Run, error: error.into() }
    }

    /// Puts `subject` in front of the message.
    pub fn about(self, subject: impl Into<String>) -> Self {
        let Self { cause, error } = self;
        Self { cause, error: About { subject: subject.into(), source: error }.into() }
    }

    /// Puts what to do after the message.
    pub fn advising(self, advice: impl Into<String>) -> Self {
        let Self { cause, error } = self;
        Self { cause, error: Advised { advice: advice.into(), source: error }.into() }
    }

    /// The error itself, where it is of this type.
    pub fn of_type<T: Error + 'static>(&self) -> Option<&T> {
        self.error.downcast_ref()
    }

    /// 1 or 2.
    pub fn exit_code(&self) -> ExitCode {
        match self.cause {
            Cause::Run => ExitCode::from(1),
            Cause::Usage => ExitCode::from(2),
        }
    }
}

impl fmt::Display for Failure {
    /// The error, then each of its sources that the text does not name yet.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = self.error.to_string();
        let mut source = self.error.source();
        while let Some(error) = source {
            let part = error.to_string();
            if !text.contains(&part) {
                text += &format!(": {part}");
            }
            source = error.source();
        }
        f.write_str(&text)
    }
}

/// Failures that are collected, so that the user sees all of them at once.
#[derive(Debug, Default)]
pub struct Failures(Vec<Failure>);

impl Failures {
    /// The value of `result`; or nothing, and its failure is collected.
    pub fn take<T>(&mut self, result: Result<T, impl Into<Failure>>) -> Option<T> {
        result.map_err(|error| self.0.push(error.into())).ok()
    }

    /// Collects failures.
    pub fn extend(&mut self, failures: impl IntoIterator<Item = impl Into<Failure>>) {
        self.0.extend(failures.into_iter().map(Into::into));
    }

    /// `checked` if nothing was collected; else one failure with all messages. It is a failure of usage if any of them
    /// is.
    pub fn verdict<T>(self, checked: Option<T>) -> Result<T, Failure> {
        if let Some(checked) = checked.filter(|_| self.0.is_empty()) {
            return Ok(checked);
        }
        let text: Vec<String> = self.0.iter().map(ToString::to_string).collect();
        let is_usage = self.0.iter().any(|failure| failure.cause == Cause::Usage);
        Err(if is_usage { Failure::usage(text.join("\n")) } else { Failure::run(text.join("\n")) })
    }
}

impl From<MachineError> for Failure {
    fn from(error: MachineError) -> Self {
        Self::usage(error)
    }
}

impl From<NothingLearned> for Failure {
    fn from(error: NothingLearned) -> Self {
        Self::usage(error)
    }
}

impl From<UnknownAxis> for Failure {
    fn from(error: UnknownAxis) -> Self {
        Self::usage(error)
    }
}

impl From<ChannelError> for Failure {
    fn from(error: ChannelError) -> Self {
        Self::run(error)
    }
}

impl From<BoardError> for Failure {
    fn from(error: BoardError) -> Self {
        Self::run(error)
    }
}

impl From<RecorderError> for Failure {
    fn from(error: RecorderError) -> Self {
        Self::run(error).about("--record")
    }
}

impl From<LifelineError> for Failure {
    fn from(error: LifelineError) -> Self {
        Self::run(error)
    }
}

impl From<SignalError> for Failure {
    fn from(error: SignalError) -> Self {
        Self::run(error)
    }
}

impl From<OutputError> for Failure {
    fn from(error: OutputError) -> Self {
        match error {
            OutputError::Create { .. } | OutputError::NoPicture { .. } | OutputError::StandardOutputTwice { .. } => {
                Self::usage(error)
            }
            _ => Self::run(error),
        }
    }
}

impl From<OperatorError> for Failure {
    fn from(error: OperatorError) -> Self {
        match error {
            OperatorError::Board(BoardError::OtherMachine { .. }) => Self::usage(error),
            _ => Self::run(error),
        }
    }
}

impl From<SupervisorError> for Failure {
    fn from(error: SupervisorError) -> Self {
        match error {
            SupervisorError::Log { .. } => Self::usage(error),
            _ => Self::run(error),
        }
    }
}

impl From<PreflightError> for Failure {
    fn from(error: PreflightError) -> Self {
        match error {
            PreflightError::LogFolder(_) | PreflightError::Program { .. } => Self::usage(error),
            _ => Self::run(error),
        }
    }
}

impl From<UnknownGroup> for Failure {
    fn from(error: UnknownGroup) -> Self {
        match error {
            UnknownGroup::None => Self::run(error),
            UnknownGroup::Several(_) | UnknownGroup::Machine { .. } => Self::usage(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_names_every_source_once() {
        let file = std::path::PathBuf::from("x.json");
        let source = std::io::Error::other("disk full");
        let failure = Failure::from(OutputError::Create { option: "--json", path: file, source }).about("boom");
        assert_eq!(
            failure.to_string(),
            "boom: --json: x.json cannot be written: disk full; allowed: a file that this user may write"
        );
        assert_eq!(failure.cause, Cause::Usage);
    }

    #[test]
    fn one_failure_of_usage_makes_all_of_them_one() {
        let mut failures = Failures::default();
        assert_eq!(failures.take(Ok::<_, Failure>(3)), Some(3));
        failures.extend([Failure::run("a"), Failure::usage("b")]);
        let all = failures.verdict(Some(())).unwrap_err();
        assert_eq!((all.to_string().as_str(), all.cause), ("a\nb", Cause::Usage));
    }
}
