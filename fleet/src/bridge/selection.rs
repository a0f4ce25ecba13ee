//! What of a group is published, and when: the newest of each channel at its pace, models and events when they change.

use std::{
    collections::BTreeMap,
    sync::Arc,
    time::{Duration, Instant},
};

use pipeline::{
    cdr,
    message::{
        CoefficientSnapshot, EncoderSample, Header, MachineState, Message, StageHealth, StageState, ValveCommand,
        model_fault,
    },
    stage::StageKind,
};
use serde_json::{Value, json};

use super::{
    known::Shared,
    topic::{Outgoing, Topic},
};
use crate::{
    events::{Event, Events},
    group::Look,
    kernel::{clock_error_ns, utc_minus_monotonic_ns, utc_ns},
    pace::Pace,
    ring::Ring,
    settings::{Rates, Settings},
    stamp::{NOT_SYNCHRONISED, Stamp},
};

/// Time between two looks at the quality of the clock.
const CLOCK_APART: Duration = Duration::from_secs(1);
/// Least time between two models that are published because they have changed.
const MODELS_APART: Duration = Duration::from_secs(1);
/// Faults of a model whose change is a change of the model.
const MODEL_FAULTS: u32 = model_fault::LASTING | model_fault::ONE_SIDED | model_fault::UNSTABLE | model_fault::GAIN;

/// The newest message of a channel, until it is published.
type Newest<M> = Option<Box<M>>;

/// Messages that wait for their turn.
#[derive(Default)]
struct Waiting {
    sample: Newest<EncoderSample>,
    command: Newest<ValveCommand>,
    state: Newest<MachineState>,
    health: [Newest<StageHealth>; 4],
    model: Newest<CoefficientSnapshot>,
}

/// Paces of the keys.
struct Paces {
    sample: Pace,
    command: Pace,
    state: Pace,
    health: [Pace; 4],
    model: Pace,
    changed_model: Pace,
    status: Pace,
}

impl Paces {
    fn new(rates: &Rates) -> Self {
        Self {
            sample: Pace::per_second(rates.encoder_sample),
            command: Pace::per_second(rates.valve_command),
            state: Pace::per_second(rates.machine_state),
            health: std::array::from_fn(|_| Pace::per_second(rates.stage_health)),
            model: Pace::per_second(rates.model),
            changed_model: Pace::per_second(1.0 / MODELS_APART.as_secs_f64()),
            status: Pace::per_second(rates.status),
        }
    }
}

/// The clock of the machine, as it was last looked at.
struct Clock {
    offset_ns: i64,
    error_ns: u64,
    looked: Option<Instant>,
}

impl Clock {
    fn look(&mut self, now: Instant) {
        self.offset_ns = utc_minus_monotonic_ns();
        if self.looked.is_none_or(|looked| now - looked >= CLOCK_APART) {
            (self.looked, self.error_ns) = (Some(now), clock_error_ns());
        }
    }

    /// A time of `CLOCK_MONOTONIC` as time since 1970.
    fn utc_ns(&self, monotonic_ns: u64) -> i64 {
        monotonic_ns as i64 + self.offset_ns
    }
}

/// Decides what is published, and numbers it.
pub struct Selection {
    settings: Arc<Settings>,
    ring: Arc<Ring<Outgoing>>,
    shared: Arc<Shared>,
    /// Life of this bridge.
    run: u64,
    clock: Clock,
    waiting: Waiting,
    paces: Paces,
    /// Number of the next message of each key.
    numbers: [u64; Topic::ALL.len()],
    events: Events,
    /// Heartbeats that were heard last, with the time since 1970.
    stages: [Option<(Box<StageHealth>, i64)>; 4],
    /// The part of the models whose change counts.
    print: Vec<u8>,
    axes: Vec<String>,
}

