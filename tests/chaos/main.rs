//! Whole groups under random faults: killed and stopped stages, clients that come and go, busy cores.
//!
//! `HYDRAXIS_CHAOS_KILLS` is the number of processes that are killed, half of them in real time and half in lock-step.
//! `HYDRAXIS_CHAOS_SEED` repeats a sequence of faults. In real time the state that a fault meets differs from run to
//! run.

mod dice;
mod group;
#[path = "../harness/mod.rs"]
mod harness;
mod lives;
mod lock_step;
mod real_time;
mod watch;

/// Number of kills with each of the two clocks.
fn kills() -> u64 {
    harness::variable::<u64>("HYDRAXIS_CHAOS_KILLS", 16).div_ceil(2)
}
