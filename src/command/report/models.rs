//! The models of an axis over a recording: coefficients, forgetting, errors, and the curve of the valve.
//!
//! ```text
//! travel(u) = G N(u)                                   over the horizon, from rest
//! sigma of a span = sqrt((S2(end) - S2(begin)) / n),   S2 = n rmse^2, from the running statistics of the snapshots
//! ```

use pipeline::{
    hammerstein::Coefficients,
    message::{AxisSnapshot, MEMBERS, model_fault},
    statistics::ErrorStatistics,
};
use plotters::prelude::{Color, RGBAColor};

use super::line::{Line, Spread};
use crate::{
    model::response::travel_of_one,
    report::{
        chart::{COLOURS, Chart, HALF, Mark, Series, WIDE, tick},
        figures::CoefficientLists,
        page::Figure,
    },
};

/// Points of the curve of the valve.
const POINTS: usize = 200;
/// Curves of the adaptive model, spread over the recording.
const CURVES: usize = 3;
/// Spans of time that errors are compared in.
const SPANS: usize = 60;

/// The models of one axis.
#[derive(Debug)]
pub struct Models {
    spread: Spread<Moment>,
    forgetting: Line,
    /// The newest snapshot after the training.
    pub last: Option<Box<AxisSnapshot>>,
}

/// The models at one time.
#[derive(Debug)]
struct Moment {
    adaptive: Coefficients,
    /// h-step errors of held and adaptive model so far.
    errors: [ErrorStatistics; 2],
    /// Weights of the estimators that run side by side.
    weights: [f64; MEMBERS.len()],
}

impl Models {
    /// Nothing yet.
    pub fn new() -> Self {
        Self { spread: Spread::new(), forgetting: Line::new(), last: None }
    }

    /// Takes in a snapshot.
    pub fn look(&mut self, t: f64, snapshot: &AxisSnapshot) {
        if snapshot.faults & model_fault::TRAINING != 0 || snapshot.adaptive.structure().is_none() {
            return;
        }
        self.forgetting.push(t, snapshot.forgetting_factor);
        self.spread.push(t, || Moment {
            adaptive: snapshot.adaptive,
            errors: [snapshot.classical_errors.h_step, snapshot.adaptive_errors.h_step],
            weights: snapshot.weights,
        });
        match &mut self.last {
            Some(last) => **last = *snapshot,
            none => *none = Some(Box::new(*snapshot)),
        }
    }

    /// All pictures; none without a model.
    pub fn figures(&self) -> Vec<Figure> {
        let Some(last) = &self.last else { return Vec::new() };
        let mut figures = vec![self.errors(last), self.curve(last)];
        let lists: Vec<(f64, CoefficientLists)> =
            self.spread.kept().iter().map(|(t, moment)| (*t, CoefficientLists::new(&moment.adaptive))).collect();
        let held = CoefficientLists::new(&last.classical);
        for (name, first, of, what) in [
            ("a", 1, (|of| &of.a) as fn(&CoefficientLists) -> &Vec<f64>, "the effect of past outputs"),
            ("b", 0, |of| &of.b, "the effect of the commands behind N"),
            ("f", 1, |of| &of.f, "the shape of N(u) for u >= 0"),
            ("g", 1, |of| &of.g, "the shape of N(u) for u < 0"),
        ] {
            let chart = coefficients((name, first), &lists, of, of(&held));
            figures.push(Figure { chart, caption: format!("{name} is {what}. Thin lines: the held model.") });
        }
        figures.extend(self.weights());
        figures.push(self.forgetting());
        figures
    }