impl Selection {
    /// Of a bridge that starts now.
    pub fn new(settings: Arc<Settings>, ring: Arc<Ring<Outgoing>>, shared: Arc<Shared>) -> Self {
        Self {
            paces: Paces::new(&settings.rates),
            settings,
            ring,
            shared,
            run: utc_ns() as u64,
            clock: Clock { offset_ns: utc_minus_monotonic_ns(), error_ns: clock_error_ns(), looked: None },
            waiting: Waiting::default(),
            numbers: [0; Topic::ALL.len()],
            events: Events::default(),
            stages: Default::default(),
            print: Vec::new(),
            axes: Vec::new(),
        }
    }

    /// Begins to look at a group.
    pub fn begin(&mut self, group: &str) {
        (self.events, self.stages, self.waiting) = (Events::default(), Default::default(), Waiting::default());
        self.print.clear();
        self.group_event(format!("the group \"{group}\" is read"));
    }

    /// The group has ended.
    pub fn end(&mut self, group: &str) {
        self.stages = Default::default();
        self.group_event(format!("the group \"{group}\" has ended"));
    }

    fn group_event(&mut self, text: String) {
        self.tell(Event { utc_ns: utc_ns(), axis: None, kind: "group", text });
    }

    /// Looks at the clock, before the messages of a turn.
    pub fn look_at_clock(&mut self, now: Instant) {
        self.clock.look(now);
    }

    /// Publishes what is due of what has come.
    pub fn publish(&mut self, now: Instant) {
        if let Some(sample) = self.waiting.sample.take_if(|_| self.paces.sample.is_due(now)) {
            self.offer(Topic::Sample, &*sample);
        }
        if let Some(command) = self.waiting.command.take_if(|_| self.paces.command.is_due(now)) {
            self.offer(Topic::Command, &*command);
        }
        if let Some(state) = self.waiting.state.take_if(|_| self.paces.state.is_due(now)) {
            self.offer(Topic::State, &*state);
        }
        for i in 0..self.waiting.health.len() {
            if let Some(health) = self.waiting.health[i].take_if(|_| self.paces.health[i].is_due(now)) {
                self.offer(Topic::Health, &*health);
            }
        }
        if let Some(model) = self.waiting.model.take() {
            self.model(model, now);
        }
    }

    /// Publishes models that have changed in what counts, and others at their pace.
    fn model(&mut self, model: Box<CoefficientSnapshot>, now: Instant) {
        let print = print_of(&model);
        let has_changed = print != self.print && self.paces.changed_model.is_due(now);
        if has_changed {
            self.print = print;
        }
        let stamp = if has_changed || self.paces.model.is_due(now) {
            self.offer(Topic::Model, &*model)
        } else {
            self.stamp(Topic::Model, self.time_of(Topic::Model, &model.header))
        };
        let mut known = self.shared.known();
        if has_changed {
            known.add_models((stamp, model.clone()));
        }
        known.model = Some((stamp, model));
    }

    /// Publishes the state of bridge and group, if it is due.
    pub fn status(&mut self, now: Instant, group: Option<&str>, unread: &BTreeMap<&str, u64>, refused_puts: u64) {
        if !self.paces.status.is_due(now) {
            return;
        }
        let now_ns = utc_ns();
        let published: BTreeMap<String, u64> =
            Topic::ALL.iter().zip(self.numbers).map(|(topic, number)| (topic.key(), number)).collect();
        let recordings = self.shared.known().recordings.as_ref().map(|found| match found {
            Ok(list) => json!(list.len()),
            Err(error) => json!(error),
        });
        let heard = self.stages.iter().flatten();
        let stages: Vec<Value> = heard.map(|(health, utc_ns)| stage(health, now_ns - utc_ns)).collect();
        let status = json!({
            "site": self.settings.site,
            "machine": self.settings.machine,
            "group": group,
            "version": env!("CARGO_PKG_VERSION"),
            "run": self.run,
            "utc_ns": now_ns,
            "clock_error_ns": Some(self.clock.error_ns).filter(|error| *error != NOT_SYNCHRONISED),
            "axes": self.axes,
            "stages": stages,
            "recordings": recordings,
            "bridge": {
                "published": published,
                "overwritten": self.ring.overwritten(),
                "refused_puts": refused_puts,
                "unread": unread,
            },
        });
        let bytes = status.to_string().into_bytes();
        self.shared.known().status.clone_from(&bytes);
        self.push(Topic::Status, now_ns, bytes);
    }

