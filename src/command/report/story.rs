//! What a recording tells, read once from its first message to its last one, in bounded memory.

use std::path::Path;

use pipeline::{
    MAX_AXES,
    machine::{BUILT_IN, Machine},
    message::{
        AxisCommand, CoefficientSnapshot, ControlMode, EncoderSample, Header, Message, StageHealth, ValveCommand,
    },
    stage::StageKind,
    statistics::ErrorStatistics,
};

use super::{
    latency::Latency,
    line::Line,
    models::Models,
    spans::Spans,
    teeth::TeethStory,
    watch::{Found, Watch},
};
use crate::{
    failure::Failure,
    recording::{
        Facts, MACHINE, SETTINGS, is_lock_step,
        reading::{Damage, ReadMessage, Reading},
        typed::Decoder,
    },
};

/// Periods without a message after which a line is broken.
const GAP_PERIODS: f64 = 20.0;

/// What a recording tells.
pub struct Story {
    pub facts: Facts,
    pub damage: Option<Damage>,
    /// The machine that ran, if the recording holds its file.
    pub machine: Option<Machine>,
    /// When the first message was read, ns since 1970.
    pub begin_ns: u64,
    /// s.
    pub duration: f64,
    /// s.
    pub period: f64,
    pub axes: Vec<AxisStory>,
    pub teeth: TeethStory,
    pub found: Found,
    pub stages: Stages,
    pub end_to_end: Latency,
    pub jitter: Latency,
}

/// What a recording tells of one axis.
#[derive(Debug)]
pub struct AxisStory {
    pub name: String,
    pub position: Line,
    pub reference: Line,
    /// Following error, mm.
    pub error: Line,
    pub command: Line,
    /// Who commanded it: numbers of [`ControlMode`].
    pub commanders: Spans,
    /// Following errors over the ticks that a controller has commanded, m: all of them, and those of the model.
    pub tracking: [ErrorStatistics; 2],
    /// Ticks with a command.
    pub ticks: u64,
    /// The newest command.
    pub last: AxisCommand,
    pub models: Models,
}

/// Heartbeats of the stages.
#[derive(Debug, Default)]
pub struct Stages {
    /// The newest heartbeat of each stage, by [`StageKind`].
    pub last: [Option<StageHealth>; 4],
    /// The last heartbeats of processes that were followed by others.
    pub former: Vec<StageHealth>,
}

impl Stages {
    /// The sum of a count over all processes of a stage.
    pub fn sum(&self, kind: StageKind, of: impl Fn(&StageHealth) -> u64) -> u64 {
        let former = self.former.iter().filter(|health| health.stage == kind as u32);
        self.last[kind as usize].iter().chain(former).map(of).sum()
    }
}

impl AxisStory {
    fn new(name: String) -> Self {
        Self {
            name,
            position: Line::new(),
            reference: Line::new(),
            error: Line::new(),
            command: Line::new(),
            commanders: Spans::default(),
            tracking: [ErrorStatistics::default(); 2],
            ticks: 0,
            last: AxisCommand::default(),
            models: Models::new(),
        }
    }

    fn command(&mut self, t: f64, command: &AxisCommand) {
        self.ticks += 1;
        self.last = *command;
        self.command.push(t, command.command);
        self.commanders.push(t, command.mode);
        let is_model = command.mode == ControlMode::Model as u32;
        if is_model || command.mode == ControlMode::Fallback as u32 {
            self.reference.push(t, command.reference);
            self.error.push(t, 1e3 * command.error);
            self.tracking[0].push(command.error);
            if is_model {
                self.tracking[1].push(command.error);
            }
        } else {
            self.reference.cut(t);
            self.error.cut(t);
        }
    }

    fn cut(&mut self, t: f64) {
        let lines = [&mut self.position, &mut self.reference, &mut self.error, &mut self.command];
        lines.into_iter().for_each(|line| line.cut(t));
        self.commanders.cut();
    }
}

