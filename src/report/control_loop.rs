//! What `run` and `simulate` report: the same figures as tables and as JSON.

use std::collections::BTreeMap;

use pipeline::{
    latency::Percentiles,
    machine::{Axis, IdentifiedOutput, Machine},
    message::{
        AxisCommand, AxisMode, AxisSnapshot, ChannelHealth, CoefficientSnapshot, MissedDeadlines, ModelErrors,
        REFUSALS, StageHealth, ValveCommand,
    },
    stage::{Clock, StageKind},
    statistics::ErrorStatistics,
};
use serde::Serialize;

use super::{
    figures::{CoefficientLists, ErrorFigures, Reduction},
    table::{nanoseconds, number, percent, table},
};

/// The figures of one run.
#[derive(Debug, Serialize)]
pub struct Report {
    axes: BTreeMap<String, AxisReport>,
    stages: BTreeMap<&'static str, StageReport>,
    end_to_end_ns: Percentiles,
    release_jitter_ns: Percentiles,
    /// Ticks controlled.
    pub ticks: u64,
    /// Time that passed, s.
    pub wall_s: f64,
    /// Time of the machine, s.
    pub model_s: f64,
}

#[derive(Debug, Serialize)]
struct AxisReport {
    tracking: Tracking,
    tracking_by_model: Tracking,
    /// Those that were refused, by reason.
    rejected_snapshots: BTreeMap<&'static str, u64>,
    /// Plans without the solver.
    unsolved_plans: u64,
    /// Where a program has operated the axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    operation: Option<Operation>,
    identification: Identification,
}

#[derive(Debug, Serialize)]
struct Operation {
    /// At the end.
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
    /// In real time only: nothing is late where everybody waits.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    channels: BTreeMap<&'static str, ChannelReport>,
    implausible: u64,
    restarts: usize,
    /// What ended each life that was followed by another.
    restart_causes: Vec<String>,
    wait_ns: Percentiles,
    work_ns: Percentiles,
}

/// Deadlines missed, by what took longest.
#[derive(Debug, Serialize)]
struct MissedByCause {
    late_input: u64,
    late_release: u64,
    long_work: u64,
    /// Where there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    last_tick: Option<u64>,
}

/// A channel as a stage has read it.
#[derive(Debug, Serialize)]
struct ChannelReport {
    received: u64,
    lost: u64,
    longest_gap_ns: u64,
}

/// The last messages of a run, from which everything is reported.
#[derive(Debug, Default)]
pub struct LastMessages {
    /// From control-proc; none when a recording played.
    pub command: Option<ValveCommand>,
    /// From ident-proc.
    pub snapshot: Option<CoefficientSnapshot>,
    /// One per stage that ran, by [`StageKind`].
    pub health: [Option<StageHealth>; 4],
    /// The last ones of processes that were followed by others.
    pub former: Vec<StageHealth>,
    /// What ended those, by [`StageKind`].
    pub restart_causes: [Vec<String>; 4],
}

impl LastMessages {
    /// What all processes of a stage have counted together.
    fn sum(&self, kind: StageKind, of: fn(&StageHealth) -> u64) -> u64 {
        let former = self.former.iter().filter(|health| health.stage == kind as u32);
        self.health[kind as usize].iter().chain(former).map(of).sum()
    }
}

