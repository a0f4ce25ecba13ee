//! The report on drawn machines: how many were commissioned, and what their models gained over their fallbacks.
//!
//! ```text
//! ratio = max(rms of the model, q) / max(rms of the fallback, q)        q = resolution / sqrt(12)
//! ```
//!
//! q noise of rounding to counts, m. Errors below it are equal: neither controller can see them. The ratio of largest
//! errors is taken in the same way, with half a count.

use std::collections::BTreeMap;

use pipeline::message::{bit_names, control_flag};
use serde::Serialize;

use super::{
    Choice,
    drive::{Driven, Outcome, Pair, Run},
    rig::Rig,
    set::SetRow,
    task::Task,
};
use crate::report::{
    margins::LoopMargins,
    table::{number, table},
};

/// Ratio of the rms errors from which on the model is worse.
const WORSE: f64 = 1.05;
/// Ratio of the largest errors from which on the model is worse.
const WORSE_MAX: f64 = 1.2;
/// Number of the worst runs that the tables list.
pub const LISTED: usize = 12;

/// All figures; SI units.
#[derive(Debug, Serialize)]
pub struct DrawnReport {
    #[serde(flatten)]
    set: SetRow,
    tasks: Vec<TaskRow>,
    machines: Vec<MachineRow>,
}

/// One task over all machines.
#[derive(Debug, Serialize)]
struct TaskRow {
    task: &'static str,
    runs: usize,
    /// The controller that the model file chooses, by the fallback.
    as_chosen: Gain,
    /// The model, whatever the model file chooses, by the fallback.
    model: Gain,
    fallback: Faults,
    adaptive: Faults,
}

/// Ratios of the errors over all machines.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Gain {
    /// Of the rms errors.
    pub geometric_mean: f64,
    /// Runs with a ratio above 1.05.
    worse: usize,
    /// Largest ratio of the rms errors.
    pub worst: f64,
    /// Runs with a ratio of the largest errors above 1.2.
    worse_max: usize,
    /// Largest ratio of the largest errors.
    pub worst_max: f64,
}

/// What went wrong in the runs of one controller.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Faults {
    /// Runs that a fault ended.
    pub latched: usize,
    /// Holds that were no limit cycle, but not steady.
    pub unsteady: usize,
    /// Holds with a limit cycle.
    pub cycling: usize,
}

/// One machine.
#[derive(Debug, Serialize)]
struct MachineRow {
    machine: u64,
    parameters: Parameters,
    #[serde(skip_serializing_if = "Option::is_none")]
    refusal: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    model: Option<ModelRow>,
    tasks: BTreeMap<&'static str, RunPair>,
}

/// What was drawn.
#[derive(Debug, Serialize)]
struct Parameters {
    period_s: f64,
    valve_bandwidth_hz: f64,
    dead_time_s: f64,
    dead_band_extend: f64,
    dead_band_retract: f64,
    curve: &'static str,
    hysteresis: f64,
    resolution_m: f64,
    specific_mass_kg_per_n: f64,
    load: f64,
    speed_m_per_s: f64,
    stroke_m: f64,
    change: &'static str,
}

/// What commissioning found.
#[derive(Debug, Serialize)]
struct ModelRow {
    is_chosen: bool,
    fit_percent: f64,
    dead_time_s: f64,
    time_constant_s: f64,
    dead_band_extend: f64,
    dead_band_retract: f64,
    hysteresis: f64,
    natural_frequency_hz: f64,
    loops: Vec<LoopMargins>,
}

/// Both runs of one task.
#[derive(Debug, Serialize)]
struct RunPair {
    ratio: f64,
    ratio_max: f64,
    fallback: RunRow,
    adaptive: RunRow,
}

/// One run.
#[derive(Debug, Serialize)]
pub struct RunRow {
    /// m.
    pub rms_m: f64,
    max_m: f64,
    by_model: f64,
    latched: Vec<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    hold: Option<HoldRow>,
}

/// What was seen in a hold.
#[derive(Debug, Serialize)]
struct HoldRow {
    largest_m: f64,
    reversals: u64,
    neutral: f64,
    is_steady: bool,
    is_cycling: bool,
}

