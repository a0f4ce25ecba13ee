//! Who may use the machine's cores: real-time groups of one test binary take turns.
//!
//! `HYDRAXIS_STRICT_TIMING=1` is for machines with a real-time kernel and idle cores. In this mode no other real-time
//! group of the test binary runs beside a test, and time bounds hold without an allowance for a busy machine.

use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

static CORES: RwLock<()> = RwLock::new(());

/// A test's right to run real-time groups, until it is dropped.
pub enum Cores {
    Alone(#[expect(dead_code, reason = "held until it is dropped")] RwLockWriteGuard<'static, ()>),
    Shared(#[expect(dead_code, reason = "held until it is dropped")] RwLockReadGuard<'static, ()>),
}

/// Whether the time bounds of a machine with a real-time kernel are to hold.
pub fn is_strict() -> bool {
    std::env::var("HYDRAXIS_STRICT_TIMING").is_ok_and(|value| !value.is_empty() && value != "0")
}

/// Waits until no other real-time group of this test binary runs, and keeps others waiting. For tests that measure a
/// time, or that load the cores.
pub fn alone() -> Cores {
    Cores::Alone(CORES.write().unwrap_or_else(PoisonError::into_inner))
}

/// Waits until no test of this binary runs alone. For tests of real-time groups whose result does not depend on the
/// load: they may run side by side. In strict mode each of them runs alone.
pub fn shared() -> Cores {
    if is_strict() {
        return alone();
    }
    Cores::Shared(CORES.read().unwrap_or_else(PoisonError::into_inner))
}
