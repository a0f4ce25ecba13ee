//! Heartbeats of the stages, several times a second.
//!
//! Heartbeats are for people and for the supervisor; no stage acts on them. A stage sends its heartbeat between two
//! ticks, after the tick's output, on a channel that no stage reads. So a client that attaches to watch does not slow
//! down the loops.

use iceoryx2::prelude::ZeroCopySend;

use super::{CHANNELS, Header, Message};
use crate::{latency::Percentiles, layout::shared_struct};

/// Largest number of channels that one stage can account for.
const MAX_CHANNELS: usize = 4;

shared_struct! {
    /// State of a channel at one of its readers.
    #[type_name("hydraxis.ChannelHealth/2")]
    pub struct ChannelHealth {
        /// Which channel, its index in [`CHANNELS`].
        pub channel: u32,
        /// 1 after the first message; before it 0.
        pub any: u32,
        /// Number of messages read.
        pub received: u64,
        /// Number of lost messages: sent and never read, by the gaps in their numbers.
        pub lost: u64,
        /// Number of restarts of its publisher.
        pub restarts: u64,
        /// Number of messages about another machine, which were not read.
        pub foreign: u64,
        /// Age of the newest message's sample at this heartbeat, ns.
        pub age_ns: u64,
        /// Longest time between the samples of two messages in a row, ns.
        pub longest_gap_ns: u64,
    }
}

impl ChannelHealth {
    /// The channel's name, or `unknown` for a number that is no channel.
    pub fn name(&self) -> &'static str {
        CHANNELS.get(self.channel as usize).unwrap_or(&"unknown")
    }
}

/// Why an output was late: the largest part of its lateness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum MissCause {
    /// The input was sent late, or never.
    LateInput = 1,
    /// The input had arrived, or the timer was due, and the stage was not woken or had no core.
    LateRelease = 2,
    /// The work of the stage itself took long.
    LongWork = 3,
}

impl MissCause {
    /// The name of the cause with this number; `none` for 0.
    pub fn name(cause: u32) -> &'static str {
        ["none", "late input", "late release", "long work"].get(cause as usize).unwrap_or(&"unknown")
    }
}

shared_struct! {
    /// Ticks whose output came later than one period after their sample was due, or not at all, by cause.
    #[type_name("hydraxis.MissedDeadlines/1")]
    pub struct MissedDeadlines {
        /// [`MissCause::LateInput`].
        pub late_input: u64,
        /// [`MissCause::LateRelease`].
        pub late_release: u64,
        /// [`MissCause::LongWork`].
        pub long_work: u64,
        /// Tick of the last miss.
        pub last_tick: u64,
        /// Cause of the last miss, a [`MissCause`] as number; 0 before the first miss.
        pub last_cause: u32,
        /// Zero.
        pub reserved: u32,
    }
}

impl MissedDeadlines {
    /// Counts `ticks` missed ticks, of which `last_tick` is the last.
    pub fn count(&mut self, ticks: u64, last_tick: u64, cause: MissCause) {
        if ticks == 0 {
            return;
        }
        *match cause {
            MissCause::LateInput => &mut self.late_input,
            MissCause::LateRelease => &mut self.late_release,
            MissCause::LongWork => &mut self.long_work,
        } += ticks;
        (self.last_tick, self.last_cause) = (last_tick, cause as u32);
    }

    /// Number of missed ticks of all causes.
    pub fn total(&self) -> u64 {
        self.late_input + self.late_release + self.long_work
    }
}

shared_struct! {
    /// Heartbeat of one stage.
    #[type_name("hydraxis.StageHealth/3")]
    pub struct StageHealth {
        /// `sequence` is the last tick worked; `sent_ns` is the heartbeat.
        pub header: Header,
        /// Which stage: its number in `StageKind`, in the order of the data.
        pub stage: u32,
        /// What the stage is doing, a [`StageState`] as number.
        pub state: u32,
        /// Process id of the stage.
        pub pid: u32,
        /// Number of channels that the stage reads.
        pub channel_count: u32,
        /// Time since which the figures below count, ns of `CLOCK_MONOTONIC`: the start, or the last reset.
        pub since_ns: u64,
        /// Number of ticks worked since then.
        pub samples: u64,
        /// Number of samples with a fault bit since then (sensor-proc only).
        pub implausible: u64,
        /// Missed ticks since then.
        pub missed: MissedDeadlines,
        /// The channels that the stage reads, `channel_count` of them.
        pub channels: [ChannelHealth; MAX_CHANNELS],
        /// Time from sending an input to picking it up, ns.
        pub wait: Percentiles,
        /// Time from picking up an input to sending the output, ns.
        pub work: Percentiles,
        /// Time from the acquisition of a sample to sending its command, ns (control-proc only).
        pub end_to_end: Percentiles,
        /// Lateness of the timer against the intended time, ns (stages with a timer only).
        pub release_jitter: Percentiles,
    }
}

impl StageHealth {
    /// The channels that the stage reads.
    pub fn channels(&self) -> &[ChannelHealth] {
        &self.channels[..(self.channel_count as usize).min(MAX_CHANNELS)]
    }

    /// Number of lost messages over all channels that the stage reads.
    pub fn lost(&self) -> u64 {
        self.channels().iter().map(|channel| channel.lost).sum()
    }
}

/// What a stage is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum StageState {
    /// The channels are open; the stage waits for its first input.
    Ready = 1,
    /// The stage works.
    Running = 2,
    /// The stage has ended; this is its last message.
    Stopped = 3,
}

impl StageState {
    /// The name of the state with this number.
    pub fn name(state: u32) -> &'static str {
        ["unknown", "ready", "running", "stopped"].get(state as usize).unwrap_or(&"unknown")
    }
}
message!(StageHealth, "stage-health", publishers 8, buffer 16);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misses_are_counted_by_cause() {
        let mut missed = MissedDeadlines::default();
        assert_eq!(MissCause::name(missed.last_cause), "none");
        missed.count(0, 5, MissCause::LongWork);
        missed.count(1, 7, MissCause::LongWork);
        missed.count(3, 12, MissCause::LateRelease);
        missed.count(1, 11, MissCause::LateInput);
        assert_eq!((missed.total(), missed.late_release, missed.last_tick), (5, 3, 11));
        assert_eq!(MissCause::name(missed.last_cause), "late input");
    }
}
