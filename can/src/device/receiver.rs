//! A message of another protocol that is received: its last good frame, and whether it still comes.

use super::{Cause, Fault, fault::FRAME};
use crate::{
    MAX_FD_DATA, Received,
    frames::{Guard, Layout, Signal, Verdict},
};
use embedded_can::Frame as _;

/// Numbers of frames of a message that were not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReceiverCounters {
    /// Frames that are missing by the alive counter.
    pub lost: u64,
    /// Frames that are too short, or whose checksum is wrong.
    pub wrong: u64,
    /// Frames whose alive counter stands still.
    pub repeated: u64,
}

/// A message that is received.
#[derive(Debug, Clone)]
pub struct Receiver {
    layout: Layout,
    guard: Guard,
    timeout_ns: u64,
    data: [u8; MAX_FD_DATA],
    /// When the last good frame came; `None` before the first one.
    heard_ns: Option<u64>,
    counter: Option<i64>,
    /// What was wrong with the frames since the last good one.
    cause: Cause,
    is_late: bool,
    /// Whether a good frame has come since the last sample.
    is_fresh: bool,
    counters: ReceiverCounters,
}

impl Receiver {
    /// A message that has not come yet. Without a good frame for `timeout_ns` it is a fault.
    pub fn new(layout: Layout, guard: Guard, timeout_ns: u64) -> Self {
        Self {
            layout,
            guard,
            timeout_ns,
            data: [0; MAX_FD_DATA],
            heard_ns: None,
            counter: None,
            cause: Cause::Absent,
            is_late: true,
            is_fresh: false,
            counters: ReceiverCounters::default(),
        }
    }

    /// How the message is on the bus.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Counter and checksum.
    pub fn guard(&self) -> &Guard {
        &self.guard
    }

    /// Longest time without a good frame, ns.
    pub fn timeout_ns(&self) -> u64 {
        self.timeout_ns
    }

    /// Takes a frame from the bus: whether it was this message.
    pub fn take(&mut self, received: &Received) -> bool {
        let frame = &received.frame;
        if !self.layout.is_of(frame) {
            return false;
        }
        let length = usize::from(self.layout.length);
        let verdict = match frame.data().get(..length) {
            None => Verdict::Checksum,
            Some(data) => self.guard.judge(data, &mut self.counter),
        };
        match verdict {
            Verdict::Good(lost) => {
                self.data[..length].copy_from_slice(&frame.data()[..length]);
                (self.heard_ns, self.is_late, self.cause) = (Some(received.time_ns), false, Cause::Stale);
                self.is_fresh = true;
                self.counters.lost += lost;
            }
            Verdict::Checksum => {
                self.cause = Cause::Checksum;
                self.counters.wrong += 1;
            }
            Verdict::Counter => {
                self.cause = Cause::Counter;
                self.counters.repeated += 1;
            }
        }
        true
    }

    /// Whether a good frame has come since [`Self::begin_sample`].
    pub fn is_fresh(&self) -> bool {
        self.is_fresh
    }

    /// A sample was taken.
    pub fn begin_sample(&mut self) {
        self.is_fresh = false;
    }

    /// Looks whether the message is late.
    pub fn check(&mut self, now_ns: u64) {
        self.is_late |= self.heard_ns.is_none_or(|heard_ns| now_ns.saturating_sub(heard_ns) > self.timeout_ns);
    }

    /// The bus is gone.
    pub fn lose_bus(&mut self) {
        (self.heard_ns, self.counter, self.is_late, self.cause) = (None, None, true, Cause::Bus);
    }

    /// What is wrong.
    pub fn fault(&self) -> Option<Fault> {
        self.is_late.then_some(Fault { cause: self.cause, node: FRAME, detail: self.layout.id as u16 })
    }

    /// When the last good frame came, ns; 0 before the first one.
    pub fn heard_ns(&self) -> u64 {
        self.heard_ns.unwrap_or_default()
    }

    /// The number of a signal in the last good frame; 0 before the first one.
    pub fn raw(&self, signal: &Signal) -> i64 {
        signal.raw(&self.data).unwrap_or_default()
    }

    /// The value of a signal in the last good frame.
    pub fn value(&self, signal: &Signal) -> f64 {
        signal.value(&self.data).unwrap_or_default()
    }

    /// What was not used so far.
    pub fn counters(&self) -> &ReceiverCounters {
        &self.counters
    }
}