impl DrawnReport {
    /// The report on these machines.
    pub fn new(choice: &Choice, outcomes: &[Outcome<Driven>]) -> Self {
        let driven: Vec<(&Rig, &Driven)> =
            outcomes.iter().filter_map(|outcome| Some((&outcome.rig, outcome.result.as_ref().ok()?))).collect();
        Self {
            set: SetRow::new(choice, outcomes, |driven| driven.is_chosen),
            tasks: (0..Task::ALL.len()).map(|task| TaskRow::new(task, &driven)).collect(),
            machines: outcomes.iter().map(MachineRow::new).collect(),
        }
    }

    /// The tables.
    pub fn tables(&self) -> String {
        self.set.text() + &self.gains() + &self.faults() + &self.worst()
    }

    fn gains(&self) -> String {
        let mut rows = Vec::new();
        for task in &self.tasks {
            for (name, gain) in [("as chosen", task.as_chosen), ("model", task.model)] {
                rows.push(vec![
                    task.task.to_owned(),
                    name.to_owned(),
                    task.runs.to_string(),
                    number(gain.geometric_mean),
                    gain.worse.to_string(),
                    number(gain.worst),
                    gain.worse_max.to_string(),
                    number(gain.worst_max),
                ]);
            }
        }
        let header = ["error by fallback's", "", "runs", "mean", "above 1.05", "worst", "max above 1.2", "worst"];
        format!("\n{}\n", table(&header, rows))
    }

    fn faults(&self) -> String {
        let pair = |a: usize, b: usize| format!("{a} / {b}");
        let row = |task: &TaskRow| {
            let (f, a) = (task.fallback, task.adaptive);
            vec![
                task.task.to_owned(),
                pair(f.latched, a.latched),
                pair(f.cycling, a.cycling),
                pair(f.unsteady, a.unsteady),
            ]
        };
        let header = ["fallback / model", "latched", "cycling", "unsteady"];
        format!("\n{}\n", table(&header, self.tasks.iter().map(row).collect()))
    }

    fn worst(&self) -> String {
        let mut runs: Vec<(&MachineRow, &str, &RunPair)> = (self.machines.iter())
            .flat_map(|machine| machine.tasks.iter().map(move |(task, pair)| (machine, *task, pair)))
            .filter(|(.., pair)| pair.ratio > WORSE)
            .collect();
        runs.sort_by(|a, b| b.2.ratio.total_cmp(&a.2.ratio));
        let row = |(machine, task, pair): &(&MachineRow, &str, &RunPair)| {
            let p = &machine.parameters;
            let chosen = machine.model.as_ref().is_some_and(|model| model.is_chosen);
            vec![
                machine.machine.to_string(),
                (*task).to_owned(),
                number(pair.ratio),
                number(1e3 * pair.adaptive.rms_m),
                if chosen { "yes" } else { "no" }.to_owned(),
                milliseconds(p.period_s),
                milliseconds(p.dead_time_s),
                format!("{:.1} Hz", p.valve_bandwidth_hz),
                format!("{:.2} {:.2}", p.dead_band_extend, p.dead_band_retract),
                format!("{:.3}", p.hysteresis),
                p.curve.to_owned(),
                format!("{:.0} um", 1e6 * p.resolution_m),
                p.change.to_owned(),
            ]
        };
        if runs.is_empty() {
            return String::new();
        }
        let header = [
            "machine",
            "task",
            "ratio",
            "rms mm",
            "chosen",
            "period",
            "dead time",
            "valve",
            "dead bands",
            "hysteresis",
            "curve",
            "count",
            "change",
        ];
        format!("\n{}\n", table(&header, runs.iter().take(LISTED).map(row).collect()))
    }
}

fn milliseconds(seconds: f64) -> String {
    format!("{:.0} ms", 1e3 * seconds)
}

/// Ratios of the rms errors and of the largest errors of two runs of a machine: those of `run` by those of `by`.
pub fn ratios(rig: &Rig, run: &Run, by: &Run) -> (f64, f64) {
    let ratio = |of: fn(&Run) -> f64, least: f64| of(run).max(least) / of(by).max(least);
    (ratio(|run| run.error.rmse(), rig.resolution / 12f64.sqrt()), ratio(|run| run.error.max, 0.5 * rig.resolution))
}

