//! One turn of a stage's loop: waiting for input, and taking the times.

use std::{sync::atomic::Ordering, time::Duration};

use super::{Clock, Options, StageError, StageKind, clock::monotonic_ns};
use crate::{
    channel::{ChannelError, Ear, Group, Publisher},
    latency::LatencyRecorder,
    machine::{Machine, Wait},
    message::{Header, Message, StageHealth, StageState},
};

/// Longest wait before the loop looks at its stop flag and its time-outs again.
const SLICE_NS: u64 = 10_000_000;
/// Polls between two looks at the clock.
const POLLS_PER_LOOK: u32 = 64;
/// Time between two heartbeats.
const HEARTBEAT_NS: u64 = 100_000_000;
/// Heartbeats between two computations of the percentiles, which read the whole histogram.
const BEATS_PER_PERCENTILES: u32 = 10;

/// What a turn came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// A tick was worked.
    Worked,
    /// No input came in this slice of time.
    Waiting,
    /// The last tick was worked, or the source has ended.
    Finished,
}

/// How a stage waits for a message.
pub enum Waiter {
    /// Polls without a pause.
    Spin,
    /// Polls, giving the core away between two polls: lock-step has more stages than cores.
    Yield,
    /// Sleeps until the bell of the channel rings.
    Event(Box<Ear>),
}

impl Waiter {
    /// The way that clock and machine file ask for, on the channel of `M`.
    ///
    /// # Errors
    /// The channel's event cannot be opened.
    pub fn new<M: Message>(
        group: &Group,
        machine: &Machine,
        kind: StageKind,
        clock: Clock,
    ) -> Result<Self, ChannelError> {
        Ok(match (clock, machine.stage(kind).wait) {
            (Clock::LockStep, _) => Self::Yield,
            (Clock::RealTime, Wait::Spin) => Self::Spin,
            (Clock::RealTime, Wait::Event) => Self::Event(Box::new(group.ear::<M>()?)),
        })
    }
}

/// What a stage's loop knows about its run: options, times, counters.
pub struct Turn {
    /// How the stage runs.
    pub options: Options,
    period_ns: u64,
    slice_ns: u64,
    health: StageHealth,
    publisher: Publisher<StageHealth>,
    wait: LatencyRecorder,
    work: LatencyRecorder,
    end_to_end: LatencyRecorder,
    release_jitter: LatencyRecorder,
    picked_up_ns: u64,
    next_beat_ns: u64,
    beats: u32,
}

impl Turn {
    pub(super) fn new(
        group: &Group,
        kind: StageKind,
        period: Duration,
        options: Options,
    ) -> Result<Self, ChannelError> {
        let period_ns = period.as_nanos() as u64;
        let mut health = StageHealth { stage: kind as u32, pid: std::process::id(), ..StageHealth::default() };
        health.state = StageState::Ready as u32;
        Ok(Self {
            options,
            period_ns,
            // A writer that rings no bell is still heard within half a period.
            slice_ns: (period_ns / 2).clamp(1_000_000, SLICE_NS),
            health,
            publisher: group.publisher()?,
            wait: LatencyRecorder::new(),
            work: LatencyRecorder::new(),
            end_to_end: LatencyRecorder::new(),
            release_jitter: LatencyRecorder::new(),
            picked_up_ns: 0,
            next_beat_ns: 0,
            beats: 0,
        })
    }

    /// Whether the loop is to end.
    pub fn stopping(&self) -> bool {
        self.options.stop.load(Ordering::Relaxed)
    }

    /// Whether `sequence` is the last tick of the run.
    pub fn is_last(&self, sequence: u64) -> bool {
        self.options.ticks.is_some_and(|ticks| sequence + 1 >= ticks)
    }

