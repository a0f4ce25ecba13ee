//! Counters and latencies of a stage.
//!
//! ```text
//! wait   = picked up - sent              work = output sent - picked up
//! jitter = picked up - intended          end to end = command sent - acquired
//! late   if output sent > due + T        cause: the largest of
//!          sent - due (late input), picked up - max(sent, due) (late release), output sent - picked up (long work)
//! ```
//!
//! All times in ns; T is the period, due is the time at which the sample of the tick was due. A tick that was never
//! worked counts as missed too. Trap: measured from the time at which a timer really fired, a loop that is always late
//! looks punctual. So jitter and deadline are measured from the intended time.

use super::monotonic_ns;
use crate::{
    channel::Reader,
    latency::LatencyRecorder,
    message::{ChannelHealth, Message, MissCause, StageHealth, StageState},
};

/// Number of histograms of a stage. One of them is evaluated per heartbeat, since this reads all of its memory.
const HISTOGRAMS: u32 = 4;

/// Counters and histograms of one stage.
pub struct Accounting {
    health: StageHealth,
    wait: LatencyRecorder,
    work: LatencyRecorder,
    end_to_end: LatencyRecorder,
    release_jitter: LatencyRecorder,
    /// When the input of the present tick was sent.
    sent_ns: u64,
    /// When the input of the present tick was picked up.
    picked_up_ns: u64,
    beats: u32,
    resetting: bool,
}

impl Accounting {
    /// All counters at zero.
    pub(super) fn new(stage: u32) -> Self {
        let health = StageHealth {
            stage,
            pid: std::process::id(),
            state: StageState::Ready as u32,
            since_ns: monotonic_ns(),
            ..StageHealth::default()
        };
        Self {
            health,
            wait: LatencyRecorder::new(),
            work: LatencyRecorder::new(),
            end_to_end: LatencyRecorder::new(),
            release_jitter: LatencyRecorder::new(),
            sent_ns: 0,
            picked_up_ns: 0,
            beats: 0,
            resetting: false,
        }
    }

    /// A tick begins with a message that was sent at `sent_ns`.
    pub(super) fn pick_up(&mut self, sent_ns: u64) {
        self.picked_up_ns = monotonic_ns();
        self.sent_ns = sent_ns;
        self.wait.record(self.picked_up_ns.saturating_sub(sent_ns));
    }

    /// A tick begins by a timer that was set to `intended_ns`; returns the time.
    pub(super) fn release(&mut self, intended_ns: u64) -> u64 {
        self.picked_up_ns = monotonic_ns();
        self.sent_ns = intended_ns;
        self.release_jitter.record(self.picked_up_ns.saturating_sub(intended_ns));
        self.picked_up_ns
    }

    /// The output of tick `sequence` is sent at `now`.
    pub(super) fn finish(&mut self, sequence: u64, acquired_ns: u64, now: u64) {
        self.work.record(now.saturating_sub(self.picked_up_ns));
        self.health.samples += 1;
        self.health.header.sequence = sequence;
        self.health.header.acquired_ns = acquired_ns;
        self.health.state = StageState::Running as u32;
    }

    /// Counts tick `sequence` as missed if its output, sent at `now`, is later than one period after `due_ns`.
    pub(super) fn judge(&mut self, sequence: u64, due_ns: u64, period_ns: u64, now: u64) {
        if now <= due_ns.saturating_add(period_ns) {
            return;
        }
        let late_input = self.sent_ns.saturating_sub(due_ns);
        let late_release = self.picked_up_ns.saturating_sub(self.sent_ns.max(due_ns));
        let long_work = now.saturating_sub(self.picked_up_ns);
        let cause = if long_work >= late_input.max(late_release) {
            MissCause::LongWork
        } else if late_release >= late_input {
            MissCause::LateRelease
        } else {
            MissCause::LateInput
        };
        self.health.missed.count(1, sequence, cause);
    }

    /// The valve command was sent, so long after the acquisition of its sample.
    pub(super) fn arrive(&mut self, nanoseconds: u64) {
        self.end_to_end.record(nanoseconds);
    }

    /// Counts ticks that were due and not worked at all, up to `last_tick`.
    pub(super) fn skip(&mut self, ticks: u64, last_tick: u64, cause: MissCause) {
        self.health.missed.count(ticks, last_tick, cause);
    }

    /// Counts a sample with a fault bit.
    pub(super) fn implausible(&mut self) {
        self.health.implausible += 1;
    }

