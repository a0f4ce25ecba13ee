//! SIGINT, SIGTERM and SIGHUP to the supervisor: the first ends the run in order, another one ends it faster.

use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM},
    iterator::Signals,
};

use crate::failure::Failure;

/// The signals that ask for the end.
pub struct Interrupts {
    signals: Signals,
    any: bool,
}

impl Interrupts {
    /// Takes the signals from now on.
    ///
    /// # Errors
    /// The system refuses.
    pub fn new() -> Result<Self, Failure> {
        let signals = Signals::new([SIGINT, SIGTERM, SIGHUP]).map_err(Failure::run)?;
        Ok(Self { signals, any: false })
    }

    /// Whether one has come since this was last asked.
    pub fn again(&mut self) -> bool {
        let came = self.signals.pending().count() > 0;
        self.any |= came;
        came
    }

    /// Whether one has ever come.
    pub fn any(&mut self) -> bool {
        self.again();
        self.any
    }
}