impl TaskRow {
    fn new(task: usize, driven: &[(&Rig, &Driven)]) -> Self {
        let pairs: Vec<(&Rig, bool, &Pair)> =
            driven.iter().map(|(rig, driven)| (*rig, driven.is_chosen, &driven.tasks[task])).collect();
        let model: Vec<(f64, f64)> =
            pairs.iter().map(|(rig, _, pair)| ratios(rig, &pair.adaptive, &pair.fallback)).collect();
        let chosen: Vec<(f64, f64)> = pairs
            .iter()
            .zip(&model)
            .map(|((_, is_chosen, _), pair)| if *is_chosen { *pair } else { (1.0, 1.0) })
            .collect();
        Self {
            task: Task::ALL[task].name(),
            runs: pairs.len(),
            as_chosen: Gain::new(&chosen),
            model: Gain::new(&model),
            fallback: Faults::of(pairs.iter().map(|(.., pair)| &pair.fallback)),
            adaptive: Faults::of(pairs.iter().map(|(.., pair)| &pair.adaptive)),
        }
    }
}

impl Gain {
    /// Of pairs of ratios: rms errors, largest errors.
    pub fn new(ratios: &[(f64, f64)]) -> Self {
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(f64::NAN, f64::max);
        let mean = ratios.iter().map(|(rms, _)| rms.ln()).sum::<f64>() / ratios.len() as f64;
        Self {
            geometric_mean: mean.exp(),
            worse: ratios.iter().filter(|(rms, _)| *rms > WORSE).count(),
            worst: largest(&mut ratios.iter().map(|(rms, _)| *rms)),
            worse_max: ratios.iter().filter(|(_, max)| *max > WORSE_MAX).count(),
            worst_max: largest(&mut ratios.iter().map(|(_, max)| *max)),
        }
    }
}

impl Faults {
    /// Counted over these runs.
    pub fn of<'a>(runs: impl Iterator<Item = &'a Run>) -> Self {
        runs.fold(Self::default(), |faults, run| {
            let (is_held, is_cycling) = (run.hold.is_watched(), run.hold.is_cycling());
            Self {
                latched: faults.latched + usize::from(run.latched != 0),
                unsteady: faults.unsteady + usize::from(is_held && !is_cycling && !run.hold.is_steady()),
                cycling: faults.cycling + usize::from(is_cycling),
            }
        })
    }
}

impl MachineRow {
    fn new(outcome: &Outcome<Driven>) -> Self {
        let rig = &outcome.rig;
        let parameters = Parameters {
            period_s: rig.period(),
            valve_bandwidth_hz: rig.valve_bandwidth,
            dead_time_s: rig.dead_time,
            dead_band_extend: rig.dead_band.extend,
            dead_band_retract: rig.dead_band.retract,
            curve: if rig.is_s_shaped { "s" } else { "linear" },
            hysteresis: rig.hysteresis,
            resolution_m: rig.resolution,
            specific_mass_kg_per_n: rig.specific_mass,
            load: rig.load,
            speed_m_per_s: rig.speed,
            stroke_m: rig.stroke,
            change: rig.change.name,
        };
        let driven = outcome.result.as_ref().ok();
        let model = driven.map(|driven| ModelRow {
            is_chosen: driven.is_chosen,
            fit_percent: driven.model.fit_percent,
            dead_time_s: driven.model.dead_time,
            time_constant_s: driven.model.time_constant,
            dead_band_extend: driven.model.dead_band.extend,
            dead_band_retract: driven.model.dead_band.retract,
            hysteresis: driven.model.hysteresis,
            natural_frequency_hz: driven.model.natural_frequency,
            loops: driven.loops.clone(),
        });
        let tasks = driven.iter().flat_map(|driven| &driven.tasks).map(|pair| {
            let (ratio, ratio_max) = ratios(rig, &pair.adaptive, &pair.fallback);
            let [fallback, adaptive] = [&pair.fallback, &pair.adaptive].map(RunRow::new);
            (pair.task.name(), RunPair { ratio, ratio_max, fallback, adaptive })
        });
        Self {
            machine: rig.number,
            parameters,
            refusal: outcome.result.as_ref().err().map(|refusal| refusal.message.clone()),
            model,
            tasks: tasks.collect(),
        }
    }
}

impl RunRow {
    /// Of a run.
    pub fn new(run: &Run) -> Self {
        Self {
            rms_m: run.error.rmse(),
            max_m: run.error.max,
            by_model: run.by_model as f64 / run.error.count.max(1) as f64,
            latched: bit_names(run.latched, &control_flag::NAMES).collect(),
            hold: run.hold.is_watched().then(|| HoldRow {
                largest_m: run.hold.seen.largest(),
                reversals: run.hold.seen.reversals,
                neutral: run.hold.seen.neutral(),
                is_steady: run.hold.is_steady(),
                is_cycling: run.hold.is_cycling(),
            }),
        }
    }
}