impl Story {
    /// Reads a whole recording.
    ///
    /// # Errors
    /// It cannot be read, or holds no sample and no command.
    pub fn read(mut reading: Reading) -> Result<Self, Failure> {
        let mut teller = None;
        while let Some(message) = reading.next().map_err(Failure::usage)? {
            teller.get_or_insert_with(|| Teller::new(&reading, message.log_ns)).look(&message);
        }
        let Some(teller) = teller.filter(|teller| teller.first.is_some()) else {
            return Err(Failure::usage("found neither samples nor commands; allowed: a recording of a group that ran"));
        };
        Ok(teller.finish(&reading))
    }
}

/// The messages of one channel; none of a channel of another program.
struct Channel<M>(Option<Option<Decoder<M>>>);

impl<M> Default for Channel<M> {
    fn default() -> Self {
        Self(None)
    }
}

impl<M: Message> Channel<M> {
    /// The message, if it is one of this channel.
    fn decode(&mut self, read: &ReadMessage) -> Option<M> {
        if read.channel.name != M::CHANNEL {
            return None;
        }
        let decoder = self.0.get_or_insert_with(|| Decoder::new(&read.channel).ok());
        decoder.as_ref()?.decode(read.bytes.clone()).map(|typed| typed.message)
    }
}

/// Reads the messages one by one.
struct Teller {
    story: Story,
    samples: Channel<EncoderSample>,
    commands: Channel<ValveCommand>,
    snapshots: Channel<CoefficientSnapshot>,
    health: Channel<StageHealth>,
    watch: Watch,
    /// Acquisition of the first sample, ns of `CLOCK_MONOTONIC`; in lock-step its number.
    first: Option<u64>,
    /// Newest sample, and the time of its acquisition, s.
    sample: Option<(EncoderSample, f64)>,
    /// Time of the newest command, s.
    command_s: f64,
    last_log_ns: u64,
    /// In lock-step the ticks are the time of the machine, whatever time they took.
    is_lock_step: bool,
}

impl Teller {
    fn new(reading: &Reading, begin_ns: u64) -> Self {
        let facts = reading.facts().clone();
        let machine = machine(reading);
        let period = facts.get("period_s").and_then(|period| period.parse().ok());
        let period = period.or_else(|| Some(machine.as_ref()?.timing.period.as_secs_f64()));
        let names = reading.axes().into_iter().take(MAX_AXES).map(AxisStory::new);
        let is_lock_step = is_lock_step(&facts);
        let watch = Watch::new(machine.as_ref(), facts.get("group").map_or("", String::as_str));
        let story = Story {
            damage: None,
            begin_ns,
            duration: 0.0,
            period: period.filter(|period: &f64| *period > 0.0).unwrap_or(0.01),
            axes: names.collect(),
            teeth: TeethStory::new(),
            found: Found::default(),
            stages: Stages::default(),
            end_to_end: Latency::new("end to end"),
            jitter: Latency::new("release jitter"),
            machine,
            facts,
        };
        Self {
            story,
            samples: Channel::default(),
            commands: Channel::default(),
            snapshots: Channel::default(),
            health: Channel::default(),
            watch,
            first: None,
            sample: None,
            command_s: 0.0,
            last_log_ns: begin_ns,
            is_lock_step,
        }
    }

    /// Time of an acquisition, s since the first one.
    fn time(&mut self, header: &Header) -> f64 {
        let now = if self.is_lock_step { header.sequence } else { header.acquired_ns };
        let unit = if self.is_lock_step { self.story.period } else { 1e-9 };
        let first = *self.first.get_or_insert(now);
        now.saturating_sub(first) as f64 * unit
    }

