//! Signals to this process as flags: one asks for the end, one for counting from zero, one for neutral valves.

use std::{
    io,
    sync::{Arc, atomic::AtomicBool},
};

use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2},
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
    flag(SIGUSR1)
}

/// A flag that SIGUSR2 sets. It asks control-proc to disarm all axes; the other stages go on.
///
/// # Errors
/// The system refuses a handler.
pub fn off_flag() -> Result<Arc<AtomicBool>, SignalError> {
    flag(SIGUSR2)
}

fn flag(signal: i32) -> Result<Arc<AtomicBool>, SignalError> {
    let flag = Arc::new(AtomicBool::new(false));
    register(signal, Arc::clone(&flag))?;
    Ok(flag)
}
