//! `CLOCK_MONOTONIC`: the only clock of the project, so that setting the date disturbs nothing.

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
    fn sleeping_ends_at_or_after_the_deadline() {
        let deadline = monotonic_ns() + 2_000_000;
        sleep_until(deadline);
        assert!(monotonic_ns() >= deadline);
        // A deadline that has passed ends the sleep at once.
        sleep_until(deadline - 1_000_000);
    }
}