    /// Begins a heartbeat at `now`; the channels follow. With `reset` all figures count from zero again.
    pub(super) fn begin(&mut self, now: u64, reset: bool) {
        self.health.header.sent_ns = now;
        self.health.channel_count = 0;
        self.resetting = reset;
        if reset {
            let StageHealth { header, stage, state, pid, .. } = self.health;
            self.health = StageHealth { header, stage, state, pid, since_ns: now, ..StageHealth::default() };
            [&mut self.wait, &mut self.work, &mut self.end_to_end, &mut self.release_jitter]
                .into_iter()
                .for_each(LatencyRecorder::reset);
        }
    }

    /// Adds a channel that the stage reads.
    pub(super) fn channel<M: Message>(&mut self, reader: &mut Reader<M>) {
        if self.resetting {
            reader.reset_health();
        }
        let health: ChannelHealth = reader.health(self.health.header.sent_ns);
        if let Some(place) = self.health.channels.get_mut(self.health.channel_count as usize) {
            *place = health;
            self.health.channel_count += 1;
        }
    }

    /// The message of this heartbeat.
    pub(super) fn health(&mut self) -> &StageHealth {
        match self.beats % HISTOGRAMS {
            0 => self.health.work = self.work.percentiles(),
            1 => self.health.wait = self.wait.percentiles(),
            2 => self.health.end_to_end = self.end_to_end.percentiles(),
            _ => self.health.release_jitter = self.release_jitter.percentiles(),
        }
        self.beats = self.beats.wrapping_add(1);
        &self.health
    }

    /// The last message of the stage, with all figures up to date.
    pub(super) fn farewell(&mut self) -> &StageHealth {
        (0..HISTOGRAMS).for_each(|_| {
            self.health();
        });
        self.health.state = StageState::Stopped as u32;
        &self.health
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Misses and cause of a tick with these times after it was due, ns: sent, picked up, output; the period is 10 ms.
    fn cause(sent: u64, picked_up: u64, output: u64) -> (u64, &'static str) {
        let due = 1_000_000_000;
        let mut accounting = Accounting::new(3);
        (accounting.sent_ns, accounting.picked_up_ns) = (due + sent, due + picked_up);
        accounting.finish(77, due, due + output);
        accounting.judge(77, due, 10_000_000, due + output);
        let missed = accounting.health.missed;
        assert_eq!(missed.last_tick, if missed.total() > 0 { 77 } else { 0 });
        (missed.total(), MissCause::name(missed.last_cause))
    }

    #[test]
    fn a_missed_deadline_has_the_cause_that_took_longest() {
        assert_eq!(cause(1_000, 2_000, 10_000_000), (0, "none"), "exactly at the deadline");
        assert_eq!(cause(9_000_000, 9_100_000, 10_000_001), (1, "late input"));
        assert_eq!(cause(100_000, 9_000_000, 10_500_000), (1, "late release"));
        assert_eq!(cause(100_000, 200_000, 10_500_000), (1, "long work"));
    }

    #[test]
    fn a_reading_that_was_sent_before_its_tick_was_due_is_no_late_input() {
        let due = 1_000_000_000;
        let mut accounting = Accounting::new(1);
        (accounting.sent_ns, accounting.picked_up_ns) = (due - 5_000_000, due + 10_100_000);
        accounting.judge(1, due, 10_000_000, due + 10_200_000);
        assert_eq!(MissCause::name(accounting.health.missed.last_cause), "late release");
    }

    #[test]
    fn a_reset_sets_the_counts_to_zero_and_keeps_the_state() {
        let mut accounting = Accounting::new(2);
        accounting.pick_up(monotonic_ns());
        accounting.finish(9, 5, monotonic_ns());
        accounting.skip(4, 8, MissCause::LateRelease);
        accounting.begin(10, false);
        accounting.farewell();
        assert_eq!((accounting.health.samples, accounting.health.missed.total()), (1, 4));
        assert_eq!((accounting.health.work.count, accounting.health.wait.count), (1, 1));
        accounting.begin(20, true);
        let health = *accounting.farewell();
        assert_eq!((health.samples, health.missed.total(), health.since_ns), (0, 0, 20));
        assert_eq!((health.work.count, health.wait.count), (0, 0));
        assert_eq!((health.stage, health.header.sequence, health.pid), (2, 9, std::process::id()));
    }
}
