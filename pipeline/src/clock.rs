//! `CLOCK_MONOTONIC`: the only clock of the loops, so that setting the date disturbs nothing. It stands still while the
//! computer is suspended, which [`asleep_ns`] tells.

use rustix::{
    io::Errno,
    thread::clock_nanosleep_absolute,
    time::{ClockId, Timespec, clock_gettime},
};

const NANOSECONDS: u64 = 1_000_000_000;

/// Present time, ns.
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * NANOSECONDS + now.tv_nsec as u64
}

/// Time for which the computer has been suspended since it started, ns; too little by what passes between two looks at
/// the clocks, never too much.
pub fn asleep_ns() -> u64 {
    let since_start = clock_gettime(ClockId::Boottime);
    let since_start_ns = since_start.tv_sec as u64 * NANOSECONDS + since_start.tv_nsec as u64;
    // Read last: a process that is interrupted here has not slept.
    since_start_ns.saturating_sub(monotonic_ns())
}

/// Sleeps until an absolute time, ns; returns early only for a signal. A stage's loop uses
/// [`crate::stage::Turn::sleep_until`].
pub fn sleep_until(deadline_ns: u64) {
    let request = Timespec { tv_sec: (deadline_ns / NANOSECONDS) as i64, tv_nsec: (deadline_ns % NANOSECONDS) as i64 };
    let slept = clock_nanosleep_absolute(ClockId::Monotonic, &request);
    debug_assert!(matches!(slept, Ok(()) | Err(Errno::INTR)), "the arguments are right by construction");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_computer_that_is_awake_does_not_sleep() {
        let before = (0..100).map(|_| asleep_ns()).max().unwrap();
        sleep_until(monotonic_ns() + 20_000_000);
        assert!(asleep_ns() < before + 1_000_000);
    }

    #[test]
    fn sleeping_ends_at_or_after_the_deadline() {
        let deadline = monotonic_ns() + 2_000_000;
        sleep_until(deadline);
        assert!(monotonic_ns() >= deadline);
        // A deadline that has passed ends the sleep at once.
        sleep_until(deadline - 1_000_000);
    }
}
