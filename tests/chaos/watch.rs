//! Reads all channels of a group and checks every message against rules that hold at any time.
//!
//! ```text
//! published = sum over the lives of a writer of (last number - first number + 1) = received + lost
//! stands still: |counts(t) - counts(t - 50 ms)| <= 5 for every axis, that is 10 mm/s
//! ```

use std::collections::VecDeque;

use pipeline::{
    channel::{Group, Prefix, Reader},
    message::{
        AxisCommand, AxisMode, CoefficientSnapshot, ControlMode, EncoderReading, EncoderSample, MachineState, Message,
        Reference, Request, StageHealth, StageState, ValveCommand, control_flag,
    },
    stage::{StageKind, monotonic_ns},
};

use crate::{
    lives::{Controller, Numbers},
    stops::Stopped,
};

/// Time over which a speed is measured, ns.
const WINDOW_NS: u64 = 50_000_000;
/// Largest change in that time that is no motion, counts.
const STILL: i64 = 5;
/// Time for which positions are kept, ns.
const KEPT_NS: u64 = 8_000_000_000;
pub const AXES: usize = 4;

/// Flags of an axis that is not moved.
pub const NEUTRAL: u32 = control_flag::DISARMED | control_flag::SETTLING | control_flag::FEEDBACK;

pub struct Watch {
    readings: Counted<EncoderReading>,
    samples: Counted<EncoderSample>,
    commands: Counted<ValveCommand>,
    snapshots: Counted<CoefficientSnapshot>,
    references: Counted<Reference>,
    requests: Counted<Request>,
    states: Counted<MachineState>,
    health: Reader<StageHealth>,
    /// Positions, newest last.
    track: VecDeque<(u64, [i64; AXES])>,
    pub pids: [u32; 4],
    pub controller: Controller,
    /// The stop after which nothing may move; none after axes were armed.
    pub stopped: Option<Stopped>,
    /// First tick of the present life of sensor-proc and control-proc, and the time at which it was sent.
    first: [Option<(u64, u64)>; 4],
    last_sample: Option<u64>,
    /// When the last command was sent that moves an axis.
    pub last_moving_ns: u64,
    /// When the first neutral command after it was sent.
    pub neutral_ns: u64,
    /// Axes of the last command.
    pub last: [AxisCommand; AXES],
    _group: Group,
}

/// A reader, and an independent count by the numbers of its messages.
struct Counted<M: Message> {
    reader: Reader<M>,
    numbers: Numbers,
}

impl<M: Message> Counted<M> {
    fn new(group: &Group) -> Self {
        Self { reader: group.reader().unwrap(), numbers: Numbers::default() }
    }

    fn next(&mut self) -> Option<M> {
        let message = self.reader.read().unwrap().if_new().copied()?;
        self.numbers.take(message.header().session, message.header().number);
        Some(message)
    }

    fn check(&mut self) -> (u64, u64) {
        while self.next().is_some() {}
        let health = self.reader.health(monotonic_ns());
        let published = self.numbers.published();
        assert_eq!(health.received + health.lost, published, "{}: received + lost", M::CHANNEL);
        assert_eq!(health.restarts, self.numbers.restarts(), "{}: restarts", M::CHANNEL);
        (published, health.lost)
    }
}

impl Watch {
    pub fn new(prefix: &Prefix, pids: [u32; 4]) -> Self {
        let group = Group::join(prefix, "watch").unwrap();
        Self {
            readings: Counted::new(&group),
            samples: Counted::new(&group),
            commands: Counted::new(&group),
            snapshots: Counted::new(&group),
            references: Counted::new(&group),
            requests: Counted::new(&group),
            states: Counted::new(&group),
            health: group.reader().unwrap(),
            track: VecDeque::new(),
            pids,
            controller: Controller::default(),
            stopped: None,
            first: [None; 4],
            last_sample: None,
            last_moving_ns: 0,
            neutral_ns: 0,
            last: [AxisCommand::default(); AXES],
            _group: group,
        }
    }

    /// Reads all messages that have come.
    pub fn poll(&mut self) {
        while let Some(reading) = self.readings.next() {
            let counts = std::array::from_fn(|i| reading.encoders[i].counts);
            self.track.push_back((reading.header.acquired_ns, counts));
        }
        let oldest = self.track.back().map_or(0, |(newest, _)| newest.saturating_sub(KEPT_NS));
        while self.track.front().is_some_and(|(at, _)| *at < oldest) {
            self.track.pop_front();
        }
        while let Some(sample) = self.samples.next() {
            let (header, sequence) = (sample.header, sample.header.sequence);
            assert!(self.last_sample.is_none_or(|last| sequence > last), "{sequence} after {:?}", self.last_sample);
            self.last_sample = Some(sequence);
            if header.number == 0 {
                self.first[StageKind::SensorProc as usize] = Some((sequence, header.sent_ns));
            }
        }
        while let Some(command) = self.commands.next() {
            self.take_command(&command);
        }
        while self.snapshots.next().is_some() {}
        while self.references.next().is_some() {}
        while self.requests.next().is_some() {}
        while self.states.next().is_some() {}
        while let Some(health) = self.health.read().unwrap().if_new().copied() {
            self.take_health(&health);
        }
    }

