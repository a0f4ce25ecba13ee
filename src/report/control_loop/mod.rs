//! The report of `run` and `simulate`: figures of one control loop, as JSON and as tables.
//!
//! It is computed once, from the last messages of the run: every stage counts and measures by itself.

mod tables;

use std::{collections::BTreeMap, fmt, time::Duration};

use pipeline::{
    latency::Percentiles,
    machine::{Axis, Machine},
    message::{
        AxisCommand, AxisMode, AxisSnapshot, ChannelHealth, CoefficientSnapshot, ControlMode, MissedDeadlines,
        ModelErrors, REFUSALS, StageHealth, ValveCommand, bit_names, control_flag, model_fault,
    },
    stage::{Clock, StageKind},
    statistics::ErrorStatistics,
};
use serde::Serialize;
use thiserror::Error;

use super::{
    events::Event,
    figures::{CoefficientLists, ErrorFigures, Reduction},
    table::number,
    teeth::{Stopped, TeethFigures},
    why::why_fallback,
};

/// Why a run has not ended well.
#[derive(Debug, Error)]
pub enum BadEnd {
    /// A fault has latched axes.
    #[error("the run ended with latched axes, whose valves are neutral: {0}")]
    Latched(String),
    /// A virtual wall has ended a task of the teeth.
    #[error("the teeth have not come to the end of their way: {0}")]
    Walled(Stopped),
}

/// The figures of one run; SI units, but for times in ns.
#[derive(Debug, Serialize)]
pub struct LoopReport {
    axes: BTreeMap<String, AxisReport>,
    /// Present where the axes have followed a task of the teeth in a simulation of one process.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub teeth: Option<TeethFigures>,
    /// What happened; in real time only, since a reader in lock-step does not see every command.
    #[serde(skip_serializing_if = "Option::is_none")]
    events: Option<Vec<Event>>,
    /// Events that were too many for the list.
    #[serde(skip_serializing_if = "Option::is_none")]
    events_left_out: Option<u64>,
    stages: BTreeMap<&'static str, StageReport>,
    end_to_end_ns: Percentiles,
    release_jitter_ns: Percentiles,
    /// Ticks of the run.
    pub ticks: u64,
    /// Time that the run took, s.
    pub wall_s: f64,
    /// Time that passed for the machine: ticks times period, s.
    pub model_s: f64,
}

#[derive(Debug, Serialize)]
struct AxisReport {
    /// Present when a fault has latched the axis during the run.
    #[serde(skip_serializing_if = "Option::is_none")]
    latch: Option<Latch>,
    tracking: Tracking,
    tracking_by_model: Tracking,
    /// Over the ticks in which the fallback controlled; absent without such ticks.
    #[serde(skip_serializing_if = "Option::is_none")]
    rmse_by_fallback: Option<f64>,
    /// Refused snapshots, by reason.
    rejected_snapshots: BTreeMap<&'static str, u64>,
    /// Plans that the solver did not solve.
    unsolved_plans: u64,
    /// Ticks at which the reference was slowed.
    slowed_ticks: u32,
    /// Present when a program has operated the axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    operation: Option<Operation>,
    /// Present when no model has controlled the axis although it followed: why.
    #[serde(skip_serializing_if = "Option::is_none")]
    why_fallback: Option<String>,
    identification: Identification,
}

/// The last latch of an axis.
#[derive(Debug, Serialize)]
struct Latch {
    /// Names of the faults.
    by: Vec<&'static str>,
    /// Time of the machine, s.
    at_s: f64,
    /// Number of latches of the run.
    times: u64,
    /// The axis was latched at the end of the run.
    at_end: bool,
}

#[derive(Debug, Serialize)]
struct Operation {
    /// Mode at the end.
    mode: &'static str,
    requests: u64,
    refused_requests: u32,
}

#[derive(Debug, Serialize)]
struct Tracking {
    sigma: f64,
    rmse: f64,
    max: f64,
    count: u64,
}

