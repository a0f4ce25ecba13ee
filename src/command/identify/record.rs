//! The samples of one or several recordings, one after the other, with the gaps between and within them.

use std::{
    fmt::Write,
    fs::File,
    io::{BufReader, Read},
    path::{Path, PathBuf},
};

use pipeline::{
    columns::{TableError, TableProblem},
    machine::IdentifiedOutput,
};
use sensor_proc::log::{Cause, Found, FoundColumn, Gap, Gaps, Log, PeriodChange};
use serde::Serialize;

use super::{
    dropout::{Dropouts, leave_out},
    recorded::{MCAP, read_log},
    standing,
};
use crate::{
    arguments::ColumnArguments,
    failure::Failure,
    model::prediction::{Samples, stretches},
    report::table::number,
};

/// Largest part by which the periods of two recordings may differ.
const PERIOD_TOLERANCE: f64 = 0.01;
/// Most gaps in the text of a report.
const SHOWN_GAPS: usize = 5;

/// Samples of all recordings: those for training, then those of `--test`.
#[derive(Debug)]
pub struct Record {
    /// Sample period, s.
    pub period: f64,
    /// Time of each row since the first row of its recording, s.
    pub times: Vec<f64>,
    /// Commands u(k).
    pub inputs: Vec<f64>,
    /// Outputs y(k).
    pub outputs: Vec<f64>,
    /// Whether a gap is before row k; true for the first row.
    pub begins: Vec<bool>,
    /// Rows of the recordings for training, where others are for the test.
    pub trained: Option<usize>,
    /// Number of steps of time within the stretches that are shorter than half of the median step.
    pub short_steps: usize,
    /// What was found in each file.
    pub recordings: Vec<ReadRecording>,
}

/// One recording, as JSON has it.
#[derive(Debug, Serialize)]
pub struct ReadRecording {
    file: String,
    /// Whether it is for the test only.
    test: bool,
    rows: usize,
    #[serde(flatten)]
    found: Found,
    gaps: Gaps,
    dropouts: Dropouts,
}

impl Record {
    /// Reads all recordings of the command line: those of `data`, then those of `test`.
    ///
    /// # Errors
    /// A recording cannot be read, or its period or units are not those of the first one.
    pub fn read(data: &[PathBuf], test: &[PathBuf], columns: &ColumnArguments) -> Result<Self, Failure> {
        let mut record = Self {
            period: 0.0,
            times: Vec::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            begins: Vec::new(),
            trained: None,
            short_steps: 0,
            recordings: Vec::new(),
        };
        // Mean of the periods: one recording, or several of the same period, leave it as it is.
        let mut rows = 0.0;
        let training = data.iter().map(|file| (file.as_path(), false));
        let files: Vec<_> = training.chain(test.iter().map(|file| (file.as_path(), true))).collect();
        expect_each_once(&files)?;
        for (file, test) in files {
            let log = read_log(file, columns)?;
            record.expect_the_same(file, &log)?;
            rows += log.outputs.len() as f64;
            record.period += (log.period - record.period) * (log.outputs.len() as f64 / rows);
            if test {
                record.trained.get_or_insert(record.outputs.len());
            }
            record.add(file, test, log);
        }
        Ok(record)
    }

    /// Refuses a recording that cannot be combined with the first one.
    fn expect_the_same(&self, file: &Path, log: &Log) -> Result<(), Failure> {
        let Some(first) = self.recordings.first() else { return Ok(()) };
        let refuse = |found: String, allowed: String| {
            let problems = vec![TableProblem { line: None, field: None, found, allowed }];
            Err(Failure::usage(TableError { file: file.to_owned(), problems }))
        };
        if (log.period / self.period - 1.0).abs() > PERIOD_TOLERANCE {
            let found = format!("a period of {} s", number(log.period));
            return refuse(found, format!("{} s, as before it ({})", number(self.period), first.file));
        }
        for (before, now) in [(&first.found.input, &log.found.input), (&first.found.output, &log.found.output)] {
            if before.becomes != now.becomes {
                let unit =
                    |column: &FoundColumn| column.becomes.map_or("no unit".into(), |unit| format!("the unit {unit}"));
                let allowed =
                    format!("{}, as in {} (or state it: --unit \"{}=UNIT\")", unit(before), first.file, now.name);
                return refuse(format!("{} for column \"{}\"", unit(now), now.name), allowed);
            }
        }
        Ok(())
    }

    fn add(&mut self, file: &Path, test: bool, mut log: Log) {
        let dropouts = leave_out(&mut log);
        let rows = log.outputs.len();
        self.times.extend(log.times.iter().map(|time| time - log.times[0]));
        self.inputs.extend(log.inputs);
        self.outputs.extend(log.outputs);
        self.begins.extend(log.begins);
        self.short_steps += log.short_steps;
        let file = file.display().to_string();
        self.recordings.push(ReadRecording { file, test, rows, found: log.found, gaps: log.gaps, dropouts });
    }

