//! Signals to this process as flags: one asks for the end, one for counting from zero.

use std::{
    io,
    sync::{Arc, atomic::AtomicBool},
};

use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1},
    flag::register,
};
use thiserror::Error;

/// Signals that ask a process to end. SIGHUP comes when a terminal is closed, and to a stopped process whose parent has
/// ended.
pub const END: [i32; 3] = [SIGINT, SIGTERM, SIGHUP];

/// A signal cannot be handled.
#[derive(Debug, Error)]
#[error("signals cannot be handled")]
pub struct SignalError(#[from] io::Error);

/// A flag that the signals of [`END`] set.
///
/// # Errors
/// The system refuses a handler.
pub fn stop_flag() -> Result<Arc<AtomicBool>, SignalError> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in END {
        register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

/// A flag that SIGUSR1 sets. It asks a stage to count and to measure from zero.
///
/// # Errors
/// The system refuses a handler.
pub fn reset_flag() -> Result<Arc<AtomicBool>, SignalError> {
    let reset = Arc::new(AtomicBool::new(false));
    register(SIGUSR1, Arc::clone(&reset))?;
    Ok(reset)
}