    fn look(&mut self, message: &ReadMessage) {
        self.last_log_ns = self.last_log_ns.max(message.log_ns);
        if let Some(sample) = self.samples.decode(message) {
            self.sample(sample);
        } else if let Some(command) = self.commands.decode(message) {
            self.command(&command);
        } else if let Some(health) = self.health.decode(message) {
            self.health(&health);
        } else if message.channel.name == CoefficientSnapshot::CHANNEL {
            let logged = message.log_ns.saturating_sub(self.story.begin_ns) as f64 * 1e-9;
            let t = if self.is_lock_step { self.command_s } else { logged };
            if let Some(snapshot) = self.snapshots.decode(message) {
                let axes = self.story.axes.iter_mut().zip(&snapshot.axes);
                axes.for_each(|(axis, snapshot)| axis.models.look(t, snapshot));
            }
        }
    }

    fn sample(&mut self, sample: EncoderSample) {
        let t = self.time(&sample.header);
        let is_gap = self.is_gap(self.sample.as_ref().map(|(_, before)| *before), t);
        if let Some((before, _)) = self.sample
            && before.header.sequence + 1 == sample.header.sequence
            && !self.is_lock_step
        {
            let between = sample.header.acquired_ns.saturating_sub(before.header.acquired_ns);
            self.story.jitter.record(between.abs_diff((self.story.period * 1e9) as u64));
        }
        for (axis, sample) in self.story.axes.iter_mut().zip(&sample.axes) {
            if is_gap {
                axis.cut(t);
            }
            axis.position.push(t, sample.usable().unwrap_or(f64::NAN));
        }
        self.sample = Some((sample, t));
    }

    fn command(&mut self, command: &ValveCommand) {
        let t = self.time(&command.header);
        let is_gap = self.is_gap(Some(self.command_s).filter(|before| *before > 0.0), t);
        self.command_s = t;
        self.story.end_to_end.record(command.header.sent_ns.saturating_sub(command.header.acquired_ns));
        for (axis, command) in self.story.axes.iter_mut().zip(&command.axes) {
            if is_gap {
                axis.cut(t);
            }
            axis.command(t, command);
        }
        if is_gap {
            self.story.teeth.cut(t);
        }
        self.story.teeth.look(t, &command.teeth);
        let sample = self.sample.as_ref().map(|(sample, _)| sample);
        let names = self.story.axes.iter().map(|axis| axis.name.as_str());
        self.watch.command(t, command, sample, names);
    }

    fn is_gap(&self, before: Option<f64>, t: f64) -> bool {
        before.is_some_and(|before| t - before > GAP_PERIODS * self.story.period)
    }

    fn health(&mut self, health: &StageHealth) {
        let t = self.command_s;
        let Some(slot) = self.story.stages.last.get_mut(health.stage as usize) else { return };
        let before = slot.replace(*health).filter(|before| before.pid != health.pid);
        self.watch.health(t, health, before.as_ref());
        self.story.stages.former.extend(before);
    }

    fn finish(self, reading: &Reading) -> Story {
        let Self { mut story, watch, last_log_ns, is_lock_step, command_s, .. } = self;
        story.found = watch.finish();
        let logged = last_log_ns.saturating_sub(story.begin_ns) as f64 * 1e-9;
        story.duration = if is_lock_step { command_s } else { logged };
        story.facts = reading.facts().clone();
        story.damage = reading.damage().cloned();
        story
    }
}

/// The machine in a recording; none where there is none, or where it needs files that are elsewhere.
fn machine(reading: &Reading) -> Option<Machine> {
    let attached = |name: &str| {
        let file = reading.attached().iter().find(|(attached, _)| attached == name)?;
        std::str::from_utf8(&file.1).ok()
    };
    let text = attached(MACHINE)?;
    let settings: Vec<(String, String)> = serde_json::from_str(attached(SETTINGS)?).ok()?;
    if text == BUILT_IN {
        Machine::load(None, &settings).ok()
    } else {
        Machine::parse(text, "machine.toml", Path::new("."), &settings).ok()
    }
}
