//! The positions and commands of axes at every tick, out of a recording.
//!
//! ```text
//! row k:   y(k) from the sample of tick k,   u(k) from the first command with the number of this sample
//! ```
//!
//! y position in m, u valve command in [-1, 1]. Ticks that are missing in the numbers of the samples, or that have no
//! command, are gaps.
//!
//! Trap: a controller repeats a command, or sends a neutral one, when a stop comes between two samples. Such a message
//! has the number of the sample before; only the first command of a sample is u(k).

use std::{
    error::Error,
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use pipeline::{
    machine::Machine,
    message::{EncoderSample, Message, ValveCommand, sample_fault},
    nearest::did_you_mean,
};
use sensor_proc::Recording;
use thiserror::Error as ThisError;

use super::{
    reading::{Picked, ReadMessage, Reading, ReadingError},
    schema::Value,
};

/// First bytes of every MCAP file.
const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Why a recording has no rows of an axis.
#[derive(Debug, ThisError)]
pub enum RowsError {
    /// It cannot be read.
    #[error(transparent)]
    Reading(#[from] ReadingError),
    /// It has no axis of this name.
    #[error("{}: found no axis \"{axis}\"; allowed: one of {allowed}", .file.display())]
    Axis {
        /// The file.
        file: PathBuf,
        /// The axis that was asked for.
        axis: String,
        /// The axes of the recording.
        allowed: String,
    },
    /// It has no row.
    #[error("{}: found no sample with a command; allowed: at least one", .0.display())]
    Empty(PathBuf),
    /// Neither the facts nor the times tell a period.
    #[error("{}: found no period of the ticks; allowed: the fact period_s, or two samples", .0.display())]
    Period(PathBuf),
    /// A replay needs every tick.
    #[error(
        "{}: tick {tick}: found {missing} ticks without sample or command before it; allowed: none for a replay",
        .file.display()
    )]
    Gap {
        /// The file.
        file: PathBuf,
        /// The tick after the gap.
        tick: u64,
        /// Ticks in the gap.
        missing: u64,
    },
}

/// One axis at one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Number of the tick.
    pub tick: u64,
    /// y(k), m.
    pub position: f64,
    /// u(k).
    pub command: f64,
    /// The position was plausible.
    pub is_usable: bool,
}

/// The rows of all axes of a recording that were asked for.
#[derive(Debug)]
pub struct Rows {
    /// Control period, s.
    pub period: f64,
    /// Rows of each axis, with rising ticks.
    pub axes: Vec<Vec<Row>>,
}

/// Whether a file begins as a recording does, or has the ending of one.
pub fn is_recording(file: &Path) -> bool {
    let mut magic = [0; MAGIC.len()];
    let read = File::open(file).and_then(|mut file| file.read_exact(&mut magic));
    file.extension().is_some_and(|ending| ending == "mcap") || (read.is_ok() && magic == MAGIC)
}

/// Names of the axes of a recording.
///
/// # Errors
/// It cannot be read.
pub fn axes_of(file: &Path) -> Result<Vec<String>, ReadingError> {
    let mut reading = Reading::open(file)?;
    while reading.axes().is_empty() && reading.next()?.is_some() {}
    Ok(reading.axes())
}

impl Rows {
    /// Reads the rows of these axes.
    ///
    /// # Errors
    /// The file cannot be read, lacks an axis, or has no row.
    pub fn read(file: &Path, axes: &[&str]) -> Result<Self, RowsError> {
        let known = axes_of(file)?;
        let index = |axis: &&str| {
            known.iter().position(|name| name == axis).ok_or_else(|| RowsError::Axis {
                file: file.to_owned(),
                axis: (*axis).to_owned(),
                allowed: format!("{}{}", known.join(", "), did_you_mean(axis, known.iter().map(String::as_str))),
            })
        };
        let indices: Vec<usize> = axes.iter().map(index).collect::<Result<_, _>>()?;
        let mut columns = Columns::new(&indices);
        let mut reading = Reading::open(file)?;
        while let Some(message) = reading.next()? {
            columns.take(&message);
        }
        if let Some(damage) = reading.damage() {
            eprintln!("warning: {}: read as far as it goes: byte {}: {}", file.display(), damage.byte, damage.what);
        }
        let stated = reading.facts().get("period_s").and_then(|period| period.parse().ok());
        let rows = columns.rows();
        if rows.first().is_none_or(Vec::is_empty) {
            return Err(RowsError::Empty(file.to_owned()));
        }
        let period = stated.or_else(|| columns.period()).ok_or_else(|| RowsError::Period(file.to_owned()))?;
        Ok(Self { period, axes: rows })
    }
}

