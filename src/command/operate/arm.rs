//! `hydraxis arm`, `disarm`, `reset`: the levers of a running group, each pulled once.
//!
//! | an axis that is | off | latched by a fault | in the mode asked for | in another mode |
//! |---|---|---|---|---|
//! | arm | is enabled | is refused | stays | is refused |
//! | disarm | stays | stays latched | goes off | goes off |
//! | reset | stays | goes off | stays | stays |
//!
//! Trap: to ask a latched axis for off releases it. So each command asks only of those axes that it is about, and of all
//! others nothing.

use pipeline::{
    machine::Machine,
    message::{AxisMode, control_flag},
};

use super::{
    arguments::{ArmArguments, DisarmArguments, GroupAxes, ResetArguments},
    at_levers,
};
use crate::{arguments, failure::Failure, group::operator::Operator, report::output::show};

/// Enables the axes that are off, and leaves them so.
pub fn arm(arguments: &ArmArguments) -> Result<(), Failure> {
    let group = &arguments.group;
    let (machine, axes) = load(group)?;
    let mode = AxisMode::from(arguments.mode);
    at_levers(&machine, group, |operator| {
        refuse_to_arm(&machine, &axes, mode, group, operator)?;
        let off: Vec<usize> = axes.iter().copied().filter(|axis| is_off(operator, *axis)).collect();
        let armed = match operator.change(&off, mode) {
            Ok(false) => Err(Failure::Run("stopped before the axes were armed: they are off".to_owned())),
            Err(failure) => Err(Failure::Run(format!("{failure}{}", advice(&machine, &off, group, operator)))),
            Ok(true) => Ok(()),
        };
        if armed.is_err() {
            // All or none; but what has latched meanwhile stays to be seen.
            let enabled: Vec<usize> = off.into_iter().filter(|axis| operator.latched_by(*axis).is_empty()).collect();
            operator.off(&enabled)?;
        }
        armed.and_then(|()| show(&states(&axes, operator)))
    })
}

/// Puts the axes off, all but the latched ones.
pub fn disarm(arguments: &DisarmArguments) -> Result<(), Failure> {
    let group = &arguments.group;
    let (machine, axes) = load(group)?;
    at_levers(&machine, group, |operator| {
        // Also when it is to end: whoever wants it to end wants the machine to stand.
        let moving: Vec<usize> = axes.iter().copied().filter(|axis| operator.latched_by(*axis).is_empty()).collect();
        operator.off(&moving)?;
        show(&format!("{}{}", states(&axes, operator), next(&machine, &latched(&axes, operator), "reset", group)))
    })
}

/// Puts off the axes that are latched, and no others.
pub fn reset(arguments: &ResetArguments) -> Result<(), Failure> {
    let group = &arguments.group;
    let (machine, axes) = load(group)?;
    at_levers(&machine, group, |operator| {
        if operator.stopping() {
            return Ok(());
        }
        let released = latched(&axes, operator);
        let causes: Vec<String> = axes.iter().map(|axis| operator.latched_by(*axis)).collect();
        operator.off(&released)?;
        let one = |(axis, cause): (&usize, &String)| {
            let state = operator.state(*axis);
            if cause.is_empty() {
                format!("{state}: not latched\n")
            } else {
                format!("{state}: was latched by {cause}\n")
            }
        };
        let text: String = axes.iter().zip(&causes).map(one).collect();
        show(&format!("{text}{}", next(&machine, &released, "arm", group)))
    })
}

fn load(group: &GroupAxes) -> Result<(Machine, Vec<usize>), Failure> {
    let machine = arguments::load(&group.machine)?;
    let axes = arguments::axes(&machine, &group.axes)?;
    Ok((machine, axes))
}

fn is_off(operator: &Operator, axis: usize) -> bool {
    operator.last(axis).is_some_and(|last| last.flags & control_flag::DISARMED != 0)
}

fn latched(axes: &[usize], operator: &Operator) -> Vec<usize> {
    axes.iter().copied().filter(|axis| !operator.latched_by(*axis).is_empty()).collect()
}

/// Every axis is off, or in the mode already.
fn refuse_to_arm(
    machine: &Machine,
    axes: &[usize],
    mode: AxisMode,
    group: &GroupAxes,
    operator: &Operator,
) -> Result<(), Failure> {
    if !latched(axes, operator).is_empty() {
        let states = states(axes, operator);
        return Err(Failure::Run(format!("{}{}", states.trim_end(), advice(machine, axes, group, operator))));
    }
    let is_other = |axis: &&usize| {
        operator.last(**axis).is_some_and(|last| last.operation != mode as u32 && !is_off(operator, **axis))
    };
    let Some(axis) = axes.iter().find(is_other) else { return Ok(()) };
    Err(Failure::Run(format!(
        "{}; allowed: off, or {1} already; an axis changes its mode with: {2} --mode {1} --leave",
        operator.state(*axis),
        mode.name(),
        typed(machine, &[*axis], "operate", group)
    )))
}

/// What to do about the axes that are latched; empty when none is.
fn advice(machine: &Machine, axes: &[usize], group: &GroupAxes, operator: &Operator) -> String {
    let latched = latched(axes, operator);
    if latched.is_empty() {
        return String::new();
    }
    format!("\nlook at why, then type: {}", typed(machine, &latched, "reset", group))
}

/// The line that says what comes next with these axes, if there are any.
fn next(machine: &Machine, axes: &[usize], command: &str, group: &GroupAxes) -> String {
    if axes.is_empty() { String::new() } else { format!("next: {}\n", typed(machine, axes, command, group)) }
}

/// A command as it is to be typed for these axes of the same group.
fn typed(machine: &Machine, axes: &[usize], command: &str, group: &GroupAxes) -> String {
    let file = group.machine.bare.machine.as_ref().map_or_else(String::new, |file| format!(" {}", file.display()));
    let axes: String = axes.iter().map(|axis| format!(" --axis {}", machine.axes[*axis].name)).collect();
    format!("hydraxis {command}{file} --prefix {}{axes}", group.prefix)
}

fn states(axes: &[usize], operator: &Operator) -> String {
    axes.iter().map(|axis| operator.state(*axis) + "\n").collect()
}
