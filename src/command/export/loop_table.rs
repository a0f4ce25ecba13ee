//! The loop as a table: a row for each sample, with the command that was made of it.

use std::collections::VecDeque;

use pipeline::message::{EncoderSample, Message, ValveCommand};

use crate::{
    failure::Failure,
    recording::{
        reading::{Picked, ReadMessage},
        schema::{Kind, Value},
    },
};

use super::{Rows, sheet::Sheet, table::Heading};

/// Samples that wait for their commands, and commands for their samples. Each channel is read by itself, so either may
/// come first.
const WAITING: usize = 64;
/// Numbers of the header before those of the axes: the tick, and the time of its acquisition.
const OF_HEADER: [&str; 2] = ["header.sequence", "header.acquired_ns"];
/// Type of bits and of numbers of modes.
const BITS: Kind = Kind::Unsigned(4);
/// Columns of every axis from the sample, with their units.
const OF_SAMPLE: [(&str, &str, Kind); 3] =
    [("position", "m", Kind::Float), ("velocity", "m/s", Kind::Float), ("faults", "", BITS)];
/// Columns of every axis from the command, with their units.
const OF_COMMAND: [(&str, &str, Kind); 5] = [
    ("command", "", Kind::Float),
    ("reference", "m", Kind::Float),
    ("error", "m", Kind::Float),
    ("mode", "", BITS),
    ("flags", "", BITS),
];

/// Number of a tick, and time of its acquisition, ns. The time tells two of a number apart: a sensor-proc that starts
/// again may count from 0.
type Tick = (u64, u64);

/// A row that may wait for its command.
struct Row {
    tick: Tick,
    of_sample: Vec<Option<Value>>,
    of_command: Option<Vec<Option<Value>>>,
}

/// The table of all ticks.
pub(super) struct LoopTable {
    /// Axes that were asked for; none for all.
    asked: Vec<String>,
    /// Names of the axes of the table; none before the first message.
    axes: Option<Vec<String>>,
    sample: Picked,
    command: Picked,
    /// Period of the ticks, s, where they are the time of the machine.
    lock_step: Option<f64>,
    /// That of the first row.
    begin: Option<Tick>,
    waiting: VecDeque<Row>,
    /// What was commanded before its sample came.
    early: VecDeque<(Tick, Vec<Option<Value>>)>,
}

/// The tick of a message, and the numbers of the axes.
fn numbers(picked: &mut Picked, message: &ReadMessage) -> (Tick, Vec<Option<Value>>) {
    let mut values = picked.values(message);
    let mut header = || values.next().flatten().map_or(0, Value::as_u64);
    let tick = (header(), header());
    (tick, values.collect())
}

impl LoopTable {
    pub(super) fn new(asked: Vec<String>, lock_step: Option<f64>) -> Self {
        Self {
            asked,
            axes: None,
            sample: Picked::default(),
            command: Picked::default(),
            lock_step,
            begin: None,
            waiting: VecDeque::new(),
            early: VecDeque::new(),
        }
    }

    /// Chooses the axes of the table among those of the recording.
    fn choose(&mut self, all: &[String]) {
        let is_asked = |name: &String| self.asked.is_empty() || self.asked.contains(name);
        let chosen: Vec<(usize, &String)> = all.iter().enumerate().filter(|(_, name)| is_asked(name)).collect();
        let picked = |fields: &[(&str, &str, Kind)]| {
            let of_axes =
                chosen.iter().flat_map(|(i, _)| fields.iter().map(move |(name, ..)| format!("axes[{i}].{name}")));
            Picked::new(OF_HEADER.map(str::to_owned).into_iter().chain(of_axes))
        };
        (self.sample, self.command) = (picked(&OF_SAMPLE), picked(&OF_COMMAND));
        self.axes = Some(chosen.into_iter().map(|(_, name)| name.clone()).collect());
    }

    /// Writes the first row that waits.
    fn write(&mut self, out: &mut Sheet) -> Result<(), Failure> {
        let Some(Row { tick, of_sample, of_command }) = self.waiting.pop_front() else { return Ok(()) };
        let axes = self.axes.as_deref().unwrap_or_default();
        out.headings(|| headings(axes));
        let (first, begin_ns) = *self.begin.get_or_insert(tick);
        let (tick, acquired_ns) = tick;
        let t = match self.lock_step {
            Some(period) => tick.saturating_sub(first) as f64 * period,
            None => acquired_ns.saturating_sub(begin_ns) as f64 * 1e-9,
        };
        out.row(t, || {
            let mut row = vec![Some(Value::Unsigned(tick))];
            let of_command = of_command.unwrap_or_else(|| vec![None; OF_COMMAND.len() * axes.len()]);
            for (sample, command) in of_sample.chunks(OF_SAMPLE.len()).zip(of_command.chunks(OF_COMMAND.len())) {
                row.extend_from_slice(sample);
                row.extend_from_slice(command);
            }
            row
        })
    }
}

