//! What a recording holds: facts, channels with their gaps, and what happened to the axes.

use std::{
    collections::BTreeMap,
    time::{Duration, UNIX_EPOCH},
};

use pipeline::message::{AxisMode, CoefficientSnapshot, ControlMode, Message, ValveCommand, bit_names, control_flag};
use serde::Serialize;

use crate::{
    recording::{
        Facts,
        reading::{Picked, ReadChannel, ReadMessage, Reading, ReadingError},
        recorder::SNAPSHOTS_FACT,
        schema::Value,
    },
    report::table::{number, table},
};

/// Lines of a terminal, one less for its prompt: the text has no more, unless all events are asked for.
const SCREEN: usize = 23;
/// Most events that are kept, and most lives of programs on a channel: what a file can ask for has no bound.
const MOST_EVENTS: usize = 100_000;
const MOST_SESSIONS: usize = 4096;
/// Facts of the first lines of the text; the others are in the JSON only.
const SHOWN_FACTS: [&[&str]; 2] = [&["machine", "axes"], &["group", "version"]];

/// Contents of a recording, as JSON has them.
#[derive(Debug, Serialize)]
pub struct ContentsReport {
    /// When the first message was read, RFC 3339.
    begin: Option<String>,
    duration_s: f64,
    facts: Facts,
    /// Names of the files in it.
    attached: Vec<String>,
    channels: Vec<ChannelReport>,
    events: Vec<Event>,
    /// Why it ends before its end.
    damage: Option<String>,
}

/// One channel.
#[derive(Debug, Default, Serialize)]
struct ChannelReport {
    channel: String,
    messages: u64,
    rate_hz: f64,
    /// Longest time between two messages, s.
    longest_gap_s: f64,
    /// Messages that are missing between those in the file.
    missing: u64,
    /// Lives of programs that sent on the channel: a stage that starts again begins another one.
    publishers: usize,
}

/// Something that happened to an axis.
#[derive(Debug, Serialize)]
struct Event {
    /// Time since the first message, s.
    at_s: f64,
    axis: String,
    #[serde(skip)]
    kind: Kind,
    what: String,
}

/// What kind of event it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Latch,
    Operation,
    Controller,
}

/// What is known of a channel while the file is read.
#[derive(Debug, Default)]
struct ChannelWatch {
    report: ChannelReport,
    first_ns: u64,
    last_ns: u64,
    /// Number of the last message of each session.
    last: BTreeMap<u64, u64>,
}

impl ChannelWatch {
    /// `apart`: one of so many messages is recorded.
    fn look(&mut self, message: &ReadMessage, apart: u64) {
        let channel = &message.channel;
        let field = |name: &str| Some(channel.column(name)?.value(&message.bytes)?.as_u64());
        if self.report.messages == 0 {
            (self.first_ns, self.last_ns) = (message.log_ns, message.log_ns);
        }
        let gap = message.log_ns.saturating_sub(self.last_ns) as f64 * 1e-9;
        self.report.longest_gap_s = self.report.longest_gap_s.max(gap);
        self.last_ns = self.last_ns.max(message.log_ns);
        self.report.messages += 1;
        let Some((session, number)) = field("header.session").zip(field("header.number")) else { return };
        if self.last.len() >= MOST_SESSIONS && !self.last.contains_key(&session) {
            return;
        }
        if let Some(last) = self.last.insert(session, number) {
            self.report.missing += number.saturating_sub(last).saturating_sub(1) / apart;
        }
    }

    fn finish(mut self, channel: &ReadChannel) -> ChannelReport {
        let seconds = self.last_ns.saturating_sub(self.first_ns) as f64 * 1e-9;
        let steps = self.report.messages.saturating_sub(1) as f64;
        self.report.rate_hz = if seconds > 0.0 { steps / seconds } else { 0.0 };
        self.report.publishers = self.last.len();
        self.report.channel = channel.name.clone();
        self.report
    }
}

/// Of how many snapshots one is recorded.
fn snapshots_apart(facts: &Facts) -> u64 {
    facts.get(SNAPSHOTS_FACT).and_then(|apart| apart.parse().ok()).map_or(1, |apart: u64| apart.max(1))
}

/// Numbers of an axis in a command that tell events.
const TELLING: [&str; 4] = ["operation", "mode", "latches", "latched_by"];

/// Finds events in the commands.
#[derive(Debug, Default)]
struct EventWatch {
    picked: Option<Picked>,
    /// The telling numbers of all axes in the last command.
    last: Vec<u64>,
    events: Vec<Event>,
}

impl EventWatch {
    fn look(&mut self, message: &ReadMessage, names: &[String], begin_ns: u64) {
        let at_s = message.log_ns.saturating_sub(begin_ns) as f64 * 1e-9;
        let picked = self.picked.get_or_insert_with(|| {
            let of_axis = |i: usize| TELLING.map(|field| format!("axes[{i}].{field}"));
            Picked::new((0..names.len()).flat_map(of_axis))
        });
        let now: Vec<u64> = picked.values(message).map(|value| value.map_or(0, Value::as_u64)).collect();
        let before = std::mem::replace(&mut self.last, now);
        let axes = names.iter().zip(before.chunks(TELLING.len())).zip(self.last.chunks(TELLING.len()));
        for ((name, before), now) in axes {
            if self.events.len() >= MOST_EVENTS {
                break;
            }
            let mut event = |kind, what: String| self.events.push(Event { at_s, axis: name.clone(), kind, what });
            let (operation, mode) = (now[0] as u32, now[1] as u32);
            if now[2] > before[2] {
                let faults: Vec<&str> = bit_names(now[3] as u32, &control_flag::NAMES).collect();
                event(Kind::Latch, format!("latched by {}", faults.join(", ")));
            }
            if now[0] != before[0] {
                let mode = AxisMode::from_number(operation).map_or("unknown", AxisMode::name);
                event(Kind::Operation, format!("operated: {mode}"));
            }
            if now[1] != before[1] {
                event(Kind::Controller, format!("commanded by: {}", ControlMode::name(mode)));
            }
        }
    }
}