    /// Waits until `poll` finds input, for a slice of time at most; false when none came.
    ///
    /// # Errors
    /// What `poll` returns, or the event cannot be waited for.
    pub fn wait_for(
        &mut self,
        waiter: &Waiter,
        mut poll: impl FnMut() -> Result<bool, ChannelError>,
    ) -> Result<bool, StageError> {
        if let Waiter::Event(ear) = waiter {
            if poll()? {
                return Ok(true);
            }
            ear.wait(Duration::from_nanos(self.slice_ns))?;
            return Ok(poll()?);
        }
        let mut until = 0;
        loop {
            for _ in 0..POLLS_PER_LOOK {
                if poll()? {
                    return Ok(true);
                }
                match waiter {
                    Waiter::Yield => rustix::thread::sched_yield(),
                    Waiter::Spin | Waiter::Event(_) => std::hint::spin_loop(),
                }
            }
            let now = monotonic_ns();
            if until == 0 {
                until = now + self.slice_ns;
            }
            if now >= until || self.stopping() {
                return Ok(false);
            }
        }
    }

    /// A tick begins with a message that was sent at `sent_ns`.
    pub fn pick_up(&mut self, sent_ns: u64) {
        self.picked_up_ns = monotonic_ns();
        self.wait.record(self.picked_up_ns.saturating_sub(sent_ns));
    }

    /// A tick begins by a timer that was set to `intended_ns`; returns the time.
    pub fn release(&mut self, intended_ns: u64) -> u64 {
        self.picked_up_ns = monotonic_ns();
        self.release_jitter.record(self.picked_up_ns.saturating_sub(intended_ns));
        self.picked_up_ns
    }

    /// The output of tick `sequence` is about to be sent: fills in its header and takes the times.
    ///
    /// `due_ns` is when the sample of this tick was due; an output more than a period after it is late.
    pub fn finish(&mut self, header: &mut Header, sequence: u64, acquired_ns: u64, due_ns: u64) {
        let now = monotonic_ns();
        header.sequence = sequence;
        header.acquired_ns = acquired_ns;
        header.sent_ns = now;
        self.work.record(now.saturating_sub(self.picked_up_ns));
        if self.options.clock == Clock::RealTime && now > due_ns + self.period_ns {
            self.health.missed_deadlines += 1;
        }
        self.health.samples += 1;
        self.health.header.sequence = sequence;
        self.health.header.acquired_ns = acquired_ns;
        self.health.state = StageState::Running as u32;
    }

    /// The valve command was sent: the whole way from acquisition to here is over.
    pub fn arrive(&mut self, header: &Header) {
        self.end_to_end.record(header.sent_ns.saturating_sub(header.acquired_ns));
    }

    /// Counts ticks that were due and not worked at all.
    pub fn skip(&mut self, ticks: u64) {
        self.health.missed_deadlines += ticks;
    }

    /// Counts a sample with a fault bit.
    pub fn implausible(&mut self) {
        self.health.implausible += 1;
    }

    /// Sends a heartbeat when one is due.
    pub(super) fn beat(&mut self, lost: u64) -> Result<(), ChannelError> {
        let now = monotonic_ns();
        if now < self.next_beat_ns {
            return Ok(());
        }
        self.next_beat_ns = now + HEARTBEAT_NS;
        if self.beats.is_multiple_of(BEATS_PER_PERCENTILES) {
            self.percentiles();
        }
        self.beats += 1;
        self.send_health(now, lost)
    }

    /// Sends the last message of the stage, with all figures up to date.
    pub(super) fn farewell(&mut self, lost: u64) -> Result<(), ChannelError> {
        self.percentiles();
        self.health.state = StageState::Stopped as u32;
        self.send_health(monotonic_ns(), lost)
    }

    fn percentiles(&mut self) {
        self.health.wait = self.wait.percentiles();
        self.health.work = self.work.percentiles();
        self.health.end_to_end = self.end_to_end.percentiles();
        self.health.release_jitter = self.release_jitter.percentiles();
    }

    fn send_health(&mut self, now: u64, lost: u64) -> Result<(), ChannelError> {
        self.health.lost = lost;
        self.health.header.sent_ns = now;
        self.publisher.send(&self.health)
    }
}