    /// The files in words.
    pub fn name(&self) -> String {
        let name = |recordings: &[&ReadRecording]| match recordings {
            [] => String::new(),
            [one] => one.file.clone(),
            [first, .., last] => format!("{} .. {} ({} recordings)", first.file, last.file, recordings.len()),
        };
        let (tests, training): (Vec<_>, Vec<_>) = self.recordings.iter().partition(|recording| recording.test);
        let tested = if tests.is_empty() { String::new() } else { format!(", tested on {}", name(&tests)) };
        name(&training) + &tested
    }

    /// The unit of what is identified, where a file or an option states that of the output.
    pub fn unit(&self, identified: IdentifiedOutput) -> Option<String> {
        let unit = self.recordings.first()?.found.output.becomes.filter(|unit| *unit != "1")?;
        Some(match identified {
            IdentifiedOutput::Position => unit.to_owned(),
            IdentifiedOutput::Velocity => format!("{unit}/s"),
        })
    }

    /// What is identified, row by row; NaN for the velocity of a row without one before it.
    pub fn identified(&self, output: IdentifiedOutput) -> Vec<f64> {
        let velocity = |k: usize| match self.begins[k] {
            true => f64::NAN,
            false => (self.outputs[k] - self.outputs[k - 1]) / self.period,
        };
        match output {
            IdentifiedOutput::Position => self.outputs.clone(),
            IdentifiedOutput::Velocity => (0..self.outputs.len()).map(velocity).collect(),
        }
    }

    /// Number of steps of time that no missing row explains: those shorter than half of the median step, and times that
    /// do not rise.
    pub fn irregular_steps(&self) -> usize {
        self.short_steps + self.recordings.iter().map(|recording| recording.gaps.times_not_rising).sum::<usize>()
    }

    /// Whether the samples are not one period apart: a period changes, or more than the `part` of the steps is
    /// irregular.
    pub fn is_irregular(&self, part: f64) -> bool {
        let changes = self.recordings.iter().any(|recording| recording.gaps.period_change.is_some());
        changes || self.irregular_steps() as f64 > part * self.outputs.len() as f64
    }

    /// Part of the rows in which the output stands though the command would move it; `horizon` in samples.
    pub fn standing(&self, horizon: usize) -> f64 {
        standing::part(&self.outputs, &self.inputs, &self.begins, horizon)
    }

    /// The rows of each stretch without a gap, as ranges.
    pub fn stretches(&self) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        stretches(&self.begins)
    }

    /// The rows for predictions.
    pub fn samples(&self) -> Samples<'_> {
        Samples { inputs: &self.inputs, outputs: &self.outputs, begins: &self.begins }
    }

    /// The first row of each recording.
    pub fn first_rows(&self) -> impl Iterator<Item = usize> + '_ {
        self.recordings.iter().scan(0, |next, recording| {
            let first = *next;
            *next += recording.rows;
            Some(first)
        })
    }
}

/// Refuses a recording that is given twice: it would count twice, or judge a model that knows it. With each file goes
/// whether it is for the test.
fn expect_each_once(files: &[(&Path, bool)]) -> Result<(), Failure> {
    for (i, (file, test)) in files.iter().enumerate() {
        let Some((twice, other)) = files[..i].iter().find(|(before, _)| is_same(before, file)) else { continue };
        let twice = twice.display();
        return Err(Failure::usage(if test == other {
            format!("found {}, which is {twice} once more; allowed: each recording once", file.display())
        } else {
            format!(
                "--test: found {twice}, which is a recording for training as well; allowed: recordings that no model \
                 has seen"
            )
        }));
    }
    Ok(())
}

/// Whether two paths lead to one file, or to two with the same contents. What cannot be read is told later.
fn is_same(one: &Path, two: &Path) -> bool {
    if matches!((one.canonicalize(), two.canonicalize()), (Ok(one), Ok(two)) if one == two) {
        return true;
    }
    let length = |path: &Path| path.metadata().ok().filter(|data| data.is_file()).map(|data| data.len());
    let bytes = |path: &Path| File::open(path).ok().map(|file| BufReader::new(file).bytes());
    let are_equal = || {
        let pairs = bytes(one)?.zip(bytes(two)?);
        Some(pairs.into_iter().all(|pair| matches!(pair, (Ok(one), Ok(two)) if one == two)))
    };
    length(one).is_some() && length(one) == length(two) && are_equal() == Some(true)
}

