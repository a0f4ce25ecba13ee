//! What a person sees of a running group once a second: a line for the service manager, and lines for a terminal.

use pipeline::{
    machine::{Axis, Machine},
    message::{AxisCommand, AxisMode, AxisSnapshot, ControlMode, bit_names, control_flag, model_fault},
    stage::StageKind,
};

use crate::report::control_loop::LastMessages;

/// Flags of an axis that a person must see.
const SHOWN: u32 = control_flag::LATCHED
    | control_flag::REFERENCE
    | control_flag::REQUEST
    | control_flag::REQUEST_STOPPED
    | control_flag::SOFT_LIMIT
    | control_flag::HALF_SPEED
    | control_flag::MODEL_WORSE
    | control_flag::MODEL_TRIAL
    | control_flag::CAUTION
    | control_flag::SLOWED;

/// All axes in one line; none before the first tick.
pub fn line(machine: &Machine, last: &LastMessages) -> Option<String> {
    let mut line = format!("{:6.1} s", seconds(machine, last)?);
    for (i, axis) in machine.axes.iter().enumerate() {
        line += &format!(" | {}", axis.name);
        if let Some(command) = command(last, i) {
            line += &format!(" {:+.1} mm {}", 1e3 * command.error, ControlMode::name(command.mode));
            if command.operation == AxisMode::Hold as u32 {
                line += " hold";
            }
            for flag in flags(command) {
                line += &format!(" {flag}");
            }
        }
        match snapshot(last, i) {
            Some(snapshot) if is_training(snapshot) => line += " training",
            Some(snapshot) => line += &format!(" L{:.3}", snapshot.forgetting_factor),
            None => {}
        }
    }
    let (lost, late) = counts(last);
    Some(line + &format!(" | lost {lost} late {late}"))
}

/// A line with the time, a header, and a line for each axis; none before the first tick. What matters most stands at
/// the left, since a narrow terminal cuts the lines.
pub fn lines(machine: &Machine, last: &LastMessages) -> Option<Vec<String>> {
    let (lost, late) = counts(last);
    let time = format!(" {:.1} s, messages lost: {lost}, ticks late: {late}", seconds(machine, last)?);
    let names = machine.axes.iter().map(|axis| axis.name.chars().count());
    let width = names.max().unwrap_or(0).max("axis".len());
    let header = format!(
        " {:width$}  {:>10}  {:8}  {:>7}  {:10}  {:>10}  flags",
        "axis", "error", "by", "command", "mode", "forgetting"
    );
    let of_axis = |(i, axis): (usize, &Axis)| {
        let [error, by, asked, mode, flags] = match command(last, i) {
            Some(command) => [
                format!("{:+.1} mm", 1e3 * command.error),
                ControlMode::name(command.mode).to_owned(),
                format!("{:+.3}", command.command),
                AxisMode::from_number(command.operation).map_or("unknown", AxisMode::name).to_owned(),
                flags(command).collect::<Vec<_>>().join(" "),
            ],
            None => ["-", "-", "-", "-", ""].map(str::to_owned),
        };
        let model = match snapshot(last, i) {
            Some(snapshot) if is_training(snapshot) => "training".to_owned(),
            Some(snapshot) => format!("{:.4}", snapshot.forgetting_factor),
            None => "-".to_owned(),
        };
        let line = format!(" {:width$}  {error:>10}  {by:8}  {asked:>7}  {mode:10}  {model:>10}  {flags}", axis.name);
        line.trim_end().to_owned()
    };
    Some([time, header].into_iter().chain(machine.axes.iter().enumerate().map(of_axis)).collect())
}

/// Time of the machine, s; none before the first tick.
fn seconds(machine: &Machine, last: &LastMessages) -> Option<f64> {
    let sensor = last.health[StageKind::SensorProc as usize]?;
    Some(sensor.header.sequence as f64 * machine.timing.period.as_secs_f64())
}

/// Lost messages and late ticks of all stages.
fn counts(last: &LastMessages) -> (u64, u64) {
    (last.health.iter().flatten())
        .fold((0, 0), |(lost, late), health| (lost + health.lost(), late + health.missed.total()))
}

/// The last command of an axis; none while a recording is replayed.
fn command(last: &LastMessages, axis: usize) -> Option<&AxisCommand> {
    let command = last.command.as_ref().map(|command| &command.axes[axis]);
    command.filter(|command| command.mode != ControlMode::Replay as u32)
}

fn snapshot(last: &LastMessages, axis: usize) -> Option<&AxisSnapshot> {
    last.snapshot.as_ref().map(|snapshot| &snapshot.axes[axis])
}

fn is_training(snapshot: &AxisSnapshot) -> bool {
    snapshot.faults & model_fault::TRAINING != 0
}

/// The flags that a person must see, in capitals.
fn flags(command: &AxisCommand) -> impl Iterator<Item = String> {
    bit_names(command.flags & SHOWN, &control_flag::NAMES).map(|flag| format!("{}!", flag.to_uppercase()))
}

#[cfg(test)]
mod tests {
    use pipeline::message::{CoefficientSnapshot, StageHealth, ValveCommand};

    use super::*;

    fn last() -> LastMessages {
        let (mut command, mut health) = (ValveCommand::default(), StageHealth::default());
        for (i, axis) in command.axes.iter_mut().enumerate() {
            axis.error = -0.0123 * i as f64;
            axis.mode = ControlMode::Fallback as u32;
            axis.operation = AxisMode::Track as u32;
        }
        command.axes[1].flags = control_flag::SLOWED;
        health.header.sequence = 1234;
        let mut last = LastMessages {
            command: Some(command),
            snapshot: Some(CoefficientSnapshot::default()),
            ..LastMessages::default()
        };
        last.health[StageKind::SensorProc as usize] = Some(health);
        last
    }

    #[test]
    fn every_axis_has_a_line_that_fits_into_80_columns() {
        let machine = Machine::load(None, &[]).unwrap();
        let lines = lines(&machine, &last()).unwrap();
        assert_eq!(lines.len(), 2 + machine.axes.len());
        assert!(lines.iter().all(|line| line.len() <= 80), "{lines:#?}");
        let starts = machine.axes.iter().map(|axis| format!(" {} ", axis.name));
        assert!(starts.zip(&lines[2..]).all(|(start, line)| line.starts_with(&start)), "{lines:#?}");
        assert!(
            lines[0].contains("12.3 s") && lines[3].contains("-12.3 mm  fallback") && lines[3].ends_with("SLOWED!")
        );
    }

    #[test]
    fn nothing_is_shown_before_the_first_tick() {
        let machine = Machine::load(None, &[]).unwrap();
        assert_eq!((lines(&machine, &LastMessages::default()), line(&machine, &LastMessages::default())), (None, None));
    }
}
