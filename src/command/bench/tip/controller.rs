//! The controllers of `hydraxis bench tip`: that of the machine file, its fallback, and the fallback with a measure
//! switched off.
//!
//! | controller | differs from the fallback by |
//! |---|---|
//! | `without-feedforward` | no velocity feed-forward; learning and the inverse of the hysteresis act only beside it |
//! | `without-learning` | what the feed-forward lacks is not learned in motion |
//! | `without-hysteresis` | no inverse of the valve's hysteresis |
//! | `without-damping` | the pressures do not damp the loads, and the gains are those of loads that swing |
//! | `without-load` | neither loads that overrun an axis nor the mass that moves change feed-forward and gains |
//! | `without-scaling` | the plan keeps the speed of the task, smoothed, whatever the machine can give |
//! | `without-waiting` | neither the lag of the teeth nor `slow_references` slows the time along the way |
//! | `without-free-axis` | the telescope stays in the middle of its soft limits where the task leaves it free |
//! | `joint` | the last three at once: every axis follows its own reference in time |
//!
//! Gains, dead bands and protections are the same for all. Trap: the gains were tuned with all measures.

use clap::ValueEnum;
use mechanism::AXES;
use pipeline::machine::{Axis, Machine, ModelChoice, TipFree, TipTask};

/// Number of the telescope among the axes of a mechanism.
const TELESCOPE: usize = 2;

/// A measure that `--without` switches off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Without {
    /// each of these once
    All,
    /// velocity feed-forward, and with it learning and the inverse of the hysteresis
    Feedforward,
    /// what the feed-forward lacks is learned in motion
    Learning,
    /// inverse of the valve's hysteresis
    Hysteresis,
    /// damping of the loads by the chamber pressures, and the gains that it allows
    Damping,
    /// loads that overrun an axis in the feed-forward, gains by the mass that moves
    Load,
    /// planned speed by what axes and pump can give
    Scaling,
    /// time that waits for teeth that lag behind
    Waiting,
    /// choice of the axis that is free
    FreeAxis,
    /// scaling, waiting and free axis at once: controller joint
    Teeth,
}

/// What drives a task.
#[derive(Debug, Clone, Copy)]
pub struct Controller {
    /// Its name in the report.
    pub name: &'static str,
    /// What makes this controller of that of the machine file.
    changes: &'static [fn(&mut Machine)],
}

impl Controller {
    /// The fallback with all measures.
    pub const FALLBACK: Self = Self { name: "fallback", changes: &[fallback] };
    /// What the machine file chooses.
    const MODEL: Self = Self { name: "model", changes: &[] };
    /// What each value of `--without` adds.
    const LESS: [(Without, Self); 9] = [
        (Without::Feedforward, Self { name: "without-feedforward", changes: &[fallback, no_feedforward] }),
        (Without::Learning, Self { name: "without-learning", changes: &[fallback, no_learning] }),
        (Without::Hysteresis, Self { name: "without-hysteresis", changes: &[fallback, no_hysteresis] }),
        (Without::Damping, Self { name: "without-damping", changes: &[fallback, no_damping] }),
        (Without::Load, Self { name: "without-load", changes: &[fallback, no_load] }),
        (Without::Scaling, Self { name: "without-scaling", changes: &[fallback, no_scaling] }),
        (Without::Waiting, Self { name: "without-waiting", changes: &[fallback, no_waiting] }),
        (Without::FreeAxis, Self { name: "without-free-axis", changes: &[fallback, no_free_axis] }),
        (Without::Teeth, Self { name: "joint", changes: &[fallback, no_scaling, no_waiting, no_free_axis] }),
    ];

    /// The fallback, the controller of the machine file, and those without something.
    pub fn chosen(without: &[Without]) -> Vec<Self> {
        let is_chosen = |of: &Without| without.contains(of) || without.contains(&Without::All);
        let less = Self::LESS.into_iter().filter(|(of, _)| is_chosen(of)).map(|(_, controller)| controller);
        [Self::FALLBACK, Self::MODEL].into_iter().chain(less).collect()
    }

    /// Makes it the controller of a machine that has its task.
    pub fn apply(&self, machine: &mut Machine) {
        self.changes.iter().for_each(|change| change(machine));
    }
}

/// The axes that move the teeth.
fn axes(machine: &mut Machine) -> impl Iterator<Item = &mut Axis> {
    machine.axes.iter_mut().take(AXES)
}

fn fallback(machine: &mut Machine) {
    axes(machine).for_each(|axis| axis.control.model = ModelChoice::None);
}

fn no_feedforward(machine: &mut Machine) {
    axes(machine).for_each(|axis| axis.control.feedforward = false);
}

fn no_learning(machine: &mut Machine) {
    axes(machine).for_each(|axis| axis.control.without.learning = true);
}

fn no_hysteresis(machine: &mut Machine) {
    axes(machine).for_each(|axis| axis.control.without.hysteresis = true);
}

fn no_damping(machine: &mut Machine) {
    axes(machine).for_each(|axis| axis.control.without.damping = true);
}

fn no_load(machine: &mut Machine) {
    axes(machine).for_each(|axis| axis.control.without.load = true);
}

fn no_scaling(machine: &mut Machine) {
    machine.tip.iter_mut().for_each(|task| task.without.scaling = true);
}

fn no_waiting(machine: &mut Machine) {
    machine.tip.iter_mut().for_each(|task| task.without.waiting = true);
    axes(machine).for_each(|axis| axis.control.slow_references = false);
}

fn no_free_axis(machine: &mut Machine) {
    let middle = machine.axes.get(TELESCOPE).map(|axis| 0.5 * (axis.soft_limits.0 + axis.soft_limits.1));
    let fixed = |task: &TipTask| task.free.is_some() || task.pieces.iter().any(|piece| piece.free.is_some());
    if let Some(task) = machine.tip.as_mut().filter(|task| !fixed(task)) {
        task.free = middle.map(TipFree::Telescope);
    }
}
