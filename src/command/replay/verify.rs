//! Every message of a run in lock-step made again, from what was recorded before it.
//!
//! ```text
//! reading k    <- plant, seed, command k-1
//! sample k     <- reading k
//! snapshot k   <- sample k, command k-1
//! command k    <- sample k, snapshot k-1, references, requests and stops that the command names
//! ```
//!
//! Each core gets what was recorded, not what the others have computed here. So a difference is found in the stage in
//! which it arises, and at its tick.
//!
//! A stage in whose place another program ran is not computed. In a replay of a file only the snapshots are.

use ident_proc::Identifiers;
use pipeline::{
    machine::{Machine, Source},
    message::{
        CoefficientSnapshot, EncoderReading, EncoderSample, Header, MachineState, Message, Reference, Request,
        ValveCommand,
    },
    stage::StageKind,
};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

use super::{
    controller::ReplayedController,
    difference::{By, Channel, Difference, FIRST, Shared, most},
    feed::Feed,
    machine::Recorded,
    report::{CheckedChannel, VerifyReport},
    state::States,
};
use crate::{failure::Failure, recording::reading::Reading, report::table::progress};

/// The cores of the stages that are computed.
struct Cores {
    machine: Machine,
    plant: Option<PlantSim>,
    acquisition: Option<Acquisition>,
    identifiers: Option<Identifiers>,
    controller: Option<ReplayedController>,
    states: States,
}

/// The channels that are compared.
struct Channels {
    readings: Channel<EncoderReading>,
    samples: Channel<EncoderSample>,
    snapshots: Channel<CoefficientSnapshot>,
    commands: Channel<ValveCommand>,
    states: Channel<MachineState>,
    shared: Shared,
}

/// The last messages that were recorded.
#[derive(Default)]
struct Last {
    sample: Option<EncoderSample>,
    snapshot: Option<CoefficientSnapshot>,
    /// The command that was made of the sample.
    command: Option<ValveCommand>,
}

/// How a tick ended.
enum Step {
    Done,
    /// The recording has no further tick.
    End,
    Differs(Box<Difference>),
}

/// Computes all messages of a recording again.
///
/// # Errors
/// The run was not in lock-step, has no first tick, was recorded by another version, or the file cannot be read.
pub fn verify(recorded: &Recorded) -> Result<VerifyReport, Failure> {
    if !recorded.is_lock_step() {
        return Err(Failure::usage(format!(
            "{}: --verify: found a run in real time; allowed: a run in lock-step, which can be repeated: hydraxis run \
             --lockstep --record FILE",
            recorded.path.display()
        )));
    }
    let machine = recorded.machine(None, &[])?;
    let names = machine.axes.iter().map(|axis| axis.name.clone()).collect();
    let mut cores = Cores::new(machine, recorded)?;
    let mut feed = Feed::new(Reading::open(&recorded.path)?);
    feed.check_all_but(cores.computed().into_iter().filter_map(|(name, is)| is.then_some(name)).collect());
    if cores.controller.is_none() {
        feed.leave_out(&[MachineState::CHANNEL, Reference::CHANNEL, Request::CHANNEL]);
    }
    feed.fill()?;
    expect_exact(recorded, &feed)?;
    let mut channels = Channels {
        readings: Channel::new(feed.readings.waiting())?,
        samples: Channel::new(feed.samples.waiting())?,
        snapshots: Channel::new(feed.snapshots.waiting())?,
        commands: Channel::new(feed.commands.waiting())?,
        states: Channel::new(feed.states.waiting())?,
        shared: Shared { axes: names, machine: machine_of(&feed) },
    };
    let bar = progress(0, "ticks");
    let (mut last, mut tick) = (Last::default(), 0);
    let difference = loop {
        match cores.step(tick, &mut feed, &mut channels, &mut last)? {
            Step::Done => tick += 1,
            Step::End => break None,
            Step::Differs(difference) => break Some(*difference),
        }
        if tick % 1024 == 0 {
            bar.set_position(tick);
        }
    };
    bar.finish_and_clear();
    Ok(VerifyReport {
        ticks: tick,
        model_s: cores.machine.timing.period.as_secs_f64() * tick as f64,
        channels: cores.checked(&channels),
        identical: difference.is_none(),
        difference,
        lost: lost(&feed),
        damage: feed.damage().map(|damage| format!("byte {}: {}", damage.byte, damage.what)),
        is_cut: feed.damage().is_none_or(|damage| damage.is_cut),
    })
}

/// Messages of the compared channels that the recorder has missed.
fn lost(feed: &Feed) -> u64 {
    let channels = [
        EncoderReading::CHANNEL,
        EncoderSample::CHANNEL,
        CoefficientSnapshot::CHANNEL,
        ValveCommand::CHANNEL,
        MachineState::CHANNEL,
    ];
    channels.iter().filter_map(|channel| feed.fact(&format!("{channel} lost"))?.parse::<u64>().ok()).sum()
}

