//! The loop as a table: a row for each sample, with the command that was made of it.

use std::collections::VecDeque;

use pipeline::message::{EncoderSample, Message, ValveCommand};

use crate::{
    failure::Failure,
    recording::{reading::ReadMessage, schema::Value},
};

use super::{Rows, Sheet};

/// Samples that wait for their commands.
const WAITING: usize = 64;
/// Columns of every axis from the sample, with their fields and units.
const OF_SAMPLE: [(&str, &str, &str); 3] =
    [("position", "position", "m"), ("velocity", "velocity", "m/s"), ("faults", "faults", "")];
/// Columns of every axis from the command, with their fields and units.
const OF_COMMAND: [(&str, &str, &str); 5] = [
    ("command", "command", ""),
    ("reference", "reference", "m"),
    ("error", "error", "m"),
    ("mode", "mode", ""),
    ("flags", "flags", ""),
];

/// A row that may wait for its command.
struct Row {
    tick: u64,
    acquired_ns: u64,
    of_sample: Vec<String>,
    of_command: Option<Vec<String>>,
}

/// The table of all ticks.
pub(super) struct LoopTable {
    /// Axes that were asked for; none for all.
    asked: Vec<String>,
    begin_ns: Option<u64>,
    waiting: VecDeque<Row>,
}

impl LoopTable {
    pub(super) fn new(asked: Vec<String>) -> Self {
        Self { asked, begin_ns: None, waiting: VecDeque::new() }
    }

    /// Indices of the axes of the table.
    fn axes<'a>(&self, axes: &'a [String]) -> Vec<(usize, &'a String)> {
        let is_asked = |(_, name): &(usize, &String)| self.asked.is_empty() || self.asked.contains(name);
        axes.iter().enumerate().filter(is_asked).collect()
    }

    fn values(&self, message: &ReadMessage, axes: &[String], fields: &[(&str, &str, &str)]) -> Vec<String> {
        let value = |name: String| {
            let value = message.channel.column(&name).and_then(|column| column.value(&message.bytes));
            value.map_or(String::new(), |value| value.to_string())
        };
        let of_axis = |(i, _): (usize, &String)| fields.iter().map(move |(_, field, _)| format!("axes[{i}].{field}"));
        self.axes(axes).into_iter().flat_map(of_axis).map(value).collect()
    }

    /// Writes the first row that waits.
    fn write(&mut self, axes: &[String], out: &mut Sheet) -> Result<(), Failure> {
        let Some(Row { tick, acquired_ns, of_sample, of_command, .. }) = self.waiting.pop_front() else { return Ok(()) };
        out.header(|| self.header(axes))?;
        let begin = *self.begin_ns.get_or_insert(acquired_ns);
        let t = acquired_ns.saturating_sub(begin) as f64 * 1e-9;
        let count = self.axes(axes).len();
        out.row(t, || {
            let mut row = vec![format!("{t:.9}"), tick.to_string()];
            let of_command = of_command.unwrap_or_else(|| vec![String::new(); OF_COMMAND.len() * count]);
            for axis in 0..count {
                row.extend_from_slice(&of_sample[axis * OF_SAMPLE.len()..][..OF_SAMPLE.len()]);
                row.extend_from_slice(&of_command[axis * OF_COMMAND.len()..][..OF_COMMAND.len()]);
            }
            row
        })
    }

    fn header(&self, axes: &[String]) -> Vec<(String, &'static str)> {
        let mut columns = vec![("t".to_owned(), "s"), ("tick".to_owned(), "")];
        for (_, axis) in self.axes(axes) {
            let all = OF_SAMPLE.iter().chain(&OF_COMMAND);
            columns.extend(all.map(|(name, _, unit)| (format!("{axis}.{name}"), *unit)));
        }
        columns
    }
}

impl Rows for LoopTable {
    fn message(&mut self, message: &ReadMessage, axes: &[String], out: &mut Sheet) -> Result<(), Failure> {
        let header = |name: &str| {
            let column = message.channel.column(&format!("header.{name}"));
            column.and_then(|column| column.value(&message.bytes)).map_or(0, Value::as_u64)
        };
        if message.channel.name == EncoderSample::CHANNEL {
            let of_sample = self.values(message, axes, &OF_SAMPLE);
            let (tick, acquired_ns) = (header("sequence"), header("acquired_ns"));
            self.waiting.push_back(Row { tick, acquired_ns, of_sample, of_command: None });
            if self.waiting.len() > WAITING {
                self.write(axes, out)?;
            }
        } else if message.channel.name == ValveCommand::CHANNEL {
            let (tick, acquired_ns) = (header("sequence"), header("acquired_ns"));
            let values = self.values(message, axes, &OF_COMMAND);
            // A session of sensor-proc begins at tick 0 again; the time of the acquisition tells the two apart.
            let is_answered = |row: &&mut Row| row.tick == tick && row.acquired_ns == acquired_ns;
            if let Some(row) = self.waiting.iter_mut().find(is_answered) {
                row.of_command = Some(values);
            }
            while self.waiting.front().is_some_and(|row| row.of_command.is_some()) {
                self.write(axes, out)?;
            }
        }
        Ok(())
    }

    fn finish(&mut self, axes: &[String], out: &mut Sheet) -> Result<(), Failure> {
        while !self.waiting.is_empty() {
            self.write(axes, out)?;
        }
        Ok(())
    }
}