    fn tell(&mut self, event: Event) {
        // An event is a struct of texts and numbers, which JSON always takes.
        let bytes = serde_json::to_vec(&event).unwrap_or_default();
        self.push(Topic::Event, event.utc_ns, bytes);
        self.shared.known().add_event(event);
    }

    /// Hands a message to the network.
    fn offer<M: Message>(&mut self, topic: Topic, message: &M) -> Stamp {
        let mut bytes = Vec::new();
        cdr::encode(message, &mut bytes);
        let utc_ns = self.time_of(topic, message.header());
        self.push(topic, utc_ns, bytes)
    }

    /// What a message is about, ns since 1970: heartbeats and models are about the time of sending, since the axes of a
    /// model may rest; everything else is about its sample.
    fn time_of(&self, topic: Topic, header: &Header) -> i64 {
        let is_of_now = matches!(topic, Topic::Health | Topic::Model);
        self.clock.utc_ns(if is_of_now { header.sent_ns } else { header.acquired_ns })
    }

    fn push(&mut self, topic: Topic, utc_ns: i64, payload: Vec<u8>) -> Stamp {
        let stamp = self.stamp(topic, utc_ns);
        self.numbers[topic as usize] += 1;
        self.ring.push(Outgoing { topic, stamp, payload });
        stamp
    }

    fn stamp(&self, topic: Topic, utc_ns: i64) -> Stamp {
        let number = self.numbers[topic as usize];
        Stamp { run: self.run, number, utc_ns, clock_error_ns: self.clock.error_ns }
    }
}

impl Look for Selection {
    fn sample(&mut self, sample: &EncoderSample) {
        self.waiting.sample = Some(Box::new(*sample));
    }

    fn command(&mut self, command: &ValveCommand) {
        self.waiting.command = Some(Box::new(*command));
        let mut found = Vec::new();
        self.events.command(command, self.clock.utc_ns(command.header.sent_ns), |event| found.push(event));
        found.into_iter().for_each(|event| self.tell(event));
    }

    fn snapshot(&mut self, snapshot: &CoefficientSnapshot) {
        self.waiting.model = Some(Box::new(*snapshot));
    }

    fn state(&mut self, state: &MachineState) {
        self.events.state(state);
        let count = (state.header.axis_count as usize).min(state.axes.len());
        self.axes = state.axes[..count].iter().map(|axis| axis.name().to_owned()).collect();
        self.waiting.state = Some(Box::new(*state));
    }

    fn health(&mut self, health: &StageHealth) {
        let utc_ns = self.clock.utc_ns(health.header.sent_ns);
        let mut found = Vec::new();
        self.events.health(health, utc_ns, |event| found.push(event));
        found.into_iter().for_each(|event| self.tell(event));
        if let Some(stage) = self.stages.get_mut(health.stage as usize) {
            *stage = Some((Box::new(*health), utc_ns));
            self.waiting.health[health.stage as usize] = Some(Box::new(*health));
        }
    }
}

/// The part of the models whose change counts: the classical coefficients, and faults that last.
fn print_of(model: &CoefficientSnapshot) -> Vec<u8> {
    let mut print = cdr::ENCAPSULATION.to_vec();
    for axis in &model.axes[..(model.header.axis_count as usize).min(model.axes.len())] {
        cdr::append(&axis.classical, &mut print);
        cdr::append(&(axis.faults & MODEL_FAULTS), &mut print);
    }
    print
}

/// A stage in the state of the group.
fn stage(health: &StageHealth, silent_ns: i64) -> Value {
    json!({
        "stage": StageKind::ALL.get(health.stage as usize).map(|kind| kind.name()),
        "pid": health.pid,
        "state": StageState::name(health.state),
        "heard_ns": silent_ns,
        "tick": health.header.sequence,
        "lost": health.lost(),
        "late": health.missed.total(),
    })
}
