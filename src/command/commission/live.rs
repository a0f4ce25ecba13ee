//! The experiment with the axes of a running group, one after the other, over the channels: it reads samples and sends
//! requests.
//!
//! Trap: a command that the experiment computes from sample k is on the valve from sample k+1 on, or later, or reduced
//! by a limit. So the analysis uses the commands that the controller reports for each tick, and not the requested ones.
//!
//! Runs beside the loop, in the process of the command.

use std::sync::{Arc, atomic::AtomicBool};

use control_proc::commission::{Experiment, ExperimentOptions, ExperimentRecord, Outcome, Phase, analyse};
use pipeline::{
    MAX_AXES,
    channel::Prefix,
    machine::{Commissioned, Machine},
    message::{AxisMode, EncoderSample, ValveCommand, control_flag},
};

use super::simulated::walled;
use crate::{
    failure::Failure,
    group::operator::{Operator, OperatorError, board},
};

/// Commissions the axes with these indices, one at a time. All axes are disarmed before and after. Returns models and
/// records.
///
/// # Errors
/// The group runs another machine, or cannot be operated, an axis left its mode, a bound was met, or a record has no
/// model. All axes are disarmed.
pub fn commission_live(
    machine: &Machine,
    axes: &[usize],
    prefix: &Prefix,
    stop: Arc<AtomicBool>,
    options: &ExperimentOptions,
    mut show: impl FnMut(usize, Phase, f64),
) -> Result<Vec<(Commissioned, ExperimentRecord)>, Failure> {
    board(prefix)?.expect_hardware(machine).map_err(OperatorError::from)?;
    let mut operator = Operator::join(prefix, false, stop)?;
    let all: Vec<usize> = (0..machine.axes.len()).collect();
    let one = |axis: &usize| {
        commission(machine, *axis, &all, prefix, &mut operator, options, |phase, part| show(*axis, phase, part))
    };
    let found: Result<Vec<_>, Failure> = axes.iter().map(one).collect();
    // The axes are disarmed after a failure as well.
    let disarmed = operator.disarm(&all);
    let found = found?;
    disarmed?;
    Ok(found)
}

fn commission(
    machine: &Machine,
    axis: usize,
    all: &[usize],
    prefix: &Prefix,
    operator: &mut Operator,
    options: &ExperimentOptions,
    mut show: impl FnMut(Phase, f64),
) -> Result<(Commissioned, ExperimentRecord), Failure> {
    let name = &machine.axes[axis].name;
    let ended = |reason: String| Failure::run(format!("axis.{name}: ended, valve neutral: {reason}"));
    operator.release(all)?;
    operator.axis(axis).command = 0.0;
    let mut experiment = Experiment::new(&machine.axes[axis], &machine.timing, options);
    let mut record = Applied::new(axis, machine.timing.period.as_secs_f64());
    let mut is_walled = false;
    if operator.change(&[axis], AxisMode::Commission)? {
        while experiment.outcome().is_none() {
            let Some(sample) = operator.sample()? else {
                experiment.stop();
                break;
            };
            for _ in 0..record.sample(&sample) {
                experiment.update(None);
            }
            operator.axis(axis).command = experiment.update(Some(&sample.axes[axis]));
            operator.ask(&sample)?;
            while let Some(command) = operator.command()? {
                is_walled |= command.axes[axis].flags & control_flag::WALL != 0;
                record.command(&command);
            }
            if operator.last(axis).is_some_and(|last| last.operation != AxisMode::Commission as u32) {
                let reason = operator.state(axis);
                operator.disarm(all)?;
                return Err(ended(format!(
                    "found {reason}; allowed: commission, all the time: `hydraxis status --prefix {prefix}` says more"
                )));
            }
            show(experiment.phase(), experiment.progress());
        }
    } else {
        experiment.stop();
    }
    operator.axis(axis).command = 0.0;
    operator.disarm(all)?;
    if let Some(Outcome::Aborted(abort)) = experiment.outcome() {
        let wall = if is_walled { format!("; {}", walled("a virtual wall")) } else { String::new() };
        return Err(ended(format!("{abort}{wall}")));
    }
    let positions = record.last;
    let mut record = record.into_record(experiment.record().swing);
    record.bear(machine, axis, &positions);
    let model = analyse(&record).map_err(|error| Failure::run(error).about(format!("axis.{name}")))?;
    Ok((model, record))
}

