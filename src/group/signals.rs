//! Signals to a process as flags: the end, and counting from zero again.

use std::sync::{Arc, atomic::AtomicBool};

use crate::failure::Failure;

/// A flag that SIGINT, SIGTERM and SIGHUP set; the last comes when a terminal is closed, and to a stopped process that
/// has lost its parent.
pub fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(Failure::run)?;
    }
    Ok(stop)
}

/// A flag that SIGUSR1 sets: count from zero again.
pub fn reset_flag() -> Result<Arc<AtomicBool>, Failure> {
    let reset = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGUSR1, Arc::clone(&reset)).map_err(Failure::run)?;
    Ok(reset)
}
