//! `hydraxis-fleet top`: all machines in a table, with the age of everything.

use pipeline::message::{AxisMode, EncoderSample, Message, ValveCommand, bit_names, control_flag};
use serde::Serialize;
use serde_json::Value;

use crate::{
    fleet::{Counts, Fleet, Machine},
    key::{self, Place},
    stamp::NOT_SYNCHRONISED,
};

/// So many times older than a sample may what a bridge says of itself be: it says so once a second.
const STATUS_SLOWER: i64 = 3;

/// How a machine is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// Its newest sample is fresh.
    Live,
    /// Its newest sample, or what its bridge says, is old.
    Stale,
    /// Its bridge says that no group runs.
    NoGroup,
    /// Its bridge has left, and what there is, is old.
    Gone,
    /// Its time is still to come: a clock is wrong.
    Clock,
}

impl State {
    /// As a word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Live => "live",
            Self::Stale => "STALE",
            Self::NoGroup => "no group",
            Self::Gone => "GONE",
            Self::Clock => "CLOCK",
        }
    }

    fn of(fleet: &Fleet, machine: &Machine, sample_ns: Option<i64>, status_ns: Option<i64>) -> Self {
        let is_fresh = |age_ns: Option<i64>| age_ns.is_some_and(|age_ns| fleet.is_fresh(age_ns));
        let has_no_group = machine.newest.status.as_ref().is_some_and(|status| status["group"].is_null());
        match () {
            () if is_fresh(sample_ns) => Self::Live,
            () if sample_ns.or(status_ns).is_some_and(|age_ns| age_ns < 0) => Self::Clock,
            () if has_no_group && is_fresh(status_ns.map(|age_ns| age_ns / STATUS_SLOWER)) => Self::NoGroup,
            () if machine.is_alive => Self::Stale,
            () => Self::Gone,
        }
    }
}

/// An axis of a machine, as old as the newest command.
#[derive(Debug, Serialize)]
pub struct Axis {
    /// Its name.
    pub name: String,
    /// Position, m; none before the first plausible one.
    pub position: Option<f64>,
    /// Valve command in [-1, 1].
    pub command: f64,
    /// Following error, m.
    pub error: f64,
    /// Mode.
    pub mode: &'static str,
    /// Flags.
    pub flags: Vec<&'static str>,
}

/// A machine in the table.
#[derive(Debug, Serialize)]
pub struct Row {
    /// Its site.
    pub site: String,
    /// Its name.
    pub machine: String,
    /// How it is.
    pub state: State,
    /// Whether the token of its bridge is there.
    pub alive: bool,
    /// Age of the newest message by key, s.
    pub age_s: std::collections::BTreeMap<String, f64>,
    /// Its group.
    pub group: Option<String>,
    /// Its axes.
    pub axes: Vec<Axis>,
    /// Messages by what became of them.
    pub counts: Counts,
    /// Messages that its bridge has overwritten before they were sent, and messages of the group that it has not read.
    pub overwritten: u64,
    /// Messages of the group that its bridge has not read.
    pub unread: u64,
    /// Largest error of its clock, s; none where nothing synchronises it.
    pub clock_error_s: Option<f64>,
    /// What happened last.
    pub event: Option<Value>,
}

impl Row {
    fn new(fleet: &Fleet, place: &Place, machine: &Machine, now_ns: i64) -> Self {
        let sample_ns = machine.age_ns(&key::telemetry(EncoderSample::CHANNEL), now_ns);
        let status_ns = machine.age_ns(key::STATUS, now_ns);
        let status = machine.newest.status.as_ref();
        let bridge = |of: &str| status.map_or(&Value::Null, |status| &status["bridge"][of]);
        let error = machine.stamps.values().max_by_key(|stamp| stamp.utc_ns).map(|stamp| stamp.clock_error_ns);
        Self {
            site: place.site.to_string(),
            machine: place.machine.to_string(),
            state: State::of(fleet, machine, sample_ns, status_ns),
            alive: machine.is_alive,
            age_s: machine
                .stamps
                .iter()
                .map(|(key, stamp)| (key.clone(), stamp.age_ns(now_ns) as f64 * 1e-9))
                .collect(),
            group: status.and_then(|status| status["group"].as_str()).map(str::to_owned),
            axes: axes(machine),
            counts: machine.counts,
            overwritten: bridge("overwritten").as_u64().unwrap_or(0),
            unread: bridge("unread").as_object().map_or(0, |of| of.values().filter_map(Value::as_u64).sum()),
            clock_error_s: error.filter(|error| *error != NOT_SYNCHRONISED).map(|error| error as f64 * 1e-9),
            event: machine.newest.event.clone(),
        }
    }

