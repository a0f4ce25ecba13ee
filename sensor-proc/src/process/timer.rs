//! The release of ticks in real time.

use pipeline::{
    message::MissCause,
    stage::{Turn, monotonic_ns},
};

/// Readings in a row that wait for long before the ticks are brought forward.
const LONG_WAITS: u32 = 3;

/// When the ticks are brought forward, so that readings do not wait for them.
///
/// The program that sends readings has a clock of its own, and the first reading need not come when the later ones do.
/// A reading that waits for a whole period makes every command that late.
#[derive(Debug, Default)]
pub struct Phase {
    long_waits: u32,
}

impl Phase {
    /// Takes in how long the reading of a tick has waited for it, ns; 0 without a reading. Returns by how much the
    /// ticks are to be brought forward: after three waits in a row of more than a quarter of a period, so that an
    /// eighth is left.
    pub fn judge(&mut self, waited_ns: u64, period_ns: u64) -> Option<u64> {
        self.long_waits = if waited_ns > period_ns / 4 { self.long_waits + 1 } else { 0 };
        (self.long_waits >= LONG_WAITS).then(|| {
            self.long_waits = 0;
            (waited_ns - period_ns / 8).min(period_ns)
        })
    }
}

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

    /// Brings all later ticks forward.
    pub fn bring_forward(&mut self, by_ns: u64) {
        self.start_ns = self.start_ns.saturating_sub(by_ns);
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

#[cfg(test)]
mod tests {
    use super::Phase;

    #[test]
    fn ticks_come_soon_after_readings_whatever_their_phase_was() {
        const PERIOD: u64 = 20_000;
        // Readings at multiples of the period; the ticks have another phase, and the readings' clock runs slow or fast.
        for (first, drift) in [(0, 0), (5_001, 0), (19_999, 0), (12_000, 7), (12_000, -7)] {
            let (mut phase, mut tick, mut reading) = (Phase::default(), first, 0i64);
            let mut long_waits = 0;
            for k in 0..20_000 {
                let waited = (tick as i64 - reading).rem_euclid(PERIOD as i64) as u64;
                long_waits += u32::from(k >= 10 && waited > PERIOD / 4 + 3 * 7);
                tick += PERIOD - phase.judge(waited, PERIOD).unwrap_or(0);
                reading += PERIOD as i64 + drift;
            }
            // With a clock that runs slow a reading comes after its tick once in a while, which makes three long waits:
            // no more often than the clocks are a period apart, of which an eighth is given back.
            let beats = if drift > 0 { 20_000 * 7 / (PERIOD as u32 / 8) + 1 } else { 0 };
            assert!(long_waits <= 3 * beats, "{first} {drift}: {long_waits}");
        }
    }

    #[test]
    fn a_wait_now_and_then_changes_nothing() {
        let mut phase = Phase::default();
        let waits = [900, 900, 0, 900, 900, 200, 900, 900, 250];
        assert!(waits.iter().all(|waited| phase.judge(*waited, 1000).is_none()));
        assert_eq!((phase.judge(900, 1000), phase.judge(900, 1000), phase.judge(900, 1000)), (None, None, Some(775)));
    }
}
