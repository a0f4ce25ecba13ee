//! Late commands and late samples of the stage, in real time, and clocks that cannot be trusted.

use pipeline::{
    machine::{Machine, Timing, samples_of},
    stage::asleep_ns,
};

use crate::axis::patience;

/// Late commands in a row that latch the axes at the least: a single one is due to the scheduler, two are a trend.
const LEAST_LATE: usize = 2;

/// Least time of a suspend, ns. No computer is back sooner.
const LEAST_SLEEP: u64 = 100_000_000;

/// Counts commands that are late: that go out more than a period after their samples were acquired.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Deadlines {
    period_ns: u64,
    limit: usize,
    late_in_a_row: usize,
}

impl Deadlines {
    /// As many late commands in a row as fit into `feedback_timeout` are too many.
    pub fn new(machine: &Machine) -> Self {
        let timing = &machine.timing;
        Self {
            period_ns: timing.period.as_nanos() as u64,
            limit: samples_of(timing.feedback_timeout, timing.period).max(LEAST_LATE),
            late_in_a_row: 0,
        }
    }

    /// Whether too many commands in a row are late, with one sent at `now` for a sample acquired at `acquired`, ns.
    pub fn are_missed(&mut self, now: u64, acquired: u64) -> bool {
        let is_late = now.saturating_sub(acquired) > self.period_ns;
        self.late_in_a_row = if is_late { self.late_in_a_row.saturating_add(1) } else { 0 };
        self.late_in_a_row >= self.limit
    }
}

/// The age of the newest sample that was acted on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FeedbackAge {
    timeout_ns: u64,
    /// Time without a sample from which on the valves are neutral.
    silence_ns: u64,
    /// When a sample was acted on last; none before the first.
    heard_ns: Option<u64>,
    /// When that sample was acquired; none before the first.
    acquired_ns: Option<u64>,
    /// The controller has been told that the samples have stopped.
    is_lost: bool,
    sleep: Sleep,
}

impl FeedbackAge {
    /// Before the first sample.
    pub fn new(machine: &Machine) -> Self {
        let Timing { period, feedback_timeout, .. } = machine.timing;
        let timeout_ns = feedback_timeout.as_nanos() as u64;
        let silence_ns = (patience(period.as_secs_f64()) + 1) * period.as_nanos() as u64;
        Self {
            timeout_ns,
            silence_ns: silence_ns.min(timeout_ns),
            heard_ns: None,
            acquired_ns: None,
            is_lost: false,
            sleep: Sleep::new(),
        }
    }

    /// Whether the computer has been suspended since the last call; `asleep` is [`asleep_ns`].
    pub fn was_suspended(&mut self, asleep: u64) -> bool {
        self.sleep.was_suspended(asleep)
    }

    /// Whether a sample acquired at `acquired` says nothing of `now`, ns. One from the future is as useless.
    pub fn is_too_old(&self, now: u64, acquired: u64) -> bool {
        now.checked_sub(acquired).is_none_or(|age| age > self.timeout_ns)
    }

    /// Whether the samples have stopped by `now`, ns.
    pub fn has_stopped(&self, now: u64) -> bool {
        self.acquired_ns.is_some_and(|acquired| self.is_too_old(now, acquired))
    }

    /// Whether no sample has come for so long by `now`, ns, that axes wait at neutral.
    pub fn is_silent(&self, now: u64) -> bool {
        self.heard_ns.is_some_and(|heard| now.saturating_sub(heard) > self.silence_ns)
    }

    /// Notes that the samples have stopped; true for the first time.
    pub fn lose(&mut self) -> bool {
        !std::mem::replace(&mut self.is_lost, true)
    }

    /// Notes a sample that was acted on at `now`, acquired at `acquired`, ns.
    pub fn renew(&mut self, acquired: u64, now: u64) {
        (self.acquired_ns, self.heard_ns, self.is_lost) = (Some(acquired), Some(now), false);
    }
}

