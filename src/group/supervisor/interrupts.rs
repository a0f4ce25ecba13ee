//! SIGINT, SIGTERM and SIGHUP to the supervisor: the first ends the run in order, another one ends it faster.

use signal_hook::iterator::Signals;

use crate::group::signals::{END, SignalError};

/// The signals that ask for the end.
pub struct Interrupts {
    signals: Signals,
    any: bool,
}

impl Interrupts {
    /// Handles the signals from now on.
    ///
    /// # Errors
    /// The system refuses a handler.
    pub fn new() -> Result<Self, SignalError> {
        Ok(Self { signals: Signals::new(END)?, any: false })
    }

    /// Whether a signal has come since the last call of this function.
    pub fn again(&mut self) -> bool {
        let came = self.signals.pending().count() > 0;
        self.any |= came;
        came
    }

    /// Whether a signal has ever come.
    pub fn any(&mut self) -> bool {
        self.again();
        self.any
    }
}