    fn age_of(&self, key: &str) -> String {
        self.age_s.get(key).map_or("-".to_owned(), |age| seconds(*age))
    }
}

fn axes(machine: &Machine) -> Vec<Axis> {
    let Some(state) = &machine.newest.state else { return Vec::new() };
    let count = (state.header.axis_count as usize).min(state.axes.len());
    let one = |i: usize| {
        let named = &state.axes[i];
        let command = machine.newest.command.as_ref().map_or(&named.command, |command| &command.axes[i]);
        let sample = machine.newest.sample.as_ref().map_or(&named.sample, |sample| &sample.axes[i]);
        Axis {
            name: named.name().to_owned(),
            position: sample.last_plausible(),
            command: command.command,
            error: command.error,
            mode: AxisMode::from_number(command.operation).map_or("unknown", AxisMode::name),
            flags: bit_names(command.flags, &control_flag::NAMES).collect(),
        }
    };
    (0..count).map(one).collect()
}

/// All machines at a time.
pub fn rows(fleet: &Fleet, now_ns: i64) -> Vec<Row> {
    fleet.machines().iter().map(|(place, machine)| Row::new(fleet, place, machine, now_ns)).collect()
}

/// Columns of the table; those from the fourth to the last but one are numbers.
const COLUMNS: [&str; 15] = [
    "site",
    "machine",
    "state",
    "group",
    "sample",
    "status",
    "model",
    "armed",
    "latched",
    "lost",
    "late",
    "refused",
    "unread",
    "overwritten",
    "clock",
];

/// The rows as a table; with `has_axes` a line for each axis.
pub fn table(rows: &[Row], has_axes: bool) -> String {
    let cells: Vec<[String; COLUMNS.len()]> = rows.iter().map(cells).collect();
    let heading = COLUMNS.map(str::to_owned);
    let width = |i: usize| cells.iter().chain([&heading]).map(|line| line[i].len()).max().unwrap_or(0);
    let widths: [usize; COLUMNS.len()] = std::array::from_fn(width);
    let line = |cells: &[String; COLUMNS.len()]| {
        let padded = cells.iter().zip(widths).enumerate().map(|(i, (cell, width))| match i {
            0..=3 => format!(" {cell:width$} "),
            14 => format!(" {cell}"),
            _ => format!(" {cell:>width$} "),
        });
        padded.collect::<String>() + "\n"
    };
    let mut text = line(&heading);
    for (row, cells) in rows.iter().zip(&cells) {
        text += &line(cells);
        if has_axes {
            row.axes.iter().for_each(|axis| text += &axis_line(row, axis));
        }
    }
    text
}

fn cells(row: &Row) -> [String; COLUMNS.len()] {
    let latches: Vec<&str> = bit_names(control_flag::LATCHED, &control_flag::NAMES).collect();
    let latched = row.axes.iter().filter(|axis| axis.flags.iter().any(|flag| latches.contains(flag))).count();
    let armed = row.axes.iter().filter(|axis| axis.mode != AxisMode::Off.name()).count();
    // What is old says nothing about now.
    let now = |count: usize| if row.state == State::Live { count.to_string() } else { "?".to_owned() };
    [
        row.site.clone(),
        row.machine.clone(),
        row.state.name().to_owned(),
        row.group.clone().unwrap_or("-".to_owned()),
        row.age_of(&key::telemetry(EncoderSample::CHANNEL)),
        row.age_of(key::STATUS),
        row.age_of(key::MODEL),
        now(armed),
        now(latched),
        row.counts.lost.to_string(),
        row.counts.late.to_string(),
        (row.counts.unknown + row.counts.malformed + row.counts.repeated).to_string(),
        row.unread.to_string(),
        row.overwritten.to_string(),
        row.clock_error_s.map_or("not synchronised".to_owned(), |error| format!("{:.0} ms", 1e3 * error)),
    ]
}

