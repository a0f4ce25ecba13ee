//! The report of `run` and `simulate`: figures of one control loop, as JSON and as tables.
//!
//! It is computed once, from the last messages of the run: every stage counts and measures by itself.

mod tables;

use std::collections::BTreeMap;

use pipeline::{
    latency::Percentiles,
    machine::Machine,
    message::{
        AxisCommand, AxisMode, AxisSnapshot, ChannelHealth, CoefficientSnapshot, MissedDeadlines, ModelErrors,
        REFUSALS, StageHealth, ValveCommand,
    },
    stage::{Clock, StageKind},
    statistics::ErrorStatistics,
};
use serde::Serialize;

use super::figures::{CoefficientLists, ErrorFigures, Reduction};

/// The figures of one run; SI units, but for times in ns.
#[derive(Debug, Serialize)]
pub struct LoopReport {
    axes: BTreeMap<String, AxisReport>,
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
    tracking: Tracking,
    tracking_by_model: Tracking,
    /// Refused snapshots, by reason.
    rejected_snapshots: BTreeMap<&'static str, u64>,
    /// Plans that the solver did not solve.
    unsolved_plans: u64,
    /// Present when a program has operated the axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    operation: Option<Operation>,
    identification: Identification,
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
            (axis.name.clone(), AxisReport::new(&command, &snapshot))
        });
        let stages = StageKind::ALL
            .into_iter()
            .filter_map(|kind| health(kind).map(|health| (kind.name(), StageReport::new(kind, health, last, clock))));
        let percentiles = |kind, of: fn(&StageHealth) -> Percentiles| health(kind).map(of).unwrap_or_default();
        let ticks = last.sum(StageKind::SensorProc, |health| health.samples);
        Self {
            axes: axes.collect(),
            stages: stages.collect(),
            end_to_end_ns: percentiles(StageKind::ControlProc, |health| health.end_to_end),
            release_jitter_ns: percentiles(StageKind::SensorProc, |health| health.release_jitter),
            ticks,
            wall_s,
            model_s: ticks as f64 * machine.timing.period.as_secs_f64(),
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
        let ChannelHealth { received, lost, longest_gap_ns, .. } = *channel;
        Self { received, lost, longest_gap_ns }
    }
}

impl Tracking {
    fn new(error: &ErrorStatistics) -> Self {
        let max = if error.count > 0 { error.max } else { f64::NAN };
        Self { sigma: error.sigma(), rmse: error.rmse(), max, count: error.count }
    }
}

/// Refused snapshots by reason; reasons that did not occur are left out.
fn rejected(command: &AxisCommand) -> BTreeMap<&'static str, u64> {
    REFUSALS.into_iter().zip(command.rejected_snapshots).filter(|(_, count)| *count > 0).collect()
}

impl Operation {
    fn new(command: &AxisCommand) -> Option<Self> {
        let AxisCommand { operation, taken_requests: requests, refused_requests, .. } = *command;
        let mode = AxisMode::from_number(operation).map_or("unknown", AxisMode::name);
        (requests + u64::from(refused_requests) > 0).then_some(Self { mode, requests, refused_requests })
    }
}

impl AxisReport {
    fn new(command: &AxisCommand, snapshot: &AxisSnapshot) -> Self {
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
            tracking: Tracking::new(&command.tracking),
            tracking_by_model: Tracking::new(&command.model_tracking),
            rejected_snapshots: rejected(command),
            unsolved_plans: command.unsolved_plans,
            operation: Operation::new(command),
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
