//! The core of each source: what becomes a sample.

use std::{path::Path, time::Duration};

use pipeline::{
    machine::Machine,
    message::{AxisCommand, ControlMode, EncoderReading, EncoderSample, ValveCommand},
};

use crate::{
    plausibility::Plausibility,
    record::{Record, RecordError},
};

/// Encoder readings to samples: scaling and plausibility.
#[derive(Debug, Clone)]
pub struct Acquisition {
    checks: Vec<Plausibility>,
    resolutions: Vec<f64>,
    /// Tick of the last sample.
    last: Option<u64>,
    /// As last seen.
    emergency_stop: u32,
}

impl Acquisition {
    /// For all axes of a machine.
    pub fn new(machine: &Machine) -> Self {
        Self {
            checks: machine.axes.iter().map(|axis| Plausibility::new(axis, machine.timing.period)).collect(),
            resolutions: machine.axes.iter().map(|axis| axis.encoder.resolution).collect(),
            last: None,
            emergency_stop: 0,
        }
    }

    /// The sample of tick `sequence` from the reading that belongs to it, or from none.
    ///
    /// A reading with another number of axes is none, but that an emergency stop in it counts; without a reading the
    /// stop stays as it was last seen. The times of the header are for the process to fill in.
    pub fn update(&mut self, sequence: u64, reading: Option<&EncoderReading>) -> EncoderSample {
        let elapsed = self.last.replace(sequence).map_or(1, |last| sequence.saturating_sub(last));
        let pressed = reading.map_or(0, |reading| reading.emergency_stop);
        let reading = reading.filter(|reading| reading.header.axis_count as usize == self.checks.len());
        if reading.is_some() || pressed != 0 {
            self.emergency_stop = pressed;
        }
        let mut sample = EncoderSample { emergency_stop: self.emergency_stop, ..EncoderSample::default() };
        sample.header.sequence = sequence;
        sample.header.axis_count = self.checks.len() as u32;
        for (i, (check, resolution)) in self.checks.iter_mut().zip(&self.resolutions).enumerate() {
            let encoder = reading.map(|reading| &reading.encoders[i]);
            let position = encoder.map(|encoder| encoder.counts as f64 * resolution);
            sample.axes[i] = check.judge(elapsed, position, encoder.is_some_and(|encoder| encoder.error != 0));
        }
        sample
    }
}

/// A recording in the place of encoders and controller.
#[derive(Debug, Clone)]
pub struct Replay {
    checks: Vec<Plausibility>,
    records: Vec<Record>,
}

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// The file.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The period of the file is not that of the machine.
    #[error(
        "{file}: found a period of {found:.6} s; allowed: that of the machine file, timing.period = {expected:.6} s"
    )]
    Period {
        /// The file.
        file: String,
        /// Its period, s.
        found: f64,
        /// The machine's, s.
        expected: f64,
    },
}

/// Largest part by which a record's mean period may differ from the machine's.
const PERIOD_TOLERANCE: f64 = 0.01;

impl Replay {
    /// Reads the columns of every axis.
    ///
    /// # Errors
    /// The file cannot be used, or was sampled at another period.
    pub fn new(machine: &Machine, file: &Path) -> Result<Self, ReplayError> {
        let period = machine.timing.period;
        let mut records = Vec::with_capacity(machine.axes.len());
        for axis in &machine.axes {
            let (input, output) = &axis.columns;
            let record = match Record::read(file, input, output, None) {
                // A record without time is taken to be one of the machine's period.
                Err(RecordError::NoTime(_)) => Record::read(file, input, output, Some(period.as_secs_f64()))?,
                other => other?,
            };
            check_period(&record, period, file)?;
            records.push(record);
        }
        Ok(Self { checks: machine.axes.iter().map(|axis| Plausibility::new(axis, period)).collect(), records })
    }

    /// Number of rows.
    pub fn len(&self) -> u64 {
        self.records.first().map_or(0, |record| record.outputs.len() as u64)
    }

    /// Never: a record has rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sample and command of row `sequence`, or `None` after the last.
    pub fn update(&mut self, sequence: u64) -> Option<(EncoderSample, ValveCommand)> {
        let row = usize::try_from(sequence).ok().filter(|_| sequence < self.len())?;
        let (mut sample, mut command) = (EncoderSample::default(), ValveCommand::default());
        for header in [&mut sample.header, &mut command.header] {
            header.sequence = sequence;
            header.axis_count = self.records.len() as u32;
        }
        for (i, (check, record)) in self.checks.iter_mut().zip(&self.records).enumerate() {
            sample.axes[i] = check.judge(1, Some(record.outputs[row]), false);
            command.axes[i] =
                AxisCommand { command: record.inputs[row], mode: ControlMode::Replay as u32, ..AxisCommand::default() };
        }
        Some((sample, command))
    }
}