/// Positions and the commands that were sent for them, by tick.
struct Applied {
    axis: usize,
    period: f64,
    /// Tick of the first sample.
    first: Option<u64>,
    positions: Vec<f64>,
    commands: Vec<f64>,
    /// The last known positions of all axes, m.
    last: [f64; MAX_AXES],
}

impl Applied {
    fn new(axis: usize, period: f64) -> Self {
        Self { axis, period, first: None, positions: Vec::new(), commands: Vec::new(), last: [f64::NAN; MAX_AXES] }
    }

    /// Adds a sample. Returns the number of samples that are missing before it.
    fn sample(&mut self, sample: &EncoderSample) -> usize {
        let first = *self.first.get_or_insert(sample.header.sequence);
        let tick = sample.header.sequence.saturating_sub(first) as usize;
        let missing = tick.saturating_sub(self.positions.len());
        self.positions.resize(tick, f64::NAN);
        self.positions.push(sample.axes[self.axis].usable().unwrap_or(f64::NAN));
        for (last, axis) in self.last.iter_mut().zip(&sample.axes) {
            *last = axis.usable().unwrap_or(*last);
        }
        missing
    }

    /// Adds the command that was sent for a tick. It stays on the valve until the next one.
    fn command(&mut self, command: &ValveCommand) {
        let Some(tick) = self.first.and_then(|first| command.header.sequence.checked_sub(first)) else { return };
        let tick = tick as usize;
        let before = self.commands.last().copied().unwrap_or_default();
        if tick >= self.commands.len() {
            self.commands.resize(tick, before);
            self.commands.push(command.axes[self.axis].command);
        }
    }

    /// The ticks for which position and command are known.
    fn into_record(mut self, swing: f64) -> ExperimentRecord {
        let length = self.positions.len().min(self.commands.len());
        self.positions.truncate(length);
        self.commands.truncate(length);
        let (commands, positions) = (self.commands, self.positions);
        ExperimentRecord { swing, commands, positions, ..ExperimentRecord::new(self.period, 0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::message::sample_fault;

    #[test]
    fn ticks_without_a_sample_and_without_a_command_are_filled() {
        let mut applied = Applied::new(1, 0.01);
        let sample = |sequence: u64, position: f64, faults: u32| {
            let mut sample = EncoderSample::default();
            sample.header.sequence = sequence;
            (sample.axes[1].position, sample.axes[1].faults) = (position, faults);
            sample
        };
        let command = |sequence: u64, value: f64| {
            let mut command = ValveCommand::default();
            (command.header.sequence, command.axes[1].command) = (sequence, value);
            command
        };
        applied.command(&command(99, 0.9));
        assert_eq!(applied.sample(&sample(100, 0.5, 0)), 0);
        applied.command(&command(100, 0.1));
        assert_eq!(applied.sample(&sample(103, 0.6, 0)), 2);
        applied.command(&command(103, 0.2));
        applied.command(&command(103, 0.0));
        assert_eq!(applied.sample(&sample(104, 0.7, sample_fault::STALE)), 0);
        applied.command(&command(104, 0.3));
        applied.sample(&sample(105, 0.8, 0));
        let record = applied.into_record(0.0);
        assert_eq!(record.commands, [0.1, 0.1, 0.1, 0.2, 0.3]);
        assert_eq!((record.positions[0], record.positions[3]), (0.5, 0.6));
        assert!([1, 2, 4].iter().all(|tick| record.positions[*tick].is_nan()));
    }
}
