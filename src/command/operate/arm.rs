//! `hydraxis arm` and `reset`: one operation on the axes of a running group, then the end.
//!
//! | state of an axis before | disarmed | latched by a fault | in the mode that `arm` asks for | in another mode |
//! |---|---|---|---|---|
//! | arm | is armed | is refused | keeps it | is refused |
//! | reset | stays disarmed | is disarmed | keeps it | keeps it |
//!
//! An axis that is in the mode already may still settle: the program that has armed it did not wait for it. `arm` does.
//!
//! Trap: a request for off releases a latched axis. So each command sends requests only for the axes that it changes.

use pipeline::{
    channel::{GroupMachine, Prefix},
    message::{AxisMode, control_flag},
};

use super::{
    arguments::{ArmArguments, ResetArguments},
    as_operator, find,
};
use crate::{failure::Failure, group::operator::Operator, report::output::show};

/// Arms the axes that are disarmed, and leaves them armed.
pub fn arm(arguments: &ArmArguments) -> Result<(), Failure> {
    let (prefix, _, axes) = find(&arguments.group)?;
    let (prefix, mode) = (&prefix, AxisMode::from(arguments.mode));
    as_operator(prefix, &arguments.group, |operator| {
        refuse_to_arm(&axes, mode, prefix, operator)?;
        let off: Vec<usize> = axes.iter().copied().filter(|axis| is_disarmed(operator, *axis)).collect();
        let others: Vec<usize> = axes.iter().copied().filter(|axis| !off.contains(axis)).collect();
        let is_done = operator.change(&off, mode).and_then(|done| Ok(done && operator.await_settled(&others, mode)?));
        let armed = match is_done {
            Ok(false) => Err(Failure::run("stopped before the axes were armed: they are off")),
            Err(error) => {
                let advice = advice(&axes, prefix, operator);
                Err(Failure::run(format!("{}{advice}", Failure::from(error))))
            }
            Ok(true) => Ok(()),
        };
        if armed.is_err() {
            // Either all axes are armed or none. An axis that has latched meanwhile stays latched, so that its fault is
            // seen.
            operator.disarm(&off)?;
        }
        armed?;
        Ok(show(&states(&axes, operator))?)
    })
}

/// Disarms the latched axes, which releases them, and no others.
pub fn reset(arguments: &ResetArguments) -> Result<(), Failure> {
    let (prefix, _, axes) = find(&arguments.group)?;
    let prefix = &prefix;
    as_operator(prefix, &arguments.group, |operator| {
        if operator.stopping() {
            return Ok(());
        }
        let released = latched(&axes, operator);
        let causes = Causes::of(&axes, operator);
        operator.release(&released)?;
        let text = causes.text(operator, "not latched");
        Ok(show(&format!("{text}{}", next(operator.machine(), &released, "arm", prefix)))?)
    })
}

/// What had latched axes before they were released.
pub(super) struct Causes(Vec<(usize, String)>);

impl Causes {
    /// Of these axes, now.
    pub(super) fn of(axes: &[usize], operator: &Operator) -> Self {
        Self(axes.iter().map(|axis| (*axis, operator.latched_by(*axis))).collect())
    }

    /// A line for each axis with its state and its cause. An axis that was not latched has `without` in the place of
    /// the cause, and no line where `without` is empty.
    pub(super) fn text(&self, operator: &Operator, without: &str) -> String {
        let one = |(axis, cause): &(usize, String)| {
            let state = operator.state(*axis);
            match (cause.as_str(), without) {
                ("", "") => String::new(),
                ("", without) => format!("{state}: {without}\n"),
                (cause, _) => format!("{state}: was latched by {cause}\n"),
            }
        };
        self.0.iter().map(one).collect()
    }
}

fn is_disarmed(operator: &Operator, axis: usize) -> bool {
    operator.last(axis).is_some_and(|last| last.flags & control_flag::DISARMED != 0)
}

fn latched(axes: &[usize], operator: &Operator) -> Vec<usize> {
    axes.iter().copied().filter(|axis| !operator.latched_by(*axis).is_empty()).collect()
}

/// Refuses to arm when an axis is latched, or armed in another mode.
fn refuse_to_arm(axes: &[usize], mode: AxisMode, prefix: &Prefix, operator: &Operator) -> Result<(), Failure> {
    if !latched(axes, operator).is_empty() {
        let states = states(axes, operator);
        return Err(Failure::run(format!("{}{}", states.trim_end(), advice(axes, prefix, operator))));
    }
    let is_other = |axis: &&usize| {
        operator.last(**axis).is_some_and(|last| last.operation != mode as u32 && !is_disarmed(operator, **axis))
    };
    let Some(axis) = axes.iter().find(is_other) else { return Ok(()) };
    Err(Failure::run(format!(
        "{}; allowed: off, or {1} already; an axis changes its mode with: {2} --mode {1} --leave",
        operator.state(*axis),
        mode.name(),
        typed(operator.machine(), &[*axis], "operate", prefix)
    )))
}

/// Lines about what to type next for latched axes: for those of `axes`, and for others that keep the pilot pressure of
/// all axes cut off. Empty when there are none.
pub(super) fn advice(axes: &[usize], prefix: &Prefix, operator: &Operator) -> String {
    let cuts_off = |axis: &usize| operator.last(*axis).is_some_and(|last| last.flags & control_flag::CUT_OFF != 0);
    let others = (0..operator.machine().axis_count as usize).filter(|axis| !axes.contains(axis) && cuts_off(axis));
    let others: Vec<usize> = others.collect();
    let latched = [latched(axes, operator), others.clone()].concat();
    if latched.is_empty() {
        return String::new();
    }
    let cut_off = |axis: &usize| format!("\n{}: cuts the pilot pressure of all axes off", operator.state(*axis));
    let cut_off: String = others.iter().map(cut_off).collect();
    format!("{cut_off}\nlook at why, then type: {}", typed(operator.machine(), &latched, "reset", prefix))
}

/// A line with the command to type next for these axes; empty when there are none.
pub(super) fn next(machine: &GroupMachine, axes: &[usize], command: &str, prefix: &Prefix) -> String {
    if axes.is_empty() { String::new() } else { format!("next: {}\n", typed(machine, axes, command, prefix)) }
}

/// A command line for these axes of the group.
fn typed(machine: &GroupMachine, axes: &[usize], command: &str, prefix: &Prefix) -> String {
    let axes: String = axes.iter().map(|axis| format!(" --axis {}", machine.name(*axis))).collect();
    format!("hydraxis {command} --prefix {prefix}{axes}")
}

fn states(axes: &[usize], operator: &Operator) -> String {
    axes.iter().map(|axis| operator.state(*axis) + "\n").collect()
}
