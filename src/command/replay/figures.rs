//! How well two models have predicted, and how far two controllers are apart, over the same ticks.

use pipeline::{
    message::{AxisSnapshot, ModelErrors},
    statistics::ErrorStatistics,
};
use serde::Serialize;

/// Errors of predictions at one tick, m: of the recorded model and of the one of the replay.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Errors {
    /// One step ahead.
    pub one_step: Option<f64>,
    /// The horizon ahead.
    pub h_step: Option<f64>,
}

/// Finds the errors of each tick in the statistics of a model.
#[derive(Debug, Clone, Default)]
pub struct ErrorWatch {
    last: Option<ModelErrors>,
}

impl ErrorWatch {
    /// The errors of the tick of this snapshot; none while there are no predictions.
    pub fn look(&mut self, snapshot: &AxisSnapshot) -> Errors {
        let now = snapshot.adaptive_errors;
        let Some(before) = self.last.replace(now) else { return Errors::default() };
        Errors { one_step: newest(&before.one_step, &now.one_step), h_step: newest(&before.h_step, &now.h_step) }
    }
}

/// The value that was added to `before`: mean_n = mean_(n-1) + (e - mean_(n-1)) / n.
fn newest(before: &ErrorStatistics, after: &ErrorStatistics) -> Option<f64> {
    let is_next = after.count == before.count + 1;
    let error = before.mean + after.count as f64 * (after.mean - before.mean);
    (is_next && error.is_finite()).then_some(error)
}

/// Two series of errors over the same ticks.
#[derive(Debug, Clone, Copy, Default)]
pub struct Pair {
    was: ErrorStatistics,
    now: ErrorStatistics,
}

impl Pair {
    fn push(&mut self, was: Option<f64>, now: Option<f64>) {
        if let (Some(was), Some(now)) = (was, now) {
            self.was.push(was);
            self.now.push(now);
        }
    }

    fn figures(&self) -> PairFigures {
        let rms = |errors: &ErrorStatistics| (errors.count > 0).then(|| errors.rmse());
        PairFigures { ticks: self.was.count, was_rms: rms(&self.was), now_rms: rms(&self.now) }
    }
}

/// Root mean squares of both series.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PairFigures {
    /// Ticks at which both have an error.
    pub ticks: u64,
    /// Of the recording, m.
    pub was_rms: Option<f64>,
    /// Of the replay, m.
    pub now_rms: Option<f64>,
}

/// How far the commands of a replay are from those of the recording.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct CommandFigures {
    /// Ticks at which both commanded.
    pub ticks: u64,
    /// Ticks at which the commands differ.
    pub different: u64,
    /// Root mean square of the difference.
    pub rms: Option<f64>,
    /// Largest magnitude of the difference.
    pub max: f64,
    /// Tick of the largest difference.
    pub max_tick: u64,
    /// Ticks at which another controller commanded.
    pub other_mode: u64,
}

/// Figures of one axis.
#[derive(Debug, Clone, Serialize)]
pub struct AxisFigures {
    /// Name of the axis.
    pub axis: String,
    /// Prediction one step ahead.
    pub one_step: PairFigures,
    /// Prediction the horizon ahead.
    pub h_step: PairFigures,
    /// Commands.
    pub command: CommandFigures,
}

/// Collects the figures of one axis.
#[derive(Debug, Clone, Default)]
pub struct AxisWatch {
    one_step: Pair,
    h_step: Pair,
    command: ErrorStatistics,
    different: u64,
    max_tick: u64,
    other_mode: u64,
}

impl AxisWatch {
    /// Takes in the errors of a tick.
    pub fn errors(&mut self, was: &Errors, now: &Errors) {
        self.one_step.push(was.one_step, now.one_step);
        self.h_step.push(was.h_step, now.h_step);
    }

    /// Takes in the commands of a tick, and the numbers of the controllers that made them.
    pub fn commands(&mut self, tick: u64, was: (f64, u32), now: (f64, u32)) {
        let difference = now.0 - was.0;
        if difference.abs() > self.command.max {
            self.max_tick = tick;
        }
        self.command.push(difference);
        self.different += u64::from(was.0.to_bits() != now.0.to_bits());
        self.other_mode += u64::from(was.1 != now.1);
    }

    /// The figures.
    pub fn figures(&self, axis: &str) -> AxisFigures {
        AxisFigures {
            axis: axis.to_owned(),
            one_step: self.one_step.figures(),
            h_step: self.h_step.figures(),
            command: CommandFigures {
                ticks: self.command.count,
                different: self.different,
                rms: (self.command.count > 0).then(|| self.command.rmse()),
                max: self.command.max,
                max_tick: self.max_tick,
                other_mode: self.other_mode,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_errors_of_the_ticks_come_back_out_of_their_statistics() {
        let mut watch = ErrorWatch::default();
        let mut snapshot = AxisSnapshot::default();
        assert_eq!(watch.look(&snapshot), Errors::default());
        for k in 0..10_000 {
            let error = 1e-3 * f64::from(k).sin() + 2e-4;
            snapshot.adaptive_errors.one_step.push(error);
            let errors = watch.look(&snapshot);
            assert!((errors.one_step.unwrap() - error).abs() < 1e-12, "{k}");
            assert_eq!(errors.h_step, None);
        }
        assert_eq!(watch.look(&snapshot), Errors::default());
    }

    #[test]
    fn only_ticks_with_both_errors_count_and_the_largest_difference_has_its_tick() {
        let mut axis = AxisWatch::default();
        let errors = |one_step| Errors { one_step, h_step: None };
        axis.errors(&errors(Some(3.0)), &errors(Some(1.0)));
        axis.errors(&errors(Some(100.0)), &errors(None));
        axis.commands(7, (0.1, 1), (0.1, 1));
        axis.commands(8, (0.1, 1), (-0.2, 2));
        axis.commands(9, (0.1, 2), (0.2, 2));
        let figures = axis.figures("boom");
        assert_eq!(
            (figures.one_step.ticks, figures.one_step.was_rms, figures.one_step.now_rms),
            (1, Some(3.0), Some(1.0))
        );
        assert_eq!(figures.h_step.was_rms, None);
        let CommandFigures { ticks, different, max_tick, other_mode, .. } = figures.command;
        assert_eq!((ticks, different, max_tick, other_mode), (3, 2, 8, 1));
    }
}
