//! The report of `run` and `simulate` as tables for people: axes, stages, latencies, and lines about what was unusual.

use std::time::Duration;

use pipeline::{
    machine::{Axis, IdentifiedOutput, Machine, Source},
    stage::StageKind,
};

use super::{AxisReport, LoopReport, Operation};
use crate::report::{
    events::{Event, LATCH, RESTART},
    table::{nanoseconds, number, percent, table},
    teeth::TeethFigures,
};

/// Events that the tables show.
const MOST_EVENTS: usize = 10;

/// Below the table of the axes where a reduction is negative.
const NEGATIVE_REDUCTION: &str = " A negative reduction: the classical model predicted these samples better than the \
    adaptive one, as where little changes\n \
    after the training. It is no figure of the tracking.\n";
/// Time for which the model and the fallback must each have controlled an axis before their errors are compared.
/// Shorter parts of the motion have little in common.
const LEAST_COMPARED: Duration = Duration::from_secs(5);
/// Above the comparison of the model with the fallback.
const GAINS: &str = "Tracking error in this run (rms, each over the ticks in which it controlled):\n";

impl LoopReport {
    /// All figures as tables.
    pub fn tables(&self, machine: &Machine) -> String {
        let parts = [
            self.latches(machine),
            self.axis_table(machine),
            self.stage_table(),
            self.latency_table(),
            self.restarts(),
            self.foreign(),
            self.operations(machine),
            self.faults(),
            self.training_hints(machine),
            self.fallbacks(machine),
            self.gains(machine),
            self.teeth.as_ref().map(TeethFigures::line).unwrap_or_default(),
        ];
        let total = format!(
            "{} ticks, {} s of the machine in {} s: {} lost.\n",
            self.ticks,
            number(self.model_s),
            number(self.wall_s),
            self.lost()
        );
        parts.concat() + &total
    }

    /// A line for each axis that a fault has latched.
    fn latches(&self, machine: &Machine) -> String {
        let line = |axis: &Axis| {
            let latch = self.axes[&axis.name].latch.as_ref()?;
            let times = if latch.times > 1 { format!(" {} times, last", latch.times) } else { String::new() };
            let since = if latch.at_end {
                "its valve has been neutral since, and its tracking error ends there"
            } else {
                "it was released later"
            };
            Some(format!("axis.{}: LATCHED{times} by {latch}; {since}.\n", axis.name))
        };
        machine.axes.iter().filter_map(line).collect()
    }

    /// A line for each channel with messages that were not read.
    fn foreign(&self) -> String {
        let channels = self.stages.iter().flat_map(|(stage, report)| {
            report.channels.iter().map(move |(channel, figures)| (stage, channel, figures.foreign))
        });
        let line = |(stage, channel, count): (&&str, &&str, u64)| {
            format!(
                "{stage} <- {channel}: {count} messages not read, because they are about another machine or do not say \
                 about which.\n"
            )
        };
        channels.filter(|(.., count)| *count > 0).map(line).collect()
    }

    fn axis_table(&self, machine: &Machine) -> String {
        let mut text = String::new();
        let by_velocity = |axis: &&Axis| axis.identification.output == IdentifiedOutput::Velocity;
        for axis in machine.axes.iter().filter(by_velocity) {
            text += &format!("{}: identified by its velocity, identification errors below are in mm/s.\n", axis.name);
        }
        text += "Tracking error, mm, and identification error, mm (sigma; h steps ahead; 1 - adaptive / classical):\n";
        let rows = machine.axes.iter().map(|axis| axis_row(&axis.name, &self.axes[&axis.name]));
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
        text += &format!("{}\n", table(&header, rows.collect()));
        let reductions = self.axes.values().map(|axis| &axis.identification.reduction_percent);
        if reductions.into_iter().any(|reduction| reduction.h_step < 0.0 || reduction.one_step < 0.0) {
            text += NEGATIVE_REDUCTION;
        }
        text + "\n"
    }

    /// Tracking by the model against tracking by the fallback, for each axis that both have controlled for long enough.
    fn gains(&self, machine: &Machine) -> String {
        let least = LEAST_COMPARED.as_secs_f64() / machine.timing.period.as_secs_f64();
        let line = |axis: &Axis| {
            let AxisReport { tracking, tracking_by_model: by_model, rmse_by_fallback, .. } = &self.axes[&axis.name];
            let by_fallback = rmse_by_fallback.as_ref()?;
            let shorter = by_model.count.min(tracking.count - by_model.count);
            let is_ground = shorter as f64 >= least && by_model.rmse.is_finite() && by_fallback.is_finite();
            let [model, fallback] = [by_model.rmse, *by_fallback].map(|rmse| 1e3 * rmse);
            is_ground.then(|| format!(" {}: model {model:.1} mm, fallback {fallback:.1} mm\n", axis.name))
        };
        let lines: String = machine.axes.iter().filter_map(line).collect();
        if lines.is_empty() { lines } else { format!("{GAINS}{lines}") }
    }

