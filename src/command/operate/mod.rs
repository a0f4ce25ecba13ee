//! `hydraxis operate`: a person operates the axes of a running group, and with `--tip` the bucket's teeth
//! ([`mod@tip`]); `arm` and `reset` in [`mod@arm`], `disarm` in [`mod@disarm`].
//!
//! Names of axes are those of the group that runs. Runs in a process of its own, beside the loop.

mod arguments;
mod arm;
mod disarm;
mod places;
mod tip;
mod travel;

use std::time::{Duration, Instant};

use pipeline::{
    channel::{GroupMachine, Prefix, remove_leftovers},
    message::{AxisMode, ControlMode, EncoderSample},
};

use arm::Causes;
pub use arm::{arm, reset};
pub use disarm::disarm;

use crate::{
    arguments::axes_of,
    failure::Failure,
    group::{
        operator::{Operator, board},
        running::meant,
        signals::stop_flag,
    },
    report::output::show,
    teeth::ALL,
};
use arguments::GroupAxes;
pub use arguments::{ArmArguments, DisarmArguments, OperateArguments, ResetArguments};
use tip::TipMove;
use travel::Travel;

/// Time between two lines.
const LINE_PERIOD: Duration = Duration::from_secs(1);

/// Runs the command.
pub fn run(arguments: &OperateArguments) -> Result<(), Failure> {
    check(arguments)?;
    let (prefix, machine, axes) = find(&arguments.group)?;
    check_target(&machine, &axes, arguments)?;
    let mut tip = TipMove::asked(arguments, &prefix)?;
    let axes = if tip.is_some() { ALL.to_vec() } else { axes };
    as_operator(&prefix, &arguments.group, |operator| {
        operate(&axes, tip.as_mut(), arguments, operator)
            .map_err(|failure| failure.advising(arm::advice(&axes, &prefix, operator)))
    })
}

/// A running group, its machine, and the axes with these names.
fn find(group: &GroupAxes) -> Result<(Prefix, GroupMachine, Vec<usize>), Failure> {
    let prefix = meant(group.prefix.as_ref())?;
    let machine = *board(&prefix)?.machine();
    let axes = axes_of(machine.names(), &group.axes)?;
    Ok((prefix, machine, axes))
}

/// Does `work` as the operator of a group.
fn as_operator(
    prefix: &Prefix,
    group: &GroupAxes,
    work: impl FnOnce(&mut Operator) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let stop = stop_flag()?;
    let result = match Operator::join(prefix, group.take_over, stop) {
        Ok(mut operator) => work(&mut operator),
        Err(error) => Err(error.into()),
    };
    // The last process that leaves a group that has ended removes its files.
    let _ = remove_leftovers(prefix);
    result
}

/// Refuses options that do not go together.
fn check(arguments: &OperateArguments) -> Result<(), Failure> {
    let mode = arguments.axis_mode();
    let refuse = |text: String| Err(Failure::usage(text));
    if arguments.mode.is_none() && arguments.tip.is_none() {
        let allowed = "one of off, manual, hold, track, or a place for the teeth by --tip";
        return refuse(format!("--mode: found nothing; allowed: {allowed}\nnext: hydraxis operate --help"));
    }
    match (mode, arguments.command) {
        (AxisMode::Manual, None) => {
            return refuse("--command: found none; allowed: a valve command in [-1, 1], such as 0.2 or 20%".into());
        }
        (AxisMode::Manual, _) | (_, None) => {}
        (_, Some(_)) => {
            return refuse(format!("--command: found one with --mode {}; allowed: with manual", mode.name()));
        }
    }
    if arguments.tip.is_none() && (arguments.pitch.is_some() || arguments.speed.is_some()) {
        return refuse("--pitch, --speed: found without --tip; allowed: with it".into());
    }
    if arguments.target.is_some() && mode != AxisMode::Hold {
        return refuse(format!("--target: found one with --mode {}; allowed: with hold", mode.name()));
    }
    if arguments.leave && !matches!(mode, AxisMode::Hold | AxisMode::Track) {
        return refuse(format!("--leave: found with --mode {}; allowed: with hold and track", mode.name()));
    }
    Ok(())
}

/// Refuses a set point outside the soft limits of an axis.
fn check_target(machine: &GroupMachine, axes: &[usize], arguments: &OperateArguments) -> Result<(), Failure> {
    for axis in axes {
        let [low, high] = machine.soft_limits[*axis];
        if let Some(target) = arguments.target.filter(|target| !(low..=high).contains(target)) {
            let name = machine.name(*axis);
            return Err(Failure::usage(format!(
                "--target: found {target} m; allowed: axis.{name} within its soft limits, {low} to {high} m"
            )));
        }
    }
    Ok(())
}

