//! The release of ticks in real time.

use pipeline::{
    message::MissCause,
    stage::{Turn, monotonic_ns},
};

/// Releases ticks at absolute times: tick k is due at start + (k - first) periods.
pub struct Timer {
    start_ns: u64,
    period_ns: u64,
    first: u64,
    next: u64,
}

impl Timer {
    /// Tick `first` is due one period from now.
    pub fn new(period_ns: u64, first: u64) -> Self {
        Self { start_ns: monotonic_ns() + period_ns, period_ns, first, next: first }
    }

    /// When `tick` is due, on the monotonic clock.
    pub fn due_ns(&self, tick: u64) -> u64 {
        self.start_ns + (tick - self.first) * self.period_ns
    }

    /// Sleeps until the next tick. Returns the number of the tick and the time at which it was due, or `None` if a
    /// signal came first. Ticks whose whole period has passed are counted as missed, and their numbers are left out, so
    /// that readers of the samples see the gap.
    pub fn release(&mut self, turn: &mut Turn) -> Option<(u64, u64)> {
        let due_ns = self.due_ns(self.next);
        if !turn.sleep_until(due_ns) {
            return None;
        }
        let now = turn.release(due_ns);
        let passed = now.saturating_sub(due_ns) / self.period_ns;
        let tick = self.next + passed;
        turn.skip(passed, tick.saturating_sub(1), MissCause::LateRelease);
        self.next = tick + 1;
        Some((tick, self.due_ns(tick)))
    }
}