/// One line for each format, and one for each recording with gaps.
pub fn text(recordings: &[ReadRecording]) -> String {
    let mut text = String::new();
    for same in recordings.chunk_by(|a, b| a.found == b.found) {
        let names = match same {
            [one] => one.file.clone(),
            _ => format!("{} .. {} ({} recordings)", same[0].file, same[same.len() - 1].file, same.len()),
        };
        text += &format!("{names}: {}\n", format(&same[0].found));
        if let (true, Some(FoundColumn { name, .. })) = (same[0].found.is_time_doubtful, &same[0].found.time) {
            text += &format!(
                "warning: {names}: the times are taken as seconds, a second or more apart; otherwise state their unit: \
                 --unit \"{name}=ms\" for milliseconds, \"{name}=us\" (\"{name}=s\" ends this warning)\n"
            );
        }
        if let Some(timed) = same[0].found.contradicting_period_s {
            text += &format!("warning: {names}: --period is used, though the times are {} s apart\n", number(timed));
        }
    }
    for ReadRecording { file, gaps, .. } in recordings {
        if let Some(PeriodChange { line, seconds, before_s, after_s }) = gaps.period_change {
            text += &format!(
                "warning: {file}: the period changes from {} s to {} s at line {line}, {} s after the first row; make \
                 a recording of each part\n",
                number(before_s),
                number(after_s),
                number(seconds)
            );
        }
    }
    let with_gaps = recordings.iter().filter(|recording| recording.gaps.any());
    let with_dropouts = recordings.iter().filter(|recording| recording.dropouts.count > 0);
    text + &with_gaps.map(gaps).chain(with_dropouts.map(dropouts)).collect::<String>()
}

/// The dropouts of a file in words.
fn dropouts(ReadRecording { file, dropouts: Dropouts { count, rows, times_s }, .. }: &ReadRecording) -> String {
    let times: Vec<String> = times_s.iter().take(SHOWN_GAPS).map(|time| number(*time) + " s").collect();
    let more = if *count > times.len() { format!(", and {} more", count - times.len()) } else { String::new() };
    let name = if *count == 1 { "dropout" } else { "dropouts" };
    format!(
        "warning: {file}: {rows} rows left out, {count} {name} of the sensor, in which the output stands and to or \
         from which it jumps: after {}{more}\n",
        times.join(", ")
    )
}

/// The format of a file in words.
fn format(found: &Found) -> String {
    let unit = |column: &FoundColumn| match (&column.unit, column.becomes) {
        (Some(unit), Some("1")) if unit != "%" => String::new(),
        (Some(unit), Some("1")) => format!(" in {unit}, read as parts of 1"),
        (Some(unit), Some(becomes)) if unit != becomes => format!(" in {unit}, read as {becomes}"),
        (Some(unit), _) => format!(" in {unit}"),
        (None, _) => String::new(),
    };
    let time = match (&found.time, found.time_form) {
        (Some(time), Some("numbers")) => {
            let unit = time.unit.as_deref().unwrap_or("s");
            format!("time \"{}\" in {unit}", time.name)
        }
        (Some(time), Some(form)) => format!("time \"{}\" as {form}", time.name),
        _ => "no time".to_owned(),
    };
    let row = match (found.header, found.units_row) {
        (false, _) => ", no header",
        (true, true) => ", a row of units",
        (true, false) => "",
    };
    if found.separator == MCAP {
        return format!(
            "{MCAP}; time from the ticks, input \"{}\", output \"{}\"{}",
            found.input.name,
            found.output.name,
            unit(&found.output)
        );
    }
    format!(
        "{}, {}, {}{row}; {time}, input \"{}\"{}, output \"{}\"{}",
        found.separator,
        found.decimal,
        found.encoding,
        found.input.name,
        unit(&found.input),
        found.output.name,
        unit(&found.output)
    )
}

/// The gaps of a file in words.
fn gaps(recording: &ReadRecording) -> String {
    let ReadRecording { file, gaps, .. } = recording;
    let line = if recording.found.separator == MCAP { "tick" } else { "line" };
    let place = |number: usize| format!("{line} {number}");
    let count = |count: usize, one: &str, more: &str| match count {
        0 => None,
        1 => Some(format!("1 {one}")),
        _ => Some(format!("{count} {more}")),
    };
    let counts = [
        count(gaps.empty_rows, "row with an empty field", "rows with an empty field"),
        count(gaps.missing_rows, "place with missing rows", "places with missing rows"),
        count(gaps.times_not_rising, "time that does not rise", "times that do not rise"),
    ];
    let counts: Vec<String> = counts.into_iter().flatten().collect();
    let mut text = format!("{file}: gaps, over which nothing is combined: {}:", counts.join(", "));
    for Gap { line, cause } in gaps.places.iter().take(SHOWN_GAPS) {
        let cause = match cause {
            Cause::EmptyField { column } => format!("\"{column}\" empty"),
            Cause::MissingRows { seconds } => format!("{} s after the row before", number(*seconds)),
            Cause::TimeNotRising { seconds: 0.0 } => "the time of the row before".to_owned(),
            Cause::TimeNotRising { seconds } => format!("{} s backwards", number(-seconds)),
        };
        let _ = write!(text, " {} ({cause}),", place(*line));
    }
    let all = gaps.empty_rows + gaps.missing_rows + gaps.times_not_rising;
    let more = all.saturating_sub(SHOWN_GAPS);
    text.pop();
    text + &if more > 0 { format!(", and {more} more\n") } else { "\n".to_owned() }
}
