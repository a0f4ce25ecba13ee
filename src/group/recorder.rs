//! The recorder of a run in lock-step: a process that records from the first tick on, and for which the loop waits.

use std::{
    io::{self, BufRead, BufReader, Read},
    os::unix::process::CommandExt,
    path::Path,
    process::{Child, ChildStdout, Command, ExitStatus, Stdio},
};

use pipeline::channel::Prefix;
use rustix::process::{Pid, Signal, kill_process};
use thiserror::Error;

/// Why a run cannot be recorded.
#[derive(Debug, Error)]
pub enum RecorderError {
    /// Its process cannot be started, or not be waited for.
    #[error("the recorder cannot be run")]
    Process(#[source] io::Error),
    /// It has failed; it has said why.
    #[error("the recorder ended with {0}")]
    Ended(ExitStatus),
}

/// A recorder that runs.
pub struct LockStepRecorder {
    process: Child,
    said: BufReader<ChildStdout>,
}

impl LockStepRecorder {
    /// Starts a recorder of a group into a new file, and waits until it reads all channels.
    ///
    /// # Errors
    /// It cannot be started, or the file cannot be made.
    pub fn start(prefix: &Prefix, file: &Path) -> Result<Self, RecorderError> {
        let mut command = Command::new(std::env::current_exe().map_err(RecorderError::Process)?);
        command.arg("record").arg("--prefix").arg(prefix.to_string()).arg("--output").arg(file);
        command.arg("--lockstep").arg("--parent").arg(std::process::id().to_string());
        // Ctrl-C on the terminal is for the supervisor, which ends the recorder after the stages.
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).process_group(0);
        let mut process = command.spawn().map_err(RecorderError::Process)?;
        let Some(said) = process.stdout.take() else {
            return Err(RecorderError::Process(io::ErrorKind::BrokenPipe.into()));
        };
        let mut recorder = Self { process, said: BufReader::new(said) };
        let mut line = String::new();
        if recorder.said.read_line(&mut line).map_err(RecorderError::Process)? == 0 {
            let status = recorder.process.wait().map_err(RecorderError::Process)?;
            return Err(RecorderError::Ended(status));
        }
        Ok(recorder)
    }

    /// Ends the recorder when the stages have ended. What it says at its end.
    ///
    /// # Errors
    /// It has failed.
    pub fn finish(mut self) -> Result<String, RecorderError> {
        let _ = kill_process(Pid::from_child(&self.process), Signal::INT);
        let mut said = String::new();
        self.said.read_to_string(&mut said).map_err(RecorderError::Process)?;
        let status = self.process.wait().map_err(RecorderError::Process)?;
        if status.success() { Ok(said) } else { Err(RecorderError::Ended(status)) }
    }
}

impl Drop for LockStepRecorder {
    fn drop(&mut self) {
        // Nothing to do where it has ended.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