    fn take_command(&mut self, command: &ValveCommand) {
        let header = command.header;
        let first = &mut self.first[StageKind::ControlProc as usize];
        if header.number == 0 {
            *first = None;
        }
        // A stop is answered also by a controller that has not had a sample yet: its command has the tick 0.
        if header.acquired_ns > 0 {
            first.get_or_insert((header.sequence, header.sent_ns));
        }
        self.controller.take(header.number, &command.axes[..AXES]);
        for (i, axis) in command.axes[..AXES].iter().enumerate() {
            let u = axis.command;
            assert!(u.is_finite() && u.abs() <= 1.0, "axis {i}: {axis:?}");
            let is_off = axis.flags & NEUTRAL != 0 || axis.operation == AxisMode::Off as u32;
            assert!(!is_off || (u == 0.0 && axis.mode == ControlMode::Neutral as u32), "axis {i}: {axis:?}");
            self.last[i] = *axis;
        }
        if let Some(stopped) = &mut self.stopped {
            stopped.take(command);
        }
        let moves = self.last.iter().any(|axis| axis.command != 0.0);
        if moves {
            self.last_moving_ns = header.sent_ns;
        } else if self.neutral_ns <= self.last_moving_ns {
            self.neutral_ns = header.sent_ns;
        }
    }

    fn take_health(&mut self, health: &StageHealth) {
        let stage = health.stage as usize;
        if health.state != StageState::Stopped as u32 {
            self.pids[stage] = health.pid;
        }
        let Some((first, sent_ns)) = self.first[stage] else { return };
        // Only if the heartbeat is of this life and its counters have not been reset since.
        if health.samples > 0 && (health.since_ns..=health.header.sent_ns).contains(&sent_ns) {
            let (passed, missed) = (health.header.sequence + 1 - first, health.missed.total());
            assert!(health.samples + missed >= passed, "{passed} ticks passed since {first}: {health:?}");
        }
    }

    /// Checks that received and lost messages add up to the numbers. Returns the messages on all channels, and those
    /// that this reader has lost.
    pub fn check_numbers(&mut self) -> (u64, u64) {
        self.poll();
        let all = [
            self.readings.check(),
            self.samples.check(),
            self.commands.check(),
            self.snapshots.check(),
            self.references.check(),
            self.requests.check(),
            self.states.check(),
        ];
        all.iter().fold((0, 0), |(published, lost), one| (published + one.0, lost + one.1))
    }

    pub fn restarts(&self) -> u64 {
        self.commands.reader.restarts() + self.samples.reader.restarts() + self.snapshots.reader.restarts()
    }

    /// Time of the last motion since a time, by the encoders; none if nothing has moved.
    pub fn last_motion(&self, since_ns: u64) -> Option<u64> {
        let mut before = self.track.iter().peekable();
        let mut last = None;
        for (at, counts) in &self.track {
            let mut reference = None;
            while let Some((_, counts)) = before.next_if(|(then, _)| then + WINDOW_NS <= *at) {
                reference = Some(counts);
            }
            let Some(reference) = reference.or_else(|| before.peek().map(|(_, counts)| counts)) else { continue };
            let moves = counts.iter().zip(reference).any(|(now, then)| now.abs_diff(*then) > STILL as u64);
            if *at >= since_ns && moves {
                last = Some(*at);
            }
        }
        last
    }

    /// The newest positions, counts, with their time.
    pub fn positions(&self) -> Option<(u64, [i64; AXES])> {
        self.track.back().copied()
    }

    /// Whether an axis was commanded and has moved within the last 0.1 s.
    pub fn is_moving(&self) -> bool {
        let since = monotonic_ns().saturating_sub(100_000_000);
        self.last_moving_ns >= since && self.last_motion(since).is_some()
    }

    /// Whether an axis is disarmed, off or not settled.
    pub fn needs_arming(&self) -> bool {
        self.last.iter().any(|axis| axis.flags & NEUTRAL != 0 || axis.operation == AxisMode::Off as u32)
    }
}