/// Refuses a recording that lacks something.
fn expect_exact(recorded: &Recorded, feed: &Feed) -> Result<(), Failure> {
    let refuse = |what: String| Err(Failure::usage(format!("{}: --verify: {what}", recorded.path.display())));
    let exact = [
        feed.readings.is_exact(),
        feed.samples.is_exact(),
        feed.snapshots.is_exact(),
        feed.commands.is_exact(),
        feed.states.is_exact(),
    ];
    if exact.contains(&false) {
        let version = recorded.facts.get("version").map_or("another version", String::as_str);
        return refuse(format!("found messages of {version} with other fields; allowed: those of this version"));
    }
    match feed.samples.peek() {
        None => refuse("found no sample; allowed: a recording of a run in lock-step".to_owned()),
        Some(sample) if sample.header.number > 0 && sample.header.sequence > 0 => refuse(format!(
            "found tick {} as the first one; allowed: a recording from tick 0 on: hydraxis run --lockstep --record \
             FILE",
            sample.header.sequence
        )),
        Some(_) => Ok(()),
    }
}

impl Cores {
    fn new(machine: Machine, recorded: &Recorded) -> Result<Self, Failure> {
        let is_simulated = machine.source == Source::Sim;
        let is_own = |kind: StageKind| machine.stage(kind).command.is_none();
        let seed = recorded.seed(&machine).filter(|_| is_own(StageKind::PlantSim));
        let plant = seed.map(|seed| PlantSim::new(&machine, seed).map_err(Failure::usage)).transpose()?;
        let controls = is_simulated && is_own(StageKind::ControlProc);
        Ok(Self {
            plant,
            acquisition: (is_simulated && is_own(StageKind::SensorProc)).then(|| Acquisition::new(&machine)),
            identifiers: is_own(StageKind::IdentProc).then(|| Identifiers::new(&machine)),
            controller: controls.then(|| ReplayedController::new(&machine, true)).transpose()?,
            states: States::new(&machine),
            machine,
        })
    }

    /// The channels that are computed, with what was compared of them.
    fn checked(&self, channels: &Channels) -> Vec<CheckedChannel> {
        let counts = [
            channels.readings.count(),
            channels.samples.count(),
            channels.snapshots.count(),
            channels.commands.count(),
            channels.states.count(),
        ];
        let checked = |((channel, is_computed), messages)| CheckedChannel { channel, is_computed, messages };
        self.computed().into_iter().zip(counts).map(checked).collect()
    }

    /// The channels of the loop, and whether they are computed.
    fn computed(&self) -> [(&'static str, bool); 5] {
        [
            (EncoderReading::CHANNEL, self.plant.is_some()),
            (EncoderSample::CHANNEL, self.acquisition.is_some()),
            (CoefficientSnapshot::CHANNEL, self.identifiers.is_some()),
            (ValveCommand::CHANNEL, self.controller.is_some()),
            (MachineState::CHANNEL, self.controller.is_some()),
        ]
    }

    /// Computes one tick.
    fn step(&mut self, tick: u64, feed: &mut Feed, channels: &mut Channels, last: &mut Last) -> Result<Step, Failure> {
        feed.fill()?;
        if let Some(difference) = feed.changed() {
            return Ok(Step::Differs(Box::new(difference)));
        }
        if let Some(difference) = self.between(tick, feed, channels, last) {
            return Ok(Step::Differs(Box::new(difference)));
        }
        if let Some(missing) = self.missing(feed) {
            return Ok(self.end(tick, missing, feed, channels));
        }
        Ok(match self.compute(tick, feed, channels, last) {
            Some(difference) => Step::Differs(Box::new(difference)),
            None => Step::Done,
        })
    }

    /// The end of the recording: nothing may be left but a part of this tick.
    fn end(&mut self, tick: u64, missing: &'static str, feed: &mut Feed, channels: &mut Channels) -> Step {
        if feed.damage().is_some() {
            return Step::End;
        }
        if waiting(feed) > 1 {
            return Step::Differs(Box::new(Difference {
                channel: missing.to_owned(),
                tick,
                axis: None,
                field: "message".to_owned(),
                recorded: "none".to_owned(),
                replayed: "one".to_owned(),
                by: By::Replay,
            }));
        }
        // A state of a tick that does not come.
        let state = if self.controller.is_some() { feed.states.pop() } else { None };
        let difference = state.and_then(|state| {
            let candidates = self.states.candidates(&state.message);
            channels.states.compare_any(candidates, &state, tick.saturating_sub(1), &channels.shared)
        });
        difference.map_or(Step::End, |difference| Step::Differs(Box::new(difference)))
    }

    /// The channel without a message of this tick.
    fn missing(&self, feed: &Feed) -> Option<&'static str> {
        let needs_readings = self.plant.is_some() || self.acquisition.is_some();
        [
            (needs_readings && feed.readings.peek().is_none(), EncoderReading::CHANNEL),
            (feed.samples.peek().is_none(), EncoderSample::CHANNEL),
            (feed.snapshots.peek().is_none(), CoefficientSnapshot::CHANNEL),
            (feed.commands.peek().is_none(), ValveCommand::CHANNEL),
        ]
        .into_iter()
        .find_map(|(is_missing, channel)| is_missing.then_some(channel))
    }

