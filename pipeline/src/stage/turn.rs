//! One turn of a stage's loop: waiting for input, and accounting for the tick.

use std::{sync::atomic::Ordering, time::Duration};

use super::{Accounting, Clock, StageError, StageKind, StageOptions, monotonic_ns, sleep_until};
use crate::{
    channel::{Group, Listener, ListenerError, Publisher, PublisherError, ReceiveError, SendError},
    machine::{Machine, Wait},
    message::{Header, Message, MissCause, StageHealth},
};

/// Longest wait before the loop checks its stop flag and its time-outs again, ns.
const SLICE_NS: u64 = 10_000_000;
/// Longest sleep of a timer before the stop flag is checked, ns.
const SLEEP_NS: u64 = 100_000_000;
/// Number of polls between two readings of the clock.
const POLLS_PER_LOOK: u32 = 64;
/// Time between two heartbeats, ns.
const HEARTBEAT_NS: u64 = 100_000_000;

/// Result of a turn.
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
    /// Polls and yields the core between two polls, since lock-step has more stages than cores.
    Yield,
    /// Polls for so many ns, then sleeps until the channel's notifier wakes it; with 0 it only sleeps.
    Event(Box<Listener>, u64),
}

impl Waiter {
    /// The way to wait on the channel of `M` that clock and machine file ask for.
    ///
    /// # Errors
    /// The channel's event cannot be opened.
    pub fn new<M: Message>(
        group: &Group,
        machine: &Machine,
        kind: StageKind,
        clock: Clock,
    ) -> Result<Self, ListenerError> {
        Ok(match (clock, machine.stage(kind).wait) {
            (Clock::LockStep, _) => Self::Yield,
            (Clock::RealTime, Wait::Spin) => Self::Spin,
            (Clock::RealTime, Wait::Event) => Self::Event(Box::new(group.listener::<M>()?), 0),
            (Clock::RealTime, Wait::SpinThenEvent(spin)) => {
                Self::Event(Box::new(group.listener::<M>()?), spin.as_nanos() as u64)
            }
        })
    }
}

/// State of a stage's loop: options, times, counters.
pub struct Turn {
    /// How the stage runs.
    pub options: StageOptions,
    period_ns: u64,
    slice_ns: u64,
    /// How long before its time a timer is polled instead of slept for, ns.
    timer_spin_ns: u64,
    accounting: Accounting,
    publisher: Publisher<StageHealth>,
    next_beat_ns: u64,
}

impl Turn {
    pub(super) fn new(
        group: &Group,
        machine: &Machine,
        kind: StageKind,
        options: StageOptions,
    ) -> Result<Self, PublisherError> {
        let period_ns = machine.timing.period.as_nanos() as u64;
        let timer_spin_ns = match machine.stage(kind).wait {
            Wait::Event => 0,
            Wait::Spin => u64::MAX,
            Wait::SpinThenEvent(spin) => spin.as_nanos() as u64,
        };
        Ok(Self {
            options,
            period_ns,
            // A message whose publisher sends no notification is found within half a period.
            slice_ns: (period_ns / 2).clamp(1_000_000, SLICE_NS),
            timer_spin_ns,
            accounting: Accounting::new(kind as u32),
            publisher: group.publisher()?,
            next_beat_ns: 0,
        })
    }

    /// Whether the loop must end.
    pub fn stopping(&self) -> bool {
        self.options.stop.load(Ordering::Relaxed)
    }

    /// Whether `sequence` is the last tick of the run.
    pub fn is_last(&self, sequence: u64) -> bool {
        self.options.ticks.is_some_and(|ticks| sequence + 1 >= ticks)
    }

    /// Waits for an absolute time, ns, in the way that the machine file asks for; false when the loop must end before.
    /// A signal with another purpose does not end the wait.
    pub fn sleep_until(&self, deadline_ns: u64) -> bool {
        let asleep_until = deadline_ns.saturating_sub(self.timer_spin_ns);
        loop {
            if self.stopping() {
                return false;
            }
            let now = monotonic_ns();
            if now >= deadline_ns {
                return true;
            }
            if now < asleep_until {
                sleep_until(asleep_until.min(now + SLEEP_NS));
            } else {
                std::hint::spin_loop();
            }
        }
    }

