//! The last messages of a running group, and what a person sees of them once a second.
//!
//! Runs in the supervisor, beside the loop. No stage waits for the monitor.

use std::time::{Duration, Instant};

use pipeline::{
    channel::{ChannelError, Group},
    machine::Machine,
    message::{ChannelHealth, EncoderReading, StageState, ValveCommand},
    stage::StageKind,
};

use super::glance;
use crate::{
    recording::tapes::Tapes,
    report::{control_loop::LastMessages, events::Events},
};

/// Time between two outputs for a person.
const SECOND: Duration = Duration::from_secs(1);

/// What a person sees of the group at one time.
pub struct Second {
    /// All axes in one line.
    pub line: String,
    /// A line for each axis, below a line with the time and a header.
    pub lines: Vec<String>,
}

/// Reads the messages of a group.
pub struct Monitor {
    tapes: Tapes,
    last: LastMessages,
    /// Session of the program that operates the group.
    operator: u64,
    /// When the last heartbeat of each stage came; none before the first one of its process.
    heartbeats: [Option<Instant>; 4],
    next_second: Instant,
    progress: u64,
    progressed: Instant,
    events: Events,
}

impl Monitor {
    /// Attaches to the group's channels.
    ///
    /// # Errors
    /// A channel cannot be opened.
    pub fn new(group: &Group, machine: &Machine) -> Result<Self, ChannelError> {
        let now = Instant::now();
        Ok(Self {
            tapes: Tapes::new(group)?,
            last: LastMessages::default(),
            operator: 0,
            heartbeats: [None; 4],
            next_second: now + SECOND,
            progress: 0,
            progressed: now,
            events: Events::new(machine, group.prefix()),
        })
    }

    /// Reads all messages that have come.
    ///
    /// # Errors
    /// A channel cannot be read.
    pub fn poll(&mut self) -> Result<(), ChannelError> {
        let tapes = &mut self.tapes;
        while let Some(health) = tapes.health.read()? {
            let Some(slot) = self.last.health.get_mut(health.stage as usize) else { continue };
            self.heartbeats[health.stage as usize] = Some(Instant::now());
            self.events.health(&health);
            let before = slot.replace(health);
            // A new process counts from 0 again, so the last counts of the former one are kept.
            self.last.former.extend(before.filter(|before| before.pid != health.pid));
        }
        tapes.readings.newest()?;
        tapes.samples.newest()?;
        tapes.references.newest()?;
        tapes.requests.newest()?;
        tapes.states.newest()?;
        while let Some(command) = tapes.commands.read()? {
            self.events.command(&command, tapes.samples.last());
            self.last.command = Some(command);
        }
        self.last.snapshot = tapes.snapshots.newest()?.or(self.last.snapshot);
        let all = self.last.health.iter().flatten().chain(&self.last.former);
        let progress = all.map(|health| health.samples).sum();
        if progress != self.progress {
            (self.progress, self.progressed) = (progress, Instant::now());
        }
        Ok(())
    }

    /// Whether the heartbeat of a stage says that its channels are open.
    pub fn is_ready(&self, kind: StageKind) -> bool {
        self.heartbeats[kind as usize].is_some()
            && self.last.health[kind as usize].is_some_and(|health| health.state != StageState::Stopped as u32)
    }

    /// Age of the last heartbeat of a stage; none before its first one.
    pub fn heartbeat_age(&self, kind: StageKind) -> Option<Duration> {
        self.heartbeats[kind as usize].map(|heartbeat| heartbeat.elapsed())
    }

    /// Forgets the heartbeats of a stage whose process has ended.
    pub fn forget(&mut self, kind: StageKind) {
        self.heartbeats[kind as usize] = None;
    }

    /// Number of the newest sample, and when it was acquired, ns of `CLOCK_MONOTONIC`.
    pub fn last_sample(&self) -> Option<(u64, u64)> {
        self.tapes.samples.last().map(|sample| (sample.header.sequence, sample.header.acquired_ns))
    }

    /// The last command, if there has been one.
    pub fn last_command(&self) -> Option<&ValveCommand> {
        self.last.command.as_ref()
    }

    /// Counts of the readings, and the last one.
    pub fn readings(&self) -> (ChannelHealth, Option<&EncoderReading>) {
        (self.tapes.readings.health(), self.tapes.readings.last())
    }

    /// Whether a program has taken over from another one since the last call.
    pub fn was_taken_over(&mut self) -> bool {
        let Some(command) = &self.last.command else { return false };
        let before = std::mem::replace(&mut self.operator, command.operator);
        let takes_over = self.tapes.requests.last().is_some_and(|request| request.takes_over == 1);
        before != 0 && command.operator != 0 && before != command.operator && takes_over
    }

    /// What the black box keeps and writes.
    pub fn tapes(&mut self) -> &mut Tapes {
        &mut self.tapes
    }

    /// Time since a stage last worked a tick.
    pub fn stalled_for(&self) -> Duration {
        self.progressed.elapsed()
    }

    /// The stages with their last ticks, for an error message about a group that stands still.
    pub fn ticks(&self) -> String {
        let ticks = StageKind::ALL.iter().filter_map(|kind| {
            self.last.health[*kind as usize].map(|health| format!("{} {}", kind.name(), health.header.sequence))
        });
        ticks.collect::<Vec<_>>().join(", ")
    }

    /// What has happened to the group.
    pub fn events(&mut self) -> &mut Events {
        &mut self.events
    }

    /// The last messages, with the reasons for which stages were started again.
    pub fn into_last(self, restart_causes: [Vec<String>; 4]) -> LastMessages {
        LastMessages { restart_causes, events: Some(self.events.into_list()), ..self.last }
    }

    /// What a person sees of this second; none until the next one is due.
    pub fn second(&mut self, machine: &Machine) -> Option<Second> {
        if Instant::now() < self.next_second {
            return None;
        }
        self.next_second += SECOND;
        Some(Second { line: glance::line(machine, &self.last)?, lines: glance::lines(machine, &self.last)? })
    }
}