fn operate(
    axes: &[usize],
    tip: Option<&mut TipMove>,
    arguments: &OperateArguments,
    operator: &mut Operator,
) -> Result<(), Failure> {
    let mode = arguments.axis_mode();
    if operator.stopping() {
        return Ok(());
    }
    if mode == AxisMode::Off {
        let causes = Causes::of(axes, operator);
        operator.release(axes)?;
        return Ok(show(&format!("{}{}", causes.text(operator, ""), line(axes, operator, None)))?);
    }
    // What the machine cannot do is refused before anything is armed.
    tip.as_ref().map(|tip| tip.judge(operator)).transpose()?;
    let is_off = |axis: &usize| operator.last(*axis).is_some_and(|last| last.operation == AxisMode::Off as u32);
    let off: Vec<usize> = axes.iter().copied().filter(is_off).collect();
    if let Some(axis) = off.first().filter(|_| !arguments.enable) {
        return Err(Failure::usage(format!("{}; allowed: with --enable, and then it may move", operator.state(*axis))));
    }
    if !off.is_empty() {
        let causes = Causes::of(&off, operator);
        operator.release(&off)?;
        show(&causes.text(operator, ""))?;
    }
    let result = match tip {
        Some(tip) => tip.run(arguments, operator),
        None => stream(axes, mode, arguments, operator),
    };
    match &result {
        Ok(()) if arguments.leave && !operator.stopping() => {}
        // For every other end, with or without a failure, the axes are disarmed; what a fault has latched stays so.
        _ => {
            operator.disarm(axes)?;
            show(&line(axes, operator, None))?;
        }
    }
    result
}

/// Changes the mode and sends requests until the end.
fn stream(
    axes: &[usize],
    mode: AxisMode,
    arguments: &OperateArguments,
    operator: &mut Operator,
) -> Result<(), Failure> {
    for axis in axes {
        let request = operator.axis(*axis);
        request.command = arguments.command.unwrap_or_default();
        request.target = arguments.target.unwrap_or_default();
        request.has_target = u32::from(arguments.target.is_some());
        request.hold_to_run = u32::from(arguments.hold_to_run);
    }
    if !operator.change(axes, mode)? || arguments.leave {
        if arguments.leave {
            show(&line(axes, operator, None))?;
        }
        return Ok(());
    }
    let begin = Instant::now();
    let mut next_line = begin;
    let mut travels: Vec<Travel> = axes.iter().map(|_| Travel::default()).collect();
    while arguments.duration.is_none_or(|duration| begin.elapsed() < duration) {
        let Some(sample) = operator.sample()? else { break };
        operator.ask(&sample)?;
        while operator.command()?.is_some() {}
        let has_left = |axis: &&usize| operator.last(**axis).is_some_and(|last| last.operation != mode as u32);
        if let Some(axis) = axes.iter().find(has_left) {
            return Err(Failure::run(format!("{}; allowed: {}", operator.state(*axis), mode.name())));
        }
        for (axis, travel) in axes.iter().zip(&mut travels) {
            let sent = operator.last(*axis).unwrap_or_default();
            let now = sample.header.acquired_ns;
            travel.update((now, sample.axes[*axis].usable()), &sent, operator.machine().dead_bands[*axis]);
        }
        if Instant::now() >= next_line {
            next_line += LINE_PERIOD;
            show(&line(axes, operator, Some(&sample)))?;
        }
    }
    arguments.command.map_or(Ok(()), |command| expect_direction(axes, command, &travels, operator))
}

/// Shows how far the axes have moved under a command; fails where one has moved against it.
fn expect_direction(axes: &[usize], command: f64, travels: &[Travel], operator: &Operator) -> Result<(), Failure> {
    let mut against = Vec::new();
    for (axis, travel) in axes.iter().zip(travels) {
        let name = operator.machine().name(*axis);
        match travel.judged(command) {
            Ok(text) => show(&format!("axis.{name}: {text}\n"))?,
            Err(text) => against.push(format!("axis.{name}: {text}")),
        }
    }
    if against.is_empty() { Ok(()) } else { Err(Failure::run(against.join("\n"))) }
}

/// A line about the present state of the axes.
fn line(axes: &[usize], operator: &Operator, sample: Option<&EncoderSample>) -> String {
    let one = |axis: &usize| {
        let mut text = operator.state(*axis);
        if let (Some(last), Some(sample)) = (operator.last(*axis), sample) {
            text += &format!(", {:.4} m, command {:+.4}", sample.axes[*axis].position, last.command);
            if last.operation == AxisMode::Hold as u32 || last.operation == AxisMode::Track as u32 {
                text += &format!(" by {}, reference {:.4} m", ControlMode::name(last.mode), last.reference);
            }
        }
        text
    };
    let seconds = sample.map(|sample| 1e-9 * sample.header.sequence as f64 * operator.machine().period_ns as f64);
    let time = seconds.map_or_else(String::new, |seconds| format!("{seconds:8.2} s  "));
    format!("{time}{}\n", axes.iter().map(one).collect::<Vec<_>>().join("; "))
}
