//! SIGINT, SIGTERM and SIGHUP to the supervisor: the first ends the run in order, another one ends it faster. SIGTSTP,
//! which is Ctrl-Z, stops the supervisor and with it all axes.

use signal_hook::{consts::SIGTSTP, iterator::Signals, low_level::emulate_default_handler};

use crate::group::signals::{END, SignalError};

/// The signals that ask for something.
pub struct Interrupts {
    signals: Signals,
    any: bool,
    is_suspended: bool,
}

impl Interrupts {
    /// Handles the signals from now on.
    ///
    /// # Errors
    /// The system refuses a handler.
    pub fn new() -> Result<Self, SignalError> {
        let signals = Signals::new(END.into_iter().chain([SIGTSTP]))?;
        Ok(Self { signals, any: false, is_suspended: false })
    }

    /// Whether a signal that asks for the end has come since the last call of this function.
    pub fn again(&mut self) -> bool {
        let mut came = false;
        for signal in self.signals.pending() {
            if signal == SIGTSTP {
                self.is_suspended = true;
            } else {
                came = true;
            }
        }
        self.any |= came;
        came
    }

    /// Whether a signal has ever asked for the end.
    pub fn any(&mut self) -> bool {
        self.again();
        self.any
    }

    /// Stops this process if Ctrl-Z has asked for it, after `prepare`. Returns when it is continued.
    pub fn suspend(&mut self, prepare: impl FnOnce()) {
        self.again();
        if std::mem::take(&mut self.is_suspended) {
            prepare();
            // It fails for signals that have no such action, which this one has.
            let _ = emulate_default_handler(SIGTSTP);
        }
    }
}