impl ContentsReport {
    /// Reads a whole recording.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn read(mut reading: Reading) -> Result<Self, ReadingError> {
        let mut watches: BTreeMap<String, ChannelWatch> = BTreeMap::new();
        let mut events = EventWatch::default();
        let (mut begin, mut end) = (None, 0);
        while let Some(message) = reading.next()? {
            let begin_ns = *begin.get_or_insert(message.log_ns);
            end = message.log_ns.max(end);
            let is_snapshot = message.channel.name == CoefficientSnapshot::CHANNEL;
            let apart = if is_snapshot { snapshots_apart(reading.facts()) } else { 1 };
            watches.entry(message.channel.name.clone()).or_default().look(&message, apart);
            if message.channel.carries(ValveCommand::CHANNEL) {
                events.look(&message, &reading.axes(), begin_ns);
            }
        }
        let finish =
            |channel: &std::rc::Rc<ReadChannel>| watches.remove(&channel.name).unwrap_or_default().finish(channel);
        let channels = reading.channels().map(finish).collect();
        let begin_time = begin.map(|ns| humantime::format_rfc3339_millis(UNIX_EPOCH + Duration::from_nanos(ns)));
        Ok(Self {
            begin: begin_time.map(|time| time.to_string()),
            duration_s: end.saturating_sub(begin.unwrap_or(end)) as f64 * 1e-9,
            facts: reading.facts().clone(),
            attached: reading.attached().iter().map(|(name, _)| name.clone()).collect(),
            channels,
            events: events.events,
            damage: reading.damage().map(|damage| format!("byte {}: {}", damage.byte, damage.what)),
        })
    }

    /// Why a file without any channel has none; nothing of a file with channels.
    pub fn without_channel(&self) -> Option<&str> {
        self.channels.is_empty().then(|| self.damage.as_deref().unwrap_or("it ends in order"))
    }

    /// For people: one screen, or all events.
    pub fn text(&self, file: &str, all_events: bool) -> String {
        let begin = self.begin.as_deref().unwrap_or("without a message");
        let duration = humantime::format_duration(Duration::from_millis((self.duration_s * 1e3) as u64));
        let mut text = format!("{file}: {begin}, {duration}\n");
        if let Some(damage) = &self.damage {
            text += &format!("warning: read as far as it goes: {damage}\n");
        }
        for names in SHOWN_FACTS {
            let said = names.iter().filter_map(|name| Some(format!("{name} {}", self.facts.get(*name)?)));
            let said: Vec<String> = said.collect();
            text += &if said.is_empty() { String::new() } else { format!("{}\n", said.join(", ")) };
        }
        if let Some(cause) = self.facts.get("cause") {
            text += &format!("black box: {cause}\n");
        }
        if !self.attached.is_empty() {
            text += &format!("attached: {}\n", self.attached.join(", "));
        }
        let apart = snapshots_apart(&self.facts);
        if apart > 1 {
            text += &format!("{}: one of {apart} is recorded\n", CoefficientSnapshot::CHANNEL);
        }
        text += &format!("{}\n", self.channel_table());
        let lines = if all_events { usize::MAX } else { SCREEN.saturating_sub(text.lines().count()) };
        text + &self.event_text(lines)
    }

    fn channel_table(&self) -> String {
        let row = |channel: &ChannelReport| {
            let lost = self.facts.get(&format!("{} lost", channel.channel)).map_or("?", String::as_str);
            vec![
                channel.channel.clone(),
                channel.messages.to_string(),
                number(channel.rate_hz),
                number(1e3 * channel.longest_gap_s),
                channel.missing.to_string(),
                lost.to_owned(),
                channel.publishers.to_string(),
            ]
        };
        let header = ["channel", "messages", "Hz", "longest gap, ms", "missing", "lost", "publishers"];
        table(&header, self.channels.iter().map(row).collect()).to_string()
    }

    /// The events in so many lines; where there are more, a line for each axis says how many, and which was the first
    /// latch.
    fn event_text(&self, lines: usize) -> String {
        if self.events.len() <= lines {
            let line = |Event { at_s, axis, what, .. }: &Event| format!("{at_s:9.3} s  {axis}: {what}\n");
            return self.events.iter().map(line).collect();
        }
        let mut axes: Vec<&str> = Vec::new();
        for event in &self.events {
            if !axes.contains(&event.axis.as_str()) {
                axes.push(&event.axis);
            }
        }
        let line = |axis: &&str| {
            let of = |kind| self.events.iter().filter(move |event| event.axis == **axis && event.kind == kind);
            let first = of(Kind::Latch).next();
            let first = first.map_or(String::new(), |event| format!(", first at {:.3} s {}", event.at_s, event.what));
            let [latches, operations, controllers] =
                [Kind::Latch, Kind::Operation, Kind::Controller].map(|kind| of(kind).count());
            format!("{axis}: {latches} latches{first}; {operations} changes of mode, {controllers} of controller\n")
        };
        let said: String = axes.iter().map(line).collect();
        format!("{said}{} events: --events shows them\n", self.events.len())
    }
}