/// Whether the computer has been suspended. Then the machine may have moved, or have been moved, and no clock of the
/// loops knows.
#[derive(Debug, Clone, PartialEq)]
struct Sleep {
    /// The longest time seen, ns.
    asleep_ns: u64,
}

impl Sleep {
    /// From now on.
    pub fn new() -> Self {
        // A single look may be far too little.
        Self { asleep_ns: (0..100).map(|_| asleep_ns()).max().unwrap_or_default() }
    }

    /// Whether the computer has been suspended since the last call; `asleep` is [`asleep_ns`].
    pub fn was_suspended(&mut self, asleep: u64) -> bool {
        let slept = asleep > self.asleep_ns.saturating_add(LEAST_SLEEP);
        self.asleep_ns = self.asleep_ns.max(asleep);
        slept
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn machine(feedback_timeout: u64) -> Machine {
        let mut machine = crate::tests::machine(1);
        machine.timing.feedback_timeout = Duration::from_millis(feedback_timeout);
        machine
    }

    /// For commands that go out so many ms after their samples: whether each is one too many.
    fn missed(late: &[u64], feedback_timeout: u64) -> Vec<bool> {
        let mut deadlines = Deadlines::new(&machine(feedback_timeout));
        let acquired = 1_000_000_000;
        late.iter().map(|late| deadlines.are_missed(acquired + late * 1_000_000, acquired)).collect()
    }

    #[test]
    fn as_many_late_commands_in_a_row_as_fit_into_the_time_out_are_too_many() {
        assert_eq!(missed(&[11, 50, 10, 11, 11, 11, 0], 30), [false, false, false, false, false, true, false]);
        assert_eq!(missed(&[10, 10, 10, 10], 30), [false; 4]);
        // Two at the least.
        assert_eq!(missed(&[11, 9, 11, 11], 1), [false, false, false, true]);
        assert_eq!(missed(&[11; 7], 60), [false, false, false, false, false, true, true]);
    }

    #[test]
    fn samples_have_stopped_after_the_time_out_and_are_lost_once() {
        let mut age = FeedbackAge::new(&machine(30));
        assert!(!age.has_stopped(u64::MAX), "no sample has come yet");
        age.renew(1_000_000_000, 1_000_000_000);
        assert!(!age.has_stopped(1_030_000_000) && age.has_stopped(1_030_000_001));
        assert!(age.is_too_old(2_000_000_000, 2_000_000_001) && !age.is_too_old(2_000_000_001, 2_000_000_001));
        assert!(age.lose() && !age.lose());
        age.renew(2_000_000_000, 2_000_000_000);
        assert!(age.lose());
    }

    #[test]
    fn valves_are_neutral_before_samples_have_stopped_and_no_later() {
        for (timeout, silent) in [(1000, 60_000_000), (30, 30_000_000)] {
            let mut age = FeedbackAge::new(&machine(timeout));
            assert!(!age.is_silent(u64::MAX), "no sample has come yet");
            age.renew(1_000_000_000, 1_000_000_000);
            assert!(!age.is_silent(1_000_000_000 + silent) && age.is_silent(1_000_000_001 + silent));
            // A sample that has taken long is heard now.
            age.renew(1_000_000_000, 1_500_000_000);
            assert!(!age.is_silent(1_500_000_000 + silent) && age.is_silent(1_500_000_001 + silent));
        }
    }

    #[test]
    fn a_suspend_is_told_once() {
        let mut sleep = Sleep { asleep_ns: 5_000_000_000 };
        // Looks that were interrupted tell too little.
        let looks = [5_000_000_000, 4_200_000_000, 5_099_000_000, 5_900_000_000, 5_900_000_000, 5_000_000_000];
        assert_eq!(looks.map(|asleep| sleep.was_suspended(asleep)), [false, false, false, true, false, false]);
        assert!(!Sleep::new().was_suspended(asleep_ns()));
    }
}
