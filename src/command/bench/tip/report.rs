//! The tables of `hydraxis bench tip`.
//!
//! Errors of several runs are taken together tick by tick. A controller is compared with the fallback over the runs
//! that both have brought to the end of the way.

use pipeline::statistics::{ErrorStatistics, median};
use serde::Serialize;

use super::{case::Row, controller::Controller, task::TipTaskKind};
use crate::report::{
    table::{number, table},
    teeth::Stopped,
};

/// All figures; m, degrees, s.
#[derive(Debug, Serialize)]
pub struct TipReport {
    /// Seed of tasks that were drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    drawn_with: Option<u64>,
    /// Names of the controllers, in the order of the tables.
    #[serde(skip)]
    controllers: Vec<&'static str>,
    rows: Vec<Row>,
}

/// A length in m as millimetres.
fn millimetres(length: Option<f64>) -> String {
    number(length.map_or(f64::NAN, |length| 1e3 * length))
}

/// The errors of several runs; none without a tick on the way.
fn merged<'r>(errors: impl Iterator<Item = &'r ErrorStatistics>) -> Option<ErrorStatistics> {
    let mut all = ErrorStatistics::default();
    errors.for_each(|error| all.merge(error));
    (all.count > 0).then_some(all)
}

/// The root mean square of several runs; none without a tick on the way.
fn rms<'r>(errors: impl Iterator<Item = &'r ErrorStatistics>) -> Option<f64> {
    merged(errors).map(|all| all.rmse())
}

impl TipReport {
    /// Of runs by the controllers of these names; `drawn_with` is the seed of tasks that were drawn.
    pub fn new(drawn_with: Option<u64>, controllers: Vec<&'static str>, rows: Vec<Row>) -> Self {
        Self { drawn_with, controllers, rows }
    }

    /// The runs.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// The tables for people.
    pub fn tables(&self) -> String {
        let is_usual = self.controllers.len() == Controller::chosen(&[]).len();
        match self.drawn_with {
            Some(seed) => self.table_of_drawn(seed),
            None if is_usual => format!("{}{}", self.table_of_tasks(), self.reasons()),
            None => format!("{}\n{}{}", self.summary(), self.table_by_task(), self.reasons()),
        }
    }