    /// Waits until `poll` finds input, for a slice of time at most; false when no input came.
    ///
    /// # Errors
    /// `poll` fails, or the event cannot be waited for.
    pub fn wait_for(
        &mut self,
        waiter: &Waiter,
        mut poll: impl FnMut() -> Result<bool, ReceiveError>,
    ) -> Result<bool, StageError> {
        let spin_ns = match waiter {
            Waiter::Event(_, spin_ns) => *spin_ns,
            Waiter::Spin | Waiter::Yield => self.slice_ns,
        };
        if self.poll_for(spin_ns, matches!(waiter, Waiter::Yield), &mut poll)? {
            return Ok(true);
        }
        let Waiter::Event(listener, _) = waiter else { return Ok(false) };
        listener.wait(Duration::from_nanos(self.slice_ns))?;
        Ok(poll()?)
    }

    /// Polls for a time, and at least once.
    fn poll_for(
        &self,
        nanoseconds: u64,
        yields: bool,
        poll: &mut impl FnMut() -> Result<bool, ReceiveError>,
    ) -> Result<bool, StageError> {
        if nanoseconds == 0 {
            return Ok(poll()?);
        }
        let mut until = 0;
        loop {
            for _ in 0..POLLS_PER_LOOK {
                if poll()? {
                    return Ok(true);
                }
                if yields {
                    rustix::thread::sched_yield();
                } else {
                    std::hint::spin_loop();
                }
            }
            let now = monotonic_ns();
            if until == 0 {
                until = now + nanoseconds;
            }
            if now >= until || self.stopping() {
                return Ok(false);
            }
        }
    }

    /// A tick begins with a message that was sent at `sent_ns`.
    pub fn pick_up(&mut self, sent_ns: u64) {
        self.accounting.pick_up(sent_ns);
    }

    /// A tick begins by a timer that was set to `intended_ns`; returns the present time.
    pub fn release(&mut self, intended_ns: u64) -> u64 {
        self.accounting.release(intended_ns)
    }

    /// Fills in the header of the output of tick `sequence` and measures the times; called just before sending.
    ///
    /// `due_ns` is the time at which the sample of this tick was due. An output later than one period after it is late.
    pub fn finish(&mut self, header: &mut Header, sequence: u64, acquired_ns: u64, due_ns: u64) {
        let now = monotonic_ns();
        header.sequence = sequence;
        header.acquired_ns = acquired_ns;
        header.sent_ns = now;
        self.accounting.finish(sequence, acquired_ns, now);
        if self.options.clock == Clock::RealTime {
            self.accounting.judge(sequence, due_ns, self.period_ns, now);
        }
    }

    /// The valve command was sent: measures the time from acquisition to sending.
    pub fn arrive(&mut self, header: &Header) {
        self.accounting.arrive(header.sent_ns.saturating_sub(header.acquired_ns));
    }

    /// Counts ticks that were due and not worked at all; `last_tick` is the last of them.
    pub fn skip(&mut self, ticks: u64, last_tick: u64, cause: MissCause) {
        self.accounting.skip(ticks, last_tick, cause);
    }

    /// Counts a sample with a fault bit.
    pub fn implausible(&mut self) {
        self.accounting.implausible();
    }

    /// Whether a heartbeat is due.
    pub(super) fn is_beat_due(&self) -> bool {
        monotonic_ns() >= self.next_beat_ns
    }

    /// Sends a heartbeat; `channels` adds the channels that the stage reads.
    pub(super) fn beat(&mut self, channels: impl FnOnce(&mut Accounting)) -> Result<(), SendError> {
        let now = monotonic_ns();
        self.next_beat_ns = now + HEARTBEAT_NS;
        let reset = self.options.reset.swap(false, Ordering::Relaxed);
        self.accounting.begin(now, reset);
        channels(&mut self.accounting);
        self.publisher.send(self.accounting.health())
    }

    /// Sends the last message of the stage, with all figures up to date.
    pub(super) fn farewell(&mut self, channels: impl FnOnce(&mut Accounting)) -> Result<(), SendError> {
        self.accounting.begin(monotonic_ns(), false);
        channels(&mut self.accounting);
        self.publisher.send(self.accounting.farewell())
    }
}