fn check_period(record: &Record, period: Duration, file: &Path) -> Result<(), ReplayError> {
    let expected = period.as_secs_f64();
    if (record.period / expected - 1.0).abs() > PERIOD_TOLERANCE {
        return Err(ReplayError::Period { file: file.display().to_string(), found: record.period, expected });
    }
    Ok(())
}

/// Whether any axis of the sample is marked with more than rest.
pub fn is_implausible(sample: &EncoderSample) -> bool {
    sample.axes.iter().any(|axis| axis.usable().is_none())
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::message::{EncoderValue, sample_fault};

    #[test]
    fn counts_become_metres() {
        let machine = Machine::load(None, &[]).unwrap();
        let mut acquisition = Acquisition::new(&machine);
        let mut reading = EncoderReading::default();
        reading.header.axis_count = 4;
        reading.encoders[0] = EncoderValue { counts: 6500, ..EncoderValue::default() };
        reading.encoders[3] = EncoderValue { counts: 5500, error: 7, ..EncoderValue::default() };
        let sample = acquisition.update(9, Some(&reading));
        assert_eq!((sample.header.sequence, sample.header.axis_count), (9, 4));
        assert!((sample.axes[0].position - 0.65).abs() < 1e-12);
        assert_eq!(sample.axes[3].faults, sample_fault::ENCODER);
        assert!(is_implausible(&sample));

        let none = acquisition.update(10, None);
        assert!(none.axes[..4].iter().all(|axis| axis.faults & sample_fault::STALE != 0));
        reading.header.axis_count = 3;
        let foreign = acquisition.update(11, Some(&reading));
        assert!(foreign.axes[..4].iter().all(|axis| axis.faults & sample_fault::STALE != 0));
    }

    #[test]
    fn an_emergency_stop_is_passed_on_and_stays_until_it_is_seen_released() {
        let machine = Machine::load(None, &[]).unwrap();
        let mut acquisition = Acquisition::new(&machine);
        let mut reading = EncoderReading { emergency_stop: 1, ..EncoderReading::default() };
        assert_eq!(acquisition.update(0, None).emergency_stop, 0);
        // Pressed counts in whatever reading; released only in a sound one.
        assert_eq!(acquisition.update(1, Some(&reading)).emergency_stop, 1);
        assert_eq!(acquisition.update(2, None).emergency_stop, 1);
        reading.emergency_stop = 0;
        assert_eq!(acquisition.update(3, Some(&reading)).emergency_stop, 1);
        reading.header.axis_count = 4;
        assert_eq!(acquisition.update(4, Some(&reading)).emergency_stop, 0);
    }

    #[test]
    fn ticks_that_nobody_worked_count_as_time() {
        let machine = Machine::load(None, &[]).unwrap();
        let mut acquisition = Acquisition::new(&machine);
        let mut sample = |tick, counts| {
            let mut reading = EncoderReading::default();
            reading.header.axis_count = 4;
            reading.encoders[..4].fill(EncoderValue { counts, ..EncoderValue::default() });
            acquisition.update(tick, Some(&reading)).axes[0]
        };
        sample(0, 6000);
        // 10.4 mm in one tick would be too fast, and so would 20 mm in two be where nothing has moved.
        let later = sample(2, 6104);
        assert_eq!(later.faults, 0);
        assert!((later.velocity - 0.52).abs() < 1e-9, "{}", later.velocity);
    }

    #[test]
    fn a_recording_replays_row_by_row() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("r.csv");
        std::fs::write(&file, "t,u,y\n0,0.25,0.5\n0.01,-0.5,0.501\n0.02,0,0.502\n").unwrap();
        let machine = Machine::load(None, &[]).unwrap();
        let mut replay = Replay::new(&machine, &file).unwrap();
        assert_eq!(replay.len(), 3);
        let (sample, command) = replay.update(1).unwrap();
        assert_eq!((sample.axes[2].position, command.axes[2].command), (0.501, -0.5));
        assert_eq!(command.axes[2].mode, ControlMode::Replay as u32);
        assert!(replay.update(3).is_none());

        std::fs::write(&file, "t,u,y\n0,0.25,0.5\n0.02,-0.5,0.501\n").unwrap();
        let error = Replay::new(&machine, &file).unwrap_err().to_string();
        assert!(error.contains("found a period of 0.020000 s"), "{error}");
    }
}