impl Report {
    /// From the last messages of a run that took `wall_s`.
    pub fn new(machine: &Machine, last: &LastMessages, clock: Clock, wall_s: f64) -> Self {
        let health = |kind: StageKind| last.health[kind as usize].as_ref();
        let axes = machine.axes.iter().enumerate().map(|(i, axis)| {
            let command = last.command.map(|command| command.axes[i]).unwrap_or_default();
            let snapshot = last.snapshot.map(|snapshot| snapshot.axes[i]).unwrap_or_default();
            (axis.name.clone(), AxisReport::new(&command, &snapshot))
        });
        let stages = StageKind::ALL.into_iter().filter_map(|kind| {
            health(kind).map(|health| {
                let sum = |of| last.sum(kind, of);
                let causes = &last.restart_causes[kind as usize];
                let stage = StageReport {
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
                };
                (kind.name(), stage)
            })
        });
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

    /// Messages lost over all stages.
    pub fn lost(&self) -> u64 {
        self.stages.values().map(|stage| stage.lost).sum()
    }

    /// The same as tables.
    pub fn tables(&self, machine: &Machine) -> String {
        let mut text = String::new();
        let axes = || machine.axes.iter().map(|axis| (&axis.name, &self.axes[&axis.name]));
        let by_velocity = |axis: &&Axis| axis.identification.output == IdentifiedOutput::Velocity;
        for axis in machine.axes.iter().filter(by_velocity) {
            text += &format!("{}: identified by its velocity, identification errors below are in mm/s.\n", axis.name);
        }
        text += "Tracking error, mm, and identification error, mm (sigma; h steps ahead; 1 - adaptive / classical):\n";
        let rows = axes().map(|(name, axis)| {
            let identification = &axis.identification;
            let (classical, adaptive) = (&identification.classical, &identification.adaptive);
            vec![
                name.clone(),
                number(1e3 * axis.tracking.rmse),
                number(1e3 * axis.tracking.max),
                number(1e3 * axis.tracking_by_model.rmse),
                percent(100.0 * axis.tracking_by_model.count as f64 / axis.tracking.count as f64),
                number(1e3 * classical.h_step.sigma),
                number(1e3 * adaptive.h_step.sigma),
                percent(identification.reduction_percent.h_step),
                number(1e3 * classical.one_step.sigma),
                number(1e3 * adaptive.one_step.sigma),
                percent(identification.reduction_percent.one_step),
            ]
        });
        let header = [
            "axis",
            "track rmse",
            "max",
            "by model",
            "of ticks",
            "h-step class.",
            "adaptive",
            "reduction",
            "1-step class.",
            "adaptive",
            "reduction",
        ];
        text += &format!("{}\n\n", table(&header, rows.collect()));
        let rows =
            StageKind::ALL.iter().filter_map(|kind| self.stages.get(kind.name()).map(|stage| (kind.name(), stage)));
        let rows = rows.map(|(name, stage)| {
            let mut row = vec![
                name.to_owned(),
                stage.samples.to_string(),
                stage.lost.to_string(),
                stage.missed_deadlines.to_string(),
            ];
            for p in [&stage.wait_ns, &stage.work_ns] {
                row.extend(
                    [p.p50, p.p99, p.p99_9, p.max].map(|v| if p.count > 0 { nanoseconds(v) } else { "-".into() }),
                );
            }
            row
        });
        let header =
            ["stage", "samples", "lost", "late", "wait p50", "p99", "p99.9", "max", "work p50", "p99", "p99.9", "max"];
        text += &format!("{}\n\n", table(&header, rows.collect()));
        let rows = [("end to end", &self.end_to_end_ns), ("release jitter", &self.release_jitter_ns)];
        let rows = rows.iter().filter(|(_, p)| p.count > 0).map(|(name, p)| {
            let mut row = vec![(*name).to_owned(), p.count.to_string()];
            row.extend([p.p50, p.p99, p.p99_9, p.p99_99, p.max].map(nanoseconds));
            row.push(p.beyond.to_string());
            row
        });
        let rows: Vec<_> = rows.collect();
        if !rows.is_empty() {
            let header = ["latency", "count", "p50", "p99", "p99.9", "p99.99", "max", "beyond"];
            text += &format!("{}\n\n", table(&header, rows));
        }
        for (name, stage) in self.stages.iter().filter(|(_, stage)| stage.restarts > 0) {
            let times = if stage.restarts == 1 { "once".to_owned() } else { format!("{} times", stage.restarts) };
            text += &format!("{name}: started again {times}: {}.\n", stage.restart_causes.join(", "));
        }
        for (name, axis) in axes() {
            if let Some(Operation { mode, requests, refused_requests }) = &axis.operation {
                text += &format!("{name}: {mode} after {requests} requests, {refused_requests} more refused.\n");
            }
        }
        for axis in machine.axes.iter().filter(|axis| self.axes[&axis.name].identification.updates == 0) {
            let training = axis.identification.training as f64 * machine.timing.period.as_secs_f64();
            text += &format!(
                "{}: no model yet, training takes {} s (axis.{}.identification.training); use a longer --duration.\n",
                axis.name,
                number(training),
                axis.name
            );
        }
        text += &format!(
            "{} ticks, {} s of the machine in {} s: {} lost.\n",
            self.ticks,
            number(self.model_s),
            number(self.wall_s),
            self.lost()
        );
        text
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

/// Refused snapshots by reason, without the reasons that there were not.
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