/// What the messages of a recording say of some axes.
struct Columns {
    samples: Picked,
    commands: Picked,
    /// Tick and time of acquisition (ns) of each sample.
    ticks: Vec<(u64, u64)>,
    /// Position and faults of all axes for each sample.
    positions: Vec<(f64, u64)>,
    /// Tick of each command.
    commanded: Vec<u64>,
    /// Commands of all axes for each of them.
    values: Vec<f64>,
    axes: usize,
}

impl Columns {
    fn new(indices: &[usize]) -> Self {
        let names = |header: &[&str], fields: &[&str]| {
            let header = header.iter().map(|name| format!("header.{name}"));
            let axes = indices.iter().flat_map(|i| fields.iter().map(move |field| format!("axes[{i}].{field}")));
            Picked::new(header.chain(axes).collect::<Vec<_>>())
        };
        Self {
            samples: names(&["sequence", "acquired_ns"], &["position", "faults"]),
            commands: names(&["sequence"], &["command"]),
            ticks: Vec::new(),
            positions: Vec::new(),
            commanded: Vec::new(),
            values: Vec::new(),
            axes: indices.len(),
        }
    }

    /// Takes in a message. One whose number does not rise repeats the one before.
    fn take(&mut self, message: &ReadMessage) {
        let number = |value: Option<Value>| match value {
            Some(Value::Float(value)) => value,
            _ => f64::NAN,
        };
        let whole = |value: Option<Value>| value.map_or(0, Value::as_u64);
        if message.channel.name == EncoderSample::CHANNEL {
            let values: Vec<_> = self.samples.values(message).collect();
            let tick = whole(values[0]);
            if self.ticks.last().is_none_or(|(last, _)| tick > *last) {
                self.ticks.push((tick, whole(values[1])));
                self.positions.extend(values[2..].chunks(2).map(|axis| (number(axis[0]), whole(axis[1]))));
            }
        } else if message.channel.name == ValveCommand::CHANNEL {
            let values: Vec<_> = self.commands.values(message).collect();
            let tick = whole(values[0]);
            if self.commanded.last().is_none_or(|last| tick > *last) {
                self.commanded.push(tick);
                self.values.extend(values[1..].iter().map(|value| number(*value)));
            }
        }
    }

    /// The rows of each axis: samples with a command.
    fn rows(&self) -> Vec<Vec<Row>> {
        let mut rows = vec![Vec::new(); self.axes];
        let mut next = 0;
        for (k, (tick, _)) in self.ticks.iter().enumerate() {
            while self.commanded.get(next).is_some_and(|commanded| commanded < tick) {
                next += 1;
            }
            if self.commanded.get(next) != Some(tick) {
                continue;
            }
            for (axis, rows) in rows.iter_mut().enumerate() {
                let (position, faults) = self.positions[k * self.axes + axis];
                let command = self.values[next * self.axes + axis];
                let is_usable = position.is_finite() && faults & u64::from(sample_fault::UNUSABLE) == 0;
                if command.is_finite() {
                    rows.push(Row { tick: *tick, position, command, is_usable });
                }
            }
        }
        rows
    }

    /// Median time between two ticks, s.
    fn period(&self) -> Option<f64> {
        let pairs = self.ticks.windows(2).filter(|pair| pair[1].1 > pair[0].1);
        let step = |pair: &[(u64, u64)]| (pair[1].1 - pair[0].1) as f64 / (pair[1].0 - pair[0].0) as f64;
        let mut steps: Vec<f64> = pairs.map(step).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).map(|step| step * 1e-9)
    }
}

/// Reads the recordings of all axes of a machine for a replay: CSV, or MCAP with axes of the same names.
///
/// # Errors
/// The file cannot be read, lacks an axis, has gaps, or was recorded with another period than the machine's.
pub fn read_recordings(machine: &Machine, file: &Path) -> Result<Vec<Recording>, Box<dyn Error + Send + Sync>> {
    if !is_recording(file) {
        return Ok(Recording::read_all(machine, file)?);
    }
    let names: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    let Rows { period, axes } = Rows::read(file, &names)?;
    axes.into_iter()
        .map(|rows| {
            let gap = rows.windows(2).find(|pair| pair[1].tick != pair[0].tick + 1);
            if let Some(&[before, after]) = gap {
                let (tick, missing) = (after.tick, after.tick - before.tick - 1);
                return Err(RowsError::Gap { file: file.to_owned(), tick, missing }.into());
            }
            let recording = Recording {
                period,
                inputs: rows.iter().map(|row| row.command).collect(),
                outputs: rows.iter().map(|row| row.position).collect(),
                irregular_steps: 0,
            };
            recording.expect_period(machine.timing.period, file)?;
            Ok(recording)
        })
        .collect()
}