#[derive(Debug, Serialize)]
struct Identification {
    classical: ModelReport,
    adaptive: ModelReport,
    reduction_percent: Reduction,
    forgetting_factor: f64,
    updates: u64,
    skipped: u64,
}

#[derive(Debug, Serialize)]
struct ModelReport {
    one_step: ErrorFigures,
    h_step: ErrorFigures,
    free_run: ErrorFigures,
    coefficients: CoefficientLists,
}

#[derive(Debug, Serialize)]
struct StageReport {
    samples: u64,
    lost: u64,
    missed_deadlines: u64,
    missed_by_cause: MissedByCause,
    /// In real time only: in lock-step no message is late, because every stage waits for its input.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    channels: BTreeMap<&'static str, ChannelReport>,
    implausible: u64,
    restarts: usize,
    /// Why each process ended that was followed by another.
    restart_causes: Vec<String>,
    wait_ns: Percentiles,
    work_ns: Percentiles,
}

/// Missed deadlines, by the part of the tick that took longest.
#[derive(Debug, Serialize)]
struct MissedByCause {
    late_input: u64,
    late_release: u64,
    long_work: u64,
    /// The last tick with a missed deadline, if there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    last_tick: Option<u64>,
}

/// A channel, as counted by the stage that reads it.
#[derive(Debug, Serialize)]
struct ChannelReport {
    received: u64,
    lost: u64,
    /// Messages about another machine, or that do not say about which: not read.
    foreign: u64,
    longest_gap_ns: u64,
}

/// The last messages of a run, from which the report is computed.
#[derive(Debug, Default)]
pub struct LastMessages {
    /// From control-proc; none when a recording was replayed.
    pub command: Option<ValveCommand>,
    /// From ident-proc.
    pub snapshot: Option<CoefficientSnapshot>,
    /// One for each stage that ran, by [`StageKind`].
    pub health: [Option<StageHealth>; 4],
    /// The last heartbeats of processes that were followed by others.
    pub former: Vec<StageHealth>,
    /// Why those processes ended, by [`StageKind`].
    pub restart_causes: [Vec<String>; 4],
    /// What happened, and how much more than is listed.
    pub events: Option<(Vec<Event>, u64)>,
}

impl LastMessages {
    /// The sum of a count over all processes of a stage.
    fn sum(&self, kind: StageKind, of: fn(&StageHealth) -> u64) -> u64 {
        let former = self.former.iter().filter(|health| health.stage == kind as u32);
        self.health[kind as usize].iter().chain(former).map(of).sum()
    }
}

impl LoopReport {
    /// The report from the last messages of a run that took `wall_s`.
    pub fn new(machine: &Machine, last: &LastMessages, clock: Clock, wall_s: f64) -> Self {
        let health = |kind: StageKind| last.health[kind as usize].as_ref();
        let axes = machine.axes.iter().enumerate().map(|(i, axis)| {
            let command = last.command.map(|command| command.axes[i]).unwrap_or_default();
            let snapshot = last.snapshot.map(|snapshot| snapshot.axes[i]).unwrap_or_default();
            (axis.name.clone(), AxisReport::new(axis, &command, &snapshot, machine.timing.period))
        });
        let stages = StageKind::ALL
            .into_iter()
            .filter_map(|kind| health(kind).map(|health| (kind.name(), StageReport::new(kind, health, last, clock))));
        let percentiles = |kind, of: fn(&StageHealth) -> Percentiles| health(kind).map(of).unwrap_or_default();
        let ticks = last.sum(StageKind::SensorProc, |health| health.samples);
        let (events, events_left_out) = last.events.clone().filter(|_| clock == Clock::RealTime).unzip();
        Self {
            teeth: None,
            axes: axes.collect(),
            events,
            events_left_out,
            stages: stages.collect(),
            end_to_end_ns: percentiles(StageKind::ControlProc, |health| health.end_to_end),
            release_jitter_ns: percentiles(StageKind::SensorProc, |health| health.release_jitter),
            ticks,
            wall_s,
            model_s: ticks as f64 * machine.timing.period.as_secs_f64(),
        }
    }