/// The columns but the time.
fn headings(axes: &[String]) -> Vec<Heading> {
    let all = || OF_SAMPLE.iter().chain(&OF_COMMAND);
    let of_axis = |axis: &String| {
        let heading =
            |(name, unit, kind): &(&str, &'static str, Kind)| Heading::new(format!("{axis}.{name}"), unit, *kind);
        all().map(heading).collect::<Vec<_>>()
    };
    [Heading::new("tick", "", Kind::Unsigned(8))].into_iter().chain(axes.iter().flat_map(of_axis)).collect()
}

impl Rows for LoopTable {
    fn message(&mut self, message: &ReadMessage, axes: &[String], out: &mut Sheet) -> Result<(), Failure> {
        if self.axes.is_none() {
            self.choose(axes);
        }
        if message.channel.carries(EncoderSample::CHANNEL) {
            let (tick, of_sample) = numbers(&mut self.sample, message);
            let early = self.early.iter().position(|(of, _)| *of == tick).and_then(|i| self.early.remove(i));
            self.waiting.push_back(Row { tick, of_sample, of_command: early.map(|(_, of_command)| of_command) });
            if self.waiting.len() > WAITING {
                self.write(out)?;
            }
        } else if message.channel.carries(ValveCommand::CHANNEL) {
            let (tick, of_command) = numbers(&mut self.command, message);
            match self.waiting.iter_mut().find(|row| row.tick == tick) {
                // A controller repeats a command when a stop comes between two samples; the first one was made of this.
                Some(row) => _ = row.of_command.get_or_insert(of_command),
                None => self.early.push_back((tick, of_command)),
            }
            if self.early.len() > WAITING {
                self.early.pop_front();
            }
        }
        while self.waiting.front().is_some_and(|row| row.of_command.is_some()) {
            self.write(out)?;
        }
        Ok(())
    }

    fn finish(&mut self, out: &mut Sheet) -> Result<(), Failure> {
        while !self.waiting.is_empty() {
            self.write(out)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::{
        command::export::{ExportArguments, TableFile, run},
        recording::{
            Facts,
            file::{Encoded, RecordingFile},
        },
    };

    /// A recording of one axis, with a sample for `Ok(tick)`, and for `Err((tick, command))` a command of it.
    fn recording(path: &Path, messages: &[Result<u64, (u64, f64)>]) {
        let facts: Facts = [("axes".to_owned(), "boom".to_owned())].into();
        let mut file = RecordingFile::create(path, &facts, &[], 1_000).unwrap();
        file.add_channel::<EncoderSample>().unwrap();
        file.add_channel::<ValveCommand>().unwrap();
        for (now, message) in (0..).zip(messages) {
            let encoded = match *message {
                Ok(tick) => {
                    let mut sample = EncoderSample::default();
                    (sample.header.sequence, sample.header.acquired_ns) = (tick, 1_000 * tick);
                    Encoded::new(now, &sample)
                }
                Err((tick, command)) => {
                    let mut valves = ValveCommand::default();
                    (valves.header.sequence, valves.header.acquired_ns) = (tick, 1_000 * tick);
                    valves.axes[0].command = command;
                    Encoded::new(now, &valves)
                }
            };
            file.write(&encoded).unwrap();
        }
        file.finish(&Facts::new()).unwrap();
    }

    #[test]
    fn a_command_that_was_read_before_its_sample_or_is_repeated_is_in_the_row_of_its_sample() {
        let folder = tempfile::tempdir().unwrap();
        let (file, csv) = (folder.path().join("run.mcap"), folder.path().join("run.csv"));
        let ordered = [Ok(1), Err((1, 0.1)), Err((1, 0.0)), Ok(2), Err((2, 0.2))];
        let early = [Err((3, 0.3)), Ok(3), Ok(4), Err((5, 0.5)), Err((5, 0.0)), Err((4, 0.4)), Ok(5), Ok(6)];
        recording(&file, &[&ordered[..], &early[..]].concat());
        let to = TableFile { csv: Some(csv.clone()), parquet: None };
        let (channel, axes) = (None, Vec::new());
        run(&ExportArguments { file, to, channel, axes, from: None, until: None, every: 1, units: false }).unwrap();
        let text = std::fs::read_to_string(csv).unwrap();
        let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let headings = lines.next().unwrap();
        let column = |name: &str| headings.iter().position(|heading| *heading == name).unwrap();
        let (tick, command) = (column("tick"), column("boom.command"));
        let rows: Vec<String> = lines.map(|row| format!("{}:{}", row[tick], row[command])).collect();
        assert_eq!(rows, ["1:0.1", "2:0.2", "3:0.3", "4:0.4", "5:0.5", "6:"]);
    }
}