    fn stage_table(&self) -> String {
        let stages = StageKind::ALL.iter().filter_map(|kind| Some((kind.name(), self.stages.get(kind.name())?)));
        let rows = stages.map(|(name, stage)| {
            let counts = [stage.samples, stage.lost, stage.missed_deadlines].map(|count| count.to_string());
            let mut row = vec![name.to_owned()];
            row.extend(counts);
            for p in [&stage.wait_ns, &stage.work_ns] {
                row.extend(
                    [p.p50, p.p99, p.p99_9, p.max].map(|v| if p.count > 0 { nanoseconds(v) } else { "-".into() }),
                );
            }
            row
        });
        let header =
            ["stage", "samples", "lost", "late", "wait p50", "p99", "p99.9", "max", "work p50", "p99", "p99.9", "max"];
        format!("{}\n\n", table(&header, rows.collect()))
    }

    /// Empty for a run that has measured neither latency.
    fn latency_table(&self) -> String {
        let latencies = [("end to end", &self.end_to_end_ns), ("release jitter", &self.release_jitter_ns)];
        let rows = latencies.iter().filter(|(_, p)| p.count > 0).map(|(name, p)| {
            let mut row = vec![(*name).to_owned(), p.count.to_string()];
            row.extend([p.p50, p.p99, p.p99_9, p.p99_99, p.max].map(nanoseconds));
            row.push(p.beyond.to_string());
            row
        });
        let rows: Vec<_> = rows.collect();
        if rows.is_empty() {
            return String::new();
        }
        let header = ["latency", "count", "p50", "p99", "p99.9", "p99.99", "max", "beyond"];
        format!("{}\n\n", table(&header, rows))
    }

    fn restarts(&self) -> String {
        let restarted = self.stages.iter().filter(|(_, stage)| stage.restarts > 0);
        let line = |(name, stage): (&&str, &super::StageReport)| {
            let times = if stage.restarts == 1 { "once".to_owned() } else { format!("{} times", stage.restarts) };
            format!("{name}: started again {times}: {}.\n", stage.restart_causes.join(", "))
        };
        restarted.map(line).collect()
    }

    fn operations(&self, machine: &Machine) -> String {
        let operated =
            machine.axes.iter().filter_map(|axis| Some((&axis.name, self.axes[&axis.name].operation.as_ref()?)));
        let line = |(name, operation): (&String, &Operation)| {
            let Operation { mode, requests, refused_requests } = operation;
            format!("{name}: {mode} after {requests} requests, {refused_requests} more refused.\n")
        };
        operated.map(line).collect()
    }

    /// Why the fallback controls, for each axis that no model has controlled; other lines tell of one without a model.
    fn fallbacks(&self, machine: &Machine) -> String {
        let line = |axis: &Axis| {
            let report = &self.axes[&axis.name];
            let why = report.why_fallback.as_ref().filter(|_| report.identification.updates > 0)?;
            Some(format!("{}: by the fallback: {why}.\n", axis.name))
        };
        machine.axes.iter().filter_map(line).collect()
    }

    /// The last events that are faults; latches have lines of their own.
    fn faults(&self) -> String {
        let is_shown = |event: &&Event| event.is_fault && ![LATCH, RESTART].contains(&event.kind);
        let faults: Vec<&Event> = self.events.iter().flatten().filter(is_shown).collect();
        let before = faults.len().saturating_sub(MOST_EVENTS);
        let mut text: String = faults[before..].iter().map(|event| event.line() + "\n").collect();
        if before > 0 {
            text = format!("{before} more events before these; --json lists them.\n{text}");
        }
        text
    }

    /// A line for each axis without a model: its run was too short, or it moved too little.
    fn training_hints(&self, machine: &Machine) -> String {
        let untrained = machine.axes.iter().filter(|axis| self.axes[&axis.name].identification.updates == 0);
        let line = |axis: &Axis| {
            let ticks = axis.identification.training as u64;
            let training = number(ticks as f64 * machine.timing.period.as_secs_f64());
            let report = &self.axes[&axis.name];
            if report.tracking_by_model.count > 0 {
                let name = &axis.name;
                return format!(
                    "{name}: errors of models are counted after {training} s of motion \
                     (axis.{name}.identification.training).\n"
                );
            }
            let has_followed = report.tracking.count > 0 || machine.source != Source::Sim;
            let why = if report.latch.is_some() {
                "a fault latched the axis before it had moved enough to be identified".to_owned()
            } else if self.ticks > ticks && !has_followed {
                "the axis has not followed its reference: it was not armed, or never had 0.2 s of healthy samples"
                    .to_owned()
            } else if self.ticks > ticks {
                format!("training takes {training} s of motion, and the axis has moved for less; let it move more")
            } else {
                format!(
                    "training takes {training} s of motion (axis.{}.identification.training); use a longer --duration",
                    axis.name
                )
            };
            format!("{}: no model yet: {why}.\n", axis.name)
        };
        untrained.map(line).collect()
    }
}

fn axis_row(name: &str, axis: &AxisReport) -> Vec<String> {
    let identification = &axis.identification;
    let (classical, adaptive) = (&identification.classical, &identification.adaptive);
    vec![
        name.to_owned(),
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
}
