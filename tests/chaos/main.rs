//! Whole groups under random faults: killed and stopped stages, stops of the axes, clients and operators that come,
//! hang and go, other starts of the same name, foreign files, full memory, busy cores.
//!
//! `HYDRAXIS_CHAOS_KILLS` is the number of processes that are killed, half of them in real time and half in lock-step.
//! The long form (`--ignored`) kills 500.
//! `HYDRAXIS_CHAOS_SEED` repeats a sequence of faults. In real time the state that a fault meets differs from run to
//! run.

mod group;
#[path = "../harness/mod.rs"]
mod harness;
mod lives;
mod lock_step;
mod real_time;
mod stops;
mod watch;

use harness::Dice;

/// The dice of a test that kills so many processes.
fn dice(test: &'static str, kills: u64) -> Dice {
    Dice::new(test, "HYDRAXIS_CHAOS_SEED", &format!("HYDRAXIS_CHAOS_KILLS={kills}"))
}

/// Number of kills with each of the two clocks.
fn kills() -> u64 {
    harness::variable::<u64>("HYDRAXIS_CHAOS_KILLS", 16).div_ceil(2)
}

/// Processes that each test of the long form kills.
const MANY_KILLS: u64 = 250;