    /// Fails if an axis was latched at the end of the run, or a virtual wall has ended the task of the teeth.
    ///
    /// # Errors
    /// The axes, with the reason for each, or the wall.
    pub fn verdict(&self) -> Result<(), BadEnd> {
        let latches = self.axes.iter().filter_map(|(name, axis)| Some((name, axis.latch.as_ref()?)));
        let at_end = latches.filter(|(_, latch)| latch.at_end).map(|(name, latch)| format!("axis.{name} ({latch})"));
        let axes: Vec<String> = at_end.collect();
        let stopped = self.teeth.as_ref().and_then(|teeth| teeth.stopped.clone());
        match stopped {
            _ if !axes.is_empty() => Err(BadEnd::Latched(axes.join(", "))),
            Some(stopped) => Err(BadEnd::Walled(stopped)),
            None => Ok(()),
        }
    }

    /// Lost messages, summed over all stages.
    pub fn lost(&self) -> u64 {
        self.stages.values().map(|stage| stage.lost).sum()
    }
}

impl StageReport {
    /// Counts of all processes of a stage; latencies and channels of the last one, whose heartbeat is `health`.
    fn new(kind: StageKind, health: &StageHealth, last: &LastMessages, clock: Clock) -> Self {
        let sum = |of| last.sum(kind, of);
        let causes = &last.restart_causes[kind as usize];
        Self {
            samples: sum(|health| health.samples),
            lost: sum(StageHealth::lost),
            missed_deadlines: sum(|health| health.missed.total()),
            missed_by_cause: MissedByCause::new(&health.missed),
            channels: if clock == Clock::RealTime {
                health.channels().iter().map(|c| (c.name(), ChannelReport::new(c))).collect()
            } else {
                BTreeMap::new()
            },
            implausible: sum(|health| health.implausible),
            restarts: causes.len(),
            restart_causes: causes.clone(),
            wait_ns: health.wait,
            work_ns: health.work,
        }
    }
}

impl MissedByCause {
    fn new(missed: &MissedDeadlines) -> Self {
        let MissedDeadlines { late_input, late_release, long_work, .. } = *missed;
        let last_tick = (missed.total() > 0).then_some(missed.last_tick);
        Self { late_input, late_release, long_work, last_tick }
    }
}

impl ChannelReport {
    fn new(channel: &ChannelHealth) -> Self {
        let ChannelHealth { received, lost, foreign, longest_gap_ns, .. } = *channel;
        Self { received, lost, foreign, longest_gap_ns }
    }
}

impl Tracking {
    fn new(error: &ErrorStatistics) -> Self {
        let max = if error.count > 0 { error.max } else { f64::NAN };
        Self { sigma: error.sigma(), rmse: error.rmse(), max, count: error.count }
    }
}

/// Why no model has controlled an axis that followed. The last command of a run is neutral, so its flags say nothing.
fn why_never_by_model(axis: &Axis, command: &AxisCommand, snapshot: &AxisSnapshot) -> Option<String> {
    if command.tracking.count == 0 || command.model_tracking.count > 0 {
        return None;
    }
    let is_refused = command.rejected_snapshots.iter().any(|count| *count > 0);
    let flags = match (snapshot.faults & model_fault::TRAINING != 0, is_refused) {
        (true, _) => control_flag::NO_MODEL,
        (false, true) => control_flag::MODEL_REFUSED,
        (false, false) => 0,
    };
    let last = AxisCommand { mode: ControlMode::Fallback as u32, flags, ..*command };
    why_fallback(&axis.name, Some(axis.control.model), &last, snapshot.faults)
}