    /// The messages of a tick, in the order of the stages.
    fn compute(&mut self, tick: u64, feed: &mut Feed, channels: &mut Channels, last: &mut Last) -> Option<Difference> {
        let shared = &channels.shared;
        let reading = feed.readings.pop();
        if let (Some(plant), Some(recorded)) = (&mut self.plant, &reading) {
            if let Some(command) = &last.command {
                plant.command(command);
                plant.advance(self.machine.timing.period);
            }
            let mut replayed = plant.read();
            replayed.header.acquired_ns = recorded.message.header.acquired_ns;
            if let Some(difference) = channels.readings.compare(replayed, recorded, tick, shared) {
                return Some(difference);
            }
        }
        let sample = feed.samples.pop()?;
        if let (Some(acquisition), Some(reading)) = (&mut self.acquisition, &reading) {
            let header = reading.message.header;
            let mut replayed = acquisition.update(header.sequence, Some(&reading.message));
            replayed.header.acquired_ns = header.acquired_ns;
            if let Some(difference) = channels.samples.compare(replayed, &sample, tick, shared) {
                return Some(difference);
            }
        }
        let sample = sample.message;
        let snapshot = feed.snapshots.pop()?;
        if let Some(identifiers) = &mut self.identifiers {
            let mut replayed = CoefficientSnapshot::default();
            identifiers.update(&sample, last.command.as_ref(), &mut replayed);
            replayed.header.acquired_ns = sample.header.acquired_ns;
            if let Some(difference) = channels.snapshots.compare(replayed, &snapshot, tick, shared) {
                return Some(difference);
            }
        }
        let command = feed.commands.pop()?;
        if let Some(controller) = &mut self.controller {
            let replayed = controller.update(&sample, last.snapshot.as_ref(), &command.message, feed);
            if let Some(difference) = channels.commands.compare(replayed, &command, tick, &channels.shared) {
                return Some(difference);
            }
        }
        self.states.renew(&sample, last.snapshot.as_ref(), &command.message);
        *last = Last { sample: Some(sample), snapshot: Some(snapshot.message), command: Some(command.message) };
        None
    }

    /// Messages between the command before and that of this tick: commands without a sample, and states.
    fn between(&mut self, tick: u64, feed: &mut Feed, channels: &mut Channels, last: &Last) -> Option<Difference> {
        let controller = self.controller.as_mut()?;
        let shared = &channels.shared;
        while feed.commands.peek().is_some_and(ReplayedController::is_extra) {
            let command = feed.commands.pop()?;
            let before = last.sample.map_or(Header::default(), |sample| sample.header);
            // A run that ends may have read a sample without answering it.
            let next = feed.samples.peek().map(|sample| sample.header);
            let is_next = |next: &Header| next.sequence == command.message.header.sequence;
            let of = next.filter(|next| before.sequence != command.message.header.sequence && is_next(next));
            let replayed = controller.extra(&of.unwrap_or(before), &command.message);
            let tick = if of.is_some() { tick } else { before.sequence };
            if let Some(difference) = channels.commands.compare(replayed, &command, tick, shared) {
                return Some(difference);
            }
            self.states.repeat(&command.message);
        }
        let before = tick.saturating_sub(1);
        // A state that names a later tick is that of a later tick.
        while feed.states.peek().is_some_and(|state| state.header.sequence < tick.max(1)) {
            let has_begun = feed.states.peek().is_some_and(|state| state.header.acquired_ns > 0);
            if has_begun && tick == 0 {
                break;
            }
            let state = feed.states.pop()?;
            let candidates = self.states.candidates(&state.message);
            if let Some(difference) = channels.states.compare_any(candidates, &state, before, shared) {
                return Some(difference);
            }
        }
        None
    }
}

/// The machine that the first messages are about.
fn machine_of(feed: &Feed) -> u32 {
    let samples = feed.samples.waiting().iter().map(|typed| typed.message.header.machine);
    let commands = feed.commands.waiting().iter().map(|typed| typed.message.header.machine);
    most(samples.take(FIRST).chain(commands.take(FIRST)))
}

/// Most messages of a channel of each tick that have not been used.
fn waiting(feed: &Feed) -> usize {
    let counts = [
        feed.readings.waiting().len(),
        feed.samples.waiting().len(),
        feed.snapshots.waiting().len(),
        feed.commands.waiting().len(),
    ];
    counts.into_iter().max().unwrap_or_default()
}