    fn of(&self, controller: &str) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(move |row| row.controller == controller)
    }

    /// The runs of a controller beside those of the fallback, where both came to the end of the way.
    fn beside_fallback(&self, controller: &str) -> Vec<(&Row, &Row)> {
        let fallback: Vec<&Row> = self.of(Controller::FALLBACK.name).collect();
        let same = |row: &Row| fallback.iter().find(|other| other.run() == row.run()).copied();
        let pairs = self.of(controller).filter_map(|row| Some((row, same(row)?)));
        pairs.filter(|(row, other)| row.is_done && other.is_done).collect()
    }

    /// A line for each controller, over all runs.
    fn summary(&self) -> String {
        let line = |controller: &&'static str| {
            let all = || self.of(controller);
            let driven = || all().filter(|row| row.refused.is_none());
            let error = merged(driven().map(|row| &row.error));
            let pairs = self.beside_fallback(controller);
            let errors = rms(pairs.iter().map(|(row, _)| &row.error));
            let errors = errors.zip(rms(pairs.iter().map(|(_, other)| &other.error))).map(|(own, other)| own / other);
            let time = |of: fn(&(&Row, &Row)) -> Option<f64>| pairs.iter().filter_map(of).sum::<f64>();
            let times = time(|(row, _)| row.time) / time(|(_, other)| other.time);
            vec![
                (*controller).to_owned(),
                driven().count().to_string(),
                millimetres(error.map(|error| error.rmse())),
                number(errors.unwrap_or(f64::NAN)),
                millimetres(error.map(|error| error.max)),
                number(rms(driven().map(|row| &row.pitch)).unwrap_or(f64::NAN)),
                number(times),
                driven().filter(|row| !row.is_done).count().to_string(),
                driven().filter(|row| !row.latches.is_empty()).count().to_string(),
                all().filter(|row| row.refused.is_some()).count().to_string(),
            ]
        };
        let header = [
            "controller",
            "runs",
            "rms",
            "by fallback",
            "max",
            "pitch",
            "time by fallback",
            "not done",
            "latched",
            "refused",
        ];
        format!(
            "Distance of the teeth from their way, mm (rms; max over all runs), and pitch, degrees (rms):\n{}",
            table(&header, self.controllers.iter().map(line).collect())
        )
    }

    /// A line for each controller, and a column for each task.
    fn table_by_task(&self) -> String {
        let tasks: Vec<&str> = TipTaskKind::ALL.iter().map(|task| task.name()).collect();
        let tasks: Vec<&str> = tasks.into_iter().filter(|task| self.rows.iter().any(|row| row.task == *task)).collect();
        let line = |controller: &&'static str| {
            let of = |task: &&str| {
                millimetres(rms(self.of(controller).filter(|row| row.task == *task).map(|row| &row.error)))
            };
            std::iter::once((*controller).to_owned()).chain(tasks.iter().map(of)).collect()
        };
        let header: Vec<&str> = std::iter::once("rms by task").chain(tasks.iter().copied()).collect();
        format!("{}\n", table(&header, self.controllers.iter().map(line).collect()))
    }

    /// A line for each controller and task that was refused or stopped by a wall, with the reason of the first run.
    fn reasons(&self) -> String {
        let refused = |row: &Row| row.refused.clone();
        let stopped = |row: &Row| row.stopped.as_ref().map(Stopped::to_string);
        self.told("refused", refused) + &self.told("stopped", stopped)
    }

    fn told(&self, what: &str, why: impl Fn(&Row) -> Option<String>) -> String {
        let mut told: Vec<(&str, &str)> = Vec::new();
        let mut text = String::new();
        for row in &self.rows {
            let Some(reason) = why(row).filter(|_| !told.contains(&(row.controller, row.task.as_str()))) else {
                continue;
            };
            told.push((row.controller, &row.task));
            let all = self.of(row.controller).filter(|other| other.task == row.task);
            let count = all.filter(|other| why(other).is_some()).count();
            text += &format!("{}, {}: {count} {what}, the first of them: {reason}\n", row.controller, row.task);
        }
        text
    }

    /// A line for each controller.
    fn table_of_drawn(&self, seed: u64) -> String {
        let line = |controller: &&'static str| {
            let all = || self.of(controller);
            let driven = || all().filter(|row| row.refused.is_none());
            let worst = driven().max_by(|a, b| a.rms.unwrap_or(0.0).total_cmp(&b.rms.unwrap_or(0.0)));
            vec![
                (*controller).to_owned(),
                driven().count().to_string(),
                all().filter(|row| row.refused.is_some()).count().to_string(),
                driven().filter(|row| !row.latches.is_empty()).count().to_string(),
                driven().filter(|row| !row.is_done).count().to_string(),
                millimetres(median(driven().filter_map(|row| row.rms))),
                millimetres(driven().filter_map(|row| row.max).reduce(f64::max)),
                worst.map_or(String::new(), |row| {
                    format!("task {}, {}: {}", row.task, row.scenario, millimetres(row.rms))
                }),
            ]
        };
        let lines = self.controllers.iter().map(line).collect();
        let header = ["controller", "driven", "refused", "latched", "not done", "median", "max", "worst"];
        format!(
            "Distance of the teeth from their way in tasks of seed {seed}, mm (rms; max over all):\n{}\n",
            table(&header, lines)
        )
    }

    /// A line for each task, speed and controller.
    fn table_of_tasks(&self) -> String {
        let mut rows: Vec<&Row> = self.rows.iter().collect();
        let key = |row: &Row| {
            let task = TipTaskKind::ALL.iter().position(|task| task.name() == row.task);
            let controller = self.controllers.iter().position(|name| *name == row.controller);
            (task, row.speed.to_bits(), controller)
        };
        rows.sort_by_key(|row| key(row));
        let lines = rows.chunk_by(|a, b| key(a) == key(b)).map(|group| {
            let driven = || group.iter().filter(|row| row.refused.is_none());
            let all = merged(driven().map(|row| &row.error));
            let worst = driven().max_by(|a, b| a.error.rmse().total_cmp(&b.error.rmse()));
            let nominal = driven().find(|row| row.scenario == "nominal" && row.payload == 0.0);
            vec![
                group[0].task.clone(),
                format!("{} m/s", group[0].speed),
                group[0].controller.to_owned(),
                millimetres(nominal.and_then(|row| row.rms)),
                millimetres(all.map(|all| all.rmse())),
                millimetres(all.map(|all| all.max)),
                worst.map_or(String::new(), |row| {
                    format!("{} {} kg: {}", row.scenario, row.payload, millimetres(row.rms))
                }),
                number(driven().filter_map(|row| row.duration).fold(f64::NAN, f64::max)),
                driven().filter(|row| !row.is_done).count().to_string(),
                format!("{}", group.iter().filter(|row| row.refused.is_some()).count()),
                format!("{}", group.iter().filter(|row| !row.latches.is_empty()).count()),
            ]
        });
        let header =
            ["task", "speed", "controller", "nominal", "all", "max", "worst", "s", "not done", "refused", "latched"];
        format!(
            "Distance of the teeth from their way, mm (rms; max over all runs):\n{}\n",
            table(&header, lines.collect())
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run whose error is the same at 100 ticks, m.
    fn row(controller: &'static str, seed: u64, error: f64, time: f64) -> Row {
        let mut row = Row { task: "level".to_owned(), controller, seed, is_done: true, ..Row::default() };
        (0..100).for_each(|_| row.error.push(error));
        row.pitch.push(1e3 * error);
        row.time = Some(time);
        row
    }

    fn words(text: &str, controller: &str) -> Vec<String> {
        let line = text.lines().find(|line| line.trim_start().starts_with(controller)).unwrap();
        line.split_whitespace().map(str::to_owned).collect()
    }

    #[test]
    fn the_summary_takes_all_seeds_together_and_compares_runs_that_both_have_done() {
        let refused = Row { refused: Some("found no way".to_owned()), is_done: false, ..row("joint", 2, 0.0, 0.0) };
        let stopped = Row { is_done: false, latches: vec!["boom".to_owned()], ..row("model", 2, 0.001, 0.0) };
        let rows = vec![
            row("fallback", 1, 0.001, 10.0),
            row("fallback", 2, 0.007, 10.0),
            row("model", 1, 0.003, 8.0),
            stopped,
            row("joint", 1, 0.0005, 5.0),
            refused,
        ];
        let report = TipReport::new(None, vec!["fallback", "model", "joint"], rows);
        let text = report.tables();
        // 5 mm is the root mean square of 1 and 7 mm.
        let expected = "fallback 2 5.0000 1.0000 7.0000 5.0000 1.0000 0 0 0";
        assert_eq!(words(&text, "fallback").join(" "), expected);
        let expected = "model 2 2.2361 3.0000 3.0000 2.2361 0.80000 1 1 0";
        assert_eq!(words(&text, "model").join(" "), expected);
        let expected = "joint 1 0.50000 0.50000 0.50000 0.50000 0.50000 0 0 1";
        assert_eq!(words(&text, "joint").join(" "), expected);
        assert!(text.contains("joint, level: 1 refused, the first of them: found no way\n"), "{text}");
    }
}