/// Root mean square of the values of `all` that are not among those of `part`; none without such values.
fn rmse_of_rest(all: &ErrorStatistics, part: &ErrorStatistics) -> Option<f64> {
    let squares =
        |error: &ErrorStatistics| if error.count == 0 { 0.0 } else { error.count as f64 * error.rmse().powi(2) };
    let count = all.count.checked_sub(part.count).filter(|count| *count > 0)?;
    Some(((squares(all) - squares(part)).max(0.0) / count as f64).sqrt())
}

/// Refused snapshots by reason; reasons that did not occur are left out.
fn rejected(command: &AxisCommand) -> BTreeMap<&'static str, u64> {
    REFUSALS.into_iter().zip(command.rejected_snapshots).filter(|(_, count)| *count > 0).collect()
}

impl fmt::Display for Latch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at {} s", self.by.join(", "), number(self.at_s))
    }
}

impl Latch {
    fn new(command: &AxisCommand, period: Duration) -> Option<Self> {
        let at_s = command.latched_at as f64 * period.as_secs_f64();
        let by = bit_names(command.latched_by & control_flag::LATCHED, &control_flag::NAMES).collect();
        let at_end = command.flags & control_flag::LATCHED != 0;
        (command.latches > 0).then_some(Self { by, at_s, times: command.latches, at_end })
    }
}

impl Operation {
    fn new(command: &AxisCommand) -> Option<Self> {
        let AxisCommand { operation, taken_requests: requests, refused_requests, .. } = *command;
        let mode = AxisMode::from_number(operation).map_or("unknown", AxisMode::name);
        (requests + u64::from(refused_requests) > 0).then_some(Self { mode, requests, refused_requests })
    }
}

impl AxisReport {
    fn new(axis: &Axis, command: &AxisCommand, snapshot: &AxisSnapshot, period: Duration) -> Self {
        let (classical, adaptive) = (&snapshot.classical_errors, &snapshot.adaptive_errors);
        let model = |errors: &ModelErrors, coefficients| {
            let figures = |error: &ErrorStatistics| ErrorFigures::new(error, &snapshot.output);
            ModelReport {
                one_step: figures(&errors.one_step),
                h_step: figures(&errors.h_step),
                free_run: figures(&errors.free_run),
                coefficients: CoefficientLists::new(coefficients),
            }
        };
        Self {
            latch: Latch::new(command, period),
            tracking: Tracking::new(&command.tracking),
            tracking_by_model: Tracking::new(&command.model_tracking),
            rmse_by_fallback: rmse_of_rest(&command.tracking, &command.model_tracking),
            rejected_snapshots: rejected(command),
            unsolved_plans: command.unsolved_plans,
            slowed_ticks: command.slowed_ticks,
            operation: Operation::new(command),
            why_fallback: why_never_by_model(axis, command, snapshot),
            identification: Identification {
                classical: model(classical, &snapshot.classical),
                adaptive: model(adaptive, &snapshot.adaptive),
                reduction_percent: Reduction::new(classical, adaptive),
                forgetting_factor: snapshot.forgetting_factor,
                updates: snapshot.updates,
                skipped: snapshot.skipped,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rest_of_errors_has_the_root_mean_square_of_its_own_values() {
        let of = |values: &[f64]| {
            let mut statistics = ErrorStatistics::default();
            values.iter().for_each(|value| statistics.push(*value));
            statistics
        };
        let (part, rest) = (of(&[1.0, -2.0, 5.0]), of(&[3.0, 4.0]));
        let all = of(&[1.0, 3.0, -2.0, 4.0, 5.0]);
        assert!((rmse_of_rest(&all, &part).unwrap() - rest.rmse()).abs() < 1e-12);
        assert_eq!(rmse_of_rest(&all, &of(&[])), Some(all.rmse()));
        assert_eq!(rmse_of_rest(&all, &all), None);
    }
}
