//! The last messages of a running group, and a line per second for a person.
//!
//! Runs in the supervisor, beside the loop. No stage waits for the monitor.

use std::time::{Duration, Instant};

use pipeline::{
    channel::{ChannelError, Group},
    machine::Machine,
    message::{
        AxisMode, ChannelHealth, ControlMode, EncoderReading, StageState, ValveCommand, bit_names, control_flag,
        model_fault,
    },
    stage::StageKind,
};

use crate::{recording::black_box::Tapes, report::control_loop::LastMessages};

/// Time between two lines.
const LINE_PERIOD: Duration = Duration::from_secs(1);

/// Reads the messages of a group.
pub struct Monitor {
    tapes: Tapes,
    last: LastMessages,
    /// Session of the program that operates the group.
    operator: u64,
    /// When the last heartbeat of each stage came; none before the first one of its process.
    heartbeats: [Option<Instant>; 4],
    next_line: Instant,
    progress: u64,
    progressed: Instant,
}

impl Monitor {
    /// Attaches to the group's channels. `keeps`: the messages are kept for a black box.
    ///
    /// # Errors
    /// A channel cannot be opened.
    pub fn new(group: &Group, keeps: bool) -> Result<Self, ChannelError> {
        let now = Instant::now();
        Ok(Self {
            tapes: Tapes::new(group, keeps)?,
            last: LastMessages::default(),
            operator: 0,
            heartbeats: [None; 4],
            next_line: now + LINE_PERIOD,
            progress: 0,
            progressed: now,
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
            let before = slot.replace(health);
            // A new process counts from 0 again, so the last counts of the former one are kept.
            self.last.former.extend(before.filter(|before| before.pid != health.pid));
        }
        tapes.readings.newest()?;
        tapes.samples.newest()?;
        tapes.references.newest()?;
        tapes.requests.newest()?;
        tapes.states.newest()?;
        self.last.command = tapes.commands.newest()?.or(self.last.command);
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

    /// What the black box writes.
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

    /// The last messages, with the reasons for which stages were started again.
    pub fn into_last(self, restart_causes: [Vec<String>; 4]) -> LastMessages {
        LastMessages { restart_causes, ..self.last }
    }

    /// The line of this second; none until the next one is due.
    pub fn line(&mut self, machine: &Machine) -> Option<String> {
        if Instant::now() < self.next_line {
            return None;
        }
        self.next_line += LINE_PERIOD;
        let sensor = self.last.health[StageKind::SensorProc as usize]?;
        let seconds = sensor.header.sequence as f64 * machine.timing.period.as_secs_f64();
        let mut line = format!("{seconds:6.1} s");
        for (i, axis) in machine.axes.iter().enumerate() {
            line += &format!(" | {}", axis.name);
            if let Some(command) = self.last.command.map(|command| command.axes[i])
                && command.mode != ControlMode::Replay as u32
            {
                line += &format!(" {:+.1} mm {}", 1e3 * command.error, ControlMode::name(command.mode));
                if command.operation == AxisMode::Hold as u32 {
                    line += " hold";
                }
                let fault = control_flag::LATCHED
                    | control_flag::REFERENCE
                    | control_flag::REQUEST
                    | control_flag::REQUEST_STOPPED
                    | control_flag::SOFT_LIMIT
                    | control_flag::HALF_SPEED
                    | control_flag::MODEL_WORSE
                    | control_flag::SLOWED;
                for flag in bit_names(command.flags & fault, &control_flag::NAMES) {
                    line += &format!(" {}!", flag.to_uppercase());
                }
            }
            if let Some(snapshot) = self.last.snapshot.map(|snapshot| snapshot.axes[i]) {
                if snapshot.faults & model_fault::TRAINING != 0 {
                    line += " training";
                } else {
                    line += &format!(" L{:.3}", snapshot.forgetting_factor);
                }
            }
        }
        let (lost, late) = (self.last.health.iter().flatten())
            .fold((0, 0), |(lost, late), health| (lost + health.lost(), late + health.missed.total()));
        Some(line + &format!(" | lost {lost} late {late}"))
    }
}
