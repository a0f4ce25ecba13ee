//! The report of `hydraxis bench control`: tracking errors aggregated over axes and seeds.

use std::collections::BTreeMap;

use pipeline::{
    machine::Axis,
    message::{bit_names, control_flag},
    statistics::ErrorStatistics,
};
use serde::Serialize;

use super::contest::{AxisResult, Case, Contest, Entry};
use crate::report::table::{number, table};

/// All figures; SI units.
#[derive(Debug, Serialize)]
pub struct BenchReport {
    rows: Vec<BenchRow>,
    gains: Vec<Gains>,
}

/// One controller under one scenario at one dead time.
#[derive(Debug, Serialize)]
struct BenchRow {
    controller: &'static str,
    scenario: String,
    dead_time_s: f64,
    #[serde(flatten)]
    errors: TrackingErrors,
    /// Part of the ticks at which a model controlled, from 0 to 1.
    by_model: f64,
    /// The axes, over all seeds, that a fault had latched at the end.
    latched: Vec<LatchedAxis>,
    axes: BTreeMap<String, TrackingErrors>,
}

/// An axis that a fault had latched.
#[derive(Debug, Serialize)]
struct LatchedAxis {
    axis: String,
    seed: u64,
    /// Time since the start of the course, s.
    time_s: f64,
    causes: Vec<&'static str>,
}

/// Statistics of reference minus true position, m.
#[derive(Debug, Clone, Copy, Serialize)]
struct TrackingErrors {
    rms: f64,
    sigma: f64,
    max: f64,
    #[serde(skip)]
    statistics: ErrorStatistics,
}

/// Tuned gains of a baseline, or of the controller that controls while there is no model.
#[derive(Debug, Serialize)]
struct Gains {
    controller: &'static str,
    dead_time_s: f64,
    axis: String,
    kp: f64,
    ki: f64,
}

impl From<ErrorStatistics> for TrackingErrors {
    fn from(statistics: ErrorStatistics) -> Self {
        Self { rms: statistics.rmse(), sigma: statistics.sigma(), max: statistics.max, statistics }
    }
}

impl BenchReport {
    /// The report from the results of all cases. Cases of one entry and scenario stand together.
    pub fn new(contest: &Contest, cases: &[Case], results: &[Vec<AxisResult>]) -> Self {
        let runs: Vec<(&Case, &Vec<AxisResult>)> = cases.iter().zip(results).collect();
        let groups = runs.chunk_by(|a, b| (a.0.entry, a.0.scenario) == (b.0.entry, b.0.scenario));
        let gains = contest.entries.iter().flat_map(|entry| {
            entry.axes.iter().map(|axis| Gains {
                controller: entry.kind.name(),
                dead_time_s: entry.dead_time.as_secs_f64(),
                axis: axis.name.clone(),
                kp: axis.control.kp,
                ki: axis.control.ki,
            })
        });
        Self { rows: groups.map(|group| BenchRow::new(contest, group)).collect(), gains: gains.collect() }
    }

    /// Two tables: one line per controller and dead time, and one line per scenario and dead time.
    pub fn tables(&self) -> String {
        let mut text = self.by_controller() + &self.by_scenario();
        let latched: usize = self.rows.iter().map(|row| row.latched.len()).sum();
        if latched > 0 {
            text += &format!("{latched} times a fault latched an axis; --json says which fault, when and where.\n");
        }
        text
    }

    fn by_controller(&self) -> String {
        let entries = self.rows.chunk_by(|a, b| (a.controller, a.dead_time_s) == (b.controller, b.dead_time_s));
        let rows = entries.map(|rows| {
            let rms_of =
                |name: &str| rows.iter().find(|row| row.scenario == name).map_or(f64::NAN, |row| row.errors.rms);
            let worst = rows.iter().max_by(|a, b| a.errors.rms.total_cmp(&b.errors.rms)).unwrap_or(&rows[0]);
            let all = TrackingErrors::from(merged(rows.iter().map(|row| &row.errors.statistics)));
            let mm = |metres: f64| number(1e3 * metres);
            vec![
                rows[0].controller.to_owned(),
                milliseconds(rows[0].dead_time_s),
                mm(rms_of("nominal")),
                mm(worst.errors.rms),
                worst.scenario.clone(),
                mm(all.rms),
                mm(all.sigma),
                mm(all.max),
            ]
        });
        let header = ["controller", "dead time", "nominal", "worst", "scenario", "all", "sigma", "max"];
        format!(
            "Tracking error over all axes and seeds, mm (rms; sigma and max over all scenarios):\n{}\n\n",
            table(&header, rows.collect())
        )
    }

    fn by_scenario(&self) -> String {
        let mut places: Vec<(f64, &str)> = Vec::new();
        let mut controllers: Vec<&str> = Vec::new();
        for row in &self.rows {
            let place = (row.dead_time_s, row.scenario.as_str());
            if !places.contains(&place) {
                places.push(place);
            }
            if !controllers.contains(&row.controller) {
                controllers.push(row.controller);
            }
        }
        let rows = places.into_iter().map(|(dead_time, scenario)| {
            // At every place the rows have the order of the controllers.
            let here = self.rows.iter().filter(|row| (row.dead_time_s, row.scenario.as_str()) == (dead_time, scenario));
            let cells = [scenario.to_owned(), milliseconds(dead_time)].into_iter();
            cells.chain(here.map(|row| number(1e3 * row.errors.rms))).collect()
        });
        let header = [&["rms by scenario", "dead time"], &controllers[..]].concat();
        format!("{}\n", table(&header, rows.collect()))
    }
}

fn milliseconds(seconds: f64) -> String {
    format!("{:.0} ms", 1e3 * seconds)
}

impl BenchRow {
    /// The row from the runs of one entry under one scenario.
    fn new(contest: &Contest, runs: &[(&Case, &Vec<AxisResult>)]) -> Self {
        let (entry, scenario) = (&contest.entries[runs[0].0.entry], &contest.scenarios[runs[0].0.scenario]);
        let all = || runs.iter().flat_map(|(_, axes)| axes.iter());
        let statistics = merged(all().map(|result| &result.error));
        let axes = entry.axes.iter().enumerate().map(|(index, axis)| {
            let errors = merged(runs.iter().map(|(_, axes)| &axes[index].error));
            (axis.name.clone(), TrackingErrors::from(errors))
        });
        Self {
            controller: entry.kind.name(),
            scenario: scenario.scenario.name.clone(),
            dead_time_s: entry.dead_time.as_secs_f64(),
            errors: statistics.into(),
            by_model: all().map(|result| result.by_model).sum::<u64>() as f64 / statistics.count as f64,
            latched: runs.iter().flat_map(|(case, axes)| latched(entry, case.seed, axes)).collect(),
            axes: axes.collect(),
        }
    }
}

fn latched(entry: &Entry, seed: u64, results: &[AxisResult]) -> Vec<LatchedAxis> {
    let latched = |(axis, result): (&Axis, &AxisResult)| {
        let latch = result.latched?;
        let causes = bit_names(latch.causes, &control_flag::NAMES).collect();
        Some(LatchedAxis { axis: axis.name.clone(), seed, time_s: latch.time, causes })
    };
    entry.axes.iter().zip(results).filter_map(latched).collect()
}

fn merged<'a>(parts: impl Iterator<Item = &'a ErrorStatistics>) -> ErrorStatistics {
    parts.fold(ErrorStatistics::default(), |mut all, part| {
        all.merge(part);
        all
    })
}
