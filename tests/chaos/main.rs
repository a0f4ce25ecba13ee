//! Whole groups under random faults: kills, stops, clients that come and go, and no core to work on.
//!
//! `HYDRAXIS_CHAOS_KILLS` is how many processes are killed in all, half of them in real time and half in lock-step;
//! `HYDRAXIS_CHAOS_SEED` repeats the order of a failure's faults. In real time what they meet differs each time.

mod dice;
mod group;
#[path = "../harness/mod.rs"]
mod harness;
mod lives;
mod lock_step;
mod real_time;
mod watch;

/// Kills in each of the two clocks.
fn kills() -> u64 {
    harness::variable::<u64>("HYDRAXIS_CHAOS_KILLS", 16).div_ceil(2)
}
