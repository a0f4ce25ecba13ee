//! How the stages are doing, several times a second: every stage to whoever watches.
//!
//! What is here is for people and for the supervisor; no stage acts on it. It goes out between two ticks, after the
//! tick's output, on channels that no stage reads: so whoever attaches to watch costs the loops nothing.

use iceoryx2::prelude::ZeroCopySend;

use super::{AxisCommand, AxisSample, CHANNELS, Header, Message};
use crate::{MAX_AXES, latency::Percentiles, layout::shared_struct};

/// Channels that one stage can account for.
pub const MAX_CHANNELS: usize = 4;

shared_struct! {
    /// A channel as one of its readers sees it.
    #[type_name("hydraxis.ChannelHealth/1")]
    pub struct ChannelHealth {
        /// Which channel, its index in [`CHANNELS`].
        pub channel: u32,
        /// 1 once a message has come.
        pub any: u32,
        /// Messages read.
        pub received: u64,
        /// Messages sent and never read, by the gaps in their numbers.
        pub lost: u64,
        /// Times that its writer has begun anew.
        pub restarts: u64,
        /// Age of the newest message's sample at this heartbeat, ns.
        pub age_ns: u64,
        /// The longest that one message had to do before the next came, from sample to sample, ns.
        pub longest_gap_ns: u64,
    }
}

impl ChannelHealth {
    /// The channel's name, or `unknown` for a number that is none.
    pub fn name(&self) -> &'static str {
        CHANNELS.get(self.channel as usize).unwrap_or(&"unknown")
    }
}

/// Why an output came too late: the largest part of its lateness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum MissCause {
    /// The input was sent late, or never.
    LateInput = 1,
    /// The input was there, or its time had come, and the stage was not woken or had no core.
    LateRelease = 2,
    /// The stage itself took long.
    LongWork = 3,
}

impl MissCause {
    /// The cause of this number in words, or `none`.
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
        /// The last of them: its tick.
        pub last_tick: u64,
        /// Its cause, a [`MissCause`] as number; 0 when there was none.
        pub last_cause: u32,
        /// Zero.
        pub reserved: u32,
    }
}

impl MissedDeadlines {
    /// Counts the miss of `ticks` ticks, of which `last_tick` is the last.
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

    /// All of them.
    pub fn total(&self) -> u64 {
        self.late_input + self.late_release + self.long_work
    }
}

shared_struct! {
    /// How one stage is doing.
    #[type_name("hydraxis.StageHealth/2")]
    pub struct StageHealth {
        /// `sequence` is the last tick worked; `sent_ns` is the heartbeat.
        pub header: Header,
        /// Which stage, its index in [`crate::stage::StageKind`].
        pub stage: u32,
        /// What it does, a [`StageState`] as number.
        pub state: u32,
        /// Its process.
        pub pid: u32,
        /// Channels that it reads.
        pub channel_count: u32,
        /// When the counting below began, ns of `CLOCK_MONOTONIC`: the start, or the last reset.
        pub since_ns: u64,
        /// Ticks worked since.
        pub samples: u64,
        /// Samples with a fault bit since (sensor-proc only).
        pub implausible: u64,
        /// Deadlines missed since.
        pub missed: MissedDeadlines,
        /// The channels that it reads, `channel_count` of them.
        pub channels: [ChannelHealth; MAX_CHANNELS],
        /// From an input being sent to being picked up, ns.
        pub wait: Percentiles,
        /// From pick-up to the output being sent, ns.
        pub work: Percentiles,
        /// From acquisition to the command being sent, ns (control-proc only).
        pub end_to_end: Percentiles,
        /// Lateness of the timer against the intended time, ns (stages with a timer only).
        pub release_jitter: Percentiles,
    }
}

impl StageHealth {
    /// The channels that it reads.
    pub fn channels(&self) -> &[ChannelHealth] {
        &self.channels[..(self.channel_count as usize).min(MAX_CHANNELS)]
    }

    /// Messages lost over all of them.
    pub fn lost(&self) -> u64 {
        self.channels().iter().map(|channel| channel.lost).sum()
    }
}

/// What a stage is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum StageState {
    /// Its channels are open; it waits for its first input.
    Ready = 1,
    /// It works.
    Running = 2,
    /// It has ended; this is its last message.
    Stopped = 3,
}

impl StageState {
    /// The state of this number in words.
    pub fn name(state: u32) -> &'static str {
        ["unknown", "ready", "running", "stopped"].get(state as usize).unwrap_or(&"unknown")
    }
}

shared_struct! {
    /// One axis of a [`MachineState`].
    #[type_name("hydraxis.AxisState/1")]
    pub struct AxisState {
        /// Its name in UTF-8, cut to what there is room for, then zeros.
        pub name: [u8; 32],
        /// Where it is.
        pub sample: AxisSample,
        /// What its valve was last told.
        pub command: AxisCommand,
        /// Forgetting factor of the newest snapshot; 0 while there is none.
        pub forgetting_factor: f64,
        /// Standard deviation of the adaptive model's h-step error, in the unit of the identified output.
        pub h_step_sigma: f64,
        /// Age of the newest snapshot's sample at this heartbeat, ns.
        pub model_age_ns: u64,
        /// Why the model is not to be trusted, [`super::model_fault`] bits.
        pub model_faults: u32,
        /// 1 once a snapshot has come.
        pub has_model: u32,
    }
}

impl AxisState {
    /// Names the axis.
    pub fn set_name(&mut self, name: &str) {
        let mut length = name.len().min(self.name.len());
        while !name.is_char_boundary(length) {
            length -= 1;
        }
        self.name = [0; 32];
        self.name[..length].copy_from_slice(&name.as_bytes()[..length]);
    }

    /// The axis' name.
    pub fn name(&self) -> &str {
        let length = self.name.iter().position(|byte| *byte == 0).unwrap_or(self.name.len());
        std::str::from_utf8(&self.name[..length]).unwrap_or("?")
    }
}

shared_struct! {
    /// The last sample and command, at every heartbeat of control-proc: for people, who need no tick of their own.
    #[type_name("hydraxis.MachineState/1")]
    pub struct MachineState {
        /// `sequence` names the sample.
        pub header: Header,
        /// One entry per axis.
        pub axes: [AxisState; MAX_AXES],
    }
}

message!(StageHealth, "stage-health", publishers 8, buffer 16);
message!(MachineState, "machine-state", publishers 1, buffer 4);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_channel_has_its_name_in_the_list() {
        use crate::message::{CoefficientSnapshot, EncoderReading, EncoderSample, Reference, Request, ValveCommand};
        let channels = [
            EncoderReading::CHANNEL,
            EncoderSample::CHANNEL,
            ValveCommand::CHANNEL,
            CoefficientSnapshot::CHANNEL,
            Reference::CHANNEL,
            Request::CHANNEL,
            StageHealth::CHANNEL,
            MachineState::CHANNEL,
        ];
        assert_eq!(channels, CHANNELS);
    }

    #[test]
    fn a_name_is_cut_between_two_letters() {
        let mut axis = AxisState::default();
        assert_eq!(axis.name(), "");
        axis.set_name("boom");
        assert_eq!(axis.name(), "boom");
        axis.set_name(&"\u{e4}".repeat(20));
        assert_eq!(axis.name(), "\u{e4}".repeat(16));
        axis.set_name(&format!("x{}", "\u{e4}".repeat(20)));
        assert_eq!(axis.name().chars().count(), 16);
    }

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