    /// Weights of the estimators over time, those that learn from one regressor together; none with a single estimator.
    fn weights(&self) -> Option<Figure> {
        let kept = self.spread.kept();
        if kept.iter().all(|(_, moment)| moment.weights.iter().all(|weight| *weight == 0.0)) {
            return None;
        }
        let family = |member: &'static str| member.split(' ').next().unwrap_or(member);
        let mut families: Vec<&str> = MEMBERS.map(family).to_vec();
        families.dedup();
        let of = |wanted: &str, moment: &Moment| {
            let own = MEMBERS.into_iter().zip(moment.weights).filter(|(member, _)| family(member) == wanted);
            own.map(|(_, weight)| weight).sum::<f64>()
        };
        let series = families.iter().zip(COLOURS).map(|(name, colour)| {
            line(name, kept.iter().map(|(t, moment)| (*t, of(name, moment))).collect(), colour, 3)
        });
        let chart = chart("Weights of the estimators", "weight", HALF, series.collect());
        let caption =
            "Several estimators run side by side; the adaptive model is their sum by these weights. held and \
                       still learn nothing: the held model, and no motion. The others are named by what they learn."
                .to_owned();
        Some(Figure { chart, caption })
    }

    /// Errors of both models over time, in spans of equal length.
    fn errors(&self, last: &AxisSnapshot) -> Figure {
        let kept = self.spread.kept();
        let step = kept.len().div_ceil(SPANS).max(1);
        let ends: Vec<&(f64, Moment)> = kept.iter().step_by(step).collect();
        let of = |model: usize| {
            let sigma = |pair: &[&(f64, Moment)]| {
                let [before, after] = [&pair[0].1.errors[model], &pair[1].1.errors[model]];
                (pair[1].0, 1e3 * rmse_between(before, after))
            };
            ends.windows(2).map(sigma).collect::<Vec<_>>()
        };
        let series = vec![line("held model", of(0), COLOURS[1], 3), line("adaptive model", of(1), COLOURS[0], 3)];
        let chart = chart(&format!("Prediction {} samples ahead", last.horizon), "error rms, mm", HALF, series);
        let caption = "Error of both models, root mean square over short spans of time; mm/s where the velocity was \
                       identified. Where nothing is drawn no sample was used, as while the axis rests."
            .to_owned();
        Figure { chart, caption }
    }

    /// The curve of the valve by the held model, and by the adaptive one at several times.
    fn curve(&self, last: &AxisSnapshot) -> Figure {
        let (low, high) = (last.command_low, last.command_high);
        let (low, high) = if high > low { (low, high) } else { (-1.0, 1.0) };
        let of = |model: &Coefficients| {
            let (gain, nonlinearity) = (travel_of_one(model, last.horizon as usize), model.nonlinearity());
            let at = |i: usize| low + (high - low) * i as f64 / POINTS as f64;
            (0..=POINTS).map(|i| (at(i), 1e3 * gain * nonlinearity.evaluate(at(i)))).collect::<Vec<_>>()
        };
        let kept = self.spread.kept();
        let mut series = vec![line("held model", of(&last.classical), COLOURS[1], 4)];
        for i in 0..CURVES {
            let (t, moment) = &kept[(kept.len() - 1) * i / CURVES];
            let colour = COLOURS[0].mix(0.25 + 0.25 * i as f64);
            series.push(line(&format!("adaptive, {t:.0} s"), of(&moment.adaptive), colour, 2));
        }
        series.push(line("in the end", of(&last.adaptive), COLOURS[0], 4));
        let mut chart = chart("The curve N(u) of the valve", "travel, mm", HALF, series);
        chart.labels[0] = "command u".to_owned();
        let caption = format!(
            "Travel within {} samples of a command that is held, from rest. Where it is flat, around 0, is the dead \
             band. The curves end at the lowest and highest command that the model has seen.",
            last.horizon
        );
        Figure { chart, caption }
    }

    fn forgetting(&self) -> Figure {
        let series = vec![line("", self.forgetting.points(), COLOURS[0], 2)];
        let chart = chart("Forgetting factor", "factor", WIDE, series);
        let caption = "1 remembers everything; at 0.99 a sample counts e times less after 100 samples.".to_owned();
        Figure { chart, caption }
    }
}