fn axis_line(row: &Row, axis: &Axis) -> String {
    let position = axis.position.map_or("-".to_owned(), |position| format!("{position:.4} m"));
    let age = row.age_of(&key::telemetry(ValveCommand::CHANNEL));
    let age = if row.state == State::Live { String::new() } else { format!("  ({age} ago)") };
    format!(
        "   {:12}  {:8}  {:+.4}  {position:>10}  {:+8.2} mm  {}{age}\n",
        axis.name,
        axis.mode,
        axis.command,
        1e3 * axis.error,
        if axis.flags.is_empty() { "-".to_owned() } else { axis.flags.join(" ") }
    )
}

fn seconds(age: f64) -> String {
    if age.abs() < 100.0 { format!("{age:.2} s") } else { format!("{age:.0} s") }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use pipeline::{cdr, message::MachineState};

    use super::*;
    use crate::{content, stamp::Stamp};

    const SECOND: i64 = 1_000_000_000;

    fn put<M: Message>(fleet: &mut Fleet, message: &M, number: u64, utc_ns: i64, now_ns: i64) {
        let mut payload = Vec::new();
        cdr::encode(message, &mut payload);
        let stamp = Stamp { run: 1, number, utc_ns, clock_error_ns: NOT_SYNCHRONISED };
        let key = format!("hydraxis/v1/quarry/ex-07/{}", key::telemetry(M::CHANNEL));
        fleet.take(&key, &content::name_of::<M>(), &payload, &stamp.to_bytes(), now_ns);
    }

    #[test]
    fn what_is_old_is_shown_as_old_and_says_nothing_about_now() {
        let mut fleet = Fleet::new(Duration::from_secs(1));
        let (mut state, mut command) = (MachineState::default(), ValveCommand::default());
        (state.header.axis_count, command.header.axis_count) = (1, 1);
        state.axes[0].set_name("boom");
        command.axes[0].operation = AxisMode::Track as u32;
        command.axes[0].flags = control_flag::STALL;
        put(&mut fleet, &state, 0, 0, 0);
        put(&mut fleet, &command, 0, 0, 0);
        put(&mut fleet, &EncoderSample::default(), 0, 0, 0);
        fleet.alive("hydraxis/v1/quarry/ex-07/alive", true);
        let live = rows(&fleet, SECOND / 2);
        assert_eq!((live[0].state, live[0].axes[0].flags.clone()), (State::Live, vec!["stall"]));
        let shown = table(&live, true);
        assert!(shown.contains("live") && shown.contains("0.50 s") && shown.contains("not synchronised"), "{shown}");
        let line: Vec<&str> = shown.lines().nth(1).unwrap().split_whitespace().collect();
        assert!(line.windows(2).any(|pair| pair == ["1", "1"]), "one armed, one latched: {shown}");

        let stale = rows(&fleet, 30 * SECOND);
        let shown = table(&stale, true);
        assert_eq!(stale[0].state, State::Stale);
        assert!(shown.contains("STALE") && shown.contains("30.00 s") && shown.contains("(30.00 s ago)"), "{shown}");
        assert!(shown.contains("  ?  "), "{shown}");
        fleet.alive("hydraxis/v1/quarry/ex-07/alive", false);
        assert_eq!(rows(&fleet, 30 * SECOND)[0].state, State::Gone);
        assert_eq!(rows(&fleet, -10 * SECOND)[0].state, State::Clock);
    }
}
