//! The release of ticks in real time.

use pipeline::{
    message::MissCause,
    stage::{Turn, monotonic_ns},
};

/// Readings in a row that wait for long before the ticks are brought forward.
const LONG_WAITS: u32 = 3;
/// What a tick without a reading, or with one that has waited for long, adds to the score of ticks that are too close
/// to the readings; any other tick takes 1 away.
const CLOSE: u32 = 10;
/// The score from which on the ticks are brought forward, and the greatest one.
const TOO_CLOSE: u32 = 4 * CLOSE;
/// Ticks between two times at which they are brought forward by the score.
const PAUSE: u32 = 100;

/// When the ticks are brought forward, so that readings do not wait for them.
///
/// The program that sends readings has a clock of its own, and the first reading need not come when the later ones do.
/// A reading that waits for a whole period makes every command that late.
///
/// Trap: where readings come at the time of the ticks, now before and now after them, some ticks have none, and others
/// have one that has waited for a period. Those are seldom several in a row, so they are counted by a score.
#[derive(Debug, Default)]
pub struct Phase {
    long_waits: u32,
    score: u32,
    pause: u32,
}

impl Phase {
    /// Takes in how long the reading of a tick has waited for it, ns; 0 without a reading. Returns by how much the
    /// ticks are to be brought forward: after three waits in a row of more than a quarter of a period, or many of them
    /// among ticks without a reading, so that an eighth is left.
    pub fn judge(&mut self, waited_ns: u64, period_ns: u64) -> Option<u64> {
        let is_long = waited_ns > period_ns / 4;
        self.long_waits = if is_long { self.long_waits + 1 } else { 0 };
        self.pause = self.pause.saturating_sub(1);
        let is_close = is_long || waited_ns == 0;
        self.score = if is_close { (self.score + CLOSE).min(TOO_CLOSE) } else { self.score.saturating_sub(1) };
        let is_too_close = is_long && self.score == TOO_CLOSE && self.pause == 0;
        (is_too_close || self.long_waits >= LONG_WAITS).then(|| {
            (self.long_waits, self.score, self.pause) = (0, 0, PAUSE);
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
    fn ticks_at_the_time_of_the_readings_are_brought_forward() {
        const PERIOD: i64 = 10_000;
        let (mut phase, mut shift, mut state, mut last) = (Phase::default(), 0, 1_u64, -1);
        let mut without = [0, 0];
        for k in 0..400_i64 {
            // Readings at multiples of the period, up to 300 before or after: seldom two of one kind in a row.
            let mut jitter = |n: i64| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(n as u64 | 1);
                n * PERIOD + (state >> 33) as i64 % 600 - 300
            };
            let tick = k * PERIOD - shift;
            let newest = (last + 1..=k + 1).map(|n| (n, jitter(n))).take_while(|(_, at)| *at < tick).last();
            let waited = newest.map_or(0, |(n, at)| {
                last = n;
                tick - at
            });
            without[usize::from(k >= 200)] += u32::from(waited == 0);
            shift += phase.judge(waited as u64, PERIOD as u64).unwrap_or(0) as i64;
        }
        assert!(without[0] > 3 && without[1] == 0, "{without:?}");
    }

    #[test]
    fn a_wait_now_and_then_changes_nothing() {
        let mut phase = Phase::default();
        for _ in 0..100 {
            let waits = [900, 900, 0].into_iter().chain([200; 30]);
            assert!(waits.into_iter().all(|waited| phase.judge(waited, 1000).is_none()));
        }
        assert_eq!((phase.judge(900, 1000), phase.judge(900, 1000), phase.judge(900, 1000)), (None, None, Some(775)));
    }
}