/// Root mean square of the values that came between two states of running statistics; NaN without any.
fn rmse_between(before: &ErrorStatistics, after: &ErrorStatistics) -> f64 {
    let squares = |errors: &ErrorStatistics| {
        if errors.count == 0 { 0.0 } else { errors.count as f64 * errors.rmse().powi(2) }
    };
    // A stage that starts again counts from zero.
    match after.count.checked_sub(before.count) {
        Some(count) if count > 0 => ((squares(after) - squares(before)).max(0.0) / count as f64).sqrt(),
        _ => f64::NAN,
    }
}

fn coefficients(
    (name, first): (&str, usize),
    lists: &[(f64, CoefficientLists)],
    of: fn(&CoefficientLists) -> &Vec<f64>,
    held: &[f64],
) -> Chart {
    let count = lists.iter().map(|(_, lists)| of(lists).len()).max().unwrap_or_default();
    let ends = [lists.first(), lists.last()].map(|end| end.map_or(0.0, |(t, _)| *t));
    let series = (0..count).zip(COLOURS).flat_map(|(i, colour)| {
        let value = |(t, lists): &(f64, CoefficientLists)| (*t, of(lists).get(i).copied().unwrap_or(f64::NAN));
        let held = held.get(i).map(|held| line("", ends.map(|t| (t, *held)).to_vec(), colour, 1));
        let adaptive = line(&format!("{name}_{}", i + first), lists.iter().map(value).collect(), colour, 3);
        [Some(adaptive), held].into_iter().flatten()
    });
    chart(&format!("{name} over time"), "coefficient", HALF, series.collect())
}

/// A line.
pub fn line(name: &str, points: Vec<(f64, f64)>, colour: impl Into<RGBAColor>, width: u32) -> Series {
    Series { name: name.to_owned(), points, colour: colour.into(), mark: Mark::Line(width) }
}

/// A chart over time.
pub fn chart(title: &str, label: &str, size: (u32, u32), series: Vec<Series>) -> Chart {
    Chart {
        title: title.to_owned(),
        size,
        labels: ["time, s".to_owned(), label.to_owned()],
        tick,
        y_tick: None,
        series,
        notes: Vec::new(),
        frame: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_drawn_by_families_where_there_are_any() {
        let mut snapshot = AxisSnapshot { adaptive: Coefficients::TABLE_2, ..AxisSnapshot::default() };
        let mut alone = Models::new();
        (0..10).for_each(|t| alone.look(f64::from(t), &snapshot));
        assert!(alone.weights().is_none());
        let mut models = Models::new();
        for t in 0..10 {
            snapshot.weights = [0.0; MEMBERS.len()];
            (snapshot.weights[0], snapshot.weights[6], snapshot.weights[8]) = (0.5, 0.25, 0.25);
            models.look(f64::from(t), &snapshot);
        }
        let series = models.weights().unwrap().chart.series;
        let drawn: Vec<(&str, f64)> = series.iter().map(|of| (of.name.as_str(), of.points[0].1)).collect();
        let rest = ["still", "linear", "increments", "directional"].map(|name| (name, 0.0));
        assert_eq!(drawn, [&[("held", 0.5)], &rest[..], &[("full", 0.5), ("smoothed", 0.0)]].concat());
    }

    #[test]
    fn the_error_of_a_span_is_that_of_its_own_values() {
        let mut errors = ErrorStatistics::default();
        [5.0, -7.0].into_iter().for_each(|error| errors.push(error));
        let before = errors;
        [3.0, 4.0].into_iter().for_each(|error| errors.push(error));
        assert!((rmse_between(&before, &errors) - 12.5f64.sqrt()).abs() < 1e-9);
        assert!(rmse_between(&errors, &errors).is_nan() && rmse_between(&errors, &before).is_nan());
    }
}
